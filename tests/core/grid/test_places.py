"""The cell of a ring in which a place lies, and the part of that."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.grid.places import (
    MOST_PARTS,
    Ring,
    cell_at,
    index_of,
    ones,
    part_bit,
    parts_of,
    world_cell,
)
from core.grid.ring import RingGrid

COORDINATE = st.floats(-30, 30)


@given(x=COORDINATE, y=COORDINATE, corner=st.tuples(st.integers(-50, 50), st.integers(-50, 50)))
def test_a_flat_index_is_that_of_the_ring_or_none(
    x: float, y: float, corner: tuple[int, int]
) -> None:
    size, cell_m = 21, 0.25
    i, j = math.floor(x / cell_m), math.floor(y / cell_m)
    inside = all(0 <= a - b < size for a, b in zip((i, j), corner, strict=True))
    at = cell_at(x, y, Ring(*corner, corner[0] % size, corner[1] % size, size, cell_m))
    assert at == ((j % size) * size + i % size if inside else -1)


@given(x=COORDINATE, y=COORDINATE, sub=st.integers(1, MOST_PARTS))
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


@pytest.mark.parametrize(("cell_m", "along"), [(0.2, 4), (0.1, 2), (0.05, 1), (0.5, MOST_PARTS)])
@pytest.mark.parametrize("cell", [0, -3, 17])
def test_each_part_of_a_cell_has_a_bit_of_its_own(cell_m: float, along: int, cell: int) -> None:
    middles = [(cell + (k + 0.5) / along) * cell_m for k in range(along)]
    bits = [part_bit(x, y, cell_m, parts_of(cell_m)) for y in middles for x in middles]
    assert bits == [1 << k for k in range(along * along)]


def moved(size: int, cell_m: float, x_m: float, y_m: float) -> RingGrid:
    grid = RingGrid(size, cell_m)
    grid.follow(x_m, y_m)
    return grid


@given(x=st.floats(-9, 9), y=st.floats(-9, 9), to=st.tuples(*[st.floats(-7, 7)] * 2))
def test_a_place_has_the_index_that_its_window_says(
    x: float, y: float, to: tuple[float, float]
) -> None:
    grid = moved(41, 0.2, *to)
    i, j = grid.cell_of(x, y)
    inside = 0 <= i - grid.corner_i < 41 and 0 <= j - grid.corner_j < 41
    expected = (j % 41) * 41 + i % 41 if inside else -1
    assert cell_at(x, y, grid.ring) == index_of(i, j, grid.ring) == expected


@pytest.mark.parametrize("edge", [-1, 41])
def test_just_outside_of_the_window_there_is_no_cell(edge: int) -> None:
    ring = moved(41, 0.2, 2.7, 6.3).ring
    low_i, low_j = ring.corner_i, ring.corner_j
    assert index_of(low_i + edge, low_j, ring) == index_of(low_i, low_j + edge, ring) == -1
    assert index_of(low_i, low_j, ring) >= 0
    assert index_of(low_i + 40, low_j + 40, ring) >= 0


def test_an_index_is_that_of_one_world_cell() -> None:
    ring = moved(41, 0.2, 2.7, 6.3).ring
    for di, dj in ((0, 0), (7, 0), (40, 40), (12, 29)):
        i, j = ring.corner_i + di, ring.corner_j + dj
        assert world_cell(index_of(i, j, ring), ring) == (i, j)
