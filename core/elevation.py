"""What a cell's height is: the average of all heights that fell into it, and evidence against free.

The average alone would hide the edge of a box or the mouth of a ditch behind the floor that shares
its cell. So each cell also counts what contradicts "floor": returns beyond the height bounds, and
beams that passed below the ground there before they ended lower than `h_neg`: where a beam is below
the ground there is no ground. And it keeps whether anything rises or falls in it, and on which
sides of it, seen from the laser, the ground should go on.
Source: the paper, section 4.2.2 (average); design, section 7.
"""

import math

import numpy as np

from core.grid import RingGrid
from core.jit import kernel
from core.records import F64, I32, I64, U8

RISING_M = 0.03  # a return so far off the ground may belong to the foot of something,
RELIEF_M = 0.012  # and so may heights in one cell of one scan, which no wrong attitude sets apart
MAX_COUNT = 1_000_000_000
MAX_EVIDENCE = 60_000
HOLE_STEPS = 0.25  # of a cell: how finely a beam is followed below the ground
MAX_HOLE_STEPS = 256  # along one beam: 64 cells
MAX_TOUCHED = 250_000  # cells of one scan: two echoes of 1081 beams, what they dug, neighbours


# mean, count, beyond, rising, far sides, looks, hit scan, span, stamp, beyond scan: flat views
Layers = tuple[F64, I32, I32, U8, U8, I32, I64, F64, I64, I64]


@kernel
def _touch(at: int, stamp: I64, serial: int, touched: I32, used: int) -> int:
    """Note a flat cell index once per scan."""
    if stamp[at] != serial and used < touched.size:
        stamp[at] = serial
        touched[used] = at
        return used + 1
    return used


@kernel
def _touch_around(at: int, size: int, stamp: I64, serial: int, touched: I32, used: int) -> int:
    """Note a cell that is seen for the first time, and its neighbours: they wait for it."""
    row, column = at // size, at % size
    for dj in range(-1, 2):
        for di in range(-1, 2):
            near = ((row + dj) % size) * size + (column + di) % size
            used = _touch(near, stamp, serial, touched, used)
    return used


@kernel
def octant(dx: float, dy: float) -> int:
    """Which of the eight neighbours a direction points to: 0 is +x, counter-clockwise."""
    return round(math.atan2(dy, dx) / (math.pi / 4)) % 8


@kernel
def _flat(x: float, y: float, cell_m: float, corner: tuple[int, int], size: int) -> int:
    """Flat index of the cell of a point, -1 outside of the window."""
    i, j = math.floor(x / cell_m), math.floor(y / cell_m)
    if not (0 <= i - corner[0] < size and 0 <= j - corner[1] < size):
        return -1
    return int((j % size) * size + i % size)


@kernel
def _contradict(at: int, layers: Layers, serial: int) -> None:
    """Something speaks against "floor" in this cell; counted once a scan: errors come together."""
    beyond, beyond_scan = layers[2], layers[9]
    if beyond_scan[at] != serial and beyond[at] < MAX_EVIDENCE:
        beyond_scan[at] = serial
        beyond[at] += 1


@kernel
def _fall_in(at: int, z: float, layers: Layers, bounds: tuple[float, float], serial: int) -> None:
    """One return of height z falls into the cell `at`."""
    mean, count, _, rising, _, looks, hit_scan, span, _, _ = layers
    if hit_scan[at] != serial:
        hit_scan[at] = serial
        looks[at] += 1
        span[at, 0] = span[at, 1] = z
    span[at, 0], span[at, 1] = min(span[at, 0], z), max(span[at, 1], z)
    if abs(z) > RISING_M or span[at, 1] - span[at, 0] > RELIEF_M:
        rising[at] = 1
    if count[at] < MAX_COUNT:
        count[at] += 1
    mean[at] += (z - mean[at]) / count[at]
    if z >= bounds[0] or z <= bounds[1]:
        _contradict(at, layers, serial)


@kernel
def _add_points(
    points: F64,
    lenses: F64,
    bounds: tuple[float, float],
    window: tuple[int, int, int, float],
    layers: Layers,
    serial: int,
    touched: I32,
) -> int:
    """Take the returns of one scan; fills `touched` and returns how many cells it lists."""
    _, count, beyond, _, far_sides, _, _, _, stamp, _ = layers
    corner, size, cell_m = (window[0], window[1]), window[2], window[3]
    used = 0
    for p in range(points.shape[0]):
        x, y, z = points[p]
        dx, dy = x - lenses[p, 0], y - lenses[p, 1]
        at = _flat(x, y, cell_m, corner, size)
        if at >= 0:
            if count[at] == 0 and beyond[at] == 0:
                used = _touch_around(at, size, stamp, serial, touched, used)
            far_sides[at] |= 1 << octant(dx, dy)
            _fall_in(at, z, layers, bounds, serial)
            used = _touch(at, stamp, serial, touched, used)
        if z > bounds[1] or lenses[p, 2] <= 0:
            continue
        share = lenses[p, 2] / (lenses[p, 2] - z)  # of the beam, where it met the ground's height
        below_m = (1 - share) * math.hypot(dx, dy)
        steps = min(math.ceil(below_m / (HOLE_STEPS * cell_m)), MAX_HOLE_STEPS)
        last = at
        for s in range(1, steps):
            along = share + (1 - share) * s / steps
            dug = _flat(lenses[p, 0] + along * dx, lenses[p, 1] + along * dy, cell_m, corner, size)
            if dug >= 0 and dug != last and dug != at:
                if count[dug] == 0 and beyond[dug] == 0:
                    used = _touch_around(dug, size, stamp, serial, touched, used)
                _contradict(dug, layers, serial)
                used = _touch(dug, stamp, serial, touched, used)
            last = dug
    return used


class MeanCells:
    """Layers of a RingGrid, all (size, size).

    `mean_m` and `count` of the heights; `beyond`: scans that contradict "floor"; `rising`: 1 once
    something rose or fell in it; `far_sides`: bit k is set once a beam went on towards octant k;
    `looks`: scans of which a return fell in.
    """

    def __init__(self, grid: RingGrid, h_pos_m: float, h_neg_m: float) -> None:
        self.grid, self._bounds = grid, (h_pos_m, h_neg_m)
        self.mean_m: F64 = grid.layer(np.float64, 0.0)  # above the ground under the robot
        self.count: I32 = grid.layer(np.int32, 0)
        self.beyond: I32 = grid.layer(np.int32, 0)
        self.rising: U8 = grid.layer(np.uint8, 0)
        self.far_sides: U8 = grid.layer(np.uint8, 0)
        self.looks: I32 = grid.layer(np.int32, 0)
        hit_scan: I64 = grid.layer(np.int64, 0)  # newest scan of which a return fell in,
        span_m = np.zeros((grid.size**2, 2))  # and the lowest and highest height of that scan
        stamp: I64 = grid.layer(np.int64, 0)  # newest scan that listed the cell as touched
        beyond_scan: I64 = grid.layer(np.int64, 0)  # newest scan that contradicted "floor"
        self._layers: Layers = (
            self.mean_m.ravel(),
            self.count.ravel(),
            self.beyond.ravel(),
            self.rising.ravel(),
            self.far_sides.ravel(),
            self.looks.ravel(),
            hit_scan.ravel(),
            span_m,
            stamp.ravel(),
            beyond_scan.ravel(),
        )
        self.scans = 0
        self._touched = np.zeros(min(MAX_TOUCHED, grid.size**2), dtype=np.int32)

    def add(self, points: F64, lenses: F64) -> I32:
        """Take the returns of a scan, (k, 3) map frame; the flat indices of all cells touched."""
        self.scans += 1
        grid = self.grid
        window = (grid.corner_i, grid.corner_j, grid.size, grid.cell_m)
        used = _add_points(
            points, lenses, self._bounds, window, self._layers, self.scans, self._touched
        )
        return self._touched[:used]
