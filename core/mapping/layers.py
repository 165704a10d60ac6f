"""What can be asked of a map, cell by cell: whole layers by name, or the values of some cells.

Copies, so that nobody who looks can change a map. NaN is "not known" in every layer, never flat and
never free. "state" is what was decided: whoever tells it on holds FREE back while the map is not
trusted. A cell may have a state and no height: missing floor is known by what did not show.
"""

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from core.grid.ring import RingGrid
from core.grid.window import ObstacleWindow
from core.mapping.footing import FOOTING, USUAL, Footing, Ground, footing_of
from core.mapping.surface.cells import Cells
from core.mapping.surface.constants import LIKELY
from core.mapping.terrain import F32, JUDGED, around, terrain_of
from core.records import F64, I64, UNKNOWN

UNITS = {  # every layer there is
    "height": "m",  # above the ground: measured (`surface`) or expected (`reference_plane`)
    "variance": "m2",  # of the height: by its error model, or of what fell into the cell
    "z": "m",  # average height, map frame
    "slope": "rad",  # of the ground through the cell and its neighbours; 0: level
    "step": "m",  # largest height difference within the cell and to its neighbours
    "roughness": "m",  # rms, off the plane through them
    "edge": "m",  # to the nearest known cell that is a step away, up to a reach
    "foothold": "",  # 1: a foot stands there level and smooth, without an edge; 0: it would not
    "soft": "",  # 1: beams go into what stands there; 0: they do not, or nothing stands there
    "state": "",  # OBSTACLE or FREE
}
ON_ASKING = ("cause", "age")  # only of some cells: a code of `causes.py`; s, at the newest scan
RingLayer = tuple[RingGrid, npt.NDArray[Any]]  # with the values (size, size) of its cells


@dataclass(frozen=True, slots=True, eq=False)
class LayerView:
    """One layer as it was when asked for."""

    name: str
    values: F32  # (size, size), [row, column] = [j - corner_j, i - corner_i]; NaN: not known
    corner_i: int  # world cell of values[0, 0]
    corner_j: int
    cell_m: float


def _only_inside(grid: RingGrid, i: I64, j: I64, values: npt.NDArray[Any]) -> F64:
    """Values (n,) of world cells i, j (n,); NaN outside the window."""
    inside = (
        (i >= grid.corner_i)
        & (i < grid.corner_i + grid.size)
        & (j >= grid.corner_j)
        & (j < grid.corner_j + grid.size)
    )
    return np.where(inside, values, np.nan)


def at_cells(grid: RingGrid, i: I64, j: I64, ring: npt.NDArray[Any]) -> F64:
    """Values (n,) of a ring's layer at world cells i, j (n,); NaN outside its window."""
    return _only_inside(grid, i, j, ring[j % grid.size, i % grid.size])


def view_of(name: str, grid: RingGrid, ring: npt.NDArray[Any]) -> LayerView:
    """A layer (size, size) of a ring, unrolled."""
    shift = (-(grid.corner_j % grid.size), -(grid.corner_i % grid.size))
    values = np.roll(ring, shift, axis=(0, 1)).astype(np.float32)
    return LayerView(name, values, grid.corner_i, grid.corner_j, grid.cell_m)


class Layered(Protocol):
    """A map of which layers can be told."""

    window: ObstacleWindow

    def maybe_ring(self, name: str) -> RingLayer | None: ...

    def maybe_ground(self) -> Ground | None: ...

    def causes(self, i: I64, j: I64) -> F64: ...

    def ages_s(self, i: I64, j: I64) -> F64: ...


def _maybe_ring(maps: Layered, name: str) -> RingLayer | None:
    if name != "state":
        return maps.maybe_ring(name)
    window = maps.window
    return window.grid, np.where(window.cells == UNKNOWN, np.nan, window.cells)


def _flat(grid: RingGrid, i: I64, j: I64) -> I64:
    """Of world cells (n,), where they would lie in a ring."""
    return np.asarray(j % grid.size * grid.size + i % grid.size)


def maybe_layer(maps: Layered, name: str, *, footing: Footing = USUAL) -> LayerView | None:
    """A layer by its name in `UNITS`; none where the method has none."""
    if name in FOOTING:
        ground = maps.maybe_ground()
        if ground is None:
            return None
        values = footing_of(name, ground, np.arange(ground.z_m.size), footing)
        return view_of(name, ground.grid, values.reshape(ground.z_m.shape))
    ring = _maybe_ring(maps, name)
    return None if ring is None else view_of(name, *ring)


def maybe_values(
    maps: Layered, name: str, i: I64, j: I64, *, footing: Footing = USUAL
) -> F64 | None:
    """What a layer, or one of `ON_ASKING`, holds at world cells i, j (n,); NaN: not known."""
    if name in FOOTING:
        ground = maps.maybe_ground()
        if ground is None:
            return None
        values = footing_of(name, ground, _flat(ground.grid, i, j), footing)
        return _only_inside(ground.grid, i, j, values)
    if name in ON_ASKING:
        return maps.causes(i, j) if name == "cause" else maps.ages_s(i, j)
    ring = _maybe_ring(maps, name)
    return None if ring is None else at_cells(ring[0], i, j, ring[1])


def heights_of(cells: Cells, static_rad: F64) -> F64:
    """Of method `surface`, (size, size), map frame: what stands, else the ground; NaN: none.

    static_rad (2,): what pitch and roll are always wrong by.
    """
    tilt_m = static_rad[0] * cells["arm_m"] + static_rad[1] * cells["aside_m"]
    return np.asarray(cells["ground_m"] - tilt_m + _over_ground_m(cells))


def _over_ground_m(cells: Cells) -> F64:
    """Of method `surface`: how high what stands is, 0 where floor was seen, NaN elsewhere."""
    top_m, floor = cells["top_m"], np.where(cells["looks"] > 0, 0.0, np.nan)
    return np.where((cells["stands"] > 0.0) & np.isfinite(top_m), top_m, floor)


def surface_ground(cells: Cells, static_rad: F64, grid: RingGrid) -> Ground:
    """What feet may stand on, of method `surface`, as `heights_of`; nothing where it is soft."""
    z_m, is_soft = (
        heights_of(cells, static_rad),
        (cells["stands"] > 0.0) & (cells["soft"] >= LIKELY),
    )
    z_m = np.where(is_soft, np.nan, z_m)
    return Ground(grid, z_m, z_m + np.minimum(0.0, cells["under_m"]))


def maybe_surface_ring(
    name: str, cells: Cells, static_rad: F64, grid: RingGrid
) -> RingLayer | None:
    """A layer of method `surface`, as `heights_of`; none: there is no such."""
    height_m, is_seen = _over_ground_m(cells), cells["looks"] > 0
    steep_x, steep_y = cells["slope_x"], cells["slope_y"]
    if name == "height":
        return grid, height_m
    if name == "z":
        return grid, heights_of(cells, static_rad)
    if name == "variance":
        return grid, np.where(np.isnan(height_m), np.nan, cells["var_m2"])
    if name == "slope":
        return grid, np.where(is_seen, np.arctan(np.hypot(steep_x, steep_y)), np.nan)
    if name == "soft":
        is_soft = (cells["stands"] > 0.0) & (cells["soft"] >= LIKELY)
        return grid, np.where(np.isnan(height_m), np.nan, is_soft)
    if name not in JUDGED:
        return None
    near, z_m = around(grid, np.arange(cells.size)), heights_of(cells, static_rad).reshape(-1)
    stands_m = np.where(cells["stands"] > 0.0, np.maximum(0.0, cells["top_m"]), 0.0)
    relief_m = stands_m - np.minimum(0.0, cells["under_m"])  # slopes, what stands, what lacks
    relief_m += grid.cell_m * (np.abs(steep_x) + np.abs(steep_y))
    z_m = np.where(near >= 0, z_m[near], np.nan)
    judged = terrain_of(z_m, relief_m.reshape(-1), grid.cell_m)[JUDGED.index(name)]
    return grid, np.asarray(judged.reshape(cells.shape), float)
