"""Method `beams` in closed scenes: holes, steps, and floor that is not seen."""

import math

import numpy as np
import numpy.typing as npt
import pytest

from core.records import FREE, OBSTACLE, UNKNOWN
from tests.support.cases import few
from tests.support.flat_ride import Ride, Rig, config_of, places_where, state_at
from tests.support.flat_world import FAR_M, Box, Profile, World, ditch, kerb

F64 = npt.NDArray[np.float64]
LANES_M = (-0.3, -0.1, 0.1, 0.3)  # the cells that the robot's width of 0.6 m covers
SLACK_M = 0.15  # half the diagonal of a cell: a cell that touches a thing may be an obstacle
WITHIN_M = -SLACK_M - 0.03  # no part of a cell so deep in a ditch is floor, noise or not
LINE_M = 8.45  # from the axle to where the scanner sees the floor


def drive(world: World, metres: float, v_mps: float = 1.0, seed: int = 7) -> Rig:
    return Rig(config_of(), world, Ride(v_mps=v_mps), metres / v_mps, seed).run()


def within(profile: Profile, places: F64, low: float, high: float, slack_m: float) -> F64:
    """Those of some places (k, 2) whose u lies in low..high, widened by the slack."""
    u = profile.along(places)
    return np.asarray(places[(u >= low - slack_m) & (u <= high + slack_m)])


def barred_lanes(rig: Rig, low: float, high: float) -> set[float]:
    """The lanes of the robot's way in which an obstacle lies between u = low and high."""
    found = within(rig.world.ground, places_where(rig, OBSTACLE), low, high, SLACK_M)
    return {lane for lane in LANES_M if np.any(np.abs(found[:, 1] - lane) < 0.05)}


def false_obstacles(rig: Rig, low: float, high: float) -> int:
    """Obstacle cells that do not touch u = low..high."""
    found = places_where(rig, OBSTACLE)
    return len(found) - len(within(rig.world.ground, found, low, high, SLACK_M + 0.1))


# Holes


@pytest.mark.parametrize(
    ("width_m", "shift_m"),
    few([(0.3, 0.05), (0.6, 0.1), (0.3, 0.10), (0.3, 0.15), (0.6, 0.0), (1.5, 0.05)], 2),
)
@pytest.mark.parametrize("yaw_rad", few([0.2, -0.6, 0.0], 2))
def test_a_ditch_across_the_way_is_an_obstacle_in_every_lane(
    width_m: float, yaw_rad: float, shift_m: float
) -> None:
    near_m = (9.0 + shift_m) * math.cos(yaw_rad)
    ground = ditch(near_m, width_m, yaw_rad)
    rig = drive(World(ground), 9.0 + 2 * width_m + 1.0 - LINE_M)
    assert barred_lanes(rig, near_m, near_m + width_m) == set(LANES_M)
    inside = within(ground, places_where(rig, FREE), near_m, near_m + width_m, WITHIN_M)
    assert len(inside) == 0
    assert false_obstacles(rig, near_m, near_m + width_m) <= 3


@pytest.mark.parametrize("v_mps", few([0.5, 0.2], 1))
def test_a_narrow_ditch_is_still_an_obstacle_when_the_robot_is_before_it(v_mps: float) -> None:
    """Slow or fast: at 1.5 m from the robot's nose the laser has long seen the floor behind."""
    rig = drive(World(ditch(9.08, 0.3)), 9.08 - 1.5 - 0.52, v_mps)
    assert barred_lanes(rig, 9.08, 9.38) == set(LANES_M)
    assert state_at(rig, 8.5, 0.1) == FREE


def test_a_ditch_that_lies_in_view_of_a_standing_robot_is_never_free() -> None:
    near_m = LINE_M - 0.3
    rig = Rig(config_of(), World(ditch(near_m, 0.6)), Ride(), 4.0).run()
    ground = rig.world.ground
    inside = within(ground, places_where(rig, FREE), near_m, near_m + 0.6, WITHIN_M)
    assert len(inside) == 0


@pytest.mark.parametrize(
    ("rise_m", "shift_m"),
    few(
        [
            *[(0.12, 0.15), (-0.12, 0.05), (0.12, 0.0), (-0.50, 0.0), (-0.12, 0.0), (0.12, 0.05)],
            *[(0.12, 0.1), (-0.12, 0.1), (-0.12, 0.15), (0.20, 0.1), (-0.20, 0.05)],
        ],
        3,
    ),
)
def test_a_kerb_of_twelve_centimetres_is_an_obstacle_in_every_lane(
    rise_m: float, shift_m: float
) -> None:
    at_m = 9.0 + shift_m
    rig = drive(World(kerb(at_m, rise_m)), 3.5)
    assert barred_lanes(rig, at_m, at_m + 0.2) == set(LANES_M)
    before = places_where(rig, OBSTACLE)
    assert not np.any(before[:, 0] < at_m - SLACK_M)


@pytest.mark.parametrize(
    ("rise_m", "pitching_deg", "pitching_hz"),
    few(
        [
            *[(0.12, 1, 1.0), (-0.12, 2, 1.0)],
            *[
                (0.2, 3, 1.0),
                (0.12, 0.3, 1.0),
                (0.15, 1, 0.3),
                (-0.12, 1, 1.0),
                (-0.15, 1, 0.3),
                (-0.2, 3, 1.0),
            ],
        ],
        2,
    ),
)
def test_a_robot_that_nods_does_not_take_a_kerb_for_ground(
    rise_m: float, pitching_deg: float, pitching_hz: float
) -> None:
    ride = Ride(v_mps=0.6, pitching_rad=math.radians(pitching_deg), pitching_hz=pitching_hz)
    rig = Rig(config_of(), World(kerb(9.53, rise_m)), ride, 8.0).run()
    shadow_m = 1.3 if rise_m < 0.0 else 0.4
    assert barred_lanes(rig, 9.53, 9.53 + shadow_m) == set(LANES_M)


def test_a_table_does_not_drag_the_pose_along() -> None:
    """Its top moves with the robot under the beams: that is not the face of anything."""
    table = Box((9.0, -0.8, 0.67), (10.4, 0.8, 0.70))
    rig = Rig(config_of(), World(solids=(table,)), Ride(v_mps=0.7), 10.0).run()
    (x_m, y_m, _), (true_x_m, true_y_m, _) = rig.mapper.odometry.xyz_at(rig.now_s), rig.place()
    assert math.hypot(float(x_m) - true_x_m, float(y_m) - true_y_m) < 0.03


@pytest.mark.parametrize(("rise_m", "at_most"), [(0.08, 1), (-0.08, 4)])
@pytest.mark.parametrize("shift_m", few([0.15, 0.0, 0.05, 0.10], 1))
def test_a_kerb_of_eight_centimetres_bars_no_more_than_its_own_shadow(
    rise_m: float, at_most: int, shift_m: float
) -> None:
    """Down, it hides 0.6 m of the floor behind it, as a ditch would: that lies in four cells."""
    at_m = 9.0 + shift_m
    rig = drive(World(kerb(at_m, rise_m)), 4.0)
    found = places_where(rig, OBSTACLE)
    assert not np.any(found[:, 0] < at_m - SLACK_M)
    assert not np.any(found[:, 0] > at_m + 0.6 + SLACK_M)
    for lane in LANES_M:
        assert np.sum(np.abs(found[:, 1] - lane) < 0.05) <= at_most
        assert state_at(rig, at_m + 1.1, lane) == FREE


def test_a_drop_from_which_nothing_comes_back_is_an_obstacle() -> None:
    edge = Profile(((-FAR_M, 0.0), (9.07, 0.0), (9.07, -50.0), (FAR_M, -50.0)))
    rig = drive(World(edge), 3.0)
    assert barred_lanes(rig, 9.1, 9.3) == set(LANES_M)
    assert not np.any(places_where(rig, FREE)[:, 0] > 9.07 + SLACK_M)
    x, y = (places_where(rig, OBSTACLE)[0]).tolist()
    assert rig.maps.is_low(*rig.maps.window.grid.cell_of(x, y))


def is_mat(points: F64) -> npt.NDArray[np.bool_]:
    """A black mat, 1 m by 2 m."""
    x, y, z = points.T
    return np.asarray((x > 9.07) & (x < 10.07) & (np.abs(y) < 1.0) & (z < 0.05))


def test_floor_that_swallows_the_light_is_an_obstacle_and_the_floor_around_it_is_free() -> None:
    rig = drive(World(is_black=is_mat), 4.0)
    assert barred_lanes(rig, 9.2, 9.9) == set(LANES_M)
    free = places_where(rig, FREE)
    assert not np.any(is_mat(np.column_stack([free, np.zeros(len(free))])))
    assert state_at(rig, 11.1, 0.1) == FREE
    assert state_at(rig, 9.5, 1.3) == FREE


def test_floor_that_a_box_hides_is_unknown_and_no_drop() -> None:
    box = Box((9.03, -0.5, 0.0), (9.43, 0.5, 0.4))
    rig = drive(World(solids=(box,)), 6.0)
    assert barred_lanes(rig, 9.03, 9.23) == set(LANES_M)
    found = places_where(rig, OBSTACLE)
    assert np.all(np.abs(found[:, 0] - 9.23) < 0.2 + SLACK_M)
    assert np.all(np.abs(found[:, 1]) < 0.5 + SLACK_M)
    for x in (9.9, 10.5, 11.3):
        assert state_at(rig, x, 0.1) == UNKNOWN, x
    assert state_at(rig, 10.5, 1.3) == FREE
    for x, y in found:
        assert not rig.maps.is_low(*rig.maps.window.grid.cell_of(float(x), float(y)))


def test_outside_of_the_window_nothing_lies_low_and_erasing_forgets_everything() -> None:
    rig = drive(World(ditch(9.0, 0.6)), 2.0)
    grid = rig.maps.window.grid
    low = [
        (int(i), int(j))
        for i, j in (grid.cell_of(*place.tolist()) for place in places_where(rig, OBSTACLE))
        if rig.maps.is_low(int(i), int(j))
    ]
    assert len(low) > 50
    assert not any(rig.maps.is_low(i + grid.size, j) for i, j in low)
    epoch = rig.maps.window.epoch
    rig.maps.erase()
    assert rig.maps.window.epoch == epoch + 1
    assert not rig.maps.window.cells.any()
    assert len(rig.maps.window.take_changed()) == 0
    assert not rig.maps.cells.cells["count"].any()
    assert rig.maps.ground.line is None
    assert not any(rig.maps.is_low(i, j) for i, j in low)


# What it costs


def test_a_scan_touches_as_many_cells_in_a_large_window_as_in_a_small_one() -> None:
    """Beams end within the small one: what lies outside of it cannot be touched there."""
    room = (
        Box((9.5, -9.6, 0.0), (9.7, 9.6, 3.0)),
        Box((-1.0, 9.5, 0.0), (9.7, 9.7, 3.0)),
        Box((-1.0, -9.7, 0.0), (9.7, -9.5, 3.0)),
        Box((5.0, 1.0, 0.0), (5.5, 1.5, 0.5)),
    )
    touched = []
    for cells in (101, 401):
        config = config_of(map={"cells": cells}, obstacle={"window_cells": 101})
        rig = Rig(config, World(solids=room), Ride(v_mps=0.2), 2.0)
        touched.append([rig.maps.cells.used for _ in rig.drive()])
    assert touched[0] == touched[1]
    assert max(touched[0]) > 100
