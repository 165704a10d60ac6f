"""What the pilot makes of a map and a request: stop zone, drops, wheel power, health."""

import math
from typing import Any

import pytest

from config_file import with_changes
from core.driving.control import NOT_ENABLED
from core.driving.health import BOOTING, MAP_VALID, POSE_VALID, RUNNING, TOO_STEEP
from core.driving.pilot import ZONE_S, Pilot
from core.driving.report import report
from core.driving.stall import STALLED
from core.driving.zone import CLEAR, NOT_TRUSTED, SLOW
from core.mapping.mapper import Mapper
from core.records import FREE, OBSTACLE, UNKNOWN, DriveRequest, PoseReport, WheelCounts
from tests.core.mapping.test_mapper import CONFIG, standing, wall_and_floor
from tests.core.motion.test_attitude import attitude

AHEAD = DriveRequest(0.5, 0.0, 1e9)
NOW_S = 1.0


def told_by(mapper: Mapper, now_s: float = NOW_S) -> tuple[bool, PoseReport]:
    """Whether free may be told, and what is told of the pose."""
    return report(
        mapper,
        now_s,
        clocks_locked=True,
        overrun=False,
        replayed=False,
        impaired=False,
        stop_asked=False,
        drop_ahead=False,
        stalled=False,
        scan_stale_s=0.15,
    )


class Robot:
    """A pilot whose robot stands on free ground, all inputs well."""

    def __init__(self, **robot: Any) -> None:
        usual = {"enable_motors": True, "start_clear_m": 4.0}
        config = with_changes(CONFIG, robot=usual | robot)
        self.mapper = standing(2.5 * NOW_S, Mapper(config))
        self.mapper.add_scan(wall_and_floor(0.95))
        assert self.mapper.settle(NOW_S) == 1
        self.mapper.maps.window.cells[...] = FREE
        self.pilot = Pilot(config, self.mapper)

    def mark(self, x_m: float, y_m: float) -> None:
        """An obstacle."""
        grid = self.mapper.maps.window.grid
        i, j = grid.cell_of(x_m, y_m)
        self.mapper.maps.window.cells[j % grid.size, i % grid.size] = OBSTACLE

    def powers(self, now_s: float = NOW_S, **words: str) -> tuple[float, float]:
        """Of a robot that is asked to go ahead."""
        _, told = told_by(self.mapper)
        said = {"sight": "", "commander": "", "motors_off": ""} | words
        return self.pilot.powers(now_s, told, AHEAD, **said)


def test_a_robot_that_stands_well_is_told_as_such_and_one_without_a_pose_at_zero() -> None:
    trusted, told = told_by(Robot().mapper)
    assert trusted
    assert told.mode == RUNNING
    assert told.health & POSE_VALID
    assert told.health & MAP_VALID
    trusted, told = told_by(Mapper(CONFIG))
    assert not trusted
    assert told.mode == BOOTING
    assert (told.x_m, told.y_m, told.yaw_rad, told.v_mps) == (0.0, 0.0, 0.0, 0.0)
    assert not told.health & POSE_VALID


@pytest.mark.parametrize("leans", [(0.4, 0.0), (0.0, -0.4)])
def test_a_robot_that_leans_either_way_is_told_as_too_steep(leans: tuple[float, float]) -> None:
    mapper = Mapper(CONFIG)
    for k in range(3):
        mapper.add_attitude(attitude(0.01 * k, *leans))
    assert told_by(mapper, 0.02)[1].health & TOO_STEEP


def test_the_stop_zone_is_worked_out_now_and_then_and_at_once_when_trust_goes() -> None:
    robot = Robot()
    _, told = told_by(robot.mapper)
    robot.pilot.look_around(NOW_S, told, True, AHEAD)
    before = robot.pilot.zone
    assert before.free_ahead_m > 5.0
    robot.mark(2.1, 0.1)
    robot.pilot.look_around(NOW_S + 0.9 * ZONE_S, told, True, None)
    assert robot.pilot.zone is before
    robot.pilot.look_around(NOW_S + 1.1 * ZONE_S, told, True, None)
    assert robot.pilot.zone.free_ahead_m < 2.0
    robot.pilot.look_around(NOW_S + 1.2 * ZONE_S, told, False, None)
    assert robot.pilot.zone is NOT_TRUSTED
    robot.mark(-0.9, 0.1)
    for until_s, state in ((0.0, CLEAR), (NOW_S, SLOW)):  # a request that still holds at NOW_S
        robot.pilot.look_around(NOW_S, told, False, None)
        robot.pilot.look_around(NOW_S, told, True, DriveRequest(-0.5, 0.0, until_s))
        assert robot.pilot.zone.state == state


@pytest.mark.parametrize("under_m", [math.inf, -0.3])
def test_a_drop_ahead_is_told(under_m: float) -> None:
    robot = Robot()
    assert not robot.pilot.drop_ahead
    _, told = told_by(robot.mapper)
    robot.mark(0.9, 0.1)
    cells: Any = robot.mapper.maps.cells  # type: ignore[attr-defined]
    cells["var_m2"], cells["under_m"] = 1e-4, under_m
    robot.pilot.look_ahead(NOW_S, told, AHEAD)
    assert robot.pilot.drop_ahead is (under_m < 0.0)


def test_wheels_get_power_only_where_nothing_speaks_against_it() -> None:
    robot = Robot()
    assert min(robot.powers()) > 0.0
    for words in ("sight", "commander", "motors_off"):
        assert robot.powers(NOW_S + 0.02, **{words: "no"}) == (0.0, 0.0)
        assert robot.pilot.control.blocked_by == "no"
    shut = Robot(enable_motors=False)
    assert shut.powers() == (0.0, 0.0)
    assert shut.pilot.control.blocked_by == NOT_ENABLED


@pytest.mark.parametrize(("off_m", "goes"), [(0.0, True), (3.5, False), (math.inf, False)])
def test_the_settings_vouch_as_long_as_it_is_known_where_the_run_began(
    off_m: float, goes: bool
) -> None:
    robot = Robot()
    robot.mapper.maps.window.cells[...] = UNKNOWN
    robot.mapper.off_start_m = off_m
    assert any(robot.powers()) is goes


def test_wheels_that_do_not_follow_get_no_power() -> None:
    robot = Robot()
    k = 0
    while not robot.pilot.stalled:
        robot.powers(NOW_S + 0.01 * k)
        robot.pilot.counted(WheelCounts(NOW_S + 0.01 * k, 0.0, 0.0, 0))
        k += 1
        assert k < 200
    assert robot.powers(NOW_S + 0.01 * k) == (0.0, 0.0)
    assert robot.pilot.control.blocked_by == STALLED


def test_power_that_did_not_go_out_is_no_stall_and_the_ramp_begins_anew() -> None:
    robot = Robot(max_accel_mps2=20.0)
    robot.powers()
    for k in range(1, 100):
        robot.pilot.halted(NOW_S + 0.01 * (k - 1), "no")
        assert robot.pilot.control.blocked_by == "no"
        assert robot.powers(NOW_S + 0.01 * k) == pytest.approx((0.2, 0.2))
        robot.pilot.counted(WheelCounts(NOW_S + 0.01 * k, 0.0, 0.0, 0))
    assert not robot.pilot.stalled
