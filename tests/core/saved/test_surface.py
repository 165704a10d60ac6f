"""A saved map of method `surface` goes on, and believes nothing that it can't know."""

from collections.abc import Callable

import numpy as np
import pytest

from core.mapping.causes import UNSEEN
from core.mapping.mapper import Mapper
from core.mapping.surface.maps import SurfaceMaps
from core.records import FREE, OBSTACLE, UNKNOWN
from core.saved.encoding import Arrays, StateError, arrays_from_bytes, bytes_from_arrays
from core.saved.state import restore, state_of
from core.saved.surface import KEPT
from tests.support.maps.flat_ride import Ride, Rig, config_of, places_where, state_at
from tests.support.maps.flat_world import Box, Profile, World, ditch, kerb

CONFIG = config_of()
LATER_S = 5000.0


@pytest.fixture(scope="module")
def rig() -> Rig:
    """It has driven towards a box and stands."""
    world = World(solids=(Box((9.0, -0.5, 0.0), (9.6, 0.5, 0.5)),))
    return Rig(CONFIG, world, Ride(v_mps=1.0), 4.0).run()


@pytest.fixture
def arrays(rig: Rig) -> Arrays:
    return arrays_from_bytes(bytes_from_arrays(state_of(rig.mapper, CONFIG, rig.now_s)))


def loaded(arrays: Arrays) -> tuple[Mapper, SurfaceMaps]:
    mapper = Mapper(CONFIG)
    restore(mapper, arrays, CONFIG, LATER_S)
    assert isinstance(mapper.maps, SurfaceMaps)
    return mapper, mapper.maps


def test_obstacles_are_kept_and_what_was_free_is_unknown_until_its_floor_is_met(
    rig: Rig, arrays: Arrays
) -> None:
    before = arrays["window.cells"]
    assert (before == OBSTACLE).sum() > 5
    assert (before == FREE).sum() > 500
    _, maps = loaded(arrays)
    expected = np.where(before == OBSTACLE, OBSTACLE, UNKNOWN)
    np.testing.assert_array_equal(maps.window.cells, expected)
    was = rig.mapper.maps
    assert isinstance(was, SurfaceMaps)
    stands = maps.cells["stands"] > 0.0
    assert stands.sum() > 5
    np.testing.assert_allclose(maps.heights_m()[stands], was.heights_m()[stands], atol=1e-12)
    size, grid = before.shape[0], maps.window.grid
    row, column = np.argwhere(before == FREE)[0]
    i = grid.corner_i + (column - grid.corner_i) % size
    j = grid.corner_j + (row - grid.corner_j) % size
    maps.fresh.follow(LATER_S, 0.0, 0.0, (1.0, 0.0))
    assert maps.causes(np.array([i]), np.array([j])) == UNSEEN


def test_a_run_that_goes_on_from_it_tells_free_what_it_sees_again_and_nothing_else(
    rig: Rig, arrays: Arrays
) -> None:
    x_m = rig.place()[0]
    box = Box((9.0 - x_m, -0.5, 0.0), (9.6 - x_m, 0.5, 0.5))  # where it stands from here
    on = Rig(CONFIG, World(solids=(box,)), Ride(v_mps=1.0), 3.0)
    restore(on.mapper, arrays, CONFIG, 0.0)
    on.run()
    free, hard = places_where(on, FREE), places_where(on, OBSTACLE)
    assert len(free) > 500
    assert (free[:, 0] > x_m + 8.3).all()  # it meets no floor nearer than that
    assert not ((free[:, 0] > 9.1) & (free[:, 0] < 9.5) & (np.abs(free[:, 1]) < 0.4)).any()
    assert ((np.abs(hard[:, 0] - 9.1) < 0.2) & (np.abs(hard[:, 1]) < 0.4)).sum() >= 4


def test_what_has_gone_meanwhile_is_unknown_until_its_floor_is_met(arrays: Arrays) -> None:
    """It stands where it stood for a second, and then backs until its sweep meets that floor."""
    on, states, lanes_m = Rig(CONFIG, World(), Ride(v_mps=-1.0, start_s=1.0), 5.2), [], (-0.3, 0.1)
    restore(on.mapper, arrays, CONFIG, 0.0)
    for now_s in on.drive():
        told = {state_at(on, 9.1, lane) for lane in lanes_m}
        assert FREE not in told or now_s > 4.2  # the sweep is at 9.2 m then
        states += [told] if told not in states else []
    assert states[0] == {OBSTACLE}
    assert {UNKNOWN} in states
    assert states[-1] == {FREE}


@pytest.fixture(scope="module")
def floor() -> tuple[Arrays, float]:
    """What a robot saw that backed over a flat floor; and where it stands then."""
    rig = Rig(CONFIG, World(), Ride(v_mps=-1.0), 4.0).run()
    return state_of(rig.mapper, CONFIG, rig.now_s), rig.place()[0]


HOLES = [
    (ditch, 6.05, 0.6),
    (ditch, 6.05, 1.5),
    (kerb, 6.05, -0.2),
    (kerb, 6.05, -1.0),
    (ditch, 6.05, 0.3),
    (ditch, 6.1, 0.3),
]


@pytest.mark.parametrize(("hole", "near_m", "size_m"), HOLES)
def test_no_way_is_free_over_a_hole_that_has_come_where_an_earlier_run_saw_floor(
    floor: tuple[Arrays, float],
    hole: Callable[[float, float], Profile],
    near_m: float,
    size_m: float,
) -> None:
    arrays, x_m = floor
    on = Rig(CONFIG, World(hole(near_m - x_m, size_m)), Ride(v_mps=1.0), 5.0)
    restore(on.mapper, arrays, CONFIG, 0.0)
    on.run()
    over_m = np.arange(near_m - 0.5, near_m + abs(size_m) + 0.4, 0.1)
    assert state_at(on, near_m - 0.5, 0.1) == FREE
    for lane in (-0.3, -0.1, 0.1, 0.3):
        assert any(state_at(on, x, lane) != FREE for x in over_m)


@pytest.mark.parametrize("name", KEPT)
def test_what_can_not_be_is_refused(arrays: Arrays, name: str) -> None:
    field = arrays[f"cells.{name}"]
    wrong = field.copy()
    wrong[0] = np.nan if field.dtype.kind == "f" else 0xFF
    bads = [(wrong, "can't be"), (field[:-1], "has")]
    for bad, words in bads[1 if name == "looks" else 0 :]:  # it can be any number
        with pytest.raises(StateError, match=rf"cells\.{name}.*{words}"):
            loaded({**arrays, f"cells.{name}": bad})
