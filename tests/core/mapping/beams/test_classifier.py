"""What a cell means: Definition 1, contradictions, holes, and what waits for its neighbours."""

from itertools import product
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.config import Obstacle
from core.grid.window import ObstacleWindow
from core.mapping import causes
from core.mapping.beams.cells import GONE_FLOOR_AGAIN, GONE_JUDGED, GONE_PASSED, CellGrid
from core.mapping.beams.classifier import (
    AROUND,
    ENOUGH,
    LOOKED_AGAIN,
    CellClassifier,
    is_soft,
    lacks_floor,
)
from core.mapping.causes import state_of
from core.mapping.freshness import Freshness
from core.records import FREE, OBSTACLE, UNKNOWN
from tests.support.cases import examples
from tests.support.cell_rig import FOOTPRINT, NEW_LOOKS, CellRig, H, Point, floor_around


def rows(x: float, z: float = 0.0) -> list[Point]:
    """Returns side by side across one cell, as close as beams are."""
    return [(x, 0.025 + 0.05 * k, z) for k in range(4)]


@pytest.mark.parametrize("z", [-0.5, -H - 0.001, 0.001 - H, 0.0, H - 0.001, H + 0.001, 0.5])
def test_a_cell_is_free_only_if_its_height_lies_between_the_bounds(z: float) -> None:
    rig = CellRig()
    rig.add((2.1, 0.1, z), *floor_around(2.1, 0.1))
    assert rig.state(2.1, 0.1) == (FREE if -H < z < H else OBSTACLE)
    assert rig.state(2.1, 0.9) == UNKNOWN


def test_the_edge_of_a_box_is_not_averaged_away_by_the_floor_in_its_cell() -> None:
    rig = CellRig()
    for _ in range(ENOUGH):
        rig.add(*[(2.1, 0.1, 0.0)] * 500, (2.15, 0.1, 0.15))
    assert abs(rig.cell(2.1, 0.1)["mean_m"]) < 0.01
    assert rig.state(2.1, 0.1) == OBSTACLE


def test_the_mouth_of_a_ditch_is_not_averaged_away_by_the_floor_in_its_cell() -> None:
    rig = CellRig()
    for _ in range(ENOUGH):
        rig.add(*[(2.1, 0.1, 0.0)] * 500, (2.15, 0.1, -0.15))
    assert abs(rig.cell(2.1, 0.1)["mean_m"]) < 0.01
    assert rig.state(2.1, 0.1) == OBSTACLE


def test_a_single_stray_return_holds_a_cell_unknown_until_the_laser_has_looked_again() -> None:
    rig = CellRig()
    rig.add((2.1, 0.1, 0.0), (2.1, 0.1, 0.12), *floor_around(2.1, 0.1))
    assert rig.state(2.1, 0.1) == UNKNOWN
    for _ in range(LOOKED_AGAIN):
        rig.add((2.1, 0.1, 0.0))
    assert rig.state(2.1, 0.1) == FREE


def test_where_a_beam_passed_below_the_ground_is_a_hole_not_floor() -> None:
    """A ditch from x = 2.03 to 3.53 m: beams that clear its near edge end on its far wall."""
    rig = CellRig()
    slope = 1.08 / 2.035  # the steepest beam that passes the near edge
    for _ in range(NEW_LOOKS):
        rig.add(*[place for k in range(13) for place in rows(1.9 + 0.01 * k)])
    assert rig.state(2.01, 0.1) == FREE
    for _ in range(ENOUGH):
        rig.add(*rows(3.53, 1.08 - slope * 3.53))
    for x in (2.05, 2.3, 2.9, 3.3, 3.53):
        assert rig.state(x, 0.1) == OBSTACLE, x
    assert rig.state(1.9, 0.1) == FREE


def test_floor_that_gives_no_return_is_a_hole_as_well() -> None:
    """A drop, a black floor, a pane of glass in the floor: nothing comes back."""
    rig = CellRig()
    for _ in range(NEW_LOOKS):
        rig.add(*rows(2.1))
    silent = [(x, y, 0.0) for x in np.arange(2.42, 2.6, 0.04) for y in (0.03, 0.1, 0.17)]
    for _ in range(ENOUGH):
        rig.add_silent(*silent)
    assert rig.state(2.5, 0.1) == OBSTACLE
    assert rig.state(2.1, 0.1) == FREE
    assert rig.state(2.9, 0.1) == UNKNOWN


def test_floor_hidden_behind_something_is_unknown_and_no_hole() -> None:
    rig = CellRig()
    for _ in range(30):
        rig.add(*rows(2.1, 0.4))  # those beams would have met the floor at 3.34 m
    assert rig.state(2.1, 0.1) == OBSTACLE
    for x in (2.3, 2.9, 3.3, 3.5):
        assert rig.state(x, 0.1) == UNKNOWN, x


def test_a_return_just_below_the_ground_digs_no_hole() -> None:
    rig = CellRig()
    rig.add(*[(2.1, 0.1, -0.09)] * 3, *floor_around(2.1, 0.1))
    cells = rig.cells.cells
    assert int(cells["above"].sum() + cells["below"].sum()) == 0
    assert rig.state(2.1, 0.1) == FREE


def test_changes_are_told_once_and_only_when_the_meaning_changed() -> None:
    rig = CellRig()
    rig.add((2.1, 0.1, 0.0), *floor_around(2.1, 0.1), (2.1, 1.1, 0.3))
    told = set(rig.window.take_changed().tolist())
    known = np.flatnonzero(rig.window.cells.ravel() != UNKNOWN)
    assert told == set(known.tolist())
    assert len(told) == 3  # with the cell in front, which is free as well
    rig.add((2.1, 0.1, 0.01), (2.1, 1.1, 0.3))
    assert len(rig.window.take_changed()) == 0
    rig.add(*[(2.1, 0.1, 0.5)] * 3)
    [at] = rig.window.take_changed()
    assert rig.window.cells.ravel()[at] == OBSTACLE


def test_a_cell_that_is_hit_for_a_second_is_free_though_nothing_lies_behind_it() -> None:
    """A robot that stands still: the laser draws one line across the floor."""
    rig = CellRig()
    for k in range(NEW_LOOKS):
        assert rig.state(2.1, 0.1) == UNKNOWN, k
        rig.add((2.1, 0.1, 0.0))
    assert rig.state(2.1, 0.1) == FREE


def test_the_foot_of_a_wall_is_not_free_while_its_height_is_not_seen_yet() -> None:
    """A wall at x = 2.07 m: as the robot comes near, beams climb it by 3 mm a scan."""
    rig = CellRig()
    for k in range(60):
        wall = (2.07, 0.1, 0.003 * k)
        rig.add(wall, *[(2.03, 0.1 + dy, 0.0) for dy in (-0.2, 0.0, 0.2)])
        assert rig.state(2.1, 0.1) != FREE, k
    assert rig.state(2.1, 0.1) == OBSTACLE


def test_a_wall_alongside_is_not_free_where_the_scan_climbs_it_within_one_cell() -> None:
    rig = CellRig()
    climb = [(2.05 + 0.02 * k, 0.1, 0.003 * (6 - k)) for k in range(7)]
    for _ in range(2 * NEW_LOOKS):
        rig.add(*climb)
    assert rig.state(2.1, 0.1) == UNKNOWN


def test_changes_that_nobody_takes_are_each_kept_once() -> None:
    rig = CellRig(41, 5)
    for k in range(40):
        rig.add(*[(0.1, 0.1, 0.3 * (k % 2))] * 3)
        rig.cells.grid.erase()
        rig.window.grid.erase()
    assert len(rig.window.take_changed()) == 1


# The decision itself: an obvious model, and cells at, below and above all that decides

LEAST_PARTS = {1: (1, 1, 1), 2: (2, 3, 4), 3: (3, 5, 6), 4: (4, 6, 8)}  # surely, thrice, twice
NEW = {0.02: 50, 0.1: 10, 0.3: 4}  # scans in a second or more
H_POS, H_NEG, SOFT_M, SIZE, OLDEST_S = 0.10, -0.15, 0.4, 9, 4.0
SOFT = ((0, 0, 0), (6, 6, 3), (5, 5, 3), (6, 7, 4), (6, 6, 2))  # soft, hard, doubles
VALUES: dict[str, tuple[Any, ...]] = {  # the first of each: floor
    "count": (5, 0, 1),
    "looks": (60, -1, 0, 1, LOOKED_AGAIN - 1, LOOKED_AGAIN, *NEW.values(), 3, 9, 49),
    "mean_m": (0.0, H_POS, H_NEG, H_POS - 0.01, H_NEG + 0.01),
    "floor_m": (0.0, H_POS),
    "top_m": (SOFT_M, SOFT_M + 0.1, 0.0),
    "above": (0, 1, 2),
    "below": (0, 1, 2),
    "miss": (0, 1, 2, 3),
    "miss_sure": (0, 1, 2),
    "miss_bits": (0, 1, 0xF, 0xFF),
    "floor_bits": (0, 1, 0xFF00),
    "rising": (0, 1),
    "far_sides": (0, *(1 << k for k in range(8)), 0b10010),
    "gone": (0, GONE_PASSED, GONE_FLOOR_AGAIN, GONE_JUDGED),
}
BEFORE = {OBSTACLE: 133, UNKNOWN: 10, FREE: 69}  # causes of what was decided before


def scatters(cell: Any) -> bool:
    rising = cell["soft"] + cell["hard"]
    return bool(cell["soft"] >= 6 and 2 * cell["soft"] >= rising and 4 * cell["doubles"] >= rising)


def drops(cell: Any, sub: int) -> bool:
    parts = (int(cell["miss_bits"]) & ~int(cell["floor_bits"])).bit_count()
    surely, thrice, twice = LEAST_PARTS[sub]
    if cell["miss"] < 2:
        return False
    return (
        parts >= twice
        or (parts >= thrice and cell["miss"] >= 3)
        or (parts >= surely and bool(cell["miss_sure"] >= 2))
    )


def seen(cell: Any) -> bool:
    return bool((cell["count"] > 0 and cell["looks"] >= 0) or cell["miss"] > 0)


class Drawn:
    """A window of cells as chance has it, and what each of them means."""

    def __init__(self, seed: int, size: int, offset: tuple[int, int]) -> None:
        self.chance = chance = np.random.default_rng(seed)
        self.sub, self.soft_m = int(chance.integers(1, 5)), float(chance.choice([0.0, SOFT_M]))
        period_s = float(chance.choice(list(NEW)))
        self.new = NEW[period_s]
        self.source = source = CellGrid(SIZE, 0.05 * self.sub)
        self.window = ObstacleWindow(size, 0.05 * self.sub)
        grid, self.shown = source.grid, self.window.grid
        grid.corner_i, grid.corner_j = chance.integers(-20, 20, 2).tolist()
        self.shown.corner_i = grid.corner_i + offset[0]
        self.shown.corner_j = grid.corner_j + offset[1]
        self.fresh = Freshness(grid, 1.0, FOOTPRINT)
        self.fresh.now_s = OLDEST_S + 1.0
        obstacle = Obstacle(H_POS, H_NEG, size, self.soft_m, 1.0)
        self.classifier = CellClassifier(source, self.window, self.fresh, obstacle, period_s)
        self.draw()

    def some(self, values: tuple[Any, ...], usual: int = 0) -> Any:
        """For each cell one of the values: most often the same one, and that mostly the usual."""
        if self.chance.random() < 0.15:
            usual = int(self.chance.integers(len(values)))
        which = self.chance.integers(len(values), size=(SIZE, SIZE))
        which[self.chance.random((SIZE, SIZE)) < self.chance.choice([0.4, 0.9])] = usual
        return np.array(values)[which]

    def draw(self) -> None:
        """All cells anew."""
        for name, values in VALUES.items():
            self.source.cells[name] = self.some(values)
        kinds = self.some(SOFT, int(self.chance.integers(2)))
        for k, name in enumerate(("soft", "hard", "doubles")):
            self.source.cells[name] = kinds[..., k]
        self.fresh.seen_s[:] = self.some((OLDEST_S, OLDEST_S - 0.1, OLDEST_S + 0.1)).ravel()

    def covers(self, grid: Any, i: int, j: int) -> bool:
        return bool(0 <= i - grid.corner_i < grid.size and 0 <= j - grid.corner_j < grid.size)

    def state(self, i: int, j: int) -> int:
        """What a cell means."""
        return state_of(self.cause(i, j))

    def cause(self, i: int, j: int) -> int:
        """Why it means that."""
        cell = self.source.cells[j % SIZE, i % SIZE]
        around = [(i + di, j + dj) for di, dj in AROUND]
        beside = [self.source.cells[v % SIZE, u % SIZE] for u, v in around]
        count, looks, above, below = (cell[n] for n in ("count", "looks", "above", "below"))
        if count == 0 and cell["miss"] == 0:
            return causes.GONE if cell["gone"] else causes.UNSEEN
        free = (causes.FLOOR, causes.PASSED, causes.FLOOR_AGAIN, causes.JUDGED_AGAIN)[cell["gone"]]
        height_m = cell["mean_m"]
        if (
            0.0 < self.soft_m >= cell["top_m"]
            and above > 0
            and all(scatters(one) for one in (cell, *beside) if one["above"] > 0)
        ):
            above, height_m, free = 0, cell["floor_m"], causes.SOFT
        if above >= 2 or below >= 2:
            return causes.STANDS if above >= 2 else causes.LOW
        if drops(cell, self.sub):
            return causes.NO_FLOOR
        if count > 0 and (height_m >= H_POS or height_m <= H_NEG):
            return causes.TOO_HIGH if height_m >= H_POS else causes.TOO_LOW
        if (above == 1 or below == 1 or cell["miss"] == 1) and looks < LOOKED_AGAIN:
            return causes.CONTRADICTED
        if count == 0 or looks < 0:
            return causes.UNSHOWN if count == 0 else causes.EARLIER_RUN
        asked = set(range(8)) if cell["rising"] else set()
        if looks < self.new:
            far = [k for k in range(8) if int(cell["far_sides"]) >> k & 1]
            asked |= {(k + turn) % 8 for k in far for turn in (-1, 0, 1)}
        if not all(self.covers(self.source.grid, *around[k]) and seen(beside[k]) for k in asked):
            return causes.FOOT if cell["rising"] else causes.EDGE
        is_old = self.fresh.seen_s[j % SIZE * SIZE + i % SIZE] < OLDEST_S
        return causes.AGED if is_old else free

    def told(self) -> dict[tuple[int, int], int]:
        """What the window shows."""
        grid, size = self.shown, self.shown.size
        return {
            (i, j): int(self.window.cells[j % size, i % size])
            for i in range(grid.corner_i, grid.corner_i + size)
            for j in range(grid.corner_j, grid.corner_j + size)
        }


@settings(max_examples=examples(150))
@given(st.integers(0, 2**32 - 1), st.sampled_from([(SIZE, 0, 0), (5, 1, 3), (5, 3, 0), (5, -2, 7)]))
def test_a_touched_cell_means_what_the_model_says_and_the_others_stay(
    seed: int, window: tuple[int, int, int]
) -> None:
    drawn = Drawn(seed, window[0], window[1:])
    before = drawn.told()
    grid = drawn.source.grid
    touched = drawn.chance.permutation(SIZE * SIZE).astype(np.int32)[:70]
    drawn.classifier.decide(touched)
    for (i, j), state in drawn.told().items():
        at = j % SIZE * SIZE + i % SIZE
        decided = drawn.covers(grid, i, j) and at in touched
        assert state == (drawn.state(i, j) if decided else before[i, j])
    assert sorted(drawn.window.take_changed()) == np.flatnonzero(drawn.window.cells).tolist()


@settings(max_examples=examples(150))
@given(st.integers(0, 2**32 - 1), st.sampled_from([(SIZE, 0, 0), (5, 1, 3), (5, 3, 0), (5, -2, 7)]))
def test_who_asks_why_is_told_the_rule_of_just_the_state_that_is_shown(
    seed: int, window: tuple[int, int, int]
) -> None:
    drawn = Drawn(seed, window[0], window[1:])
    drawn.classifier.decide(drawn.chance.permutation(SIZE * SIZE).astype(np.int32)[:70])
    shown, shows = drawn.told(), drawn.shown
    asked = list(product(range(-1, SIZE + 2), repeat=2))
    i, j = np.array(asked).T + np.array([[shows.corner_i], [shows.corner_j]])
    for cell, cause in zip(zip(i, j, strict=True), drawn.classifier.causes(i, j), strict=True):
        if cell not in shown:
            assert cause == causes.OUTSIDE
            continue
        is_known = drawn.covers(drawn.source.grid, *cell)
        rule = drawn.cause(*cell) if is_known else causes.UNSEEN
        assert cause == (rule if state_of(rule) == shown[cell] else BEFORE[shown[cell]])
        assert state_of(int(cause)) == shown[cell]


@settings(max_examples=examples(40))
@given(st.integers(0, 2**32 - 1), st.sampled_from(AROUND), st.sampled_from([2, 3, 4, 6]))
def test_what_comes_into_a_smaller_window_is_decided_and_what_stays_in_it_is_not(
    seed: int, way: tuple[int, int], far: int
) -> None:
    drawn = Drawn(seed, 5, (2, 2))
    drawn.classifier.decide(np.arange(SIZE * SIZE, dtype=np.int32))
    before, grid = drawn.told(), drawn.source.grid
    drawn.draw()
    x_m = (grid.corner_i + 4.5 + far * way[0]) * grid.cell_m
    y_m = (grid.corner_j + 4.5 + far * way[1]) * grid.cell_m
    grid.follow(x_m, y_m)
    drawn.classifier.follow(x_m, y_m)
    told = drawn.told()
    assert (set(told) == set(before)) == (far <= 2)
    for (i, j), state in told.items():
        assert state == (before[i, j] if (i, j) in before else drawn.state(i, j))


@pytest.mark.parametrize("far", range(8))
def test_a_new_cell_waits_for_the_side_where_a_beam_went_on_and_for_those_next_to_it(
    far: int,
) -> None:
    rig = CellRig(3, 3)
    rig.cells.cells["count"] = rig.cells.cells["looks"] = 1
    rig.cells.cells["far_sides"] = 1 << far
    rig.fresh.seen_s[:], rig.fresh.now_s = 0.0, 0.0
    for turn in range(8):
        di, dj = AROUND[(far + turn) % 8]
        rig.cells.cells["count"][dj % 3, di % 3] = 0
        rig.classifier.decide(np.array([0], dtype=np.int32))
        assert rig.state(0.1, 0.1) == (UNKNOWN if turn in (0, 1, 7) else FREE)
        rig.cells.cells["count"] = 1


def test_soft_is_what_scatters_often_enough_and_echoes_twice_often_enough() -> None:
    cells = CellGrid(1, 0.2)
    for soft, hard, doubles in product(range(4, 9), range(10), range(6)):
        for name, value in (("soft", soft), ("hard", hard), ("doubles", doubles)):
            cells.cells[name] = value
        assert is_soft(cells.flat, 0) == scatters(cells.cells[0, 0])


@pytest.mark.parametrize("sub", LEAST_PARTS)
def test_a_drop_is_floor_that_is_missed_often_enough_in_enough_parts(sub: int) -> None:
    cells = CellGrid(1, 0.05 * sub)
    for miss, sure, parts, floor in product(range(5), range(4), range(sub * sub + 1), (0, 1, 4)):
        cells.cells["miss"], cells.cells["miss_sure"] = miss, min(miss, sure)
        cells.cells["miss_bits"], cells.cells["floor_bits"] = (1 << parts) - 1, floor
        assert lacks_floor(cells.flat, 0, sub) == drops(cells.cells[0, 0], sub)
