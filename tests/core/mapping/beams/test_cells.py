"""Cells of method `beams`: their places, their parts, and the list of those that a scan touched."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.mapping.beams.cells import (
    CELL,
    MAX_SUB,
    CellGrid,
    flat_index,
    ones,
    part_bit,
    parts_of,
    touch,
    touch_around,
)

COORDINATE = st.floats(-30, 30)


@given(x=COORDINATE, y=COORDINATE, corner=st.tuples(st.integers(-50, 50), st.integers(-50, 50)))
def test_a_flat_index_is_that_of_the_ring_or_none(
    x: float, y: float, corner: tuple[int, int]
) -> None:
    size, cell_m = 21, 0.25
    i, j = math.floor(x / cell_m), math.floor(y / cell_m)
    inside = all(0 <= a - b < size for a, b in zip((i, j), corner, strict=True))
    at = flat_index(x, y, cell_m, corner, size)
    assert at == ((j % size) * size + i % size if inside else -1)


@given(x=COORDINATE, y=COORDINATE, sub=st.integers(1, MAX_SUB))
def test_a_part_is_where_its_place_lies_in_the_cell(x: float, y: float, sub: int) -> None:
    bit = part_bit(x, y, 0.25, sub)
    assert ones(bit) == bit.bit_count() == 1
    assert ones(0xFFFF) == 16
    assert ones(0x8009) == 3
    row, column = divmod(bit.bit_length() - 1, sub)
    for place, part in ((x, column), (y, row)):
        within = place / 0.25 - math.floor(place / 0.25)
        assert 0 <= part < sub
        assert part / sub - 1e-9 <= within <= (part + 1) / sub + 1e-9


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
