"""The error state of the body's motion: what is estimated, and how sure that is.

Nineteen numbers with one covariance P. `value` holds what is owed to the told pose, and the
constants of the sensors as estimated so far; P is the covariance of their errors (truth minus
estimate). With theta a turn about the earth's axes, of which x and y are the tilt and z is the yaw,
and p a place:

    truth R = exp(theta) R(told)       theta' = -R b                b: the gyro's bias, body axes
    truth p = p(told) + (x, y)         (x, y)' = theta_z x v + s v  s: scale of the wheels, v: speed

Time passes in steps of a tenth of a second (`pass_time`), way in steps of the wheels (`travel`).
Position is that at the newest wheel counts, angles those of the newest attitude: the few
centiseconds between them are left out.
Source: error-state (indirect) Kalman filter, scalar measurements one after another; Sola,
Quaternion kinematics for the error-state Kalman filter, 2017, section 7 (global angular errors).
"""

import math

import numpy as np

from core.geometry import Matrix
from core.motion.kalman import begin, fade
from core.motion.kalman import correct as take
from core.records import F64
from jit import Records, allocating_kernel, kernel, records

SIZE = 19
X, Y, YAW = 0, 1, 2  # m, m, rad: what the told pose is to be corrected by; map frame
TILT = 3  # and 4: rad, the same about the earth's x and y
BIAS = 5  # to 7: rad/s, of the gyro's rates about body x, y,
BIAS_Z = 7  # and z
WANDER = 8  # and 9: rad, by which the sensor's own tilt errs about the earth's x and y, for a while
OFFSET = 10  # rad, of the sensor's own yaw against the filter's, beyond what is known of it
SHARE = 11  # of what it feels of the robot's driving, which the sensor takes for the vertical's
CASE = 12  # and 13: rad, by which it sits askew on the body for always, about body x and y
SCALE = 14  # relative: true travel is (1 + SCALE) times that of the wheels
ASYMMETRY = 15  # relative: how much larger the right wheel is than the left one
ALIGN_X, ALIGN_Y, ALIGN_YAW = 16, 17, 18  # of a positioning system's frame in the map frame

H_YAW: F64 = np.eye(SIZE)[YAW]  # of a measurement of the yaw alone
ERRORS = np.dtype([("value", np.float64, SIZE), ("P", np.float64, (SIZE, SIZE))])
START_BIAS_RADPS = math.radians(0.5)  # of a gyro that is not calibrated
LIKELY_BIAS_RADPS = math.radians(0.1)  # of one that is
START_SCALE = 0.04
START_ASYMMETRY = 0.005
START_SHARE = 1.0 / 3.0  # a sensor that leans wholly is three sigmas off
BIAS_VAR = math.radians(0.003) ** 2  # (rad/s)2/s: random walk of a bias
WANDER_RAD, WANDER_S = math.radians(0.1), 20.0  # sheet: repeatability 0.2 deg is two sigmas
OFFSET_RAD, OFFSET_S = math.radians(1.0), 100.0  # sheet: heading 1 deg; its time is chosen
CASE_RAD = math.radians(0.25)  # sheet: static accuracy 0.5 deg is two sigmas


@kernel
def pass_time(
    P: F64, value: F64, R: Matrix, dt_s: float, turn_var: float, yaw_stands: bool
) -> None:
    """Time passes: angles err by what the biases turn them; what wanders returns to its middle.

    Args:
        R: the told orientation, rows of R_earth_body.
        turn_var: what the gyro's own errors add to the variance of each angle.
        yaw_stands: the told yaw was not moved by the gyro.
    """
    for i in range(2 if yaw_stands else 3):
        row, (x, y, z) = (TILT + i if i < 2 else YAW), R[i]
        for n in range(SIZE):
            P[row, n] -= dt_s * (x * P[BIAS, n] + y * P[BIAS + 1, n] + z * P[BIAS_Z, n])
    for i in range(2 if yaw_stands else 3):
        row, (x, y, z) = (TILT + i if i < 2 else YAW), R[i]
        for n in range(SIZE):
            P[n, row] -= dt_s * (x * P[n, BIAS] + y * P[n, BIAS + 1] + z * P[n, BIAS_Z])
        P[row, row] += turn_var
    for k in range(3):
        P[BIAS + k, BIAS + k] += BIAS_VAR * dt_s
    return_to_middle(P, value, WANDER, WANDER_RAD, math.exp(-dt_s / WANDER_S))
    return_to_middle(P, value, WANDER + 1, WANDER_RAD, math.exp(-dt_s / WANDER_S))
    return_to_middle(P, value, OFFSET, OFFSET_RAD, math.exp(-dt_s / OFFSET_S))


@kernel
def return_to_middle(P: F64, value: F64, row: int, sigma: float, kept: float) -> None:
    """An Ornstein-Uhlenbeck process of such a sigma keeps a share of what it was."""
    fade(P, value, row, kept, sigma * sigma * (1.0 - kept * kept))


@kernel
def travel(P: F64, dx_m: float, dy_m: float, along_var: float, across_var: float) -> None:
    """A step in the map frame: heading and scale errors become errors of position.

    Variances (m2) along and across it are added.
    """
    for n in range(SIZE):
        P[X, n] += dx_m * P[SCALE, n] - dy_m * P[YAW, n]
        P[Y, n] += dy_m * P[SCALE, n] + dx_m * P[YAW, n]
    for n in range(SIZE):
        P[n, X] += dx_m * P[n, SCALE] - dy_m * P[n, YAW]
        P[n, Y] += dy_m * P[n, SCALE] + dx_m * P[n, YAW]
    length2 = dx_m * dx_m + dy_m * dy_m
    if length2 == 0.0:
        P[X, X] += along_var
        P[Y, Y] += along_var
        return
    cc, ss, cs = dx_m * dx_m / length2, dy_m * dy_m / length2, dx_m * dy_m / length2
    P[X, X] += cc * along_var + ss * across_var
    P[Y, Y] += ss * along_var + cc * across_var
    P[X, Y] += cs * (along_var - across_var)
    P[Y, X] = P[X, Y]


@kernel
def lay_step(
    P: F64,
    value: F64,
    step_m: tuple[float, float],
    along_var: float,
    across_var: float,
    most_m: float,
) -> tuple[float, float]:
    """What a step makes less sure, and what the told heading does not lay as estimated.

    Returns:
        How much of the pending correction of the position is taken, `most_m` at most.
    """
    dx_m, dy_m = step_m
    travel(P, dx_m, dy_m, along_var, across_var)
    pending_rad = value[YAW]
    value[X] -= pending_rad * dy_m
    value[Y] += pending_rad * dx_m
    x_m, y_m = value[X], value[Y]
    length_m = math.hypot(x_m, y_m)
    if length_m > most_m:
        x_m, y_m = x_m * (most_m / length_m), y_m * (most_m / length_m)
    value[X] -= x_m
    value[Y] -= y_m
    return x_m, y_m


@allocating_kernel
def correct(P: F64, value: F64, h: F64, innovation: float, variance: float) -> None:
    """One scalar measurement: innovation, measured minus expected, = h (19,) . error + noise.

    The variance of the noise must be positive.
    """
    take(P, value, h, innovation, variance, np.zeros(SIZE))


@kernel
def define(P: F64, row: int, like: int, sign: float, variance: float) -> None:
    """Begin a state anew: its error is `sign` times that of another, and noise of its own."""
    for n in range(SIZE):
        P[row, n] = sign * P[like, n]
    for n in range(SIZE):
        P[n, row] = P[row, n]
    P[row, row] = P[like, like] + variance


class ErrorState:
    """`value` (19,) and `P` (19, 19), in the order of the names above; units of each as there.

    They lie in `record` (1,), of ERRORS.
    """

    def __init__(self, record: Records | None = None) -> None:
        self.record = record = records(ERRORS) if record is None else record
        self.value: F64 = record["value"][0]
        self.P: F64 = record["P"][0]
        for row, sigma in (
            *((BIAS + k, LIKELY_BIAS_RADPS) for k in range(2)),
            (BIAS_Z, START_BIAS_RADPS),
            *((WANDER + k, WANDER_RAD) for k in range(2)),
            *((CASE + k, CASE_RAD) for k in range(2)),
            (SHARE, START_SHARE),
            (SCALE, START_SCALE),
            (ASYMMETRY, START_ASYMMETRY),
        ):
            self.P[row, row] = sigma**2

    def correct(self, h: F64, innovation: float, variance: float) -> None:
        """Take a measurement, as `correct` above."""
        correct(self.P, self.value, h, innovation, variance)

    def correct_some(
        self, rows: tuple[int, ...], h: F64, innovation: float, variance: float
    ) -> None:
        """Take a measurement for some states alone, and leave the others as sure as they are.

        For one whose errors hang together in ways that would be taken for those of the others.
        """
        Ph = self.P @ h
        gain = np.zeros(SIZE)
        gain[list(rows)] = Ph[list(rows)] / (float(h @ Ph) + variance)
        self.value += gain * innovation
        left = np.eye(SIZE) - np.outer(gain, h)
        self.P[:] = left @ self.P @ left.T + variance * np.outer(gain, gain)

    def spread(self, h: F64) -> float:
        """Variance of h . error."""
        return float(h @ self.P @ h)

    def define(self, row: int, like: int, sign: float, variance: float) -> None:
        """Begin a state anew: its error is `sign` times that of another, and noise of its own."""
        define(self.P, row, like, sign, variance)

    def forget(self, row: int, variance: float) -> None:
        """Begin a state anew that has to do with no other one."""
        begin(self.P, row, variance)

    def begin_map(self) -> None:
        """The pose of now is the map's frame: nothing is unsure about it, but the offset is."""
        P = self.P
        P[OFFSET, :] += P[YAW, :]
        P[:, OFFSET] += P[:, YAW]
        for row in (X, Y, YAW):
            self.forget(row, 0.0)
        self.value[[X, Y]] = 0.0

    def turn_map(self, variance: float) -> None:
        """The map begins with its frame turned by an error: all that tells yaw is off it alike."""
        P = self.P
        self.forget(YAW, variance)
        P[OFFSET, OFFSET] += variance
        P[YAW, OFFSET] = P[OFFSET, YAW] = -variance
