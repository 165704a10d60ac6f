"""Pieces of the map for who asks, against the whole layers that tools see."""

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from config_file import load_config, with_changes
from core.mapping.causes import CAUSES, FLOOR, NO_SCANS, OUTSIDE, state_of
from core.mapping.footing import FOOTING
from core.mapping.layers import FILL
from core.mapping.tiles import MOST_POINTS, TileValues
from core.records import FREE, OBSTACLE, Scan
from tests import ROOT
from tests.support.cases import examples
from tests.support.robot.closed_loop import START_S, ClosedLoop

LAYERS = ("state", "height", "variance", "slope", "z", *FOOTING, *FILL)
F32 = npt.NDArray[np.float32]


@pytest.fixture(scope="module", params=["surface", "reference_plane", "certainty"])
def driven(request: pytest.FixtureRequest) -> ClosedLoop:
    shipped = load_config((ROOT / "mapod.toml").read_text(encoding="utf-8"))
    loop = ClosedLoop(with_changes(shipped, map={"method": request.param}))
    loop.run(6.0)
    return loop


def values_of(loop: ClosedLoop) -> TileValues:
    """Of a map that is trusted, as of the newest scan."""
    tiles = TileValues(loop.app.mapper, loop.config.scanner)
    tiles.now_s, tiles.doubt = loop.app.mapper.newest_scan_s, 0
    return tiles


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
    tiles = values_of(driven)
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
    tiles, grid = values_of(driven), driven.app.mapper.maps.window.grid
    rectangle = (grid.corner_i, grid.corner_j, grid.size, 0, grid.size**2)
    states = tiles.values("state", *rectangle)
    assert states is not None
    assert {OBSTACLE, FREE} <= set(states[~np.isnan(states)])
    tiles.doubt = NO_SCANS
    for layer in LAYERS:
        held = tiles.values(layer, *rectangle)
        if held is not None:
            assert np.isnan(held[states != OBSTACLE]).all()
            if layer in (
                *FOOTING,
                *FILL,
            ):  # "there a foot can stand" says more than an obstacle does
                assert np.isnan(held).all()
            elif layer != "slope":  # the ground under what stands was not seen
                assert not np.isnan(held[states == OBSTACLE]).all()
    causes, ages = tiles.values("cause", *rectangle), tiles.values("age", *rectangle)
    assert causes is not None
    assert ages is not None
    assert set(causes[states != OBSTACLE]) == {NO_SCANS}
    assert {state_of(int(cause)) for cause in causes[states == OBSTACLE]} == {OBSTACLE}
    assert np.isnan(ages[states != OBSTACLE]).all()
    assert tiles.maybe_scan() is None


def test_there_are_no_other_layers(driven: ClosedLoop) -> None:
    assert values_of(driven).values("colour", 0, 0, 3, 0, 9) is None


def test_each_cell_has_the_cause_of_just_the_state_that_is_told(driven: ClosedLoop) -> None:
    tiles, grid = values_of(driven), driven.app.mapper.maps.window.grid
    edge = 3
    rectangle = (grid.corner_i - edge, grid.corner_j - edge, grid.size + 2 * edge)
    count = rectangle[2] ** 2
    states, causes = (tiles.values(name, *rectangle, 0, count) for name in ("state", "cause"))
    assert states is not None
    assert causes is not None
    told = [state_of(int(cause)) for cause in causes]
    np.testing.assert_array_equal(told, np.nan_to_num(states))
    inside = causes.reshape(rectangle[2], -1)[edge:-edge, edge:-edge]
    assert set(inside.ravel()) <= CAUSES.keys()
    assert OUTSIDE not in inside
    assert set(causes) - set(inside.ravel()) == {OUTSIDE}
    assert FLOOR in inside


def test_ages_are_those_of_now_and_unknown_where_no_beam_was(driven: ClosedLoop) -> None:
    tiles, grid = values_of(driven), driven.app.mapper.maps.window.grid
    rectangle = (grid.corner_i, grid.corner_j, grid.size, 0, grid.size**2)
    states, ages = tiles.values("state", *rectangle), tiles.values("age", *rectangle)
    assert states is not None
    assert ages is not None
    assert not np.isnan(ages[states == FREE]).any()
    assert 0.0 <= np.nanmin(ages) < 0.1
    assert np.nanmax(ages) <= driven.now_s - START_S + 0.1
    assert np.isnan(ages).any()
    tiles.now_s += 2.5
    later = tiles.values("age", *rectangle)
    assert later is not None
    np.testing.assert_allclose(later, ages + np.float32(2.5), atol=1e-4)


def test_the_newest_sweep_lies_on_the_walls_of_the_world(driven: ClosedLoop) -> None:
    tiles = values_of(driven)
    sweep = tiles.maybe_scan()
    assert sweep is not None
    assert sweep.t_s == driven.app.mapper.newest_scan_s
    assert 100 < len(sweep.points_m) <= MOST_POINTS
    assert sweep.returns >= len(sweep.points_m)
    x_m, y_m, z_m = sweep.points_m.T
    beside = [(dx, dy) for dx in (-0.08, 0.0, 0.08) for dy in (-0.08, 0.0, 0.08)]
    around_m = np.array([driven.rig.world.height_at(x_m + dx, y_m + dy) for dx, dy in beside])
    lies = (around_m.min(axis=0) < z_m + 0.05) & (z_m - 0.05 < around_m.max(axis=0))
    assert lies.mean() > 0.95
    driven.app.mapper.newest_scan, scan = None, driven.app.mapper.newest_scan
    assert tiles.maybe_scan() is None
    driven.app.mapper.newest_scan = scan


def test_more_returns_than_are_told_are_thinned_out_evenly(driven: ClosedLoop) -> None:
    scan = driven.app.mapper.newest_scan
    assert isinstance(scan, Scan)
    thick = replace(scan, ranges_m=np.concatenate([scan.ranges_m] * 3))
    driven.app.mapper.newest_scan = thick
    sweep = values_of(driven).maybe_scan()
    driven.app.mapper.newest_scan = scan
    assert sweep is not None
    assert len(sweep.points_m) == MOST_POINTS
    assert sweep.returns == 3 * np.isfinite(scan.ranges_m).sum()
