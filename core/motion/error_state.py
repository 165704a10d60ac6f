"""The error state of heading and position: what is estimated, and how sure that is.

Ten numbers with one covariance. `value` holds what is owed to the told pose (position and yaw), and
the constants of the sensors as estimated so far; `P` is the covariance of their errors (truth minus
estimate). Position is that at the newest wheel counts, yaw that of the newest attitude: the few
centiseconds between them are left out.
Source: error-state (indirect) Kalman filter, scalar measurements one after another.
"""

import math

import numpy as np

from core.motion.kalman import begin
from core.motion.kalman import correct as take
from core.records import F64
from jit import Records, allocating_kernel, kernel, records

SIZE = 10
X, Y, YAW = 0, 1, 2  # m, m, rad: what the told pose is to be corrected by; map frame
BIAS = 3  # rad/s, of the gyro's rate about the vertical
OFFSET = 4  # rad, of the sensor's own yaw against the filter's, beyond what is known of it
SCALE = 5  # relative: true travel is (1 + SCALE) times that of the wheels
ASYMMETRY = 6  # relative: how much larger the right wheel is than the left one
ALIGN_X, ALIGN_Y, ALIGN_YAW = 7, 8, 9  # of a positioning system's frame in the map frame

ERRORS = np.dtype([("value", np.float64, SIZE), ("P", np.float64, (SIZE, SIZE))])
START_BIAS_RADPS = math.radians(0.5)
START_SCALE = 0.04
START_ASYMMETRY = 0.005


@kernel
def turn(
    P: F64, value: F64, biased_s: float, yaw_var: float, bias_var: float, kept: float, var: float
) -> None:
    """Time passes: the yaw's error grows with the bias's, the offset's returns to its middle.

    Variances are what that adds, `kept` is what stays of the offset. `biased_s` is for how long yaw
    was moved by the gyro, whose bias becomes its error.
    """
    for n in range(SIZE):
        P[YAW, n] -= biased_s * P[BIAS, n]
        P[OFFSET, n] *= kept
    for n in range(SIZE):
        P[n, YAW] -= biased_s * P[n, BIAS]
        P[n, OFFSET] *= kept
    P[YAW, YAW] += yaw_var
    P[BIAS, BIAS] += bias_var
    P[OFFSET, OFFSET] += var
    value[OFFSET] *= kept


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


@allocating_kernel
def correct(P: F64, value: F64, h: F64, innovation: float, variance: float) -> None:
    """One scalar measurement: innovation, measured minus expected, = h (10,) . error + noise.

    The variance of the noise must be positive.
    """
    take(P, value, h, innovation, variance, np.zeros(SIZE))


@kernel
def spread_of_sum(P: F64, one: int, other: int) -> float:
    """Variance of the sum of two errors."""
    return float((P[one, one] + P[other, one]) + (P[one, other] + P[other, other]))


@kernel
def define(P: F64, row: int, like: int, sign: float, variance: float) -> None:
    """Begin a state anew: its error is `sign` times that of another, and noise of its own."""
    for n in range(SIZE):
        P[row, n] = sign * P[like, n]
    for n in range(SIZE):
        P[n, row] = P[row, n]
    P[row, row] = P[like, like] + variance


@kernel
def forget(P: F64, row: int, variance: float) -> None:
    """Begin a state anew that has to do with no other one."""
    begin(P, row, variance)


class ErrorState:
    """`value` (10,) and `P` (10, 10), in the order of the names above; units of each as there.

    They lie in `record` (1,), of ERRORS.
    """

    def __init__(self, record: Records | None = None) -> None:
        self.record = record = records(ERRORS) if record is None else record
        self.value: F64 = record["value"][0]
        self.P: F64 = record["P"][0]
        self.P[BIAS, BIAS] = START_BIAS_RADPS**2
        self.P[SCALE, SCALE] = START_SCALE**2
        self.P[ASYMMETRY, ASYMMETRY] = START_ASYMMETRY**2

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
        forget(self.P, row, variance)

    def begin_map(self) -> None:
        """The pose of now is the map's frame: nothing is unsure about it, but the offset is."""
        P = self.P
        P[OFFSET, :] += P[YAW, :]
        P[:, OFFSET] += P[:, YAW]
        for row in (X, Y, YAW):
            self.forget(row, 0.0)
        self.value[[X, Y]] = 0.0
