"""Cells of method `beams`: their parts, and the list of those that a scan touched."""

import numpy as np
import pytest

from core.grid.places import parts_of
from core.mapping.beams.cells import CELL, CellGrid, touch, touch_around


@pytest.mark.parametrize(
    ("cell_m", "parts"), [(0.01, 1), (0.05, 1), (0.1, 2), (0.15, 3), (0.2, 4), (0.49, 4), (1.0, 4)]
)
def test_a_cell_is_divided_into_parts_of_some_five_centimetres(cell_m: float, parts: int) -> None:
    assert parts_of(cell_m) == CellGrid(5, cell_m).sub == parts


def test_records_live_on_while_the_window_covers_them_and_enter_blank() -> None:
    grid = CellGrid(11, 0.2)
    size = grid.grid.size
    for i, j in ((3, 2), (-5, 0)):
        cell = grid.cells[j % size, i % size]
        cell["mean_m"], cell["count"], cell["far_sides"] = 0.1 * i, 4, 0xFF
    assert grid.grid.follow(0.7, 0.0)  # three cells on: -5 goes, 3 stays
    assert grid.window == (grid.grid.corner_i, -5, 11, 0.2)
    kept = grid.cells[2, 3]
    assert (kept["mean_m"], kept["count"]) == (pytest.approx(0.3), 4)
    assert int(grid.cells["count"].sum()) == 4
    entered = grid.cells[0, -5 % size]
    assert all(entered[name] == 0 for name in CELL.names or ())
    assert np.shares_memory(grid.flat, grid.cells)


def test_a_cell_is_noted_once_per_scan_and_again_in_the_next() -> None:
    grid = CellGrid(5, 0.2)
    for _ in range(2):
        serial = grid.begin_scan()
        assert grid.used == 0
        used = 0
        for at in (3, 7, 3, 3, 7):
            used = touch(at, grid.flat, serial, grid.touched, used)
        grid.used = used
        assert grid.touched[:used].tolist() == [3, 7]
    used = touch_around(0, 5, grid.flat, grid.begin_scan(), grid.touched, 0)  # across the seam
    assert sorted(grid.touched[:used].tolist()) == [0, 1, 4, 5, 6, 9, 20, 21, 24]
