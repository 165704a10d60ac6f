"""What a cell means: obstacle, free or unknown, in the window that the planner gets.

Definition 1 of the paper on the cell's height, a cell at a bound counting as obstacle; and two
scans that contradict "floor" make an obstacle whatever the height says, while a cell with only one
is unknown until the laser has looked again several times. Where floor was due in part of a cell
and never showed, there is a drop. Of a wall's foot, the laser first sees what looks like floor. So
a new cell is not free before something has been seen behind it, and one in which something rises
not before something has been seen all around it. Only touched cells are decided. What decides is a
cause (core/mapping/causes.py), and the state follows from it: who asks why gets the same answer.
Source: the paper, Definition 1; design, section 7.
"""

import math
from typing import NamedTuple

import numpy as np

from core.config import Obstacle
from core.grid.places import index_in, index_of, ones
from core.grid.window import ObstacleWindow, Shown, put_state
from core.mapping import causes
from core.mapping.beams.cells import GONE_JUDGED, GONE_PASSED, CellGrid, Cells, known
from core.mapping.causes import (
    AGED,
    CONTRADICTED,
    EARLIER_RUN,
    EDGE,
    FLOOR,
    FLOOR_AGAIN,
    FOOT,
    GONE,
    JUDGED_AGAIN,
    LOW,
    NO_FLOOR,
    OUTSIDE,
    PASSED,
    SOFT,
    STANDS,
    TOO_HIGH,
    TOO_LOW,
    UNSEEN,
    UNSHOWN,
)
from core.mapping.freshness import Freshness
from core.records import F64, FREE, I32, I64, U8, UNKNOWN
from jit import kernel

ENOUGH = 2  # contradicting scans that make an obstacle
MISSED_ENOUGH = 3  # scans in which a beam went a little below the ground, where floor was due,
MISSED_SUBS = 1.5  # and in so many parts of a cell, times those along its edge, never was any;
MOST_SUBS = 2.0  # of so many parts, a scan less is enough
LOOKED_AGAIN = 6  # scans after which a single contradiction no longer holds a cell unknown
NEW_S = 1.0  # of scans that have hit a cell, and it no longer counts as new
SOFT_LEAST = 6  # returns that say "soft",
SOFT_SHARE = 0.5  # of all that rise,
DOUBLE_SHARE = 0.25  # and that echo twice

_state_of, _shown_cause = kernel(causes.state_of), kernel(causes.shown_cause)

AROUND = ((1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1))  # (di, dj), octants


class Bounds(NamedTuple):
    """What the settings say of cells."""

    h_pos_m: float
    h_neg_m: float
    soft_free_below_m: float
    new_looks: int  # NEW_S, in scans


@kernel
def is_soft(cells: Cells, at: int) -> bool:
    """Whether what stands in a cell scatters the beams and lets them in: grass, a curtain."""
    cell = cells[at]
    rising = cell.soft + cell.hard
    return bool(
        cell.soft >= SOFT_LEAST
        and cell.soft >= SOFT_SHARE * rising
        and cell.doubles >= DOUBLE_SHARE * rising
    )


@kernel
def lacks_floor(cells: Cells, at: int, sub: int) -> bool:
    """Whether so many parts of a cell lack the floor that was due there that it is a drop."""
    cell = cells[at]
    if cell.miss < ENOUGH:
        return False
    parts, most = ones(cell.miss_bits & ~cell.floor_bits), sub * sub
    return bool(
        (cell.miss_sure >= ENOUGH and parts >= sub)
        or (cell.miss >= MISSED_ENOUGH and parts >= min(MISSED_SUBS * sub, most))
        or parts >= min(MOST_SUBS * sub, most)
    )


@kernel
def _is_among_soft(i: int, j: int, cells: Cells, window: tuple[int, int, int]) -> bool:
    """Whether nothing stands beside a cell but what is soft as well."""
    size = window[2]
    for side in range(8):
        ni, nj = i + AROUND[side][0], j + AROUND[side][1]
        at = (nj % size) * size + ni % size
        if cells[at].above > 0 and not is_soft(cells, at):
            return False
    return True


@kernel
def _goes_on(i: int, j: int, sides: int, cells: Cells, window: tuple[int, int, int]) -> bool:
    """Whether the neighbours on these sides (bits by octant) have all been seen."""
    size = window[2]
    for side in range(8):
        if not sides >> side & 1:
            continue
        ni, nj = i + AROUND[side][0], j + AROUND[side][1]
        if not (0 <= ni - window[0] < size and 0 <= nj - window[1] < size):
            return False
        if not known(cells, (nj % size) * size + ni % size):
            return False
    return True


@kernel
def _why_free(cells: Cells, at: int) -> int:
    """Why a cell is free that no rule speaks against: what did, and is gone."""
    gone = cells[at].gone
    if gone == 0:
        return FLOOR
    if gone == GONE_PASSED:
        return PASSED
    return JUDGED_AGAIN if gone == GONE_JUDGED else FLOOR_AGAIN


@kernel
def _rule(
    i: int, j: int, at: int, cells: Cells, sub: int, bounds: Bounds, window: tuple[int, int, int]
) -> int:
    """Which rule decides a cell, however old it is: a cause."""
    cell = cells[at]
    if cell.count == 0 and not known(cells, at):
        return UNSEEN if cell.gone == 0 else GONE
    above, height, lets_in = cell.above, cell.mean_m, False
    soft_m = bounds.soft_free_below_m
    may_be_free = soft_m > 0.0 and above > 0 and cell.top_m <= soft_m
    if may_be_free and is_soft(cells, at) and _is_among_soft(i, j, cells, window):
        above, height, lets_in = 0, cell.floor_m, True
    if above >= ENOUGH:
        return STANDS
    if cell.below >= ENOUGH:
        return LOW
    if lacks_floor(cells, at, sub):
        return NO_FLOOR
    if cell.count > 0 and not bounds.h_neg_m < height < bounds.h_pos_m:
        return TOO_LOW if height <= bounds.h_neg_m else TOO_HIGH
    if (above + cell.below > 0 or cell.miss == 1) and cell.looks < LOOKED_AGAIN:
        return CONTRADICTED
    if cell.count == 0:
        return UNSHOWN
    if cell.looks < 0:
        return EARLIER_RUN
    sides = 0
    if cell.rising == 1:
        sides = 0xFF
    elif cell.looks < bounds.new_looks:
        far = int(cell.far_sides)
        sides = (far | far << 1 | far >> 7 | far >> 1 | far << 7) & 0xFF
    if not _goes_on(i, j, sides, cells, window):
        return FOOT if cell.rising == 1 else EDGE
    return SOFT if lets_in else _why_free(cells, at)


@kernel
def _is_aged(state: int, seen_s: float, oldest_s: float) -> bool:
    """Whether a cell would be free, had it not been seen too long ago."""
    return state == FREE and seen_s < oldest_s


@kernel
def _decide(
    touched: I32,
    layers: Cells,
    sub: int,
    bounds: Bounds,
    seen_s: F64,
    oldest_s: float,
    from_window: tuple[int, int, int],
    shown: Shown,
    used: int,
) -> int:
    """Decide touched cells of the elevation window, which is (corner i, corner j, size)."""
    size = from_window[2]
    for at in touched:
        row, column = at // size, at % size
        i = from_window[0] + (column - from_window[0]) % size
        j = from_window[1] + (row - from_window[1]) % size
        into = index_of(i, j, shown.ring)
        if into < 0:
            continue
        state = _state_of(_rule(i, j, at, layers, sub, bounds, from_window))
        state = UNKNOWN if _is_aged(state, seen_s[at], oldest_s) else state
        used = put_state(into, state, shown, used)
    return used


@kernel
def _list_causes(
    i: I64,
    j: I64,
    layers: Cells,
    sub: int,
    bounds: Bounds,
    seen_s: F64,
    oldest_s: float,
    from_window: tuple[int, int, int],
    window: Shown,
    out: U8,
) -> None:
    """Fill `out` (n,) with the causes of what the window shows at world cells i, j (n,)."""
    for k in range(i.size):
        out[k], into = OUTSIDE, index_of(i[k], j[k], window.ring)
        if into < 0:
            continue
        cause = UNSEEN
        at = index_in(i[k], j[k], (from_window[0], from_window[1]), from_window[2])
        if at >= 0:
            cause = _rule(i[k], j[k], at, layers, sub, bounds, from_window)
            cause = AGED if _is_aged(_state_of(cause), seen_s[at], oldest_s) else cause
        out[k] = _shown_cause(cause, _state_of(cause), window.cells[into])


class CellClassifier:
    """Decides the cells of a `CellGrid` into a `ObstacleWindow`, which may be smaller."""

    def __init__(
        self,
        source: CellGrid,
        window: ObstacleWindow,
        fresh: Freshness,
        obstacle: Obstacle,
        period_s: float,
    ) -> None:
        self._source, self._window, self._fresh = source, window, fresh
        self._bounds = Bounds(
            obstacle.h_pos_m,
            obstacle.h_neg_m,
            obstacle.soft_free_below_m,
            math.ceil(NEW_S / period_s - 1e-6),
        )

    def decide(self, touched: I32) -> None:
        """Decide cells again (flat indices of the source)."""
        source, window = self._source, self._window
        window.used = _decide(
            touched,
            source.flat,
            source.sub,
            self._bounds,
            self._fresh.seen_s,
            self._fresh.oldest_s,
            (source.grid.corner_i, source.grid.corner_j, source.grid.size),
            window.shown,
            window.used,
        )

    def causes(self, i: I64, j: I64) -> U8:
        """Why the window shows what it does at world cells i, j (n,), by the rules that decide."""
        source, window = self._source, self._window
        found: U8 = np.zeros(i.size, dtype=np.uint8)
        _list_causes(
            i,
            j,
            source.flat,
            source.sub,
            self._bounds,
            self._fresh.seen_s,
            self._fresh.oldest_s,
            (source.grid.corner_i, source.grid.corner_j, source.grid.size),
            window.shown,
            found,
        )
        return found

    def follow(self, x_m: float, y_m: float) -> None:
        """Move the window with the robot; what enters and is known in the source is decided.

        The source must have moved before.
        """
        self.decide(self._window.follow_in(self._source.grid, x_m, y_m))
