"""What the beams of a sweep say of the cells where they end.

A scan has one vote a cell, the highest of its beams': a hit outweighs a beam that passes beside it.
Ground that is met is a Kalman filter's, with what the attitude has wandered since as its noise:

    gain = aged / (aged + noise),  ground += gain (z - ground),  var = (1 - gain) aged

Source: docs/method.md, section 4.
"""

import math

from core.grid.places import ones, part_bit
from core.mapping.surface.cells import (
    APART,
    LOOSE,
    MOST_LOOKS,
    PART_BITS,
    TIED,
    Surface,
    cell_at,
    floor_parts,
    ground_of,
    index_of,
    plane_at,
    row_of,
    under_parts,
    world_cell,
)
from core.mapping.surface.constants import (
    ALIKE_S,
    CLEAR,
    FLAT_M,
    GATE,
    HIT,
    LEAST,
    LOWERED,
    MOST,
    PASS_THROUGH,
    SIGMA_RANGE_M,
    STEEPEST,
    THING_M,
)
from core.mapping.surface.error import parted_m2
from core.mapping.surface.soft import softness
from core.mapping.surface.sweep import (
    ABOVE,
    BELOW,
    FLOOR,
    HIGH,
    Beams,
    Stand,
)
from core.mapping.surface.ties import tie
from core.mapping.surface.touched import (
    NEWLY_TIED,
    SAW_FLOOR,
    VOTED,
    WENT_UNDER,
    Limits,
    Touched,
    touch,
)
from core.records import F64
from jit import Record, kernel


@kernel
def vote(cell: Record, slot: int, say: float, touched: Touched) -> None:
    """Of a scan's votes on a cell, touched before, the highest counts."""
    before = 0.0
    if not touched.bits[slot] & VOTED:
        touched.bits[slot] |= VOTED
        before = cell.stands
    elif say > touched.said[slot]:
        before = cell.stands - touched.said[slot]
    else:
        return
    cell.stands = min(MOST, max(LEAST, before + say))
    touched.said[slot] = cell.stands - before
    if before > CLEAR >= cell.stands:
        cell.low_m, cell.top_m, cell.soft = math.inf, -math.inf, 0.0


@kernel
def lower(cell: Record, slot: int, part: int, depth: float, touched: Touched) -> None:
    """A beam was so far over the ground, less than none: half of it is believed at once.

    Where floor was seen, it is the beam that errs.
    """
    if floor_parts(cell) & part:
        return
    cell.parts |= part << PART_BITS
    before = 0.0 if cell.under_m == math.inf else cell.under_m
    if depth < before and not touched.bits[slot] & WENT_UNDER:
        touched.bits[slot] |= WENT_UNDER
        cell.under_m = before + LOWERED * (depth - before)


@kernel
def _lay(cell: Record, z: float, gain: float, one: Record, stand: Stand, own: F64) -> float:
    """Move a cell's ground towards a height z, seen now; by how much it moves."""
    arm, aside = one.ahead_m + stand.travel_m, one.aside_m
    move = gain * (z - ground_of(cell, own))
    cell.ground_m += gain * (z + own[3] * arm + own[4] * aside - cell.ground_m)
    cell.arm_m += gain * (arm - cell.arm_m)
    cell.aside_m += gain * (aside - cell.aside_m)
    return move


@kernel
def stay(cell: Record, move: float) -> None:
    """What was seen stays where it is while the ground moves."""
    cell.floor_m -= move
    cell.low_m -= move
    cell.top_m -= move
    cell.under_m -= move


@kernel
def _see_floor(
    at: int, slot: int, one: Record, z: float, stand: Stand, limits: Limits, surface: Surface,
    touched: Touched,
) -> None:  # fmt: skip
    """Floor at height z at a cell's centre: the errors of one scan come together, count once."""
    cell, own = surface.cells[at], surface.own
    touched.bits[slot] |= SAW_FLOOR
    aged, since_s = cell.var_m2, stand.t_s - cell.floor_s
    if cell.looks > 0:
        aged += parted_m2(one.ahead_m, one.aside_m, since_s)
    gain = aged / (aged + one.noise_m2)
    move = _lay(cell, z, gain, one, stand, own)
    if since_s < ALIKE_S:  # else all of it was seen by another attitude
        stay(cell, move)
    cell.var_m2 = (1.0 - gain) * aged
    cell.floor_s = stand.t_s
    if cell.looks == 0:  # until then it was that of ground beyond it
        cell.floor_m = math.inf
    cell.looks = min(MOST_LOOKS, cell.looks + 1)
    i, j = world_cell(at, surface)
    if cell.looks & (cell.looks - 1) == 0:  # the first, second, fourth, eighth...
        plane = plane_at(i, j, stand.x_m, stand.y_m, surface)
        cell.slope_x, cell.slope_y = plane.slope_x, plane.slope_y
    if cell.looks == 1:
        doubt = GATE * math.sqrt(one.var_m2)
        is_joined = limits.h_neg_m + doubt < one.height_m < limits.h_pos_m - doubt
        cell.tied = one.tied if is_joined or one.tied == APART else LOOSE
        if cell.tied == TIED:
            touched.bits[slot] |= NEWLY_TIED
    if cell.tied != TIED:
        tie(at, i, j, limits, surface, touched)


@kernel
def _see_part(at: int, part: int, limits: Limits, surface: Surface, touched: Touched) -> None:
    """Floor in a part of a cell, which may frame the cells beside it."""
    cells = surface.cells
    if floor_parts(cells[at]) & part:
        return
    cells[at].parts |= part
    i, j = world_cell(at, surface)
    for di, dj in ((-1, 0), (1, 0), (0, -1), (0, 1)):
        near = index_of(i + di, j + dj, surface)
        if near >= 0 and 0 < ones(floor_parts(cells[near])) <= row_of(limits.parts):
            touch(near, touched)


@kernel
def _end_on_floor(
    at: int, slot: int, part: int, one: Record, z: float, is_step: bool, stand: Stand,
    limits: Limits, surface: Surface, touched: Touched,
) -> None:  # fmt: skip
    """A return from floor."""
    cell = surface.cells[at]
    one.kind = FLOOR
    if is_step:  # what was expected is worth nothing
        stay(cell, _lay(cell, z, 1.0, one, stand, surface.own))
        cell.var_m2 = one.noise_m2
        one.tied = APART if one.height_m <= limits.h_neg_m else LOOSE
    if not touched.bits[slot] & SAW_FLOOR:
        _see_floor(at, slot, one, z, stand, limits, surface, touched)
    touched.seen_s[at] = stand.t_s
    cell.floor_m = min(cell.floor_m, z - ground_of(cell, surface.own))
    _see_part(at, part, limits, surface, touched)
    if cell.under_m < math.inf and under_parts(cell) & ~floor_parts(cell) == 0:
        cell.parts, cell.under_m = floor_parts(cell), math.inf
    rests = cell.low_m < limits.h_pos_m
    vote(cell, slot, PASS_THROUGH if cell.stands > 0.0 and rests else 0.0, touched)


@kernel
def _goes_on(at: int, z: float, doubt: float, ray: F64, one: Record, surface: Surface) -> bool:
    """Whether the ground is as low already in the cell before that of a return.

    Not so near the seam of both that a face there has its returns on both sides of it.
    """
    level = math.hypot(ray[0], ray[1])
    dx, dy, seam = ray[0] / level, ray[1] / level, GATE * SIGMA_RANGE_M
    if cell_at(one.x_m - seam * dx, one.y_m - seam * dy, surface) != at:
        return False
    step = surface.cell_m
    before = cell_at(one.x_m - step * dx, one.y_m - step * dy, surface)
    if before < 0 or before == at:
        return False
    cell = surface.cells[before]
    return bool(abs(cell.low_m + ground_of(cell, surface.own) - z) < doubt)


@kernel
def _stand(at: int, h: float, one: Record, surface: Surface, touched: Touched) -> None:
    """Something has a return at a height h, low_m and top_m its lowest and highest.

    A grain of dust stands above what it is met over: alone, it widens nothing.
    """
    cell = surface.cells[at]
    is_point = cell.top_m - cell.low_m < FLAT_M
    if cell.top_m == -math.inf or (is_point and h < cell.low_m - THING_M):
        cell.low_m = cell.top_m = h
    elif one.is_lone == 0 or cell.low_m - THING_M <= h <= cell.top_m + THING_M:
        cell.low_m, cell.top_m = min(cell.low_m, h), max(cell.top_m, h)
    touched.tall[at] = cell.stands > CLEAR


@kernel
def _rise(at: int, one: Record, surface: Surface, touched: Touched) -> None:
    """Over ground that is a guess, it stands what rises in its place more steeply than ground."""
    cell = surface.cells[at]
    _stand(at, one.z_m - ground_of(cell, surface.own), one, surface, touched)
    steepest = STEEPEST * surface.cell_m + GATE * math.sqrt(2.0 * one.noise_m2)
    if cell.top_m - cell.low_m > steepest:
        one.kind = ABOVE
        vote(cell, touch(at, touched), HIT, touched)


@kernel
def _end(
    at: int, one: Record, ray: F64, stand: Stand, limits: Limits, surface: Surface,
    touched: Touched,
) -> None:  # fmt: skip
    """A return into the cell where it lies: as floor, above it or below."""
    cell, own, h, cell_m = surface.cells[at], surface.own, one.height_m, surface.cell_m
    slope = one.slope_x * one.from_x + one.slope_y * one.from_y
    z, sigma = one.z_m - slope, math.sqrt(one.var_m2 + one.wander_m2 + one.noise_m2)
    higher = limits.h_pos_m + (0.0 if one.is_face else GATE * sigma)
    is_guess = one.var_m2 > limits.guess_m2 and h < higher
    if is_guess and h < 0.0:
        return  # it tells nothing, over ground that is a guess
    if cell.var_m2 == math.inf:
        expect(cell, z - h, one.var_m2, one.ahead_m, one.aside_m, stand, own)
        cell.slope_x, cell.slope_y = one.slope_x, one.slope_y
        cell.floor_s = stand.t_s - one.age_s
    if is_guess:
        _rise(at, one, surface, touched)
        return
    slot, part = touch(at, touched), part_bit(one.x_m, one.y_m, cell_m, limits.parts)
    doubt = GATE * math.sqrt(one.near_var_m2 + one.wander_m2 + one.noise_m2)
    drift = 0.0
    if cell.looks > 0 and cell.floor_s < stand.t_s:
        drift = parted_m2(one.ahead_m, one.aside_m, stand.t_s - cell.floor_s)
    rise = min(limits.h_pos_m, GATE * math.sqrt(one.noise_m2 + drift))
    if under_parts(cell) & part:
        doubt /= GATE  # seen lower before: only what is as high as it should be is floor
    is_lower = cell.looks == 0 and one.near_m < -doubt
    goes_on = is_lower and one.is_face == 0
    goes_on = goes_on and _goes_on(at, one.z_m, GATE * math.sqrt(one.noise_m2), ray, one, surface)
    is_step = abs(h) > GATE * sigma
    most = limits.h_pos_m if one.is_before else min(limits.h_pos_m, GATE * sigma)
    if (h <= limits.h_neg_m and is_step and not goes_on) or (is_lower and not goes_on):
        one.kind = BELOW
        cell.low_m = min(cell.low_m, h)
        lower(cell, slot, part, z - ground_of(cell, own), touched)
    elif h < most and one.is_face == 0 and z - ground_of(cell, own) <= cell.floor_m + rise:
        is_step = is_step and cell.looks == 0
        _end_on_floor(at, slot, part, one, z, is_step, stand, limits, surface, touched)
    else:
        one.kind = ABOVE
        vote(cell, slot, max(0.0, min(HIT, (h - limits.h_pos_m) / sigma)), touched)
        _stand(at, h, one, surface, touched)


@kernel
def expect(
    cell: Record, z: float, var_m2: float, ahead: float, aside: float, stand: Stand, own: F64
) -> None:
    """Ground that is not seen yet."""
    cell.arm_m, cell.aside_m = ahead + stand.travel_m, aside
    cell.ground_m = z + own[3] * cell.arm_m + own[4] * cell.aside_m
    cell.var_m2 = var_m2


@kernel
def _tell_soft(one: Record, say: float, limits: Limits, surface: Surface, touched: Touched) -> None:
    """Whether what stands in a cell lets beams in, which counts for those around it as well."""
    cell = surface.cells[one.at]
    cell.soft = min(2.0 * MOST, cell.soft + say)  # soon hard, if something lies down in it
    if limits.soft_m > 0.0:
        i, j = world_cell(one.at, surface)
        for n in range(9):
            near = index_of(i + n % 3 - 1, j + n // 3 - 1, surface)
            if near >= 0:
                touch(near, touched)


@kernel
def end_beams(
    beams: Beams, stand: Stand, limits: Limits, surface: Surface, touched: Touched
) -> None:
    """Each return into the cell where it lies."""
    for b in range(beams.returns.size):
        one = beams.returns[b]
        if one.at < 0:
            continue
        if one.height_m > limits.height_m:
            one.kind = HIGH
        else:
            _end(one.at, one, beams.rays[b], stand, limits, surface, touched)
            if one.kind == ABOVE:
                _tell_soft(one, softness(beams.ranges_m, b), limits, surface, touched)
