"""The floor of a frame: predicted by the pose, found by MSAC within a gate, refined, with doubts.

    z = a + b x + c y                              in the predicted level frame
    |z| <= GATE (s_h + x s_pitch + |y| s_roll + s)  the gate: what may be floor
    cost = sum min(e^2 / s^2, GATE^2)               of a hypothesis by three points of the gate

s is one sigma of a point's height. The covariance is that of least squares, times 1 + n SHARED^2:
neighbours err alike, so n points are worth no more than 1 / SHARED^2 of them.

Source: docs/objects.md, section 3; MSAC, Torr and Zisserman 2000.
"""

import math
from typing import NamedTuple

import numpy as np

from core.objects.frame.pixels import GATE, I32, sigma_m
from core.records import F32, F64
from jit import kernel, releasing_kernel

ROUGH_M = 0.002  # one sigma of what a floor is not flat by
SHARED = 0.3  # part of a range's sigma that all its neighbours have in common
TRIES, SCORED = 150, 800  # hypotheses, points that judge each
ROUNDS = 4  # of least squares
SEED = 20_461  # the same for each frame: a replay gives the same bits
LEVEL_BIN_M, LEVEL_WIDE = 0.002, 3  # of levels below a plane: height of a bin, half width in bins
LEVEL_BINS = 64  # as deep as a gate of GATE x 4 cm
LEVEL_SHARE = 0.1  # of the plane's points: so many on a lower level, and that one is the floor,
LEVEL_WORSE = 1.0  # if the prediction's chi^2 of it is not larger by more than that
LEAST_POINTS = 50
LEAST_SHARE = 0.3  # of the points in the gate must lie on the plane
LEAST_WIDTH = 0.05  # m, one sigma of where the points lie, along both directions

Plane = tuple[float, float, float]
Nine = tuple[float, float, float, float, float, float, float, float, float]


class Gated(NamedTuple):
    """Room for points that may be floor, and how many lie below all that may be."""

    x: F64  # (n,) m, level as predicted
    y: F64
    z: F64
    sigma: F64  # of z
    found: I32  # (2,) how many are in the gate, how many below it


@releasing_kernel
def gather(
    units: F32, ranges: F32, stride: int, R: Nine, lens_m: float,
    sigmas: Plane, limits: tuple[float, float, float, float], gated: Gated,
) -> None:  # fmt: skip
    """Points of every stride-th row and column that may be floor.

    Args:
        R: (3, 3) from sensor to level, row by row.
        sigmas: of the lens's height, pitch and roll.
        limits: least and most range, noise_m and noise_per_m2.
    """
    rows, columns = ranges.shape
    r0, r1, r2, r3, r4, r5, r6, r7, r8 = R
    n, below, (least, most, noise, per_m2) = 0, 0, limits
    for i in range(stride // 2, rows, stride):
        for j in range(stride // 2, columns, stride):
            r = ranges[i, j]
            if r < least or r >= most or r == 0.0:
                continue
            a, b, c = r * units[0, i, j], r * units[1, i, j], r * units[2, i, j]
            down = r6 * a + r7 * b + r8 * c
            x, y, z = r0 * a + r1 * b + r2 * c, r3 * a + r4 * b + r5 * c, lens_m + down
            s = sigma_m(r, noise, per_m2) * down / r
            sigma = math.sqrt(s * s + ROUGH_M * ROUGH_M)
            gate = GATE * (sigmas[0] + abs(x) * sigmas[1] + abs(y) * sigmas[2] + sigma)
            if abs(z) <= gate:
                gated.x[n], gated.y[n], gated.z[n], gated.sigma[n] = x, y, z, sigma
                n += 1
            elif z < 0.0:
                below += 1
    gated.found[0], gated.found[1] = n, below


@kernel
def _inverse(m: F64, out: F64) -> bool:
    """Inverse of a symmetric (3, 3); False, and nothing written, where there is none."""
    c0 = m[1, 1] * m[2, 2] - m[1, 2] * m[1, 2]
    c1 = m[0, 2] * m[1, 2] - m[0, 1] * m[2, 2]
    c2 = m[0, 1] * m[1, 2] - m[0, 2] * m[1, 1]
    det = m[0, 0] * c0 + m[0, 1] * c1 + m[0, 2] * c2
    if not det > 1e-12 * m[0, 0] * m[1, 1] * m[2, 2]:
        return False
    out[0, 0], out[0, 1], out[0, 2] = c0 / det, c1 / det, c2 / det
    out[1, 1] = (m[0, 0] * m[2, 2] - m[0, 2] * m[0, 2]) / det
    out[1, 2] = (m[0, 1] * m[0, 2] - m[0, 0] * m[1, 2]) / det
    out[2, 2] = (m[0, 0] * m[1, 1] - m[0, 1] * m[0, 1]) / det
    out[1, 0], out[2, 0], out[2, 1] = out[0, 1], out[0, 2], out[1, 2]
    return True


@kernel
def _through(gated: Gated, p: int, q: int, s: int) -> tuple[bool, float, float, float]:
    """The plane through three points; False where they lie on one line."""
    x, y, z = gated.x, gated.y, gated.z
    ux, uy, uz = x[q] - x[p], y[q] - y[p], z[q] - z[p]
    vx, vy, vz = x[s] - x[p], y[s] - y[p], z[s] - z[p]
    det = ux * vy - uy * vx
    if abs(det) < 0.01:  # m2
        return False, 0.0, 0.0, 0.0
    b, c = (uz * vy - uy * vz) / det, (ux * vz - uz * vx) / det
    return True, z[p] - b * x[p] - c * y[p], b, c


@kernel
def _best(gated: Gated, sigmas: Plane) -> Plane:
    """The hypothesis of least cost; the predicted plane is the first of them."""
    n, state, best = gated.found[0], SEED, (0.0, 0.0, 0.0)
    least, step = math.inf, max(1, n // SCORED)
    for number in range(TRIES + 1):
        a, b, c = 0.0, 0.0, 0.0
        if number > 0:
            state = (state * 1103515245 + 12345) & 0x7FFFFFFF
            p = (state >> 8) % n
            state = (state * 1103515245 + 12345) & 0x7FFFFFFF
            q = (state >> 8) % n
            state = (state * 1103515245 + 12345) & 0x7FFFFFFF
            found, a, b, c = _through(gated, p, q, (state >> 8) % n)
            is_far = abs(a) > GATE * sigmas[0] or abs(b) > GATE * sigmas[1]
            if not found or is_far or abs(c) > GATE * sigmas[2]:
                continue
        cost = 0.0
        for k in range(0, n, step):
            e = (gated.z[k] - a - b * gated.x[k] - c * gated.y[k]) / gated.sigma[k]
            cost += min(e * e, GATE * GATE)
            if cost >= least:
                break
        if cost < least:
            least, best = cost, (a, b, c)
    return best


@kernel
def _refine(gated: Gated, plane: Plane, N: F64, C: F64) -> tuple[int, float, Plane]:
    """Least squares over the points near a plane: how many, sum of their e^2 / s^2, the plane.

    Args:
        N: (3, 3) written: sum of w J J'.
        C: (3, 3) written: its inverse; not where no points are, or they lie on a line.
    """
    a, b, c = plane
    used, total = 0, 0.0
    for _ in range(ROUNDS):
        N[:] = 0.0
        used, total, g0, g1, g2 = 0, 0.0, 0.0, 0.0, 0.0
        for k in range(gated.found[0]):
            x, y, s = gated.x[k], gated.y[k], gated.sigma[k]
            e = gated.z[k] - a - b * x - c * y
            if abs(e) > GATE * s:
                continue
            w = 1.0 / (s * s)
            used, total = used + 1, total + w * e * e
            g0, g1, g2 = g0 + w * e, g1 + w * e * x, g2 + w * e * y
            N[0, 0] += w
            N[0, 1] += w * x
            N[0, 2] += w * y
            N[1, 1] += w * x * x
            N[1, 2] += w * x * y
            N[2, 2] += w * y * y
        if used < 3 or not _inverse(N, C):
            return 0, 0.0, plane
        a += C[0, 0] * g0 + C[0, 1] * g1 + C[0, 2] * g2
        b += C[1, 0] * g0 + C[1, 1] * g1 + C[1, 2] * g2
        c += C[2, 0] * g0 + C[2, 1] * g1 + C[2, 2] * g2
    return used, total, (a, b, c)


@kernel
def _lower_level(gated: Gated, plane: Plane, used: int, levels: I32) -> float:
    """How far below a plane the lowest level lies on which many points agree; 0: there is none."""
    a, b, c = plane
    levels[:] = 0
    for k in range(gated.found[0]):
        e = gated.z[k] - a - b * gated.x[k] - c * gated.y[k]
        at = int(-e / LEVEL_BIN_M)
        if e < -GATE * gated.sigma[k] and at < LEVEL_BINS:
            levels[at] += 1
    for at in range(LEVEL_BINS - 1, -1, -1):
        near, most = 0, 0
        for k in range(max(0, at - LEVEL_WIDE), min(LEVEL_BINS, at + LEVEL_WIDE + 1)):
            near += levels[k]
            most = max(most, levels[k])
        if near >= LEVEL_SHARE * used and levels[at] == most:
            return (at + 0.5) * LEVEL_BIN_M
    return 0.0


@kernel
def _off(plane: Plane, sigmas: Plane) -> float:
    """Chi^2 of a plane by the prediction alone."""
    a, b, c = plane[0] / sigmas[0], plane[1] / sigmas[1], plane[2] / sigmas[2]
    return a * a + b * b + c * c


@releasing_kernel
def fit(
    gated: Gated, sigmas: Plane, levels: I32, N: F64, C: F64
) -> tuple[int, float, float, float, float]:
    """The floor among the points of a gate: how many lie on it, chi^2 of one, and its plane."""
    if gated.found[0] < LEAST_POINTS:
        return 0, 0.0, 0.0, 0.0, 0.0
    used, total, plane = _refine(gated, _best(gated, sigmas), N, C)
    drop = _lower_level(gated, plane, used, levels)
    if drop > 0.0:
        lower, sum_of_it, low = _refine(gated, (plane[0] - drop, plane[1], plane[2]), N, C)
        is_likely = _off(low, sigmas) <= _off(plane, sigmas) + LEVEL_WORSE
        if is_likely and lower >= LEVEL_SHARE * used:
            used, total, plane = lower, sum_of_it, low
        else:
            used, total, plane = _refine(gated, plane, N, C)
    return used, total / max(1, used - 3), plane[0], plane[1], plane[2]


class Floor(NamedTuple):
    """The floor as a frame alone tells it, beside the pose that predicted it."""

    height_m: float  # of the lens over it
    # how far the camera is turned from the prediction about the level frame's axes:
    pitch_rad: float  # about y, nose down positive
    roll_rad: float  # about x, right side down positive
    covariance: F64  # (3, 3) of these three
    share: float  # of the points that may be floor, those that are
    points: int  # of them, in the part of the image that was looked at
    normal_sensor: F64  # (3,) unit, up


def width_of(N: F64) -> float:
    """The lesser one sigma of where points lie, along any direction, m.

    Args:
        N: (3, 3) sum of w (1, x, y)' (1, x, y).
    """
    mean = N[0, 1:] / N[0, 0]
    spread = np.array([[N[1, 1], N[1, 2]], [N[1, 2], N[2, 2]]]) / N[0, 0] - np.outer(mean, mean)
    return math.sqrt(max(0.0, float(np.linalg.eigvalsh(spread)[0])))


def level_rotation(b: float, c: float) -> F64:
    """(3, 3) the least rotation that turns the normal of z = a + b x + c y upright."""
    n = np.array([-b, -c, 1.0]) / math.sqrt(1.0 + b * b + c * c)
    v = np.array([n[1], -n[0], 0.0])  # n x up
    K = np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    return np.asarray(np.eye(3) + K + K @ K / (1.0 + n[2]))
