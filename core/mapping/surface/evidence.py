"""What the beams of a sweep say of the cells where they end, and what these are tied to.

    gain = aged / (aged + noise),  ground += gain (z - ground),  var = (1 - gain) aged

of floor, with what the attitude has wandered since it was seen in `aged`. All else is log-odds, to
which a scan adds one vote a cell, the highest of its beams'.

Source: docs/method.md, section 4.
"""

import math

from core.grid.places import cell_at, index_of, ones, part_bit, world_cell
from core.grid.touched import touch
from core.mapping.body import in_body
from core.mapping.rays import last_echo_m
from core.mapping.surface import cells
from core.mapping.surface.cells import APART, LOOSE, TIED, Plane, Surface, ground_of
from core.mapping.surface.constants import *
from core.mapping.surface.error import parted_m2
from core.mapping.surface.sweep import ABOVE, BELOW, FLOOR, HIGH, Beams, level_of, sigma_of
from core.records import F64
from jit import Record, kernel

VOTED, SAW_FLOOR, WENT_UNDER, NEWLY_TIED = 1, 2, 4, 8  # bits of what a scan has said of a cell


@kernel
def vote(at: int, say: float, surface: Surface) -> None:
    """Of a scan's votes on a cell, the highest counts."""
    cell, touched = surface.cells[at], surface.touched
    slot = touch(at, touched)
    if touched.bits[slot] & VOTED and say <= touched.said[slot]:
        return
    touched.bits[slot] |= VOTED
    before = cell.stands - touched.said[slot]
    cell.stands = min(MOST, max(LEAST, before + say))
    touched.said[slot] = cell.stands - before
    if before > CLEAR >= cell.stands and cell.top_m > -math.inf:
        cell.low_m, cell.top_m, cell.soft = math.inf, -math.inf, 0.0
        if surface.uppers.size > 0:
            surface.uppers[at].var_m2, surface.uppers[at].balance = math.inf, 0


@kernel
def touch_around(at: int, surface: Surface) -> None:
    """Have a cell and those beside it decided again."""
    i, j = world_cell(at, surface.ring)
    for n in range(9):
        near = index_of(i + n % 3 - 1, j + n // 3 - 1, surface.ring)
        if near >= 0:
            touch(near, surface.touched)


@kernel
def lower(at: int, part: int, depth: float, surface: Surface) -> None:
    """A beam was so far over the ground, less than none: half of it is believed at once."""
    cell, slot = surface.cells[at], touch(at, surface.touched)
    if cell.parts & part:
        return  # floor was seen there: it is the beam that errs
    cell.parts |= part << cells.PART_BITS
    before = 0.0 if cell.under_m == math.inf else cell.under_m
    if depth < before and not surface.touched.bits[slot] & WENT_UNDER:
        surface.touched.bits[slot] |= WENT_UNDER
        touch_around(at, surface)  # they may be its edge
        cell.under_m = before + LOWERED * (depth - before)


@kernel
def stay(cell: Record, move: float) -> None:
    """What was seen stays where it is while the ground moves."""
    cell.floor_m -= move
    cell.low_m -= move
    cell.top_m -= move
    cell.under_m -= move


@kernel
def expect(cell: Record, plane: Plane, x: float, y: float, surface: Surface) -> None:
    """Ground that is not seen yet, at a cell's centre; x, y: a point in it."""
    own, (ahead, aside) = surface.own, in_body(x, y, surface.stand)
    if cell.var_m2 < math.inf:
        stay(cell, plane.z_m - ground_of(cell, own))
    cell.arm_m, cell.aside_m = ahead + surface.stand.travel_m, aside
    cell.ground_m = plane.z_m + own[3] * cell.arm_m + own[4] * cell.aside_m
    cell.var_m2, cell.floor_s = plane.var_m2, plane.seen_s
    cell.slope_x, cell.slope_y = plane.slope_x, plane.slope_y


@kernel
def tie(at: int, i: int, j: int, surface: Surface) -> None:
    """Tie the ground of a cell, world cell i, j, that is not tied yet, by that around it.

    It is joined along a front as wide as a robot, no less, and not where more ground within two
    cells is a step off than joins it: no wheel climbs that.
    """
    cell, own, limits = surface.cells[at], surface.own, surface.limits
    ground = ground_of(cell, own)
    joined = apart = against = 0
    for dj in range(-REACH, REACH + 1):
        for di in range(-REACH, REACH + 1):
            near = index_of(i + di, j + dj, surface.ring)
            other = surface.cells[max(0, near)]
            if near < 0 or near == at or other.looks == 0:
                continue
            if not limits.h_neg_m < ground - ground_of(other, own) < limits.h_pos_m:
                against += other.tied == TIED
            elif max(abs(di), abs(dj)) == 1:
                joined += other.tied == TIED
                apart += other.tied == APART
    if joined >= FRONT and joined > against:
        surface.touched.bits[touch(at, surface.touched)] |= NEWLY_TIED  # and may tie others in turn
        cell.tied = TIED
    elif apart > joined:
        cell.tied = APART


@kernel
def spread_ties(surface: Surface) -> None:
    """Ground that was seen before is reached over what has been tied now."""
    touched, k = surface.touched, 0
    while k < touched.used[0]:  # grows as cells are tied
        if touched.bits[k] & NEWLY_TIED:
            i, j = world_cell(touched.at[k], surface.ring)
            for n in range(9):
                ni, nj = i + n % 3 - 1, j + n // 3 - 1
                near = index_of(ni, nj, surface.ring)
                if near >= 0 and surface.cells[near].looks > 0 and surface.cells[near].tied != TIED:
                    tie(near, ni, nj, surface)
        k += 1


@kernel
def _lay(cell: Record, z: float, gain: float, one: Record, surface: Surface) -> float:
    """Move a cell's ground towards a height z, seen now; by how much it moves."""
    arm, aside, own = one.ahead_m + surface.stand.travel_m, one.aside_m, surface.own
    move = gain * (z - ground_of(cell, own))
    cell.ground_m += gain * (z + own[3] * arm + own[4] * aside - cell.ground_m)
    cell.arm_m += gain * (arm - cell.arm_m)
    cell.aside_m += gain * (aside - cell.aside_m)
    return move


@kernel
def _see_floor(one: Record, z: float, surface: Surface) -> None:
    """Floor at height z at a cell's centre: the errors of one scan come together, count once."""
    at, limits, t_s = one.at, surface.limits, surface.stand.t_s
    cell = surface.cells[at]
    aged, since_s = cell.var_m2, t_s - cell.floor_s
    if cell.looks > 0:
        aged += parted_m2(one.ahead_m, one.aside_m, since_s)
    gain = aged / (aged + one.noise_m2)
    move = _lay(cell, z, gain, one, surface)
    if since_s < ALIKE_S:  # else all of it was seen by another attitude
        stay(cell, move)
    cell.var_m2, cell.floor_s = (1.0 - gain) * aged, t_s
    cell.looks = min(cells.MOST_LOOKS, cell.looks + 1)
    i, j = world_cell(at, surface.ring)
    if cell.looks & (cell.looks - 1) == 0:  # the first, second, fourth, eighth...
        plane = cells.plane_at(i, j, surface)
        cell.slope_x, cell.slope_y = plane.slope_x, plane.slope_y
    if cell.looks == 1:
        cell.floor_m = math.inf  # until then it was that of ground beyond it
        doubt = GATE * math.sqrt(one.var_m2)
        is_joined = limits.h_neg_m + doubt < one.height_m < limits.h_pos_m - doubt
        cell.tied = one.tied if is_joined or one.tied == APART else LOOSE
        if cell.tied == TIED:
            surface.touched.bits[touch(at, surface.touched)] |= NEWLY_TIED
    if cell.tied != TIED:
        tie(at, i, j, surface)


@kernel
def _end_on_floor(part: int, one: Record, z: float, is_step: bool, surface: Surface) -> None:
    """A return from floor, in a part of a cell, which may frame the cells beside it."""
    at, limits, bits = one.at, surface.limits, surface.touched.bits
    cell, slot = surface.cells[at], touch(at, surface.touched)
    one.kind = FLOOR
    if is_step:  # what was expected is worth nothing
        stay(cell, _lay(cell, z, 1.0, one, surface))
        cell.var_m2 = one.noise_m2
        one.tied = APART if one.height_m <= limits.h_neg_m else LOOSE
    if not bits[slot] & SAW_FLOOR:
        bits[slot] |= SAW_FLOOR
        _see_floor(one, z, surface)
    surface.seen_s[at] = surface.stand.t_s
    cell.floor_m = min(cell.floor_m, z - ground_of(cell, surface.own))
    if not cell.parts & part:
        cell.parts |= part
        i, j = world_cell(at, surface.ring)
        for di, dj in ((-1, 0), (1, 0), (0, -1), (0, 1)):
            near = index_of(i + di, j + dj, surface.ring)
            if near >= 0 and 0 < ones(surface.cells[near].parts) <= limits.row:
                touch(near, surface.touched)
    if cell.under_m < math.inf and cell.parts >> cells.PART_BITS & ~cell.parts == 0:
        cell.parts, cell.under_m = cell.parts & cells.ALL_PARTS, math.inf
    if cell.stands <= 0.0:
        vote(at, limits.floor_says, surface)
    else:
        vote(at, PASS_THROUGH if cell.low_m < limits.h_pos_m else 0.0, surface)


@kernel
def _goes_on(one: Record, ray: F64, surface: Surface) -> bool:
    """Whether the ground is as low already in the cell before that of a return.

    Not so near the seam of both that a face there has its returns on both sides of it.
    """
    level, doubt = level_of(ray), GATE * math.sqrt(one.noise_m2)
    sigma = sigma_of(math.hypot(one.ahead_m, one.aside_m), surface.limits)
    dx, dy, seam = ray[0] / level, ray[1] / level, math.sqrt(2.0) * GATE * sigma
    if cell_at(one.x_m - seam * dx, one.y_m - seam * dy, surface.ring) != one.at:
        return False
    step = surface.ring.cell_m
    before = cell_at(one.x_m - step * dx, one.y_m - step * dy, surface.ring)
    if before < 0 or before == one.at:
        return False
    cell = surface.cells[before]
    return bool(abs(cell.low_m + ground_of(cell, surface.own) - one.z_m) < doubt)


@kernel
def _stand(at: int, h: float, surface: Surface) -> None:
    """Something has a return at a height h, low_m and top_m its lowest and highest."""
    cell = surface.cells[at]
    if cell.top_m == -math.inf:  # until then the lowest return below the ground
        cell.low_m = h
    cell.low_m, cell.top_m = min(cell.low_m, h), max(cell.top_m, h)
    surface.tall[at] = cell.stands > CLEAR


@kernel
def _rise(one: Record, surface: Surface) -> None:
    """Over ground that is a guess, it stands what rises in its place more steeply than ground."""
    cell = surface.cells[one.at]
    _stand(one.at, one.z_m - ground_of(cell, surface.own), surface)
    steepest = STEEPEST * surface.ring.cell_m + GATE * math.sqrt(2.0 * one.noise_m2)
    if cell.top_m - cell.low_m > steepest:
        one.kind = ABOVE
        vote(one.at, HIT, surface)


@kernel
def _end(one: Record, ray: F64, surface: Surface) -> None:
    """A return into the cell where it lies: as floor, above it or below."""
    at, limits, stand = one.at, surface.limits, surface.stand
    cell = surface.cells[at]
    h, z = one.height_m, one.z_m - (one.slope_x * one.from_x + one.slope_y * one.from_y)
    sigma = math.sqrt(one.var_m2 + one.wander_m2 + one.noise_m2)
    is_guess = one.var_m2 > limits.guess_m2
    is_guess = is_guess and h < limits.h_pos_m + (0.0 if one.is_face else GATE * sigma)
    if is_guess and h < 0.0:
        return  # it tells nothing, over ground that is a guess
    if cell.var_m2 == math.inf:
        seen_s = stand.t_s - one.age_s
        plane = Plane(z - h, one.slope_x, one.slope_y, one.var_m2, seen_s, one.tied, True)
        expect(cell, plane, one.x_m, one.y_m, surface)
    if is_guess:
        _rise(one, surface)
        return
    touch(at, surface.touched)
    part = part_bit(one.x_m, one.y_m, surface.ring.cell_m, limits.parts)
    over = z - ground_of(cell, surface.own)  # h is over the ground that was due
    doubt = GATE * math.sqrt(one.near_var_m2 + one.wander_m2 + one.noise_m2)
    if cell.parts & part << cells.PART_BITS:
        doubt /= GATE  # seen lower before: only what is as high as it should be is floor
    is_step, is_lower = abs(h) > GATE * sigma, cell.looks == 0 and one.near_m < -doubt
    drift = 0.0
    if cell.looks > 0 and cell.floor_s < stand.t_s:
        drift = parted_m2(one.ahead_m, one.aside_m, stand.t_s - cell.floor_s)
    rise = min(limits.h_pos_m, GATE * math.sqrt(one.noise_m2 + drift))
    most = limits.h_pos_m if one.is_before else min(limits.h_pos_m, GATE * sigma)
    if ((h <= limits.h_neg_m and is_step) or is_lower) and not (
        is_lower and one.is_face == 0 and _goes_on(one, ray, surface)
    ):
        one.kind = BELOW
        cell.low_m = min(cell.low_m, one.z_m - ground_of(cell, surface.own))
        lower(at, part, over, surface)
    elif h < most and one.is_face == 0 and over <= cell.floor_m + rise:
        _end_on_floor(part, one, z, is_step and cell.looks == 0, surface)
    else:
        one.kind, foot = ABOVE, 0.0
        if cell.looks > 0 and cell.parts & part:  # a face: its first returns were floor, lifted it
            foot = max(-rise, cell.floor_m)
        vote(at, max(0.0, min(HIT, (h - foot - limits.h_pos_m) / sigma)), surface)
        _stand(at, over, surface)


@kernel
def softness(ranges_m: F64, b: int, limits: cells.Limits) -> float:
    """What the first of a beam's echoes says of what it met: whether that lets beams in.

    Stalks end beams off the middle of their neighbours, and more comes back from behind. A face
    ends them where it ends their neighbours; at its edge one neighbour goes far past.

    ranges_m (echoes, n): it, and those behind it.
    """
    r = ranges_m[0, b]
    alike = GATE * math.sqrt(1.5) * sigma_of(r, limits)
    before, after = max(0, b - 1), min(ranges_m.shape[1] - 1, b + 1)
    if not last_echo_m(ranges_m, b) - r > THING_M:
        is_met = before < b and abs(last_echo_m(ranges_m, before) - r) < alike
        is_met = is_met or (after > b and abs(last_echo_m(ranges_m, after) - r) < alike)
        return HARD if is_met else STOPPED
    one, other = ranges_m[0, before], ranges_m[0, after]
    are_beside = max(abs(one - r), abs(other - r)) < 2.0 * THING_M
    scatters = abs(r - 0.5 * (one + other)) > alike
    return LET_IN if before < b < after and are_beside and scatters else STOPPED


@kernel
def end_beams(beams: Beams, surface: Surface) -> None:
    """Each return into the cell where it lies; and whether what stands there lets beams in."""
    for b in range(beams.returns.size):
        one = beams.returns[b]
        if one.at < 0:
            continue
        if one.height_m > surface.limits.height_m:
            one.kind = HIGH
            continue
        _end(one, beams.rays[b], surface)
        if one.kind != ABOVE:
            continue
        cell = surface.cells[one.at]  # soon hard, if something lies down in it
        cell.soft = min(2.0 * MOST, cell.soft + softness(beams.ranges_m, b, surface.limits))
        if surface.limits.soft_m > 0.0:  # it counts for the cells around as well
            touch_around(one.at, surface)
