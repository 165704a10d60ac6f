"""One sweep in one kernel: beams from the lens's poses to what they meet, and to their echoes."""

import numpy as np

from fakes.ray_kernels import (
    BLACK,
    F64,
    Bundle,
    Passers,
    Targets,
    bundle_from,
    kernel,
    meet_passers,
    meet_targets,
    rays_from_poses,
)

FAR_M = 30.0  # a beam returns nothing from beyond
BLACK_REACH_M = 3.0  # nor from what is black, beyond this
MIDDLE_WEIGHT = 0.28  # of a beam's light; the ring around its middle shares the rest
PULSE_M = 0.5  # surfaces that lie nearer behind each other are one echo


@kernel
def bundle_at(
    t_map_body: F64, R_map_body: F64, lens: F64, R_body_lens: F64, bearings: F64, pattern: F64,
    spread_rad: float,
) -> Bundle:  # fmt: skip
    """The rays of beams from a body's poses (n, 3), (n, 3, 3), by the lens's place in the body.

    Args:
        lens, R_body_lens: (3,), (3, 3).
        bearings, pattern, spread_rad: of `rays_from_poses`, of `Bundle`.
    """
    n = len(bearings)
    t_map_lens, R_map_lens = np.empty((n, 3)), np.zeros((n, 3, 3))
    for i in range(n):
        for axis in range(3):
            place = t_map_body[i, axis]
            for k in range(3):
                place += R_map_body[i, axis, k] * lens[k]
                for column in range(3):
                    R_map_lens[i, axis, column] += R_map_body[i, axis, k] * R_body_lens[k, column]
            t_map_lens[i, axis] = place
    begins, ways = rays_from_poses(t_map_lens, R_map_lens, bearings, pattern)
    return bundle_from(begins, ways, len(pattern), spread_rad)


@kernel
def echoes_of_beams(
    t_map_body: F64, R_map_body: F64, lens: F64, R_body_lens: F64, bearings: F64, pattern: F64,
    spread_rad: float, since_begin_s: F64, targets: Targets, passers: Passers, glass_cos: float,
    mixes: bool,
) -> tuple[F64, F64]:  # fmt: skip
    """First and second echo (2, n) of beams, inf where nothing is; and their azimuths (n,).

    Args:
        since_begin_s: (n,) instants, of the passers' clock.
        mixes: of `echoes_from_rays`; the others of `bundle_at` and `meet_targets`.
    """
    bundle = bundle_at(t_map_body, R_map_body, lens, R_body_lens, bearings, pattern, spread_rad)
    n, subs = len(bearings), len(pattern)
    found, met = np.full(n * subs, np.inf), np.full(n * subs, -1)
    meet_targets(bundle, targets, glass_cos, FAR_M, found, met)
    meet_passers(bundle, since_begin_s, passers, found, met)
    for row in range(n * subs):
        is_black = met[row] >= 0 and targets.materials[met[row]] == BLACK
        if found[row] > (BLACK_REACH_M if is_black else FAR_M):
            found[row] = np.inf
    return echoes_from_rays(found, subs, mixes), bundle.azimuths


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
