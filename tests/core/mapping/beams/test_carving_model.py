"""Clearing against slow models: cells in every state, beams at, just before and just after limits.

Lengths are mostly sums of powers of two, so that many fall exactly on an edge or a limit.
"""

import math
import random
from typing import Any

import numpy as np

from core.grid.places import flat_index, part_bit
from core.mapping.along import GOLDEN, REACH_M, STEP_M
from core.mapping.beams.carving import (
    BEFORE_M,
    CLEAR_M,
    FINER,
    FLOOR_FOR_LONG,
    JUST_M,
    LEAST_HALF_M,
    LOW_M,
    MARGIN_M,
    MARGIN_SHARE,
    MARGIN_SLOPE,
    THROUGH,
    FreeSpaceCarver,
    see_floor_again,
)
from core.mapping.beams.cells import GONE_FLOOR_AGAIN, GONE_PASSED, CellGrid, forget
from core.mapping.beams.ground_plane import LEVEL, Ground, ground_m
from core.mapping.freshness import Freshness
from core.mapping.rays import MIN_RANGE_M, Sweep

SIZE, CELL_M = 8, 0.25
ALL = (1 << 16) - 1  # parts of a cell
SPANS = [(0.0, 0.0), (-0.25, 0.25), (0.25, 0.5), (0.0, 0.0625), (-2.0, 2.0), (0.5, 0.5)]
T_S, OLDEST_S = 10.0, 8.0


def around(limit: float) -> list[float]:
    """A limit and its neighbours among the numbers."""
    return [math.nextafter(limit, -math.inf), limit, math.nextafter(limit, math.inf)]


def scatter(draw: random.Random, grid: CellGrid) -> None:
    """Cells in all the states that clearing asks for."""
    scan = grid.scan
    states: dict[str, list[float]] = {
        "above": [0, 1, 1, 2],
        "below": [0, 0, 1, 2],
        "miss": [0, 0, 1, 2],
        "miss_sure": [0, 1],
        "miss_bits": [0, 1, 2, 3, ALL],
        "floor_bits": [0, 1, 2, 3, ALL],
        "high_bits": [0, 1, 2, 3, ALL, ALL, ALL, 0x0F0F, 0x5555],
        "floor_run": [0, FLOOR_FOR_LONG - 1, FLOOR_FOR_LONG, FLOOR_FOR_LONG + 1],
        "count": [5, 6],
        "floor_count": [2, 3],
        "mean_m": [0.5, 0.25],
        "floor_m": [0.0, 0.125],
        "above_scan": [scan - 2, scan - 1, scan - 1, scan],
        "hit_scan": [scan - 2, scan - 1, scan],
        "through": [0, THROUGH - 2, THROUGH - 1, THROUGH],
        "through_scan": [scan - 1, scan - 1, scan],
        "stamp": [scan - 1, scan],
        "soft": [0, 4],
    }
    for name, values in states.items():
        grid.flat[name] = draw.choices(values, k=SIZE * SIZE)
    for low, high in (("low_m", "top_m"), ("span_low_m", "span_high_m")):
        grid.flat[low], grid.flat[high] = np.array(draw.choices(SPANS, k=SIZE * SIZE)).T


# Floor again


def test_floor_again_ends_a_lack_and_in_the_long_run_what_is_low_in_parts_that_show_floor() -> None:
    draw, grid = random.Random(1), CellGrid(SIZE, CELL_M)
    forgotten = 0
    for _ in range(8):
        scatter(draw, grid)
        grid.flat["top_m"] = draw.choices(around(LOW_M), k=SIZE * SIZE)
        model = grid.flat.copy()
        for at, cell in enumerate(model):
            if cell["below"] + cell["miss"] > 0 and not cell["miss_bits"] & ~cell["floor_bits"]:
                cell["below"] = cell["miss"] = cell["miss_sure"] = cell["miss_bits"] = 0
                cell["gone"] = GONE_FLOOR_AGAIN
                if cell["above"] == 0:
                    cell["mean_m"], cell["count"] = cell["floor_m"], cell["floor_count"]
            low = cell["above"] > 0 and cell["top_m"] <= LOW_M
            shows = not cell["high_bits"] & ~cell["floor_bits"]
            if cell["floor_run"] >= FLOOR_FOR_LONG and low and shows:
                forget(model, at, GONE_FLOOR_AGAIN)
                forgotten += 1
            see_floor_again(grid.flat, at)
        np.testing.assert_array_equal(grid.flat, model)
    assert forgotten > 10


# Beams through what stands


def ranges_of(beam: int, scan: int, end: float) -> list[float]:
    """At which ranges a beam of a scan is looked at."""
    first = MIN_RANGE_M + (beam * GOLDEN + scan * GOLDEN * GOLDEN) % 1.0 * STEP_M
    return [first + k * STEP_M for k in range(math.ceil((end - first) / STEP_M))]


def some_sweep(draw: random.Random, scan: int, is_level: bool) -> Sweep:
    """Beams towards places in the window, from within and from afar."""
    beams, origins, rays, ranges = draw.randrange(1, 6), [], [], []
    for beam in range(beams):
        turn, far = draw.random() * math.tau, draw.choice([draw.random(), 2.0, 4.0, REACH_M])
        dx, dy, dz = math.cos(turn), math.sin(turn), draw.choice([0.0, 0.0, 0.125, -0.125])
        x, y = 0.25 + 2.0 * draw.random(), -2.75 + 2.0 * draw.random()
        low, high = draw.choice(SPANS)
        margin = MARGIN_M + MARGIN_SLOPE * far
        edges = [high - 2 * margin * draw.random(), low + 2 * margin * draw.random(), high - margin]
        limits = [*around(low - JUST_M), *around(high), *around(low + LEAST_HALF_M)]
        height = draw.choice([*edges, *edges, *limits, 0.5 * (low + high), 0.7 * high + 0.3 * low])
        dz = 0.0 if is_level else dz
        looks = ranges_of(beam, scan, far + 1.0)
        finer = draw.choice(looks) + draw.choice([-0.08, -0.04, 0.0, 0.04, 0.08])
        ends = [finer, draw.choice(looks), finer + CLEAR_M, far + 2 * draw.random(), 30.0]
        origins.append((x - far * dx, y - far * dy, height - far * dz))
        rays.append((dx, dy, dz))
        nothing = [math.nan, 0.0, math.nextafter(MIN_RANGE_M, 0.0)]
        more = [*nothing, MIN_RANGE_M, 40.0, far + 1.5]
        back = draw.choice([*around(draw.choice(ends) + BEFORE_M), *more[:2]])
        ranges.append(draw.sample([back, draw.choice(more)], k=2))
    return Sweep(T_S, np.array(origins), np.array(rays), np.array(ranges).T.copy())


def passes(cell: Any, bit: int, h: float, r: float, just: bool, scan: int) -> bool:
    """Whether a beam speaks against what stood in a part of a cell."""
    if not cell["above"] or not cell["high_bits"] & bit or cell["above_scan"] == scan:
        return False
    is_there = cell["span_low_m"] - JUST_M <= h <= cell["span_high_m"]
    if just and is_there and cell["hit_scan"] == cell["above_scan"]:
        return True
    tall = cell["top_m"] - cell["low_m"]
    half = 0.5 * tall - min(MARGIN_M + MARGIN_SLOPE * r, MARGIN_SHARE * tall)
    return bool(abs(h - 0.5 * (cell["low_m"] + cell["top_m"])) <= max(half, LEAST_HALF_M))


class SlowCarver:
    """What the carver does, cell by cell; of its own grid."""

    def __init__(self, grid: CellGrid, fresh: Freshness) -> None:
        self.grid, self.cells, self.seen_s = grid, grid.flat, fresh.seen_s
        self.cleared = 0
        self.stands = {at for at in range(SIZE * SIZE) if grid.flat["above"][at]}

    def at(self, x: float, y: float) -> int:
        return flat_index(x, y, CELL_M, self.grid.window[:2], SIZE)

    def add(self, sweep: Sweep, ground: Ground, clears: bool, stood: bool, hit: list[int]) -> None:
        """A sweep, whose returns have touched some cells before."""
        for at in hit:
            self.stands -= {at}
            if self.cells["above"][at]:
                self.stands.add(at)
            if self.cells["hit_scan"][at] == self.grid.scan:
                self.seen_s[at] = T_S
        for i, (o, ray) in enumerate(zip(sweep.origins, sweep.rays, strict=True)):
            returns = [r for r in sweep.ranges_m[:, i] if r >= MIN_RANGE_M]
            end = min(min(returns) - BEFORE_M, REACH_M) if returns else 0.0
            for r in ranges_of(i, self.grid.scan, end):
                at = self.at(o[0] + r * ray[0], o[1] + r * ray[1])
                if at >= 0 and ray[2] < 0.0 and self.seen_s[at] >= OLDEST_S:
                    self.seen_s[at] = T_S
                if at in self.stands and clears and self.goes(o, ray, r, end, at, ground, stood):
                    self.count(at)

    def goes(
        self, o: Any, ray: Any, r: float, end: float, at: int, ground: Ground, stood: bool
    ) -> bool:
        """Whether a beam passes, at one of five places about a range, through what stands there."""
        cell, scan = self.cells[at], self.grid.scan
        if cell["through_scan"] == scan:
            return False
        for near in [r + (k - FINER // 2) * STEP_M / FINER for k in range(FINER)]:
            x, y = o[0] + near * ray[0], o[1] + near * ray[1]
            if near < end and self.at(x, y) == at:
                h, just = o[2] + near * ray[2] - ground_m(ground, x, y), near < end - CLEAR_M
                bit = part_bit(x, y, CELL_M, self.grid.sub)
                if passes(cell, bit, h, near, stood and just, scan):
                    return True
        return False

    def count(self, at: int) -> None:
        """One scan more in which a beam went through."""
        cell, grid = self.cells[at], self.grid
        cell["through_scan"], cell["through"] = grid.scan, cell["through"] + 1
        if cell["through"] >= THROUGH:
            forget(self.cells, at, GONE_PASSED)
            self.stands.remove(at)
            self.cleared += 1
        if cell["stamp"] != grid.scan:
            cell["stamp"] = grid.scan
            grid.touched[grid.used] = at
            grid.used += 1


def grids(scan: int) -> tuple[CellGrid, Freshness]:
    """An empty window from (0.25, -2.75) to (2.25, -0.75)."""
    grid = CellGrid(SIZE, CELL_M)
    grid.scan = scan
    fresh = Freshness(grid.grid, T_S - OLDEST_S, (0.1, 0.1, 0.1))
    grid.grid.follow(1.3, -1.7)
    fresh.follow(T_S, 99.0, 99.0, (1.0, 0.0))
    return grid, fresh


def test_what_beams_clear_keep_fresh_and_count_equals_a_slow_model() -> None:
    draw, cleared = random.Random(2), 0
    for _ in range(250):
        scan = draw.randrange(10, 1000)
        (grid, fresh), (slow_grid, slow_fresh) = grids(scan), grids(scan)
        scatter(draw, grid)
        slow_grid.flat[:] = grid.flat
        carver, slow = FreeSpaceCarver(grid, fresh), SlowCarver(slow_grid, slow_fresh)
        is_level = draw.random() < 0.5
        sweep = some_sweep(draw, scan, is_level)
        for _ in range(2):
            planes = [draw.randrange(-8, 9) / 64 for _ in range(6)]
            ground = LEVEL if is_level else Ground._make([*planes, 1.0, 0.5, 0.5, 0.0])
            clears, stood = draw.random() < 0.9, draw.random() < 0.5
            hit = draw.sample(range(SIZE * SIZE), k=draw.choice([0, 12]))
            for some in grid, slow_grid:
                some.used, some.touched[: len(hit)] = len(hit), hit
            fresh.seen_s[:] = draw.choices([*around(OLDEST_S), 9.0, 0.0], k=SIZE * SIZE)
            slow_fresh.seen_s[:] = fresh.seen_s
            options = ({} if clears else {"clears": False}) | ({"stood": True} if stood else {})
            carver.add(sweep, ground, **options)
            slow.add(sweep, ground, clears, stood, hit)
            np.testing.assert_array_equal(grid.flat, slow_grid.flat)
            np.testing.assert_array_equal(fresh.seen_s, slow_fresh.seen_s)
            assert grid.used == slow_grid.used
            assert list(grid.touched[: grid.used]) == list(slow_grid.touched[: grid.used])
            assert carver.cleared == slow.cleared
            scatter(draw, grid)  # also where no return touched anything
            slow_grid.flat[:] = grid.flat
        cleared += carver.cleared
    assert cleared > 50


def goes_through(h: float, rises: float, nearest: float, scan: int, **cells: Any) -> bool:
    """Whether the last beam that it took, along x, clears cells which are all the same."""
    grid, fresh = grids(scan)
    state = {"above": 1, "high_bits": ALL, "through": THROUGH - 1, "low_m": 99.0, "top_m": 99.0}
    for name, value in (state | {"span_low_m": 99.0, "span_high_m": 99.0} | cells).items():
        grid.flat[name] = value
    start = 0.3 - ranges_of(0, scan, 1.0)[0]  # it is first looked at near the edge of a cell
    origin, ray = np.array([[start, -1.9, h]]), np.array([[1.0, 0.0, rises]])
    carver = FreeSpaceCarver(grid, fresh)
    carver.add(Sweep(T_S, origin, ray, np.array([[nearest]])), LEVEL, stood=True)
    return carver.cleared > 0


def test_just_where_it_was_seen_last_reaches_a_little_below_and_not_above() -> None:
    last = {"span_low_m": 0.0, "span_high_m": 0.25}
    for h, goes in zip(around(-JUST_M), [False, True, True], strict=True):
        assert goes_through(h, 0.0, 5.0, 7, **last) is goes
    for h, goes in zip(around(0.25), [True, True, False], strict=True):
        assert goes_through(h, 0.0, 5.0, 7, **last) is goes


def test_a_place_proves_something_before_the_end_and_far_before_it_where_it_was_seen_last() -> None:
    """Beams rise so steeply that one place alone is as high as what stood there."""
    tried = 0
    for scan in range(10, 60):
        place = ranges_of(0, scan, 1.0)[0] + 2 * STEP_M / FINER
        for behind, low, high in (
            (0.0, "low_m", "top_m"),
            (CLEAR_M, "span_low_m", "span_high_m"),
        ):
            for nearest in around(place + behind + BEFORE_M):
                if nearest - BEFORE_M - behind == place:
                    tried += 1
                    goes = [
                        goes_through(0.0, 1.0, r, scan, **{low: place, high: place})
                        for r in around(nearest)[1:]
                    ]
                    assert goes == [False, True]
    assert tried > 10
