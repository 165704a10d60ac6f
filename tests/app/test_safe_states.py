"""Whatever an input does while the robot drives, link and motors are safe within the times told.

The times follow from the constants that docs/safety.md cites. Simulated time alone.
"""

import math
import re

import numpy as np
import pytest

from app import LOOK_S
from core.driving import health
from core.driving.control import ORDER_S
from core.driving.health import AHRS_STALE_S, WHEELS_STALE_S, stale_s
from core.mapping.mapper import Mapper
from core.motion.gravity import BLOCK_S, SHEET_RAD, SPAN_S, SWAY_MPS
from core.motion.lean import GRAVITY_MPS2
from core.motion.wheel_check import IGNORED_RAD
from core.records import FREE
from fakes.scenes.scene import Solid
from tests import ROOT
from tests.app.test_drive import FRONT_M, Commander, driving
from tests.support.cases import few
from tests.support.robot.closed_loop import compare
from tests.support.robot.shipped import FLOOR

ROOMS = "core", "hw", "recording"
STEP_S = 0.005  # of the loop here
TICK_S = 1.25 * 0.02  # of the link as shipped, held back for a scan
SCANS_STALE_S = stale_s(0.04)
REPAIR_S = 0.5  # until a window of 101 cells has been told anew

ROWS = [  # what, and what happens to it; the bit that goes, and after which age
    ("scanner", "frozen", health.SCANNER_OK, SCANS_STALE_S),
    ("ahrs", "frozen", health.AHRS_OK, AHRS_STALE_S),
    ("drive", "mute", health.WHEELS_OK, WHEELS_STALE_S),
    ("scanner", "mute", health.SCANNER_OK, SCANS_STALE_S),
    ("ahrs", "mute", health.AHRS_OK, AHRS_STALE_S),
    ("ahrs", "nan", health.AHRS_OK, AHRS_STALE_S),
]


def free_cells(commander: Commander) -> int:
    return int((commander.loop.planner.window() == 1).sum())


@pytest.mark.parametrize(("name", "fault", "bit", "stale_after_s"), few(ROWS, 3))
def test_an_input_that_stops_or_repeats_itself_is_told_and_stops_the_wheels_in_time(
    name: str, fault: str, bit: int, stale_after_s: float
) -> None:
    commander = driving()
    begun_s, told_s, powered_s = commander.loop.now_s, None, 0.0
    assert commander.health & bit
    setattr(getattr(commander.loop.rig, name), fault, True)
    while commander.loop.now_s - begun_s < 1.2:
        commander.run(STEP_S)
        passed_s = commander.loop.now_s - begun_s
        if told_s is None and not commander.health & bit:
            told_s = passed_s
            assert not commander.health & health.MAP_VALID
        if commander.loop.rig.drive.powers() != (0, 0):
            powered_s = passed_s
    assert told_s is not None
    assert told_s <= stale_after_s + TICK_S + STEP_S
    assert powered_s <= stale_after_s + LOOK_S + ORDER_S + STEP_S
    assert free_cells(commander) == 0
    assert stale_after_s + REPAIR_S < 1.2


def started_again(commander: Commander) -> float:
    """Its controller starts again; nothing moves by itself. How far the map may be off then."""
    mapper, erased = commander.loop.app.mapper, commander.loop.app.mapper.counts.erased
    commander.loop.rig.drive.reset(commander.loop.now_s)
    commander.run(ORDER_S + LOOK_S)
    commander.powers = set()
    commander.run(2.5)  # while the commander goes on asking
    assert not commander.has_moved
    assert mapper.counts.erased == erased + 1
    return mapper.off_start_m


BOX = Solid("box", (6.5, 7.3), (-0.3, 0.6), (0.0, 0.8))


def test_after_a_controller_started_again_the_map_holds_as_far_as_it_can_have_rolled() -> None:
    commander = Commander(FLOOR, BOX)
    commander.drive(0.6, 0.0, 3.0)
    off_m = started_again(commander)
    assert 0.0 < off_m < 1.0
    app, (x, y, _) = commander.loop.app, commander.place
    pose = app.mapper.maybe_pose(commander.loop.now_s)
    assert pose is not None
    assert np.hypot(pose.x_m - x, pose.y_m - y) <= off_m
    assert app.pilot.control.clear[2] == 12.0 - off_m
    comparison = compare(commander.loop)
    assert (commander.loop.map_now() == FREE).sum() > 100
    assert comparison.free_on_obstacle == []
    commander.drive(0.0, 0.0, 0.5)
    commander.drive(0.6, 0.0, 9.0)  # it goes on, and stops before the box
    assert commander.place[0] > x + 1.0
    assert commander.place[0] < BOX.x[0] - FRONT_M
    assert commander.blocked_by == "an obstacle is in the way"
    told = commander.loop.planner.window()
    meant = np.array([0, 2, 1], dtype=np.uint8)[commander.loop.map_now()]
    assert int((told != meant).sum()) <= 20  # what this very tick's scan changed


def test_a_second_restart_adds_to_what_the_map_may_be_off() -> None:
    commander = driving(start_clear_m=12.0)
    once_m = started_again(commander)
    twice_m = started_again(commander)
    assert 1.1 * once_m < twice_m < 2.0 * once_m  # the second time it stood


def started_with_radio(commander: Commander) -> Mapper:
    """Its controller has been in R/C mode for some seconds."""
    fake = commander.loop.rig.drive
    fake.parameters[0] = 0
    fake.reset(commander.loop.now_s)
    commander.run(5.0)
    fake.mode = "rs232_watchdog"
    commander.run(3.0)
    assert commander.loop.app.mapper.counts.erased == 1
    return commander.loop.app.mapper


def test_a_controller_that_starts_again_with_its_radio_ends_the_map() -> None:
    commander = driving(start_clear_m=12.0)
    app = commander.loop.app
    started_with_radio(commander)
    assert app.mapper.off_start_m == np.inf
    assert app.pilot.control.clear[2] == 0.0
    assert not app.mapper.maps.window.under.any()


def test_where_no_radio_is_wired_it_has_rolled_no_farther_than_without_power() -> None:
    commander = Commander(FLOOR, BOX, radio=False)
    commander.drive(0.6, 0.0, 3.0)
    mapper = started_with_radio(commander)
    (x, y, _), pose = commander.place, mapper.maybe_pose(commander.loop.now_s)
    assert pose is not None
    assert np.hypot(pose.x_m - x, pose.y_m - y) <= mapper.off_start_m < 1.0
    assert (commander.loop.map_now() == FREE).sum() > 100
    assert compare(commander.loop).free_on_obstacle == []


def test_an_attitude_whose_gyro_contradicts_its_angles_is_counted_and_the_angles_are_told() -> None:
    """It does not stop the robot: nobody knows which of both is right."""
    commander = driving()
    commander.loop.rig.ahrs.rate_bias_radps = np.array([0.0, 0.35, 0.0])
    commander.asks = None
    commander.run(1.5)
    attitudes = commander.loop.app.mapper.attitudes
    roll_rad, pitch_rad, _ = attitudes.newest_rpy()
    assert abs(pitch_rad) < 0.06
    assert abs(roll_rad) < 0.06
    assert attitudes.orientation.doubted > 0


def test_an_attitude_that_stands_still_while_the_wheels_turn_is_not_believed_for_long() -> None:
    """Samples come, counted and noisy, and tell one and the same attitude."""
    commander = driving()
    commander.drive(0.0, 0.5, 1.5)
    sensor, now_s = commander.loop.rig.ahrs.sensor, commander.loop.now_s
    stuck = sensor._motion_at(now_s)
    stuck = (stuck[0], np.zeros(3), stuck[2])
    sensor._motion_at = lambda t_s: stuck
    begun_rad = commander.place[2]
    commander.run(4.0)
    assert commander.place[2] - begun_rad < IGNORED_RAD + 0.3  # and until it stands
    assert commander.loop.rig.drive.powers() == (0, 0)
    assert commander.blocked_by == "the pose is not known"
    assert not commander.health & health.POSE_VALID
    assert free_cells(commander) == 0


@pytest.mark.parametrize("again", few([False, True], 1))
def test_an_attitude_that_gravity_contradicts_is_not_believed_until_both_agree(
    again: bool,
) -> None:
    """Its angles are wrong by 6 degrees, and so are those told; what it feels is right."""
    commander = driving()
    sensor, mapper = commander.loop.rig.ahrs, commander.loop.app.mapper
    sensor.tilt_off_rad = np.radians([0.0, 6.0])
    most_mps, left = 2.0 * 1.0 + SWAY_MPS, math.sin(math.radians(6.0)) - SHEET_RAD
    commander.run(most_mps / (GRAVITY_MPS2 * left) + BLOCK_S + 2 * TICK_S)
    assert mapper.gravity.times == mapper.counts.erased == 1
    assert mapper.doubt == mapper.odometry.broken_by
    assert not commander.health & (health.POSE_VALID | health.MAP_VALID)
    assert commander.health & health.AHRS_OK  # it delivers
    assert commander.blocked_by == "the pose is not known"
    commander.run(ORDER_S + LOOK_S)
    assert commander.loop.rig.drive.powers() == (0, 0)
    assert commander.loop.app.monitor.why == ""  # it was the pilot that stopped it
    if not again:
        return
    commander.run(2.0)
    assert free_cells(commander) == 0
    sensor.tilt_off_rad = np.zeros(2)
    commander.run(SPAN_S + BLOCK_S + TICK_S)
    assert (mapper.doubt, mapper.gravity.times, mapper.counts.erased) == ("", 1, 2)
    commander.run(1.0)
    assert commander.health & health.MAP_VALID
    assert free_cells(commander) > 50
    comparison = compare(commander.loop)
    assert comparison.free_on_obstacle == []


def test_the_wall_clock_is_read_for_what_people_read_alone() -> None:
    """Names of files, stamps of log and recording, and of what Modbus clients show."""
    rooms = [
        *ROOT.glob("*.py"),
        *(path for room in ROOMS for path in (ROOT / room).glob("**/*.py")),
    ]
    reads = re.compile(r"\btime\.(?:time|time_ns)\b|\bdatetime\.(?:now|today|utcnow)\b")
    readers = {path.name for path in rooms if reads.search(path.read_text(encoding="utf-8"))}
    assert readers == {"wiring.py", "recorder.py", "logs.py", "flight.py"}


def test_where_counters_jump_the_map_ends_and_the_robot_stands() -> None:
    """They may have been wrong before: how far it is off nobody knows."""
    commander = Commander(FLOOR, BOX)
    commander.drive(0.6, 0.0, 3.0)
    commander.loop.rig.drive.counter_offset = (100_000, 100_000)
    commander.run(1.0)
    app, x = commander.loop.app, commander.place[0]
    commander.run(1.0)
    assert (app.mapper.counts.erased, app.mapper.off_start_m) == (1, np.inf)
    assert commander.place[0] == pytest.approx(x, abs=0.01)
    assert not app.mapper.maps.window.under.any()
    assert compare(commander.loop).free_on_obstacle == []
