"""What the beams of a sweep pass on their way: nothing stands there, or no ground is there.

Source: docs/method.md, section 4.
"""

import math

from core.grid.places import cell_at, index_of, part_bit
from core.grid.touched import touch
from core.mapping.along import STEP_M, first_place_m, places_along, share_of
from core.mapping.body import in_body
from core.mapping.rays import MIN_RANGE_M
from core.mapping.surface import sweep
from core.mapping.surface.cells import Surface, ground_of, height_over, plane_at
from core.mapping.surface.constants import *
from core.mapping.surface.error import arms_m2, parted_m2
from core.mapping.surface.evidence import expect, lower, vote
from core.mapping.surface.sweep import Beams, level_of, noise_m2, reach, upright_line
from core.records import F64
from jit import Record, kernel


@kernel
def _expects(at: int, x: float, y: float, r: float, ray: F64, surface: Surface) -> bool:
    """Whether ground is due in a cell, seen or told by what lies before it."""
    cell = surface.cells[at]
    if cell.var_m2 < math.inf:
        return True
    plane = reach(x, y, r, ray, surface)
    if plane.var_m2 > surface.limits.guess_m2:
        return False
    expect(cell, plane, x, y, surface)
    return True


@kernel
def _leave(b: int, beams: Beams, surface: Surface) -> float:
    """How far a beam counts that leaves the map, or ends low over a guess; BELOW if low there."""
    one, lens, ray, ring = beams.returns[b], beams.lenses[b], beams.rays[b], surface.ring
    corner, r = (ring.corner_i, ring.corner_j), beams.ranges_m[0, b]
    expected_m = surface.limits.guess_m2 / (BEND * BEND * CARRY_M)  # until ground is a guess
    for k in range(2):
        edge_m = (corner[k] + (ring.size if ray[k] > 0.0 else 0)) * ring.cell_m
        if ray[k] != 0.0:
            r = min(r, (edge_m - lens[k]) / ray[k] - 0.5 * ring.cell_m)
    (lens_z, rise), wheels_m = upright_line(lens, ray, surface), surface.now[0].wheels_m
    if rise < 0.0:
        r = min(r, (wheels_m - lens_z) / rise + expected_m / level_of(ray))
    z = lens_z + r * rise
    if z - wheels_m > surface.limits.h_neg_m or r < MIN_RANGE_M:
        return float(r)
    x, y = lens[0] + r * ray[0], lens[1] + r * ray[1]
    plane = reach(x, y, r, ray, surface)
    one.height_m, one.var_m2 = z - plane.z_m, plane.var_m2
    one.wander_m2 = parted_m2(*in_body(x, y, surface.stand), surface.stand.t_s - plane.seen_s)
    noise = noise_m2(r, ray[2], beams.lens_m2, surface.limits)
    sigma = math.sqrt(one.var_m2 + one.wander_m2 + noise)
    if one.height_m <= min(surface.limits.h_neg_m, -GATE * sigma):
        one.kind = sweep.BELOW
    return float(r)


@kernel
def _pass_low(b: int, end: float, beams: Beams, surface: Surface) -> None:
    """Back from where a beam ends, while it is low: nothing stands, or no ground is there."""
    one, lens, ray = beams.returns[b], beams.lenses[b], beams.rays[b]
    limits, cell_m = surface.limits, surface.ring.cell_m
    if one.height_m > limits.h_pos_m:
        return  # nor is it low before
    is_below = one.kind == sweep.BELOW
    is_low = one.height_m <= -GATE * math.sqrt(one.var_m2 + one.wander_m2 + one.noise_m2)
    step = cell_m / max(abs(ray[0]), abs(ray[1]), 1e-9)  # to the next row or column of cells
    if is_below:
        step, last, r = 0.25 * step, -1, end
    else:
        step, last = max(step, STEP_M), one.at
        r = end + (1.0 - share_of(b, surface.now[0].scan)) * step
    lens_z, rise = upright_line(lens, ray, surface)
    while r - step > MIN_RANGE_M and end - r < GAP_M:
        r -= step
        x, y = lens[0] + r * ray[0], lens[1] + r * ray[1]
        i, j = math.floor(x / cell_m), math.floor(y / cell_m)
        at = index_of(i, j, surface.ring)
        if at < 0 or (at == last and not is_below):
            continue
        last, cell = at, surface.cells[at]
        if cell.var_m2 == math.inf and not (is_low and _expects(at, x, y, r, ray, surface)):
            continue
        if cell.looks == 0:  # the ground around may tell it better by now
            plane = plane_at(i, j, surface)
            if plane.var_m2 < cell.var_m2:
                expect(cell, plane, x, y, surface)
        h = height_over(cell, x, y, lens_z + r * rise, surface)
        if h > limits.h_pos_m:
            return
        if h >= 0.0 and cell.stands <= LEAST and cell.under_m == math.inf:
            continue  # it is clear already: nothing is said
        touch(at, surface.touched)
        if cell.stands <= 0.0:
            vote(at, PASS_LOW, surface)
        if h < 0.0:
            (ahead, aside), age_s = in_body(x, y, surface.stand), surface.stand.t_s - cell.floor_s
            var = noise_m2(r, ray[2], beams.lens_m2, surface.limits) + cell.var_m2
            var += parted_m2(ahead, aside, age_s) + arms_m2(ahead, aside, cell, surface)
            if h * h > GATE * GATE * var:
                lower(at, part_bit(x, y, cell_m, limits.parts), h, surface)
        if cell.under_m < math.inf and cell.looks == 0:
            _see_beyond(cell, one, surface)


@kernel
def _see_beyond(cell: Record, one: Record, surface: Surface) -> None:
    """Where a beam landed that was under the ground of a cell: on floor, lower, or on a face."""
    own, end = surface.own, surface.cells[max(0, one.at)]
    over_lowest = one.z_m - ground_of(end, own) - end.low_m
    if one.kind == sweep.FLOOR:
        cell.floor_m = ground_of(end, own) - ground_of(cell, own)
    elif one.height_m <= surface.limits.h_neg_m:
        cell.floor_m = min(cell.floor_m, one.z_m - ground_of(cell, own))
    elif one.kind == sweep.ABOVE or over_lowest > GATE * math.sqrt(2.0 * one.noise_m2):
        cell.floor_m = 0.0


@kernel
def _pass_through(b: int, beams: Beams, surface: Surface) -> None:
    """Along a beam: where something stood at its height, and does not stop it, it may be gone."""
    lens, ray, end, ring = beams.lenses[b], beams.rays[b], beams.ranges_m[0, b], surface.ring
    tall, seen_s, places = surface.tall, surface.seen_s, surface.room.places
    first_m = first_place_m(b, surface.now[0].scan)
    # on its way up, what comes in would stop the beam as little
    oldest_s = surface.oldest_s if ray[2] < 0.0 else math.inf
    lens_z, rise = upright_line(lens, ray, surface)
    for k in range(places_along(lens, ray, first_m, end - THING_M, ring, places)):
        at = places[k]
        if at < 0:
            continue
        if seen_s[at] >= oldest_s:
            seen_s[at] = surface.stand.t_s
        if tall[at]:
            cell, r = surface.cells[at], first_m + k * STEP_M
            doubt = math.sqrt(noise_m2(r, ray[2], beams.lens_m2, surface.limits))
            z = lens_z + r * rise - ground_of(cell, surface.own)
            if cell.low_m - doubt <= z <= cell.top_m + doubt:
                vote(at, PASS_THROUGH, surface)
                tall[at] = cell.stands > CLEAR


@kernel
def _miss(lens: F64, ray: F64, surface: Surface) -> None:
    """A beam did not come back: where it should have met the ground there is none, or black one."""
    limits, z, at, x, y = surface.limits, surface.now[0].wheels_m, -1, 0.0, 0.0
    if ray[2] >= 0.0:
        return
    lens_m = sweep.set_upright(lens[2], 0.0, 0.0, surface)
    for _ in range(2):
        r = (z - lens_m) / ray[2]
        if not MIN_RANGE_M < r < math.sqrt(2.0) * limits.far_m:  # of level ground, at 45 degrees
            return
        x, y = lens[0] + r * ray[0], lens[1] + r * ray[1]
        at = cell_at(x, y, surface.ring)
        if at < 0 or not _expects(at, x, y, r, ray, surface):
            return
        z = ground_of(surface.cells[at], surface.own)
    part = part_bit(x, y, surface.ring.cell_m, limits.parts)
    lower(at, part, limits.h_neg_m / LOWERED, surface)


@kernel
def follow_beams(beams: Beams, surface: Surface) -> None:
    """What all beams pass on their way to their ends."""
    ranges_m, count = beams.ranges_m[0], beams.returns.size
    first = back = 0  # of the beams in a row that did not come back, and the one behind them
    for b in range(count):
        if math.isnan(ranges_m[b]):
            if b >= back:
                first = back = b
                while back < count and math.isnan(ranges_m[back]):
                    back += 1
            if back - first >= DARK:
                _miss(beams.lenses[b], beams.rays[b], surface)
            continue
        if ranges_m[b] < MIN_RANGE_M:
            continue  # it came back, and tells nothing
        one, end = beams.returns[b], ranges_m[b]
        if one.at < 0 or (one.kind == sweep.NONE and one.height_m < 0.0):
            end = _leave(b, beams, surface)
        if one.kind not in (sweep.HIGH, sweep.NONE):
            _pass_low(b, end, beams, surface)
        if (b + surface.now[0].scan) % 2 == 0:  # the others in the next scan
            _pass_through(b, beams, surface)
