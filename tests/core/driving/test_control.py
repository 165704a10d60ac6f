"""From requests to power: limits, ramps, and zero with a reason on any doubt."""

import functools
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from config_file import load_config, with_changes
from core.driving import health
from core.driving.control import (
    NOT_ENABLED,
    SILENT,
    DriveControl,
    link_refusal,
    links_refusal,
    stop_reason,
)
from core.driving.stop_zone import NOTHING
from core.mapping.surface.cells import APART
from core.mapping.surface.maps import SurfaceMaps
from core.motion.track import Pose
from core.records import FREE, OBSTACLE, UNKNOWN, DriveRequest
from tests import ROOT

SHIPPED = (ROOT / "mapod.toml").read_text(encoding="utf-8")
HERE = Pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
WELL = 0x7F
PERIOD_S = 0.005


@functools.cache
def blank_maps() -> SurfaceMaps:
    """Of the shipped settings: they cost more than most tests."""
    return SurfaceMaps(load_config(SHIPPED))


class Robot:
    """A control on free ground, and its clock."""

    def __init__(self, **robot: Any) -> None:
        self.config = with_changes(load_config(SHIPPED), robot={"enable_motors": True, **robot})
        self.maps = blank_maps()
        self.maps.erase()
        self.window = self.maps.window
        self.window.cells[...] = FREE
        self.control = DriveControl(self.config, self.maps)
        self.now_s = 100.0
        self.powers = (0.0, 0.0)
        self.step(DriveRequest(0.0, 0.0, 1e9))

    def step(self, request: DriveRequest | None, stop_reason: str = "", **kw: Any) -> None:
        self.now_s += PERIOD_S
        given: dict[str, Any] = {"pose": HERE, "motors_off": "", "moves": (0.0, 0.0)} | kw
        self.powers = self.control.step(self.now_s, request, stop_reason, **given)

    def run(self, v_mps: float, w_radps: float, seconds: float) -> None:
        for _ in range(round(seconds / PERIOD_S)):
            self.step(DriveRequest(v_mps, w_radps, self.now_s + 1.0))

    def mark(self, x: float, y: float, state: int) -> tuple[int, int]:
        """Set a cell of the window; its place in the arrays."""
        i, j = self.window.grid.cell_of(x, y)
        at = j % 101, i % 101
        self.window.cells[at] = state
        return at


def test_the_speed_grows_by_the_ramp_to_what_was_asked_and_becomes_power() -> None:
    robot = Robot()
    robot.run(0.5, 0.0, 0.5)
    assert robot.control.v_mps == pytest.approx(0.25, abs=0.01)
    robot.run(0.5, 0.0, 1.0)
    assert robot.powers == pytest.approx((0.5, 0.5))
    robot.run(0.0, 0.8, 2.0)
    assert robot.powers == pytest.approx((-0.8 * 0.25, 0.8 * 0.25))


@given(requests=st.lists(st.tuples(st.floats(-40, 40), st.floats(-40, 40)), min_size=1, max_size=6))
def test_speed_turn_ramp_and_power_never_pass_their_limits(
    requests: list[tuple[float, float]],
) -> None:
    robot, before = Robot(), (0.0, 0.0)
    limits = robot.config.robot
    for v_mps, w_radps in requests:
        for _ in range(12):
            robot.step(DriveRequest(v_mps, w_radps, robot.now_s + 1.0))
            now = robot.control.v_mps, robot.control.w_radps
            assert abs(now[0]) <= limits.max_speed_mps + 1e-9
            assert abs(now[1]) <= limits.max_turn_radps + 1e-9
            assert abs(now[0]) - abs(before[0]) <= limits.max_accel_mps2 * PERIOD_S + 1e-9
            assert abs(now[1]) - abs(before[1]) <= limits.max_turn_accel_radps2 * PERIOD_S + 1e-9
            assert max(map(abs, robot.powers)) <= 1.0
            before = now


def test_a_request_beyond_the_limits_keeps_its_arc() -> None:
    robot = Robot(max_accel_mps2=20.0, max_turn_accel_radps2=100.0, max_turn_radps=0.5)
    for asked, limited in (((4.0, 1.0), (1.0, 0.25)), ((1.0, -1.0), (0.5, -0.5))):
        robot.run(*asked, 1.0)
        assert (robot.control.v_mps, robot.control.w_radps) == pytest.approx(limited)


def test_more_than_full_power_of_one_wheel_lowers_both() -> None:
    robot = Robot(max_accel_mps2=20.0, max_turn_accel_radps2=100.0)
    robot.run(1.0, 1.0, 1.0)
    left, right = robot.powers
    assert right == 1.0
    assert left / right == pytest.approx(0.75 / 1.25)


def test_what_turns_round_passes_through_standing() -> None:
    robot = Robot()
    robot.run(0.5, 0.0, 2.0)
    seen = set()
    for _ in range(400):
        robot.run(-0.5, 0.0, PERIOD_S)
        seen.add(round(robot.control.v_mps, 6))
    assert 0.0 in seen
    assert robot.control.v_mps == pytest.approx(-0.5)


@pytest.mark.parametrize(
    ("request_", "doubt_", "pose", "reason"),
    [
        (DriveRequest(0.5, 0.0, 1e9), "the sky falls", HERE, "the sky falls"),
        (DriveRequest(0.5, 0.0, 1e9), "", None, "the pose is not known"),
        (DriveRequest(0.5, 0.0, 100.0), "", HERE, SILENT),
        (DriveRequest(0.5, 0.0, math.nan), "", HERE, SILENT),
        (DriveRequest(math.nan, 0.0, 1e9), "", HERE, "the request is no number"),
        (DriveRequest(0.0, 0.0, -math.inf), "", HERE, ""),
        (None, "", HERE, ""),
    ],
)
def test_any_doubt_ends_the_motion_at_once_and_says_why(
    request_: DriveRequest | None, doubt_: str, pose: Pose | None, reason: str
) -> None:
    robot = Robot(max_accel_mps2=20.0, max_turn_accel_radps2=20.0)
    robot.run(0.8, 0.2, 0.05)
    assert min(robot.powers) > 0.5
    robot.step(request_, doubt_, pose=pose)
    assert robot.powers == (0.0, 0.0)
    assert robot.control.blocked_by == reason
    robot.run(0.8, 0.2, PERIOD_S)
    assert 0 < max(robot.powers) < 0.15  # from standing again


def test_a_request_during_trouble_of_the_motors_does_not_count_when_it_ends() -> None:
    robot = Robot()
    asks = DriveRequest(0.5, 0.0, 1e9)
    robot.step(asks, motors_off="the emergency stop is pressed")
    robot.step(asks)
    assert robot.powers == (0.0, 0.0)
    assert robot.control.blocked_by == (
        "until the commander lets go once: the emergency stop is pressed"
    )
    robot.step(DriveRequest(0.0, 0.0, 1e9))
    robot.step(asks)
    assert min(robot.powers) > 0.0


def test_before_an_obstacle_it_slows_down_and_stands() -> None:
    robot = Robot()
    robot.mark(3.1, 0.1, OBSTACLE)
    x_m, speeds = 0.0, []
    for _ in range(1400):
        robot.step(
            DriveRequest(1.0, 0.0, robot.now_s + 1.0), pose=Pose(0.0, x_m, 0.0, 0.0, 0.0, 0.0)
        )
        x_m += robot.control.v_mps * PERIOD_S
        speeds.append(robot.control.v_mps)
    assert max(speeds) > 0.7
    assert robot.powers == (0.0, 0.0)
    assert robot.control.blocked_by == "an obstacle is in the way"
    margin_m = robot.config.robot.stop_margin_m + robot.config.robot.front_m
    assert 3.0 - margin_m - 0.03 < x_m < 3.0 - margin_m
    braking = np.diff(speeds)
    assert braking.min() > -0.1  # lowered step by step, not in one
    assert robot.control.maybe_barred == pytest.approx((3.1, 0.1, 0.2))  # middle and edge
    robot.step(DriveRequest(-0.2, 0.0, robot.now_s + 1.0), pose=Pose(0.0, x_m, 0.0, 0.0, 0.0, 0.0))
    assert (robot.control.blocked_by, robot.control.maybe_barred) == ("", None)


@pytest.mark.parametrize("factor", [1.0, 2.5])
def test_a_robot_that_is_faster_than_it_was_told_stops_before_it_too(factor: float) -> None:
    robot = Robot()
    robot.mark(3.1, 0.1, OBSTACLE)
    x_m, v_mps = 0.0, 0.0
    for _ in range(1400):
        told_mps = factor * robot.control.v_mps
        brake = robot.config.robot.brake_mps2 * PERIOD_S
        v_mps = told_mps if told_mps > v_mps else max(told_mps, v_mps - brake)
        x_m += v_mps * PERIOD_S
        robot.step(
            DriveRequest(1.0, 0.0, robot.now_s + 1.0),
            pose=Pose(0.0, x_m, 0.0, 0.0, 0.0, 0.0),
            moves=(v_mps, 0.0),
        )
    assert x_m + robot.config.robot.front_m < 3.0


@pytest.mark.parametrize(
    ("seen", "is_drop"),
    [
        ({"under_m": -0.3}, True),
        ({"under_m": -0.3, "looks": 5}, True),
        ({"looks": 5, "tied": APART}, True),
        ({"looks": 5, "stands": 3.0, "top_m": 0.3}, False),
        ({"stands": 3.0, "top_m": 0.9}, False),
        ({"stands": 3.0, "top_m": 0.9, "under_m": -0.05}, False),
        ({}, False),
    ],
)
def test_a_drop_is_told_from_what_stands_up(seen: dict[str, float], is_drop: bool) -> None:
    robot = Robot()
    at = robot.mark(1.0, 0.1, OBSTACLE)
    for name, value in {"var_m2": 1e-4, **seen}.items():
        robot.maps.cells[name][at] = value
    asks = DriveRequest(0.5, 0.0, 1e9)
    assert robot.control.drop_ahead((0.5, 0.0), None, HERE) is is_drop
    assert robot.control.drop_ahead((0.0, 0.0), asks, HERE) is is_drop
    assert not robot.control.drop_ahead((-0.5, 0.0), asks, HERE)
    assert not robot.control.drop_ahead((0.5, 0.0), asks, None)
    robot.run(0.5, 0.0, 0.2)
    said = "a drop is in the way" if is_drop else "an obstacle is in the way"
    assert robot.control.blocked_by in ("", said)


def test_what_is_vouched_for_is_the_ground_near_the_start_of_an_unbroken_map() -> None:
    asks = DriveRequest(0.5, 0.0, 1e9)
    for clear_m, off_m, goes in ((3.0, 0.0, True), (3.0, math.inf, False), (0.3, 0.0, False)):
        robot = Robot(start_clear_m=clear_m)
        robot.control.off_start_m = off_m
        robot.window.cells[...] = UNKNOWN
        now_s = robot.now_s + PERIOD_S
        powers = robot.control.step(now_s, asks, "", HERE, "", (0.0, 0.0))
        assert (powers != (0.0, 0.0)) is goes


# At the limits


def fresh(**robot: Any) -> DriveControl:
    """One that nobody has asked anything yet."""
    return DriveControl(Robot(**robot).config, blank_maps())


def test_power_is_the_share_of_the_full_speed() -> None:
    config = with_changes(Robot().config, drive={"full_power_mps": 2.0})
    control = DriveControl(config, blank_maps())
    powers = control.step(9.0, DriveRequest(0.5, 0.0, 9.0), "", HERE, "", (0.0, 0.0))
    assert powers == pytest.approx((control.v_mps / 2.0, control.v_mps / 2.0))
    assert control.v_mps > 0.0


def go(control: DriveControl, now_s: float, v: float, w: float = 0.0, **kw: Any) -> None:
    """A step of a robot at the origin, with a request that holds until just now."""
    given = {"motors_off": "", "moves": (0.0, 0.0)} | kw
    control.step(now_s, DriveRequest(v, w, now_s), "", HERE, **given)


def test_a_new_control_stands_and_its_first_step_is_no_longer_than_a_late_one() -> None:
    control = fresh(max_accel_mps2=1.0, max_turn_accel_radps2=2.0)
    assert (control.v_mps, control.w_radps) == (0.0, 0.0)
    go(control, 50.0, 0.5, 0.5)
    assert (control.v_mps, control.w_radps) == pytest.approx((0.05, 0.1))
    go(control, 40.0, 0.5, 0.5)  # time does not go back
    assert (control.v_mps, control.w_radps) == pytest.approx((0.05, 0.1))
    go(control, 60.0, 0.5, 0.5)
    assert (control.v_mps, control.w_radps) == pytest.approx((0.1, 0.2))


def test_it_brakes_by_the_brakes_and_turns_less_by_the_turns_ramp() -> None:
    control = fresh(max_accel_mps2=1.0, brake_mps2=2.0, max_turn_accel_radps2=3.0)
    for k in range(5):
        go(control, 50.0 + 0.05 * k, 0.5, -0.5)
    assert (control.v_mps, control.w_radps) == pytest.approx((0.25, -0.5))
    go(control, 50.25, 0.0)
    assert (control.v_mps, control.w_radps) == pytest.approx((0.15, -0.35))
    go(control, 50.30, -0.5, 0.5)
    assert (control.v_mps, control.w_radps) == pytest.approx((0.05, -0.2))
    go(control, 50.35, -0.5, 0.5)
    assert (control.v_mps, control.w_radps) == pytest.approx((0.0, -0.05))


def test_until_it_stops_pass_a_stale_scan_a_late_tick_and_an_order() -> None:
    control = fresh(brake_mps2=1.0)
    assert control.zone.stop_m(1.0) == pytest.approx(0.15 + 0.1 + 0.2 + 0.5)


@pytest.mark.parametrize(
    ("trouble", "then", "goes"),
    [
        ("off", DriveRequest(0.5, 0.0, 1e9), False),
        ("off", DriveRequest(0.0, 0.1, 1e9), False),
        ("", DriveRequest(0.5, 0.0, 1e9), True),
    ],
)
def test_whoever_asks_during_trouble_must_let_go(
    trouble: str, then: DriveRequest, goes: bool
) -> None:
    robot = Robot()
    for request in (then, None, then):
        robot.step(then, motors_off=trouble)
        robot.step(then)
        assert (robot.powers != (0.0, 0.0)) is goes
        robot.step(request)  # None lets go
    assert (robot.powers != (0.0, 0.0)) is goes
    for late_s, must in ((0.001, False), (0.0, True)):  # an expired one asks nothing
        robot.step(DriveRequest(0.5, 0.0, robot.now_s + PERIOD_S - late_s), motors_off="off")
        robot.step(then)
        assert (robot.powers == (0.0, 0.0)) is must


def before_wall(robot: Robot, free_m: float) -> Pose:
    """Where a robot has so much free way to an obstacle."""
    i, _ = robot.window.grid.cell_of(2.1, 0.1)
    robot.mark(2.1, 0.1, OBSTACLE)
    size = robot.config.robot
    x_m = i * robot.window.grid.cell_m - size.front_m - size.stop_margin_m - free_m
    return Pose(0.0, x_m, 0.0, 0.0, 0.0, 0.0)


def test_the_ground_that_is_vouched_for_shrinks_by_how_badly_its_middle_is_known() -> None:
    control = Robot(start_clear_m=1.5).control
    assert control.clear == (0.0, 0.0, 1.5)
    control.off_start_m = 0.5
    assert control.clear == (0.0, 0.0, 1.0)
    for off_m in (2.0, math.inf):
        control.off_start_m = off_m
        assert control.clear == (0.0, 0.0, 0.0)


def test_a_robot_that_still_rolls_is_not_turned_into_what_it_rolls_to() -> None:
    robot = Robot()
    robot.mark(0.65, 0.0, OBSTACLE)
    turning = DriveRequest(0.0, 0.8, 1e9)
    robot.step(turning, moves=(0.6, 0.0))
    assert robot.powers == (0.0, 0.0)
    assert robot.control.blocked_by == "an obstacle is in the way"
    robot.step(turning, moves=(-0.6, 0.0))
    assert robot.powers != (0.0, 0.0)


def test_a_robot_a_little_faster_than_told_lags_and_one_that_is_faster_still_is_slowed() -> None:
    robot = Robot(max_accel_mps2=20.0)
    pose = before_wall(robot, 0.36)
    allowed_mps = robot.control.zone.allowed_mps(robot.control.look(pose, (0.4, 0.0), 1.0).free_m)
    assert 0.4 < allowed_mps < 0.55
    for moves_mps, v_mps in ((0.555, 0.4), (0.565, 0.4 * allowed_mps / 0.565)):
        for _ in range(9):
            robot.step(DriveRequest(0.4, 0.0, 1e9), pose=pose)
        robot.step(DriveRequest(0.4, 0.0, 1e9), pose=pose, moves=(moves_mps, 0.0))
        assert robot.control.v_mps == pytest.approx(v_mps, abs=1e-6)


def test_a_standing_robot_does_not_set_out_for_next_to_nothing() -> None:
    for free_m, goes in ((0.045, False), (0.057, True)):  # 0.1 m/s takes 51 mm
        robot = Robot(max_accel_mps2=20.0)
        robot.step(DriveRequest(0.5, 0.0, 1e9), pose=before_wall(robot, free_m))
        assert (robot.powers != (0.0, 0.0)) is goes


def test_the_way_goes_as_the_robot_moves_or_else_as_it_is_asked_to() -> None:
    control, back = fresh(max_speed_mps=0.5), DriveRequest(-4.0, 1.0, 1e9)
    assert control.heading_for((0.05, 0.0), back) == (0.05, 0.0)
    assert control.heading_for((0.0499, 0.0), back) == (-0.5, 0.125)
    assert control.heading_for((0.0499, 0.0), None) == (0.0, 0.0)
    assert control.look(HERE, (0.0, 0.0), 9.0) is NOTHING


@pytest.mark.parametrize(
    ("unknown_stops", "off_m", "goes_m"),
    [(True, math.inf, 1.0), (True, 0.0, 2.0), (False, math.inf, math.inf), (False, 0.0, math.inf)],
)
def test_unknown_ground_is_free_where_the_settings_say_so(
    unknown_stops: bool, off_m: float, goes_m: float
) -> None:
    robot = Robot(unknown_stops=unknown_stops, start_clear_m=2.0)
    size = robot.config.robot
    for x_m in (1.0, 2.0, 3.0):
        robot.mark(x_m + 0.1, 0.1, UNKNOWN)
    robot.control.off_start_m = off_m
    found = robot.control.look(HERE, (0.1, 0.0), 1.6)
    assert found.free_m == pytest.approx(goes_m - size.front_m - size.stop_margin_m, abs=0.01)


@pytest.mark.parametrize(("v", "w", "of"), [(-0.1, 0.1, (-0.8, 0.8)), (0.1, -0.8, (0.2, -1.6))])
def test_full_speed_is_that_on_the_same_arc(v: float, w: float, of: tuple[float, float]) -> None:
    control = fresh(max_speed_mps=0.8, max_turn_radps=1.6)
    assert control.at_full_speed((v, w)) == pytest.approx(of)


def test_a_drop_is_ahead_when_it_lies_within_the_way_to_a_stop_and_not_before() -> None:
    robot = Robot()
    at = robot.mark(1.1, 0.1, OBSTACLE)
    robot.maps.cells["var_m2"][at], robot.maps.cells["under_m"][at] = 1e-4, -0.3
    ahead_m = 1.0 - robot.config.robot.front_m - robot.config.robot.stop_margin_m
    for free_m, is_ahead in ((0.35, False), (0.15, True)):
        pose = Pose(0.0, ahead_m - free_m, 0.0, 0.0, 0.0, 0.0)
        assert robot.control.drop_ahead((0.2, 0.0), None, pose) is is_ahead


# Doubts


def test_all_well_leaves_no_doubt_and_every_missing_bit_makes_one() -> None:
    assert stop_reason(WELL, health.RUNNING, "") == ""
    assert stop_reason(WELL, health.DEGRADED, "")
    for bit in range(7):
        assert stop_reason(WELL & ~(1 << bit), health.RUNNING, ""), bit
    for bit in (9, 15):
        assert stop_reason(WELL | 1 << bit, health.RUNNING, ""), bit


@given(
    word=st.integers(0, 0xFFFF),
    mode=st.integers(0, 4),
    sight=st.sampled_from(["", "the window is too dirty"]),
    other=st.sampled_from(["", "something else"]),
)
def test_there_is_no_doubt_only_if_all_is_known_to_be_well(
    word: int, mode: int, sight: str, other: str
) -> None:
    well = word & WELL == WELL and not word & (1 << 9 | 1 << 15) and mode == health.RUNNING
    well = well and not sight and not other
    assert (stop_reason(word, mode, sight, (other,)) == "") is well


@pytest.mark.parametrize(
    ("url", "has_key", "allowed"),
    [
        ("udp://127.0.0.1:9750", False, True),
        ("udp://127.1.2.3:9750", False, True),
        ("udp://localhost:9750", False, True),
        ("udp://[::1]:9750", False, True),
        ("udp://192.168.0.7:9750", False, False),
        ("udp://planner:9750", False, False),
        ("udp://0.0.0.0:9750", False, False),
        ("udp://192.168.0.7:9750", True, True),
        ("tcp://192.168.0.7:9750", False, False),
        ("serial:///dev/planner?baud=115200", False, True),
    ],
)
def test_who_may_drive_over_which_link(url: str, has_key: bool, allowed: bool) -> None:
    refusal = link_refusal(url, has_key, True)
    assert (refusal == "") is allowed
    assert allowed or "key" in refusal
    assert link_refusal(url, has_key, False) == NOT_ENABLED


def test_external_poses_are_taken_if_one_of_the_ports_takes_them() -> None:
    far, near = "udp://192.168.0.7:9750", "udp://127.0.0.1:9750"
    assert "key" in links_refusal([far], has_key=False)
    assert "key" in links_refusal([far, far], has_key=False)
    assert links_refusal([far, near], has_key=False) == ""
    assert links_refusal([far], has_key=True) == ""
