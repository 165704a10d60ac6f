"""Floor that was due and did not show: each kernel against a slow model, each limit by example.

Lengths are mostly sums of powers of two, so that many fall exactly on an edge or a limit.
"""

import math
import random

import numpy as np
import pytest

from core.grid.places import flat_index, part_bit
from core.mapping.beams.cells import CellGrid, Cells, known
from core.mapping.beams.ground_plane import LEVEL, Ground, ground_m
from core.mapping.beams.negative import (
    BEFORE_M,
    BELOW_M,
    BELOW_SLOPE,
    LEAST_LEVEL,
    LOOKS_BACK,
    LOWER_M,
    MAX_EVIDENCE,
    MAX_HOLE_STEPS,
    NEAR_BACK,
    NODDING_M,
    RAISED_M,
    SHALLOW_M,
    floor_before,
    missed,
    missing,
)
from core.mapping.rays import MIN_RANGE_M
from core.records import F64

SIZE, CELL_M, SERIAL = 6, 0.25, 7
CORNER = 3, -5  # the window: 0.75 to 2.25 m, -1.25 to 0.25 m
WINDOW = (*CORNER, SIZE, CELL_M)
LEVELS = [(0.5, 0.0), (-0.5, 0.0), (0.0, 0.5), (0.0, -0.5), (1.0, 0.0), (0.0, 1.0)]
SLANTS = [(0.375 * a, 0.5 * b) for a in (-1, 1) for b in (-1, 1)] + [(0.5, 0.375), (-0.5, 0.375)]
LIMITS = 0.10, -0.25, 1.5  # h_pos, h_neg, height of the robot
DARK = np.full((1, 5), np.nan)


def above_and_below(limit: float) -> list[float]:
    """A limit and its neighbours among the numbers."""
    return [math.nextafter(limit, -math.inf), limit, math.nextafter(limit, math.inf)]


def index(x: float, y: float) -> int:
    return flat_index(x, y, CELL_M, CORNER, SIZE)


def at_random(draw: random.Random) -> tuple[float, float]:
    """A place in the window or just beside it."""
    return 0.5 + draw.randrange(128) / 64, -1.5 + draw.randrange(128) / 64


# Marking


def some_cells(draw: random.Random) -> tuple[CellGrid, Cells]:
    """Cells in all the states that marking asks for, and a copy."""
    grid = CellGrid(SIZE, CELL_M)
    for name, values in (
        ("count", [0, 1]),
        ("looks", [-1, 0, 1]),
        ("miss", [0, 0, 1, MAX_EVIDENCE - 1, MAX_EVIDENCE]),
        ("miss_scan", [SERIAL - 1, SERIAL]),
        ("miss_sure", [0, 3]),
        ("miss_sure_scan", [SERIAL - 1, SERIAL]),
        ("miss_bits", [0, 1, 2]),
        ("stamp", [SERIAL - 1, SERIAL - 1, SERIAL]),
    ):
        grid.flat[name] = draw.choices(values, k=SIZE * SIZE)
    return grid, grid.flat.copy()


def mark(cells: Cells, at: int, bit: int, is_sure: bool) -> set[int]:
    """Floor lacks in a part of a cell; which cells are to be decided anew."""
    row, column = divmod(at, SIZE)
    around = {(row + a) % SIZE * SIZE + (column + b) % SIZE for a in (-1, 0, 1) for b in (-1, 0, 1)}
    noted = {at} if known(cells, at) else around
    cell = cells[at]
    cell["miss_bits"] |= bit
    if cell["miss_scan"] < SERIAL and cell["miss"] < MAX_EVIDENCE:
        cell["miss"], cell["miss_scan"] = cell["miss"] + 1, SERIAL
    if is_sure and cell["miss_sure_scan"] < SERIAL:
        cell["miss_sure"], cell["miss_sure_scan"] = cell["miss_sure"] + 1, SERIAL
    return {k for k in noted if cells["stamp"][k] != SERIAL}


@pytest.mark.parametrize("kind", ["lost", "short", "far"])
def test_the_parts_between_where_floor_was_due_and_where_the_beam_was_seen_lack_it(
    kind: str,
) -> None:
    draw = random.Random(kind)
    for _ in range(300):
        grid, model = some_cells(draw)
        (dx, dy), due = draw.choice(LEVELS + SLANTS), draw.randrange(1, 64) / 16
        level, is_sure = math.hypot(dx, dy), draw.random() < 0.5
        length = draw.randrange(1, 40) / 32 if kind == "short" else 40.0 + draw.randrange(40) / 32
        x, y = at_random(draw)
        if kind == "far":  # then it is the end or the beginning that lies in the window
            due += draw.choice([0.0, -0.9 * length])
        seen = math.inf if kind == "lost" else due + length
        origin = np.array([x - due * dx, y - due * dy, 1.0])
        places, last = [(x, y, False)], -1
        if kind != "lost":
            n = min(math.ceil(length * level / (CELL_M / grid.sub)), MAX_HOLE_STEPS)
            ranges = [due + length * k / n for k in range(n)]
            places = [
                (origin[0] + r * dx, origin[1] + r * dy, (seen - r) * level <= CELL_M / grid.sub)
                for r in ranges
            ]
            last = index(origin[0] + seen * dx, origin[1] + seen * dy)
        noted: set[int] = set()
        for px, py, is_end in places:
            at = index(px, py)
            if at >= 0 and not (is_end and at == last):
                new = mark(model, at, part_bit(px, py, CELL_M, grid.sub), is_sure)
                noted |= new
                for k in new:
                    model["stamp"][k] = SERIAL
        ray, room = np.array([dx, dy, -0.25]), (grid.sub, grid.flat, SERIAL, grid.touched, 2)
        used = missed(origin, ray, due, seen, is_sure, WINDOW, *room)
        assert set(grid.touched[2:used]) == noted
        assert used == 2 + len(noted)
        np.testing.assert_array_equal(grid.flat, model)


# The floor before


def floors(draw: random.Random) -> CellGrid:
    """Cells with and without floor, of some heights."""
    grid = CellGrid(SIZE, CELL_M)
    heights = [0.0, 0.0, RAISED_M, 0.0625, *above_and_below(RAISED_M)]
    grid.flat["floor_count"] = draw.choices([0, 0, 1, 2], k=SIZE * SIZE)
    grid.flat["above"] = draw.choices([0, 0, 0, 1, 2], k=SIZE * SIZE)
    grid.flat["z_m"] = draw.choices(heights, k=SIZE * SIZE)
    return grid


def some_ground(draw: random.Random) -> Ground:
    planes = [draw.randrange(-8, 9) / 64 for _ in range(6)]
    way = draw.choice([(1.0, 0.0), (0.0, 1.0)])
    return Ground._make([*planes, *way, draw.choice([0.0, 1.0, 2.0]), draw.choice([0.0, 0.03])])


def before_by_hand(
    origin: F64, ray: F64, due: float, x: float, y: float, ground: Ground, cells: Cells
) -> float:
    """The height of the first floor on the way back, unless it lies too far or too high."""
    level, heights = math.hypot(ray[0], ray[1]), {}
    for back in range(1, LOOKS_BACK + 1):
        r = due - BEFORE_M * back / level
        bx, by = origin[0] + r * ray[0], origin[1] + r * ray[1]
        at = index(bx, by)
        if at >= 0 and cells["floor_count"][at] and not cells["above"][at]:
            heights[back] = cells["z_m"][at] + ground.far_x * (x - bx) + ground.far_y * (y - by)
    first = min(heights, default=LOOKS_BACK)
    if first > NEAR_BACK or any(heights[first] - z > RAISED_M for z in heights.values()):
        return math.nan
    return float(heights[first])


def same(one: float, other: float) -> bool:
    return one == other or (math.isnan(one) and math.isnan(other))


def test_floor_before_a_hole_is_the_nearest_on_the_way_back_and_has_not_risen() -> None:
    draw, told = random.Random(3), 0
    for k in range(600):
        cells, ground = floors(draw).flat, LEVEL if k % 2 else some_ground(draw)
        (dx, dy), due, (x, y) = draw.choice(LEVELS + SLANTS), 2.0, at_random(draw)
        origin, ray = np.array([x - due * dx, y - due * dy, 1.0]), np.array([dx, dy, -0.5])
        x, y = x + 0.25, y - 0.375
        by_hand = before_by_hand(origin, ray, due, x, y, ground, cells)
        assert same(floor_before(origin, ray, due, x, y, ground, WINDOW, cells), by_hand)
        told += not math.isnan(by_hand)
    assert 100 < told < 400


@pytest.mark.parametrize("level", above_and_below(LEAST_LEVEL))
def test_nothing_lies_before_where_a_beam_comes_straight_down(level: float) -> None:
    grid = CellGrid(SIZE, CELL_M)
    grid.flat["floor_count"] = 1
    beam = np.array([1.5, 0.0, 1.0]), np.array([level, 0.0, -1.0]), 1.0
    found = floor_before(*beam, 1.5, 0.0, LEVEL, WINDOW, grid.flat)
    assert same(found, 0.0 if level >= LEAST_LEVEL else math.nan)


# What is missing


def missing_at(
    z: float,
    nearest: float = 2.0,
    due: float = 1.5,
    is_calm: bool = True,
    floor_m: float = 0.0,
) -> int:
    """What a beam says that returns from a height, over level floor at another one."""
    grid = CellGrid(SIZE, CELL_M)
    grid.flat["floor_count"], grid.flat["z_m"] = 1, floor_m
    origin, ray = np.array([1.5 - due * 0.5, 0.0, 0.0]), np.array([0.5, 0.0, z / nearest])
    rest = DARK, LEVEL, LIMITS, is_calm, WINDOW, grid.flat
    return missing(2, origin, ray, due, nearest, *rest)


def test_a_return_from_a_drop_is_a_clear_miss_and_one_just_above_is_not() -> None:
    assert [missing_at(z) for z in above_and_below(-0.25)] == [2, 2, 1]
    assert missing_at(-0.25, due=SHALLOW_M + 1) == 2


def test_a_return_that_is_hardly_below_the_ground_is_floor_however_high_the_floor_before() -> None:
    found = [missing_at(z, floor_m=0.125) for z in (*above_and_below(-LOWER_M), 0.0)]
    assert found == [1, 1, 0, 0]


def test_floor_due_far_off_shows_none_by_a_few_centimetres() -> None:
    assert [missing_at(-0.125, due=due) for due in above_and_below(SHALLOW_M)] == [1, 1, 0]


@pytest.mark.parametrize("nearest", [0.5, 2.0, 8.0])
def test_a_few_centimetres_below_the_floor_before_are_a_hole_more_of_them_while_nodding(
    nearest: float,
) -> None:
    calm = above_and_below(-(BELOW_M + BELOW_SLOPE * nearest))
    assert [missing_at(z, nearest) for z in calm] == [1, 1, 0]
    nodding = above_and_below(-NODDING_M)
    assert [missing_at(z, nearest, is_calm=False) for z in nodding] == [1, 1, 0]


def test_what_is_missing_equals_a_slow_model_over_any_ground() -> None:
    draw, told = random.Random(5), [0, 0, 0]
    for _ in range(600):
        cells, ground, is_calm = floors(draw).flat, some_ground(draw), draw.random() < 0.5
        (dx, dy), due = draw.choice(LEVELS + SLANTS), draw.choice([2.0, 3.0])
        nearest, (x, y) = due + draw.choice([0.25, 0.5]), at_random(draw)
        origin = np.array([x - due * dx, y - due * dy, 1.0])
        x, y = origin[0] + nearest * dx, origin[1] + nearest * dy
        ground_z = ground_m(ground, x, y)
        aim_z = ground_z + draw.choice([-0.3, -0.2, -0.15, -0.1, -0.08, -0.05, -0.03])
        ray = np.array([dx, dy, (aim_z - 1.0) / nearest])
        z = 1.0 + nearest * ray[2]
        before = before_by_hand(origin, ray, due, x, y, ground, cells)
        deep = BELOW_M + BELOW_SLOPE * nearest if is_calm else NODDING_M
        says = 2 if z - ground_z <= LIMITS[1] else int(z - ground.jitter_m - before <= -deep)
        beam = origin, ray, due, nearest, DARK, ground, LIMITS, is_calm
        assert missing(2, *beam, WINDOW, cells) == says
        told[says] += 1
    assert min(told) > 50


def test_a_beam_misses_floor_that_is_one_of_three_in_a_row_that_did_not_come_back() -> None:
    draw, cells = random.Random(7), CellGrid(SIZE, CELL_M).flat
    near = math.nextafter(MIN_RANGE_M, 0.0)
    for _ in range(150):
        echoes, beams = draw.choice([1, 2]), draw.randrange(1, 9)
        values = [math.nan, near, 0.0, *[math.nan] * 3, MIN_RANGE_M, 9.0]
        ranges_m = np.array(draw.choices(values, k=echoes * beams)).reshape(echoes, beams)
        back = [any(ranges_m[:, k] >= MIN_RANGE_M) for k in range(beams)]
        for i in range(beams):
            rows = [back[k : k + 3] for k in range(max(0, i - 2), i + 1)]
            is_dark = [False] * 3 in rows
            rest = ranges_m, LEVEL, LIMITS, True, WINDOW, cells
            says = missing(i, np.zeros(3), np.ones(3), 2.0, math.inf, *rest)
            assert says == (2 if is_dark else 0), (i, back)
