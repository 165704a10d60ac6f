"""One obstacle map of two sensors: which cells it shows, against an obvious model."""

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.grid.window import ObstacleWindow
from core.mapping.combined import CombinedMaps, _combine, states_of
from core.mapping.mapper import Mapper
from core.records import FREE, OBSTACLE, UNKNOWN, PointSweep
from tests.support.robot.depth_loop import with_camera

SIZE, CELL_M = 7, 0.2
Cells = dict[tuple[int, int], int]


def window(corner: tuple[int, int], states: list[int]) -> tuple[ObstacleWindow, Cells]:
    """One with these cells, and the same as a dict of world cells."""
    made, model = ObstacleWindow(SIZE, CELL_M), Cells()
    made.grid.corner_i, made.grid.corner_j = corner
    for k, state in enumerate(states):
        i, j = corner[0] + k % SIZE, corner[1] + k // SIZE
        made.cells[j % SIZE, i % SIZE] = model[i, j] = state
    return made, model


CORNERS = st.tuples(st.integers(-4, 3), st.integers(-4, 3))
STATES = st.lists(st.sampled_from([OBSTACLE, UNKNOWN, FREE]), min_size=SIZE**2, max_size=SIZE**2)
STANDING = st.lists(st.tuples(st.integers(-6, 8), st.integers(-6, 8)), max_size=5)


@settings(max_examples=60, deadline=None)
@given(CORNERS, CORNERS, STATES, STATES, STATES, STANDING, st.booleans())
def test_a_cell_is_what_both_sensors_allow(
    at: tuple[int, int], camera_at: tuple[int, int], scanned: list[int], seen: list[int],
    before: list[int], standing: list[tuple[int, int]], frees: bool,
) -> None:  # fmt: skip
    one, laser = window(at, scanned)
    other, camera = window(camera_at, seen)
    shown, was = window(at, before)
    mask = np.zeros(SIZE**2, np.int8)
    cells = np.array(standing, np.int64).reshape(-1, 2)
    used = _combine(one.shown, other.shown, frees, cells, mask, shown.shown, 0)
    for place, state in laser.items():
        says = {state, camera.get(place, UNKNOWN)}
        expected = UNKNOWN
        if OBSTACLE in says or place in standing:
            expected = OBSTACLE
        elif state == FREE or (FREE in says and frees):
            expected = FREE
        i, j = place
        assert shown.cells[j % SIZE, i % SIZE] == expected
    changed = {(i % SIZE, j % SIZE) for i, j in was if shown.cells[j % SIZE, i % SIZE] != was[i, j]}
    assert {(int(k) % SIZE, int(k) // SIZE) for k in shown.changed[:used]} == changed
    assert not mask.any()


def test_a_cause_explains_what_is_shown_though_neither_map_says_it_any_more() -> None:
    maps = Mapper(with_camera()).maps
    assert isinstance(maps, CombinedMaps)
    grid = maps.window.grid
    states = [OBSTACLE, FREE, UNKNOWN]
    for k, state in enumerate(states):
        maps.window.cells[0, k % grid.size] = state
    i: npt.NDArray[np.int64] = np.arange(3)
    assert states_of(maps.causes(i, np.zeros(3, np.int64))).tolist() == states


def test_a_frame_is_not_mapped_where_nobody_knows_its_place_and_is_bounded() -> None:
    mapper = Mapper(with_camera())
    n = 4000
    rays = np.tile([1.0, 0.0, 0.0], (n, 1))
    sweep = PointSweep(np.zeros((n, 3)), rays, np.ones((1, n)), np.zeros(n), 0, 0.0)
    assert not mapper.add_frame(sweep, np.zeros((0, 2), np.int64))
    assert isinstance(mapper.maps, CombinedMaps)
    with pytest.raises(ValueError, match="1 to 3072 beams, this one 1 x 4000 ranges"):
        mapper.maps.add_frame(sweep, np.zeros((0, 2), np.int64), mapper.attitudes, mapper.odometry)
