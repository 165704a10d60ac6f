"""Slope, step and roughness of the ground about each cell, worked out for whoever asks.

A plane is laid through the heights (map frame) of a cell and its known neighbours. Scans note which
cells they touched; `update` looks once at each of these and at its neighbours, before a layer is
read and whenever many wait, so that the cost grows with what was seen and not with the window.
Heights far apart in time also carry the drift of the pose between them. Refuses to judge: NaN says
that a cell is not known, never that it is flat.
Source: step, slope and roughness as Wermelinger et al., Navigation planning for legged robots in
challenging terrain, 2016.
"""

import math

import numpy as np
import numpy.typing as npt

from core.mapping.beams.cells import CellGrid, Cells
from core.records import I8, I32
from jit import kernel

F32 = npt.NDArray[np.float32]
Windowed = tuple[int, int, int, float]  # corner i, corner j, size, edge of a cell in metres

MANY = 1500  # touched cells that may wait until somebody asks: looking at all of them is short
TOUCHED, LISTED = 1, 2  # bits of a mark: a scan touched the cell; this update looks at it
EVENLY = 1.0 / math.sqrt(12.0)  # rms about the middle of what lies evenly between two bounds


@kernel
def _note(touched: I32, marks: I8, noted: I32, used: int) -> int:
    """Add touched cells to the `used` noted ones, each once; returns how many there are now."""
    for at in touched:
        if marks[at] == 0:
            marks[at] = TOUCHED
            noted[used] = at
            used += 1
    return used


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
def _list_around(window: Windowed, marks: I8, noted: I32, used: int) -> int:
    """Add the neighbours of the noted cells and take all marks off; how many are listed."""
    touched, around = used, np.empty(9, dtype=np.int32)
    for k in range(touched):
        _find_around(noted[k], window, around)
        for near in around:
            if near >= 0 and marks[near] == 0:
                marks[near] = LISTED
                noted[used] = near
                used += 1
    for k in range(used):
        marks[noted[k]] = 0
    return used


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
def _look(
    listed: I32, cells: Cells, window: Windowed, slopes: F32, steps: F32, roughness: F32
) -> None:
    """Judge the listed cells into the layers (flat)."""
    around = np.empty(9, dtype=np.int32)
    for at in listed:
        cell = cells[at]
        slopes[at] = steps[at] = roughness[at] = np.nan
        if cell.count == 0:
            continue
        _find_around(at, window, around)
        steps[at] = _step(at, cells, around)
        a, b, off = _plane(at, cells, window, around)
        if math.isnan(a):
            continue
        slopes[at] = math.atan(math.hypot(a, b))
        rise = window[3] * (abs(a) + abs(b))  # of the plane itself, within the cell
        own = EVENLY * max(0.0, cell.z_high_m - cell.z_low_m - rise)
        roughness[at] = math.sqrt(off + own * own)


class Terrain:
    """Layers (size, size) float32 over a `CellGrid`, laid out as it is; NaN where not known.

    They are as of the last `update`, which whoever reads them calls first. A cell at the edge of
    the window keeps what it was judged with when neighbours leave.
    """

    def __init__(self, cells: CellGrid) -> None:
        self._cells = cells
        self.slope_rad: F32 = cells.grid.layer(np.float32, np.nan)  # 0: level, of whatever heading
        self.step_m: F32 = cells.grid.layer(np.float32, np.nan)
        self.roughness_m: F32 = cells.grid.layer(np.float32, np.nan)  # rms, off the plane
        self._marks: I8 = np.full(cells.flat.size, 0, dtype=np.int8)
        self._noted: I32 = np.full(cells.flat.size, 0, dtype=np.int32)
        self._used = 0
        self.looks = 0  # cells looked at so far

    def note(self, touched: I32) -> None:
        """Cells (flat indices) that a scan touched: they are looked at when there are many."""
        self._used = _note(touched, self._marks, self._noted, self._used)
        if self._used > MANY:
            self.update()

    def update(self) -> int:
        """Look again at what was touched since the last update; returns at how many cells."""
        if self._used == 0:
            return 0
        window = self._cells.window
        used = int(_list_around(window, self._marks, self._noted, self._used))
        _look(
            self._noted[:used],
            self._cells.flat,
            window,
            self.slope_rad.reshape(-1),
            self.step_m.reshape(-1),
            self.roughness_m.reshape(-1),
        )
        self._used = 0
        self.looks += used
        return used
