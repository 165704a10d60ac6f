"""Heights of cells that no beam met: gaps, what rises beside them, and what is left unknown."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.grid.ring import RingGrid
from core.mapping.footing import Ground
from core.mapping.heights.fill import FILL_M
from core.mapping.heights.told import Heights
from core.mapping.heights.upper import NO_UPPERS
from core.mapping.surface.cells import BLANK, CELL, Cells
from core.mapping.surface.constants import BEND, FLAT_M, LIKELY
from core.records import F64, I64
from tests.support.cases import examples

SIZE, CELL_M, H_POS_M = 61, 0.01, 0.03
VAR_M2 = 0.002**2
MIDDLE = SIZE // 2


def window(size: int = SIZE) -> RingGrid:
    """Whose array begins with its corner."""
    grid = RingGrid(size, CELL_M)
    grid.follow(0.5 * size * CELL_M, 0.5 * size * CELL_M)
    return grid


def level(grid: RingGrid, z_m: float = 0.0) -> Cells:
    cells = grid.layer(CELL, BLANK)
    cells["looks"], cells["ground_m"], cells["var_m2"] = 1, z_m, VAR_M2
    return cells


def filled(cells: Cells, grid: RingGrid, at: I64) -> Ground:
    return Heights(grid, cells, NO_UPPERS, np.zeros(2), H_POS_M).filled_at(at)


def told(cells: Cells, grid: RingGrid) -> tuple[F64, F64]:
    """Heights and sigmas (size, size); of cells that were measured 0."""
    ground = filled(cells, grid, np.arange(SIZE**2))
    return ground.z_m, ground.sigma_m


def gap(cells: Cells, half: int) -> None:
    """Nothing was seen in a square about the middle."""
    part = slice(MIDDLE - half, MIDDLE + half + 1)
    cells[part, part] = BLANK


def test_a_gap_in_level_ground_is_level_and_the_less_sure_the_farther_from_its_sides() -> None:
    grid = window()
    cells = level(grid, 0.7)
    gap(cells, 10)
    z_m, sigma_m = told(cells, grid)
    np.testing.assert_allclose(z_m, 0.7, atol=1e-6)
    along = sigma_m[MIDDLE, MIDDLE - 10 : MIDDLE + 1]
    assert (np.diff(along) > 0.0).all()
    away_m = 11 * CELL_M
    expected = VAR_M2 + (BEND * away_m) ** 2 + FLAT_M**2
    assert along[-1] == pytest.approx(math.sqrt(expected), rel=1e-6)
    assert (sigma_m[0] == 0.0).all()


def test_behind_an_edge_lies_ground_and_no_slope_but_its_height_is_one_sigma() -> None:
    """A box at the left, floor around it, and ten columns in its lee that nobody saw."""
    grid = window()
    cells = level(grid)
    cells["ground_m"][25:36, :20] = 0.15
    cells[25:36, 20:30] = BLANK
    z_m, sigma_m = told(cells, grid)
    gap_m, doubts_m = z_m[MIDDLE, 20:30], sigma_m[MIDDLE, 20:30]
    np.testing.assert_allclose(gap_m, 0.0, atol=1e-6)
    for k in (0, 5, 9):
        box_m, floor_m = (1 + k) * CELL_M, min(6, 10 - k) * CELL_M
        if k == 5:  # the diagonals meet the floor beyond
            floor_m = 5 * CELL_M
        slope_m = 0.15 * floor_m / (floor_m + box_m)
        assert slope_m <= doubts_m[k] < slope_m + 0.004, k


@pytest.mark.parametrize("up_m", [0.15, -0.15])
def test_a_gap_in_a_top_is_as_high_and_one_in_a_pit_as_low(up_m: float) -> None:
    grid = window()
    cells = level(grid)
    cells["ground_m"][20:41, 20:41] = up_m
    gap(cells, 1)
    z_m, _ = told(cells, grid)
    assert z_m[MIDDLE, MIDDLE] == pytest.approx(up_m, abs=1e-6)


def test_nothing_is_told_beyond_the_last_ground_nor_far_from_any() -> None:
    grid = window()
    cells = level(grid)
    cells[:, 30:] = BLANK
    assert np.isnan(told(cells, grid)[0][:, 30:]).all()
    far = window(101)
    cells = far.layer(CELL, BLANK)
    edge = round(FILL_M / CELL_M)
    cells[:, : 50 - edge], cells[:, 51 + edge :] = level(far)[0, 0], level(far)[0, 0]
    ground = filled(cells, far, np.arange(101**2))
    assert np.isnan(ground.z_m[50, 50])


@pytest.mark.parametrize("what", ["a beam was under it", "it is soft"])
def test_a_hole_and_what_is_soft_are_not_filled_and_tell_nothing(what: str) -> None:
    grid = window()
    cells = level(grid)
    gap(cells, 2)
    part = slice(MIDDLE - 2, MIDDLE + 3)
    if what == "it is soft":
        cells["stands"][part, part], cells["soft"][part, part] = 1.0, LIKELY
    else:
        cells["under_m"][part, part] = -0.05
    assert np.isnan(told(cells, grid)[0][part, part]).all()


@settings(max_examples=examples(20), deadline=None)
@given(
    seed=st.integers(0, 2**32), share=st.sampled_from([0.1, 0.5, 0.9]), shift=st.integers(-99, 99)
)
def test_what_is_filled_lies_between_what_was_measured_wherever_the_map_lies(
    seed: int, share: float, shift: int
) -> None:
    random, grid = np.random.default_rng(seed), RingGrid(SIZE, CELL_M)
    grid.follow(shift * CELL_M, -shift * CELL_M)
    cells = level(grid)
    cells["ground_m"] = random.uniform(-0.1, 0.1, cells.shape)
    cells[random.random(cells.shape) < share] = BLANK
    z_m, sigma_m = told(cells, grid)
    is_new = (cells["looks"] == 0) & np.isfinite(z_m)
    assert (np.abs(z_m[is_new]) <= 0.1).all()
    assert (sigma_m[is_new] >= math.sqrt(VAR_M2 + FLAT_M**2) - 1e-9).all()
    np.testing.assert_array_equal(z_m[cells["looks"] > 0], cells["ground_m"][cells["looks"] > 0])
    here = np.arange(SIZE**2)[random.random(SIZE**2) < 0.05]  # who asks for some gets the same
    some = filled(cells, grid, here)
    np.testing.assert_array_equal(some.z_m.ravel()[here], z_m.ravel()[here])
    np.testing.assert_array_equal(some.sigma_m.ravel()[here], sigma_m.ravel()[here])
