"""Slope, step and roughness against least squares done plainly; layers against their cells."""

import itertools
import math
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.grid.ring import RingGrid
from core.mapping.heights.told import LAYERS, Heights
from core.mapping.heights.upper import NO_UPPERS
from core.mapping.layers import view_of
from core.mapping.surface.cells import BLANK, CELL, Cells
from core.mapping.surface.constants import LIKELY
from core.mapping.terrain import around, terrain_of
from tests.support.cases import examples

F64 = npt.NDArray[np.float64]
SIZE, CELL_M = 9, 0.2
SLOPES = {"slope_x": 0.1, "slope_y": -0.05}
RISE_M = 0.03  # of such ground within a cell
Known = dict[tuple[int, int], tuple[float, float]]  # height and relief of cells


class Ground:
    """Cells of a ring whose heights are put in by hand."""

    def __init__(self) -> None:
        self.grid = RingGrid(SIZE, CELL_M)
        self.cells: Cells = self.grid.layer(CELL, BLANK)
        self.heights = Heights(self.grid, self.cells, NO_UPPERS, np.zeros(2), h_pos_m=0.1)

    def put(self, i: int, j: int, z_m: float, relief_m: float = 0.0, **fields: float) -> Any:
        """Something that ends at a height, and stands so high over its ground; its record."""
        cell = self.cells[j % SIZE, i % SIZE]
        for name, value in {"ground_m": z_m - relief_m, "looks": 1, **fields}.items():
            cell[name] = value
        if relief_m > 0.0:
            cell["stands"], cell["top_m"] = 1.0, relief_m
        return cell

    def ring(self, name: str) -> F64:
        """A layer (SIZE, SIZE), a ring as the cells."""
        found = self.heights.maybe_ring(name)
        assert found is not None
        return found[1](np.arange(SIZE * SIZE)).reshape(SIZE, SIZE)

    def judged(self) -> F64:
        """Slope by the plane through the neighbours, step and roughness: (3, SIZE, SIZE)."""
        near, z_m = around(self.grid, np.arange(self.cells.size)), self.ring("z").reshape(-1)
        relief_m = CELL_M * (np.abs(self.cells["slope_x"]) + np.abs(self.cells["slope_y"]))
        relief_m += np.where(self.cells["stands"] > 0.0, self.cells["top_m"], 0.0)
        z_m = np.where(near >= 0, z_m[near], np.nan)
        return terrain_of(z_m, relief_m.reshape(-1), CELL_M).reshape(3, SIZE, SIZE).astype(float)


def surface(slope_x: float, slope_y: float) -> Ground:
    """A plane that fills the window."""
    ground = Ground()
    corner = ground.grid.corner_i
    for i in range(corner, corner + SIZE):
        for j in range(corner, corner + SIZE):
            z_m = CELL_M * (slope_x * i + slope_y * j)
            ground.put(i, j, z_m, slope_x=slope_x, slope_y=slope_y)
    return ground


def known_cells(share: float, seed: int) -> Known:
    """A share of all cells, at any height; in half of these something stands."""
    random = np.random.default_rng(seed)
    return {
        at: (random.uniform(-1.0, 1.0), RISE_M + max(0.0, random.uniform(-0.5, 0.5)))
        for at in itertools.product(range(SIZE), range(SIZE))
        if random.random() < share
    }


def plain(known: Known, i: int, j: int) -> list[float]:
    """Slope, step and roughness of one cell, by the book."""
    near = {
        (di, dj): known[i + di, j + dj][0]
        for di in (-1, 0, 1)
        for dj in (-1, 0, 1)
        if (i + di, j + dj) in known
    }
    z_m, relief_m = known[i, j]
    step_m = max([relief_m] + [abs(other - z_m) for other in near.values()])
    design = np.array([(1.0, di * CELL_M, dj * CELL_M) for di, dj in near])
    if np.linalg.matrix_rank(design, tol=1e-6) < 3:
        return [math.nan, step_m, math.nan]
    heights = np.array(list(near.values()))
    solution = np.linalg.lstsq(design, heights, rcond=None)[0]
    off = np.mean((design @ solution - heights) ** 2)
    own = max(0.0, relief_m - CELL_M * np.abs(solution[1:]).sum()) / math.sqrt(12)
    slope_rad = math.atan(float(np.hypot(solution[1], solution[2])))
    return [slope_rad, step_m, math.sqrt(off + own**2)]


@settings(max_examples=examples(30), deadline=None)
@given(
    share=st.sampled_from([0.1, 0.3, 0.6, 1.0]),
    seed=st.integers(0, 2**32),
    x_cells=st.integers(-20, 20),
    y_cells=st.integers(-20, 20),
)
def test_each_known_cell_is_judged_as_least_squares_by_the_book_judge_it(
    share: float, seed: int, x_cells: int, y_cells: int
) -> None:
    ground, known = Ground(), known_cells(share, seed)
    ground.grid.follow(x_cells * CELL_M, y_cells * CELL_M)
    low_i, low_j = ground.grid.corner_i, ground.grid.corner_j
    expected = np.full((3, SIZE, SIZE), np.nan)
    for (i, j), (z_m, relief_m) in known.items():
        ground.put(low_i + i, low_j + j, z_m, relief_m - RISE_M, **SLOPES)
        expected[:, (low_j + j) % SIZE, (low_i + i) % SIZE] = plain(known, i, j)
    np.testing.assert_allclose(ground.judged(), expected, atol=2e-6)
    for k, name in ((1, "step"), (2, "roughness")):
        np.testing.assert_allclose(ground.ring(name), expected[k], atol=2e-6)


@pytest.mark.parametrize(
    ("slope_deg", "heading_deg"), [(0.0, 0.0), (1.0, 90.0), (8.0, 37.0), (25.0, 225.0)]
)
def test_a_smooth_ramp_has_its_slope_and_no_roughness(slope_deg: float, heading_deg: float) -> None:
    rise, heading = math.tan(math.radians(slope_deg)), math.radians(heading_deg)
    ground = surface(rise * math.cos(heading), rise * math.sin(heading))
    slopes_rad, _, roughness_m = ground.judged()
    np.testing.assert_allclose(np.degrees(slopes_rad), slope_deg, atol=1e-4)
    np.testing.assert_allclose(np.degrees(ground.ring("slope")), slope_deg, atol=1e-4)
    np.testing.assert_allclose(roughness_m, 0.0, atol=1e-6)


def test_a_change_reaches_the_neighbours_and_what_is_forgotten_is_unknown_again() -> None:
    ground = surface(0.0, 0.0)
    middle = ground.put(0, 0, 0.3, 0.3)
    _, steps_m, roughness_m = ground.judged()
    beside = np.ix_([-1, 0, 1], [-1, 0, 1])
    np.testing.assert_allclose(steps_m[beside], 0.3, atol=1e-6)
    assert (roughness_m[beside] > 0.05).all()
    assert np.count_nonzero(steps_m) == 9
    middle["looks"], middle["stands"] = 0, 0.0
    assert np.isnan(ground.judged()[:, 0, 0]).all()


def test_what_enters_the_window_is_not_known_and_an_erased_map_has_nothing() -> None:
    ground = surface(0.1, 0.0)
    ground.grid.follow(4 * CELL_M, 0.0)
    assert np.isnan(ground.judged()[0]).sum() == 4 * SIZE
    ground.grid.erase()
    assert np.isnan(ground.judged()).all()


def test_every_layer_can_be_asked_for_and_lies_where_its_corner_says() -> None:
    ground = Ground()
    grid = ground.grid
    grid.follow(3.0, -2.0)
    i, j = grid.cell_of(3.1, -2.1)
    cell = ground.put(i, j, 0.4, 0.1, var_m2=0.01, soft=LIKELY, under_m=-0.2)
    expected = {"height": 0.1, "variance": 0.01, "z": 0.4, "step": 0.3, "soft": 1}
    for name in LAYERS:
        found = ground.heights.maybe_ring(name)
        assert found is not None
        view = view_of(name, *found)
        assert view.name == name
        assert view.values.dtype == np.float32
        if name in expected:
            here = view.values[j - view.corner_j, i - view.corner_i]
            assert here == pytest.approx(expected[name], abs=1e-6)
            assert np.isnan(view.values).sum() == view.values.size - 1
        view.values[...] = 7.0  # it is a copy
    assert np.isfinite(ground.cells["var_m2"]).sum() == 1
    cell["soft"] = 0.0
    assert np.nanmax(ground.ring("soft")) == 0
    assert ground.heights.maybe_ring("colour") is None
