"""What a cell means to the planner, by its elevation and certainty: the only place that decides.

    unknown    without certainty, corrupt by the CAS filter; flat, but not certain enough yet, at
               the edge of what is known, or beside an obstacle
    obstacle   at or beyond h_pos or h_neg over the ground, or higher than a cell beside it by that
               much: a brink
    free       flat, certain, and seen lately

Nobody knows how the ground goes on: level from where the robot stands, or along the plane on which
its body stands. What is beyond the bounds by either is an obstacle. So a robot that leans takes no
lower road for flat, and a ramp is an obstacle where it has risen by the bound.
The foot of a wall looks flat for as long as nothing higher of it was met: so what lies around must
be known before ground is free.
A filled height is none here: unseen is unknown. The paper has no obstacle map; all of this is ours.
Source: docs/certainty.md.
"""

from core.grid.places import index_of, world_cell
from core.grid.window import Shown, put_state
from core.mapping import causes
from core.mapping.body import BodyPose
from core.mapping.certainty.cells import CORRUPT, RESET, Cells, Rules, over_ground_m
from core.records import I32, I64, U8
from jit import kernel

LEAST_AROUND = 6  # of eight neighbours: a straight wall hides three

_state_of, _shown_cause = kernel(causes.state_of), kernel(causes.shown_cause)


@kernel
def _is_brink(at: int, i: int, j: int, cells: Cells, rules: Rules) -> bool:
    """Whether a world cell lies higher than a known one beside it by a bound of floor."""
    bound_m = min(rules.h_pos_m, -rules.h_neg_m)
    for n in range(9):
        near = index_of(i + n % 3 - 1, j + n // 3 - 1, cells.ring)
        if near < 0 or near == at or cells.certainty[near] == 0 or cells.marks[near] & CORRUPT != 0:
            continue
        if cells.height_m[at] - cells.low_m[near] >= bound_m:
            return True
    return False


@kernel
def _is_edge(i: int, j: int, cells: Cells) -> bool:
    """Whether fewer than `LEAST_AROUND` of the neighbours of a world cell are known."""
    known = 0
    for n in range(9):
        near = index_of(i + n % 3 - 1, j + n // 3 - 1, cells.ring)
        if n != 4 and near >= 0 and cells.certainty[near] > 0 and cells.marks[near] & CORRUPT == 0:
            known += 1
    return known < LEAST_AROUND


@kernel
def _beyond(at: int, i: int, j: int, cells: Cells, body: BodyPose, rules: Rules) -> int:
    """`TOO_HIGH` or `TOO_LOW` where a world cell lies at or beyond a bound, else `FLOOR`."""
    cell_m = cells.ring.cell_m
    x, y = (i + 0.5) * cell_m, (j + 0.5) * cell_m
    if over_ground_m(x, y, cells.height_m[at], body)[1] >= rules.h_pos_m:
        return causes.TOO_HIGH
    if over_ground_m(x, y, cells.low_m[at], body)[0] <= rules.h_neg_m:
        return causes.TOO_LOW
    return causes.FLOOR


@kernel
def _is_beside(at: int, i: int, j: int, cells: Cells, body: BodyPose, rules: Rules) -> bool:
    """Whether a cell beside a world cell is an obstacle: beyond a bound, or a brink over it."""
    bound_m = min(rules.h_pos_m, -rules.h_neg_m)
    for n in range(9):
        a, b = i + n % 3 - 1, j + n // 3 - 1
        near = index_of(a, b, cells.ring)
        if near < 0 or near == at or cells.certainty[near] == 0 or cells.marks[near] & CORRUPT != 0:
            continue
        if cells.height_m[near] - cells.low_m[at] >= bound_m:
            return True
        if _beyond(near, a, b, cells, body, rules) != causes.FLOOR:
            return True
    return False


@kernel
def cause_at(
    at: int, i: int, j: int, cells: Cells, body: BodyPose, oldest_s: float, rules: Rules
) -> int:
    """The rule that decides a cell (flat index) that is world cell i, j."""
    if cells.certainty[at] == 0:
        return causes.RESET if cells.marks[at] & RESET != 0 else causes.UNSEEN
    if cells.marks[at] & CORRUPT != 0:
        return causes.CORRUPT
    beyond = _beyond(at, i, j, cells, body, rules)
    if beyond != causes.FLOOR:
        return beyond
    if _is_brink(at, i, j, cells, rules):
        return causes.BRINK
    if cells.certainty[at] < rules.free_from:
        return causes.UNCERTAIN
    if _is_edge(i, j, cells):
        return causes.EDGE
    if _is_beside(at, i, j, cells, body, rules):
        return causes.BESIDE
    return causes.FLOOR if cells.seen_s[at] >= oldest_s else causes.AGED


@kernel
def decide(
    listed: I32,
    cells: Cells,
    body: BodyPose,
    oldest_s: float,
    rules: Rules,
    shown: Shown,
    used: int,
) -> int:
    """Decide cells (flat indices) again into the planner's window; how many of it have changed."""
    for at in listed:
        i, j = world_cell(at, cells.ring)
        into = index_of(i, j, shown.ring)
        if into >= 0:
            cause = cause_at(at, i, j, cells, body, oldest_s, rules)
            used = put_state(into, _state_of(cause), shown, used)
    return used


@kernel
def list_causes(
    i: I64,
    j: I64,
    cells: Cells,
    body: BodyPose,
    oldest_s: float,
    rules: Rules,
    shown: Shown,
    out: U8,
) -> None:
    """Fill `out` (n,) with the causes of what the window shows at world cells i, j (n,)."""
    for k in range(i.size):
        at, into = index_of(i[k], j[k], cells.ring), index_of(i[k], j[k], shown.ring)
        out[k] = causes.OUTSIDE
        if into >= 0:
            cause = causes.UNSEEN
            if at >= 0:
                cause = cause_at(at, i[k], j[k], cells, body, oldest_s, rules)
            out[k] = _shown_cause(cause, _state_of(cause), shown.cells[into])
