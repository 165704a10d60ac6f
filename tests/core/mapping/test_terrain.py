"""Slope, step and roughness against least squares done plainly; layers against their cells."""

import math

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.grid.window import ObstacleWindow
from core.mapping.beams.cells import CellGrid
from core.mapping.beams.classifier import SOFT_LEAST
from core.mapping.layers import UNITS, LayerView, maybe_beams_layer
from core.mapping.terrain import F32, JUDGED
from core.records import OBSTACLE
from tests.support.cases import examples

F64 = npt.NDArray[np.float64]
SIZE, CELL_M = 9, 0.2
HEIGHTS = st.dictionaries(
    st.tuples(st.integers(0, SIZE - 1), st.integers(0, SIZE - 1)),
    st.tuples(st.floats(-1, 1), st.floats(0, 0.5)),
    max_size=SIZE * SIZE,
)


def put(cells: CellGrid, i: int, j: int, z_m: float, relief_m: float = 0.0) -> int:
    """Let a world cell have a height; its flat index."""
    at = (j % cells.grid.size) * cells.grid.size + i % cells.grid.size
    cell = cells.flat[at]
    cell["count"], cell["z_m"] = 10, z_m
    cell["z_low_m"], cell["z_high_m"] = z_m - 0.5 * relief_m, z_m + 0.5 * relief_m
    return at


def surface(slope_x: float, slope_y: float) -> CellGrid:
    """A plane that fills the window, each cell with the relief that its slope makes."""
    cells = CellGrid(SIZE, CELL_M)
    relief_m = CELL_M * (abs(slope_x) + abs(slope_y))
    corner = cells.grid.corner_i
    for i in range(corner, corner + SIZE):
        for j in range(corner, corner + SIZE):
            put(cells, i, j, CELL_M * (slope_x * i + slope_y * j), relief_m)
    return cells


def judged(cells: CellGrid) -> F32:
    """Slope, step and roughness of every cell: (3, SIZE, SIZE), a ring as the cells."""
    window = ObstacleWindow(SIZE, CELL_M)
    views = [maybe_beams_layer(name, cells, window) for name in JUDGED]
    shift = cells.grid.corner_j % SIZE, cells.grid.corner_i % SIZE
    return np.array([np.roll(view.values, shift, (0, 1)) for view in views if view is not None])


def plain(known: dict[tuple[int, int], tuple[float, float]], i: int, j: int) -> list[float]:
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
@given(heights=HEIGHTS, x_cells=st.integers(-20, 20), y_cells=st.integers(-20, 20))
def test_each_known_cell_is_judged_as_least_squares_by_the_book_judge_it(
    heights: dict[tuple[int, int], tuple[float, float]], x_cells: int, y_cells: int
) -> None:
    cells = CellGrid(SIZE, CELL_M)
    cells.grid.follow(x_cells * CELL_M, y_cells * CELL_M)
    corner = cells.grid.corner_i, cells.grid.corner_j
    for (i, j), (z_m, relief_m) in heights.items():
        put(cells, corner[0] + i, corner[1] + j, z_m, relief_m)
    window = ObstacleWindow(SIZE, CELL_M)
    expected = np.full((3, SIZE, SIZE), np.nan)
    for i, j in heights:
        expected[:, j, i] = plain(heights, i, j)
    for name, values in zip(("slope", "step", "roughness"), expected, strict=True):
        view = maybe_beams_layer(name, cells, window)
        assert view is not None
        np.testing.assert_allclose(view.values, values, atol=2e-6)


@pytest.mark.parametrize(
    ("slope_deg", "heading_deg"), [(0.0, 0.0), (1.0, 90.0), (8.0, 37.0), (25.0, 225.0)]
)
def test_a_smooth_ramp_has_its_slope_and_no_roughness(slope_deg: float, heading_deg: float) -> None:
    rise, heading = math.tan(math.radians(slope_deg)), math.radians(heading_deg)
    slopes_rad, _, roughness_m = judged(surface(rise * math.cos(heading), rise * math.sin(heading)))
    np.testing.assert_allclose(np.degrees(slopes_rad), slope_deg, atol=1e-4)
    np.testing.assert_allclose(roughness_m, 0.0, atol=1e-6)


def test_a_change_reaches_the_neighbours_and_what_is_forgotten_is_unknown_again() -> None:
    cells = surface(0.0, 0.0)
    middle = put(cells, 0, 0, 0.3)
    assert middle == 0
    _, steps_m, roughness_m = judged(cells)
    around = np.ix_([-1, 0, 1], [-1, 0, 1])
    np.testing.assert_allclose(steps_m[around], 0.3, atol=1e-6)
    assert (roughness_m[around] > 0.05).all()
    assert np.count_nonzero(steps_m) == 9
    cells.flat[middle]["count"] = 0
    assert np.isnan(judged(cells)[:, 0, 0]).all()


def test_what_enters_the_window_is_not_known_and_an_erased_map_has_nothing() -> None:
    cells = surface(0.1, 0.0)
    cells.grid.follow(4 * CELL_M, 0.0)
    assert np.isnan(judged(cells)[0]).sum() == 4 * SIZE
    cells.grid.erase()
    assert np.isnan(judged(cells)).all()


def views_of(cells: CellGrid, window: ObstacleWindow) -> dict[str, LayerView]:
    views = {name: maybe_beams_layer(name, cells, window) for name in UNITS}
    return {name: view for name, view in views.items() if view is not None}


def test_every_layer_can_be_asked_for_and_lies_where_its_corner_says() -> None:
    cells, window = CellGrid(SIZE, CELL_M), ObstacleWindow(5, CELL_M)
    for grid in (cells.grid, window.grid):
        grid.follow(3.0, -2.0)
    i, j = cells.grid.cell_of(3.1, -2.1)
    at = put(cells, i, j, 0.4, 0.1)
    cells.flat[at]["mean_m"], cells.flat[at]["var_m2"] = 0.3, 0.01
    cells.flat[at]["soft"] = cells.flat[at]["doubles"] = SOFT_LEAST
    ring_at = np.array([(j % 5) * 5 + i % 5], dtype=np.int32)
    window.put(ring_at, np.array([OBSTACLE], dtype=np.int8))
    expected = {"height": 0.3, "variance": 0.01, "z": 0.4, "step": 0.1, "soft": 1, "state": 1}
    views = views_of(cells, window)
    assert views.keys() == UNITS.keys()
    for name, value in expected.items():
        view = views[name]
        assert view.name == name
        assert view.values.dtype == np.float32
        assert view.values[j - view.corner_j, i - view.corner_i] == pytest.approx(value, abs=1e-6)
        assert np.isnan(view.values).sum() == view.values.size - 1
        view.values[...] = 7.0  # it is a copy
    assert (cells.cells["mean_m"] != 0.0).sum() == window.cells.sum() == 1
    cells.flat[at]["soft"] = 0
    assert np.nanmax(views_of(cells, window)["soft"].values) == 0
    assert maybe_beams_layer("colour", cells, window) is None
