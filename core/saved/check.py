"""Whether the arrays of a saved state can be true, and belong to these settings.

Names the first thing that is wrong; repairs nothing, and takes no part of a state for the whole.
"""

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from core.config import Config
from core.records import FREE, OBSTACLE, UNKNOWN
from core.saved import surface
from core.saved.bounds import (
    MOST_CELLS,
    MOST_M,
    MOST_SCANS,
    check_within,
)
from core.saved.encoding import Arrays, StateError

FORMAT, VERSION = "mapod map state", 3
I64, I32, I8, FLOAT = np.dtype(np.int64), np.dtype(np.int32), np.dtype(np.int8), np.dtype(float)

Shapes = dict[str, tuple[np.dtype[Any], tuple[int | None, ...]]]  # None: as many as there are


def settings_of(config: Config) -> list[str]:
    """The settings that a map was made with and can only be used with, as `key=value`."""
    return [
        f"map.method={config.map.method}",
        f"map.cells={config.map.cells}",
        f"map.cell_m={config.map.cell_m!r}",
        f"obstacle.window_cells={config.obstacle.window_cells}",
        f"obstacle.h_pos_m={config.obstacle.h_pos_m!r}",
        f"obstacle.h_neg_m={config.obstacle.h_neg_m!r}",
    ]


def shapes_of(config: Config) -> Shapes:
    """Every array of a state but for its head: type and shape."""
    window, cells = config.obstacle.window_cells, config.map.cells
    shapes: Shapes = {
        "pose": (FLOAT, (4,)),  # x, y, z (m), yaw (rad), map frame
        "travel_m": (FLOAT, ()),  # signed, since the first run's start
        "motion": (FLOAT, (2,)),  # m/s, rad/s, at that instant
        "window.corner": (I64, (2,)),  # world cell i, j
        "window.epoch": (I64, ()),
        "window.cells": (I8, (window, window)),  # as the ring lays them out
    }
    if config.map.method == "reference_plane":
        shapes["plane.average_m"] = (FLOAT, (cells, cells))
        shapes["plane.count"] = (I32, (cells, cells))
        shapes["plane.states"] = (I8, (cells, cells))
        return shapes
    if config.map.method == "certainty":
        return shapes
    return shapes | surface.shapes()


def check_state(arrays: Arrays, config: Config) -> None:
    """Let a state pass that these settings can go on from; StateError says what can't be."""
    _check_head(arrays, config)
    shapes = shapes_of(config)
    foreign = sorted(arrays.keys() - shapes.keys() - {"format", "version", "settings"})
    if foreign:
        raise StateError(f"it holds what this version does not know: {', '.join(foreign)}")
    for name, (dtype, shape) in shapes.items():
        _check_shape(name, arrays.get(name), dtype, shape)
    _check_window(arrays)
    if config.map.method == "reference_plane":
        _check_plane(arrays)
    elif config.map.method == "surface":
        surface.check_surface(arrays, config)


def _check_head(arrays: Arrays, config: Config) -> None:
    kind, version = arrays.get("format"), arrays.get("version")
    if kind is None or kind.shape != () or str(kind) != FORMAT:
        raise StateError("it is no saved map")
    if version is None or version.dtype != I64 or version.shape != ():
        raise StateError("version: is missing or no number")
    if int(version) != VERSION:
        age = "a newer" if int(version) > VERSION else "another"
        raise StateError(f"it is of {age} version, {int(version)}; this one reads {VERSION}")
    settings = arrays.get("settings")
    if settings is None or settings.dtype.kind != "U" or settings.ndim != 1:
        raise StateError("settings: are missing")
    for had, has in zip(settings.tolist(), settings_of(config), strict=False):
        if had != has:
            raise StateError(f"it was made with {had}, the settings say {has}")
    if len(settings) != len(settings_of(config)):
        raise StateError("settings: there are more or fewer than this version compares")


def _check_shape(
    name: str, array: npt.NDArray[Any] | None, dtype: np.dtype[Any], shape: tuple[int | None, ...]
) -> None:
    if array is None:
        raise StateError(f"{name}: is missing")
    if array.dtype != dtype:
        raise StateError(f"{name}: must be of type {dtype}, is {array.dtype}")
    fits = len(array.shape) == len(shape) and all(
        want in (None, has) for has, want in zip(array.shape, shape, strict=True)
    )
    if not fits:
        raise StateError(f"{name}: must have the shape {shape}, has {array.shape}")


def _check_window(arrays: Arrays) -> None:
    check_within("pose", arrays["pose"][:3], -MOST_M, MOST_M)
    check_within("pose", arrays["pose"][3:], -2 * math.pi, 2 * math.pi)
    check_within("travel_m", arrays["travel_m"], -MOST_M, MOST_M)
    check_within("motion", arrays["motion"], -100.0, 100.0)
    check_within("window.corner", arrays["window.corner"], -MOST_CELLS, MOST_CELLS)
    check_within("window.epoch", arrays["window.epoch"], 0, MOST_SCANS)
    check_within("window.cells", arrays["window.cells"], FREE, OBSTACLE)


def _check_plane(arrays: Arrays) -> None:
    """Both maps of method `reference_plane`: heights where something was counted, only there."""
    average_m, count, states = (
        arrays[f"plane.{name}"] for name in ("average_m", "count", "states")
    )
    check_within("plane.count", count, 0, MOST_SCANS)
    check_within("plane.states", states, FREE, OBSTACLE)
    check_within("plane.average_m", average_m[count > 0], -MOST_M, MOST_M)
    if not np.isnan(average_m[count == 0]).all() or (states[count == 0] != UNKNOWN).any():
        raise StateError("plane.average_m: knows of cells in which nothing was counted")
