"""The error state of heading and position: what is estimated, and how sure that is.

Ten numbers with one covariance. `value` holds what is owed to the told pose (position and yaw), and
the constants of the sensors as estimated so far; `P` is the covariance of their errors (truth minus
estimate). Position is that at the newest wheel counts, yaw that of the newest attitude: the few
centiseconds between them are left out.
Source: error-state (indirect) Kalman filter, scalar measurements one after another.
"""

import math

import numpy as np

from core.records import F64
from jit import kernel

SIZE = 10
X, Y, YAW = 0, 1, 2  # m, m, rad: what the told pose is to be corrected by; map frame
BIAS = 3  # rad/s, of the gyro's rate about the vertical
OFFSET = 4  # rad, of the sensor's own yaw against the filter's, beyond what is known of it
SCALE = 5  # relative: true travel is (1 + SCALE) times that of the wheels
ASYMMETRY = 6  # relative: how much larger the right wheel is than the left one
ALIGN_X, ALIGN_Y, ALIGN_YAW = 7, 8, 9  # of a positioning system's frame in the map frame

START_BIAS_RADPS = math.radians(0.5)
START_SCALE = 0.04
START_ASYMMETRY = 0.005


@kernel
def _turn(
    P: F64, biased_s: float, yaw_var: float, bias_var: float, kept: float, var: float
) -> None:
    """Time passes: the yaw's error grows with the bias's, the offset's returns to its middle."""
    for n in range(SIZE):
        P[YAW, n] -= biased_s * P[BIAS, n]
        P[OFFSET, n] *= kept
    for n in range(SIZE):
        P[n, YAW] -= biased_s * P[n, BIAS]
        P[n, OFFSET] *= kept
    P[YAW, YAW] += yaw_var
    P[BIAS, BIAS] += bias_var
    P[OFFSET, OFFSET] += var


@kernel
def _travel(P: F64, dx_m: float, dy_m: float, along_var: float, across_var: float) -> None:
    """A level step: heading and scale errors become errors of position, and some is added."""
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
def _correct(P: F64, value: F64, h: F64, innovation: float, variance: float) -> None:
    """One scalar measurement: innovation = h . error + noise of that variance."""
    Ph = np.zeros(SIZE)
    spread = variance
    for i in range(SIZE):
        for n in range(SIZE):
            Ph[i] += P[i, n] * h[n]
        spread += h[i] * Ph[i]
    for i in range(SIZE):
        value[i] += Ph[i] / spread * innovation
        for n in range(SIZE):
            P[i, n] -= Ph[i] * Ph[n] / spread


class ErrorState:
    """`value` (10,) and `P` (10, 10), in the order of the names above; units of each as there."""

    def __init__(self) -> None:
        self.value = np.zeros(SIZE)
        self.P = np.zeros((SIZE, SIZE))
        self.P[BIAS, BIAS] = START_BIAS_RADPS**2
        self.P[SCALE, SCALE] = START_SCALE**2
        self.P[ASYMMETRY, ASYMMETRY] = START_ASYMMETRY**2

    def turn(
        self, biased_s: float, yaw_var: float, bias_var: float, kept: float, offset_var: float
    ) -> None:
        """Let time pass; variances are what that adds, `kept` is what stays of the offset.

        `biased_s` is for how long yaw was moved by the gyro, whose bias becomes its error.
        """
        _turn(self.P, biased_s, yaw_var, bias_var, kept, offset_var)
        self.value[OFFSET] *= kept

    def travel(self, dx_m: float, dy_m: float, along_var: float, across_var: float) -> None:
        """Go on by a step in the map frame; variances (m2) along and across it are added."""
        _travel(self.P, dx_m, dy_m, along_var, across_var)

    def correct(self, h: F64, innovation: float, variance: float) -> None:
        """Take a measurement: `innovation` is measured minus expected, = h (10,) . error + noise.

        The variance of the noise must be positive.
        """
        _correct(self.P, self.value, h, innovation, variance)

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
        self.P = left @ self.P @ left.T + variance * np.outer(gain, gain)

    def spread_of_sum(self, one: int, other: int) -> float:
        """Variance of the sum of two errors."""
        P = self.P.item
        return (P(one, one) + P(other, one)) + (P(one, other) + P(other, other))

    def spread(self, h: F64) -> float:
        """Variance of h . error."""
        return float(h @ self.P @ h)

    def define(self, row: int, like: int, sign: float, variance: float) -> None:
        """Begin a state anew: its error is `sign` times that of `like`, and noise of its own."""
        P = self.P
        if row != like:
            P[row, :] = sign * P[like, :]
            P[:, row] = P[row, :]
            P[row, row] = P[like, like]
        P[row, row] += variance

    def forget(self, row: int, variance: float) -> None:
        """Begin a state anew that has to do with no other one."""
        self.P[row, :] = 0.0
        self.P[:, row] = 0.0
        self.P[row, row] = variance

    def begin_map(self) -> None:
        """The pose of now is the map's frame: nothing is unsure about it, but the offset is."""
        P = self.P
        P[OFFSET, :] += P[YAW, :]
        P[:, OFFSET] += P[:, YAW]
        for row in (X, Y, YAW):
            self.forget(row, 0.0)
        self.value[[X, Y]] = 0.0
