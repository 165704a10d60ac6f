"""What ground is tied to: to that on which the wheels roll, to a step, or to nothing yet.

Ground inherits from the ground that told it; it is joined to what lies beside it, without a step,
along a front as wide as a robot. Where ground is tied, loose ground around it may be tied in turn.

Source: docs/method.md, section 4.
"""

from core.mapping.surface.cells import APART, TIED, Surface, ground_of, index_of, world_cell
from core.mapping.surface.constants import FRONT, REACH
from core.mapping.surface.touched import NEWLY_TIED, Limits, Touched, touch
from jit import kernel


@kernel
def tie_of(at: int, i: int, j: int, limits: Limits, surface: Surface) -> int:
    """What a cell's ground is tied to by that of world cells around i, j: its own if by none.

    It is joined along a front as wide as a robot, no less, and not where more ground within two
    cells is a step off than joins it: no wheel climbs that.
    """
    cells, own = surface.cells, surface.own
    joined = apart = against = 0
    for dj in range(-REACH, REACH + 1):
        for di in range(-REACH, REACH + 1):
            near = index_of(i + di, j + dj, surface)
            if near < 0 or near == at or cells[near].looks == 0:
                continue
            step = ground_of(cells[at], own) - ground_of(cells[near], own)
            if not limits.h_neg_m < step < limits.h_pos_m:
                against += cells[near].tied == TIED
            elif max(abs(di), abs(dj)) == 1:
                joined += cells[near].tied == TIED
                apart += cells[near].tied == APART
    if joined >= FRONT and joined > against:
        return TIED
    return APART if apart > joined else cells[at].tied


@kernel
def tie(at: int, i: int, j: int, limits: Limits, surface: Surface, touched: Touched) -> None:
    """Tie a cell's ground, if it can be; what is loose around it may be tied by it in turn."""
    cell = surface.cells[at]
    before = cell.tied
    cell.tied = tie_of(at, i, j, limits, surface)
    if cell.tied == TIED and before != TIED:
        touched.bits[touch(at, touched)] |= NEWLY_TIED


@kernel
def spread_ties(limits: Limits, surface: Surface, touched: Touched) -> None:
    """Ground that was seen before is reached over what has been tied now."""
    cells, k = surface.cells, 0
    while k < touched.used[0]:  # grows as cells are tied
        at = touched.at[k]
        if touched.bits[k] & NEWLY_TIED:
            i, j = world_cell(at, surface)
            for n in range(9):
                ni, nj = i + n % 3 - 1, j + n // 3 - 1
                near = index_of(ni, nj, surface)
                if near >= 0 and cells[near].looks > 0 and cells[near].tied != TIED:
                    tie(near, ni, nj, limits, surface, touched)
        k += 1
