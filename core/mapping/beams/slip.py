"""How far the pose has slid along its way, by upright faces that the robot drives towards.

Wheels that slip alike count more than the robot travels, and no gyro sees it. But the front of a
pillar, a box or a wall stays where it is: returns from it that come to lie before or behind those
that made it known tell how far the pose is off along the way. Only faces that look along the way
are used, and many returns of a scan must agree in their middle. `core.motion.slip` judges whether
what they say over a while is slip.
Source: point-to-line matching, Censi, ICRA 2008, in one direction.
"""

import math

import numpy as np

from core.mapping.beams.cells import CellGrid, Cells, flat_index
from core.mapping.beams.ground_plane import BodyPose, Ground, ground_m
from core.mapping.rays import MIN_RANGE_M, Sweep
from core.motion.slip import SlipEstimator
from core.records import F64
from jit import kernel

LOW_M = 0.25  # above the ground: lower returns may be of the top of a thing, or of a slope
APART = 2  # beams to either side that tell how a face runs
ALONG_M = 0.3  # and how far off they may be
UPRIGHT_M = 0.1  # between its lowest and its highest return: a floor or the top of a thing has not
FACING = 0.95  # cosine between a face's normal and the way
MADE_OF = 40  # returns that make a face known
KNOWN = 12  # of them, from which on it tells something
MOST_M = 0.25
LEAST = 12  # returns that agree
AGREE_M = 0.05  # about their middle
SAME_SEGMENT = math.cos(math.radians(20.0))  # a robot that has turned by more makes its faces anew


@kernel
def _normal(
    origins: F64, rays: F64, ranges_m: F64, i: int, hx: float, hy: float, normal: F64
) -> bool:
    """Whether the surface that a beam meets looks along the way; its normal (2,), along it."""
    a, b = i - APART, i + APART
    if a < 0 or b >= rays.shape[0]:
        return False
    r, ra, rb = ranges_m[0, i], ranges_m[0, a], ranges_m[0, b]
    if not (abs(ra - r) < ALONG_M and abs(rb - r) < ALONG_M and ra > MIN_RANGE_M):
        return False
    dx = origins[b, 0] + rb * rays[b, 0] - origins[a, 0] - ra * rays[a, 0]
    dy = origins[b, 1] + rb * rays[b, 1] - origins[a, 1] - ra * rays[a, 1]
    length = math.hypot(dx, dy)
    if length < 1e-3:
        return False
    facing = (dy * hx - dx * hy) / length
    sign = 1.0 if facing > 0 else -1.0
    normal[0], normal[1] = sign * dy / length, -sign * dx / length
    return bool(abs(facing) >= FACING)


@kernel
def _is_upright_face(cells: Cells, at: int, segment: int) -> bool:
    """Whether a cell holds a face that is known, and was met at different heights."""
    cell = cells[at]
    is_upright = cell.z_high_m - cell.z_low_m >= UPRIGHT_M
    return bool(cell.face_segment == segment and cell.face_n >= KNOWN and is_upright)


@kernel
def _off(
    x: float,
    y: float,
    normal: F64,
    cell_m: float,
    corner: tuple[int, int],
    size: int,
    segment: int,
    cells: Cells,
) -> float:
    """How far a return lies ahead of the nearest known face; inf: there is none near."""
    best = math.inf
    for step in range(-1, 2):
        sx, sy = x + step * cell_m * normal[0], y + step * cell_m * normal[1]
        at = flat_index(sx, sy, cell_m, corner, size)
        if at >= 0 and _is_upright_face(cells, at, segment):
            off = (x - cells[at].face_x_m) * normal[0] + (y - cells[at].face_y_m) * normal[1]
            if abs(off) < abs(best):
                best = off
    return best if abs(best) <= MOST_M else math.inf


@kernel
def _offsets_of(
    origins: F64,
    rays: F64,
    ranges_m: F64,
    ground: Ground,
    hx: float,
    hy: float,
    window: tuple[int, int, int, float],
    segment: int,
    cells: Cells,
    offsets: F64,
) -> int:
    """How far (k,) along the way returns lie ahead of the faces they belong to; learns new ones."""
    corner, size, cell_m = (window[0], window[1]), window[2], window[3]
    normal, n = np.zeros(2), 0
    for i in range(rays.shape[0]):
        r = ranges_m[0, i]
        if not r >= MIN_RANGE_M or not _normal(origins, rays, ranges_m, i, hx, hy, normal):
            continue
        x, y = origins[i, 0] + r * rays[i, 0], origins[i, 1] + r * rays[i, 1]
        if origins[i, 2] + r * rays[i, 2] - ground_m(ground, x, y) < LOW_M:
            continue
        off = _off(x, y, normal, cell_m, corner, size, segment, cells)
        if math.isfinite(off):
            offsets[n] = off / (normal[0] * hx + normal[1] * hy)
            n += 1
        own = flat_index(x, y, cell_m, corner, size)
        if own < 0:
            continue
        if cells[own].face_segment != segment:
            cells[own].face_segment, cells[own].face_n = segment, 0
        if cells[own].face_n >= MADE_OF:
            continue
        if math.isinf(off) or cells[own].face_n > 0:
            cell = cells[own]
            cell.face_n += 1
            cell.face_x_m += (x - cell.face_x_m) / cell.face_n
            cell.face_y_m += (y - cell.face_y_m) / cell.face_n
    return n


@kernel
def _agreeing(offsets: F64, middle_m: float) -> tuple[int, float]:
    """How many of some (n,) agree with their middle, and their mean."""
    count, total_m = 0, 0.0
    for k in range(len(offsets)):
        if abs(offsets[k] - middle_m) <= AGREE_M:
            count, total_m = count + 1, total_m + offsets[k]
    return count, total_m / max(count, 1)


class FaceMatcher:
    """What stands across the way, in the cells of a `CellGrid`, and what it says of the pose."""

    def __init__(self, cells: CellGrid, max_beams: int) -> None:
        self._cells = cells
        self._offsets = np.zeros(max_beams)
        self._slip = SlipEstimator()
        self._segment, self._heading = 1, (math.nan, math.nan)

    def warm(self) -> None:
        """Run the kernel that few scans need."""
        _agreeing(self._offsets[:1], 0.0)

    def erase(self) -> None:
        """Forget what they told; the cells forget the faces."""
        self._slip.restart()

    def maybe_slipped_m(
        self, sweep: Sweep, ground: Ground, body: BodyPose, corrected_m: F64
    ) -> float | None:
        """How far the pose has newly run ahead along the heading, if enough of a sweep shows it.

        corrected_m (2,) is the sum of all corrections of the place so far. Returns of the sweep add
        to the faces.
        """
        cells, (hx, hy) = self._cells, body.heading
        if not self._heading[0] * hx + self._heading[1] * hy >= SAME_SEGMENT:
            self._segment, self._heading = self._segment + 1, body.heading
            self._slip.restart()
        n = _offsets_of(
            sweep.origins,
            sweep.rays,
            sweep.ranges_m,
            ground,
            hx,
            hy,
            cells.window,
            self._segment,
            cells.flat,
            self._offsets,
        )
        if n < LEAST:
            return None
        offsets = self._offsets[:n]
        ordered = sorted(offsets.tolist())
        median_m = (ordered[n // 2] + ordered[(n - 1) // 2]) / 2
        count, mean_m = _agreeing(offsets, median_m)
        if count < max(LEAST, 0.5 * n):
            return None
        corrected_ahead_m = float(hx * corrected_m[0] + hy * corrected_m[1])
        return self._slip.maybe_slipped_m(body.travel_m, mean_m, corrected_ahead_m)
