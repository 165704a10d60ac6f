"""Kernels of the fake MTi: a sample's rotations and vectors in one go, a hundred times a second."""

import math

import numpy as np

from fakes.rays.kernels import F64
from jit import allocating_kernel

Sigmas = tuple[float, float, float, float]  # of angle, acceleration, rate of turn, field


@allocating_kernel
def times(A: F64, B: F64) -> F64:
    """Product (3, 3) of two matrices."""
    C = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            C[i, j] = A[i, 0] * B[0, j] + A[i, 1] * B[1, j] + A[i, 2] * B[2, j]
    return C


@allocating_kernel
def turn_about(x: float, y: float, z: float) -> F64:
    """The turn (3, 3) about a vector by its length, rad."""
    angle = math.sqrt(x * x + y * y + z * z)
    half = math.sin(angle / 2) / angle if angle > 0.0 else 0.5
    w, x, y, z = math.cos(angle / 2), half * x, half * y, half * z
    ww, xx, yy, zz = w * w, x * x, y * y, z * z
    R = np.empty((3, 3))
    R[0, 0], R[1, 1], R[2, 2] = ww + xx - yy - zz, ww - xx + yy - zz, ww - xx - yy + zz
    R[0, 1], R[1, 0] = 2 * (x * y - w * z), 2 * (x * y + w * z)
    R[0, 2], R[2, 0] = 2 * (x * z + w * y), 2 * (x * z - w * y)
    R[1, 2], R[2, 1] = 2 * (y * z - w * x), 2 * (y * z + w * x)
    return R


@allocating_kernel
def told(
    R_true: F64, R_believed: F64, accel: F64, rate: F64, field: F64, yaw_rad: float,
    sigmas: Sigmas, noise: F64, accel_off: F64, rate_off: F64, full: F64, earth: F64, case: F64,
) -> tuple[F64, F64, int]:  # fmt: skip
    """What is told of a sample: orientation (3, 3), vectors as rows (3, 3), which were clipped.

    Args:
        R_true, R_believed: (3, 3) as it is, and as the sensor takes it to be.
        accel, rate: (3,) along the sensor's axes; field: (3,) in the earth frame.
        yaw_rad: by which the orientation's yaw is off.
        sigmas: of angle, acceleration, rate and field; noise: (4, 3) of these, for the angle in row
            0, the rate in 1, acceleration in 2 and field in 3; accel_off, rate_off: (3,) biases.
        full: (3,) at most: acceleration, rate, field.
        earth, case: (3, 3), what turns the earth, and the sensor's axes, to what is told.

    Returns:
        The rows are acceleration, rate and field; a bit for each number beyond `full`, accel x
        first.
    """
    R = times(turn_about(0.0, 0.0, yaw_rad), R_believed)
    x, y, z = sigmas[0] * noise[0, 0], sigmas[0] * noise[0, 1], sigmas[0] * noise[0, 2]
    R = times(times(earth, times(R, turn_about(x, y, z))), case.T)
    vectors, clipped, sensed = np.empty((3, 3)), 0, np.empty(3)
    for kind in range(3):
        for axis in range(3):
            if kind == 0:
                value = accel[axis] + (accel_off[axis] + sigmas[1] * noise[2, axis])
            elif kind == 1:
                value = rate[axis] + (rate_off[axis] + sigmas[2] * noise[1, axis])
            else:
                value = 0.0
                for k in range(3):
                    value += R_true[k, axis] * field[k]
                value += sigmas[3] * noise[3, axis]
            if abs(value) > full[kind]:
                clipped |= 1 << (3 * kind + axis)
            sensed[axis] = min(max(value, -full[kind]), full[kind])
        for axis in range(3):
            vectors[kind, axis] = (
                case[axis, 0] * sensed[0] + case[axis, 1] * sensed[1] + case[axis, 2] * sensed[2]
            )
    return R, vectors, clipped


@allocating_kernel
def go_on(
    gone_s: float, R_earth_sensor: F64, accel: F64, lean_s: float, lean_rad: F64,
    times_s: F64, wander: F64, noise: F64,
) -> None:  # fmt: skip
    """Let a false vertical (2,) follow what is felt, and let what wanders (n,) go on, in place."""
    felt = np.zeros(3)
    for k in range(3):
        for axis in range(3):
            felt[k] += R_earth_sensor[k, axis] * accel[axis]
    strength = max(1e-9, math.sqrt(felt[0] * felt[0] + felt[1] * felt[1] + felt[2] * felt[2]))
    share = 1.0 - math.exp(-gone_s / lean_s)
    lean_rad[0] += share * (felt[1] / strength - lean_rad[0])
    lean_rad[1] += share * (-felt[0] / strength - lean_rad[1])
    for k in range(len(wander)):
        kept = math.exp(-gone_s / times_s[k])
        wander[k] = kept * wander[k] + math.sqrt(1.0 - kept * kept) * noise[k]


@allocating_kernel
def believed(R_earth_sensor: F64, lean_rad: F64, wander: F64, sigmas: F64, R_case: F64) -> F64:
    """An orientation (3, 3) with a false vertical, a false heading, and in a case set askew.

    Args:
        lean_rad: (2,). wander: (3,) more of it and the heading's, in sigmas (3,).
    """
    lean_x, lean_y = lean_rad[0] + sigmas[0] * wander[0], lean_rad[1] + sigmas[1] * wander[1]
    R = times(turn_about(lean_x, lean_y, 0.0), R_earth_sensor)
    return times(times(turn_about(0.0, 0.0, sigmas[2] * wander[2]), R), R_case)


def warm() -> None:
    """Run all of them once, so that none is compiled while a host waits for its device."""
    up, one, rows = np.array([0.0, 0.0, 9.81]), np.eye(3), np.zeros((4, 3))
    told(one, one, up, up, up, 0.0, (0.0, 0.0, 0.0, 0.0), rows, up, up, up, one, one)
    go_on(0.01, one, up, 1.0, np.zeros(2), np.ones(6), np.zeros(6), np.zeros(6))
    believed(one, np.zeros(2), np.zeros(6), np.zeros(3), one)
