"""Clearing: what has gone goes, and what stands stays, however the beams pass by it."""

import math

import numpy as np
import pytest

from core.mapping.beams.carving import THROUGH
from core.records import FREE, OBSTACLE
from tests.support.cases import few
from tests.support.cell_rig import LENS, CellRig
from tests.support.flat_ride import SCAN_S, Ride, Rig, config_of, places_where, state_at
from tests.support.flat_world import Box, Cylinder, World, ramp

WALK_MPS = 1.2
STANDING, SLOW, BRISK = Ride(), Ride(v_mps=0.4), Ride(v_mps=1.0)


def obstacles_near(rig: Rig, x: float, y: float, radius_m: float) -> int:
    """Obstacle cells whose middle lies near a place."""
    found = places_where(rig, OBSTACLE)
    return int(np.sum(np.hypot(found[:, 0] - x, found[:, 1] - y) <= radius_m))


# What has gone

FEW_LEFT = 5  # of some 80 cells, which few beams pass: they go later


def crossing(x_m: float, ride: Ride) -> tuple[int, int]:
    """A person crosses: scans in which no obstacle was there, and most cells left behind.

    Behind is what the body's nearest part has left a second ago, and a cell more.
    """
    person = Cylinder(x_m, -3.0, 0.2, 1.7, 0.0, WALK_MPS)
    rig = Rig(config_of(), World(solids=(person,)), ride, 6.0)
    unseen = trail = 0
    for now_s in rig.drive():
        x, y = person.place(now_s - SCAN_S)
        if now_s > 0.3 and abs(y) < 2.5:
            unseen += obstacles_near(rig, x, y, 0.35) == 0
        found = places_where(rig, OBSTACLE)
        trail = max(trail, int(np.sum(found[:, 1] < y - 0.2 - WALK_MPS - 0.2)))
    return unseen, trail


@pytest.mark.parametrize("x_m", few([6.0, 4.0, 7.4], 1))
def test_a_person_who_crosses_is_on_the_map_while_there_and_gone_a_second_later(
    x_m: float,
) -> None:
    unseen, trail = crossing(x_m, STANDING)
    assert unseen <= 2
    assert trail <= FEW_LEFT


def test_a_person_who_crosses_before_a_driving_robot_is_on_the_map_while_there() -> None:
    """What stays behind is not asked here: beams that come to pass above prove nothing.

    The edge of a table looks the same as a person who has gone.
    """
    unseen, _ = crossing(6.0, SLOW)
    assert unseen <= 2


def test_where_a_person_stood_the_floor_that_was_seen_before_is_free_again() -> None:
    person = Cylinder(8.3, -4.0, 0.2, 1.7, 0.0, WALK_MPS)
    rig = Rig(config_of(), World(solids=(person,)), STANDING, 7.0).run()
    assert len(places_where(rig, OBSTACLE)) == 0
    assert state_at(rig, 8.45, 0.1) == FREE


@pytest.mark.parametrize("height_m", few([0.3, 0.6, 1.2], 1))
def test_a_box_that_is_taken_away_is_gone_a_second_later(height_m: float) -> None:
    box = Box((7.0, -0.3, 0.0), (7.4, 0.3, height_m), until_s=3.0)
    rig = Rig(config_of(), World(solids=(box,)), STANDING, 4.5)
    there = 0
    for now_s in rig.drive():
        near = obstacles_near(rig, 7.1, 0.0, 0.5)
        there += 1.0 < now_s <= 3.0 and near > 0
        if now_s > 3.0 + 1.0 + 2 * SCAN_S:
            assert near == 0, now_s
    assert there >= 48


# What stands


def test_a_table_top_is_not_cleared_by_beams_that_pass_under_it() -> None:
    """0.7 m high, open below: near it the beams see the floor under and behind it."""
    table = Box((7.0, -0.8, 0.67), (8.2, 0.8, 0.70))
    rig = Rig(config_of(), World(solids=(table,)), Ride(v_mps=0.5), 10.0).run()
    edge = places_where(rig, OBSTACLE)
    for y in (-0.5, -0.1, 0.1, 0.5):
        assert np.any((np.abs(edge[:, 1] - y) < 0.11) & (np.abs(edge[:, 0] - 7.1) < 0.21)), y


@pytest.mark.parametrize("v_mps", few([1.0, 0.3], 1))
def test_a_wall_driven_past_is_not_cleared(v_mps: float) -> None:
    wall = Box((3.0, 1.0, 0.0), (9.0, 1.2, 2.5))
    rig = Rig(config_of(), World(solids=(wall,)), Ride(v_mps=v_mps), 9.0 / v_mps)
    for _ in rig.drive():
        pass
    assert rig.maps.carver.cleared == 0
    found = places_where(rig, OBSTACLE)
    for x in np.arange(3.9, 8.8, 0.2):
        assert np.any((np.abs(found[:, 0] - x) < 0.11) & (np.abs(found[:, 1] - 1.1) < 0.21)), x


@pytest.mark.parametrize("height_m", few([0.15, 0.3, 0.8], 1))
def test_boxes_driven_past_keep_every_edge(height_m: float) -> None:
    boxes = tuple(
        Box((x, y, 0.0), (x + 0.4, y + 0.4, height_m), yaw)
        for x, y, yaw in ((9.0, 0.6, 0.0), (10.03, -1.1, 0.4), (11.11, 0.5, 0.8))
    )
    rig = Rig(config_of(), World(solids=boxes), Ride(v_mps=0.5), 16.0).run()
    assert rig.maps.carver.cleared == 0
    for x, y in ((9.1, 0.7), (10.2, -0.9), (11.3, 0.7)):
        assert obstacles_near(rig, x, y, 0.35) > 0


@pytest.mark.parametrize("gap_m", few([0.0, 1.0], 1))
def test_a_box_before_a_ramp_stays_where_the_ground_before_the_ramp_is_taken_to_rise(
    gap_m: float,
) -> None:
    """Nearer than the line the ground is interpolated: here 5 to 10 cm too high."""
    box = Box((12.0, -0.3, 0.0), (12.4, 0.3, 0.2))
    slope = ramp(12.4 + gap_m, math.radians(11.0), 6.0)
    end = Box((20.0, -8.0, 0.0), (20.2, 8.0, 4.0))
    rig = Rig(config_of(), World(slope, (box, end)), Ride(v_mps=0.5), 10.8 / 0.5).run()
    assert rig.maps.carver.cleared == 0
    assert obstacles_near(rig, 12.2, 0.0, 0.45) >= 12


def test_while_a_turning_robot_only_guesses_the_ground_nothing_is_cleared() -> None:
    """Walls all around, nearer than the laser meets the floor: its line is never found."""
    walls = [Box((-4.2, s * 4.1 - 0.1, 0), (4.2, s * 4.1 + 0.1, 3)) for s in (-1, 1)]
    walls += [Box((s * 4.1 - 0.1, -4.2, 0), (s * 4.1 + 0.1, 4.2, 3)) for s in (-1, 1)]
    chest = Box((2.0, -1.8, 0.0), (2.6, 1.8, 1.0), until_s=1.5)
    world = World(solids=(*walls, chest))
    rig = Rig(config_of(), world, Ride(w_radps=0.5), 2.6)
    for _ in rig.drive():
        if rig.maps.ground.is_guess:
            break
    before = rig.maps.carver.cleared
    assert obstacles_near(rig, 2.2, 0.0, 0.5) > 0
    for _ in rig.drive():
        assert rig.maps.carver.cleared == before


@pytest.mark.parametrize("x_m", few([9.0, 6.0], 1))
@pytest.mark.parametrize("ride", [STANDING, SLOW, BRISK], ids=["standing", "slow", "brisk"])
def test_a_thin_pole_stays(x_m: float, ride: Ride) -> None:
    """4 cm thick: at times one beam meets it, and many pass close by."""
    pole = Cylinder(x_m + 0.01, 0.43, 0.02, 1.5)
    rig = Rig(config_of(), World(solids=(pole,)), ride, 5.0)
    first_s = math.inf
    for now_s in rig.drive():
        if obstacles_near(rig, x_m, 0.43, 0.25) > 0:
            first_s = min(first_s, now_s)
        elif now_s > first_s:
            pytest.fail(f"the pole has gone at {now_s:.2f} s")
    assert first_s < 4.5 or (x_m > 8.45 and ride.v_mps == 0.0)


def test_beside_and_above_a_wall_in_a_turn_nothing_is_cleared() -> None:
    walls = (Box((4.0, -6.0, 0.0), (4.2, 6.0, 2.5)), Box((-3.0, 5.0, 0.0), (4.0, 5.2, 1.0)))
    rig = Rig(config_of(), World(solids=walls), Ride(w_radps=0.6), 10.0).run()
    assert rig.maps.carver.cleared <= 1  # of some hundreds


# Beam by beam: limits are in test_carving_model.py


def blocked() -> CellRig:
    """A rig in which something stands at (2.1, 0.1), seen between two heights."""
    rig = CellRig()
    for _ in range(3):
        rig.add((2.1, 0.1, 0.2), (2.1, 0.1, 0.6))
    assert rig.state(2.1, 0.1) == OBSTACLE
    return rig


def pass_by(rig: CellRig, times: int) -> None:
    """Beams through the middle of it, level, ending 2 m behind."""
    for _ in range(times):
        rig.add(*[(4.0, 0.1, 0.4)] * 9, lens=(0.0, 0.1, 0.4))


def test_beams_through_the_middle_clear_after_some_scans_in_a_row() -> None:
    rig = blocked()
    pass_by(rig, THROUGH - 1)
    assert rig.state(2.1, 0.1) == OBSTACLE
    pass_by(rig, 8)
    assert rig.carver.cleared == 1
    assert rig.state(2.1, 0.1) != OBSTACLE
    cell = rig.cell(2.1, 0.1)
    assert (cell["above"], cell["high_bits"], cell["rising"]) == (0, 0, 0)


def test_a_return_in_between_begins_the_count_anew() -> None:
    rig = blocked()
    for _ in range(6):
        pass_by(rig, THROUGH - 2)
        rig.add((2.1, 0.1, 0.4), (2.1, 0.1, 0.6))
    assert rig.carver.cleared == 0
    assert rig.state(2.1, 0.1) == OBSTACLE


def test_the_floor_that_was_seen_counts_again() -> None:
    rig = CellRig()
    for _ in range(4):
        rig.add((2.1, 0.1, 0.01), lens=LENS)
    for _ in range(3):
        rig.add((2.1, 0.1, 0.2), (2.1, 0.1, 0.6))
    pass_by(rig, THROUGH + 8)
    cell = rig.cell(2.1, 0.1)
    assert cell["count"] == cell["floor_count"] == 4
    assert cell["mean_m"] == pytest.approx(0.01)
