"""Where a foot can stand: how far the next edge is, and how good a foothold, when somebody asks.

Of heights alone, for planners of legged robots; nothing is kept, and who asks for some cells pays
for these alone. An edge is a difference of heights, whatever lies between: a ramp counts as one
where it has risen by the bound. A cell keeps its highest point: one over which an edge runs seems
as high as the upper side, and the lower side shows in the next one. So no edge may be under a foot
nor in the cells beside those under it. Refuses to guess: where any of these is not known, soft, or
out of the map, no foothold is told, and a cell that is not known is no edge. A height that was
filled in is known as far as it can hide no edge: off by GATE sigmas, it still is none. But the
middle of a foot and half of the cells under it, at least, must have been measured.
Source: foothold scores by slope, roughness and step as Wermelinger et al., Navigation planning for
legged robots in challenging terrain, 2016; distance to edges as Jenelten et al., TAMOLS, 2022.
"""

import functools
import itertools
import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from core.grid.ring import RingGrid
from core.mapping.surface.constants import GATE
from core.records import F64, I64
from jit import kernel

F32 = npt.NDArray[np.float32]

FOOTING = ("edge", "foothold", "foothold_sigma")
NEIGHBOURS = 0.71  # cells: a plane needs those beside a cell and across, however small the foot


class Footing(NamedTuple):
    """A foot, and what it can stand on."""

    radius_m: float = 0.10  # of the foot
    step_m: float = 0.05  # heights that differ by more are an edge
    reach_m: float = 0.50  # as far an edge is looked for
    level_rad: float = math.radians(5.0)  # as good as level; at `steep_rad` it slips
    steep_rad: float = math.radians(20.0)
    smooth_m: float = 0.01  # rms off the plane under the foot, as good as smooth; at `rough_m` not
    rough_m: float = 0.03


USUAL = Footing()


class Ground(NamedTuple):
    """Heights of a map, a ring."""

    grid: RingGrid
    z_m: F64  # (size, size) highest, map frame; NaN: not known, or soft
    low_m: F64  # (size, size) lowest: below `z_m` where a beam was under the ground
    sigma_m: F64  # (size, size) 1 sigma of heights that were filled in; 0: measured


class Near(NamedTuple):
    """Cells about one, the nearest first."""

    di: I64  # (n,) columns
    dj: I64  # (n,) rows
    away_m: F64  # (n,) from centre to centre


class Sole(NamedTuple):
    """Cells about that of a foot's middle: those that it touches, then those beside these."""

    di: I64  # (n,) columns
    dj: I64  # (n,) rows
    touched: int  # so many of them


@functools.lru_cache(maxsize=16)
def near_within(reach_m: float, cell_m: float, touched: bool) -> Near:
    """Cells, without the own one, whose centre is within reach; `touched`: any of their area is."""
    most = math.ceil(reach_m / cell_m) + 1
    di, dj = (part.ravel() for part in np.mgrid[-most : most + 1, -most : most + 1])
    from_edge = np.hypot(np.maximum(abs(di) - 0.5, 0.0), np.maximum(abs(dj) - 0.5, 0.0))
    away = from_edge if touched else np.hypot(di, dj)
    is_near = (cell_m * away < reach_m) if touched else (cell_m * away <= reach_m + 1e-9)
    listed = np.nonzero(is_near & ((di != 0) | (dj != 0)))[0]
    order = listed[np.argsort(np.hypot(di, dj)[listed], kind="stable")]
    return Near(di[order], dj[order], cell_m * np.hypot(di, dj)[order])


@functools.lru_cache(maxsize=16)
def sole_of(foot_m: float, cell_m: float) -> Sole:
    """Of a foot of that radius."""
    under = near_within(foot_m, cell_m, True)
    touched = [(0, 0), *zip(under.di.tolist(), under.dj.tolist(), strict=True)]
    steps = tuple(itertools.product((-1, 0, 1), repeat=2))
    about = {(i + di, j + dj) for i, j in touched for di, dj in steps}
    cells = np.array([*touched[1:], *sorted(about.difference(touched))], dtype=np.int64)
    return Sole(cells[:, 0].copy(), cells[:, 1].copy(), len(touched) - 1)


@kernel
def _index(at: int, di: int, dj: int, low: tuple[int, int], size: int) -> int:
    """Flat index of the neighbour of a cell; -1: outside of the window.

    low: column and row of the cell, counted from the window's corner.
    """
    i, j = low[0] + di, low[1] + dj
    if not (0 <= i < size and 0 <= j < size):
        return -1
    column, row = at % size + di, at // size + dj
    column += size if column < 0 else -size if column >= size else 0
    row += size if row < 0 else -size if row >= size else 0
    return row * size + column


@kernel
def _from_corner(at: int, corner: tuple[int, int], size: int) -> tuple[int, int]:
    return (at % size - corner[0]) % size, (at // size - corner[1]) % size


@kernel
def _find_edges(
    listed: I64,
    corner: tuple[int, int],
    size: int,
    heights: tuple[F64, F64],
    near: Near,
    footing: Footing,
    edges_m: F64,
) -> None:
    """Fill `edges_m` (n,): the way to the nearest cell that is a step away; the reach at most."""
    z_m, low_m = heights
    step_m = footing.step_m
    for k in range(listed.size):
        z = z_m[listed[k]]
        edges_m[k] = footing.reach_m
        if math.isnan(z):
            edges_m[k] = math.nan
        elif z - low_m[listed[k]] > step_m:
            edges_m[k] = 0.0
        else:
            low = _from_corner(listed[k], corner, size)
            for n in range(near.di.size):
                at = _index(listed[k], near.di[n], near.dj[n], low, size)
                if at >= 0 and max(abs(z_m[at] - z), abs(low_m[at] - z)) > step_m:
                    edges_m[k] = near.away_m[n]
                    break


@kernel
def _share(value: float, good: float, bad: float) -> float:
    """1 up to a good value, 0 from a bad one on."""
    return min(1.0, max(0.0, (bad - value) / (bad - good)))


@kernel
def _foothold(
    own: int,
    corner: tuple[int, int],
    size: int,
    heights: tuple[F64, F64, F64],
    sole: Sole,
    cell_m: float,
    footing: Footing,
) -> tuple[float, float]:
    """Of a foot on one cell, and the largest sigma under and beside it.

    The plane under it is the simpler as it touches cells all around.
    """
    z_m, low_m, sigma_m = heights
    di, dj, n = sole.di, sole.dj, 1 + sole.touched
    z, sigma, most_m = z_m[own], sigma_m[own], z_m[own] - low_m[own]
    sz = szz = sxz = syz = sxx = 0.0
    if math.isnan(z) or sigma > 0.0:
        return math.nan, math.nan
    hidden_m, largest_m, measured = 0.0, 0.0, 1
    low = _from_corner(own, corner, size)
    for k in range(di.size):
        at = _index(own, di[k], dj[k], low, size)
        if at < 0 or math.isnan(z_m[at]):
            return math.nan, math.nan
        up, off_m = z_m[at] - z, GATE * sigma_m[at]
        step_m, largest_m = max(abs(up), abs(low_m[at] - z)), max(largest_m, sigma_m[at])
        if off_m == 0.0:
            most_m = max(most_m, step_m)
        hidden_m = max(hidden_m, step_m + off_m)
        if k >= sole.touched:
            continue
        measured += off_m == 0.0
        sz, szz = sz + up, szz + up * up
        sxz, syz, sxx = sxz + di[k] * up, syz + dj[k] * up, sxx + di[k] * di[k]
    if most_m > footing.step_m:
        return 0.0, largest_m
    if hidden_m > footing.step_m or 2 * measured < n:
        return math.nan, math.nan
    a, b = sxz / sxx, syz / sxx
    off = szz / n - (sz / n) ** 2 - (a * sxz + b * syz) / n
    slope_rad = math.atan(math.hypot(a, b) / cell_m)
    is_level = _share(slope_rad, footing.level_rad, footing.steep_rad)
    is_smooth = _share(math.sqrt(max(0.0, off)), footing.smooth_m, footing.rough_m)
    return min(is_level, is_smooth), largest_m


@kernel
def _judge_footholds(
    listed: I64,
    corner: tuple[int, int],
    size: int,
    heights: tuple[F64, F64, F64],
    sole: Sole,
    cell_m: float,
    footing: Footing,
    footholds: F64,
    sigmas_m: F64,
) -> None:
    for k in range(listed.size):
        footholds[k], sigmas_m[k] = _foothold(
            listed[k], corner, size, heights, sole, cell_m, footing
        )


def footing_of(name: str, ground: Ground, at: I64, footing: Footing) -> F64:
    """One of `FOOTING` at cells (n,), flat indices of the ring.

    Returns:
        (n,) "edge": m from the cell's centre to that of the nearest known cell whose height differs
        from its own by more than `step_m`, or under whose ground a beam was so low; 0: its own is
        so; `reach_m`: none is nearer. "foothold": 1 level and smooth, 0 an edge, steep or rough;
        "foothold_sigma": m, the largest 1 sigma of the heights under that foot and beside it, 0
        where all were measured. NaN: not known.
    """
    grid, cell_m, found = ground.grid, ground.grid.cell_m, np.empty(at.size)
    corner, heights = (grid.corner_i, grid.corner_j), (ground.z_m.ravel(), ground.low_m.ravel())
    sigmas_m = np.empty(at.size)
    foot = Footing(*map(float, footing))
    if name == "edge":
        near = near_within(footing.reach_m, cell_m, False)
        _find_edges(at, corner, grid.size, heights, near, foot, found)
    else:
        sole = sole_of(max(footing.radius_m, NEIGHBOURS * cell_m), cell_m)
        told = (*heights, ground.sigma_m.ravel())
        _judge_footholds(at, corner, grid.size, told, sole, cell_m, foot, found, sigmas_m)
    return sigmas_m if name == "foothold_sigma" else found


def cells_within(grid: RingGrid, at: I64, reach_m: float) -> I64:
    """Flat indices, each once, of a ring's cells that lie so near to those at (n,), or nearer."""
    size, reach = grid.size, math.ceil(reach_m / grid.cell_m) + 1
    if at.size * (2 * reach + 1) ** 2 >= size * size:
        return np.arange(size * size)
    steps = np.arange(-reach, reach + 1)
    columns = (at % size)[:, None, None] + steps[None, None, :]
    rows = (at // size)[:, None, None] + steps[None, :, None]
    return np.unique(rows % size * size + columns % size)
