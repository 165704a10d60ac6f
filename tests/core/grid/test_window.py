"""The planner's window: what is put in is there, told once, and moves with the robot."""

import itertools

import numpy as np
from hypothesis import example, given
from hypothesis import strategies as st

from core.grid.ring import RingGrid
from core.grid.window import ObstacleWindow
from core.records import FREE, OBSTACLE, UNKNOWN

STATES = st.sampled_from([OBSTACLE, UNKNOWN, FREE])
SIZE = 7
PUTS = st.lists(
    st.one_of(
        st.lists(st.tuples(st.integers(0, SIZE**2 - 1), STATES), max_size=12),
        st.just("take"),
        st.just("erase"),
    ),
    max_size=20,
)


def put(window: ObstacleWindow, cells: list[tuple[int, int]]) -> None:
    """Set (flat index, state) pairs, in order."""
    window.put(
        np.array([at for at, _ in cells], dtype=np.int32),
        np.array([state for _, state in cells], dtype=np.int8),
    )


def cells_of(window: ObstacleWindow) -> set[tuple[int, int]]:
    """The world cells that it covers."""
    i, j = window.grid.corner_i, window.grid.corner_j
    return set(itertools.product(range(i, i + SIZE), range(j, j + SIZE)))


@given(steps=PUTS)
def test_cells_and_changes_equal_a_slow_model(steps: list[list[tuple[int, int]] | str]) -> None:
    window = ObstacleWindow(SIZE, 0.2)
    model, changed, epoch = [UNKNOWN] * SIZE**2, set[int](), 0
    for step in steps:
        if step == "erase":
            window.erase()
            model, epoch = [UNKNOWN] * SIZE**2, epoch + 1
            changed.clear()
        elif isinstance(step, str):
            taken = window.take_changed().tolist()
            assert len(taken) == len(set(taken))
            assert set(taken) == changed
            changed.clear()
        else:
            put(window, step)
            for at, state in step:
                if model[at] != state:
                    model[at] = state
                    changed.add(at)
        assert window.cells.ravel().tolist() == model
        assert window.epoch == epoch


def test_a_cell_lies_where_the_ring_says() -> None:
    window = ObstacleWindow(SIZE, 0.2)
    i, j = window.grid.cell_of(0.5, -0.3)
    assert (i, j) == (2, -2)
    put(window, [((j % SIZE) * SIZE + i % SIZE, OBSTACLE)])
    assert window.cells[j % SIZE, i % SIZE] == OBSTACLE
    assert int(np.count_nonzero(window.cells)) == 1


def test_what_stays_in_view_stays_and_what_enters_is_unknown() -> None:
    window = ObstacleWindow(SIZE, 0.2)
    window.cells[...] = FREE
    put(window, [(0 * SIZE + 3, OBSTACLE)])  # world cell (3, 0)
    assert not window.follow(0.3, 0.0)  # within the hysteresis
    assert window.follow(0.9, 0.0)
    assert window.grid.corner_i == 1
    assert window.cells[0, 3] == OBSTACLE
    entered = [i for i in range(window.grid.corner_i, window.grid.corner_i + SIZE) if i > 3]
    assert len(entered) == 4
    assert all(window.cells[:, i % SIZE].max() == UNKNOWN for i in entered)


@given(
    source_size=st.integers(SIZE, SIZE + 6),
    steps=st.lists(st.tuples(st.floats(-4, 4), st.floats(-4, 4)), min_size=1, max_size=4),
)
@example(source_size=SIZE, steps=[(2.0, 0.0)])  # it moves, and the source knows no more
@example(source_size=SIZE + 3, steps=[(0.9, 0.9)])  # some cells come in, others stay
@example(source_size=SIZE + 3, steps=[(-0.9, -0.9)])
def test_what_comes_in_is_told_by_its_place_in_the_source(
    source_size: int, steps: list[tuple[float, float]]
) -> None:
    window, source = ObstacleWindow(SIZE, 0.2), RingGrid(source_size, 0.2)
    for x_m, y_m in steps:
        before = cells_of(window)
        source.follow(x_m, y_m)
        came_in = window.follow_in(source, x_m, y_m)
        wanted = cells_of(window) - before if source_size > SIZE else set()
        flat = {(j % source_size) * source_size + i % source_size for i, j in wanted}
        assert set(came_in.tolist()) == flat


def test_no_obstacle_is_told_outside_of_the_window() -> None:
    window = ObstacleWindow(SIZE, 0.2)
    put(window, [(at, OBSTACLE) for at in range(SIZE**2)] + [(1 * SIZE + 2, FREE)])
    around = itertools.product(range(-9, 10), repeat=2)
    assert {at for at in around if window.is_obstacle(*at)} == cells_of(window) - {(2, 1)}


def test_an_erased_window_has_nothing_to_tell_but_its_epoch() -> None:
    window = ObstacleWindow(SIZE, 0.2)
    put(window, [(5, FREE), (6, OBSTACLE)])
    window.erase()
    assert window.epoch == 1
    assert len(window.take_changed()) == 0
    put(window, [(5, FREE)])
    assert window.take_changed().tolist() == [5]


def test_a_change_back_and_forth_is_told_once() -> None:
    window = ObstacleWindow(SIZE, 0.2)
    put(window, [(5, FREE), (5, OBSTACLE), (5, FREE)])
    put(window, [(5, OBSTACLE)])
    assert window.take_changed().tolist() == [5]
    assert window.take_changed().tolist() == []
