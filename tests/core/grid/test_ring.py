"""RingGrid against a slow and obvious model: a dict from world cells to values."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from core.grid.ring import HYSTERESIS_CELLS, RingGrid, cells_about

PAIR = np.dtype([("number", np.int64), ("share", np.float64)])
BLANK = np.array((-7, 2.5), dtype=PAIR)
STEPS = st.lists(
    st.tuples(st.floats(-4, 4), st.floats(-4, 4), st.integers(1, 9)), min_size=1, max_size=30
)


@given(steps=STEPS, size=st.integers(3, 12))
def test_cells_live_on_while_the_window_covers_them_and_enter_blank(
    steps: list[tuple[float, float, int]], size: int
) -> None:
    grid = RingGrid(size, 0.25)
    layer, records = grid.layer(int, 0), grid.layer(PAIR, BLANK)
    model: dict[tuple[int, int], int] = {}
    x = y = 0.0
    for dx, dy, value in steps:
        x, y = x + dx, y + dy
        grid.follow(x, y)
        covered = {
            (i, j)
            for i in range(grid.corner_i, grid.corner_i + size)
            for j in range(grid.corner_j, grid.corner_j + size)
        }
        model = {cell: value for cell, value in model.items() if cell in covered}
        i, j = grid.cell_of(x, y)
        if (i, j) in covered:
            layer[j % size, i % size] = model[i, j] = value
            records[j % size, i % size] = (value, 0.5)
        for i, j in covered:
            assert layer[j % size, i % size] == model.get((i, j), 0)
            pair = records[j % size, i % size].item()
            assert pair == ((model[i, j], 0.5) if (i, j) in model else BLANK.item())


@given(x=st.floats(-100, 100), y=st.floats(-100, 100))
def test_the_robot_is_never_further_off_centre_than_the_hysteresis(x: float, y: float) -> None:
    grid = RingGrid(21, 0.2)
    for share in (0.1, 0.5, 0.51, 1.0):
        grid.follow(x * share, y * share)
        i, j = grid.cell_of(x * share, y * share)
        assert abs(i - grid.corner_i - 10) <= HYSTERESIS_CELLS
        assert abs(j - grid.corner_j - 10) <= HYSTERESIS_CELLS


def test_hovering_on_a_cell_edge_does_not_move_the_window() -> None:
    grid = RingGrid(21, 0.2)
    grid.follow(1.0, 0.0)
    corner = grid.corner_i
    moved = [grid.follow(1.0 + dx, 0.0) for dx in (-0.01, 0.01, -0.3, 0.3)]
    assert moved == [False] * 4
    assert grid.corner_i == corner
    assert grid.cell_of(-0.1, 0.1) == (-1, 0)


def test_the_cells_about_a_place_are_a_square_that_holds_all_within_reach() -> None:
    assert cells_about(0.3, -0.1, 2.0, 0.2) == (-9, -11, 21)
    assert cells_about(0.05, 0.05, 0.05, 0.125) == (0, 0, 2)
