"""What can be asked of a map, cell by cell: whole layers by name, or the values of some cells.

Copies, so that nobody who looks can change a map. NaN is "not known" in every layer, never flat and
never free. "state" is what was decided: whoever tells it on holds FREE back while the map is not
trusted. A cell may have a state and no height: missing floor is known by what did not show.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from core.grid.ring import RingGrid
from core.grid.window import ObstacleWindow
from core.mapping.footing import FOOTING, USUAL, Footing, Ground, cells_within, footing_of
from core.mapping.terrain import F32
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
    "foothold_sigma": "m",  # of the heights under that foot, the largest 1 sigma; 0: all measured
    "filled": "m",  # as `z`; where nothing was measured by what lies around
    "filled_sigma": "m",  # 1 sigma of that, which grows with the distance to what was measured
    "soft": "",  # 1: beams go into what stands there; 0: they do not, or nothing stands there
    "state": "",  # OBSTACLE or FREE
}
FILL = ("filled", "filled_sigma")
ON_ASKING = ("cause", "age")  # only of some cells: a code of `causes.py`; s, at the newest scan
Pick = Callable[[I64], F64]  # values (n,) at flat indices (n,) of a ring; NaN: not known
RingLayer = tuple[RingGrid, Pick]


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


def flat_of(grid: RingGrid, i: I64, j: I64) -> I64:
    """Of world cells (n,), where they would lie in a ring, if inside of its window."""
    return np.asarray(j % grid.size * grid.size + i % grid.size)


def at_cells(grid: RingGrid, i: I64, j: I64, pick: Pick) -> F64:
    """Values (n,) of a ring's layer at world cells i, j (n,); NaN outside its window."""
    return _only_inside(grid, i, j, pick(flat_of(grid, i, j)))


def view_of(name: str, grid: RingGrid, pick: Pick) -> LayerView:
    """A layer (size, size) of a ring, unrolled."""
    j, i = np.indices((grid.size, grid.size)).reshape(2, -1)
    at = flat_of(grid, i + grid.corner_i, j + grid.corner_j)
    values = pick(at).reshape(grid.size, grid.size).astype(np.float32)
    return LayerView(name, values, grid.corner_i, grid.corner_j, grid.cell_m)


class GroundSource(Protocol):
    """Heights of one frame that feet may stand on, at flat indices (n,) of a grid; else NaN."""

    @property
    def grid(self) -> RingGrid: ...

    def ground_at(self, at: I64) -> Ground: ...

    def filled_at(self, at: I64) -> Ground:
        """The same, and what was filled in at those cells, if the method tells how surely."""


class Layered(Protocol):
    """A map of which layers can be told."""

    window: ObstacleWindow

    def maybe_ring(self, name: str) -> RingLayer | None: ...

    def maybe_ground(self) -> GroundSource | None: ...

    def causes(self, i: I64, j: I64) -> F64: ...

    def ages_s(self, i: I64, j: I64) -> F64: ...


def _maybe_ring(maps: Layered, name: str) -> RingLayer | None:
    if name != "state":
        return maps.maybe_ring(name)
    states = maps.window.cells.reshape(-1)
    return maps.window.grid, lambda at: np.where(states[at] == UNKNOWN, np.nan, states[at])


def _maybe_footing(maps: Layered, name: str, footing: Footing) -> RingLayer | None:
    source = maps.maybe_ground()
    if source is None:
        return None
    grid = source.grid

    def told(at: I64) -> F64:
        if name == "edge":
            ground = source.ground_at(cells_within(grid, at, footing.reach_m))
        else:
            ground = source.filled_at(cells_within(grid, at, footing.radius_m + grid.cell_m))
        return footing_of(name, ground, at, footing)

    return grid, told


def _maybe_filled(maps: Layered, name: str) -> RingLayer | None:
    source, z, variance = maps.maybe_ground(), maps.maybe_ring("z"), maps.maybe_ring("variance")
    if source is None or z is None or variance is None:
        return None

    def told(at: I64) -> F64:
        ground = source.filled_at(at)
        filled = {"filled": ground.z_m, "filled_sigma": ground.sigma_m}[name].ravel()[at]
        is_filled, is_told = ground.sigma_m.ravel()[at] > 0.0, ~np.isnan(ground.z_m.ravel()[at])
        measured = z[1](at) if name == "filled" else np.sqrt(variance[1](at))
        return np.where(is_filled, filled, np.where(is_told, measured, np.nan))

    return source.grid, told


def _maybe_any(maps: Layered, name: str, footing: Footing) -> RingLayer | None:
    if name in FILL:
        return _maybe_filled(maps, name)
    return _maybe_footing(maps, name, footing) if name in FOOTING else _maybe_ring(maps, name)


def maybe_layer(maps: Layered, name: str, *, footing: Footing = USUAL) -> LayerView | None:
    """A layer by its name in `UNITS`; none where the method has none."""
    ring = _maybe_any(maps, name, footing)
    return None if ring is None else view_of(name, *ring)


def maybe_values(
    maps: Layered, name: str, i: I64, j: I64, *, footing: Footing = USUAL
) -> F64 | None:
    """What a layer, or one of `ON_ASKING`, holds at world cells i, j (n,); NaN: not known."""
    if name in ON_ASKING:
        return maps.causes(i, j) if name == "cause" else maps.ages_s(i, j)
    ring = _maybe_any(maps, name, footing)
    return None if ring is None else at_cells(ring[0], i, j, ring[1])
