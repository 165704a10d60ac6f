"""What a cell means, by what is known of it: the only place that decides.

    missing ground   a beam passed under - GATE sigma of where the ground should be; it is an
                     obstacle once it is too deep, or the ground beyond shows a hole or an edge
    obstacle         log-odds that something stands >= LIKELY, and it is higher than the ground
    free             log-odds <= CLEAR, floor was seen, lately, and it can be reached without a step
    unknown          else

Source: docs/method.md, section 5.
"""

import math
from typing import NamedTuple

import numpy as np

from core.grid.places import ones
from core.grid.ring import RingGrid
from core.grid.window import ObstacleWindow, put_state
from core.mapping import causes
from core.mapping.causes import (
    AGED,
    BEYOND_STEP,
    EARLIER_RUN,
    FEW,
    FLOOR,
    GUESSED,
    NO_FLOOR,
    OUTSIDE,
    SOFT,
    STANDS,
    UNREACHED,
    UNSEEN,
    UNSHOWN,
)
from core.mapping.freshness import Freshness
from core.mapping.surface.cells import (
    APART,
    TIED,
    Surface,
    floor_parts,
    index_of,
    row_of,
    under_parts,
    world_cell,
)
from core.mapping.surface.constants import CLEAR, GATE, HIT, LIKELY
from core.mapping.surface.touched import Limits
from core.records import F64, I8, I32, I64, OBSTACLE, U8
from jit import Record, kernel

_state_of, _shown_cause = kernel(causes.state_of), kernel(causes.shown_cause)


@kernel
def _missing(cell: Record, h_neg: float, noise: float) -> int:
    """NO_FLOOR for a hole or an edge down, UNSHOWN where there may be one, else 0.

    Before the ground beyond has been seen, a little is only "perhaps". It may lie lower: then the
    ground is lower here too, and that is no hole; but too much of it is an edge.
    """
    if cell.under_m == math.inf:
        return 0
    if cell.looks == 0 and cell.floor_m <= h_neg:
        return NO_FLOOR
    doubt = GATE * math.sqrt(cell.var_m2 + noise)
    if -cell.under_m <= doubt:
        return UNSHOWN if cell.under_m <= h_neg else 0
    if cell.under_m <= h_neg:
        return NO_FLOOR
    far = 0.0 if cell.looks > 0 else cell.floor_m
    if far == math.inf:
        return UNSHOWN
    return NO_FLOOR if far <= h_neg or far - cell.under_m > doubt else 0


@kernel
def _is_whole(cell: Record, parts: int, is_framed: bool) -> bool:
    """Whether floor was seen in more than a row of a cell's parts, and where beams were under it.

    Else it is the edge of a ditch: floor on one side of the cell says nothing of the other, but
    where it is framed.
    """
    return bool(
        ones(floor_parts(cell)) > (0 if is_framed else row_of(parts))
        and ones(under_parts(cell) & ~floor_parts(cell)) < max(2, parts // 2)
    )


@kernel
def _is_seen(cell: Record, k: int, along: int, parts: int) -> bool:
    """Whether floor was seen in any of the k-th parts of a cell along x (0) or y (1)."""
    for n in range(parts):
        if floor_parts(cell) >> (n * parts + k if along == 0 else k * parts + n) & 1:
            return True
    return False


@kernel
def is_framed(i: int, j: int, limits: Limits, surface: Surface) -> bool:
    """Whether what lacks of a world cell's floor, along x and y, is no wider than half a cell.

    As where the laser's line jumps on: so narrow a gap, with floor on both sides, is no ditch.
    """
    cells, parts = surface.cells, limits.parts
    for along in range(2):
        run = 0
        for k in range(-parts, 2 * parts):
            n = k // parts
            near = index_of(i + n * (1 - along), j + n * along, surface)
            seen = near >= 0 and cells[near].looks > 0
            seen = seen and _is_seen(cells[near], k - n * parts, along, parts)
            run = 0 if seen else run + 1
            if run > parts // 2 and k >= 0 and k - run < parts - 1:  # some of it is in the cell
                return False
    return True


@kernel
def rule_of(
    cell: Record, shown: int, seen_s: float, oldest_s: float, limits: Limits, noise: float,
    passable: bool = False, framed: bool = False,
) -> int:  # fmt: skip
    """Which rule decides a cell: a cause. What was told as obstacle stays so until it is gone.

    Args:
        noise: variance of a return's height where the ground is met.
        passable: what stands in it is soft and low, and nothing hard beside it.
        framed: what lacks of its floor is narrow.
    """
    if cell.var_m2 == math.inf:
        return UNSEEN
    missing = _missing(cell, limits.h_neg_m, noise)
    if missing > 0:
        return missing
    stands = cell.stands >= LIKELY or (shown == OBSTACLE and cell.stands > 0.0)
    if stands and not passable:
        return STANDS if cell.top_m > HIT * math.sqrt(cell.var_m2 + noise) else GUESSED
    if cell.looks == 0:
        return UNSHOWN
    if cell.tied != TIED:
        return BEYOND_STEP if cell.tied == APART else UNREACHED
    if cell.stands > CLEAR and not passable:
        return FEW
    if not _is_whole(cell, limits.parts, framed):
        return UNSHOWN
    if seen_s < oldest_s:
        return AGED if seen_s > -math.inf else EARLIER_RUN
    return SOFT if passable else FLOOR


@kernel
def is_passable(at: int, i: int, j: int, limits: Limits, surface: Surface) -> bool:
    """Whether what stands in a cell is soft, as low as the settings say, and so all beside it."""
    cells, cell = surface.cells, surface.cells[at]
    if limits.soft_m == 0.0 or cell.top_m > limits.soft_m:
        return False
    if cell.stands <= CLEAR or cell.soft < LIKELY:
        return False
    for n in range(9):
        near = index_of(i + n % 3 - 1, j + n // 3 - 1, surface)
        if near >= 0 and cells[near].stands > 0.0 and cells[near].soft < LIKELY:
            return False
    return True


class Shown(NamedTuple):
    """The planner's window, as kernels are given it."""

    corner_i: int  # world cell with the lowest i and j,
    corner_j: int
    turn_i: int  # and its column and row
    turn_j: int
    size: int
    cells: I8  # (size * size,) states
    marked: I8  # of those that changed,
    changed: I32  # and their list
    seen_s: F64  # (cells of the surface,) when a beam met or passed one last
    oldest_s: float  # what was seen before is too old
    noise_m2: float  # of a return from level ground


@kernel
def _place_in(i: int, j: int, shown: Shown) -> int:
    """Flat index of a world cell in the window; -1: it lies outside."""
    size, column, row = shown.size, i - shown.corner_i, j - shown.corner_j
    if not (0 <= column < size and 0 <= row < size):
        return -1
    column, row = column + shown.turn_i, row + shown.turn_j
    column = column - size if column >= size else column
    row = row - size if row >= size else row
    return row * size + column


@kernel
def _rule_at(
    at: int, i: int, j: int, state: int, limits: Limits, surface: Surface, shown: Shown
) -> int:
    """Which rule decides the cell of a surface that is world cell i, j."""
    passable = is_passable(at, i, j, limits, surface)
    cell = surface.cells[at]
    framed = 0 < ones(floor_parts(cell)) <= row_of(limits.parts)
    framed = framed and is_framed(i, j, limits, surface)
    seen_s, oldest_s = shown.seen_s[at], shown.oldest_s
    return rule_of(cell, state, seen_s, oldest_s, limits, shown.noise_m2, passable, framed)


@kernel
def decide_cells(touched: I32, surface: Surface, limits: Limits, shown: Shown, used: int) -> int:
    """Decide cells again into the planner's window; how many of it have changed."""
    for at in touched:
        i, j = world_cell(at, surface)
        into = _place_in(i, j, shown)
        if into >= 0:
            cause = _rule_at(at, i, j, shown.cells[into], limits, surface, shown)
            used = put_state(into, _state_of(cause), shown.cells, shown.marked, shown.changed, used)
    return used


@kernel
def _list_causes(i: I64, j: I64, surface: Surface, limits: Limits, shown: Shown, out: U8) -> None:
    """Fill `out` (n,) with the causes of what the window shows at world cells i, j (n,)."""
    for k in range(i.size):
        out[k] = OUTSIDE
        into = _place_in(i[k], j[k], shown)
        if into < 0:
            continue
        state, cause = shown.cells[into], UNSEEN
        at = index_of(i[k], j[k], surface)
        if at >= 0:
            cause = _rule_at(at, i[k], j[k], state, limits, surface, shown)
        out[k] = _shown_cause(cause, _state_of(cause), state)


class Decision:
    """Decides the cells of a surface into a window, which may be smaller."""

    def __init__(
        self, window: ObstacleWindow, fresh: Freshness, limits: Limits, noise_m2: float
    ) -> None:
        self._window, self._fresh, self._limits, self._noise_m2 = window, fresh, limits, noise_m2
        self._states = window.cells.reshape(-1)

    @property
    def shown(self) -> Shown:
        """The window as it is now, for kernels."""
        window, fresh, grid = self._window, self._fresh, self._window.grid
        i, j, size = grid.corner_i, grid.corner_j, grid.size
        return Shown(
            i, j, i % size, j % size, size, self._states, window.marked,
            window.changed, fresh.seen_s, fresh.oldest_s, self._noise_m2,
        )  # fmt: skip

    def causes(self, i: I64, j: I64, surface: Surface) -> U8:
        """Why the window shows what it does at world cells i, j (n,), by the rules that decide."""
        found = np.zeros(i.size, dtype=np.uint8)
        _list_causes(i, j, surface, self._limits, self.shown, found)
        return found

    def follow(self, x_m: float, y_m: float, source: RingGrid, surface: Surface) -> None:
        """Move the window with the robot; what enters and is known in the surface is decided."""
        entered, window = self._window.follow_in(source, x_m, y_m), self._window
        if entered.size:
            window.used = decide_cells(entered, surface, self._limits, self.shown, window.used)
