"""Edges and footholds against plain Python: a kerb, a box, a hole, the unknown, any ground."""

import itertools
import math

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.grid.ring import RingGrid
from core.mapping.footing import Footing, Ground, footing_of
from core.mapping.heights.told import Heights
from core.mapping.heights.upper import NO_UPPERS
from core.mapping.layers import view_of
from core.mapping.surface.cells import BLANK, CELL
from core.mapping.surface.constants import LIKELY
from tests.support.cases import examples

F64 = npt.NDArray[np.float64]
SIZE, CELL_M = 15, 0.1
FOOT = Footing(radius_m=0.1, step_m=0.05, reach_m=0.4)
Columns = dict[tuple[int, int], tuple[float, float]]  # of known cells: highest and lowest


def ground_of(heights: Columns, grid: RingGrid) -> Ground:
    """Of cells that count from the window's corner."""
    z_m, low_m = np.full((2, SIZE, SIZE), np.nan)
    for (i, j), (high, low) in heights.items():
        at = (grid.corner_j + j) % SIZE, (grid.corner_i + i) % SIZE
        z_m[at], low_m[at] = high, low
    return Ground(grid, z_m, low_m, np.zeros(z_m.shape))


def judged(name: str, heights: Columns, footing: Footing = FOOT, shift: int = 0) -> F64:
    """(SIZE, SIZE), [i, j] from the window's corner."""
    grid = RingGrid(SIZE, CELL_M)
    grid.follow(shift * CELL_M, -2 * shift * CELL_M)
    values = footing_of(name, ground_of(heights, grid), np.arange(SIZE**2), footing)
    return view_of(name, grid, lambda at: values[at]).values.T.astype(np.float64)


def flat(z_m: float = 0.0) -> Columns:
    return dict.fromkeys(itertools.product(range(SIZE), range(SIZE)), (z_m, z_m))


def raised(where: list[tuple[int, int]], by_m: float) -> Columns:
    return flat() | dict.fromkeys(where, (by_m, by_m))


def plain_edge(heights: Columns, at: tuple[int, int], footing: Footing) -> float:
    if at not in heights:
        return math.nan
    high_m, low_m = heights[at]
    ways_m = [footing.reach_m]
    for (i, j), levels_m in heights.items():
        away_m = CELL_M * math.hypot(i - at[0], j - at[1])
        if any(abs(level_m - high_m) > footing.step_m for level_m in levels_m):
            ways_m.append(away_m)
    return 0.0 if high_m - low_m > footing.step_m else min(ways_m)


def plain_foothold(heights: Columns, at: tuple[int, int], footing: Footing) -> float:
    """A plane by least squares through every cell that the foot touches; no edge a cell wider."""
    foot_m = max(footing.radius_m, 0.71 * CELL_M)
    under, about = [], set()
    for di, dj in itertools.product(range(-9, 10), range(-9, 10)):
        beside = max(abs(di) - 0.5, 0.0), max(abs(dj) - 0.5, 0.0)
        if CELL_M * math.hypot(*beside) < foot_m:
            under.append((di, dj))
            about |= set(itertools.product((di - 1, di, di + 1), (dj - 1, dj, dj + 1)))
    if any((at[0] + di, at[1] + dj) not in heights for di, dj in about):
        return math.nan
    all_m = [level_m for di, dj in about for level_m in heights[at[0] + di, at[1] + dj]]
    own_m = heights[at][0]
    if any(abs(level_m - own_m) > footing.step_m for level_m in all_m):
        return 0.0
    levels_m = [heights[at[0] + di, at[1] + dj] for di, dj in under]
    design = np.array([(1.0, di * CELL_M, dj * CELL_M) for di, dj in under])
    z_m = np.array([pair[0] for pair in levels_m])
    solution = np.linalg.lstsq(design, z_m, rcond=None)[0]
    rms_m = math.sqrt(np.mean((design @ solution - z_m) ** 2))
    slope_rad = math.atan(math.hypot(solution[1], solution[2]))
    level = (footing.steep_rad - slope_rad) / (footing.steep_rad - footing.level_rad)
    smooth = (footing.rough_m - rms_m) / (footing.rough_m - footing.smooth_m)
    return min(1.0, max(0.0, min(level, smooth)))


@pytest.mark.slow
@settings(max_examples=examples(30), deadline=None)
@given(
    share=st.sampled_from([0.5, 0.9, 1.0]),
    sigma_m=st.sampled_from([0.0, 0.008, 0.02, 0.1]),
    rise=st.sampled_from([0.0, 0.15, 0.3]),
    seed=st.integers(0, 2**32),
    shift=st.integers(-20, 20),
    radius_m=st.sampled_from([0.02, 0.1, 0.18]),
)
def test_each_cell_is_judged_as_plain_python_judges_it(
    share: float, sigma_m: float, rise: float, seed: int, shift: int, radius_m: float
) -> None:
    random, footing = np.random.default_rng(seed), FOOT._replace(radius_m=radius_m)
    heights: Columns = {}
    for i, j in flat():
        if random.random() < share:
            z_m = rise * CELL_M * i + sigma_m * random.standard_normal()
            heights[i, j] = z_m, z_m - (0.1 if random.random() < 0.02 else 0.0)
    for name, plain in (("edge", plain_edge), ("foothold", plain_foothold)):
        expected = [[plain(heights, (i, j), footing) for j in range(SIZE)] for i in range(SIZE)]
        found = judged(name, heights, footing, shift)
        np.testing.assert_allclose(found, expected, atol=2e-6, err_msg=name)


def test_even_ground_is_a_foothold_all_over_and_has_no_edge() -> None:
    np.testing.assert_allclose(judged("edge", flat(0.7)), 0.4, atol=1e-6)
    footholds = judged("foothold", flat(0.7))
    assert (footholds[2:-2, 2:-2] == 1.0).all()
    assert np.isnan(footholds[:2]).all()  # the foot would stand over the map's end, or beside it
    assert np.isnan(footholds).sum() == SIZE**2 - (SIZE - 4) ** 2


@pytest.mark.parametrize("height_m", [0.12, -0.12])
def test_a_kerb_is_as_far_from_both_of_its_sides(height_m: float) -> None:
    kerb = raised([(i, j) for i in range(8, SIZE) for j in range(SIZE)], height_m)
    edges_m, footholds = judged("edge", kerb)[:, 7], judged("foothold", kerb)[:, 7]
    np.testing.assert_allclose(edges_m[3:13], [0.4, 0.4, 0.3, 0.2, 0.1, 0.1, 0.2, 0.3, 0.4, 0.4])
    np.testing.assert_array_equal(footholds[2:-2], [1, 1, 1, 1, 0, 0, 0, 0, 1, 1, 1])
    low = raised([(i, j) for i in range(8, SIZE) for j in range(SIZE)], height_m / 3)
    assert (judged("edge", low) > 0.39).all()


def test_on_a_box_stands_a_foot_that_is_not_larger() -> None:
    box = raised([(i, j) for i in range(5, 10) for j in range(5, 10)], 0.3)
    footholds = judged("foothold", box)
    assert footholds[7, 7] == 1.0
    assert (footholds[3:7, 7] == 0.0).all()
    assert footholds[2, 7] == 1.0
    assert judged("edge", box)[7, 7] == pytest.approx(0.3)
    assert judged("foothold", box, FOOT._replace(radius_m=0.2))[7, 7] == 0.0


def test_a_beam_below_the_ground_makes_its_cell_an_edge() -> None:
    hole = flat() | {(7, 7): (0.0, -0.2)}
    edges_m, footholds = judged("edge", hole), judged("foothold", hole)
    assert (edges_m[7, 7], footholds[7, 7], footholds[6, 6]) == (0.0, 0.0, 0.0)
    assert (edges_m[5, 7], footholds[5, 7]) == (pytest.approx(0.2), 0.0)
    assert footholds[4, 7] == 1.0


def test_an_edge_in_the_last_cell_that_a_foot_touches_is_seen_in_the_next_one() -> None:
    """Cells of 1 cm, which keep their highest points: a drop 8 mm before the end of the foot."""
    cell_m, size, edge_m = 0.01, 41, 0.295
    grid = RingGrid(size, cell_m)
    x_m = grid.corner_i * cell_m + cell_m * np.arange(size)
    high_m = np.where(x_m < grid.corner_i * cell_m + edge_m, 0.08, 0.0)
    z_m = np.zeros((size, size))
    z_m[:, (grid.corner_i + np.arange(size)) % size] = high_m
    ground = Ground(grid, z_m, z_m, np.zeros(z_m.shape))
    told = footing_of("foothold", ground, np.arange(size**2), FOOT).reshape(size, size)
    row = told[(grid.corner_j + 20) % size, (grid.corner_i + np.arange(size)) % size]
    middles_m = cell_m * (np.arange(size) + 0.5)
    safe = abs(middles_m - edge_m) > FOOT.radius_m
    assert not (row[~safe] > 0.0).any()
    assert (row[middles_m < edge_m - FOOT.radius_m - 2 * cell_m][12:] == 1.0).all()


def test_no_foot_stands_where_something_under_it_is_not_known() -> None:
    """Not even where an edge is under it, too; and what is not known is no edge."""
    known = raised([(6, 6)], 0.3)
    del known[7, 7]
    edges_m, footholds = judged("edge", known), judged("foothold", known)
    assert np.isnan(footholds[5:10, 5:10]).all()
    assert footholds[4, 6] == 0.0
    assert footholds[10, 10] == 1.0
    assert np.isnan(edges_m[7, 7])
    assert edges_m[8, 8] == pytest.approx(0.2 * math.sqrt(2))


def test_a_filled_height_counts_as_far_as_it_can_hide_no_edge() -> None:
    """At most step / GATE off, on level ground; and less where it lies higher already."""
    grid, everywhere = RingGrid(SIZE, CELL_M), np.arange(SIZE**2)
    for up_m, sigma_m, is_known in ((0.0, 0.016, True), (0.0, 0.017, False), (0.02, 0.011, False)):
        heights = flat() | {(7, 7): (up_m, up_m), (7, 8): (0.03, 0.03)}
        ground = ground_of(heights, grid)
        where = (grid.corner_j + 7) % SIZE, (grid.corner_i + 7) % SIZE
        ground.sigma_m[where] = sigma_m
        foothold, sigma = (
            footing_of(name, ground, everywhere, FOOT).reshape(SIZE, SIZE)
            for name in ("foothold", "foothold_sigma")
        )
        under = where[0], (where[1] + 1) % SIZE  # the foot touches it from beside
        assert np.isfinite(foothold[under]) == np.isfinite(sigma[under]) == is_known, sigma_m
        if is_known:
            assert sigma[under] == sigma_m
        away = where[0], (where[1] + 5) % SIZE
        assert (foothold[away], sigma[away]) == (1.0, 0.0)


@pytest.mark.parametrize(("slope_deg", "score"), [(4.0, 1.0), (8.0, 0.8), (12.5, 0.5), (21.0, 0.0)])
def test_a_steeper_ramp_is_a_worse_foothold(slope_deg: float, score: float) -> None:
    rise_m = CELL_M * math.tan(math.radians(slope_deg))
    ramp = {(i, j): (rise_m * i, rise_m * i) for i, j in flat()}
    footholds = judged("foothold", ramp, FOOT._replace(step_m=0.2))
    np.testing.assert_allclose(footholds[2:-2, 2:-2], score, atol=1e-6)


def test_of_the_surface_soft_things_are_no_ground_and_low_beams_are_its_lowest() -> None:
    grid = RingGrid(SIZE, CELL_M)
    cells = grid.layer(CELL, BLANK)
    cells["looks"], cells["ground_m"] = 1, 0.5
    soft, box, hole = cells[3, 2], cells[3, 3], cells[3, 5]
    for cell in (soft, box):
        cell["stands"], cell["top_m"] = 1.0, 0.25
    soft["soft"], hole["under_m"] = LIKELY, -0.125
    ground = Heights(grid, cells, NO_UPPERS, np.zeros(2), 0.1).ground_at(np.arange(SIZE**2))
    assert np.isnan([ground.z_m[3, 2], ground.low_m[3, 2]]).all()
    assert (ground.z_m[3, 3], ground.low_m[3, 3]) == (0.75, 0.75)
    assert (ground.z_m[3, 5], ground.low_m[3, 5]) == (0.5, 0.375)
    edges_m, footholds = (
        footing_of(name, ground, np.arange(SIZE**2), FOOT).reshape(SIZE, SIZE)
        for name in ("edge", "foothold")
    )
    assert (edges_m[3, 5], footholds[3, 5]) == (0.0, 0.0)
    assert np.isnan([edges_m[3, 2], footholds[3, 2], footholds[3, 1]]).all()


def test_a_foot_needs_its_middle_and_half_of_what_it_touches_to_be_measured() -> None:
    """Else a pit that nobody saw would be bridged by what lies around it."""
    grid, everywhere, middle = RingGrid(SIZE, CELL_M), np.arange(SIZE**2), (7, 7)
    touched = [at for at in itertools.product((6, 7, 8), repeat=2) if at != middle]
    for filled, is_known in ((touched[:4], True), (touched[:5], False), ([middle], False)):
        ground = ground_of(flat(), grid)
        for i, j in filled:
            ground.sigma_m[(grid.corner_j + j) % SIZE, (grid.corner_i + i) % SIZE] = 1e-3
        footholds = footing_of("foothold", ground, everywhere, FOOT).reshape(SIZE, SIZE)
        told = footholds[(grid.corner_j + 7) % SIZE, (grid.corner_i + 7) % SIZE]
        assert np.isfinite(told) == is_known, filled
