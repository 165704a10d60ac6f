"""How far the robot can go on as it moves before its footprint meets a cell that is not free.

The footprint, a rectangle about the drive axle, is swept along the commanded arc over the way that
it takes to stop; each cell counts with all of its square. Around the footprint a margin is kept:
the way ends where the margin meets a cell. Where a cell lies within the margin already, the robot
can leave and go past, but not near: such a cell stops a motion that would bring the footprint
itself to it, other cells one that would bring them nearer than the nearest is now, and a cell under
the footprint one that goes deeper, now or on its way. Ground outside the window is unknown.
Source: design, sections 7 and 8.
"""

import math

import numpy as np
from msgspec import Struct

from core.grid.ring import RingGrid, cells_about
from core.records import F64, FREE, I8, I32, UNKNOWN
from jit import allocating_kernel, kernel

STEP_CELLS = 0.5  # of the sweep,
PARTS = 8  # of a step, at each of which a near cell counts: a corner may clip it in between
STRIDE_M = 0.2  # of its way, for which cells that are near are looked for once
LONGEST_M = 10.0  # sweep
TOUCH_M = 1e-9  # an edge in common is no contact
SLACK_M = 0.02  # beside a wall within the margin, nobody goes along quite straight
HALVINGS = 3  # of a part, to find where it met a cell
STANDING_MPS = 1e-6
SLOWEST_MPS = 0.03  # below this there is no going

Rect = tuple[float, float, float]  # ahead of the axle, behind it, to either side; metres
Place = tuple[float, float, float]  # x, y, yaw in the map frame
Motion = tuple[float, float]  # forward m/s, counter-clockwise rad/s
Window = tuple[int, int, int]  # corner i, corner j, size
Heading = tuple[float, float]  # cosine and sine of a place's yaw


@kernel
def _at(start: Place, v: float, w: float, t: float) -> Place:
    """Where an arc has led after t seconds: x, y, yaw."""
    x, y, yaw = start
    turn = w * t
    if abs(turn) < 1e-6:
        ahead, aside = v * t, 0.5 * v * t * turn
    else:
        ahead, aside = v / w * math.sin(turn), v / w * (1.0 - math.cos(turn))
    c, s = math.cos(yaw), math.sin(yaw)
    return x + c * ahead - s * aside, y + s * ahead + c * aside, yaw + turn


@kernel
def gap_to(cx: float, cy: float, half: float, place: Place, rect: Rect) -> float:
    """By how much the rectangle must grow to meet a square cell about (cx, cy); < 0: it does."""
    return gap_along(cx, cy, half, place, heading_of(place), rect)


@kernel
def heading_of(place: Place) -> Heading:
    """Worked out once for the gaps of many cells at one place."""
    return math.cos(place[2]), math.sin(place[2])


@kernel
def gap_along(
    cx: float, cy: float, half: float, place: Place, heading: Heading, rect: Rect
) -> float:
    """`gap_to`, with the heading of the place."""
    c, s = heading
    dx, dy = cx - place[0], cy - place[1]
    ahead, aside = c * dx + s * dy, c * dy - s * dx
    spread = abs(c) + abs(s)
    middle, length = (rect[0] - rect[1]) / 2, (rect[0] + rect[1]) / 2
    mx, my = c * middle - dx, s * middle - dy  # the rectangle's middle from the cell's
    return max(
        abs(ahead - middle) - length - half * spread,
        abs(aside) - rect[2] - half * spread,
        (abs(mx) - half - length * abs(c) - rect[2] * abs(s)) / spread,
        (abs(my) - half - length * abs(s) - rect[2] * abs(c)) / spread,
    )


@kernel
def read_row(i: int, j: int, cells: I8, window: Window, states: I8) -> None:
    """Fill `states` with those of as many cells, (i, j), (i + 1, j) and so on.

    UNKNOWN outside the window.
    """
    size, n = window[2], states.size
    begin, end = min(n, max(0, window[0] - i)), max(0, min(n, window[0] + size - i))
    if not window[1] <= j < window[1] + size:
        begin = end = n
    row, column = j % size, (i + begin) % size
    for k in range(begin):
        states[k] = UNKNOWN
    for k in range(begin, end):
        states[k] = cells[row, column]
        column = column + 1 if column + 1 < size else 0
    for k in range(end, n):
        states[k] = UNKNOWN


@kernel
def is_in_way(state: int, i: int, j: int, cell_m: float, clear: Place) -> bool:
    """Whether a cell is not FREE, nor UNKNOWN ground that somebody vouches for.

    clear: x, y and radius of that ground; an infinite one is everywhere.
    """
    if state != UNKNOWN:
        return state != FREE
    x, y = (i + 0.5) * cell_m - clear[0], (j + 0.5) * cell_m - clear[1]
    return not (max(abs(x), abs(y)) <= clear[2] and math.hypot(x, y) <= clear[2])


@kernel
def leaves(
    cx: float,
    cy: float,
    place: Place,
    rect: Rect,
    v: float,
    w: float,
) -> bool:
    """Whether a cell under the rectangle is on its way out, over the edge that it is nearest to."""
    c, s = math.cos(place[2]), math.sin(place[2])
    dx, dy = cx - place[0], cy - place[1]
    ahead, aside = c * dx + s * dy, c * dy - s * dx
    to_front, to_rear = rect[0] - ahead, rect[1] + ahead
    to_side = rect[2] - abs(aside)
    if to_side <= to_front and to_side <= to_rear:
        return (-w * ahead) * aside > 1e-9
    outward = -v + w * aside
    return outward > 1e-9 if to_front <= to_rear else outward < -1e-9


@allocating_kernel
def cells_near(
    cells: I8,
    window: Window,
    cell_m: float,
    place: Place,
    rect: Rect,
    within: float,
    clear: Place,
) -> I32:
    """(n, 3) i, j and state of all cells in the way to which the gap is less than `within`."""
    reach = math.hypot(max(rect[0], rect[1]) + within, rect[2] + within)
    low_i, low_j, count = cells_about(place[0], place[1], reach, cell_m)
    found, used = np.empty((count * count, 3), np.int32), 0
    states, heading, half = np.empty(count, np.int8), heading_of(place), cell_m / 2
    for j in range(low_j, low_j + count):
        read_row(low_i, j, cells, window, states)
        for k in range(count):
            if states[k] == FREE:
                continue
            i = low_i + k
            cx, cy = (i + 0.5) * cell_m, (j + 0.5) * cell_m
            gap = gap_along(cx, cy, half, place, heading, rect)
            if gap < within and is_in_way(states[k], i, j, cell_m, clear):
                found[used, 0], found[used, 1], found[used, 2] = i, j, states[k]
                used += 1
    return found[:used]


@allocating_kernel
def clearance(
    cells: I8,
    window: Window,
    cell_m: float,
    place: Place,
    rect: Rect,
    margin: float,
    clear: Place,
) -> float:
    """What is to be kept free of new cells: the margin, or less where it is not free now."""
    least, near = margin, cells_near(cells, window, cell_m, place, rect, margin, clear)
    heading = heading_of(place)
    for n in range(near.shape[0]):
        cx, cy = (near[n, 0] + 0.5) * cell_m, (near[n, 1] + 0.5) * cell_m
        gap = gap_along(cx, cy, cell_m / 2, place, heading, rect)
        if -TOUCH_M <= gap < least - SLACK_M:
            least = gap
    return least if least == margin else max(0.0, least - SLACK_M)


@kernel
def _first(
    cx: float,
    cy: float,
    half: float,
    place: Place,
    rect: Rect,
    motion: Motion,
    span: tuple[float, float],
    least: float,
) -> float:
    """Seconds, within a span at whose end it is, until a cell's gap is less than `least`."""
    low, high = span
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        if gap_to(cx, cy, half, _at(place, motion[0], motion[1], middle), rect) < least:
            high = middle
        else:
            low = middle
    return low


@kernel
def drift_m(rect: Rect, margin: float, motion: Motion, for_s: float) -> float:
    """How far, at most, the edge of the rectangle and its margin gets in so many seconds."""
    return for_s * (abs(motion[0]) + abs(motion[1]) * (max(rect) + margin))


@kernel
def _free_path(
    cx: float,
    cy: float,
    half: float,
    place: Place,
    then: tuple[Place, Heading],
    rect: Rect,
    motion: Motion,
    span: tuple[float, float],
    pace: tuple[float, float],
    limit: tuple[float, float],
    best: float,
) -> float:
    """How far the robot gets before a cell that comes in the way in a span; inf: it does not.

    then: the place at that end, its heading. pace: metres per second, and how far an edge gets in
    a span. limit: that of the cell (`_limits`). best: inf also where it leaves no less.
    """
    (rate, drift), (least, taken) = pace, limit
    if rate * span[0] - taken >= best:
        return math.inf
    if gap_along(cx, cy, half, then[0], then[1], rect) >= least + drift:
        return math.inf
    part = (span[1] - span[0]) / PARTS
    for n in range(PARTS):
        low, high = span[0] + n * part, span[0] + (n + 1) * part
        at = _at(place, motion[0], motion[1], high)
        if gap_to(cx, cy, half, at, rect) < least - TOUCH_M:
            return rate * _first(cx, cy, half, place, rect, motion, (low, high), least) - taken
    return math.inf


@allocating_kernel
def _limits(
    near: I32,
    cell_m: float,
    place: Place,
    rect: Rect,
    motion: Motion,
    margin: float,
    kept: float,
) -> tuple[F64, F64]:
    """Of listed cells (n,): below which gap one ends the motion, and metres that it takes off.

    kept: what is to be kept free of new cells. A gap of -inf: it ends none, for it is unknown
    ground under the footprint. An obstacle under it that is on its way out may still get deeper
    later, as one does that lies off a corner.
    """
    least, taken, heading = np.zeros(near.shape[0]), np.empty(near.shape[0]), heading_of(place)
    for n in range(near.shape[0]):
        cx, cy = (near[n, 0] + 0.5) * cell_m, (near[n, 1] + 0.5) * cell_m
        gap = gap_along(cx, cy, cell_m / 2, place, heading, rect)
        taken[n] = margin
        if gap >= margin - TOUCH_M:
            least[n], taken[n] = kept, 0.0
        elif gap < -TOUCH_M and near[n, 2] == UNKNOWN:
            least[n] = -math.inf
        elif gap < -TOUCH_M and leaves(cx, cy, place, rect, motion[0], motion[1]):
            least[n] = -SLACK_M if gap > -SLACK_M else gap - SLACK_M
    return least, taken


@allocating_kernel
def _sweep(
    cells: I8,
    window: Window,
    cell_m: float,
    place: Place,
    rect: Rect,
    motion: Motion,
    way: tuple[float, float, float],
    clear: Place,
) -> tuple[float, int, int, int]:
    """(free metres, i, j, state) of the nearest blocking cell; inf if none stands in the way.

    way: metres to sweep, metres per second, margin. clear: as of `is_in_way`. What may be met is
    listed once for some steps.
    """
    length, rate, margin = way
    kept = clearance(cells, window, cell_m, place, rect, margin, clear)
    half, step = cell_m / 2, STEP_CELLS * cell_m
    stride = max(1, math.floor(STRIDE_M / step))
    half_s = stride / 2 * step / rate  # from the middle of a stride to its ends
    pace = rate, drift_m(rect, margin, motion, step / rate)
    within = margin + drift_m(rect, margin, motion, half_s)
    near, least, taken = np.empty((0, 3), np.int32), np.empty(0), np.empty(0)
    best, best_i, best_j, best_state = math.inf, 0, 0, FREE
    k = 0
    while k * step <= length + step + margin and max(0.0, (k - 1) * step - margin) < best:
        span = (max(0, k - 1) * step / rate, k * step / rate)
        if k % stride == 0:
            middle = _at(place, motion[0], motion[1], span[0] + half_s)
            near = cells_near(cells, window, cell_m, middle, rect, within, clear)
            least, taken = _limits(near, cell_m, place, rect, motion, margin, kept)
        at = _at(place, motion[0], motion[1], span[1])
        then = at, heading_of(at)
        for n in range(least.size):
            limit = least[n], taken[n]
            i, j = near[n, 0], near[n, 1]
            cx, cy = (i + 0.5) * cell_m, (j + 0.5) * cell_m
            free = max(0.0, _free_path(
                cx, cy, half, place, then, rect, motion, span, pace, limit, best
            ))  # fmt: skip
            if free < best:
                best, best_i, best_j, best_state = free, i, j, near[n, 2]
        k += 1
    return best, best_i, best_j, best_state


class Obstruction(Struct, frozen=True):
    """What stands in the way first."""

    free_m: float  # way of the footprint's fastest point until it is too near; inf: all free
    i: int  # world cell
    j: int
    state: int  # OBSTACLE or UNKNOWN


NOTHING = Obstruction(math.inf, 0, 0, FREE)


class StopZone:
    """The footprint of one robot and how it stops."""

    def __init__(
        self,
        front_m: float,
        rear_m: float,
        width_m: float,
        margin_m: float,
        brake_mps2: float,
        reaction_s: float,
    ) -> None:
        """`reaction_s`: until motors have no power: a scan's age, a loop, an order."""
        self.rect: Rect = (front_m, rear_m, width_m / 2)
        self.margin_m, self._brake_mps2 = margin_m, brake_mps2
        self._reaction_s = reaction_s
        self._reach_m = math.hypot(max(front_m, rear_m), width_m / 2)

    def rate_mps(self, v_mps: float, w_radps: float) -> float:
        """Speed that no point of the footprint exceeds."""
        return abs(v_mps) + abs(w_radps) * self._reach_m

    def stop_m(self, rate_mps: float) -> float:
        """From the order to stop until it stands."""
        return rate_mps * self._reaction_s + rate_mps**2 / (2 * self._brake_mps2)

    def allowed_mps(self, free_m: float) -> float:
        """The rate from which it can stop within so much free way; 0 for next to nothing."""
        brake = self._brake_mps2
        lost_mps = brake * self._reaction_s
        rate_mps = math.sqrt(lost_mps**2 + 2 * brake * max(free_m, 0.0)) - lost_mps
        return rate_mps if rate_mps >= SLOWEST_MPS else 0.0

    def look(
        self,
        grid: RingGrid,
        cells: I8,
        place: Place,
        motion: Motion,
        clear: Place,
        from_mps: float,
        for_s: float,
    ) -> Obstruction:
        """What the motion (v m/s, w rad/s) would meet on its way to a stop.

        Args:
            clear: as of `is_in_way`, in metres.
            from_mps: sweep the way to a stop from this rate, if it is more than the motion's own.
            for_s: sweep the way of so many seconds at least, and no farther than LONGEST_M.
        """
        rate_mps = self.rate_mps(*motion)
        if rate_mps < STANDING_MPS:
            return NOTHING
        wanted_m = self.stop_m(max(rate_mps, from_mps))
        wanted_m = max(wanted_m, min(LONGEST_M, rate_mps * for_s))
        length_m = min(LONGEST_M, wanted_m)
        free_m, i, j, state = _sweep(
            cells,
            (grid.corner_i, grid.corner_j, grid.size),
            grid.cell_m,
            place,
            self.rect,
            motion,
            (length_m, rate_mps, self.margin_m),
            clear,
        )
        if math.isinf(free_m):  # nothing as far as we looked
            return NOTHING if wanted_m <= LONGEST_M else Obstruction(LONGEST_M, 0, 0, UNKNOWN)
        return Obstruction(free_m, i, j, state)
