"""The cells of method `surface` as named arrays, and cells that go on from them.

Only cells that bar the way, or may, go on: nobody saw what became of ground meanwhile. A hole may
have come, so floor must be met anew before it tells anything. Of the error of the newest sweep only
what is always wrong goes on; the rest begins anew.
"""

import math

import numpy as np

from core.config import Config
from core.mapping.surface.cells import APART, CELL, LOOSE
from core.mapping.surface.constants import CLEAR, LEAST, MOST
from core.mapping.surface.maps import SurfaceMaps
from core.saved.bounds import MOST_M, MOST_S, MOST_SCANS, check_places, check_within
from core.saved.encoding import Arrays

OF_THIS_RUN = ("parts", "looks")  # what is free must show its floor anew
KEPT = tuple(name for name in CELL.names or () if name not in OF_THIS_RUN)
UNBOUNDED = ("floor_m", "low_m", "top_m", "under_m")  # inf or -inf while there is none
ALWAYS = math.radians(5.0)  # more than this no attitude is always wrong by
BOUNDS = {
    "var_m2": (0.0, MOST_M),
    "slope_x": (-1.0, 1.0),
    "slope_y": (-1.0, 1.0),
    "floor_s": (-MOST_S, MOST_S),
    "stands": (LEAST, MOST),
    "soft": (-MOST_SCANS, 2.0 * MOST),
    "tied": (0.0, APART),
}


def shapes() -> dict[str, tuple[np.dtype[np.generic], tuple[int | None, ...]]]:
    """Every array: type and shape; None: as many as there are."""
    cells = {f"cells.{name}": (CELL[name], (None,)) for name in KEPT}
    return {
        "cells.corner": (np.dtype(np.int64), (2,)),
        "cells.at": (np.dtype(np.int32), (None,)),  # flat indices of those that are known
        "error.static": (np.dtype(float), (2,)),  # of pitch and roll, rad
        **cells,
    }


def of_surface(maps: SurfaceMaps, now_s: float) -> Arrays:
    """The cells in which something stands or lacks, or beyond a step; instants as ages."""
    flat, grid = maps.cells.reshape(-1), maps.grid
    bars = (flat["stands"] > CLEAR) | (flat["under_m"] < 0.0) | (flat["tied"] == APART)
    at = np.flatnonzero(np.isfinite(flat["var_m2"]) & bars).astype(np.int32)
    arrays: Arrays = {
        "cells.corner": np.array([grid.corner_i, grid.corner_j], dtype=np.int64),
        "cells.at": at,
        "error.static": maps.static_rad.copy(),
    }
    for name in KEPT:
        arrays[f"cells.{name}"] = flat[name][at].copy()
    arrays["cells.floor_s"] = now_s - arrays["cells.floor_s"]
    return arrays


def into_surface(maps: SurfaceMaps, arrays: Arrays, now_s: float) -> None:
    """Go on from arrays that `check_surface` let pass: no floor was met in this run yet."""
    maps.erase()
    maps.grid.corner_i, maps.grid.corner_j = (int(part) for part in arrays["cells.corner"])
    records = np.zeros(arrays["cells.at"].size, dtype=CELL)
    for name in KEPT:
        records[name] = arrays[f"cells.{name}"]
    is_apart = records["tied"] == APART
    records["looks"] = is_apart  # of all others the ground is expected, not seen
    records["tied"] = np.where(is_apart, APART, LOOSE)
    records["floor_s"] = now_s - arrays["cells.floor_s"]
    maps.go_on_from(arrays["cells.at"], records, arrays["error.static"])


def check_surface(arrays: Arrays, config: Config) -> None:
    """Let cells pass that can be true; StateError names the first that can't."""
    check_within("error.static", arrays["error.static"], -ALWAYS, ALWAYS)
    check_places(arrays, KEPT, config)
    for name in KEPT:
        field = arrays[f"cells.{name}"]
        if name in UNBOUNDED:
            none = -math.inf if name == "top_m" else math.inf
            field = np.where(field == none, 0.0, field)
        check_within(f"cells.{name}", field, *BOUNDS.get(name, (-MOST_M, MOST_M)))
