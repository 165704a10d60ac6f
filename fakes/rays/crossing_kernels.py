"""Where rays meet boxes, cylinders and convex bodies, standing or moving: kernels.

A ray is tried against what its beam can meet alone, by the spans that `fakes.rays.kernels` finds.
"""

import math

import numpy as np

from fakes.rays.kernels import (
    BOX,
    CYLINDER,
    F64,
    GLASS,
    HULL,
    I64,
    TINY,
    Passers,
    Pencil,
    Targets,
)
from jit import allocating_kernel, kernel

# One ray across one body: scalars, which cost a fifth of what rows of arrays do. A ray is its begin
# x, y, z, and one over its direction. Each gives the ways to where it enters, behind its begin
# (below 0) from inside, and to where it leaves, which is not beyond where it misses.


@kernel
def across_slab(
    begin: float, inverse: float, low: float, high: float, enter: float, leave: float
) -> tuple[float, float]:
    """The part of enter..leave between two planes."""
    one, two = (low - begin) * inverse, (high - begin) * inverse
    return max(enter, min(one, two)), min(leave, max(one, two))


@kernel
def across_disc(
    x: float, y: float, way_x: float, way_y: float, radius: float
) -> tuple[float, float]:
    """The part within an endless upright cylinder around (0, 0)."""
    a = max(way_x * way_x + way_y * way_y, TINY)
    b = x * way_x + y * way_y
    inside = b * b - a * (x * x + y * y - radius * radius)
    if inside <= 0.0:
        return math.inf, -math.inf
    half = math.sqrt(inside)
    return (-b - half) / a, (-b + half) / a


@kernel
def across_hull(pencil: Pencil, row: int, planes: F64, first: int, end: int) -> tuple[float, float]:
    """The part behind all of the planes first..end of planes (p, 4), of a ray of a pencil."""
    enter, leave = -math.inf, math.inf
    begins, ways = pencil.begins, pencil.ways
    x, y, z = begins[0, row], begins[1, row], begins[2, row]
    way_x, way_y, way_z = ways[0, row], ways[1, row], ways[2, row]
    for k in range(first, end):
        nx, ny, nz = planes[k, 0], planes[k, 1], planes[k, 2]
        down = nx * way_x + ny * way_y + nz * way_z
        above = nx * x + ny * y + nz * z - planes[k, 3]
        if abs(down) < TINY:
            if above > 0.0:
                return math.inf, -math.inf
        elif down < 0.0:
            enter = max(enter, -above / down)
        else:
            leave = min(leave, -above / down)
    return enter, leave


@kernel
def cosine_at(
    x: float, y: float, z: float, way_x: float, way_y: float, way_z: float,
    low: F64, high: F64,
) -> float:  # fmt: skip
    """Of the angle between a ray and the normal of that side of a box on which a point lies."""
    off_x = min(abs(x - low[0]), abs(x - high[0]))
    off_y = min(abs(y - low[1]), abs(y - high[1]))
    off_z = min(abs(z - low[2]), abs(z - high[2]))
    if off_x <= off_y and off_x <= off_z:
        return abs(way_x)
    return abs(way_y) if off_y <= off_z else abs(way_z)


@kernel
def _meet_box(
    pencil: Pencil, first: int, end: int, low: F64, high: F64, far_m: float, j: int,
    found: F64, met: I64,
) -> None:  # fmt: skip
    """Bring found and met to what the rays first..end meet of a box; without a branch a ray."""
    x, y, z = pencil.begins[0, first:end], pencil.begins[1, first:end], pencil.begins[2, first:end]
    over_x, over_y = pencil.inverses[0, first:end], pencil.inverses[1, first:end]
    over_z, nearest, whose = pencil.inverses[2, first:end], found[first:end], met[first:end]
    x0, y0, z0, x1, y1, z1 = low[0], low[1], low[2], high[0], high[1], high[2]
    for k in range(end - first):
        enter, leave = across_slab(x[k], over_x[k], x0, x1, -math.inf, math.inf)
        enter, leave = across_slab(y[k], over_y[k], y0, y1, enter, leave)
        enter, leave = across_slab(z[k], over_z[k], z0, z1, enter, leave)
        near = enter if enter > 0.0 else leave
        is_met = (enter < leave) & (leave > 0.0) & (near < nearest[k]) & (near <= far_m)
        nearest[k] = near if is_met else nearest[k]
        whose[k] = j if is_met else whose[k]


@kernel
def _list_near(
    pencil: Pencil, first: int, end: int, low: F64, high: F64, far_m: float, found: F64,
    enters: F64, near: I64,
) -> int:  # fmt: skip
    """Put those of the rays first..end that enter a box before what they meet so far into `near`.

    Returns how many they are; enters: (n,), room to work in.
    """
    x, y, z = pencil.begins[0, first:end], pencil.begins[1, first:end], pencil.begins[2, first:end]
    over_x, over_y = pencil.inverses[0, first:end], pencil.inverses[1, first:end]
    over_z, nearest, room = pencil.inverses[2, first:end], found[first:end], enters[first:end]
    x0, y0, z0, x1, y1, z1 = low[0], low[1], low[2], high[0], high[1], high[2]
    for k in range(end - first):  # without a branch, so that many are done at once
        enter, leave = across_slab(x[k], over_x[k], x0, x1, -math.inf, math.inf)
        enter, leave = across_slab(y[k], over_y[k], y0, y1, enter, leave)
        enter, leave = across_slab(z[k], over_z[k], z0, z1, enter, leave)
        room[k] = enter if (enter < leave) & (leave > 0.0) & (enter < far_m) else math.inf
    count = 0
    for k in range(end - first):
        if room[k] < nearest[k]:
            near[count] = first + k
            count += 1
    return count


@kernel
def _meet_other(
    pencil: Pencil, i: int, targets: Targets, j: int, glass_cos: float, far_m: float,
    found: F64, met: I64,
) -> None:  # fmt: skip
    """The same as `_meet_box` with one ray that enters the box around a target of any kind."""
    low, high = targets.lows[j], targets.highs[j]
    x, y, z = pencil.begins[0, i], pencil.begins[1, i], pencil.begins[2, i]
    over_z = pencil.inverses[2, i]
    way_x, way_y, way_z = pencil.ways[0, i], pencil.ways[1, i], pencil.ways[2, i]
    if targets.kinds[j] == HULL:
        first, end = targets.first_planes[j], targets.first_planes[j + 1]
        enter, leave = across_hull(pencil, i, targets.planes, first, end)
    elif targets.kinds[j] == CYLINDER:
        off_x, off_y = x - (low[0] + high[0]) / 2, y - (low[1] + high[1]) / 2
        enter, leave = across_disc(off_x, off_y, way_x, way_y, (high[0] - low[0]) / 2)
        enter, leave = across_slab(z, over_z, low[2], high[2], enter, leave)
    else:
        enter, leave = across_slab(x, pencil.inverses[0, i], low[0], high[0], -math.inf, math.inf)
        enter, leave = across_slab(y, pencil.inverses[1, i], low[1], high[1], enter, leave)
        enter, leave = across_slab(z, over_z, low[2], high[2], enter, leave)
    near = enter if enter > 0.0 else leave
    if enter >= leave or leave <= 0.0 or near >= found[i] or near > far_m:
        return
    if targets.materials[j] == GLASS:
        at_x, at_y, at_z = x + near * way_x, y + near * way_y, z + near * way_z
        if cosine_at(at_x, at_y, at_z, way_x, way_y, way_z, low, high) <= glass_cos:
            return
    found[i], met[i] = near, j


@allocating_kernel
def meet_targets(
    pencil: Pencil, spans: I64, targets: Targets, glass_cos: float, far_m: float,
    found: F64, met: I64,
) -> None:  # fmt: skip
    """Bring `found` (n,) and `met` (n,) to what each ray meets first, within far_m.

    Glass, always a box, is met only by rays with a greater cosine to its normal than `glass_cos`.

    Args:
        spans: (m, 3, 2) of `spans_of_targets`.
    """
    enters, listed = np.empty(len(found)), np.empty(len(found), dtype=np.int64)
    for j in range(len(targets.kinds)):
        low, high = targets.lows[j], targets.highs[j]
        is_easy = targets.kinds[j] == BOX and targets.materials[j] != GLASS
        for turn in range(3):
            first, end = spans[j, turn, 0], spans[j, turn, 1]
            if is_easy and end > first:
                _meet_box(pencil, first, end, low, high, far_m, j, found, met)
            elif end > first:
                count = _list_near(pencil, first, end, low, high, far_m, found, enters, listed)
                for i in listed[:count]:
                    _meet_other(pencil, i, targets, j, glass_cos, far_m, found, met)


@kernel
def _meet_passer(
    pencil: Pencil, i: int, at_s: float, passers: Passers, j: int, found: F64, met: I64
) -> None:
    """Ray i, and passer j where it is at an instant."""
    places, known = passers.middles_m[:, j], len(passers.middles_m)
    knot = min(max(0.0, (at_s - passers.first_s) / passers.every_s), known - 1.0)
    k = min(int(knot), max(0, known - 2))
    share, after = knot - k, min(k + 1, known - 1)
    x = pencil.begins[0, i] - ((1.0 - share) * places[k, 0] + share * places[after, 0])
    y = pencil.begins[1, i] - ((1.0 - share) * places[k, 1] + share * places[after, 1])
    radius, half_x, half_y = passers.radii_m[j], passers.halves_m[j, 0], passers.halves_m[j, 1]
    low, high = passers.spans_m[j, 0], passers.spans_m[j, 1]
    enter, leave = across_slab(pencil.begins[2, i], pencil.inverses[2, i], low, high, 0.0, found[i])
    if radius > 0.0:
        near, far = across_disc(x, y, pencil.ways[0, i], pencil.ways[1, i], radius)
        enter, leave = max(enter, near), min(leave, far)
    else:
        enter, leave = across_slab(x, pencil.inverses[0, i], -half_x, half_x, enter, leave)
        enter, leave = across_slab(y, pencil.inverses[1, i], -half_y, half_y, enter, leave)
    if enter < leave and enter < found[i]:
        found[i], met[i] = enter, -1


@kernel
def meet_passers(
    pencil: Pencil, spans: I64, times_s: F64, passers: Passers, found: F64, met: I64
) -> None:
    """The same with what moves, each beam at its own instant; `met` becomes -1 there.

    Args:
        spans: (m, 3, 2) of `spans_of_passers`. times_s: (n,).
    """
    for j in range(len(passers.radii_m)):
        for turn in range(3):
            for i in range(spans[j, turn, 0], spans[j, turn, 1]):
                if passers.stays_s[j, 0] <= times_s[i] < passers.stays_s[j, 1]:
                    _meet_passer(pencil, i, times_s[i], passers, j, found, met)


@kernel
def ways_through_box(begins: F64, ways: F64, low: F64, high: F64, enters: F64, leaves: F64) -> None:
    """Where rays (3, n) enter (n,), 0 from inside, and leave (n,) a box; else inf."""
    enters[:], leaves[:] = math.inf, math.inf
    for i in range(len(enters)):
        enter, leave = 0.0, math.inf
        for axis in range(3):
            way = ways[axis, i]
            inverse = 1.0 / (way if abs(way) >= TINY else TINY)
            enter, leave = across_slab(
                begins[axis, i], inverse, low[axis], high[axis], enter, leave
            )
        if enter < leave:
            enters[i], leaves[i] = enter, leave
