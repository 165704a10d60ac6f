"""One sweep against the ground: what each return is held against, and what tells how far it is off.

A return is held against the ground of its cell, or what `plane_at` or `reach` tell of that; its own
noise is that of range, attitude and lens (`noise_m2`).

Source: docs/method.md, sections 2 and 3.
"""

import math
from typing import NamedTuple

import numpy as np

from core.grid.places import cell_at, from_centre, index_of
from core.mapping.body import in_body
from core.mapping.rays import MIN_RANGE_M
from core.mapping.surface import cells
from core.mapping.surface.cells import NOWHERE, Plane, Surface, ground_of, plane_of
from core.mapping.surface.constants import *
from core.records import F64
from jit import Records, fields, kernel

RETURN = np.dtype(
    [
        *fields(np.float64, "x_m y_m"),  # place, map frame,
        *fields(np.float32, "from_x from_y"),  # and from the middle of its cell
        *fields(np.float32, "z_m ahead_m aside_m"),  # the same in the robot's frame
        *fields(np.float32, "height_m slope_x slope_y var_m2"),  # over the ground there; of that
        *fields(np.float32, "age_s wander_m2"),  # of what tells it; what the attitude wandered
        *fields(np.float32, "near_m near_var_m2"),  # over the ground before it on its own beam
        *fields(np.float32, "noise_m2"),  # of its own height
        # by how much its beam lies over what `witness` tells, and where, in the robot's frame
        *fields(np.float32, "off_m witness_ahead_m witness_aside_m"),
        *fields(np.int32, "at witness"),  # flat indices of cells; -1: none, or outside
        *fields(np.int8, "kind tied"),  # what it is; what that ground is
        *fields(np.int8, "is_face"),  # the sweep climbs it sideways steeper than ground can be
        *fields(np.int8, "is_before"),  # ground nearer was measured
    ],
    align=True,
)
NONE, FLOOR, ABOVE, BELOW, HIGH = 0, 1, 2, 3, 4  # what a return is


class Beams(NamedTuple):
    """A sweep's beams, as kernels are given them."""

    lenses: F64  # (n, 3)
    rays: F64  # (n, 3)
    ranges_m: F64  # (echoes, n)
    returns: Records  # (n,) of RETURN
    lens_m2: float  # variance of the height of the lens


@kernel
def sigma_of(r: float, limits: cells.Limits) -> float:
    """Of a range, by the scanner's sheet: sigma_r."""
    return max(limits.sigma_m, limits.sigma_share * r)


@kernel
def noise_m2(r: float, fall: float, lens_m2: float, limits: cells.Limits) -> float:
    """Variance of a return's height: range along the beam, attitude across it, the lens.

    fall: z of the ray. lens_m2: by how much the lens is lifted where wheels roll over bumps.
    """
    along, across = sigma_of(r, limits) * fall, SIGMA_ANGLE_RAD * r
    return along * along + across * across * (1.0 - fall * fall) + lens_m2


@kernel
def set_upright(z: float, ahead: float, aside: float, surface: Surface) -> float:
    """A height without the sweep's error, as far as that is known."""
    own = surface.own
    fast = own[0] + own[1] * ahead + own[2] * aside
    return float(z - fast - own[3] * (ahead + surface.stand.travel_m) - own[4] * aside)


@kernel
def upright_line(lens: F64, ray: F64, surface: Surface) -> tuple[float, float]:
    """The same along a beam: the height of its lens, and by how much it rises a metre."""
    own, (hx, hy) = surface.own, surface.stand.heading
    ahead, aside = in_body(lens[0], lens[1], surface.stand)
    goes_ahead, goes_aside = ray[0] * hx + ray[1] * hy, ray[1] * hx - ray[0] * hy
    rise = ray[2] - (own[1] + own[3]) * goes_ahead - (own[2] + own[4]) * goes_aside
    return set_upright(lens[2], ahead, aside, surface), rise


@kernel
def level_of(ray: F64) -> float:
    """How far a beam goes along the ground in a metre: also straight down not 0."""
    return max(math.hypot(ray[0], ray[1]), 1e-9)


@kernel
def reach(x: float, y: float, r: float, ray: F64, surface: Surface) -> Plane:
    """Ground at a point of a beam, r away, by the nearest seen towards the robot, or its wheels."""
    stand, cell_m, away = surface.stand, surface.ring.cell_m, THING_M
    while away < min(r, GAP_M):
        bx, by = x - away * ray[0], y - away * ray[1]
        at = cell_at(bx, by, surface.ring)
        if at >= 0 and surface.cells[at].looks > 0:
            cell = surface.cells[at]
            kept = 1.0 / (1.0 + away / CARRY_M)
            dx, dy = x - bx + from_centre(bx, cell_m), y - by + from_centre(by, cell_m)
            var = cells.grown(cell.var_m2, math.sqrt(dx * dx + dy * dy))
            rise = cell.slope_x * dx + cell.slope_y * dy
            z = ground_of(cell, surface.own) + kept * rise
            var += min(0.0, (1.0 - kept) * rise) ** 2  # ground that falls away may go on to fall
            return plane_of(cell, z, var)
        away += THING_M
    dx, dy, (a, b) = x - stand.x_m, y - stand.y_m, stand.slopes
    var = min(surface.limits.wheels_m2, (0.5 * STEEP) ** 2 * (dx * dx + dy * dy))
    z = surface.now[0].wheels_m + a * dx + b * dy
    return Plane(z, a, b, var, stand.t_s, cells.TIED, False)


@kernel
def hold(beams: Beams, surface: Surface) -> int:
    """Each first return against the ground where it lies, into its RETURN; how many there are."""
    last, count, plane, near, ring = -2, 0, NOWHERE, NOWHERE, surface.ring
    surface.now[0].held += 1
    for b in range(beams.returns.size):
        one, r = beams.returns[b], beams.ranges_m[0, b]
        one.at, one.kind = -1, NONE
        if not r >= MIN_RANGE_M:
            continue
        count += 1
        lens, ray = beams.lenses[b], beams.rays[b]
        x, y = lens[0] + r * ray[0], lens[1] + r * ray[1]
        i, j = math.floor(x / ring.cell_m), math.floor(y / ring.cell_m)
        at = index_of(i, j, ring)
        one.x_m, one.y_m, one.at = x, y, at
        one.noise_m2 = noise_m2(r, ray[2], beams.lens_m2, surface.limits)
        one.ahead_m, one.aside_m = in_body(x, y, surface.stand)
        z = set_upright(lens[2] + r * ray[2], one.ahead_m, one.aside_m, surface)
        one.z_m = z
        if at < 0:
            continue
        cx, cy = x - (i + 0.5) * ring.cell_m, y - (j + 0.5) * ring.cell_m
        one.from_x, one.from_y = cx, cy
        if at != last:  # what is due in a cell, at its centre
            last, cell = at, surface.cells[at]
            if cell.looks > 0:
                near = plane = plane_of(cell, ground_of(cell, surface.own), cell.var_m2)
            else:
                near = plane = cells.plane_at(i, j, surface)
                if not (plane.var_m2 < math.inf and z > plane.z_m + surface.limits.h_pos_m):
                    near = reach(x - cx, y - cy, r, ray, surface)
                if plane.var_m2 == math.inf:
                    plane = near
        one.slope_x, one.slope_y, one.var_m2 = plane.slope_x, plane.slope_y, plane.var_m2
        one.is_before, one.tied = plane.is_before, plane.tied
        one.height_m = z - plane.z_m - plane.slope_x * cx - plane.slope_y * cy
        one.age_s = surface.stand.t_s - plane.seen_s
        one.near_m = z - near.z_m - near.slope_x * cx - near.slope_y * cy
        one.near_var_m2 = near.var_m2
    return count


@kernel
def find_faces(returns: Records, is_plane: bool) -> None:
    """Which returns lie on what rises to the side, too steeply for ground.

    A sweep meets level ground along a line across the way: one that climbs, or falls, while it
    hardly goes aside runs along a wall.
    """
    last = returns.size - 1
    for b in range(returns.size):
        me, one, other = returns[b], returns[max(0, b - BESIDE)], returns[min(last, b + BESIDE)]
        me.is_face = 0
        if me.at >= 0 and one.at >= 0 and other.at >= 0:
            rise, run = abs(other.z_m - one.z_m), abs(other.aside_m - one.aside_m)
            if not is_plane:  # returns of several planes may be beside each other anyhow
                run = math.hypot(other.x_m - one.x_m, other.y_m - one.y_m)
            doubt = GATE * math.sqrt(one.noise_m2 + other.noise_m2)
            me.is_face = rise - doubt > STEEPEST * run


@kernel
def find_witnesses(beams: Beams, surface: Surface) -> None:
    """Where each beam meets ground that is known, and beyond which floor was seen as well."""
    for b in range(beams.returns.size):
        one, lens, ray = beams.returns[b], beams.lenses[b], beams.rays[b]
        one.witness = -1
        if one.at < 0:
            continue
        r = beams.ranges_m[0, b]
        for k in range(1 + REACH):
            x, y = lens[0] + r * ray[0], lens[1] + r * ray[1]
            at = cell_at(x, y, surface.ring)
            cell = surface.cells[max(0, at)]
            if at >= 0 and cell.looks > 0 and cell.stands <= KNOWN:
                ahead, aside = in_body(x, y, surface.stand)
                z = set_upright(lens[2] + r * ray[2], ahead, aside, surface)
                off = cells.height_over(cell, x, y, z, surface)
                if k == 0 or off < 0.0:  # else it passes over it
                    one.witness, one.off_m = at, off
                    one.witness_ahead_m, one.witness_aside_m = ahead, aside
                break
            if one.height_m >= 0.0:
                break  # one that ends below the ground has passed under such ground before
            r -= surface.ring.cell_m / level_of(ray)


@kernel
def agree(returns: Records, tied: int, surface: Surface) -> None:
    """Where ground is a guess for most returns, those are floor, so tied, of one height."""
    limits, bins = surface.limits, surface.room.bins
    unsure, sure, guessed, edge = 0, 0, 0, 0.5 * limits.h_pos_m / WIDE
    bins[:] = 0.0
    for b in range(returns.size):
        one = returns[b]
        if one.at >= 0 and one.var_m2 <= limits.sure_m2:
            sure += 1
        elif one.at >= 0:
            guessed += 1
            k = math.floor(one.height_m / edge) + BINS // 2
            if 0 <= k < BINS and one.height_m**2 < HIT * HIT * one.var_m2:
                unsure += 1
                bins[k] += 1.0
    best, most, total = 0, 0.0, 0.0  # of WIDE bins, the last of them k
    for k in range(BINS):
        total += bins[k] - (bins[k - WIDE] if k >= WIDE else 0.0)
        if total > most:
            best, most = max(0, k - WIDE + 1), total
    if sure >= RARE * (sure + guessed) or most < WITNESSES or most < SHARE * unsure:
        return
    low, total, offset = (best - BINS // 2) * edge, 0.0, 0.0  # their mean
    for b in range(returns.size):
        one = returns[b]
        if one.at >= 0 and one.var_m2 > limits.sure_m2 and 0.0 <= one.height_m - low < WIDE * edge:
            total += 1.0
            offset += (one.height_m - offset) / total
    for b in range(returns.size):
        one = returns[b]
        if one.at >= 0 and one.var_m2 > limits.sure_m2:
            one.height_m -= offset
            one.near_m -= offset
            one.var_m2 = one.near_var_m2 = (0.25 * WIDE * edge) ** 2
            one.tied = tied
