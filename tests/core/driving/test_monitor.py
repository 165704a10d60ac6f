"""The monitor lets pass what the inputs allow, and halts all else, whatever a pilot computes."""

import math
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import Polygon, box
from shapely.affinity import rotate, translate

from config_file import load_config, with_changes
from core.config import Config
from core.driving import control, health, monitor
from core.driving.monitor import Monitor, Place, Powers, Seen
from core.driving.stall import STALLED
from core.geometry import R_from_rpy, q_from_R
from core.grid.window import ObstacleWindow
from core.mapping.method import MAX_SLOPE_RAD
from core.motion.track import Pose
from core.records import FREE, OBSTACLE, UNKNOWN, Attitude, DriveRequest, WheelCounts
from tests import ROOT
from tests.support.cases import examples

CONFIG = load_config((ROOT / "mapod.toml").read_text(encoding="utf-8"))
CONFIG = with_changes(CONFIG, robot={"enable_motors": True})
ROBOT = CONFIG.robot  # 0.52 m ahead of its axle, 0.20 m behind, 0.30 m to either side
PER_M = 4 * ROBOT.encoder_ppr * ROBOT.gear_ratio / (2 * math.pi * ROBOT.wheel_radius_m)
TICK_S, SHORT_S = 0.01, 1e-4
FAR_S = 0.5  # of a request
REACH_M = math.hypot(0.52, 0.30)


def attitude(t_s: float, roll_rad: float = 0.0, pitch_rad: float = 0.0, size: float = 1.0) -> Any:
    q = size * q_from_R(R_from_rpy(roll_rad, pitch_rad, 0.7))
    return Attitude(t_s, tuple(q.tolist()), (0.0, 0.0, 0.0))


class Robot:
    """A monitor on free ground; all records are as new as they can be, unless they are held."""

    def __init__(self, config: Config = CONFIG) -> None:
        self.config, self.monitor = config, Monitor(config)
        self.window = ObstacleWindow(101, 0.2)
        self.window.cells[...] = FREE
        self.x_m = self.y_m = self.yaw_rad = 0.0
        self.moves = 0.0, 0.0  # by the counters
        self.counts = [0.0, 0.0]
        self.now_s, self.restarts, self.mapped_s = 100.0, 0, 100.0
        self.held: set[str] = set()  # what does not come any more
        self.vouched = False
        self.leans = 0.0, 0.0
        for _ in range(10):
            self.tick()
            self.passed((0.0, 0.0), (0.0, 0.0))

    def tick(self, seconds: float = TICK_S) -> None:
        """Time passes, and records come."""
        self.now_s += seconds
        rim_mps = self.moves[1] * self.config.robot.track_width_m / 2
        for k, speed_mps in enumerate((self.moves[0] - rim_mps, self.moves[0] + rim_mps)):
            self.counts[k] += speed_mps * seconds * PER_M
        if "scans" not in self.held:
            self.monitor.scanned(self.now_s)
        if "map" not in self.held:
            self.mapped_s = self.now_s
        if "attitudes" not in self.held:
            self.monitor.turned(attitude(self.now_s, *self.leans))
        if "counts" not in self.held:
            left, right = self.counts
            self.monitor.counted(WheelCounts(self.now_s, left, right, self.restarts))

    def passed(self, powers: Powers, asked: tuple[float, float] | None, **seen: Any) -> Powers:
        """What goes out; `asked`: v and w of a request that holds."""
        given: dict[str, Any] = {
            "request": None if asked is None else DriveRequest(*asked, self.now_s + FAR_S),
            "pose": Pose(self.now_s, self.x_m, self.y_m, self.yaw_rad, 0.0, 0.0),
            "window": self.window,
            "mapped_s": self.mapped_s,
            "vouched": self.vouched,
        }
        return self.monitor.passed(self.now_s, powers, Seen(**given | seen))

    def told(self, v_mps: float, w_radps: float, **seen: Any) -> str:
        """Asked and told to go so: why it may not."""
        rim_mps = w_radps * self.config.robot.track_width_m / 2
        full_mps = self.config.drive.full_power_mps
        powers = (v_mps - rim_mps) / full_mps, (v_mps + rim_mps) / full_mps
        out = self.passed(powers, (v_mps, w_radps), **seen)
        assert out == ((0.0, 0.0) if self.monitor.why else powers)
        return self.monitor.why

    def mark(self, i: int, j: int, state: int) -> None:
        self.window.cells[j % 101, i % 101] = state


def test_a_robot_in_order_gets_its_power_and_halts_are_counted() -> None:
    robot = Robot()
    assert robot.told(0.5, 0.2) == ""
    assert robot.monitor.halts == 0
    robot.tick()
    assert robot.told(0.5, 0.2, pose=None) == monitor.NO_POSE
    assert robot.monitor.halts == 1


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


@pytest.mark.parametrize("state", [OBSTACLE, UNKNOWN])
@pytest.mark.parametrize(("front_m", "rear_m"), [(0.52, 0.20), (0.20, 0.52)])
@pytest.mark.parametrize("v_mps", [0.8, -0.8, 0.05, -0.05])
def test_the_way_to_a_stop_must_be_free(
    v_mps: float, front_m: float, rear_m: float, state: int
) -> None:
    """0.3 s and v^2 / 1.6 m/s2; the cell counts that is 0.02 m deep in the footprint."""
    way_m, sense = 0.3 * abs(v_mps) + v_mps**2 / 1.6, math.copysign(1.0, v_mps)
    edge_m = front_m if v_mps > 0 else rear_m
    config = with_changes(CONFIG, robot={"front_m": front_m, "rear_m": rear_m})
    for beyond_m, why in ((-SHORT_S, ""), (SHORT_S, monitor.IN_WAY[state])):
        robot = Robot(with_changes(config, drive={"full_power_mps": 0.9}))
        robot.mark(10 if sense > 0 else -11, 0, state)  # its edge is at 2 m
        robot.x_m = sense * (2.0 - edge_m - way_m + 0.02 + beyond_m)
        creeps = state == UNKNOWN and way_m < 0.02  # unseen ground that it has touched is no matter
        assert robot.told(v_mps, 0.0) == ("" if creeps else why)


def test_what_it_would_drive_over_on_its_way_is_in_its_way() -> None:
    """At 1 m/s it goes 0.925 m on: so far that all of its 0.72 m have passed the cell."""
    robot = Robot()
    robot.mark(10, 0, OBSTACLE)
    robot.x_m = 2.0 - 0.52 - 0.001
    assert robot.told(1.0, 0.0) == monitor.IN_WAY[OBSTACLE]


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_a_turn_on_the_spot_is_followed_to_its_end(sense: float) -> None:
    """By 1 rad/s for 0.3 s and as long as its farthest corner, at 0.60 m/s, takes to stand.

    After these 0.675 rad that corner has come as far back as x = 0.215 m, y = 0.531 m.
    """
    for i, why in ((10, monitor.IN_WAY[OBSTACLE]), (9, "")):
        robot = Robot()
        robot.window.grid.cell_m = 0.02
        robot.mark(i, 26 if sense > 0 else -27, OBSTACLE)
        assert robot.told(0.0, sense) == why


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_a_robot_that_is_faster_than_told_must_have_room_to_brake(sense: float) -> None:
    way_m, edge_m = 0.9**2 / 1.6, 0.52 if sense > 0 else 0.20
    for beyond_m, why in ((-0.001, ""), (0.001, monitor.IN_WAY[OBSTACLE])):
        robot = Robot()
        robot.mark(10 if sense > 0 else -11, 0, OBSTACLE)
        robot.moves = sense * 0.9, 0.0
        for _ in range(12):
            robot.tick()
            robot.passed((0.0, 0.0), (sense * 0.1, 0.0))
        robot.x_m = sense * (2.0 - edge_m - way_m + 0.02 + beyond_m)
        assert robot.told(sense * 0.1, 0.0) == why


def test_beside_the_footprint_and_under_it_nothing_is_in_the_way() -> None:
    robot = Robot()
    robot.y_m = 0.1
    for j, why in ((-2, ""), (-1, monitor.IN_WAY[OBSTACLE]), (2, "")):  # it reaches -0.2 to 0.4 m
        robot.window.cells[...] = FREE
        robot.mark(4, j, OBSTACLE)
        robot.passed((0.0, 0.0), None)
        assert robot.told(0.8, 0.0) == why
    for i in range(-1, 3):
        robot.mark(i, 0, OBSTACLE)
    robot.window.cells[-1 % 101, 4] = FREE
    robot.passed((0.0, 0.0), None)
    assert robot.told(0.8, 0.0) == ""


@pytest.mark.parametrize("corner", [(-50, -50), (-1, -50), (-98, -50), (-50, -1), (-50, -98)])
def test_outside_of_the_window_nothing_is_known(corner: tuple[int, int]) -> None:
    grid_m = 0.2
    for k, (yaw_rad, edge_m) in enumerate(
        (
            (0.0, (corner[0] + 101) * grid_m),
            (math.pi, -corner[0] * grid_m),
            (math.pi / 2, (corner[1] + 101) * grid_m),
            (-math.pi / 2, -corner[1] * grid_m),
        )
    ):
        for inside_m, why in ((0.001, ""), (-0.001, monitor.IN_WAY[UNKNOWN])):
            robot = Robot()
            grid = robot.window.grid
            grid.corner_i, grid.corner_j = corner
            ahead_m = edge_m - 0.52 - 0.64 + 0.02 - inside_m
            robot.yaw_rad = yaw_rad
            middle_m = (corner[k < 2] + 50.5) * grid_m  # of the other axis
            way = ahead_m * round(math.cos(yaw_rad)), ahead_m * round(math.sin(yaw_rad))
            robot.x_m, robot.y_m = (way[0], middle_m) if k < 2 else (middle_m, way[1])
            assert robot.told(0.8, 0.0) == why


def test_the_ground_of_the_start_is_vouched_for_as_far_as_the_settings_say() -> None:
    config = with_changes(CONFIG, robot={"start_clear_m": 1.0})
    for i, vouched, why in (
        (3, True, ""),  # its middle is 0.7 m away
        (3, False, monitor.IN_WAY[UNKNOWN]),
        (5, True, monitor.IN_WAY[UNKNOWN]),
    ):
        robot = Robot(config)
        robot.mark(i, 0, UNKNOWN)
        robot.vouched = vouched
        assert robot.told(0.8, 0.0) == why
    robot = Robot(config)
    robot.vouched = True
    robot.mark(3, 0, OBSTACLE)
    assert robot.told(0.8, 0.0) == monitor.IN_WAY[OBSTACLE]
    robot = Robot(with_changes(CONFIG, robot={"unknown_stops": False}))
    robot.mark(5, 0, UNKNOWN)
    assert robot.told(0.8, 0.0) == ""


def test_the_middle_of_the_ground_that_is_vouched_for_is_where_the_map_began() -> None:
    robot = Robot(with_changes(CONFIG, robot={"start_clear_m": 1.0}))
    robot.window.cells[...] = UNKNOWN
    robot.vouched = True
    for k in range(8):
        robot.yaw_rad = k * math.pi / 4
        for ahead_m, why in ((0.05, ""), (0.55, monitor.IN_WAY[UNKNOWN])):
            robot.x_m, robot.y_m = (ahead_m * f(robot.yaw_rad) for f in (math.cos, math.sin))
            robot.passed((0.0, 0.0), None)
            assert robot.told(0.4, 0.0) == why


def footprint(x_m: float, y_m: float, yaw_rad: float, less_m: float = 0.0) -> Polygon:
    one = box(-ROBOT.rear_m + less_m, -0.3 + less_m, ROBOT.front_m - less_m, 0.3 - less_m)
    return translate(rotate(one, yaw_rad, origin=(0, 0), use_radians=True), x_m, y_m)


def after(place: Place, motion: tuple[float, float], t_s: float) -> Place:
    """Where a motion leads, by the radius of its arc."""
    x, y, yaw = place
    v, w = motion
    if abs(w) < 1e-9:
        return x + v * t_s * math.cos(yaw), y + v * t_s * math.sin(yaw), yaw
    turned = yaw + w * t_s
    r = v / w
    return (
        x + r * (math.sin(turned) - math.sin(yaw)),
        y - r * (math.cos(turned) - math.cos(yaw)),
        turned,
    )


@given(
    place=st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.floats(-4.0, 4.0)),
    motion=st.tuples(st.sampled_from([0.0, 0.3, 0.7, -0.4]), st.sampled_from([0.0, 0.6, -1.0])),
    at=st.tuples(st.integers(-8, 8), st.integers(-8, 8)),
)
@settings(max_examples=300)
def test_it_halts_where_a_cell_comes_under_the_footprint_and_nowhere_else(
    place: tuple[float, float, float], motion: tuple[float, float], at: tuple[int, int]
) -> None:
    """Against polygons, at many instants; its own instants are up to 0.1 m of way apart."""
    if not any(motion):
        return
    robot = Robot()
    robot.x_m, robot.y_m, robot.yaw_rad = place
    robot.mark(*at, OBSTACLE)
    cell = box(0.2 * at[0], 0.2 * at[1], 0.2 * at[0] + 0.2, 0.2 * at[1] + 0.2)
    rate_mps = abs(motion[0]) + abs(motion[1]) * REACH_M
    seconds = 0.3 + rate_mps / 1.6
    ways = [after(place, motion, seconds * k / 40) for k in range(41)]
    halted = robot.told(*motion) != ""
    is_under = footprint(*place).intersects(cell)
    if halted:
        assert not footprint(*place, 0.021).intersects(cell)
        assert any(footprint(*way, 0.019).intersects(cell) for way in ways)
    elif not is_under:
        assert not any(footprint(*way, 0.125).intersects(cell) for way in ways)


@given(
    place=st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0), st.floats(-4.0, 4.0)),
    bearing_rad=st.floats(-math.pi, math.pi),
    half_m=st.floats(0.01, 0.5),
)
def test_footprint_and_cell_overlap_from_where_polygons_do(
    place: tuple[float, float, float], bearing_rad: float, half_m: float
) -> None:
    c, s = math.cos(bearing_rad), math.sin(bearing_rad)

    def places(away_m: float) -> tuple[float, float]:
        return place[0] + away_m * c, place[1] + away_m * s

    def square(away_m: float) -> Polygon:
        x, y = places(away_m)
        return box(x - half_m, y - half_m, x + half_m, y + half_m)

    low_m, high_m = 0.0, 3.0
    for _ in range(40):
        middle_m = (low_m + high_m) / 2
        touches = footprint(*place).intersects(square(middle_m))
        low_m, high_m = (middle_m, high_m) if touches else (low_m, middle_m)
    rect = (ROBOT.front_m, ROBOT.rear_m, ROBOT.width_m / 2)
    assert monitor._overlaps(*places(low_m - 1e-6), half_m, place, rect)
    assert not monitor._overlaps(*places(high_m + 1e-6), half_m, place, rect)


@given(
    place=st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0), st.floats(-4.0, 4.0)),
    motion=st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0)),
    seconds=st.floats(0.0, 2.0),
)
def test_an_arc_leads_where_its_radius_says(
    place: tuple[float, float, float], motion: tuple[float, float], seconds: float
) -> None:
    if abs(motion[1]) > 1e-4:
        moved = monitor._moved(place, motion, seconds)
        assert moved == pytest.approx(after(place, motion, seconds), abs=1e-6)
    straight = monitor._moved(place, (motion[0], 0.0), seconds)
    assert straight == pytest.approx(after(place, (motion[0], 0.0), seconds))


class Adversary:
    """A robot whose pilot tells anything; it obeys at once, and brakes 0.1 s after a zero."""

    def __init__(self, cells: list[tuple[int, int]]) -> None:
        self.robot, self.goes, self.zero_s = Robot(), (0.0, 0.0), math.inf
        self.cells = []
        for i, j in cells:
            cell = box(0.2 * i, 0.2 * j, 0.2 * i + 0.2, 0.2 * j + 0.2)
            if not footprint(0.0, 0.0, 0.0).intersects(cell):
                self.cells.append(cell)
                self.robot.mark(i, j, OBSTACLE)

    def step(self, powers: Powers, asks: bool) -> None:
        robot = self.robot
        robot.moves = self.goes
        robot.tick()
        place = after((robot.x_m, robot.y_m, robot.yaw_rad), self.goes, TICK_S)
        robot.x_m, robot.y_m, robot.yaw_rad = place
        asked = (math.copysign(9.0, sum(powers)), math.copysign(9.0, powers[1] - powers[0]))
        left, right = robot.passed(powers, asked if asks else None)
        if left or right:
            self.goes, self.zero_s = ((left + right) / 2, (right - left) / 0.5), math.inf
            return
        self.zero_s = min(self.zero_s, robot.now_s)
        if robot.now_s - self.zero_s >= 0.1:
            rate_mps = abs(self.goes[0]) + abs(self.goes[1]) * REACH_M
            share = max(0.0, rate_mps - 0.8 * TICK_S) / rate_mps if rate_mps else 0.0
            self.goes = self.goes[0] * share, self.goes[1] * share


POWER = st.floats(-1.2, 1.2)


@given(
    orders=st.lists(st.tuples(POWER, POWER, st.booleans()), min_size=4, max_size=10),
    cells=st.lists(st.tuples(st.integers(-8, 9), st.integers(-8, 8)), min_size=15, max_size=40),
)
@settings(max_examples=examples(25))
def test_whatever_a_pilot_tells_the_robot_runs_into_nothing(
    orders: list[tuple[float, float, bool]], cells: list[tuple[int, int]]
) -> None:
    pilot = Adversary(cells)
    for left, right, lets_go in orders:
        if lets_go:
            pilot.step((0.0, 0.0), asks=False)
        for _ in range(25):
            pilot.step((left, right), asks=True)
            robot = pilot.robot
            inside = footprint(robot.x_m, robot.y_m, robot.yaw_rad, 0.05)
            assert not any(inside.intersects(cell) for cell in pilot.cells)
