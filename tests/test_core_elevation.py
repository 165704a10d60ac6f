"""Cells against a dict model; and what a ditch, an edge and a stray return make of them."""

import math
from collections import defaultdict

import numpy as np
import numpy.typing as npt
from hypothesis import given
from hypothesis import strategies as st

from core.elevation import MeanCells
from core.grid import RingGrid
from core.obstacles import LOOKED_AGAIN, NEW_LOOKS, ObstacleMap
from core.records import FREE, OBSTACLE, UNKNOWN

F64 = npt.NDArray[np.float64]
CELL_M, H = 0.2, 0.10


def maps(cells: int = 41, window: int = 41) -> tuple[MeanCells, ObstacleMap]:
    """An elevation map and its obstacle map, bounds +-0.10 m."""
    elevation = MeanCells(RingGrid(cells, CELL_M), H, -H)
    return elevation, ObstacleMap(elevation, window, H, -H)


def add(elevation: MeanCells, obstacles: ObstacleMap, *points: tuple[float, float, float]) -> None:
    """Returns seen from a lens at the origin, 1.08 m high."""
    array = np.array(points, dtype=np.float64)
    lenses = np.tile([0.0, 0.0, 1.08], (len(array), 1))
    obstacles.decide(elevation.add(array, lenses))


def state(obstacles: ObstacleMap, x: float, y: float) -> int:
    """What the cell at a place means; the place must be in the window."""
    i, j = obstacles.grid.cell_of(x, y)
    size = obstacles.grid.size
    assert 0 <= i - obstacles.grid.corner_i < size
    assert 0 <= j - obstacles.grid.corner_j < size
    return int(obstacles.cells[j % size, i % size])


def floor_around(x: float, y: float) -> list[tuple[float, float, float]]:
    """A floor return in each of the eight cells around a place."""
    steps = (-CELL_M, 0.0, CELL_M)
    return [(x + dx, y + dy, 0.0) for dx in steps for dy in steps if (dx, dy) != (0.0, 0.0)]


COORDINATE = st.floats(-4.5, 4.5)
POINTS = st.lists(st.tuples(COORDINATE, COORDINATE, st.floats(-0.09, 1.5)), min_size=1, max_size=40)


@given(scans=st.lists(POINTS, min_size=1, max_size=6))
def test_mean_count_and_contradictions_equal_a_dict_model(
    scans: list[list[tuple[float, float, float]]],
) -> None:
    elevation, obstacles = maps()
    heights: dict[tuple[int, int], list[float]] = defaultdict(list)
    contradicted: dict[tuple[int, int], int] = defaultdict(int)
    for scan in scans:
        add(elevation, obstacles, *scan)
        for x, y, z in scan:
            heights[math.floor(x / CELL_M), math.floor(y / CELL_M)].append(z)
        for cell in {
            (math.floor(x / CELL_M), math.floor(y / CELL_M)) for x, y, z in scan if z >= H
        }:
            contradicted[cell] += 1
    for (i, j), seen in heights.items():
        if not (-20 <= i <= 20 and -20 <= j <= 20):
            continue
        at = (j % 41, i % 41)
        assert elevation.count[at] == len(seen)
        assert math.isclose(elevation.mean_m[at], float(np.mean(seen)), abs_tol=1e-9)
        assert elevation.beyond[at] == contradicted[i, j]
    assert int(elevation.count.sum()) == sum(
        len(seen) for (i, j), seen in heights.items() if -20 <= i <= 20 and -20 <= j <= 20
    )


@given(z=st.floats(-0.5, 0.5))
def test_definition_1_with_a_cell_at_a_bound_an_obstacle(z: float) -> None:
    elevation, obstacles = maps()
    add(elevation, obstacles, (2.1, 0.1, z), *floor_around(2.1, 0.1))
    assert state(obstacles, 2.1, 0.1) == (FREE if -H < z < H else OBSTACLE)
    assert state(obstacles, 2.1, 0.7) == UNKNOWN


def test_a_cell_at_the_very_bound_is_an_obstacle() -> None:
    elevation, obstacles = maps()
    add(elevation, obstacles, (2.1, 0.1, H), (2.1, 0.5, -H))
    assert state(obstacles, 2.1, 0.1) == state(obstacles, 2.1, 0.5) == OBSTACLE


def test_the_edge_of_a_box_is_not_averaged_away_by_the_floor_in_its_cell() -> None:
    elevation, obstacles = maps()
    for _ in range(2):
        add(elevation, obstacles, *[(2.1, 0.1, 0.0)] * 500, (2.15, 0.1, 0.15))
    assert abs(elevation.mean_m[0, 10]) < 0.01
    assert state(obstacles, 2.1, 0.1) == OBSTACLE


def test_a_single_stray_return_holds_a_cell_unknown_until_the_laser_has_looked_again() -> None:
    elevation, obstacles = maps()
    add(elevation, obstacles, (2.1, 0.1, 0.0), (2.1, 0.1, 0.12), *floor_around(2.1, 0.1))
    assert state(obstacles, 2.1, 0.1) == UNKNOWN
    for _ in range(LOOKED_AGAIN):
        add(elevation, obstacles, (2.1, 0.1, 0.0))
    assert state(obstacles, 2.1, 0.1) == FREE


def test_where_a_beam_passed_below_the_ground_is_a_hole_not_floor() -> None:
    """A ditch from x = 2.03 to 3.53 m: beams that clear its near edge end on its far wall."""
    elevation, obstacles = maps()
    slope = 1.08 / 2.035  # the steepest beam that passes the near edge
    for _ in range(NEW_LOOKS):
        add(elevation, obstacles, *[(1.9 + 0.01 * k, 0.1, 0.0) for k in range(13)])
    assert state(obstacles, 2.01, 0.1) == FREE
    for _ in range(2):
        add(elevation, obstacles, (3.53, 0.1, 1.08 - slope * 3.53))
    for x in (2.05, 2.3, 2.9, 3.3, 3.53):
        assert state(obstacles, x, 0.1) == OBSTACLE
    assert state(obstacles, 1.9, 0.1) == FREE


def test_a_return_just_below_the_ground_digs_no_hole() -> None:
    elevation, obstacles = maps()
    add(elevation, obstacles, *[(2.1, 0.1, -0.09)] * 3, *floor_around(2.1, 0.1))
    assert int(elevation.beyond.sum()) == 0
    assert state(obstacles, 2.1, 0.1) == FREE


def test_changes_are_told_once_and_only_when_the_meaning_changed() -> None:
    elevation, obstacles = maps()
    add(elevation, obstacles, (2.1, 0.1, 0.0), *floor_around(2.1, 0.1), (2.1, 1.1, 0.3))
    assert len(obstacles.take_changed()) == 3  # with the cell in front, which is free as well
    add(elevation, obstacles, (2.1, 0.1, 0.01), (2.1, 1.1, 0.3))
    assert len(obstacles.take_changed()) == 0
    add(elevation, obstacles, *[(2.1, 0.1, 0.5)] * 3)
    [at] = obstacles.take_changed()
    assert obstacles.cells.ravel()[at] == OBSTACLE


def test_a_cell_that_is_hit_again_and_again_is_free_though_nothing_lies_behind_it() -> None:
    """A robot that stands still: the laser draws one line across the floor."""
    elevation, obstacles = maps()
    for k in range(NEW_LOOKS):
        assert state(obstacles, 2.1, 0.1) == UNKNOWN, k
        add(elevation, obstacles, (2.1, 0.1, 0.0))
    assert state(obstacles, 2.1, 0.1) == FREE


def test_the_foot_of_a_wall_is_not_free_while_its_height_is_not_seen_yet() -> None:
    """A wall at x = 2.07 m: as the robot comes near, beams climb it by 3 mm a scan."""
    elevation, obstacles = maps()
    for k in range(60):
        wall = (2.07, 0.1, 0.003 * k)
        add(elevation, obstacles, wall, *[(2.03, 0.1 + dy, 0.0) for dy in (-0.2, 0.0, 0.2)])
        assert state(obstacles, 2.1, 0.1) != FREE, k
    assert state(obstacles, 2.1, 0.1) == OBSTACLE


def test_a_wall_alongside_is_not_free_where_the_scan_climbs_it_within_one_cell() -> None:
    elevation, obstacles = maps()
    climb = [(2.05 + 0.02 * k, 0.1, 0.003 * (6 - k)) for k in range(7)]
    for _ in range(2 * NEW_LOOKS):
        add(elevation, obstacles, *climb)
    assert state(obstacles, 2.1, 0.1) == UNKNOWN


@given(
    steps=st.lists(st.tuples(st.floats(-2, 2), st.floats(-2, 2)), min_size=1, max_size=12),
    window=st.integers(5, 41),
)
def test_a_smaller_window_always_shows_what_the_elevation_map_knows(
    steps: list[tuple[float, float]], window: int
) -> None:
    elevation, obstacles = maps(41, window)
    x = y = 0.0
    for k, (dx, dy) in enumerate(steps):
        x, y = x + dx, y + dy
        elevation.grid.follow(x, y)
        obstacles.follow(x, y)
        add(elevation, obstacles, (x + 1.0, y, 0.0), (x, y + 1.5, 0.3), (x - dx, y - dy, -0.02 * k))
    whole = ObstacleMap(elevation, window, H, -H)
    whole.grid.corner_i, whole.grid.corner_j = obstacles.grid.corner_i, obstacles.grid.corner_j
    whole.decide(np.arange(41 * 41, dtype=np.int32))
    np.testing.assert_array_equal(obstacles.cells, whole.cells)


def test_changes_that_nobody_takes_are_each_kept_once() -> None:
    elevation, obstacles = maps(41, 5)
    for k in range(400):
        add(elevation, obstacles, *[(0.1, 0.1, 0.3 * (k % 2))] * 3)
        elevation.grid.erase()
        obstacles.grid.erase()
    assert len(obstacles.take_changed()) == 1


def test_erasing_leaves_nothing_known_and_says_so() -> None:
    elevation, obstacles = maps()
    add(elevation, obstacles, (2.1, 0.1, 0.0))
    epoch = obstacles.epoch
    elevation.grid.erase()
    obstacles.erase()
    assert obstacles.epoch > epoch
    assert not obstacles.cells.any()
    assert len(obstacles.take_changed()) == 0
