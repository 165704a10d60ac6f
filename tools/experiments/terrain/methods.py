"""The methods that are compared: settings of each, its map, and what the map tells.

Settings are those of robots/urg04lx.toml, or of robots/ragno.toml for the stripe. Lengths of the
method and heights of obstacles are 0.3 of those in the former, for 3 cm are to these maps what
10 cm are to those; rates are those of the ride.
"""

import math
from functools import cache
from typing import Any, NamedTuple

import msgspec
import numpy as np

from config_file import load_config, with_changes
from core.config import Config
from core.map_settings import Certainty
from core.mapping.certainty.maps import CertaintyMaps
from core.mapping.layers import maybe_values
from core.mapping.method import Maps
from core.mapping.paper.maps import ReferencePlaneMaps
from core.mapping.surface.maps import SurfaceMaps
from core.records import F64, I64
from tools.cli.options import ROBOTS
from tools.experiments.terrain.ride import PERIOD_S, STEP_M, Gait
from tools.experiments.terrain.urg import SIDE_DEG, URG_NAME, Mount

CELLS = 401
SMALLER = 0.3  # than a driving robot's obstacles
SIGMAS = 3.0 * math.sqrt(2.0)  # of the difference of two scans, at most
LEAST_TURN_RADPS = 0.1  # of a rail, which turns nothing
NOTHING: dict[str, Any] = {
    "min_group": 1,
    "three_scans": False,
    "cas": False,
    "fill": False,
}
FILTER = "shadow filter"  # of no method's own
STEPS = {  # settings that each takes from the shipped ones
    "groups": ("min_group",),
    "three scans": ("three_scans",),
    "CAS": ("cas",),
    FILTER: (),
}
OWN = tuple(key for keys in STEPS.values() for key in keys)  # of the paper
CERTAINTY = {"none": (), **STEPS, "its own": OWN, "all": OWN, "all, filled": (*OWN, "fill")}
FILTERED = (FILTER, "all", "all, filled")
LENGTHS = ("group_gap_m", "three_scans_m", "cas_height_m")
SHADED = f"surface, {FILTER}"
NAMES = (*(f"certainty, {steps}" for steps in CERTAINTY), "surface", SHADED, "reference_plane")


class Region(NamedTuple):
    """Cells of the map frame: their edges lie on whole cells."""

    x_m: tuple[float, float]
    y_m: tuple[float, float]
    cell_m: float

    def cells(self) -> tuple[I64, I64]:
        """World indices of its columns (n,) and rows (m,)."""
        i, j = (
            np.arange(round(low / self.cell_m), round(high / self.cell_m), dtype=np.int64)
            for low, high in (self.x_m, self.y_m)
        )
        return i, j


@cache
def _robot(name: str) -> Config:
    return load_config(ROBOTS[name].read_text(encoding="utf-8"))


def _shipped() -> Certainty:
    given = _robot("urg04lx").certainty
    assert given is not None  # the file has it
    return given


def _turn_degps(gait: Gait) -> float:
    """Of roll, pitch and yaw: how fast they seem to change by their errors."""
    return SIGMAS * math.degrees(gait.angle_rad) / PERIOD_S


def _certainty_of(steps: str, gait: Gait) -> dict[str, Any]:
    given, turn_degps = _shipped(), _turn_degps(gait)
    bob_mps = 4.0 * math.pi * gait.stride_hz * gait.bob_m
    return {
        **msgspec.to_builtins(given),
        "pitch_degps": max(given.pitch_degps, turn_degps),
        "roll_degps": max(given.roll_degps, turn_degps),
        "lift_mps": max(given.lift_mps, SIGMAS * gait.place_m / PERIOD_S + bob_mps),
        **{key: SMALLER * getattr(given, key) for key in LENGTHS},
        **NOTHING,
        **{key: getattr(given, key) for key in CERTAINTY[steps]},
    }


def _filter_before(methods: list[str]) -> dict[str, Any]:
    return {**msgspec.to_builtins(_robot("urg04lx").shadow_filter), "methods": methods}


def settings_of(name: str, mount: Mount, gait: Gait, cell_m: float) -> Config:
    """Of a method and what it sees with; ValueError: no method is called so."""
    if name not in NAMES:
        raise ValueError(f"method: must be one of {', '.join(NAMES)}, is {name!r}")
    method, _, steps = name.partition(", ")
    urg = {"model": URG_NAME, "from_deg": -SIDE_DEG, "to_deg": SIDE_DEG}
    swing_radps = 2.0 * math.pi * gait.stride_hz * gait.yaw_rad
    obstacle = _robot("urg04lx").obstacle
    return with_changes(
        _robot("ragno" if mount.is_stripe else "urg04lx"),
        robot={
            "max_speed_mps": STEP_M / PERIOD_S,
            "max_turn_radps": max(LEAST_TURN_RADPS, swing_radps + math.radians(_turn_degps(gait))),
        },
        scanner={
            **({} if mount.is_stripe else urg),
            "mount_x_m": 0.0,
            "mount_z_m": mount.height_m,
            "mount_tilt_deg": mount.tilt_deg,
        },
        map={"method": method, "cells": CELLS, "cell_m": cell_m, "filter_heights": True},
        shadow_filter=_filter_before([method] if steps in FILTERED else []),
        obstacle={
            "h_pos_m": SMALLER * obstacle.h_pos_m,
            "h_neg_m": SMALLER * obstacle.h_neg_m,
            "window_cells": CELLS,
        },
        **({"certainty": _certainty_of(steps, gait)} if method == "certainty" else {}),
    )


def bounds_m() -> tuple[float, float]:
    """Of floor, lowest and highest: at and beyond them is an obstacle."""
    obstacle = _robot("urg04lx").obstacle
    return SMALLER * obstacle.h_neg_m, SMALLER * obstacle.h_pos_m


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
