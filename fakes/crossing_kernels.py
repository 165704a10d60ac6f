"""Where rays meet boxes, cylinders and convex bodies, standing or moving: kernels.

A ray is tried against what its beam can meet alone, by the spans that `fakes.ray_kernels` finds.
"""

import math

from fakes.ray_kernels import (
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
    kernel,
    rows_of,
)

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
def _meet_other(
    pencil: Pencil, row: int, targets: Targets, j: int, glass_cos: float, far_m: float,
    found: F64, met: I64,
) -> None:  # fmt: skip
    """The same with one ray and a target of any kind."""
    low, high = targets.lows[j], targets.highs[j]
    x, y, z = pencil.begins[0, row], pencil.begins[1, row], pencil.begins[2, row]
    over_z = pencil.inverses[2, row]
    enter, leave = across_slab(x, pencil.inverses[0, row], low[0], high[0], -math.inf, math.inf)
    enter, leave = across_slab(y, pencil.inverses[1, row], low[1], high[1], enter, leave)
    enter, leave = across_slab(z, over_z, low[2], high[2], enter, leave)
    if enter >= leave or leave <= 0.0 or enter >= min(found[row], far_m):
        return
    way_x, way_y, way_z = pencil.ways[0, row], pencil.ways[1, row], pencil.ways[2, row]
    if targets.kinds[j] == HULL:
        first, end = targets.first_planes[j], targets.first_planes[j + 1]
        enter, leave = across_hull(pencil, row, targets.planes, first, end)
    elif targets.kinds[j] == CYLINDER:
        off_x, off_y = x - (low[0] + high[0]) / 2, y - (low[1] + high[1]) / 2
        enter, leave = across_disc(off_x, off_y, way_x, way_y, (high[0] - low[0]) / 2)
        enter, leave = across_slab(z, over_z, low[2], high[2], enter, leave)
    near = enter if enter > 0.0 else leave
    if enter >= leave or leave <= 0.0 or near >= found[row] or near > far_m:
        return
    if targets.materials[j] == GLASS:
        at_x, at_y, at_z = x + near * way_x, y + near * way_y, z + near * way_z
        if cosine_at(at_x, at_y, at_z, way_x, way_y, way_z, low, high) <= glass_cos:
            return
    found[row], met[row] = near, j


@kernel
def meet_targets(
    pencil: Pencil, spans: I64, targets: Targets, glass_cos: float, far_m: float,
    found: F64, met: I64,
) -> None:  # fmt: skip
    """Bring `found` (r,) and `met` (r,) to what each ray meets first, within far_m.

    Glass, always a box, is met only by rays with a greater cosine to its normal than `glass_cos`.

    Args:
        spans: (m, 3, 2) of `spans_of_targets`.
    """
    for j in range(len(targets.kinds)):
        is_easy = targets.kinds[j] == BOX and targets.materials[j] != GLASS
        for turn in range(3):
            first, end = rows_of(pencil, spans[j, turn])
            if is_easy and end > first:
                low, high = targets.lows[j], targets.highs[j]
                _meet_box(pencil, first, end, low, high, far_m, j, found, met)
            elif end > first:
                for row in range(first, end):
                    _meet_other(pencil, row, targets, j, glass_cos, far_m, found, met)


@kernel
def meet_passers(
    pencil: Pencil, spans: I64, times_s: F64, passers: Passers, found: F64, met: I64
) -> None:
    """The same with what moves, each beam at its own instant; `met` becomes -1 there.

    Args:
        spans: (m, 3, 2) of `spans_of_passers`. times_s: (n,) of all beams of the sweep.
    """
    for j in range(len(passers.radii_m)):
        for turn in range(3):
            first, end = rows_of(pencil, spans[j, turn])
            for i in range(first // pencil.subs, end // pencil.subs):
                at_s = times_s[pencil.first + i]
                if passers.stays_s[j, 0] <= at_s < passers.stays_s[j, 1]:
                    _meet_passer(pencil, i, at_s, passers, j, found, met)


@kernel
def _meet_passer(
    pencil: Pencil, i: int, at_s: float, passers: Passers, j: int, found: F64, met: I64
) -> None:
    """The rays of beam i of a pencil, and passer j where it is at an instant."""
    places, known = passers.middles_m[:, j], len(passers.middles_m)
    knot = min(max(0.0, (at_s - passers.first_s) / passers.every_s), known - 1.0)
    k = min(int(knot), max(0, known - 2))
    share, after = knot - k, min(k + 1, known - 1)
    middle_x = (1.0 - share) * places[k, 0] + share * places[after, 0]
    middle_y = (1.0 - share) * places[k, 1] + share * places[after, 1]
    radius, half_x, half_y = passers.radii_m[j], passers.halves_m[j, 0], passers.halves_m[j, 1]
    for row in range(i * pencil.subs, (i + 1) * pencil.subs):
        x, y = pencil.begins[0, row] - middle_x, pencil.begins[1, row] - middle_y
        z, over_z = pencil.begins[2, row], pencil.inverses[2, row]
        low, high = passers.spans_m[j, 0], passers.spans_m[j, 1]
        enter, leave = across_slab(z, over_z, low, high, 0.0, found[row])
        if radius > 0.0:
            near, far = across_disc(x, y, pencil.ways[0, row], pencil.ways[1, row], radius)
            enter, leave = max(enter, near), min(leave, far)
        else:
            enter, leave = across_slab(x, pencil.inverses[0, row], -half_x, half_x, enter, leave)
            enter, leave = across_slab(y, pencil.inverses[1, row], -half_y, half_y, enter, leave)
        if enter < leave and enter < found[row]:
            found[row], met[row] = enter, -1


@kernel
def ways_through_box(begins: F64, ways: F64, low: F64, high: F64, enters: F64, leaves: F64) -> None:
    """Where rays (n, 3) enter (n,), 0 from inside, and leave (n,) a box; else inf."""
    enters[:], leaves[:] = math.inf, math.inf
    for i in range(len(ways)):
        enter, leave = 0.0, math.inf
        for axis in range(3):
            way = ways[i, axis]
            inverse = 1.0 / (way if abs(way) >= TINY else TINY)
            enter, leave = across_slab(
                begins[i, axis], inverse, low[axis], high[axis], enter, leave
            )
        if enter < leave:
            enters[i], leaves[i] = enter, leave
