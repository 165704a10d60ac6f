"""The sensor's own tilt: how far the told one is off, how noisy it is, and whom to doubt.

With v = R R_s' e_z, the sensor's vertical as the told orientation R sees it, and what is known of
how the sensor's orientation R_s errs (`core.motion.orientation`), the filter measures

    (v_y, -v_x) = theta + u + s l + (R c)      about earth's x and y

with the resolution ANGLE_RAD, which errs alike for ALIKE_S, so that R = 2 ALIKE_S / dt ANGLE_RAD^2;
or with the noise that shows in the jumps from sample to sample. What is off by more than GATE
sigmas is left out. Where it stays so for PERSIST_S, no lean explains it any more, and the told tilt
is the sensor's, less what is known of its errors, which may be off by DYNAMIC_RAD at any instant.
Where it is off by APART_RAD, the gyro is not believed for ALONE_S.
"""

import math

import numpy as np

from core.geometry import (
    Matrix,
    Quaternion,
    matrix_of,
    q_of_turn,
    rpy_of,
    turned,
)
from core.motion.compass import GATE
from core.motion.error_state import (
    BIAS,
    BIAS_Z,
    CASE,
    LIKELY_BIAS_RADPS,
    SHARE,
    SIZE,
    START_BIAS_RADPS,
    TILT,
    WANDER,
    correct,
)
from core.motion.kalman import begin, spread
from core.motion.lean import LEAN_S
from core.records import F64
from jit import Record, allocating_kernel, kernel

ANGLE_RAD = math.radians(0.05)  # sheet: resolution of the sensor's own angles
ALIKE_S = 0.5  # so long its angles err alike: they are low-passed
DYNAMIC_RAD = math.radians(2.0)  # sheet: of its roll and pitch while it moves
UNKNOWN_RAD = 1.0  # sigma of a tilt of which nothing is known
APART_RAD, APART_S = math.radians(3.0), 0.5  # gyro and sensor do not agree any more, over so long,
ALONE_S = 10.0  # and the sensor's tilt counts alone for so long
PERSIST_S = 3.0 * LEAN_S  # statistics: 5 % of a lean is left
JUMPS_S = 0.4  # over which the jumps from sample to sample are measured


@kernel
def told(of: Record) -> Quaternion:
    return (of.q[0], of.q[1], of.q[2], of.q[3])


@kernel
def tell(of: Record, q: Quaternion) -> None:
    of.q[0], of.q[1], of.q[2], of.q[3] = q[0], q[1], q[2], q[3]


@kernel
def turn_told(of: Record, x: float, y: float, z: float) -> None:
    """Turn what is told about earth's axes."""
    tell(of, turned(q_of_turn(x, y, z), told(of)))


@kernel
def yaw_of(q: Quaternion) -> float:
    _, _, yaw_rad = rpy_of(q[0], q[1], q[2], q[3])
    return yaw_rad


@kernel
def compare_tilt(of: Record, dt_s: float, q_sensor: Quaternion) -> None:
    """By how much the sensor's own tilt is off, and how noisy that is."""
    R, up, jump = matrix_of(told(of)), matrix_of(q_sensor)[2], 0.0
    for k in range(2):
        row = R[1 - k]
        off = (1.0 - 2.0 * k) * (row[0] * up[0] + row[1] * up[1] + row[2] * up[2])
        jump += 0.25 * (off - of.off_rad[k]) ** 2
        of.off_rad[k] = off
    of.angle_var += min(1.0, dt_s / JUMPS_S) * (jump - of.angle_var)


@kernel
def is_bias_guessed(P: F64) -> bool:
    """Whether the gyro's bias about body x or y was hardly measured yet."""
    return bool(max(P[BIAS, BIAS], P[BIAS + 1, BIAS + 1]) > 0.25 * LIKELY_BIAS_RADPS**2)


@allocating_kernel
def use_tilt(
    of: Record, errors: Record, R: Matrix, off_rad: tuple[float, float], dt_s: float, var: float
) -> bool:
    """The sensor's own tilt, about earth's x and y; False: it is beyond the gate."""
    P, value, good = errors.P, errors.value, True
    alike_var = ANGLE_RAD**2 * 2.0 * ALIKE_S / dt_s if dt_s > 0.0 else 0.0
    for k in range(2):
        h = np.zeros(SIZE)
        h[TILT + k] = h[WANDER + k] = 1.0
        h[SHARE], h[CASE], h[CASE + 1] = of.lean.rad[k], R[k][0], R[k][1]
        off = off_rad[k]
        for n in range(SIZE):
            off -= h[n] * value[n]
        of.apart_rad[k] += min(1.0, dt_s / APART_S) * (off - of.apart_rad[k])
        if off * off > GATE * GATE * (spread(h, P) + var):
            good = False
        else:
            correct(P, value, h, off, max(var, alike_var))
    value[SHARE] = max(0.0, min(1.0, value[SHARE]))
    turn_told(of, value[TILT], value[TILT + 1], 0.0)
    value[TILT] = value[TILT + 1] = 0.0
    return good


@kernel
def take_sensors_tilt(of: Record, errors: Record, q_sensor: Quaternion) -> None:
    """Nothing is known of the tilt but the sensor's own, which is told, less its known errors."""
    q = turned(q_of_turn(0.0, 0.0, yaw_of(told(of)) - yaw_of(q_sensor)), q_sensor)
    tell(of, q)
    for k in range(2):
        begin(errors.P, TILT + k, UNKNOWN_RAD**2)
    use_tilt(of, errors, matrix_of(q), (0.0, 0.0), 0.0, DYNAMIC_RAD**2 + of.angle_var)
    for k in range(2):
        of.off_rad[k] = of.apart_rad[k] = 0.0
    of.beyond_s = 0.0


@kernel
def begin_tilt(of: Record, errors: Record, q_sensor: Quaternion) -> None:
    """The gyro, of which little is known yet, is no likely one."""
    for k in range(BIAS, BIAS_Z):
        begin(errors.P, k, START_BIAS_RADPS**2)
    take_sensors_tilt(of, errors, q_sensor)


@kernel
def doubt(of: Record, errors: Record, t_s: float, q_sensor: Quaternion) -> None:
    """Gyro and sensor stay apart: one of them is wrong, for no sensor leans so much or so long."""
    if max(abs(of.apart_rad[0]), abs(of.apart_rad[1])) > APART_RAD:
        of.doubted += 1
        of.alone_until_s = t_s + ALONE_S
    if of.beyond_s > PERSIST_S:
        of.doubted += 1
        take_sensors_tilt(of, errors, q_sensor)
