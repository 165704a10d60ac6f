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

from core.mapping.beams.cells import CellGrid, Cells
from core.records import I32, I64
from jit import kernel

F32 = npt.NDArray[np.float32]
Windowed = tuple[int, int, int, float]  # corner i, corner j, size, edge of a cell in metres

JUDGED = ("slope", "step", "roughness")  # slope 0: level, of whatever heading; roughness: rms
EVENLY = 1.0 / math.sqrt(12.0)  # rms about the middle of what lies evenly between two bounds


@kernel
def _find_around(at: int, window: Windowed, around: I32) -> None:
    """Put the flat indices of a cell and its neighbours into `around` (9,), row by row.

    -1 for those outside of the window.
    """
    size = window[2]
    column, row = at % size, at // size
    i, j, k = (column - window[0]) % size, (row - window[1]) % size, 0
    for dj in range(-1, 2):
        beside_row = row + dj
        beside_row += size if beside_row < 0 else (-size if beside_row >= size else 0)
        for di in range(-1, 2):
            beside = column + di
            beside += size if beside < 0 else (-size if beside >= size else 0)
            inside = 0 <= i + di < size and 0 <= j + dj < size
            around[k] = beside_row * size + beside if inside else -1
            k += 1


@kernel
def _plane(at: int, cells: Cells, window: Windowed, around: I32) -> tuple[float, float, float]:
    """Of the plane through a cell and its known neighbours: slopes along x and y, mean square off.

    NaN where they are fewer than three or lie in a line.
    """
    n = sx = sy = sxx = sxy = syy = 0
    sz = sxz = syz = szz = 0.0
    for dj in range(-1, 2):
        for di in range(-1, 2):
            near = around[3 * (dj + 1) + di + 1]
            if near < 0 or cells[near].count == 0:
                continue
            z = cells[near].z_m - cells[at].z_m
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
    return a / window[3], b / window[3], max(0.0, off)


@kernel
def _step(at: int, cells: Cells, around: I32) -> float:
    """Largest height difference within a known cell and from it to a known neighbour."""
    most = cells[at].z_high_m - cells[at].z_low_m
    for near in around:
        if near >= 0 and cells[near].count > 0:
            most = max(most, abs(cells[near].z_m - cells[at].z_m))
    return float(most)


@kernel
def _judge(listed: I64, cells: Cells, window: Windowed, judged: F32) -> None:
    """Fill `judged` (3, n) for the n listed cells."""
    around = np.empty(9, dtype=np.int32)
    for k in range(listed.size):
        at = listed[k]
        cell = cells[at]
        judged[0, k] = judged[1, k] = judged[2, k] = np.nan
        if cell.count == 0:
            continue
        _find_around(at, window, around)
        judged[1, k] = _step(at, cells, around)
        a, b, off = _plane(at, cells, window, around)
        if math.isnan(a):
            continue
        judged[0, k] = math.atan(math.hypot(a, b))
        rise = window[3] * (abs(a) + abs(b))  # of the plane itself, within the cell
        own = EVENLY * max(0.0, cell.z_high_m - cell.z_low_m - rise)
        judged[2, k] = math.sqrt(off + own * own)


def terrain_at(cells: CellGrid, at: I64) -> F32:
    """Slope (rad), step and roughness (m) as `JUDGED`: (3, n), of cells by flat index (n,)."""
    judged = np.empty((len(JUDGED), at.size), dtype=np.float32)
    _judge(at, cells.flat, cells.window, judged)
    return judged
