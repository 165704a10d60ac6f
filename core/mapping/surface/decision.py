"""What a cell means, by what is known of it: the only place that decides.

    missing ground   a beam passed under - GATE sigma of where the ground should be; it is an
                     obstacle once it is too deep, or the ground beyond shows a hole or an edge
    obstacle         log-odds that something stands >= LIKELY, and it is higher than the ground
    free             log-odds <= CLEAR, floor was seen, lately, and it can be reached without a step
    unknown          else

Source: docs/method.md, section 5.
"""

import math

from core.grid.places import index_of, ones, world_cell
from core.grid.window import Shown, put_state
from core.mapping import causes
from core.mapping.surface import cells
from core.mapping.surface.cells import APART, TIED, Limits, Surface
from core.mapping.surface.constants import *
from core.records import I32, I64, OBSTACLE, U8
from jit import Record, kernel

_state_of, _shown_cause = kernel(causes.state_of), kernel(causes.shown_cause)


@kernel
def _missing(cell: Record, limits: Limits) -> int:
    """NO_FLOOR for a hole or an edge down, UNSHOWN where there may be one, else 0."""
    h_neg = limits.h_neg_m
    if cell.under_m == math.inf:
        return 0
    if cell.looks == 0 and cell.floor_m <= h_neg:
        return causes.NO_FLOOR
    doubt = GATE * math.sqrt(cell.var_m2 + limits.noise_m2)
    if -cell.under_m <= doubt:
        return causes.UNSHOWN if cell.under_m <= h_neg else 0
    if cell.under_m <= h_neg:
        return causes.NO_FLOOR
    far = 0.0 if cell.looks > 0 else cell.floor_m  # where that lies lower as well, there is no hole
    if far == math.inf:
        return causes.UNSHOWN
    return causes.NO_FLOOR if far - cell.under_m > doubt else 0


@kernel
def is_framed(i: int, j: int, surface: Surface) -> bool:
    """Whether what lacks of a world cell's floor, along x and y, is no wider than half a cell.

    As where the laser's line jumps on: so narrow a gap, with floor on both sides, is no ditch.
    """
    parts = surface.limits.parts
    row = (1 << parts) - 1  # bits of a cell's parts
    column = ((1 << parts * parts) - 1) // row
    for along in range(2):
        run = 0
        for k in range(-parts, 2 * parts):
            n = k // parts
            near, place = index_of(i + n * (1 - along), j + n * along, surface.ring), k - n * parts
            bits = column << place if along == 0 else row << place * parts
            other = surface.cells[max(0, near)]
            seen = near >= 0 and other.looks > 0 and other.parts & bits != 0
            run = 0 if seen else run + 1
            if run > parts // 2 and k >= 0 and k - run < parts - 1:  # some of it is in the cell
                return False
    return True


@kernel
def rule_of(
    cell: Record, shown: int, seen_s: float, oldest_s: float, limits: Limits,
    passable: bool, few: int,
) -> int:  # fmt: skip
    """Which rule decides a cell: a cause. What was told as obstacle stays so until it is gone.

    Args:
        passable: what stands in it is soft and low, and nothing hard beside it.
        few: in so many of its parts floor may be on one side of an edge alone.
    """
    if cell.var_m2 == math.inf:
        return causes.UNSEEN
    missing = _missing(cell, limits)
    if missing > 0:
        return missing
    stands = cell.stands >= LIKELY or (shown == OBSTACLE and cell.stands > 0.0)
    if stands and not passable:
        is_high = cell.top_m > HIT * math.sqrt(cell.var_m2 + limits.noise_m2)
        return causes.STANDS if is_high else causes.GUESSED
    if cell.looks == 0:
        return causes.UNSHOWN
    if cell.tied != TIED:
        return causes.BEYOND_STEP if cell.tied == APART else causes.UNREACHED
    if cell.stands > CLEAR and not passable:
        return causes.FEW
    under = ones(cell.parts >> cells.PART_BITS & ~cell.parts)  # parts without, where beams were
    if ones(cell.parts) <= few or under >= 2:
        return causes.UNSHOWN
    if seen_s < oldest_s:
        return causes.AGED if seen_s > -math.inf else causes.EARLIER_RUN
    return causes.SOFT if passable else causes.FLOOR


@kernel
def is_edge(i: int, j: int, surface: Surface) -> bool:
    """Whether ground is missing beside a world cell, or may be: it was due, and not seen."""
    for n in range(9):
        near = index_of(i + n % 3 - 1, j + n // 3 - 1, surface.ring)
        other = surface.cells[max(0, near)]
        if near < 0 or other.var_m2 == math.inf or other.under_m == math.inf:
            continue
        if other.looks == 0 or _missing(other, surface.limits) > 0:
            return True
    return False


@kernel
def is_passable(at: int, i: int, j: int, surface: Surface) -> bool:
    """Whether what stands in a cell is soft, as low as the settings say, and so all beside it."""
    cell, soft_m = surface.cells[at], surface.limits.soft_m
    if soft_m == 0.0 or cell.top_m > soft_m or cell.stands <= CLEAR or cell.soft < LIKELY:
        return False
    for n in range(9):
        near = index_of(i + n % 3 - 1, j + n // 3 - 1, surface.ring)
        other = surface.cells[max(0, near)]
        if near >= 0 and other.stands > 0.0 and other.soft < LIKELY:
            return False
    return True


@kernel
def _rule_at(at: int, i: int, j: int, state: int, surface: Surface) -> int:
    """Which rule decides the cell of a surface that is world cell i, j."""
    passable, cell, limits = is_passable(at, i, j, surface), surface.cells[at], surface.limits
    # noise of the range may show floor in a row beyond an edge
    few, seen, most = limits.row, ones(cell.parts), limits.parts * limits.parts - limits.row
    if 0 < seen <= limits.row and is_framed(i, j, surface):
        few = 0
    elif limits.row < seen <= most and is_edge(i, j, surface):
        few = most
    return rule_of(cell, state, surface.seen_s[at], surface.oldest_s, limits, passable, few)


@kernel
def decide_cells(listed: I32, surface: Surface, shown: Shown, used: int) -> int:
    """Decide cells again into the planner's window; how many of it have changed."""
    for at in listed:
        i, j = world_cell(at, surface.ring)
        into = index_of(i, j, shown.ring)
        if into >= 0:
            cause = _rule_at(at, i, j, shown.cells[into], surface)
            used = put_state(into, _state_of(cause), shown, used)
    return used


@kernel
def list_causes(i: I64, j: I64, surface: Surface, shown: Shown, out: U8) -> None:
    """Fill `out` (n,) with the causes of what the window shows at world cells i, j (n,)."""
    for k in range(i.size):
        at, into = index_of(i[k], j[k], surface.ring), index_of(i[k], j[k], shown.ring)
        out[k] = causes.OUTSIDE
        if into >= 0:
            state, cause = shown.cells[into], causes.UNSEEN
            if at >= 0:
                cause = _rule_at(at, i[k], j[k], state, surface)
            out[k] = _shown_cause(cause, _state_of(cause), state)
