"""How far the robot can go on as it moves before its footprint meets a cell that is not free.

The footprint, a rectangle about the drive axle, is swept along the commanded arc over the way that
it takes to stop; each cell counts with all of its square. Around the footprint a margin is kept:
the way ends where the margin meets a cell. Where a cell lies within the margin already, the robot
can leave and go past, but not near: such a cell stops a motion that would bring the footprint
itself to it, other cells one that would bring them nearer than the nearest is now, and a cell under
the footprint one that goes deeper. Ground that the window does not cover is unknown.
Source: design, sections 7 and 8.
"""

import math

from core.grid.ring import RingGrid, cells_about
from core.records import FREE, I8, UNKNOWN, record
from jit import kernel

STEP_CELLS = 0.5  # of the sweep
LONGEST_M = 10.0  # sweep
TOUCH_M = 1e-9  # an edge in common is no contact
SLACK_M = 0.02  # beside a wall within the margin, nobody goes along quite straight
HALVINGS = 6  # of a step, to find where it met a cell
STANDING_MPS = 1e-6
SLOWEST_MPS = 0.03  # below this there is no going

Rect = tuple[float, float, float]  # ahead of the axle, behind it, to either side; metres
Place = tuple[float, float, float]  # x, y, yaw in the map frame
Motion = tuple[float, float]  # forward m/s, counter-clockwise rad/s
Window = tuple[int, int, int]  # corner i, corner j, size


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
    c, s = math.cos(place[2]), math.sin(place[2])
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
def first_of(window: Window) -> tuple[int, int]:
    """Column and row in the array of a window's lowest cell."""
    return window[0] % window[2], window[1] % window[2]


@kernel
def cell_state(
    i: int,
    j: int,
    cells: I8,
    window: Window,
    first: tuple[int, int],
    cell_m: float,
    clear: Place,
) -> int:
    """The state of a cell that is in the way, OBSTACLE or UNKNOWN; FREE of one that is not.

    first: of `first_of` that window.
    """
    size, state = window[2], UNKNOWN
    column, row = i - window[0], j - window[1]
    if 0 <= column < size and 0 <= row < size:  # i % size, j % size without their divisions
        column, row = column + first[0], row + first[1]
        column -= size if column >= size else 0
        row -= size if row >= size else 0
        state = cells[row, column]
    if state == UNKNOWN:
        x, y = (i + 0.5) * cell_m - clear[0], (j + 0.5) * cell_m - clear[1]
        if math.hypot(x, y) <= clear[2]:
            return FREE
    return state


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


@kernel
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
    reach = math.hypot(max(rect[0], rect[1]) + margin, rect[2] + margin)
    least, first = margin, first_of(window)
    low_i, low_j, count = cells_about(place[0], place[1], reach, cell_m)
    for j in range(low_j, low_j + count):
        for i in range(low_i, low_i + count):
            if cell_state(i, j, cells, window, first, cell_m, clear) != FREE:
                gap = gap_to((i + 0.5) * cell_m, (j + 0.5) * cell_m, cell_m / 2, place, rect)
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
def _free_path(
    cx: float,
    cy: float,
    half: float,
    place: Place,
    then: Place,
    rect: Rect,
    motion: Motion,
    span: tuple[float, float],
    limits: tuple[float, float, float],
    is_unknown: bool,
) -> float:
    """How far the robot gets before a cell that is in the way at the end of a span; inf: it is not.

    then: the place at that end. limits: metres per second, margin, and what is to be kept free of
    new cells.
    """
    rate, margin, kept = limits
    gap = gap_to(cx, cy, half, then, rect)
    if gap >= margin - TOUCH_M:
        return math.inf
    before = gap_to(cx, cy, half, place, rect)
    if before >= margin - TOUCH_M:  # new
        if gap >= kept - TOUCH_M:
            return math.inf
        return rate * _first(cx, cy, half, place, rect, motion, span, kept)
    if gap >= -TOUCH_M:
        return math.inf
    if before >= -TOUCH_M:  # within the margin from the begin
        return rate * _first(cx, cy, half, place, rect, motion, span, 0.0) - margin
    if is_unknown or leaves(cx, cy, place, rect, motion[0], motion[1]):
        return math.inf
    return 0.0


@kernel
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

    way: metres to sweep, metres per second, margin. clear: x, y and radius of the ground where
    unknown counts as free; an infinite one is everywhere.
    """
    length, rate, margin = way
    reach = math.hypot(max(rect[0], rect[1]) + margin, rect[2] + margin)
    kept = clearance(cells, window, cell_m, place, rect, margin, clear)
    half, step, first = cell_m / 2, STEP_CELLS * cell_m, first_of(window)
    best, best_i, best_j, best_state = math.inf, 0, 0, FREE
    k = 0
    while k * step <= length + step + margin and (k - 1) * step - margin < best:
        span = ((k - 1) * step / rate, k * step / rate)
        now = _at(place, motion[0], motion[1], span[1])
        low_i, low_j, count = cells_about(now[0], now[1], reach, cell_m)
        for j in range(low_j, low_j + count):
            for i in range(low_i, low_i + count):
                state = cell_state(i, j, cells, window, first, cell_m, clear)
                if state == FREE:
                    continue
                free = _free_path(
                    (i + 0.5) * cell_m,
                    (j + 0.5) * cell_m,
                    half,
                    place,
                    now,
                    rect,
                    motion,
                    span,
                    (rate, margin, kept),
                    state == UNKNOWN,
                )
                if max(free, 0.0) < best:
                    best, best_i, best_j, best_state = max(free, 0.0), i, j, state
        k += 1
    return best, best_i, best_j, best_state


@record()
class Obstruction:
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
        unknown_stops: bool,
        reaction_s: float,
    ) -> None:
        """`reaction_s`: until motors have no power: a scan's age, a loop, an order."""
        self.rect: Rect = (front_m, rear_m, width_m / 2)
        self.margin_m, self._brake_mps2 = margin_m, brake_mps2
        self._reaction_s = reaction_s
        self._unknown_stops = unknown_stops
        self._reach_m = math.hypot(max(front_m, rear_m), width_m / 2)

    def clear_of(self, clear: Place) -> Place:
        """Where unknown counts as free: x, y and radius; an infinite one is everywhere."""
        return clear if self._unknown_stops else (0.0, 0.0, math.inf)

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
            clear: x, y and radius (m) of ground whose unknown cells somebody vouches for.
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
            self.clear_of(clear),
        )
        if math.isinf(free_m):  # nothing as far as we looked
            return NOTHING if wanted_m <= LONGEST_M else Obstruction(LONGEST_M, 0, 0, UNKNOWN)
        return Obstruction(free_m, i, j, state)
