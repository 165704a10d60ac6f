"""Shortest ways: against a slow and obvious model, round corners, and why there is none."""

import math
import re

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from core.paths.geometry.rings import length_of
from core.paths.geometry.space import FloorError, narrowed, polygons_in
from core.paths.geometry.ways import NoWay, Way, find_way
from tests.core.paths.floors import KINDS

TWO = [shapely.box(0, 0, 2, 2), shapely.box(3, 0, 5, 2)]
CORRIDOR = shapely.box(1.9, 0.9, 3.1, 1.15)


def grid_length(space: shapely.Polygon, start: np.ndarray, goal: np.ndarray) -> float:
    """The shortest way over a grid of 16 directions, by relaxing until nothing changes."""
    step = 0.1
    low = np.floor(np.array(space.bounds[:2]) / step) * step
    size = np.ceil((np.array(space.bounds[2:]) - low) / step).astype(int) + 1
    x, y = np.meshgrid(low[0] + step * np.arange(size[0]), low[1] + step * np.arange(size[1]))
    nodes = np.column_stack([x.ravel(), y.ravel()])
    nodes = np.vstack([nodes[shapely.contains_xy(space, *nodes.T)], start, goal])
    far = np.hypot(*np.moveaxis(nodes[:, None] - nodes, 2, 0))
    i, j = np.nonzero((far < 2.3 * step) & (far > 0))
    lines = shapely.linestrings(np.stack([nodes[i], nodes[j]], axis=1))
    free = shapely.covers(space.buffer(1e-9), lines)
    i, j, cost = i[free], j[free], far[i, j][free]
    best = np.full(len(nodes), math.inf)
    best[-2] = 0.0
    while True:
        after = best.copy()
        np.minimum.at(after, j, best[i] + cost)
        if np.array_equal(after, best):
            return float(best[-1])
        best = after


@settings(max_examples=10, deadline=None)
@given(kind=st.sampled_from(["rooms", "ragged"]), seed=st.integers(0, 10**6))
def test_a_way_keeps_off_walls_and_is_never_longer_than_one_over_a_grid(
    kind: str, seed: int
) -> None:
    floor, margin_m = KINDS[kind](seed), 0.12
    parts = [p for p in polygons_in(narrowed(floor, margin_m)) if p.area > 0.3]
    if not parts:
        return
    chance = np.random.default_rng(seed)
    low, high = np.split(np.array(parts[0].bounds), 2)
    some = chance.uniform(low, high, (200, 2))
    start, goal = some[shapely.contains_xy(parts[0], *some.T)][:2]
    way = find_way(floor, margin_m, tuple(start), tuple(goal))
    assert isinstance(way, Way)
    line = shapely.LineString(way.points)
    assert floor.covers(line)
    assert floor.boundary.distance(line) >= margin_m - 1e-6
    assert way.length_m == pytest.approx(length_of(way.points))
    assert math.dist(start, goal) <= way.length_m <= grid_length(parts[0], start, goal) + 1e-6


def test_a_way_round_a_corner_is_the_tight_arc() -> None:
    """Two tangents to the circle of the margin, and the arc between where they touch."""
    corner = shapely.box(0, 0, 4, 4).difference(shapely.box(0, 0, 2, 2))
    way = find_way(corner, 0.5, (0.6, 2.6), (2.6, 0.6))
    assert isinstance(way, Way)
    far = math.hypot(1.4, 0.6)
    round_rad = 2 * math.pi - math.acos(-1.68 / far**2) - 2 * math.acos(0.5 / far)
    assert way.length_m == pytest.approx(2 * math.sqrt(far**2 - 0.25) + 0.5 * round_rad, rel=0.005)


def test_a_labyrinth_is_walked_to_its_end() -> None:
    walls = [
        shapely.box(k, 0 if k % 2 else 0.5, k + 0.1, 2.5 if k % 2 else 3) for k in range(1, 12)
    ]
    floor = shapely.box(0, 0, 12, 3).difference(shapely.union_all(walls))
    way = find_way(floor, 0.2, (0.5, 1.5), (11.6, 1.5))
    assert isinstance(way, Way)
    assert 25.0 < way.length_m < 32.0
    assert floor.boundary.distance(shapely.LineString(way.points)) >= 0.2 - 1e-6


@pytest.mark.parametrize(
    ("start", "goal", "margin_m", "why", "said"),
    [
        (
            (0.05, 1),
            (4, 1),
            0.15,
            "start",
            "start: 0.05,1 is 0.050 m from a wall or obstacle, must",
        ),
        ((1, 1), (2.5, 1.9), 0.15, "goal", "goal: 2.5,1.9 lies 0.500 m off the floor"),
        (
            (1, 1),
            (4, 1),
            0.15,
            "gap",
            "the widest gap between start and goal is 0.250 m wide, at 2.00,1.02: 0.053 m too "
            "narrow, must be 0.303 m",
        ),
        (
            (2.5, 1.0),
            (4, 1),
            0.125,
            "start",
            "start: 2.5,1 is 0.100 m from a wall or obstacle, must be 0.127 m",
        ),
    ],
)
def test_why_there_is_no_way(
    start: tuple[float, float], goal: tuple[float, float], margin_m: float, why: str, said: str
) -> None:
    found = find_way(shapely.union_all([*TWO, CORRIDOR]), margin_m, start, goal)
    assert isinstance(found, NoWay)
    assert found.why == why
    assert found.describe().startswith(said)


def test_a_gap_that_is_wide_enough_is_taken_and_walls_without_one_are_told() -> None:
    assert isinstance(find_way(shapely.union_all([*TWO, CORRIDOR]), 0.12, (1, 1), (4, 1)), Way)
    found = find_way(shapely.union_all(TWO), 0.1, (1, 1), (4, 1))
    assert isinstance(found, NoWay)
    assert found.describe() == "start and goal: walls part them, there is no gap at all"
    nowhere = find_way(shapely.Polygon(), 0.1, (1, 1), (4, 1))
    assert isinstance(nowhere, NoWay)
    assert "no floor" in nowhere.describe()


def test_the_gap_is_measured_and_found() -> None:
    found = find_way(shapely.union_all([*TWO, CORRIDOR]), 0.2, (1, 1), (4, 1))
    assert isinstance(found, NoWay)
    assert found.needed_m == pytest.approx(0.4, abs=0.003)
    assert found.there_m == pytest.approx(0.25, abs=1e-3)
    assert 1.9 < found.place[0] < 3.1


@given(margin_m=st.floats(0.02, 0.6), more_m=st.floats(-1e-3, 4e-3), is_gap=st.booleans())
def test_what_is_hardly_too_little_is_told_as_less_than_what_must_be(
    margin_m: float, more_m: float, is_gap: bool
) -> None:
    half_m = margin_m + more_m
    hall = shapely.box(0, -2, 3, 2)
    if is_gap:
        ways = shapely.union_all(
            [hall, shapely.box(6, -2, 9, 2), shapely.box(2, -half_m, 7, half_m)]
        )
        found = find_way(ways, margin_m, (1, 0), (8, 0))
    else:
        found = find_way(hall, margin_m, (half_m, 0), (1.5, 0))
    if isinstance(found, Way):
        assert half_m > margin_m
        return
    words = re.findall(r"([\d.]+) m", found.describe())
    there_m, must_m = float(words[0]), float(words[-1])
    assert there_m < must_m
    assert there_m == pytest.approx(half_m * (1 + is_gap), abs=1.2e-3)
    assert all(float(word) > 0 for word in words)
    enough = shapely.box(0, -must_m / (1 + is_gap), 9, must_m / (1 + is_gap))
    assert isinstance(find_way(enough, margin_m, (1, 0), (8, 0)), Way)


@pytest.mark.parametrize("bad", [(math.nan, 1.0), (1.0, math.inf)])
def test_an_end_that_is_no_number_is_named(bad: tuple[float, float]) -> None:
    with pytest.raises(FloorError, match="start: must be two finite numbers, is"):
        find_way(TWO[0], 0.1, bad, (1, 1))
    with pytest.raises(FloorError, match="goal: must be two finite numbers, is"):
        find_way(TWO[0], 0.1, (1, 1), bad)


def test_a_start_that_is_hardly_off_the_floor_is_told_with_enough_digits() -> None:
    found = find_way(TWO[0], 0.1, (-2e-5, 1), (1, 1))
    assert isinstance(found, NoWay)
    assert found.describe() == "start: -2e-05,1 lies 0.00002 m off the floor"
