"""The floor where the scanner sees it: the plane at that line, and the returns that lie on it.

Source: design, section 7 (ground).
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from core.grid.places import flat_index
from core.mapping.beams.cells import Cells
from core.mapping.body import BodyPose
from core.mapping.rays import MIN_RANGE_M
from core.records import F64
from jit import allocating_kernel, kernel

DUE_M = 12.0  # farther off, a dark floor need not give a return
GATE_M = 0.10  # returns so near to the expected ground, and
GATE_SLOPE = 0.006  # this much of their range, are looked at
STEEP = 0.25  # relief of a cell that is too steep for ground, share of its edge,
STEEP_M = 0.015  # and on top of it what noise makes
BIN_M, HALF_BINS, WIDE_BINS = 0.005, 34, 6  # in which the floor's height is looked for
PEAK_M = 0.025  # about it
WIDE_M = 0.03  # bins where nothing is known of it: within a metre
TURNS_WITH = math.tan(math.radians(1.2))  # a slope that may be the attitude's error


class Ground(NamedTuple):
    """The ground by which heights are told, for the kernels; metres, map frame.

    A plane (height at the origin, slopes along x and y) holds at the line and behind it, where
    hx x + hy y >= from_m; another one from under the wheels to the line.
    """

    far_m: float
    far_x: float
    far_y: float
    near_m: float
    near_x: float
    near_y: float
    hx: float  # heading
    hy: float
    from_m: float
    jitter_m: float  # by so much this very scan shows the line too high, where scans jitter


LEVEL = Ground(*[0.0] * 10)


@kernel
def ground_m(ground: Ground, x: float, y: float) -> float:
    """Height of the ground (map frame) at a place."""
    if ground.hx * x + ground.hy * y >= ground.from_m:
        return ground.far_m + ground.far_x * x + ground.far_y * y
    return ground.near_m + ground.near_x * x + ground.near_y * y


@kernel
def heights_over(origins: F64, rays: F64, ranges_m: F64, ground: Ground, heights_m: F64) -> None:
    """Fill how high over the ground first returns (n,) lie; NaN where there is none."""
    for b in range(rays.shape[0]):
        r = ranges_m[0, b]
        x, y, z = origins[b, 0] + r * rays[b, 0], origins[b, 1] + r * rays[b, 1], origins[b, 2]
        heights_m[b] = z + r * rays[b, 2] - ground_m(ground, x, y)


@kernel
def due_m(origin: F64, ray: F64, ground: Ground) -> float:
    """Range at which a beam should meet the ground at the line; inf where it does not go down."""
    above = origin[2] - (ground.far_m + ground.far_x * origin[0] + ground.far_y * origin[1])
    fall = ray[2] - ground.far_x * ray[0] - ground.far_y * ray[1]
    if fall > -1e-3 or above <= 0.0:
        return math.inf
    return float(-above / fall)


@kernel
def _is_steep(x: float, y: float, window: tuple[int, int, int, float], cells: Cells) -> bool:
    """Whether the cell of a point rises too much within itself to be ground."""
    at = flat_index(x, y, window[3], (window[0], window[1]), window[2])
    if at < 0 or cells[at].count == 0:
        return False
    return bool(cells[at].z_high_m - cells[at].z_low_m > STEEP * window[3] + STEEP_M)


@allocating_kernel
def _peak(found: F64, n: int, over_m: float, bin_m: float) -> float:
    """Where most of n heights lie close together: floor does, the foot of a wall does not.

    Heights are those in column 0 of `found`, and the result, over a height.
    """
    bins = np.zeros(2 * HALF_BINS, dtype=np.int64)
    for k in range(n):
        bins[max(0, min(2 * HALF_BINS - 1, int((found[k, 0] - over_m) / bin_m + HALF_BINS)))] += 1
    best, most = 0, -1
    for k in range(WIDE_BINS - 1, 2 * HALF_BINS):
        total = 0
        for m in range(WIDE_BINS):
            total += bins[k - m]
        if total > most:
            best, most = k, total
    return (best + 1 - 0.5 * WIDE_BINS - HALF_BINS) * bin_m


@kernel
def near_plane(
    origins: F64,
    rays: F64,
    ranges_m: F64,
    ground: Ground,
    anchor: F64,
    gate: float,
    window: tuple[int, int, int, float],
    cells: Cells,
    found: F64,
) -> tuple[int, int]:
    """Returns near the plane at the line, into `found` (n, 5): height over it, v, weight, x, y.

    v is the place across the robot's way. Returns how many, and how many might have been.
    """
    n, candidates = 0, 0
    for i in range(rays.shape[0]):
        due = due_m(origins[i], rays[i], ground)
        r = ranges_m[0, i]
        if due > DUE_M or not r >= MIN_RANGE_M or r < 0.5 * due:
            continue
        candidates += 1
        x, y = origins[i, 0] + r * rays[i, 0], origins[i, 1] + r * rays[i, 1]
        h = origins[i, 2] + r * rays[i, 2] - (ground.far_m + ground.far_x * x + ground.far_y * y)
        if abs(h) > gate * (GATE_M + GATE_SLOPE * r) or _is_steep(x, y, window, cells):
            continue
        found[n, 0] = h
        found[n, 1] = ground.hx * (y - anchor[1]) - ground.hy * (x - anchor[0])
        found[n, 2] = 1.0 / (1.0 + 0.02 * r * r)
        found[n, 3], found[n, 4] = x, y
        n += 1
    return n, candidates


@kernel
def fit(found: F64, n: int) -> tuple[int, float, float]:
    """The line through n returns (n, 3) of `near_plane`, most of which are floor.

    Returns (how many make the line, their mean height over the plane, its slope across).
    """
    peak = _peak(found, n, 0.0, BIN_M)
    s0 = sv = svv = sh = shv = 0.0
    used = 0
    for k in range(n):
        h, v, w = found[k, 0], found[k, 1], found[k, 2]
        if abs(h - peak) <= PEAK_M:
            used += 1
            s0, sv, svv = s0 + w, sv + w * v, svv + w * v * v
            sh, shv = sh + w * h, shv + w * h * v
    if used < 2:
        return used, 0.0, 0.0
    svv += s0  # as if a metre of level floor were known: a short line says little of the slope
    slope = (s0 * shv - sv * sh) / (s0 * svv - sv * sv)
    return used, (sh - slope * sv) / s0, slope


@kernel
def seek(found: F64, n: int, at: F64) -> int:
    """Where most of n returns (n, 5) of `near_plane` lie close together, however far off it.

    Their mean height over it, x and y go into `at` (3,); returns how many they are.
    """
    wide = _peak(found, n, 0.0, WIDE_M)
    fine = wide + _peak(found, n, wide, BIN_M)
    used = 0
    at[:] = 0.0
    for k in range(n):
        if abs(found[k, 0] - fine) <= PEAK_M:
            used += 1
            at[0] += (found[k, 0] - at[0]) / used
            at[1] += (found[k, 3] - at[1]) / used
            at[2] += (found[k, 4] - at[2]) / used
    return used


@kernel
def nearest_due(origins: F64, rays: F64, ground: Ground, anchor: F64) -> bool:
    """Where the nearest of the beams should meet the ground, into `anchor` (2,); False: nowhere."""
    least = DUE_M
    for i in range(rays.shape[0]):
        due = due_m(origins[i], rays[i], ground)
        if due < least:
            least = due
            anchor[0] = origins[i, 0] + due * rays[i, 0]
            anchor[1] = origins[i, 1] + due * rays[i, 1]
    return least < DUE_M


@dataclass(frozen=True, slots=True)
class GroundPlane:
    """The floor where the scanner sees it: height and slopes at a place, map frame."""

    x_m: float
    y_m: float
    z_m: float
    slope_x: float
    slope_y: float
    travel_m: float

    def height_m(self, x_m: float, y_m: float) -> float:
        """Of the plane, at a place."""
        return self.z_m + self.slope_x * (x_m - self.x_m) + self.slope_y * (y_m - self.y_m)


def turned(line: GroundPlane, heading: tuple[float, float], body: BodyPose) -> GroundPlane:
    """A line that is nearly level turns with the robot: so does an attitude that is off.

    Args:
        heading: of the robot when the line lay so.
    """
    if math.hypot(line.slope_x, line.slope_y) > TURNS_WITH:
        return line
    (ax, ay), (bx, by) = heading, body.heading
    c, s = ax * bx + ay * by, ax * by - ay * bx
    dx, dy = line.x_m - body.x_m, line.y_m - body.y_m
    return GroundPlane(
        body.x_m + c * dx - s * dy,
        body.y_m + s * dx + c * dy,
        line.z_m,
        c * line.slope_x - s * line.slope_y,
        s * line.slope_x + c * line.slope_y,
        line.travel_m,
    )
