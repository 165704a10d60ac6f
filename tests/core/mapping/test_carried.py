"""What a map still says behind a shift that is not known: never free what was not seen to be."""

import math
from random import Random
from typing import cast

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from core.grid.window import ObstacleWindow
from core.mapping.carried import carried, spread
from core.mapping.freshness import Freshness
from core.mapping.method import Maps
from core.motion.shift import Shift
from core.records import FREE, I8, OBSTACLE, UNKNOWN
from tests.support.cases import examples

SIZE, CELL_M = 12, 0.2
STATES = st.sampled_from([OBSTACLE, FREE, FREE, FREE, UNKNOWN])
CELLS = arrays(np.int8, (SIZE, SIZE), elements=STATES)


class Map:
    """As much of a map as there is to carry."""

    def __init__(self, cells: I8, corner: tuple[int, int]) -> None:
        self.window = ObstacleWindow(SIZE, CELL_M)
        half = SIZE // 2
        self.window.follow((corner[0] + half) * CELL_M + 0.1, (corner[1] + half) * CELL_M + 0.1)
        self.window.cells[...] = cells
        self.fresh = Freshness(self.window.grid, 5.0, (0.0, 0.0, 0.0))
        self.fresh.follow(100.0, 1e6, 0.0, (1.0, 0.0))

    def ages_s(self, i: np.ndarray, j: np.ndarray) -> np.ndarray:
        return np.where((i + j) % 5 == 0, np.nan, 0.1 * ((i * 3 + j) % 7))

    def state(self, cells: I8, i: int, j: int) -> int:
        """Of a world cell."""
        grid = self.window.grid
        inside = 0 <= i - grid.corner_i < SIZE and 0 <= j - grid.corner_j < SIZE
        return int(cells[j % SIZE, i % SIZE]) if inside else UNKNOWN


@settings(max_examples=examples(40))
@given(
    cells=CELLS,
    corner=st.tuples(st.integers(-30, 30), st.integers(-30, 30)),
    yaw_rad=st.floats(-4.0, 4.0),
    half_m=st.floats(0.0, 0.5),
    aside_m=st.floats(0.0, 0.2),
    chance=st.randoms(use_true_random=False),
)
def test_wherever_in_the_strip_the_robot_truly_is_free_was_free_and_obstacles_stay(
    cells: I8, corner: tuple[int, int], yaw_rad: float, half_m: float, aside_m: float,
    chance: Random,
) -> None:  # fmt: skip
    old = Map(cells, corner)
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    shift = Shift((0.0, 0.0), (c, s), half_m, aside_m)
    told, seen_s = carried(cast(Maps, old), shift)
    along_m, side_m = chance.uniform(-half_m, half_m), chance.uniform(-aside_m, aside_m)
    off_m = c * along_m - s * side_m, s * along_m + c * side_m
    low_i, low_j = old.window.grid.corner_i, old.window.grid.corner_j
    for i in range(low_i, low_i + SIZE):
        for j in range(low_j, low_j + SIZE):
            x_m, y_m = ((n + chance.uniform(0.001, 0.999)) * CELL_M for n in (i, j))
            true = math.floor((x_m + off_m[0]) / CELL_M), math.floor((y_m + off_m[1]) / CELL_M)
            was, now = old.state(cells, *true), old.state(told, i, j)
            assert now != FREE or was == FREE
            assert was != OBSTACLE or now == OBSTACLE
            if now == FREE:
                age_s = float(np.nan_to_num(old.ages_s(*np.array(true)), nan=np.inf))
                assert seen_s[j % SIZE, i % SIZE] <= 100.0 - age_s


def test_without_a_shift_a_map_stays_as_it_is() -> None:
    cells = np.random.default_rng(1).integers(-1, 2, (SIZE, SIZE)).astype(np.int8)
    told, seen_s = spread(cells, np.ones((SIZE, SIZE)), np.zeros((1, 2), np.int64))
    np.testing.assert_array_equal(told, cells)
    assert (seen_s == 1.0).all()


def expire(of: Map) -> None:
    """All rows: it goes over some at a time."""
    for _ in range(SIZE):
        of.fresh.expire(of.window)


def test_what_lies_under_shows_where_nothing_is_known_ages_and_leaves_with_its_cell() -> None:
    cells = np.full((SIZE, SIZE), FREE, np.int8)
    cells[3, 3] = OBSTACLE
    of = Map(np.full((SIZE, SIZE), UNKNOWN, np.int8), (0, 0))
    window = of.window
    window.cells[5, 5], window.cells[6, 6] = OBSTACLE, FREE
    of.fresh.seen_s[6 * SIZE + 6] = 103.0
    window.lay_under(cells, np.where(np.arange(SIZE) < 6, 96.0, 98.0) * np.ones((SIZE, 1)))
    assert (window.cells == FREE).sum() == SIZE**2 - 2
    assert {(3, 3), (5, 5)} == {(int(j), int(i)) for j, i in np.argwhere(window.cells == OBSTACLE)}
    assert set(window.take_changed().tolist()) == set(range(SIZE**2)) - {65, 78}
    window.put(np.array([0, 65], np.int32), np.array([OBSTACLE, UNKNOWN], np.int8))
    assert (window.cells[0, 0], window.cells[5, 5]) == (OBSTACLE, FREE)
    window.put(np.array([0], np.int32), np.array([UNKNOWN], np.int8))
    assert window.cells[0, 0] == UNKNOWN  # something stood there since: what was free, was
    kept = window.cells.copy()
    under = window.under.copy()
    of.fresh.follow(101.0, 1e6, 0.0, (1.0, 0.0))  # 96.0 is 5 s ago
    expire(of)
    np.testing.assert_array_equal(window.under, under)
    of.fresh.follow(101.5, 1e6, 0.0, (1.0, 0.0))  # 96.0 is older than 5 s
    expire(of)
    assert (window.cells[:, 6:] == kept[:, 6:]).all()
    assert (window.cells[:, :6] != FREE).all()
    assert (window.under[:, :6] != FREE).all()
    np.testing.assert_array_equal(window.under[:, 6:], under[:, 6:])
    assert window.under[3, 3] == OBSTACLE
    of.fresh.follow(103.5, 1e6, 0.0, (1.0, 0.0))
    expire(of)
    assert [(int(j), int(i)) for j, i in np.argwhere(window.cells == FREE)] == [(6, 6)]
    assert window.cells[3, 3] == OBSTACLE
    window.follow(100.0, 0.0)
    assert not window.under.any()
    assert not window.cells.any()
    window.lay_under(cells, np.zeros((SIZE, SIZE)))
    window.erase()
    assert not window.under.any()
