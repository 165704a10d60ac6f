"""Slope, step and roughness of the ground about each cell, worked out when somebody asks.

A plane is laid through the heights (map frame) of a cell and its known neighbours. Nothing is kept:
who asks for some cells pays for these alone, and a scan for none. Heights far apart in time also
carry the drift of the pose between them. Refuses to judge: NaN says that a cell is not known, never
that it is flat.
Source: step, slope and roughness as Wermelinger et al., Navigation planning for legged robots in
challenging terrain, 2016.
"""

import math

import numpy as np
import numpy.typing as npt

from core.grid.ring import RingGrid
from core.records import F64, I64
from jit import kernel

F32 = npt.NDArray[np.float32]

JUDGED = ("slope", "step", "roughness")  # slope 0: level, of whatever heading; roughness: rms
EVENLY = 1.0 / math.sqrt(12.0)  # rms about the middle of what lies evenly between two bounds
OWN = 4  # a cell among the nine of its surroundings, row by row


@kernel
def _find_around(listed: I64, corner: tuple[int, int], size: int, around: I64) -> None:
    """Fill `around` (n, 9) with the flat indices of cells (n,) and their neighbours, row by row.

    -1 for those outside of the window.
    """
    for k in range(listed.size):
        column, row = listed[k] % size, listed[k] // size
        i, j = (column - corner[0]) % size, (row - corner[1]) % size
        for n in range(9):
            di, dj = n % 3 - 1, n // 3 - 1
            inside = 0 <= i + di < size and 0 <= j + dj < size
            near = (row + dj) % size * size + (column + di) % size
            around[k, n] = near if inside else -1


def around(grid: RingGrid, at: I64) -> I64:
    """Flat indices (n, 9) of cells (n,) and their neighbours; -1: outside of the window."""
    found = np.empty((at.size, 9), dtype=np.int64)
    _find_around(at, (grid.corner_i, grid.corner_j), grid.size, found)
    return found


@kernel
def _plane(z_m: F64, cell_m: float) -> tuple[float, float, float]:
    """Of the plane through a cell and its known neighbours: slopes along x and y, mean square off.

    NaN where they are fewer than three or lie in a line.
    """
    n = sx = sy = sxx = sxy = syy = 0
    sz = sxz = syz = szz = 0.0
    for k in range(9):
        z = z_m[k] - z_m[OWN]
        if math.isnan(z):
            continue
        di, dj = k % 3 - 1, k // 3 - 1
        n, sx, sy = n + 1, sx + di, sy + dj
        sxx, sxy, syy = sxx + di * di, sxy + di * dj, syy + dj * dj
        sz, sxz, syz, szz = sz + z, sxz + di * z, syz + dj * z, szz + z * z
    vxx, vxy, vyy = n * sxx - sx * sx, n * sxy - sx * sy, n * syy - sy * sy
    det = vxx * vyy - vxy * vxy  # whole numbers: 0 exactly where all lie in a line
    if det == 0:
        return math.nan, math.nan, math.nan
    vxz, vyz = n * sxz - sx * sz, n * syz - sy * sz
    a = (vxz * vyy - vyz * vxy) / det
    b = (vyz * vxx - vxz * vxy) / det
    off = (n * szz - sz * sz - a * vxz - b * vyz) / (n * n)
    return a / cell_m, b / cell_m, max(0.0, off)


@kernel
def _step(z_m: F64, relief_m: float) -> float:
    """Largest height difference within a known cell and from it to a known neighbour."""
    most = relief_m
    for near_m in z_m:
        if not math.isnan(near_m):
            most = max(most, abs(near_m - z_m[OWN]))
    return float(most)


@kernel
def _judge(z_m: F64, relief_m: F64, cell_m: float, judged: F32) -> None:
    """Fill `judged` (3, n) for n cells."""
    for k in range(relief_m.size):
        judged[0, k] = judged[1, k] = judged[2, k] = np.nan
        if math.isnan(z_m[k, OWN]):
            continue
        judged[1, k] = _step(z_m[k], relief_m[k])
        a, b, off = _plane(z_m[k], cell_m)
        if math.isnan(a):
            continue
        judged[0, k] = math.atan(math.hypot(a, b))
        rise = cell_m * (abs(a) + abs(b))  # of the plane itself, within the cell
        own = EVENLY * max(0.0, relief_m[k] - rise)
        judged[2, k] = math.sqrt(off + own * own)


def terrain_of(z_m: F64, relief_m: F64, cell_m: float) -> F32:
    """Slope (rad), step and roughness (m) as `JUDGED`: (3, n).

    Args:
        z_m: (n, 9) heights of `around`, map frame; NaN: not known.
        relief_m: (n,) between the lowest and the highest in each cell.
    """
    judged = np.empty((len(JUDGED), relief_m.size), dtype=np.float32)
    _judge(z_m, relief_m, cell_m, judged)
    return judged
