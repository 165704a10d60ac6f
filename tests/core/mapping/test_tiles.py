"""Pieces of the map for who asks, against the whole layers that tools see."""

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from config_file import load_config, with_changes
from core.mapping.tiles import TileValues
from core.records import FREE, OBSTACLE
from tests import ROOT
from tests.support.cases import examples
from tests.support.closed_loop import ClosedLoop

LAYERS = ("state", "height", "variance", "slope")
F32 = npt.NDArray[np.float32]


@pytest.fixture(scope="module", params=["beams", "reference_plane"])
def driven(request: pytest.FixtureRequest) -> ClosedLoop:
    shipped = load_config((ROOT / "mapod.toml").read_text(encoding="utf-8"))
    loop = ClosedLoop(with_changes(shipped, map={"method": request.param}))
    loop.run(4.0)
    return loop


def expected(loop: ClosedLoop, layer: str, i: int, j: int, width: int, height: int) -> F32:
    """(height * width,) from a whole layer."""
    view = loop.app.mapper.maybe_layer(layer)
    assert view is not None
    rows, columns = view.values.shape
    cells = np.full((height, width), np.nan, np.float32)
    for row in range(height):
        for column in range(width):
            u, v = i + column - view.corner_i, j + row - view.corner_j
            if 0 <= u < columns and 0 <= v < rows:
                cells[row, column] = view.values[v, u]
    return cells.ravel()


@settings(max_examples=examples(25))
@given(
    st.integers(-70, 70),
    st.integers(-70, 70),
    st.integers(1, 30),
    st.integers(1, 9),
    st.data(),
)
def test_a_piece_holds_what_the_whole_layer_holds(
    driven: ClosedLoop, i: int, j: int, width: int, height: int, data: st.DataObject
) -> None:
    first = data.draw(st.integers(0, width * height - 1))
    count = data.draw(st.integers(1, width * height - first))
    tiles = TileValues(driven.app.mapper.maps)
    tiles.trusted = True
    for layer in LAYERS:
        piece = tiles.values(layer, i, j, width, first, count)
        if driven.app.mapper.maybe_layer(layer) is None:
            assert piece is None
            continue
        assert piece is not None
        whole = expected(driven, layer, i, j, width, height)
        if layer == "variance":
            whole[whole == 0.0] = np.nan  # a single return tells none
        np.testing.assert_array_equal(piece, whole[first : first + count])


def test_what_is_not_trusted_tells_of_obstacles_alone(driven: ClosedLoop) -> None:
    tiles, grid = TileValues(driven.app.mapper.maps), driven.app.mapper.maps.window.grid
    rectangle = (grid.corner_i, grid.corner_j, grid.size, 0, grid.size**2)
    tiles.trusted = True
    states = tiles.values("state", *rectangle)
    assert states is not None
    assert {OBSTACLE, FREE} <= set(states[~np.isnan(states)])
    tiles.trusted = False
    for layer in LAYERS:
        held = tiles.values(layer, *rectangle)
        if held is not None:
            assert np.isnan(held[states != OBSTACLE]).all()
            assert not np.isnan(held[states == OBSTACLE]).all()


def test_there_are_no_other_layers(driven: ClosedLoop) -> None:
    assert TileValues(driven.app.mapper.maps).values("colour", 0, 0, 3, 0, 9) is None
