"""What the beams of a sweep pass on their way: nothing stands there, or no ground is there.

Source: docs/method.md, section 4.
"""

import math

from core.grid.places import part_bit
from core.mapping.along import STEP_M, first_place_m, places_along, share_of
from core.mapping.rays import MIN_RANGE_M
from core.mapping.surface.cells import Surface, cell_at, ground_of, index_of, plane_at
from core.mapping.surface.constants import (
    CLEAR,
    DARK,
    GAP_M,
    GATE,
    LEAST,
    LOWERED,
    PASS_LOW,
    PASS_THROUGH,
    THING_M,
)
from core.mapping.surface.error import seen_again_m2
from core.mapping.surface.evidence import expect, lower, stay, vote
from core.mapping.surface.sweep import (
    BELOW,
    FLOOR,
    HIGH,
    NONE,
    Beams,
    Stand,
    in_body,
    noise_m2,
    reach,
    set_upright,
    upright_line,
)
from core.mapping.surface.touched import Limits, Touched, touch
from core.records import F64
from jit import Record, kernel


@kernel
def _expects(
    at: int, x: float, y: float, r: float, ray: F64, stand: Stand, limits: Limits, surface: Surface
) -> bool:
    """Whether ground is due in a cell, seen or told by what lies before it."""
    cell = surface.cells[at]
    if cell.var_m2 < math.inf:
        return True
    plane = reach(x, y, r, ray, stand, surface)
    if plane.var_m2 > limits.guess_m2:
        return False
    ahead, aside = in_body(x, y, stand)
    expect(cell, plane.z_m, plane.var_m2, ahead, aside, stand, surface.own)
    cell.slope_x, cell.slope_y, cell.floor_s = plane.slope_x, plane.slope_y, plane.seen_s
    return True


@kernel
def _expect_again(at: int, x: float, y: float, stand: Stand, surface: Surface) -> None:
    """Ground that was not seen is due where the ground around tells it better by now."""
    cell, cell_m = surface.cells[at], surface.cell_m
    i, j = math.floor(x / cell_m), math.floor(y / cell_m)
    plane = plane_at(i, j, stand.x_m, stand.y_m, surface)
    if plane.var_m2 < cell.var_m2:
        move = plane.z_m - ground_of(cell, surface.own)
        ahead, aside = in_body(x, y, stand)
        expect(cell, plane.z_m, plane.var_m2, ahead, aside, stand, surface.own)
        cell.slope_x, cell.slope_y, cell.floor_s = plane.slope_x, plane.slope_y, plane.seen_s
        stay(cell, move)


@kernel
def _pass_low(
    b: int, beams: Beams, stand: Stand, limits: Limits, surface: Surface, P: F64,
    touched: Touched,
) -> None:  # fmt: skip
    """Back from a return along its beam, while it is low: nothing stands, or no ground is there."""
    one, lens, ray, end = beams.returns[b], beams.lenses[b], beams.rays[b], beams.ranges_m[0, b]
    cells, cell_m, own = surface.cells, surface.cell_m, surface.own
    if one.height_m > limits.h_pos_m:
        return  # nor is it low before
    is_below = one.kind == BELOW
    is_low = one.height_m <= -GATE * math.sqrt(one.var_m2 + one.wander_m2 + one.noise_m2)
    step = cell_m / max(abs(ray[0]), abs(ray[1]))  # to the next row or column of cells
    if is_below:
        step, last, r = 0.25 * step, -1, end
    else:
        step, last = max(step, STEP_M), one.at
        r = end + (1.0 - share_of(b, surface.scan[0])) * step
    lens_z, fall = upright_line(lens, ray, stand, own)
    while r - step > MIN_RANGE_M and end - r < GAP_M:
        r -= step
        x, y = lens[0] + r * ray[0], lens[1] + r * ray[1]
        i, j = math.floor(x / cell_m), math.floor(y / cell_m)
        at = index_of(i, j, surface)
        if at < 0 or (at == last and not is_below):
            continue
        last, cell = at, cells[at]
        if cell.var_m2 == math.inf and not (
            is_low and _expects(at, x, y, r, ray, stand, limits, surface)
        ):
            continue
        if cell.looks == 0:
            _expect_again(at, x, y, stand, surface)
        h = lens_z + r * fall - ground_of(cell, own)
        h -= cell.slope_x * (x - (i + 0.5) * cell_m) + cell.slope_y * (y - (j + 0.5) * cell_m)
        if h > limits.h_pos_m:
            return
        if h >= 0.0 and cell.stands <= LEAST and cell.under_m == math.inf:
            continue  # it is clear already: nothing is said
        slot = touch(at, touched)
        if cell.stands <= 0.0:
            vote(cell, slot, PASS_LOW, touched)
        if h < 0.0:
            var = noise_m2(r, ray[2], beams.lens_m2) + cell.var_m2
            ahead, aside = in_body(x, y, stand)
            age_s = stand.t_s - cell.floor_s
            var += seen_again_m2(ahead, aside, stand.travel_m, age_s, cell, P)
            if h * h > GATE * GATE * var:
                lower(cell, slot, part_bit(x, y, cell_m, limits.parts), h, touched)
        if cell.under_m < math.inf and cell.looks == 0:
            _see_beyond(cell, one, limits, surface)


@kernel
def _see_beyond(cell: Record, one: Record, limits: Limits, surface: Surface) -> None:
    """Where a beam landed that was under the ground of a cell."""
    own = surface.own
    if one.kind == FLOOR:
        cell.floor_m = ground_of(surface.cells[one.at], own) - ground_of(cell, own)
    elif one.height_m <= limits.h_neg_m:
        cell.floor_m = min(cell.floor_m, one.z_m - ground_of(cell, own))


@kernel
def _pass_through(b: int, beams: Beams, stand: Stand, surface: Surface, touched: Touched) -> None:
    """Along a beam: where something stood at its height, and does not stop it, it may be gone."""
    lens, ray, end = beams.lenses[b], beams.rays[b], beams.ranges_m[0, b]
    window = (surface.corner_i, surface.corner_j, surface.size, surface.cell_m)
    first_m, tall, seen_s, places = (
        first_place_m(b, surface.scan[0]), touched.tall, touched.seen_s, touched.places,
    )  # fmt: skip
    # on its way up, what comes in would stop the beam as little
    oldest_s = touched.oldest_s if ray[2] < 0.0 else math.inf
    lens_z, rise = upright_line(lens, ray, stand, surface.own)
    for k in range(places_along(lens, ray, first_m, end - THING_M, window, places)):
        at = places[k]
        if at < 0:
            continue
        if seen_s[at] >= oldest_s:
            seen_s[at] = stand.t_s
        if tall[at]:
            cell, r = surface.cells[at], first_m + k * STEP_M
            doubt = math.sqrt(noise_m2(r, ray[2], beams.lens_m2))
            z = lens_z + r * rise - ground_of(cell, surface.own)
            if cell.low_m - doubt <= z <= cell.top_m + doubt:
                vote(cell, touch(at, touched), PASS_THROUGH, touched)
                tall[at] = cell.stands > CLEAR


@kernel
def _back_at(ranges_m: F64, b: int) -> int:
    """The next beam, of this one and those after it, that came back."""
    while b < ranges_m.shape[1] and not ranges_m[0, b] >= MIN_RANGE_M:
        b += 1
    return b


@kernel
def _miss(
    lens: F64, ray: F64, stand: Stand, limits: Limits, surface: Surface, touched: Touched
) -> None:
    """A beam did not come back: where it should have met the ground there is none, or black one."""
    if ray[2] >= 0.0:
        return
    lens_m = set_upright(lens[2], 0.0, 0.0, stand, surface.own)
    z, at, x, y = stand.z_m, -1, 0.0, 0.0
    for _ in range(2):
        r = (z - lens_m) / ray[2]
        if not MIN_RANGE_M < r < limits.due_m:
            return
        x, y = lens[0] + r * ray[0], lens[1] + r * ray[1]
        at = cell_at(x, y, surface)
        if at < 0 or not _expects(at, x, y, r, ray, stand, limits, surface):
            return
        z = ground_of(surface.cells[at], surface.own)
    slot, part = touch(at, touched), part_bit(x, y, surface.cell_m, limits.parts)
    lower(surface.cells[at], slot, part, limits.h_neg_m / LOWERED, touched)


@kernel
def follow_beams(
    beams: Beams, stand: Stand, limits: Limits, surface: Surface, P: F64, touched: Touched
) -> None:
    """What all beams pass on their way to their ends. P: covariance of the sweep's error."""
    first = back = 0  # of the beams in a row that did not come back, and the one behind them
    for b in range(beams.returns.size):
        kind = beams.returns[b].kind
        if not beams.ranges_m[0, b] >= MIN_RANGE_M:
            if b >= back:
                first, back = b, _back_at(beams.ranges_m, b)
            if back - first >= DARK:
                _miss(beams.lenses[b], beams.rays[b], stand, limits, surface, touched)
            continue
        if kind not in (HIGH, NONE):
            _pass_low(b, beams, stand, limits, surface, P, touched)
        if (b + surface.scan[0]) % 2 == 0:  # the others in the next scan
            _pass_through(b, beams, stand, surface, touched)
