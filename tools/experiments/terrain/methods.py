"""The methods that are compared: settings of each, its map, and what the map tells.

Settings are those of robots/urg04lx.toml, or of robots/ragno.toml for the stripe. Lengths of the
method and heights of obstacles are 0.3 of those in the former, for 3 cm are to these maps what
10 cm are to those; rates are those of the ride.
"""

import math
from typing import Any, NamedTuple

import msgspec
import numpy as np

from config_file import load_config, with_changes
from core.config import Config
from core.mapping.certainty.maps import CertaintyMaps
from core.mapping.layers import maybe_values
from core.mapping.method import Maps
from core.mapping.paper.maps import ReferencePlaneMaps
from core.mapping.surface.maps import SurfaceMaps
from core.records import F64, I64
from tools.cli.options import ROBOTS
from tools.experiments.terrain.ride import PERIOD_S, STEP_M, Gait
from tools.experiments.terrain.sensors import SIDE_DEG, URG_NAME, Mount

CELL_M, CELLS = 0.010, 401
SMALLER = 0.3  # than a driving robot's obstacles
SIGMAS = 3.0 * math.sqrt(2.0)  # of the difference of two scans, at most
LEAST_TURN_RADPS = 0.1  # of a rail, which turns nothing
NOTHING: dict[str, Any] = {
    "min_group": 1,
    "three_scans": False,
    "shadow_deg": 0.0,
    "cas": False,
    "fill": False,
}
STEPS: dict[str, dict[str, Any]] = {  # what each turns on; lengths are scaled
    "groups": {"min_group": 3},
    "three scans": {"three_scans": True},
    "CAS": {"cas": True},
    "shadow filter": {"shadow_deg": 10.0},
}
ALL: dict[str, Any] = {key: value for step in STEPS.values() for key, value in step.items()}
CERTAINTY = {"none": {}, **STEPS, "all": ALL, "all, filled": {**ALL, "fill": True}}
NAMES = (*(f"certainty, {steps}" for steps in CERTAINTY), "surface", "reference_plane")


class Region(NamedTuple):
    """Cells of the map frame: their edges lie on whole cells."""

    x_m: tuple[float, float]
    y_m: tuple[float, float]

    def cells(self) -> tuple[I64, I64]:
        """World indices of its columns (n,) and rows (m,)."""
        i, j = (
            np.arange(round(low / CELL_M), round(high / CELL_M), dtype=np.int64)
            for low, high in self
        )
        return i, j


def _robot(name: str) -> Config:
    return load_config(ROBOTS[name].read_text(encoding="utf-8"))


def settings_of(name: str, mount: Mount, gait: Gait) -> Config:
    """Of a method and what it sees with; ValueError: no method is called so."""
    if name not in NAMES:
        raise ValueError(f"method: must be one of {', '.join(NAMES)}, is {name!r}")
    method, _, steps = name.partition(", ")
    turn_degps = SIGMAS * math.degrees(gait.angle_rad) / PERIOD_S
    swing_radps = 2.0 * math.pi * gait.stride_hz * gait.yaw_rad
    lift_mps = SIGMAS * gait.place_m / PERIOD_S + 4.0 * math.pi * gait.stride_hz * gait.bob_m
    base = _robot("ragno" if mount.is_stripe else "urg04lx")
    urg = {"model": URG_NAME, "from_deg": -SIDE_DEG, "to_deg": SIDE_DEG}
    wide = _robot("urg04lx")
    assert wide.certainty is not None
    lengths = ("group_gap_m", "three_scans_m", "cas_height_m")
    steps_of_certainty = {
        **msgspec.to_builtins(wide.certainty),
        "pitch_degps": max(wide.certainty.pitch_degps, turn_degps),
        "roll_degps": max(wide.certainty.roll_degps, turn_degps),
        "lift_mps": max(wide.certainty.lift_mps, lift_mps),
        **{key: SMALLER * getattr(wide.certainty, key) for key in lengths},
        **NOTHING,
        **CERTAINTY.get(steps, {}),
    }
    return with_changes(
        base,
        robot={
            "max_speed_mps": STEP_M / PERIOD_S,
            "max_turn_radps": max(LEAST_TURN_RADPS, swing_radps + math.radians(turn_degps)),
        },
        scanner={
            **({} if mount.is_stripe else urg),
            "mount_x_m": 0.0,
            "mount_z_m": mount.height_m,
            "mount_tilt_deg": mount.tilt_deg,
        },
        map={"method": method, "cells": CELLS, "cell_m": CELL_M},
        obstacle={
            "h_pos_m": SMALLER * wide.obstacle.h_pos_m,
            "h_neg_m": SMALLER * wide.obstacle.h_neg_m,
            "window_cells": CELLS,
        },
        **({"certainty": steps_of_certainty} if method == "certainty" else {}),
    )


def maps_of(config: Config) -> Maps:
    if config.map.method == "certainty":
        return CertaintyMaps(config)
    return SurfaceMaps(config) if config.map.method == "surface" else ReferencePlaneMaps(config)


def heights_m(maps: Maps, region: Region) -> F64:
    """Heights [j, i] of a region's cells; NaN: not known."""
    i, j = (part.ravel() for part in np.meshgrid(*region.cells()))
    told = maybe_values(maps, "z", i, j)
    if told is None:  # reference_plane has heights over its own plane, which is the floor here
        told = maybe_values(maps, "height", i, j)
    assert told is not None
    return told.reshape([len(part) for part in region.cells()[::-1]])
