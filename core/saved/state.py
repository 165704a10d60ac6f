"""The whole state of a map as named arrays, and a map that goes on from them.

A loaded map is not believed as the same map is within a run: nobody saw what moved meanwhile.
- What was an obstacle is one until beams pass through it, as ever.
- What was free is unknown until this run has seen its floor; `surface` begins anew with all ground.
- The map frame goes on from the saved pose. So the robot must stand where it stood when the map was
  saved; nothing here can tell. Where it does not, obstacles lie wrong, but free does not.
- Method `certainty` begins anew with all its cells: only the obstacles of its window are kept.
- Method `reference_plane` counts yaw, displacement and its plane anew, as it does at a restart.
Numbers of the run itself (scans added and dropped, ages) are not part of the state.
"""

from typing import TYPE_CHECKING, cast

import numpy as np

from core.config import Config
from core.grid.window import ObstacleWindow
from core.mapping.mapper import Mapper
from core.records import FREE, OBSTACLE, UNKNOWN
from core.saved.check import FORMAT, VERSION, check_state, settings_of
from core.saved.encoding import Arrays, StateError
from core.saved.surface import into_surface, of_surface

if TYPE_CHECKING:
    from core.mapping.certainty.maps import CertaintyMaps
    from core.mapping.paper.maps import ReferencePlaneMaps
    from core.mapping.surface.maps import SurfaceMaps

STILL = 0.02  # m/s and rad/s


def state_of(mapper: Mapper, config: Config, now_s: float) -> Arrays:
    """All that a map needs to go on, as copies.

    Args:
        now_s: host clock; the pose is that of now.

    Raises:
        StateError: the pose is not known, so that nobody could go on from it.
    """
    pose = mapper.maybe_pose(now_s)
    if pose is None:
        raise StateError("the robot's pose is not known now")
    _, _, z_m, travel_m = mapper.odometry.place_at(now_s)
    maps, method = mapper.scanned, config.map.method
    arrays: Arrays = {
        "format": np.array(FORMAT),
        "version": np.array(VERSION, dtype=np.int64),
        "settings": np.array(settings_of(config)),
        "pose": np.array([pose.x_m, pose.y_m, z_m, pose.yaw_rad]),
        "travel_m": np.array(travel_m),
        "motion": np.array([mapper.odometry.v_mps, mapper.odometry.w_radps]),
        **_of_window(maps.window),
    }
    if method == "surface":
        arrays |= of_surface(cast("SurfaceMaps", maps), now_s)
    elif method == "reference_plane":
        grid = cast("ReferencePlaneMaps", maps).plane.grid
        arrays["plane.average_m"] = grid.average_m.copy()
        arrays["plane.count"] = grid.count.copy()
        arrays["plane.states"] = grid.states.copy()
    check_state(arrays, config)
    return arrays


def _of_window(window: ObstacleWindow) -> Arrays:
    corner = window.grid.corner_i, window.grid.corner_j
    return {
        "window.corner": np.array(corner, dtype=np.int64),
        "window.epoch": np.array(window.epoch, dtype=np.int64),
        "window.cells": window.cells.copy(),
    }


def restore(mapper: Mapper, arrays: Arrays, config: Config, now_s: float) -> None:
    """Let a new mapper, that has taken nothing yet, go on from a state.

    Raises:
        StateError: the state can't be true, or was made with other settings; nothing is changed.
    """
    if mapper.odometry.started or mapper.counts.scans_added:
        raise ValueError("a mapper that has begun can't go on from another state")
    check_state(arrays, config)
    x_m, y_m, z_m, yaw_rad = (float(part) for part in arrays["pose"])
    mapper.go_on_from(np.array([x_m, y_m, z_m]), yaw_rad, float(arrays["travel_m"]))
    maps, method = mapper.scanned, config.map.method
    if method == "surface":
        into_surface(cast("SurfaceMaps", maps), arrays, now_s)
    elif method == "reference_plane":
        grid, states = cast("ReferencePlaneMaps", maps).plane.grid, arrays["plane.states"]
        grid.average_m[...] = arrays["plane.average_m"]
        grid.count[...] = arrays["plane.count"]
        grid.states[...] = np.where(states == FREE, UNKNOWN, states)
    _into_window(maps.window, arrays)
    if method == "certainty":
        corner = maps.window.grid.corner_i, maps.window.grid.corner_j
        cast("CertaintyMaps", maps).go_on_from(*corner)


def _into_window(window: ObstacleWindow, arrays: Arrays) -> None:
    """Its obstacles, as changes that are still to be told; nothing told before holds."""
    window.erase()
    window.epoch = int(arrays["window.epoch"]) + 1
    window.grid.corner_i, window.grid.corner_j = (int(part) for part in arrays["window.corner"])
    at = np.flatnonzero(arrays["window.cells"] == OBSTACLE).astype(np.int32)
    window.put(at, np.full(at.size, OBSTACLE, dtype=np.int8))


def was_moving(arrays: Arrays) -> bool:
    """Whether the robot moved when it was saved: then it stands elsewhere by now."""
    return bool(np.abs(arrays["motion"]).max() > STILL)
