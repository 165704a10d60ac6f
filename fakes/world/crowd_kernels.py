"""Kernels of people who walk: a moment of all of them, and where their torsos and legs are."""

import math

import numpy as np

from fakes.rays.kernels import F64
from jit import allocating_kernel, kernel

FRONT_M, REAR_M, HALF_WIDTH_M = 0.52, 0.20, 0.30  # the robot's footprint, from its axle
PERSONAL_M = 0.37  # from a body to the robot's footprint: nobody goes nearer by himself
NEAR_M = 3.0  # of the robot's axle: who is farther away does not touch it in a moment
CHANGE_MPS2 = 4.0  # how fast people change their way
GOES_MPS = 1e-3  # slower is standing


@kernel
def _gap_m(x: float, y: float, robot: tuple[float, float, float]) -> float:
    """From a place to the footprint of a robot at x, y, yaw."""
    c, s, dx, dy = math.cos(robot[2]), math.sin(robot[2]), x - robot[0], y - robot[1]
    ahead, aside = c * dx + s * dy, c * dy - s * dx
    return math.hypot(
        max(ahead - FRONT_M, -REAR_M - ahead, 0.0), max(abs(aside) - HALF_WIDTH_M, 0.0)
    )


@kernel
def walk(
    span_s: float, robot: tuple[float, float, float], wanted: F64, radius_m: F64,
    at: F64, v: F64, ahead: F64, gone_m: F64,
) -> None:  # fmt: skip
    """All go on for a moment, in place, and stop short of the robot whatever they want.

    Args:
        wanted: (n, 2) m/s. radius_m: (n,).
        at, v, ahead: (n, 2) place, velocity, direction. gone_m: (n,) way.
    """
    for k in range(len(at)):
        dx, dy = wanted[k, 0] - v[k, 0], wanted[k, 1] - v[k, 1]
        share = min(1.0, CHANGE_MPS2 * span_s / max(1e-9, math.hypot(dx, dy)))
        v[k, 0], v[k, 1] = v[k, 0] + share * dx, v[k, 1] + share * dy
        x, y, speed = at[k, 0], at[k, 1], math.hypot(v[k, 0], v[k, 1])
        if speed < GOES_MPS:
            continue
        if math.hypot(x - robot[0], y - robot[1]) < NEAR_M:
            stops_s = span_s + speed / (2 * CHANGE_MPS2)  # until he can stand
            then_m = _gap_m(x + v[k, 0] * stops_s, y + v[k, 1] * stops_s, robot)
            if then_m - radius_m[k] < PERSONAL_M and then_m < _gap_m(x, y, robot):
                v[k, 0] = v[k, 1] = 0.0
                continue
        at[k, 0], at[k, 1] = x + v[k, 0] * span_s, y + v[k, 1] * span_s
        ahead[k, 0], ahead[k, 1] = v[k, 0] / speed, v[k, 1] / speed
        gone_m[k] += speed * span_s


@allocating_kernel
def parts_at(rows: F64, asides_m: F64, swings_m: F64, stride_m: float) -> F64:
    """Middles (t, n * parts, 2) of the parts of walkers, by rows (t, n, 6) of `Crowd`.

    Args:
        asides_m, swings_m: (parts,) how far each is beside the middle, and swings to and fro.
    """
    instants, n, parts = rows.shape[0], rows.shape[1], len(asides_m)
    middles = np.empty((instants, n * parts, 2))
    for i in range(instants):
        for k in range(n):
            x, y, ahead_x, ahead_y, gone_m, strides = rows[i, k]
            swing = strides * math.sin(gone_m * (math.tau / stride_m))
            for part in range(parts):
                aside, along = asides_m[part], swings_m[part] * swing
                middles[i, k * parts + part, 0] = x - aside * ahead_y + along * ahead_x
                middles[i, k * parts + part, 1] = y + aside * ahead_x + along * ahead_y
    return middles
