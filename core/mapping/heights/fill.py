"""Heights where no beam met the ground, and how well they are told; worked out when somebody asks.

From a cell the first measured one is looked for in eight directions, as far as the model of terrain
looks. Those lower than the lowest of them and h_pos are its ground, with weights as in that model;
what rises in another direction is a doubt. No slope is filled between ground and an edge: what is
not seen there lies in its lee, as a rule on the ground. Where less than half of the directions tell
ground, it is but a gap in what is higher, and all directions count. Refuses to tell a height where
less than half of them have any, where a beam was under the ground, and of what is soft. What is
filled frees no cell.

Source: docs/method.md, section 5.
"""

import math
from typing import Any

from core.grid.places import Ring, index_of, world_cell
from core.mapping.surface.cells import Cells, grown
from core.mapping.surface.constants import *
from core.records import F64, I64
from jit import Record, kernel

WAYS, LEAST_WAYS = 8, 4  # directions; in fewer there is no ground
FILL_M = REACH * REACH_M  # as far as the model of terrain looks


@kernel
def _height_of(cell: Record, static_rad: F64) -> float:
    """What stands there, else the ground, map frame; NaN: not measured."""
    ground = cell.ground_m - (static_rad[0] * cell.arm_m + static_rad[1] * cell.aside_m)
    if cell.stands > 0.0 and cell.top_m > -math.inf:
        return float(ground + cell.top_m)
    return float(ground) if cell.looks > 0 else math.nan


def is_soft(of: Any) -> Any:
    """Whether what stands there lets beams in: of a cell, or of cells (n,)."""
    return (of["stands"] > 0.0) & (of["soft"] >= LIKELY)


_is_soft = kernel(is_soft)


@kernel
def _look(at: int, cells: Cells, static_rad: F64, ring: Ring, ways: F64) -> int:
    """Fill `ways` (WAYS, 3) with what lies first in each direction; how many have something.

    Of each how far away it is, its height, and the variance that this has here.
    """
    (i, j), cell_m, found = world_cell(at, ring), ring.cell_m, 0
    for n in range(9):
        di, dj = n % 3 - 1, n // 3 - 1
        step_m = cell_m * math.sqrt(di * di + dj * dj)
        k = 1
        while n != 4 and k * step_m <= FILL_M + 1e-9:
            near = index_of(i + k * di, j + k * dj, ring)
            if near < 0 or cells[near].under_m < math.inf or _is_soft(cells[near]):
                break
            z = _height_of(cells[near], static_rad)
            if not math.isnan(z):
                away_m = k * step_m
                ways[found, 0], ways[found, 1] = away_m, z
                ways[found, 2] = grown(cells[near].var_m2, away_m) + FLAT_M * FLAT_M
                found += 1
                break
            k += 1
    return found


@kernel
def _tell(ways: F64, found: int, h_pos_m: float) -> tuple[float, float]:
    """Height and variance by what lies in those directions."""
    low_m, ground = math.inf, 0
    for k in range(found):
        low_m = min(low_m, ways[k, 1])
    for k in range(found):
        ground += ways[k, 1] - low_m < h_pos_m
    bound_m = h_pos_m if ground >= LEAST_WAYS else math.inf
    total = up = square = 0.0  # over the lowest
    var, near_m, slope_m = math.inf, math.inf, 0.0
    for k in range(found):
        away_m, rise, w = ways[k, 0], ways[k, 1] - low_m, 1.0 / ways[k, 2]
        if rise < bound_m:
            total, up, square = total + w, up + w * rise, square + w * rise * rise
            var, near_m = min(var, ways[k, 2]), min(near_m, away_m)
    up /= total
    for k in range(found):
        away_m, rise = ways[k, 0], ways[k, 1] - low_m
        if rise >= bound_m:
            slope_m = max(slope_m, (rise - up) * near_m / (near_m + away_m))
    spread = max(0.0, square / total - up * up)
    return low_m + up, var + spread + slope_m * slope_m


@kernel
def fill(
    listed: I64, cells: Cells, static_rad: F64, ring: Ring, h_pos_m: float,
    ways: F64, z_m: F64, low_m: F64, sigma_m: F64,
) -> None:  # fmt: skip
    """Fill the heights of cells that were not measured; NaN stays where nothing tells them.

    Args:
        listed: (n,) flat indices.
        static_rad: (2,) what pitch and roll are always wrong by.
        ways: (WAYS, 3) room.
        z_m, low_m, sigma_m: (cells,) of a `Ground`; NaN, NaN and 0 of those not measured.
    """
    for at in listed:
        cell = cells[at]
        if math.isnan(z_m[at]) and cell.under_m == math.inf and not _is_soft(cell):
            found = _look(at, cells, static_rad, ring, ways)
            if found >= LEAST_WAYS:
                z, var = _tell(ways, found, h_pos_m)
                z_m[at], low_m[at], sigma_m[at] = z, z, math.sqrt(var)
