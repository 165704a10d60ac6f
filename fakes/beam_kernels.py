"""One sweep in one kernel: beams from the lens's poses to what they meet, and to their echoes."""

import math
from typing import NamedTuple

import numpy as np

from fakes.crossing_kernels import meet_passers, meet_targets
from fakes.ray_kernels import (
    BLACK,
    F64,
    Horizon,
    Passers,
    Pencil,
    Targets,
    horizon_from,
    invert,
    kernel,
    pencil_for,
    spans_of_passers,
    spans_of_targets,
)

Vector = tuple[float, float, float]
BEAMS = 32  # of a pencil
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
def _way_of(beams: Beams, i: int, ahead: float, aside: float, up: float) -> Vector:
    """What lies so far ahead, aside and up of where beam i looks."""
    c, s = math.cos(beams.bearings[i]), math.sin(beams.bearings[i])
    x, y, z = _turned(beams.R_body_lens, c * ahead - s * aside, s * ahead + c * aside, up)
    return _turned(beams.R_map_body[i], x, y, z)


@kernel
def middles_of(beams: Beams) -> tuple[F64, F64]:
    """Begins and ways (n, 3) of the beams' middles."""
    n = len(beams.bearings)
    begins, ways = np.empty((n, 3)), np.empty((n, 3))
    for i in range(n):
        begins[i, 0], begins[i, 1], begins[i, 2] = _begin_of(beams, i)
        ways[i, 0], ways[i, 1], ways[i, 2] = _way_of(beams, i, 1.0, 0.0, 0.0)
    return begins, ways


@kernel
def horizon_of(beams: Beams) -> Horizon:
    """Where the beams look."""
    begins, ways = middles_of(beams)
    aside_m = 0.0
    for sub in range(len(beams.pattern)):
        aside_m = max(aside_m, abs(beams.pattern[sub, 0]) + abs(beams.pattern[sub, 1]))
    return horizon_from(begins, ways, aside_m, beams.spread_rad)


@kernel
def _put_in(beams: Beams, pencil: Pencil) -> None:
    """Into a pencil, the rays of its beams."""
    begins, ways, lengths = pencil.begins, pencil.ways, np.empty(pencil.subs)
    for sub in range(pencil.subs):
        lengths[sub] = math.hypot(1.0, math.hypot(beams.pattern[sub, 2], beams.pattern[sub, 3]))
    for i in range(pencil.beams):
        beam, row = pencil.first + i, i * pencil.subs
        begin, ahead = _begin_of(beams, beam), _way_of(beams, beam, 1.0, 0.0, 0.0)
        aside, up = _way_of(beams, beam, 0.0, 1.0, 0.0), _way_of(beams, beam, 0.0, 0.0, 1.0)
        for sub in range(pencil.subs):
            right, high = beams.pattern[sub, 0], beams.pattern[sub, 1]
            right_way, high_way = beams.pattern[sub, 2], beams.pattern[sub, 3]
            for axis in range(3):
                off = right * aside[axis] + high * up[axis]
                way = ahead[axis] + right_way * aside[axis] + high_way * up[axis]
                begins[axis, row + sub] = begin[axis] + off
                ways[axis, row + sub] = way / lengths[sub]
    invert(pencil)


@kernel
def echoes_of_beams(
    beams: Beams, since_begin_s: F64, targets: Targets, passers: Passers, glass_cos: float,
    mixes: bool,
) -> tuple[F64, F64]:  # fmt: skip
    """First and second echo (2, n) of beams, inf where nothing is; and their azimuths (n,).

    Args:
        since_begin_s: (n,) instants, of the passers' clock.
        mixes: of `echoes_from_rays`; glass_cos: of `meet_targets`.
    """
    n, subs, horizon = len(beams.bearings), len(beams.pattern), horizon_of(beams)
    spans, ways = spans_of_targets(horizon, targets), spans_of_passers(horizon, passers)
    room, echoes = pencil_for(BEAMS, subs), np.full((2, n), np.inf)
    found, met = np.empty(BEAMS * subs), np.empty(BEAMS * subs, dtype=np.int64)
    for first in range(0, n, BEAMS):
        pencil = Pencil(room.begins, room.ways, room.inverses, first, min(BEAMS, n - first), subs)
        _put_in(beams, pencil)
        found[:], met[:] = np.inf, -1
        meet_targets(pencil, spans, targets, glass_cos, FAR_M, found, met)
        meet_passers(pencil, ways, since_begin_s, passers, found, met)
        for row in range(pencil.beams * subs):
            is_black = met[row] >= 0 and targets.materials[met[row]] == BLACK
            if found[row] > (BLACK_REACH_M if is_black else FAR_M):
                found[row] = np.inf
        last = first + pencil.beams
        echoes[:, first:last] = echoes_from_rays(found[: pencil.beams * subs], subs, mixes)
    return echoes, horizon.azimuths


@kernel
def echoes_from_rays(ranges_m: F64, subs: int, mixes: bool) -> F64:
    """First and second echo (2, n) of beams of `subs` rays (n * subs,); inf where nothing is.

    Surfaces of one beam that follow each other by less than a pulse are one echo: where it `mixes`
    them at the mean of the light that they return, else at the ray nearest to the beam's middle.
    """
    n = len(ranges_m) // subs
    echoes = np.full((2, n), np.inf)
    order = np.empty(subs, dtype=np.int64)
    for i in range(n):
        some = ranges_m[i * subs : (i + 1) * subs]
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
