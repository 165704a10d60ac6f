"""The monitor lets pass what records and requests allow, and halts all else."""

import math

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from config_file import load_config, with_changes
from core.driving import control, health, monitor, stop_zone
from core.driving.monitor import Monitor, Powers, Seen
from core.driving.stall import STALLED
from core.geometry import R_from_rpy, q_from_R
from core.mapping.method import MAX_SLOPE_RAD
from core.records import Attitude, DriveRequest, WheelCounts
from tests import ROOT
from tests.support.robot.monitored_robot import CONFIG, SHORT_S, TICK_S, Robot, attitude


def test_a_robot_in_order_gets_its_power_and_halts_are_counted() -> None:
    robot = Robot()
    assert robot.told(0.5, 0.2) == ""
    assert robot.monitor.halts == 0
    robot.tick()
    assert robot.told(0.5, 0.2, pose=None) == monitor.NO_POSE
    assert robot.monitor.halts == 1


def test_to_compile_its_kernel_halts_nothing() -> None:
    robot = Robot()
    robot.monitor.warm(Seen(None, None, robot.window, robot.mapped_s, math.inf))
    assert robot.told(0.5, 0.2) == ""
    assert robot.monitor.halts == 0


INPUTS = [
    ("scans", 0.2, monitor.NO_SCANS),
    ("map", 0.2, monitor.NOT_MAPPED),
    ("attitudes", 0.2, monitor.NO_ATTITUDE),
    ("counts", 0.45, monitor.NO_COUNTS),
]


@pytest.mark.parametrize(("name", "most_s", "why"), INPUTS)
def test_an_input_may_be_so_old_and_no_older(name: str, most_s: float, why: str) -> None:
    for late_s, said in ((-SHORT_S, ""), (SHORT_S, why)):
        robot = Robot()
        robot.held = {name}
        for _ in range(10):
            robot.tick((most_s + late_s) / 10)
            robot.passed((0.0, 0.0), (0.2, 0.0))
        assert robot.told(0.2, 0.0) == said


def test_scans_may_be_four_periods_old_where_that_is_longer() -> None:
    slow = load_config((ROOT / "robots" / "urg04lx.toml").read_text(encoding="utf-8"))
    assert slow.scanner.options.spec.period_s == pytest.approx(0.1, abs=0.01)
    for age_s, why in ((0.39, ""), (0.42, monitor.NO_SCANS)):
        robot = Robot(with_changes(slow, robot={"enable_motors": True}))
        robot.held = {"scans"}
        for _ in range(10):
            robot.tick(age_s / 10)
            robot.passed((0.0, 0.0), (0.2, 0.0))
        assert robot.told(0.02, 0.0) == why


def test_no_limit_of_its_own_is_narrower_than_the_pilots() -> None:
    assert control.LOOP_S + TICK_S < monitor.LATE_S
    assert health.LINK_STALE_S < monitor.SCANS_STALE_S
    assert health.STALE_PERIODS < monitor.STALE_PERIODS
    assert health.AHRS_STALE_S < monitor.ATTITUDE_STALE_S
    assert health.WHEELS_STALE_S < monitor.COUNTS_STALE_S
    assert math.cos(MAX_SLOPE_RAD) ** 2 > math.cos(monitor.MOST_TILT_RAD)
    assert control.LOOP_S + control.ORDER_S >= monitor.STOPPING_S
    assert monitor.MET_M > stop_zone.SLACK_M


def test_a_record_from_ahead_of_now_is_not_believed() -> None:
    for ahead_s, why in ((0.0999, ""), (0.1001, monitor.NO_SCANS)):
        robot = Robot()
        robot.monitor.scanned(robot.now_s + ahead_s)
        robot.monitor.scanned(robot.now_s)  # an older one makes it no better
        assert robot.told(0.2, 0.0) == why
    robot = Robot()
    robot.monitor.turned(attitude(robot.now_s + 0.2))
    robot.monitor.turned(attitude(robot.now_s))
    assert robot.told(0.2, 0.0) == monitor.NO_ATTITUDE
    robot = Robot()
    robot.monitor.counted(WheelCounts(robot.now_s + 0.2, 0.0, 0.0, 0))
    robot.monitor.counted(WheelCounts(robot.now_s, 0.0, 0.0, 0))
    assert robot.told(0.2, 0.0) == monitor.NO_COUNTS


@pytest.mark.parametrize("size", [1.006, 0.994, math.nan])
def test_what_is_no_rotation_is_no_attitude(size: float) -> None:
    robot = Robot()
    robot.held = {"attitudes"}
    for _ in range(22):
        robot.tick()
        robot.monitor.turned(attitude(robot.now_s, size=size))
        robot.passed((0.0, 0.0), (0.2, 0.0))
    assert robot.told(0.2, 0.0) == monitor.NO_ATTITUDE


def test_a_little_rounding_is_a_rotation() -> None:
    robot = Robot()
    robot.held = {"attitudes"}
    for _ in range(22):
        robot.tick()
        robot.monitor.turned(attitude(robot.now_s, size=1.004))
        robot.passed((0.0, 0.0), (0.2, 0.0))
    assert robot.told(0.2, 0.0) == ""


@pytest.mark.parametrize("mount", [(0.0, 0.0, 0.0), (20.0, -30.0, 50.0)])
@given(roll_rad=st.floats(-0.7, 0.7), pitch_rad=st.floats(-0.7, 0.7))
@example(roll_rad=0.15, pitch_rad=0.4247)
@example(roll_rad=0.15, pitch_rad=-0.4247)
@example(roll_rad=0.499, pitch_rad=0.0)
@example(roll_rad=0.0, pitch_rad=-0.501)
def test_a_body_that_leans_by_half_a_radian_is_halted_however_the_sensor_is_mounted(
    mount: tuple[float, float, float], roll_rad: float, pitch_rad: float
) -> None:
    keys = dict(zip(("mount_roll_deg", "mount_pitch_deg", "mount_yaw_deg"), mount, strict=True))
    robot = Robot(with_changes(CONFIG, ahrs=keys))
    R_body_sensor = R_from_rpy(*map(math.radians, mount))
    R_earth_body = R_from_rpy(roll_rad, pitch_rad, 2.0)
    q = q_from_R(R_earth_body @ R_body_sensor)
    robot.monitor.turned(Attitude(robot.now_s, tuple(q.tolist()), (0.0, 0.0, 0.0)))
    tilt_rad = math.acos(R_earth_body[2, 2])
    if abs(tilt_rad - 0.5) > 1e-6:
        assert robot.told(0.2, 0.0) == (monitor.LEANS if tilt_rad > 0.5 else "")


def test_a_pose_as_good_as_the_pilots_own_limits_passes() -> None:
    robot = Robot()
    robot.leans = 0.349, 0.349
    robot.tick()
    assert robot.told(0.2, 0.0) == ""


@pytest.mark.parametrize("moves", [(0.6, 0.0), (0.0, 0.8), (-0.4, 0.5)])
def test_it_measures_the_motion_by_the_counters_alone(moves: tuple[float, float]) -> None:
    robot = Robot(with_changes(CONFIG, robot={"encoder_ppr": 100, "gear_ratio": 5.0}))
    robot.moves = moves
    for _ in range(10):
        robot.tick()
    assert robot.monitor._wheels.motion == pytest.approx(moves)


def test_a_speed_takes_counts_of_two_instants_and_may_be_so_old() -> None:
    new = Robot()
    new.monitor = Monitor(CONFIG)
    for seconds, why in ((0.01, monitor.NO_SPEED), (0.0399, monitor.NO_SPEED), (0.0002, "")):
        new.tick(seconds)
        new.passed((0.0, 0.0), None)
        assert new.told(0.2, 0.0) == why
    for age_s, why in ((0.5999, ""), (0.6001, monitor.NO_SPEED)):
        robot = Robot()
        measured_s = robot.monitor._wheels.measured_s
        for _ in range(16):
            robot.restarts += 1  # each time the zero is lost
            robot.tick((measured_s + age_s - robot.now_s) / 2)
            robot.passed((0.0, 0.0), (0.2, 0.0))
        robot.now_s = measured_s + age_s
        assert robot.told(0.2, 0.0) == why


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_a_robot_far_beyond_its_greatest_speed_is_halted(sense: float) -> None:
    for speed_mps, why in ((1.199, ""), (1.201, monitor.TOO_FAST)):
        robot = Robot(with_changes(CONFIG, robot={"max_speed_mps": 0.8}))
        robot.moves = sense * speed_mps, 0.0
        for _ in range(12):
            robot.tick()
            robot.passed((0.0, 0.0), (0.2, 0.0))
        assert robot.told(0.2, 0.0) == why


@pytest.mark.parametrize(
    "powers", [(1.001, 0.0), (0.0, -1.001), (math.nan, 0.1), (0.1, math.inf), (-math.inf, 0.0)]
)
def test_what_is_no_power_does_not_go_out(powers: Powers) -> None:
    robot = Robot()
    assert robot.passed(powers, (1.0, 1.0)) == (0.0, 0.0)
    assert robot.monitor.why == monitor.NO_POWER


def test_full_power_of_both_wheels_may_go_out() -> None:
    robot = Robot()
    assert robot.passed((1.0, 1.0), (1.0, 0.0)) == (1.0, 1.0)
    assert Robot().passed((-1.0, -1.0), (-1.0, 0.0)) == (-1.0, -1.0)


def test_power_goes_out_only_while_a_request_holds() -> None:
    for request, why in (
        (None, monitor.NOT_ASKED),
        (DriveRequest(0.2, 0.0, -SHORT_S), monitor.NOT_ASKED),
        (DriveRequest(0.2, 0.0, 0.0), ""),
        (DriveRequest(0.2, 0.0, 1.0), ""),
        (DriveRequest(0.2, 0.0, 1.0 + SHORT_S), monitor.TOO_LONG),
        (DriveRequest(0.2, 0.0, math.nan), monitor.NOT_ASKED),
    ):
        robot = Robot()
        asked = request and DriveRequest(0.2, 0.0, robot.now_s + request.valid_until_s)
        assert robot.told(0.2, 0.0, request=asked) == why


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_the_power_is_no_more_than_what_is_asked_for(sense: float) -> None:
    for told, asked, why in (
        ((0.3, 0.0), (0.3, 0.0), ""),
        ((0.3, 0.0), (0.299, 0.0), monitor.UNLIKE),
        ((-0.01, 0.0), (0.3, 0.0), monitor.UNLIKE),
        ((0.0, 0.3), (0.0, 0.3), ""),
        ((0.0, 0.3), (0.0, 0.299), monitor.UNLIKE),
        ((0.0, 0.3), (0.3, 0.0), monitor.UNLIKE),
        ((0.4, 0.0), (3.0, 0.0), ""),
    ):
        robot = Robot()
        left, right = told[0] - 0.25 * told[1], told[0] + 0.25 * told[1]
        robot.passed((sense * left, sense * right), (sense * asked[0], sense * asked[1]))
        assert robot.monitor.why == why, (told, asked)


@pytest.mark.parametrize(("limits", "told"), [((0.3, 1.0), (0.3, 0.0)), ((1.0, 0.3), (0.0, 0.3))])
def test_the_power_is_no_more_than_the_settings_allow(
    limits: tuple[float, float], told: tuple[float, float]
) -> None:
    robot_keys = {"max_speed_mps": limits[0], "max_turn_radps": limits[1]}
    for share, why in ((1.0, ""), (1.01, monitor.UNLIKE), (-1.0, ""), (-1.01, monitor.UNLIKE)):
        robot = Robot(with_changes(CONFIG, robot=robot_keys))
        assert robot.told(share * told[0], share * told[1]) == why


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_what_was_asked_for_may_be_given_up_by_the_ramps_and_no_slower(sense: float) -> None:
    """Brakes of 0.8 m/s2 and 1.5 rad/s2: after ten ticks of 0.01 s it is 0.08 m/s and 0.15 rad/s
    less.
    """
    for v_mps, w_radps, why in (
        (0.42, 0.0, ""),
        (0.422, 0.0, monitor.UNLIKE),
        (0.0, 0.35, ""),
        (0.0, 0.352, monitor.UNLIKE),
    ):
        robot = Robot()
        robot.passed((0.0, 0.0), (sense * 0.5, sense * 0.5))
        for _ in range(10):
            robot.tick()
            robot.passed((0.0, 0.0), (sense * 0.01, 0.0))
        left, right = v_mps - 0.25 * w_radps, v_mps + 0.25 * w_radps
        robot.passed((sense * left, sense * right), (sense * 0.01, 0.0))
        assert robot.monitor.why == why, (v_mps, w_radps)


def test_a_late_tick_counts_for_a_twentieth_of_a_second_of_a_ramp() -> None:
    for v_mps, w_radps, why in (
        (0.459, 0.0, ""),
        (0.461, 0.0, monitor.UNLIKE),
        (0.0, 0.424, ""),
        (0.0, 0.426, monitor.UNLIKE),
    ):
        robot = Robot()
        robot.passed((0.0, 0.0), (0.5, 0.5))
        robot.tick(0.1)
        robot.passed((v_mps - 0.25 * w_radps, v_mps + 0.25 * w_radps), (0.01, 0.0))
        assert robot.monitor.why == why, (v_mps, w_radps)


def test_it_must_have_been_asked_a_moment_ago() -> None:
    for passed_s, why in ((0.1499, ""), (0.1501, monitor.WAS_AWAY)):
        robot = Robot()
        robot.tick(passed_s)
        assert robot.told(0.2, 0.0) == why
    new = Robot()
    new.monitor = Monitor(CONFIG)
    new.tick(0.05)
    new.tick(0.05)
    assert new.told(0.2, 0.0) == monitor.WAS_AWAY


def test_once_halted_it_waits_until_the_commander_lets_go() -> None:
    robot = Robot()
    robot.told(0.2, 0.0, pose=None)
    for _ in range(20):
        robot.tick()
        assert robot.told(0.2, 0.0) == monitor.NO_POSE
        assert robot.passed((0.0, 0.0), (0.2, 0.0)) == (0.0, 0.0)
    assert robot.monitor.halts == 1
    robot.tick()
    robot.passed((0.0, 0.0), (0.0, 0.0))
    assert robot.monitor.why == ""
    assert robot.told(0.0, 0.2) == ""
    assert robot.told(0.2, 0.2, pose=None) == monitor.NO_POSE
    robot.tick()
    request = DriveRequest(0.2, 0.0, robot.now_s - SHORT_S)  # it has run out
    robot.passed((0.0, 0.0), None, request=request)
    assert robot.monitor.why == ""
    for _ in range(3):
        robot.tick()
        robot.passed((0.1, 0.1), None)
    assert robot.monitor.why == monitor.NOT_ASKED
    assert robot.monitor.halts == 3


def test_wheels_that_do_not_follow_are_halted_and_power_that_was_held_back_is_no_stall() -> None:
    robot = Robot()
    said = []
    for _ in range(10):
        robot.tick(0.05)
        said.append(robot.told(0.4, 0.0))
    assert said == [""] * 9 + [STALLED]
    robot = Robot()
    for _ in range(40):
        robot.tick(0.05)
        assert robot.told(0.4, 0.0, pose=None) == monitor.NO_POSE
    robot.passed((0.0, 0.0), None)
    assert robot.told(0.4, 0.0) == ""
