"""One sweep in one kernel: beams from the lens's poses to what they meet, and to their echoes."""

import math
from typing import NamedTuple

import numpy as np

from fakes.rays.crossing_kernels import meet_passers, meet_targets
from fakes.rays.kernels import (
    BLACK,
    F64,
    TURN_RAD,
    Horizon,
    Passers,
    Pencil,
    Targets,
    invert,
    spans_of_passers,
    spans_of_targets,
)
from jit import allocating_kernel, kernel

Vector = tuple[float, float, float]
FAR_M = 30.0  # a beam returns nothing from beyond
BLACK_REACH_M = 3.0  # nor from what is black, beyond this
MIDDLE_WEIGHT = 0.28  # of a beam's light; the ring around its middle shares the rest
PULSE_M = 0.5  # surfaces that lie nearer behind each other are one echo


class Beams(NamedTuple):
    """A sweep, each beam at its own instant; map frame."""

    t_map_body: F64  # (n, 3) where the body is,
    R_map_body: F64  # (n, 3, 3) and how it is turned
    lens: F64  # (3,) in the body,
    R_body_lens: F64  # (3, 3) and how it is turned
    bearings: F64  # (n,) rad in the scan plane, from straight ahead, counter-clockwise
    pattern: F64  # (subs, 4) of a beam's rays, its middle first: how far each begins aside and
    # above, m; the tangents of how far it is turned aside and up
    spread_rad: float  # by which rays of a beam may be beside its middle


@kernel
def _turned(R: F64, x: float, y: float, z: float) -> Vector:
    """A vector after a turn (3, 3)."""
    return (
        R[0, 0] * x + R[0, 1] * y + R[0, 2] * z,
        R[1, 0] * x + R[1, 1] * y + R[1, 2] * z,
        R[2, 0] * x + R[2, 1] * y + R[2, 2] * z,
    )


@kernel
def _begin_of(beams: Beams, i: int) -> Vector:
    """Where the middle of beam i begins."""
    place, (x, y, z) = beams.t_map_body[i], beams.lens
    dx, dy, dz = _turned(beams.R_map_body[i], x, y, z)
    return place[0] + dx, place[1] + dy, place[2] + dz


@kernel
def _way_of(beams: Beams, i: int, x: float, y: float, z: float) -> Vector:
    """A vector in the lens's axes as beam i has it, in the map's."""
    x, y, z = _turned(beams.R_body_lens, x, y, z)
    return _turned(beams.R_map_body[i], x, y, z)


@allocating_kernel
def aims_of(beams: Beams) -> F64:
    """Where the beams begin, and their ways ahead, aside and up of unit length: (4, 3, n)."""
    n = len(beams.bearings)
    aims = np.empty((4, 3, n))
    for i in range(n):
        c, s = math.cos(beams.bearings[i]), math.sin(beams.bearings[i])
        aims[0, 0, i], aims[0, 1, i], aims[0, 2, i] = _begin_of(beams, i)
        aims[1, 0, i], aims[1, 1, i], aims[1, 2, i] = _way_of(beams, i, c, s, 0.0)
        aims[2, 0, i], aims[2, 1, i], aims[2, 2, i] = _way_of(beams, i, -s, c, 0.0)
        aims[3, 0, i], aims[3, 1, i], aims[3, 2, i] = _way_of(beams, i, 0.0, 0.0, 1.0)
    return aims


@allocating_kernel
def horizon_of(beams: Beams, aims: F64) -> Horizon:
    """Where the beams look."""
    aside_m = 0.0
    for sub in range(len(beams.pattern)):
        aside_m = max(aside_m, abs(beams.pattern[sub, 0]) + abs(beams.pattern[sub, 1]))
    begins, ways = aims[0], aims[1]
    n, in_order = ways.shape[1], True
    azimuths = np.empty(n)
    x0, y0, x1, y1 = math.inf, math.inf, -math.inf, -math.inf
    for i in range(n):
        azimuth = math.atan2(ways[1, i], ways[0, i])
        if i > 0:
            before = azimuths[i - 1]
            azimuth += TURN_RAD * round((before - azimuth) / TURN_RAD)
            in_order = in_order and azimuth > before
        azimuths[i] = azimuth
        x, y = begins[0, i], begins[1, i]
        x0, y0, x1, y1 = min(x0, x), min(y0, y), max(x1, x), max(y1, y)
    room = ((x0 - aside_m, y0 - aside_m), (x1 + aside_m, y1 + aside_m))
    return Horizon(azimuths, in_order, room, beams.spread_rad)


@kernel
def _put_in(aims: F64, offsets: F64, pencil: Pencil) -> None:
    """Into a pencil, that ray of each beam which has these offsets (4,) of a pattern."""
    right, high, right_way, high_way = offsets
    length = math.hypot(1.0, math.hypot(right_way, high_way))
    for axis in range(3):
        begin, ahead, aside, up = aims[0, axis], aims[1, axis], aims[2, axis], aims[3, axis]
        begins, ways = pencil.begins[axis], pencil.ways[axis]
        for i in range(len(begin)):
            begins[i] = begin[i] + (right * aside[i] + high * up[i])
        for i in range(len(begin)):
            ways[i] = (ahead[i] + right_way * aside[i] + high_way * up[i]) / length
    invert(pencil)


@allocating_kernel
def echoes_from_rays(ranges_m: F64, mixes: bool) -> F64:
    """First and second echo (2, n) of beams of rays (subs, n); inf where nothing is.

    Surfaces of one beam that follow each other by less than a pulse are one echo: where it `mixes`
    them at the mean of the light that they return, else at the ray nearest to the beam's middle.
    """
    subs, n = ranges_m.shape
    echoes, some = np.full((2, n), np.inf), np.empty(subs)
    order = np.empty(subs, dtype=np.int64)
    for i in range(n):
        for k in range(subs):
            some[k] = ranges_m[k, i]
        least, most, whole = some[0], some[0], MIDDLE_WEIGHT * some[0]
        for k in range(1, subs):
            least, most = min(least, some[k]), max(most, some[k])
            whole += (1.0 - MIDDLE_WEIGHT) / (subs - 1) * some[k]
        if least == np.inf:
            continue
        if subs > 1 and most - least <= PULSE_M:  # one echo, as most are
            echoes[0, i] = whole if mixes else some[0]
            continue
        for k in range(subs):  # sorted by insertion: they are few
            at = k
            while at > 0 and some[order[at - 1]] > some[k]:
                order[at] = order[at - 1]
                at -= 1
            order[at] = k
        count, light, way, middle = 0, 0.0, 0.0, subs
        for k in range(subs):
            here = some[order[k]]
            if here == np.inf:
                break
            if light > 0.0 and here - some[order[k - 1]] > PULSE_M:
                echoes[count, i] = way / light if mixes else some[middle]
                count, light, way, middle = count + 1, 0.0, 0.0, subs
                if count == 2:
                    break
            weight = MIDDLE_WEIGHT if order[k] == 0 else (1.0 - MIDDLE_WEIGHT) / (subs - 1)
            light, way, middle = light + weight, way + weight * here, min(middle, order[k])
        if light > 0.0 and count < 2:
            echoes[count, i] = way / light if mixes else some[middle]
    return echoes


@allocating_kernel
def echoes_of_beams(
    beams: Beams, since_begin_s: F64, targets: Targets, passers: Passers, glass_cos: float,
    mixes: bool,
) -> tuple[F64, F64]:  # fmt: skip
    """First and second echo (2, n) of beams, inf where nothing is; and their azimuths (n,).

    Args:
        since_begin_s: (n,) instants, of the passers' clock.
        mixes: of `echoes_from_rays`; glass_cos: of `meet_targets`.
    """
    n, subs, aims = len(beams.bearings), len(beams.pattern), aims_of(beams)
    horizon = horizon_of(beams, aims)
    spans, ways = spans_of_targets(horizon, targets), spans_of_passers(horizon, passers)
    pencil = Pencil(np.empty((3, n)), np.empty((3, n)), np.empty((3, n)))
    ranges_m, met = np.full((subs, n), np.inf), np.empty(n, dtype=np.int64)
    for sub in range(subs):
        found = ranges_m[sub]
        met[:] = -1
        _put_in(aims, beams.pattern[sub], pencil)
        meet_targets(pencil, spans, targets, glass_cos, FAR_M, found, met)
        meet_passers(pencil, ways, since_begin_s, passers, found, met)
        for i in range(n):
            is_black = met[i] >= 0 and targets.materials[met[i]] == BLACK
            if found[i] > (BLACK_REACH_M if is_black else FAR_M):
                found[i] = np.inf
    return echoes_from_rays(ranges_m, mixes), horizon.azimuths
