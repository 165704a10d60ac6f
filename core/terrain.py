"""Slope, step and roughness of the ground about each cell, kept up at the publishing rate.

A plane is laid through the heights (map frame) of a cell and its known neighbours. Scans note which
cells they touched; `update` looks once at each of these and at its neighbours, so that the cost
grows with what was seen and not with the window. Heights far apart in time also carry the drift of
the pose between them. Refuses to judge: NaN says that a cell is not known, never that it is flat.
Source: step, slope and roughness as Wermelinger et al., Navigation planning for legged robots in
challenging terrain, 2016.
"""

import math

import numpy as np
import numpy.typing as npt

from core.cells import CellGrid, Cells
from core.jit import kernel
from core.records import I8, I32

F32 = npt.NDArray[np.float32]
Windowed = tuple[int, int, int, float]  # corner i, corner j, size, edge of a cell in metres

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
def _neighbour(at: int, di: int, dj: int, window: Windowed) -> int:
    """Flat index of a neighbour, -1 outside of the window."""
    size = window[2]
    i, j = (at % size - window[0]) % size + di, (at // size - window[1]) % size + dj
    if not (0 <= i < size and 0 <= j < size):
        return -1
    return int(((j + window[1]) % size) * size + (i + window[0]) % size)


@kernel
def _list_around(window: Windowed, marks: I8, noted: I32, used: int) -> int:
    """Add the neighbours of the noted cells and take all marks off; how many are listed."""
    touched = used
    for k in range(touched):
        for dj in range(-1, 2):
            for di in range(-1, 2):
                near = _neighbour(noted[k], di, dj, window)
                if near >= 0 and marks[near] == 0:
                    marks[near] = LISTED
                    noted[used] = near
                    used += 1
    for k in range(used):
        marks[noted[k]] = 0
    return used


@kernel
def _plane(at: int, cells: Cells, window: Windowed) -> tuple[float, float, float]:
    """Of the plane through a cell and its known neighbours: slopes along x and y, mean square off.

    NaN where they are fewer than three or lie in a line.
    """
    n = sx = sy = sxx = sxy = syy = 0
    sz = sxz = syz = szz = 0.0
    for dj in range(-1, 2):
        for di in range(-1, 2):
            near = _neighbour(at, di, dj, window)
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
def _step(at: int, cells: Cells, window: Windowed) -> float:
    """Largest height difference within a known cell and from it to a known neighbour."""
    most = cells[at].z_high_m - cells[at].z_low_m
    for dj in range(-1, 2):
        for di in range(-1, 2):
            near = _neighbour(at, di, dj, window)
            if near >= 0 and cells[near].count > 0:
                most = max(most, abs(cells[near].z_m - cells[at].z_m))
    return float(most)


@kernel
def _look(
    listed: I32, cells: Cells, window: Windowed, slopes: F32, steps: F32, roughness: F32
) -> None:
    """Judge the listed cells into the layers (flat)."""
    for at in listed:
        cell = cells[at]
        slopes[at] = steps[at] = roughness[at] = np.nan
        if cell.count == 0:
            continue
        steps[at] = _step(at, cells, window)
        a, b, off = _plane(at, cells, window)
        if math.isnan(a):
            continue
        slopes[at] = math.atan(math.hypot(a, b))
        rise = window[3] * (abs(a) + abs(b))  # of the plane itself, within the cell
        own = EVENLY * max(0.0, cell.z_high_m - cell.z_low_m - rise)
        roughness[at] = math.sqrt(off + own * own)


class Terrain:
    """Layers (size, size) float32 over a `CellGrid`, laid out as it is; NaN where not known.

    A cell at the edge of the window keeps what it was judged with when neighbours leave.
    """

    def __init__(self, cells: CellGrid) -> None:
        self._cells = cells
        self.slope_rad: F32 = cells.grid.layer(np.float32, np.nan)  # 0: level, of whatever heading
        self.step_m: F32 = cells.grid.layer(np.float32, np.nan)
        self.roughness_m: F32 = cells.grid.layer(np.float32, np.nan)  # rms, off the plane
        self._marks: I8 = np.zeros(cells.flat.size, dtype=np.int8)
        self._noted: I32 = np.zeros(cells.flat.size, dtype=np.int32)
        self._used = 0
        self.looks = 0  # cells looked at so far

    def note(self, touched: I32) -> None:
        """Cells (flat indices) that a scan touched: the next update looks at them."""
        self._used = _note(touched, self._marks, self._noted, self._used)

    def update(self) -> int:
        """Look again at what was touched since the last update; returns at how many cells."""
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
