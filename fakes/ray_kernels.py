"""Kernels of the rays: where beams meet boxes, cylinders, convex bodies, each from its own begin.

Each target is tried only by beams whose azimuth lies within what it covers of the horizon. A beam
may be a bundle of `subs` rays that share an azimuth but for a little: the beam's width.
"""

import math
from collections.abc import Callable
from typing import NamedTuple, ParamSpec, TypeVar, cast

import numba
import numpy as np
import numpy.typing as npt

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]
BOX, CYLINDER, HULL = 0, 1, 2
PLAIN, BLACK, GLASS = 0, 1, 2
TINY = 1e-12  # instead of a zero that something is divided by
TURN_RAD = 2.0 * math.pi
SLACK_RAD = 1e-6  # by which a target covers more of the horizon than its corners say
P = ParamSpec("P")
R = TypeVar("R")


def kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile with Numba to machine code, kept on disk beside the source; no fast-math."""
    return cast(Callable[P, R], numba.njit(cache=True)(function))


class Targets(NamedTuple):
    """What stands still, m of them; map frame, metres."""

    kinds: I64  # (m,) BOX, CYLINDER, HULL
    lows: F64  # (m, 3) lowest corner of the upright box around each,
    highs: F64  # (m, 3) and its highest
    first_planes: I64  # (m + 1,) of a HULL, within `planes`; the next one's where it ends
    planes: F64  # (p, 4) of all: outward normal, and how far along it the plane lies
    materials: I64  # (m,) PLAIN, BLACK, GLASS


class Passers(NamedTuple):
    """Upright parts of what moves, m of them: where they are is known at k instants of a sweep."""

    first_s: float  # of these instants,
    every_s: float  # and how far they are apart
    middles_m: F64  # (k, m, 2)
    radii_m: F64  # (m,); a box has 0
    halves_m: F64  # (m, 2) of a box
    spans_m: F64  # (m, 2) from which height to which
    stays_s: F64  # (m, 2) from when until when it is there


class Bundle(NamedTuple):
    """Rays of n beams, `subs` of them for each, one after the other; map frame."""

    begins: F64  # (n * subs, 3) m
    ways: F64  # (n * subs, 3) of unit length
    inverses: F64  # (n * subs, 3) one over these, never endless
    azimuths: F64  # (n,) of each beam's first ray, without jumps; growing if `in_order`
    spread_rad: float  # by which the others of a beam may be beside it
    in_order: bool
    room: tuple[tuple[float, float], tuple[float, float]]  # x, y between which all begin


@kernel
def rays_from_poses(
    t_map_lens: F64, R_map_lens: F64, bearings: F64, pattern: F64
) -> tuple[F64, F64]:
    """Begins and directions (n * subs, 3) of beams, each from the lens's pose at its own instant.

    Args:
        t_map_lens, R_map_lens: (n, 3), (n, 3, 3).
        bearings: (n,) rad in the scan plane.
        pattern: (subs, 4) of the rays in a beam: how far it begins aside and above, m; the
            tangents of how far it is turned aside and up.
    """
    n, subs = len(bearings), len(pattern)
    begins, ways = np.empty((n * subs, 3)), np.empty((n * subs, 3))
    ahead, aside, up = np.empty(3), np.empty(3), np.empty(3)
    for i in range(n):
        c, s = math.cos(bearings[i]), math.sin(bearings[i])
        for axis in range(3):
            ahead[axis] = R_map_lens[i, axis, 0] * c + R_map_lens[i, axis, 1] * s
            aside[axis] = R_map_lens[i, axis, 1] * c - R_map_lens[i, axis, 0] * s
            up[axis] = R_map_lens[i, axis, 2]
        for sub in range(subs):
            row = i * subs + sub
            right, high = pattern[sub, 0], pattern[sub, 1]
            right_way, high_way = pattern[sub, 2], pattern[sub, 3]
            for axis in range(3):
                begins[row, axis] = t_map_lens[i, axis] + right * aside[axis] + high * up[axis]
            x = ahead[0] + right_way * aside[0] + high_way * up[0]
            y = ahead[1] + right_way * aside[1] + high_way * up[1]
            z = ahead[2] + right_way * aside[2] + high_way * up[2]
            scale = 1.0 / math.sqrt(x * x + y * y + z * z)
            ways[row, 0], ways[row, 1], ways[row, 2] = x * scale, y * scale, z * scale
    return begins, ways


@kernel
def bundle_from(begins: F64, ways: F64, subs: int, spread_rad: float) -> Bundle:
    """Rays (n * subs, 3) with what is to be known of all of them."""
    n, in_order = len(ways) // subs, True
    azimuths = np.empty(n)
    for i in range(n):
        azimuth = math.atan2(ways[i * subs, 1], ways[i * subs, 0])
        if i > 0:
            before = azimuths[i - 1]
            azimuth += TURN_RAD * round((before - azimuth) / TURN_RAD)
            in_order = in_order and azimuth > before
        azimuths[i] = azimuth
    x0, y0, x1, y1 = math.inf, math.inf, -math.inf, -math.inf
    for row in range(len(begins)):
        x, y = begins[row, 0], begins[row, 1]
        x0, y0, x1, y1 = min(x0, x), min(y0, y), max(x1, x), max(y1, y)
    inverses = np.empty_like(ways)
    from_flat, to_flat = ways.reshape(-1), inverses.reshape(-1)
    for k in range(len(from_flat)):  # in one row, so that many are divided at once
        way = from_flat[k]
        to_flat[k] = 1.0 / (way if abs(way) >= TINY else TINY)
    return Bundle(begins, ways, inverses, azimuths, spread_rad, in_order, ((x0, y0), (x1, y1)))


@kernel
def _covered(low_x: float, high_x: float, low_y: float, high_y: float) -> tuple[float, float]:
    """Least and greatest azimuth that a rectangle covers, seen from (0, 0); a turn from within."""
    if low_x <= 0.0 <= high_x and low_y <= 0.0 <= high_y:
        return -math.pi, math.pi
    middle = math.atan2((low_y + high_y) / 2, (low_x + high_x) / 2)
    least, most = middle, middle
    for x in (low_x, high_x):
        for y in (low_y, high_y):
            away = math.atan2(y, x) - middle
            away -= TURN_RAD * round(away / TURN_RAD)
            least, most = min(least, middle + away), max(most, middle + away)
    return least, most


@kernel
def _range_of(azimuths: F64, least: float, most: float) -> tuple[int, int]:
    """The first beam in least..most and the one after the last."""
    first = np.searchsorted(azimuths, least)
    return int(first), int(np.searchsorted(azimuths, most, side="right"))


@kernel
def spans_of_beams(bundle: Bundle, low: F64, high: F64, spans: I64) -> int:
    """Which beams can meet what lies in a box; how many spans of them, at most 3.

    Args:
        low, high: (3,) corners; heights don't matter.
        spans: (3, 2) takes the first beam of each span and the one after its last.
    """
    n = len(bundle.azimuths)
    if not bundle.in_order:
        spans[0, 0], spans[0, 1] = 0, n
        return 1
    (x0, y0), (x1, y1) = bundle.room
    least, most = _covered(low[0] - x1, high[0] - x0, low[1] - y1, high[1] - y0)
    if most - least >= TURN_RAD:
        spans[0, 0], spans[0, 1] = 0, n
        return 1
    wider = bundle.spread_rad + SLACK_RAD
    base = TURN_RAD * round((bundle.azimuths[n // 2] - (least + most) / 2) / TURN_RAD)
    count = 0
    for turn in (-TURN_RAD, 0.0, TURN_RAD):
        first, end = _range_of(
            bundle.azimuths, least + base + turn - wider, most + base + turn + wider
        )
        if end > first:
            spans[count, 0], spans[count, 1] = first, end
            count += 1
    return count


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
def across_hull(
    begins: F64, ways: F64, row: int, planes: F64, first: int, end: int
) -> tuple[float, float]:
    """The part behind all of the planes first..end of planes (p, 4), of a ray of arrays (r, 3)."""
    enter, leave = -math.inf, math.inf
    x, y, z = begins[row, 0], begins[row, 1], begins[row, 2]
    way_x, way_y, way_z = ways[row, 0], ways[row, 1], ways[row, 2]
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
def meet_targets(
    bundle: Bundle, targets: Targets, glass_cos: float, far_m: float, found: F64, met: I64
) -> None:
    """Bring `found` (n * subs,) and `met` (n * subs,) to what each ray meets first, within far_m.

    Glass, always a box, is met only by rays with a greater cosine to its normal than `glass_cos`.
    """
    begins, ways, inverses = bundle.begins, bundle.ways, bundle.inverses
    subs, spans = len(found) // len(bundle.azimuths), np.empty((3, 2), dtype=np.int64)
    for j in range(len(targets.kinds)):
        low, high, kind = targets.lows[j], targets.highs[j], targets.kinds[j]
        first, end = targets.first_planes[j], targets.first_planes[j + 1]
        x0, y0, z0, x1, y1, z1 = low[0], low[1], low[2], high[0], high[1], high[2]
        for span in range(spans_of_beams(bundle, low, high, spans)):
            for row in range(spans[span, 0] * subs, spans[span, 1] * subs):
                x, y, z = begins[row, 0], begins[row, 1], begins[row, 2]
                enter, leave = across_slab(x, inverses[row, 0], x0, x1, -math.inf, math.inf)
                enter, leave = across_slab(y, inverses[row, 1], y0, y1, enter, leave)
                enter, leave = across_slab(z, inverses[row, 2], z0, z1, enter, leave)
                if enter >= leave or leave <= 0.0 or enter >= min(found[row], far_m):
                    continue
                if kind == HULL:
                    enter, leave = across_hull(begins, ways, row, targets.planes, first, end)
                elif kind == CYLINDER:
                    away_x, away_y, radius = x - (x0 + x1) / 2, y - (y0 + y1) / 2, (x1 - x0) / 2
                    near, far = across_disc(away_x, away_y, ways[row, 0], ways[row, 1], radius)
                    near, far = across_slab(z, inverses[row, 2], z0, z1, near, far)
                    enter, leave = near, far
                near = enter if enter > 0.0 else leave
                if enter >= leave or leave <= 0.0 or near >= found[row] or near > far_m:
                    continue
                if targets.materials[j] == GLASS:
                    way_x, way_y, way_z = ways[row, 0], ways[row, 1], ways[row, 2]
                    at_x, at_y, at_z = x + near * way_x, y + near * way_y, z + near * way_z
                    if cosine_at(at_x, at_y, at_z, way_x, way_y, way_z, low, high) <= glass_cos:
                        continue
                found[row], met[row] = near, j


@kernel
def meet_passers(bundle: Bundle, times_s: F64, passers: Passers, found: F64, met: I64) -> None:
    """The same with what moves, each beam at its own instant (n,); `met` becomes -1 there."""
    begins, ways, inverses = bundle.begins, bundle.ways, bundle.inverses
    subs, known = len(found) // len(times_s), len(passers.middles_m)
    spans, low, high = np.empty((3, 2), dtype=np.int64), np.zeros(3), np.zeros(3)
    for j in range(len(passers.radii_m)):
        places, radius = passers.middles_m[:, j], passers.radii_m[j]
        half_x, half_y = max(radius, passers.halves_m[j, 0]), max(radius, passers.halves_m[j, 1])
        low[0], high[0] = places[:, 0].min() - half_x, places[:, 0].max() + half_x
        low[1], high[1] = places[:, 1].min() - half_y, places[:, 1].max() + half_y
        for span in range(spans_of_beams(bundle, low, high, spans)):
            for i in range(spans[span, 0], spans[span, 1]):
                if not passers.stays_s[j, 0] <= times_s[i] < passers.stays_s[j, 1]:
                    continue
                knot = min(max(0.0, (times_s[i] - passers.first_s) / passers.every_s), known - 1.0)
                k = min(int(knot), max(0, known - 2))
                share, after = knot - k, min(k + 1, known - 1)
                middle_x = (1.0 - share) * places[k, 0] + share * places[after, 0]
                middle_y = (1.0 - share) * places[k, 1] + share * places[after, 1]
                for row in range(i * subs, (i + 1) * subs):
                    x, y, z = begins[row, 0] - middle_x, begins[row, 1] - middle_y, begins[row, 2]
                    enter, leave = across_slab(
                        z, inverses[row, 2], passers.spans_m[j, 0], passers.spans_m[j, 1],
                        0.0, found[row],
                    )  # fmt: skip
                    if radius > 0.0:
                        near, far = across_disc(x, y, ways[row, 0], ways[row, 1], radius)
                        enter, leave = max(enter, near), min(leave, far)
                    else:
                        enter, leave = across_slab(
                            x, inverses[row, 0], -half_x, half_x, enter, leave
                        )
                        enter, leave = across_slab(
                            y, inverses[row, 1], -half_y, half_y, enter, leave
                        )
                    if enter < leave and enter < found[row]:
                        found[row], met[row] = enter, -1


@kernel
def ways_through_box(bundle: Bundle, low: F64, high: F64, enters: F64, leaves: F64) -> None:
    """Where the first ray of each beam enters (n,), 0 from inside, and leaves a box; else inf."""
    subs = len(bundle.begins) // len(bundle.azimuths)
    begins, inverses = bundle.begins, bundle.inverses
    spans = np.empty((3, 2), dtype=np.int64)
    enters[:], leaves[:] = math.inf, math.inf
    for span in range(spans_of_beams(bundle, low, high, spans)):
        for i in range(spans[span, 0], spans[span, 1]):
            enter, leave = 0.0, math.inf
            for axis in range(3):
                begin, inverse = begins[i * subs, axis], inverses[i * subs, axis]
                enter, leave = across_slab(begin, inverse, low[axis], high[axis], enter, leave)
            if enter < leave:
                enters[i], leaves[i] = enter, leave
