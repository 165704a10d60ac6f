"""A saved map goes on as the same map, and believes nothing that it can't know."""

import numpy as np
import numpy.typing as npt
import pytest

from config_file import load_config, with_changes
from core.config import Config
from core.mapping.mapper import Mapper
from core.mapping.paper.maps import ReferencePlaneMaps
from core.records import FREE, OBSTACLE, UNKNOWN, WheelCounts
from core.saved.encoding import Arrays, StateError
from core.saved.state import restore, state_of, was_moving
from tests import ROOT
from tests.core.mapping.test_mapper import wall_and_floor
from tests.core.motion.test_attitude import attitude

SHIPPED = load_config((ROOT / "mapod.toml").read_text(encoding="utf-8"))
END_S, LATER_S = 2.0, 5000.0
METHODS = ("surface", "reference_plane", "certainty")


def config_of(method: str = "surface") -> Config:
    return with_changes(SHIPPED, map={"method": method})


def stand(
    mapper: Mapper, from_s: float, yaw_rad: float = 0.0, wall_m: float = 5.0, scans: int = 30
) -> Mapper:
    """Let a mapper's robot stand for 2 s, and scan the room."""
    for k in range(round(END_S * 100) + 5):
        mapper.add_attitude(attitude(from_s + 0.01 * k, yaw=yaw_rad))
        if k % 5 == 0:
            mapper.add_counts(WheelCounts(from_s + 0.01 * k, 0.0, 0.0, 0))
    for k in range(scans):
        mapper.add_scan(wall_and_floor(from_s + 0.1 + 0.04 * k, wall_m))
        assert mapper.settle(from_s + END_S) == 1
    mapper.settle(from_s + END_S)
    return mapper


def saved(method: str = "surface", yaw_rad: float = 0.0) -> Arrays:
    """The state of a robot that has seen the room."""
    config = config_of(method)
    return state_of(stand(Mapper(config), 0.0, yaw_rad), config, END_S)


def loaded(arrays: Arrays, method: str = "surface") -> Mapper:
    config = config_of(method)
    mapper = Mapper(config)
    restore(mapper, arrays, config, LATER_S)
    return mapper


STATE = {method: saved(method) for method in METHODS}


def states(mapper: Mapper) -> npt.NDArray[np.int8]:
    return mapper.maps.window.cells


@pytest.mark.parametrize("method", METHODS)
def test_obstacles_are_kept_and_what_was_free_is_unknown(method: str) -> None:
    before = STATE[method]["window.cells"]
    assert (before == OBSTACLE).sum() > 5
    # a line of floor has nothing beside it that `certainty` could hold it against
    assert method == "certainty" or (before == FREE).sum() > 50
    mapper = loaded(STATE[method], method)
    expected = np.where(before == OBSTACLE, OBSTACLE, UNKNOWN)
    np.testing.assert_array_equal(states(mapper), expected)
    window = mapper.window(True)
    np.testing.assert_array_equal(np.sort(window.changed), np.flatnonzero(before == OBSTACLE))
    assert window.epoch > int(STATE[method]["window.epoch"])
    assert mapper.continued
    assert not Mapper(config_of(method)).continued
    if isinstance(mapper.maps, ReferencePlaneMaps):
        grid, arrays = mapper.maps.plane.grid, STATE[method]
        np.testing.assert_array_equal(grid.average_m, arrays["plane.average_m"])
        np.testing.assert_array_equal(grid.count, arrays["plane.count"])
        assert not (grid.states == FREE).any()


@pytest.mark.parametrize("method", METHODS)
def test_a_run_goes_on_in_the_same_map_when_the_robot_stands_where_it_stood(method: str) -> None:
    arrays = saved(method, yaw_rad=0.3)
    arrays["pose"][:] = 0.5, -0.25, 0.125, 1.0
    arrays["travel_m"] = np.array(7.0)
    mapper = stand(loaded(arrays, method), LATER_S, yaw_rad=-2.0, scans=0)
    pose = mapper.maybe_pose(LATER_S + END_S)
    assert pose is not None
    assert (pose.x_m, pose.y_m) == pytest.approx((0.5, -0.25))
    assert pose.yaw_rad == pytest.approx(1.0)
    assert mapper.odometry.place_at(LATER_S + END_S)[2] == pytest.approx(0.125)
    assert mapper.odometry.travel_m == pytest.approx(7.0)


@pytest.mark.parametrize("method", METHODS)
def test_what_is_seen_again_is_free_again_and_nothing_else(method: str) -> None:
    mapper = stand(loaded(STATE[method], method), LATER_S)
    fresh = stand(Mapper(config_of(method)), LATER_S)
    before = STATE[method]["window.cells"]
    assert (states(mapper)[states(fresh) == OBSTACLE] == OBSTACLE).all()
    assert (states(fresh)[states(mapper) == FREE] == FREE).all()
    again = (states(fresh) == FREE) & (before == FREE)
    if method == "reference_plane":  # `surface` wants to see more of a cell than one line of it
        assert (states(mapper)[again] == FREE).all()


def test_a_wall_that_has_come_meanwhile_is_an_obstacle_at_once() -> None:
    mapper = stand(loaded(STATE["surface"]), LATER_S, wall_m=3.0, scans=3)
    fresh = stand(Mapper(config_of()), LATER_S, wall_m=3.0, scans=3)
    new = states(fresh) == OBSTACLE
    assert new.sum() > 5
    assert (states(mapper)[new] == OBSTACLE).all()


def test_a_loaded_map_of_which_nothing_was_seen_again_can_be_saved_again() -> None:
    config, old = config_of(), STATE["surface"]
    mapper = stand(loaded(old), LATER_S, scans=0)
    again = state_of(mapper, config, LATER_S + END_S)
    anew = {"cells.floor_s", "cells.tied", "window.cells", "window.epoch", "pose"}
    for name in old.keys() - anew:
        np.testing.assert_array_equal(again[name], old[name])
    assert ((again["window.cells"] == OBSTACLE) == (old["window.cells"] == OBSTACLE)).all()
    restore(Mapper(config), again, config, 0.0)


def test_without_a_pose_nothing_is_saved_and_a_run_that_has_begun_goes_on_from_nothing() -> None:
    config = config_of()
    with pytest.raises(StateError, match="pose is not known"):
        state_of(Mapper(config), config, 0.0)
    with pytest.raises(StateError, match="pose is not known"):
        state_of(stand(Mapper(config), 0.0), config, END_S + 10.0)
    with pytest.raises(ValueError, match="begun"):
        restore(stand(Mapper(config), 0.0), STATE["surface"], config, LATER_S)
    assert not was_moving(STATE["surface"])
    assert was_moving({**STATE["surface"], "motion": np.array([0.3, 0.0])})
