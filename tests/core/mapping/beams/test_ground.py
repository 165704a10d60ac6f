"""The ground tracker: ramps are followed, kerbs and walls are not swallowed."""

import math

import numpy as np
import pytest

from core.mapping.beams.cells import CellGrid
from core.mapping.beams.ground import STEEPEST, GroundTracker
from core.mapping.beams.ground_plane import DUE_M, LEVEL, due_m, ground_m
from core.mapping.body import BodyPose
from core.mapping.rays import Sweep
from core.records import FREE, OBSTACLE
from tests.support.cases import few
from tests.support.flat_ride import Ride, Rig, config_of, places_where, state_at
from tests.support.flat_world import FAR_M, Box, Profile, World, kerb, ramp

LANES_M = (-0.3, -0.1, 0.1, 0.3)
WIDE = config_of(map={"cells": 161}, obstacle={"window_cells": 161})  # sees down a ramp


def drive(world: World, metres: float) -> Rig:
    return Rig(WIDE, world, Ride(v_mps=1.0), metres).run()


def slope_deg(rig: Rig) -> tuple[float, float]:
    """What the tracker says of the ground ahead of a robot that looks along +x."""
    along, across = rig.maps.ground.slope_rad(BodyPose(0, 0, 0, (1.0, 0.0), (0.0, 0.0), 0.0))
    return math.degrees(along), math.degrees(across)


def error_m(rig: Rig, x: float, y: float) -> float:
    """Tracked minus true height of the ground at a place."""
    true = float(rig.world.ground.height(np.array([[x, y]]))[0])
    return ground_m(rig.maps.ground.model, x, y) - true


FEW = 4  # a row of cells, where the line leaps from the ramp's top to the level behind it


def lane_cells_off_the_crest(rig: Rig, crest_m: float) -> int:
    """Obstacle cells in the robot's way, but for the row where the ground begins to fall away."""
    found = places_where(rig, OBSTACLE)
    return int(np.sum((np.abs(found[:, 1]) < 0.4) & (np.abs(found[:, 0] - crest_m) > 0.3)))


def test_flat_ground_is_tracked_within_two_centimetres_and_level() -> None:
    rig = drive(World(), 5.0)
    assert rig.maps.ground.found
    for x in (6.0, 9.0, 13.0):
        for y in (-2.0, 0.0, 2.0):
            assert abs(error_m(rig, x, y)) < 0.02
    assert slope_deg(rig) == pytest.approx((0.0, 0.0), abs=0.3)


@pytest.mark.parametrize("degrees", few([8, -4, 3, 1, 2, 4, 5, 6, 7, -1, -2, -3], 2))
def test_a_ramp_is_told_and_free_ground_from_its_foot_to_behind_its_top(degrees: int) -> None:
    """6 m long, full width: the robot drives on to it, up (or down), and off it."""
    rig = Rig(WIDE, World(ramp(9.53, math.radians(degrees), 6.0)), Ride(v_mps=1.0), 16.0)
    slopes_deg = {round(now_s, 2): slope_deg(rig) for now_s in rig.drive()}
    assert slopes_deg[4.0] == pytest.approx((degrees, 0.0), rel=0.3, abs=0.5)
    assert lane_cells_off_the_crest(rig, 9.53) <= FEW
    assert sum(state_at(rig, x, 0.1) == FREE for x in (12.1, 13.1, 14.1)) >= 2


@pytest.mark.parametrize("degrees", few([-5, -7, -6, -8], 2))
def test_a_ramp_that_falls_nearly_as_the_beams_do_is_not_free_before_it_is_seen(
    degrees: int,
) -> None:
    """To a laser that looks down by 7.5 deg its crest is an edge, behind which little is seen."""
    rig = drive(World(ramp(9.53, math.radians(degrees))), 1.5)
    assert state_at(rig, 9.1, 0.1) == FREE
    returns = rig.maps.cells.cells["count"]
    for x in np.arange(9.9, 11.1, 0.2):
        i, j = rig.maps.cells.grid.cell_of(float(x), 0.1)
        seen = returns[j % 161, i % 161] > 0
        assert seen or state_at(rig, float(x), 0.1) != FREE


@pytest.mark.parametrize("degrees", few([-6, 5, 6, -5, -3, 2], 2))
@pytest.mark.parametrize("across", [False, True])
def test_a_start_on_a_slope_is_a_start_on_ground(degrees: int, across: bool) -> None:
    rise = FAR_M * math.tan(math.radians(degrees))
    side = Profile(((-FAR_M, -rise), (FAR_M, rise)), math.pi / 2 if across else 0.0)
    rig = drive(World(side), 4.0)
    assert len(places_where(rig, OBSTACLE)) == 0
    assert slope_deg(rig)[across] == pytest.approx(degrees, abs=1.0)
    assert across or state_at(rig, 10.1, 0.1) == FREE


@pytest.mark.parametrize(("degrees", "at_most"), few([(6, 4), (3, 0)], 1))
def test_from_a_ramp_on_to_its_level_top_is_ground_all_the_way(degrees: int, at_most: int) -> None:
    rise = math.tan(math.radians(degrees))
    top = Profile(((-FAR_M, -FAR_M * rise), (9.53, 9.53 * rise), (FAR_M, 9.53 * rise)))
    rig = drive(World(top), 12.0)
    assert lane_cells_off_the_crest(rig, 9.53) <= at_most
    assert state_at(rig, 15.1, 0.1) == FREE


@pytest.mark.parametrize("rise_m", few([0.12, 3.0, 0.30, 0.15, 0.20], 2))
def test_a_kerb_or_wall_across_the_whole_view_is_not_swallowed(rise_m: float) -> None:
    """The robot goes on until its nose is half a metre before it."""
    rig = drive(World(kerb(9.53, rise_m)), 8.5)
    for lane in LANES_M:
        assert OBSTACLE in (state_at(rig, 9.5, lane), state_at(rig, 9.7, lane))
        assert state_at(rig, 9.1, lane) == FREE
        assert rise_m < 0.15 or state_at(rig, 11.1, lane) != FREE
    assert abs(error_m(rig, 9.3, 0.0)) < 0.05


@pytest.mark.parametrize(
    ("roll_deg", "pitch_deg"), few([(0.0, 0.5), (-0.5, 0.0), (0.0, -0.5), (0.5, 0.0)], 2)
)
def test_half_a_degree_of_wrong_roll_or_pitch_is_absorbed(
    roll_deg: float, pitch_deg: float
) -> None:
    bias_rad = math.radians(roll_deg), math.radians(pitch_deg)
    rig = Rig(config_of(), World(), Ride(v_mps=1.0, bias_rad=bias_rad), 8.0).run()
    assert len(places_where(rig, OBSTACLE)) == 0
    assert sum(state_at(rig, x, 0.1) == FREE for x in (10.1, 12.1, 14.1)) == 3


def test_a_low_box_is_an_obstacle_on_a_ramp_too() -> None:
    rise = math.tan(math.radians(4))
    box = Box((14.0, -0.4, 4.5 * rise - 0.1), (14.3, 0.4, 4.7 * rise + 0.15))
    rig = drive(World(ramp(9.53, math.radians(4)), solids=(box,)), 9.0)
    for lane in LANES_M:
        assert OBSTACLE in (state_at(rig, 13.9, lane), state_at(rig, 14.1, lane))
    assert state_at(rig, 14.1, 1.1) == FREE


# The tracker alone


def stand(x: float = 0.0, z: float = 0.0) -> BodyPose:
    return BodyPose(x, 0.0, z, (1.0, 0.0), (0.0, 0.0), x)


def floor_sweep(x: float, z: float, t_s: float, silent: bool = False) -> Sweep:
    """What a level robot at x sees of a floor of height z."""
    bearings, tilt = np.radians(np.arange(-60.0, 60.1, 0.25)), math.radians(7.5)
    level = math.cos(tilt) * np.cos(bearings)
    fall = -math.sin(tilt) * np.cos(bearings)
    rays = np.column_stack([level, np.sin(bearings), fall])
    lenses = np.tile([x + 0.25, 0.0, 1.08], (len(rays), 1))
    ranges_m = np.full(len(rays), np.nan) if silent else (z - 1.08) / fall
    return Sweep(t_s, lenses, rays, ranges_m[None, :])


def tracked(z: float = 0.0) -> GroundTracker:
    tracker = GroundTracker(CellGrid(101, 0.2), 1081)
    for k in range(50):
        tracker.follow(floor_sweep(0.04 * k, z, 0.04 * k), stand(0.04 * k))
    return tracker


def test_the_line_is_lost_without_returns_and_found_again_and_leads_from_the_wheels() -> None:
    tracker = tracked()
    assert tracker.found
    for k in range(50, 75):
        tracker.follow(floor_sweep(0.04 * k, 0.0, 0.04 * k, silent=True), stand(0.04 * k))
        assert not tracker.found
    assert abs(ground_m(tracker.model, 10.0, 0.0)) < 0.02
    for k in range(75, 80):
        tracker.follow(floor_sweep(0.04 * k, 0.0, 0.04 * k), stand(0.04 * k))
    assert tracker.found
    assert abs(ground_m(tracker.model, 11.0, 0.0)) < 0.02
    tracker.follow(floor_sweep(3.2, 0.03, 3.2), stand(3.2, z=0.05))
    line = tracker.line
    assert line is not None
    middle = 0.5 * (3.2 + line.x_m)
    for x, z in ((3.2, 0.05), (middle, 0.5 * (0.05 + line.z_m)), (line.x_m, line.z_m)):
        assert ground_m(tracker.model, x, 0.0) == pytest.approx(z, abs=0.01)


def test_erasing_begins_anew_from_where_the_robot_stands() -> None:
    tracker = tracked(0.02)
    tracker.erase()
    assert (tracker.line, tracker.found) == (None, False)
    assert tracker.slope_rad(stand()) == (0.0, 0.0)
    tracker.follow(floor_sweep(2.0, 0.0, 9.0), stand(2.0))
    assert tracker.found
    assert abs(ground_m(tracker.model, 10.0, 0.0)) < 0.03


def test_no_plane_is_steeper_than_the_steepest_ramp() -> None:
    tracker = tracked()
    for k in range(50, 150):
        x = 0.04 * k
        tracker.follow(floor_sweep(x, min(1.0, 0.03 * (k - 50)), 0.04 * k), stand(x))
        line = tracker.line
        assert line is not None
        assert math.hypot(line.slope_x, line.slope_y) <= math.sqrt(2) * STEEPEST


def test_where_a_beam_is_due_follows_from_the_plane() -> None:
    lens, down = np.array([0.0, 0.0, 1.0]), math.radians(10)
    ray = np.array([math.cos(down), 0.0, -math.sin(down)])
    assert due_m(lens, ray, LEVEL) == pytest.approx(1.0 / math.sin(down))
    assert due_m(lens, np.array([1.0, 0.0, 0.0]), LEVEL) == math.inf
    ramp_up = LEVEL._replace(far_x=math.tan(down))  # as steep as the beam comes down
    due = due_m(lens, ray, ramp_up)
    assert lens[2] + due * ray[2] == pytest.approx(due * ray[0] * math.tan(down))
    assert DUE_M > 8.45


TILT = (-math.tan(math.radians(0.5)), math.tan(math.radians(0.4)))  # along and across


def leaning_sweep(yaw_rad: float, t_s: float, share: float = 1.0) -> Sweep:
    """Of level floor, by a robot at (2, 0) whose attitude leans with it; or of a wall before it.

    Args:
        share: of the way to the floor at which all beams end.
    """
    plain = floor_sweep(0.0, 0.0, t_s)
    lens_m, rays = plain.origins[0], plain.rays
    ranges_m = -lens_m[2] / (rays @ np.array([-TILT[0], -TILT[1], 1.0]) + 1e-12)
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    lenses = np.tile(lens_m @ turn + [2.0, 0.0, 0.0], (len(rays), 1))
    return Sweep(t_s, lenses, rays @ turn, share * ranges_m[None, :])


def test_a_line_that_was_found_before_the_robot_turned_lies_as_it_would_now() -> None:
    """A wall comes into view: the tracker goes back to a line that it found at another heading."""
    tracker, t_s = GroundTracker(CellGrid(101, 0.2), 1081), 0.0
    for k in range(100):
        t_s, x = 0.04 * k, 2.0 - 0.04 * (100 - k)
        sweep = leaning_sweep(0.0, t_s)
        sweep.origins[:, 0] += x - 2.0
        tracker.follow(sweep, stand(x))
    for degrees in range(0, 91, 2):
        t_s, yaw_rad = t_s + 0.04, math.radians(degrees)
        heading = math.cos(yaw_rad), math.sin(yaw_rad)
        place = BodyPose(2.0, 0.0, 0.0, heading, (0.0, 0.0), 2.0)
        tracker.follow(leaning_sweep(yaw_rad, t_s), place)
    before = tracker.slope_rad(place)
    assert before[1] == pytest.approx(TILT[1], abs=0.003)
    tracker.follow(leaning_sweep(yaw_rad, t_s + 0.04, share=0.8), place)
    assert not tracker.found
    assert tracker.slope_rad(place) == pytest.approx(before, abs=0.002)
