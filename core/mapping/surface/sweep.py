"""One sweep against the ground: what each return is held against, and what tells how far it is off.

A return at range r, whose ray has the slope f (its z), is off in height by

    sigma^2 = (SIGMA_RANGE_M f)^2 + (SIGMA_ANGLE_RAD r)^2 (1 - f^2) + lens^2

lens^2 is by how much the lens is lifted where the wheels roll over what is uneven.

Source: docs/method.md, section 3.
"""

import math
from typing import NamedTuple

import numpy as np

from core.mapping.rays import MIN_RANGE_M
from core.mapping.surface.cells import (
    LOOSE,
    NOWHERE,
    TIED,
    Plane,
    Surface,
    cell_at,
    from_centre,
    ground_of,
    grown,
    index_of,
    plane_at,
    real,
    whole,
)
from core.mapping.surface.constants import (
    ALIKE_S,
    BESIDE,
    BINS,
    CARRY_M,
    FLAT_M,
    GAP_M,
    GATE,
    HIT,
    KNOWN,
    RARE,
    REACH,
    SHARE,
    SIGMA_ANGLE_RAD,
    SIGMA_RANGE_M,
    STEEP,
    STEEPEST,
    THING_M,
    WIDE,
    WITNESSES,
)
from core.mapping.surface.touched import Limits
from core.records import F64
from jit import Record, Records, kernel

RETURN = np.dtype(
    [
        ("x_m", np.float64),  # place, map frame
        ("y_m", np.float64),
        ("from_x", np.float32),  # the same from the middle of its cell
        ("from_y", np.float32),
        ("z_m", np.float32),
        ("ahead_m", np.float32),  # the same in the robot's frame
        ("aside_m", np.float32),
        ("height_m", np.float32),  # over the ground there
        ("var_m2", np.float32),  # of that ground
        ("slope_x", np.float32),
        ("slope_y", np.float32),
        ("age_s", np.float32),  # of what tells that ground
        ("wander_m2", np.float32),  # variance of what the attitude wandered since
        ("near_m", np.float32),  # over the ground before it on its own beam,
        ("near_var_m2", np.float32),  # and the variance of that
        ("noise_m2", np.float32),  # of its own height
        ("off_m", np.float32),  # by how much its beam lies over what `witness` tells,
        ("witness_ahead_m", np.float32),  # and where, in the robot's frame
        ("witness_aside_m", np.float32),
        ("at", np.int32),  # flat index of its cell; -1: no return, or outside
        ("witness", np.int32),  # cell that tells how far the sweep is off; -1: none
        ("kind", np.int8),
        ("tied", np.int8),  # what that ground is
        ("is_face", np.int8),  # the sweep climbs it sideways steeper than ground can be
        ("is_lone", np.int8),  # no return beside it
        ("is_before", np.int8),  # whether ground nearer to the robot was measured
    ],
    align=True,
)
NONE, FLOOR, ABOVE, BELOW, HIGH = 0, 1, 2, 3, 4  # what a return is


class Stand(NamedTuple):
    """Where and how the robot stands at a sweep: on which plane."""

    x_m: float
    y_m: float
    z_m: float
    slope_x: float
    slope_y: float
    heading_x: float
    heading_y: float
    t_s: float
    travel_m: float


class Beams(NamedTuple):
    """A sweep's beams, as kernels are given them."""

    lenses: F64  # (n, 3)
    rays: F64  # (n, 3)
    ranges_m: F64  # (echoes, n)
    returns: Records  # (n,) of RETURN
    lens_m2: float  # variance of the height of the lens


class Sway:
    """The plane on which the robot stands, `slopes` along map x and y; how it sways about that.

    arm_m: lever by which a wheel that lifts the lens tips the body: from the axle to the lens.
    """

    def __init__(self, arm_m: float) -> None:
        self.slopes, self._off, self._arm_m = (math.nan, math.nan), 0.0, arm_m
        self.stand: Stand | None = None  # at the newest sweep

    def follow(self, passed_s: float, slopes: tuple[float, float]) -> float:
        """The body's own slopes now; variance of the height of the lens by what it sways over."""
        share = 1.0 - math.exp(-passed_s / ALIKE_S)
        (ax, ay), (bx, by) = self.slopes, slopes
        if math.isnan(ax):
            ax, ay = bx, by
        self.slopes = (ax + share * (bx - ax), ay + share * (by - ay))
        off = math.hypot(bx - self.slopes[0], by - self.slopes[1])
        self._off = max(off, (1.0 - share) * self._off)
        return FLAT_M**2 + (self._arm_m * self._off) ** 2


@kernel
def noise_m2(r: float, fall: float, lens_m2: float) -> float:
    """Variance of a return's height: range along the beam, attitude across it, the lens."""
    across = SIGMA_ANGLE_RAD * r
    return (SIGMA_RANGE_M * fall) ** 2 + across * across * (1.0 - fall * fall) + lens_m2


@kernel
def in_body(x: float, y: float, stand: Stand) -> tuple[float, float]:
    """How far a point lies ahead and aside of the robot."""
    dx, dy = x - stand.x_m, y - stand.y_m
    hx, hy = stand.heading_x, stand.heading_y
    return dx * hx + dy * hy, dy * hx - dx * hy


@kernel
def set_upright(z: float, ahead: float, aside: float, stand: Stand, own: F64) -> float:
    """A height without the sweep's error, as far as that is known."""
    fast = own[0] + own[1] * ahead + own[2] * aside
    return float(z - fast - own[3] * (ahead + stand.travel_m) - own[4] * aside)


@kernel
def upright_line(lens: F64, ray: F64, stand: Stand, own: F64) -> tuple[float, float]:
    """The same along a beam: the height of its lens, and by how much it rises a metre."""
    ahead, aside = in_body(lens[0], lens[1], stand)
    goes_ahead = ray[0] * stand.heading_x + ray[1] * stand.heading_y
    goes_aside = ray[1] * stand.heading_x - ray[0] * stand.heading_y
    rise = ray[2] - (own[1] + own[3]) * goes_ahead - (own[2] + own[4]) * goes_aside
    return set_upright(lens[2], ahead, aside, stand, own), rise


@kernel
def _plane_of(cell: Record, z: float, var: float, is_before: bool) -> Plane:
    """Ground that has the slopes, the age and the ties of a cell."""
    a, b, tied = real(cell.slope_x), real(cell.slope_y), whole(cell.tied)
    return Plane(z, a, b, var, cell.floor_s, tied, is_before)


@kernel
def _find(x: float, y: float, ray: F64, side: float, far_m: float, surface: Surface) -> Plane:
    """Ground extended to a point of a beam from the nearest seen before (-1) or behind it (1)."""
    away, cell_m = THING_M, surface.cell_m
    while away < far_m:
        bx, by = x + side * away * ray[0], y + side * away * ray[1]
        at = cell_at(bx, by, surface)
        if at >= 0 and surface.cells[at].looks > 0:
            cell = surface.cells[at]
            kept = 1.0 / (1.0 + away / CARRY_M)
            a, b = kept * cell.slope_x, kept * cell.slope_y
            dx = x - bx + from_centre(bx, cell_m)
            dy = y - by + from_centre(by, cell_m)
            var = grown(cell.var_m2, math.sqrt(dx * dx + dy * dy))
            z = ground_of(cell, surface.own) + a * dx + b * dy
            return _plane_of(cell, z, var, side < 0.0)
        away += THING_M
    return NOWHERE


@kernel
def reach(x: float, y: float, r: float, ray: F64, stand: Stand, surface: Surface) -> Plane:
    """Ground at a point of a beam, r away, by what was seen towards the robot, or its wheels."""
    plane = _find(x, y, ray, -1.0, r, surface)
    if plane.var_m2 < math.inf:
        return plane
    dx, dy = x - stand.x_m, y - stand.y_m
    z = stand.z_m + stand.slope_x * dx + stand.slope_y * dy
    var = (0.5 * STEEP) ** 2 * (dx * dx + dy * dy)
    return Plane(z, stand.slope_x, stand.slope_y, var, stand.t_s, TIED, False)


@kernel
def _ground_at(at: int, i: int, j: int, stand: Stand, surface: Surface) -> Plane:
    """Ground at the centre of a cell, measured or by its neighbours."""
    cell = surface.cells[at]
    if cell.looks == 0:
        return plane_at(i, j, stand.x_m, stand.y_m, surface)
    return _plane_of(cell, ground_of(cell, surface.own), real(cell.var_m2), True)


@kernel
def _between(near: Plane, far: Plane) -> Plane:
    """Ground where none is measured around: between that before and that behind, by variances."""
    if far.var_m2 == math.inf:
        return near
    share = near.var_m2 / (near.var_m2 + far.var_m2)
    z, tied = near.z_m + share * (far.z_m - near.z_m), near.tied if far.tied == near.tied else LOOSE
    var, is_before = share * far.var_m2, near.is_before
    return Plane(z, near.slope_x, near.slope_y, var, near.seen_s, tied, is_before)


@kernel
def hold(beams: Beams, stand: Stand, h_pos_m: float, surface: Surface) -> int:
    """Each first return against the ground where it lies, into its RETURN; how many there are."""
    last, count, cell_m, plane, near = -2, 0, surface.cell_m, NOWHERE, NOWHERE
    surface.scan[0] += 1
    for b in range(beams.returns.size):
        one, r = beams.returns[b], beams.ranges_m[0, b]
        one.at, one.kind = -1, NONE
        if not r >= MIN_RANGE_M:
            continue
        count += 1
        lens, ray = beams.lenses[b], beams.rays[b]
        x, y = lens[0] + r * ray[0], lens[1] + r * ray[1]
        i, j = math.floor(x / cell_m), math.floor(y / cell_m)
        at = index_of(i, j, surface)
        one.x_m, one.y_m, one.at = x, y, at
        one.noise_m2 = noise_m2(r, ray[2], beams.lens_m2)
        one.ahead_m, one.aside_m = in_body(x, y, stand)
        z = set_upright(lens[2] + r * ray[2], one.ahead_m, one.aside_m, stand, surface.own)
        one.z_m = z
        if at < 0:
            continue
        cx, cy = x - (i + 0.5) * cell_m, y - (j + 0.5) * cell_m
        one.from_x, one.from_y = cx, cy
        if at != last:  # what is due in a cell, at its centre
            last, plane = at, _ground_at(at, i, j, stand, surface)
            near, is_known = plane, plane.var_m2 < math.inf
            if surface.cells[at].looks == 0 and not (is_known and z > plane.z_m + h_pos_m):
                near = reach(x - cx, y - cy, r, ray, stand, surface)
            if not is_known:
                plane = _between(near, _find(x - cx, y - cy, ray, 1.0, GAP_M, surface))
        one.slope_x, one.slope_y, one.var_m2 = plane.slope_x, plane.slope_y, plane.var_m2
        one.is_before, one.tied = plane.is_before, plane.tied
        one.height_m = z - plane.z_m - plane.slope_x * cx - plane.slope_y * cy
        one.age_s = stand.t_s - plane.seen_s
        one.near_m = z - near.z_m - near.slope_x * cx - near.slope_y * cy
        one.near_var_m2 = near.var_m2
    return count


@kernel
def _is_near(one: Record, other: Record) -> bool:
    """Whether two returns may be of one thing."""
    dx, dy = other.x_m - one.x_m, other.y_m - one.y_m
    return bool(other.at >= 0 and dx * dx + dy * dy < THING_M * THING_M)


@kernel
def find_faces(returns: Records) -> None:
    """Which returns lie on what rises to the side, too steeply for ground.

    A sweep meets level ground along a line across the way: one that climbs, or falls, while it
    hardly goes aside runs along a wall.
    """
    n = returns.size
    for b in range(n):
        returns[b].is_face = 0
        before, after = returns[max(0, b - 1)], returns[min(n - 1, b + 1)]
        beside = (b > 0 and _is_near(returns[b], before)) or (
            b < n - 1 and _is_near(returns[b], after)
        )
        returns[b].is_lone = not beside
        one, other = returns[max(0, b - BESIDE)], returns[min(n - 1, b + BESIDE)]
        if returns[b].at < 0 or one.at < 0 or other.at < 0:
            continue
        rise, aside = abs(other.z_m - one.z_m), abs(other.aside_m - one.aside_m)
        doubt = GATE * math.sqrt(one.noise_m2 + other.noise_m2)
        returns[b].is_face = rise - doubt > STEEPEST * aside


@kernel
def find_witnesses(beams: Beams, stand: Stand, surface: Surface) -> None:
    """Where each beam meets ground that is known, and beyond which floor was seen as well.

    The front of what is mapped tells nothing of the sweep. A beam that ends below the ground has
    passed under such ground before.
    """
    cells, cell_m, own = surface.cells, surface.cell_m, surface.own
    for b in range(beams.returns.size):
        one, lens, ray = beams.returns[b], beams.lenses[b], beams.rays[b]
        one.witness = -1
        if one.at < 0:
            continue
        r, step = beams.ranges_m[0, b], cell_m / math.hypot(ray[0], ray[1])
        for k in range(1 + REACH):
            x, y = lens[0] + r * ray[0], lens[1] + r * ray[1]
            at = cell_at(x, y, surface)
            if at >= 0 and cells[at].looks > 0 and cells[at].stands <= KNOWN:
                cell = cells[at]
                ahead, aside = in_body(x, y, stand)
                off = set_upright(lens[2] + r * ray[2], ahead, aside, stand, own)
                off -= ground_of(cell, own)
                off -= cell.slope_x * from_centre(x, cell_m) + cell.slope_y * from_centre(y, cell_m)
                if k > 0 and off >= 0.0:
                    break  # it passes over it
                one.witness, one.off_m = at, off
                one.witness_ahead_m, one.witness_aside_m = ahead, aside
                break
            if one.height_m >= 0.0:
                break
            r -= step


@kernel
def _agreed(unsure: int, bins: F64) -> float:
    """The bin about which enough of the unsure returns agree; inf: none."""
    best, most = 0, 0.0
    for k in range(BINS - WIDE):
        total = 0.0
        for m in range(WIDE):
            total += bins[k + m]
        if total > most:
            best, most = k, total
    return best + 0.5 * WIDE if most >= WITNESSES and most >= SHARE * unsure else math.inf


@kernel
def agree(returns: Records, tied: int, limits: Limits, bins: F64) -> None:
    """Where ground is a guess for most returns, those are floor of which most lie at one height."""
    unsure, sure, guessed, edge = 0, 0, 0, 0.5 * limits.h_pos_m / WIDE
    bins[:] = 0.0
    for b in range(returns.size):
        one = returns[b]
        if one.at < 0:
            continue
        if one.var_m2 <= limits.guess_m2:
            sure += 1
            continue
        guessed += 1
        k = math.floor(one.height_m / edge) + BINS // 2
        if 0 <= k < BINS and one.height_m**2 < HIT * HIT * one.var_m2:
            unsure += 1
            bins[k] += 1.0
    if sure >= RARE * (sure + guessed):
        return
    agreed = _agreed(unsure, bins)
    if agreed == math.inf:
        return
    offset = (agreed - BINS // 2) * edge
    for b in range(returns.size):
        one = returns[b]
        if one.at >= 0 and one.var_m2 > limits.guess_m2:
            one.height_m -= offset
            one.near_m -= offset
            one.var_m2 = one.near_var_m2 = (0.25 * WIDE * edge) ** 2
            one.tied = tied
