"""Ways of a machine that is no disc: they fit, pass what a disc cannot, and say where they end."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from shapely import affinity
from shapely.geometry.base import BaseGeometry

from core.paths.geometry.shaped_ways import NoFit, Shape, find_shaped_way, off_floor_m2
from core.paths.geometry.space import FloorError, narrowed, polygons_in
from core.paths.geometry.ways import NoWay, Way, find_way
from core.records import F64
from tests.core.paths.floors import KINDS

Corners = list[tuple[float, float]]
LONG: Corners = [(0.6, 0.3), (-0.6, 0.3), (-0.6, -0.3), (0.6, -0.3)]
AFT: Corners = [(0.9, 0.3), (-0.3, 0.3), (-0.3, -0.3), (0.9, -0.3)]  # turns about a rear axle
ASKEW: Corners = [(0.6, 0.5), (-0.6, 0.5), (-0.6, -0.1), (0.6, -0.1)]  # wider to its left
BOAT: Corners = [(0.6, 0.0), (0.0, 0.3), (-0.6, 0.0), (0.0, -0.3)]  # of its sides none lies along
SMALL: Corners = [(0.4, 0.15), (-0.3, 0.15), (-0.3, -0.15), (0.4, -0.15)]


def two_rooms(door_m: float, wall_m: float) -> BaseGeometry:
    """With a door, or a passage, in the middle between both."""
    door = shapely.box(3.9, 2 - door_m / 2, 4.1 + wall_m, 2 + door_m / 2)
    rooms = shapely.box(0, 0, 4, 4), shapely.box(4 + wall_m, 0, 8 + wall_m, 4)
    return shapely.union_all([*rooms, door])


def bend(wide_m: float) -> BaseGeometry:
    """A room, a corridor that turns by 90 degrees, and another room."""
    rooms = shapely.box(0, 0, 4, 4), shapely.box(6, -5, 12, -1.9)
    along = shapely.box(3.9, 3, 10, 3 + wide_m)
    return shapely.union_all([*rooms, along, shapely.box(10 - wide_m, -2, 10, 3 + wide_m)])


def is_driven(way: Way, corners: Corners, floor: BaseGeometry) -> bool:
    """Whether the machine stays on the floor, by a slow and obvious model: degree by degree."""
    hull = shapely.MultiPoint([*corners, (0, 0)]).convex_hull
    loose = floor.buffer(1e-6)
    steps = np.diff(way.points, axis=0)
    looks = np.degrees(np.arctan2(steps[:, 1], steps[:, 0]))

    def at(place: F64, look: float) -> BaseGeometry:
        return affinity.translate(affinity.rotate(hull, look, (0, 0)), *place)

    for look, a, b in zip(looks, way.points[:-1], way.points[1:], strict=True):
        if not loose.covers(at(a, look).union(at(b, look)).convex_hull):
            return False
    turns = np.degrees(way.turns_rad)
    assert np.cos(way.turns_rad) == pytest.approx(np.cos(np.radians(np.diff(looks))))
    for place, look, turn in zip(way.points[1:-1], looks[:-1], turns, strict=True):
        if not all(loose.covers(at(place, look + d)) for d in np.linspace(0, turn, 200)):
            return False
    return True


@pytest.mark.parametrize("wall_m", [0.2, 2.0])
@pytest.mark.parametrize("corners", [LONG, AFT, ASKEW, BOAT], ids=["long", "aft", "askew", "boat"])
def test_a_passage_is_taken_that_is_hardly_wider_than_the_machine(
    corners: Corners, wall_m: float
) -> None:
    """Of 0.6 m, in a circle of 1.34 to 1.9 m."""
    for door_m in (0.62, 0.9):
        floor = two_rooms(door_m, wall_m)
        found = find_shaped_way(floor, Shape(corners, 0.0), (1.2, 1.2), (6.8 + wall_m, 1.2))
        assert isinstance(found, Way), door_m
        assert is_driven(found, corners, floor)


def test_a_passage_that_is_narrower_is_none_and_clearance_counts() -> None:
    assert isinstance(find_shaped_way(two_rooms(0.59, 0.2), Shape(AFT, 0.0), (1, 1), (7, 1)), NoWay)
    floor = two_rooms(0.8, 2.0)
    assert isinstance(find_shaped_way(floor, Shape(LONG, 0.09), (1, 1), (8, 1)), Way)
    thin = Shape([(0.6, 0.001), (-0.6, 0.001), (-0.6, -0.001), (0.6, -0.001)], 0.0)
    assert isinstance(find_shaped_way(floor, thin, (1, 1), (8, 1)), Way)
    found = find_shaped_way(floor, Shape(LONG, 0.11), (1, 1), (8, 1))
    assert isinstance(found, NoWay)
    assert found.describe().startswith("the widest gap between start and goal is 0.800 m wide")


@settings(max_examples=5, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_a_way_fits_and_lies_between_those_of_the_discs_within_and_around(seed: int) -> None:
    floor, shape = KINDS["rooms"](seed), Shape(SMALL, 0.0)
    chance = np.random.default_rng(seed)
    parts = polygons_in(narrowed(floor, shape.near_m))
    assume(parts)
    part = max(parts, key=lambda one: one.area)
    low, high = np.split(np.array(part.bounds), 2)
    some = chance.uniform(low, high, (50, 2))
    some = some[shapely.contains_xy(part, *some.T)]
    assume(len(some) > 1)
    start, goal = (tuple(p) for p in some[:2])
    found = find_shaped_way(floor, shape, start, goal)
    within, around = (find_way(floor, m, start, goal) for m in (shape.near_m, shape.far_m))
    if isinstance(around, Way):
        assert isinstance(found, Way)
        assert found.length_m <= around.length_m + 1e-9
    if isinstance(within, NoWay):
        assert found == within
    if isinstance(found, Way):
        assert off_floor_m2(floor, shape, found) < 1e-6
        assert isinstance(within, Way)
        assert within.length_m - 1e-9 <= found.length_m
        assert found.points[0] == pytest.approx(start)
        assert found.points[-1] == pytest.approx(goal)
        assert is_driven(found, SMALL, floor)


def test_it_turns_bit_by_bit_through_a_labyrinth_that_has_no_room_for_a_turn() -> None:
    """Gaps of 0.9 m between corridors of 1.1 m, and a circle of 1.34 m."""
    walls = [
        shapely.box(k, 0 if k % 4 else 0.9, k + 0.9, 6.1 if k % 4 else 7) for k in range(2, 8, 2)
    ]
    floor = shapely.box(0, 0, 10, 7).difference(shapely.union_all(walls))
    found = find_shaped_way(floor, Shape(LONG, 0.0), (1, 1), (9, 1))
    assert isinstance(found, Way)
    assert is_driven(found, LONG, floor)


def test_a_corridor_whose_bend_it_cannot_turn_in_is_told_with_the_place() -> None:
    """A machine of 1.2 x 0.6 m gets round with 1.1 m of corridor; 0.8 m lets 1.06 m pass at most.

    The longest is 2 (sqrt(2) w - b), of a corridor w wide and a machine b wide.
    """
    wide = find_shaped_way(bend(1.1), Shape(LONG, 0.0), (1, 1), (7, -3))
    assert isinstance(wide, Way)
    assert is_driven(wide, LONG, bend(1.1))
    narrow = find_shaped_way(bend(0.8), Shape(LONG, 0.0), (1, 1), (7, -3))
    assert isinstance(narrow, NoFit)
    assert math.dist(narrow.place, (9.6, 3.4)) < 0.6
    assert "cannot turn or drive on there" in narrow.describe()


def test_a_heading_at_an_end_is_kept() -> None:
    """In a corridor it cannot turn about: it drives out at the end that it looks to."""
    floor, shape = bend(1.1), Shape(LONG, 0.0)
    ahead = find_shaped_way(floor, shape, (6, 3.5), (7, -3), 0.0)
    away = find_shaped_way(floor, shape, (6, 3.5), (7, -3), math.pi)
    assert isinstance(ahead, Way)
    assert isinstance(away, Way)
    assert ahead.points[1, 0] > 6
    assert away.points[1, 0] < 4  # to the room, to turn there
    into = find_shaped_way(floor, shape, (1, 1), (6, 3.5), None, math.pi)
    assert isinstance(into, Way)
    assert into.points[-2, 0] > 6  # past it, and back again
    across = find_shaped_way(floor, shape, (6, 3.5), (7, -3), math.pi / 2)
    assert isinstance(across, NoFit)
    assert across.describe() == "start: at 6,3.5 the machine does not fit at 90 deg"


def test_a_turn_that_a_wall_bars_is_told_as_the_longer_way_round() -> None:
    """It comes at -10 deg and leaves at -170: its nose goes round by the side without a wall."""
    corners: Corners = [(0.9, 0.3), (-0.1, 0.3), (-0.1, -0.3), (0.9, -0.3)]
    far = [(-4 * math.cos(a), 4 * math.sin(a)) for a in (math.radians(10), math.radians(-10))]
    arms = [shapely.LineString([(0, 0), end]).buffer(0.36) for end in far]
    round_it = shapely.Point(0, 0).buffer(1.4).intersection(shapely.box(-0.8, -0.6, 2, 2))
    floor = shapely.union_all([*arms, round_it])
    ends = [(0.75 * x, 0.75 * y) for x, y in far]
    found = find_shaped_way(floor, Shape(corners, 0.0), ends[0], ends[1])
    assert isinstance(found, Way)
    assert is_driven(found, corners, floor)
    assert np.degrees(found.turns_rad).max() > 180


def test_a_footprint_without_area_is_refused() -> None:
    with pytest.raises(FloorError, match="must have an area"):
        Shape([(1, 1), (2, 2), (-1, -1)], 0.0)
