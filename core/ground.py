"""The ground ahead, tracked from the floor returns themselves, so that a ramp is no obstacle.

The scanner sees the floor along one line, metres ahead. The tracker follows the height and the
slopes of the floor at that line. A ramp moves them little from scan to scan while the line moves
on, and is followed. A step or a wall holds the line still and lifts it: its cells are steep within
themselves and no longer count, the tracker goes back to what it held before it met them and stays
there. Nearer than the line, the ground is taken to lead straight from under the wheels to it.
Where the line is lost, planes that the robot's own attitude suggests are tried.
Source: design, section 7 (ground).
"""

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from core.beams import MAX_BEAMS, MIN_RANGE_M, Sweep
from core.cells import CellGrid, Cells, flat_index
from core.jit import kernel
from core.records import F64

DUE_M = 12.0  # farther off, a dark floor need not give a return
GATE_M = 0.05  # a return so near to the expected ground, or
GATE_SLOPE = 0.003  # this much of its range nearer, is taken for floor
STEEP = 0.25  # relief of a cell that is too steep for ground, share of its edge,
STEEP_M = 0.015  # and on top of it what noise makes
BIN_M, HALF_BINS, WIDE_BINS = 0.005, 20, 6  # in which the floor's height is looked for
PEAK_M = 0.025  # about it
FLAT_SHARE = 0.4  # of the returns near the plane lie so close together, if there is floor at all
LEAST = 15  # returns that make a line
FOLLOW_M = 0.4  # travel in which the line is followed,
FOLLOW_S = 20.0  # and time, when the robot stands
TURN_M = 1.0  # travel in which the slope across is followed
STEEPEST = math.tan(math.radians(12.0))
BACK_M = 0.6  # travel by which the tracker goes back when it has lost the line
KEPT = 64
TRIED_M = (0.0, 0.03, -0.03, 0.06, -0.06)  # offsets of planes that are tried
TRIED_SLOPES = (1.0, 0.0, 0.5, 1.5, 2.0)  # of the robot's own: half of it is on a ramp already
TRIED_GATE = 0.5  # of the gates


@kernel
def ground_m(ground: F64, x: float, y: float) -> float:
    """Height of the ground (map frame) at a place, by the (9,) numbers of `Ground.numbers`."""
    k = 0 if ground[6] * x + ground[7] * y >= ground[8] else 3
    return float(ground[k] + ground[k + 1] * x + ground[k + 2] * y)


@kernel
def due_m(lens: F64, ray: F64, ground: F64) -> float:
    """Range at which a beam should meet the ground at the line; inf where it does not go down."""
    above = lens[2] - (ground[0] + ground[1] * lens[0] + ground[2] * lens[1])
    fall = ray[2] - ground[1] * ray[0] - ground[2] * ray[1]
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


@kernel
def _peak(heights: F64, n: int) -> float:
    """Where most of n heights lie close together: floor does, the foot of a wall does not."""
    bins = np.zeros(2 * HALF_BINS, dtype=np.int64)
    for k in range(n):
        bins[max(0, min(2 * HALF_BINS - 1, int(heights[k] / BIN_M + HALF_BINS)))] += 1
    best, most = 0, -1
    for k in range(WIDE_BINS - 1, 2 * HALF_BINS):
        total = 0
        for m in range(WIDE_BINS):
            total += bins[k - m]
        if total > most:
            best, most = k, total
    return (best + 1 - 0.5 * WIDE_BINS - HALF_BINS) * BIN_M


@kernel
def _near_plane(
    lenses: F64,
    rays: F64,
    ranges_m: F64,
    ground: F64,
    anchor: F64,
    gate: float,
    window: tuple[int, int, int, float],
    cells: Cells,
    found: F64,
) -> tuple[int, int]:
    """Returns near the plane at the line, into `found` (n, 3): height over it, v, weight.

    v is the place across the robot's way. Returns how many, and how many might have been.
    """
    n, candidates = 0, 0
    for i in range(rays.shape[0]):
        due = due_m(lenses[i], rays[i], ground)
        r = ranges_m[0, i]
        if due > DUE_M or not r >= MIN_RANGE_M or r < 0.5 * due:
            continue
        candidates += 1
        x, y = lenses[i, 0] + r * rays[i, 0], lenses[i, 1] + r * rays[i, 1]
        h = lenses[i, 2] + r * rays[i, 2] - (ground[0] + ground[1] * x + ground[2] * y)
        if abs(h) > gate * (GATE_M + GATE_SLOPE * r) or _is_steep(x, y, window, cells):
            continue
        found[n, 0] = h
        found[n, 1] = ground[6] * (y - anchor[1]) - ground[7] * (x - anchor[0])
        found[n, 2] = 1.0 / (1.0 + 0.02 * r * r)
        n += 1
    return n, candidates


@kernel
def _fit(found: F64, n: int) -> tuple[int, float, float]:
    """The line through n returns (n, 3) of `_near_plane`, most of which are floor.

    Returns (how many make the line, their mean height over the plane, its slope across).
    """
    peak = _peak(found[:, 0], n)
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
def _anchor(lenses: F64, rays: F64, ground: F64, anchor: F64) -> bool:
    """Where the nearest of the beams should meet the ground, into `anchor` (2,); False: nowhere."""
    least = DUE_M
    for i in range(rays.shape[0]):
        due = due_m(lenses[i], rays[i], ground)
        if due < least:
            least = due
            anchor[0] = lenses[i, 0] + due * rays[i, 0]
            anchor[1] = lenses[i, 1] + due * rays[i, 1]
    return least < DUE_M


@dataclass(frozen=True, slots=True)
class Stand:
    """Where the robot stands, map frame: the body's origin, its heading, and its own plane."""

    x_m: float
    y_m: float
    z_m: float
    heading: tuple[float, float]  # unit vector
    slopes: tuple[float, float]  # of the body's x-y plane along map x and y
    travel_m: float  # since the start, signed


@dataclass(frozen=True, slots=True)
class Line:
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


class GroundTracker:
    """The ground by which heights are told: `numbers` (9,), for the kernels.

    They are offset and slopes along map x and y of the plane at the line, the same of the plane
    from under the wheels to it, and (a, b, c): the first one holds where a x + b y >= c.
    """

    def __init__(self, cells: CellGrid) -> None:
        self._cells = cells
        self.numbers: F64 = np.zeros(9)
        self.found = False  # the newest scan saw the line
        self.line: Line | None = None
        self._history: deque[Line] = deque(maxlen=KEPT)
        self._anchor = np.zeros(2)
        self._found = np.zeros((MAX_BEAMS, 3))
        self._last_s = -math.inf

    def erase(self) -> None:
        """Forget the line."""
        self.line, self.found = None, False
        self._history.clear()
        self._last_s = -math.inf

    def slope_rad(self, stand: Stand) -> tuple[float, float]:
        """Slope of the ground ahead (along, across): up ahead and up to the left are positive."""
        line = self.line
        if line is None:
            return 0.0, 0.0
        (hx, hy), gx, gy = stand.heading, line.slope_x, line.slope_y
        return math.atan(gx * hx + gy * hy), math.atan(gy * hx - gx * hy)

    def follow(self, sweep: Sweep, stand: Stand) -> None:
        """Take the floor returns of a scan, before they are added to the cells."""
        line, was_found = self.line, self.found
        if line is None:
            line = Line(stand.x_m, stand.y_m, stand.z_m, 0.0, 0.0, stand.travel_m)
        line = self._moved(line, sweep, stand)
        fitted = self._fitted(line, sweep, stand)
        if fitted is None and was_found:
            line = self._moved(self._before(stand), sweep, stand)
            fitted = self._fitted(line, sweep, stand)
        if fitted is None or self.line is None:
            tried = self._tried(sweep, stand)
            fitted = tried or fitted
        self.found = fitted is not None
        self.line = fitted or line
        self._set(self.line, stand)
        self._last_s = sweep.t_s
        if self.found and (
            not self._history
            or abs(stand.travel_m - self._history[-1].travel_m) > BACK_M / KEPT * 2
        ):
            self._history.append(self.line)

    def _set(self, line: Line, stand: Stand) -> None:
        """The numbers for a line, seen from where the robot stands."""
        (hx, hy), numbers = stand.heading, self.numbers
        ahead_m = hx * (line.x_m - stand.x_m) + hy * (line.y_m - stand.y_m)
        across = line.slope_y * hx - line.slope_x * hy
        aside_m = hx * (line.y_m - stand.y_m) - hy * (line.x_m - stand.x_m)
        rise_m = line.z_m - across * aside_m - stand.z_m
        along = rise_m / ahead_m if ahead_m > 0.5 else line.slope_x * hx + line.slope_y * hy
        near_x, near_y = along * hx - across * hy, along * hy + across * hx
        numbers[0] = line.z_m - line.slope_x * line.x_m - line.slope_y * line.y_m
        numbers[1], numbers[2] = line.slope_x, line.slope_y
        numbers[3] = stand.z_m - near_x * stand.x_m - near_y * stand.y_m
        numbers[4], numbers[5] = near_x, near_y
        numbers[6], numbers[7] = hx, hy
        numbers[8] = hx * line.x_m + hy * line.y_m

    def _moved(self, line: Line, sweep: Sweep, stand: Stand) -> Line:
        """The line where this scan should see it, on the same plane."""
        self._set(line, stand)
        if not _anchor(sweep.lenses, sweep.rays, self.numbers, self._anchor):
            return line
        x, y = float(self._anchor[0]), float(self._anchor[1])
        return Line(x, y, line.height_m(x, y), line.slope_x, line.slope_y, stand.travel_m)

    def _before(self, stand: Stand) -> Line:
        """The line as it was a while ago."""
        history = self._history
        while len(history) > 1 and abs(stand.travel_m - history[-1].travel_m) < BACK_M:
            history.pop()
        return history[-1]

    def _look(
        self, line: Line, sweep: Sweep, stand: Stand, gate: float
    ) -> tuple[int, int, float, float]:
        self._set(line, stand)
        self._anchor[:] = line.x_m, line.y_m
        cells = self._cells
        near, candidates = _near_plane(
            sweep.lenses,
            sweep.rays,
            sweep.ranges_m,
            self.numbers,
            self._anchor,
            gate,
            cells.window,
            cells.flat,
            self._found,
        )
        n, offset_m, slope = _fit(self._found, near)
        if n < FLAT_SHARE * near:
            n = 0
        return int(n), int(candidates), float(offset_m), float(slope)

    def _fitted(self, line: Line, sweep: Sweep, stand: Stand) -> Line | None:
        """The line moved towards what the scan shows; none if it does not show it."""
        n, candidates, offset_m, across = self._look(line, sweep, stand, 1.0)
        if n < max(LEAST, 0.1 * candidates):
            return None
        passed_s = max(0.0, min(1.0, sweep.t_s - self._last_s))
        before_m = self.line.travel_m if self.line else stand.travel_m
        moved_m = abs(stand.travel_m - before_m)
        stay = math.exp(-moved_m / FOLLOW_M - passed_s / FOLLOW_S)
        rise_m = (1.0 - stay**2) * offset_m
        most_m = STEEPEST * moved_m + 0.02 * passed_s
        rise_m = max(-most_m, min(most_m, rise_m))
        bend = (1.0 - math.exp(-moved_m / FOLLOW_M)) ** 2 * offset_m / max(moved_m, 1e-3)
        if stand.travel_m < before_m:
            bend = -bend
        tilt = (1.0 - math.exp(-moved_m / TURN_M - passed_s / FOLLOW_S)) * across
        hx, hy = stand.heading
        slope_x = _limited(line.slope_x + bend * hx - tilt * hy)
        slope_y = _limited(line.slope_y + bend * hy + tilt * hx)
        return Line(line.x_m, line.y_m, line.z_m + rise_m, slope_x, slope_y, stand.travel_m)

    def _tried(self, sweep: Sweep, stand: Stand) -> Line | None:
        """The plane through the robot's wheels that most of the returns lie on, if many do."""
        best, most = None, LEAST
        for share in TRIED_SLOPES:
            slopes = (_limited(share * stand.slopes[0]), _limited(share * stand.slopes[1]))
            for offset_m in TRIED_M:
                z_m = stand.z_m + offset_m
                line = Line(stand.x_m, stand.y_m, z_m, *slopes, stand.travel_m)
                line = self._moved(line, sweep, stand)
                n, candidates, _, _ = self._look(line, sweep, stand, TRIED_GATE)
                if n > most * 1.1 and n >= 0.3 * candidates:
                    best, most = line, n
        if best is not None:
            self._history.clear()
        return best


def _limited(slope: float) -> float:
    return max(-STEEPEST, min(STEEPEST, slope))
