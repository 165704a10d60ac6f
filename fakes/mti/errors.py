"""How wrong an attitude sensor is that keeps to its sheet: offsets, slow drifts, a false vertical.

What makes the roll and pitch of a moving sensor wrong is that it takes the mean direction of what
it feels over some seconds for the vertical: it leans when the robot brakes, and in long curves.

Source: MTi sheet, section 7: 0.5 deg of roll and pitch and 1 deg of heading at rest, 2 deg rms
while it moves, noise of 0.05 deg/s and 0.002 m/s2 by the root of the bandwidth, 40 and 30 Hz. How
fast it leans, and what bias the calibrated values have, are our assumptions.
"""

import math

import numpy as np

from fakes.mti.kernels import believed, go_on, turn_about
from fakes.wires.timing import F64

STATIC_RAD, HEADING_RAD = math.radians(0.5), math.radians(1.0)  # bounds: two sigmas
LEAN_S = 4.0  # time constant with which it takes what it feels for the vertical: a full brake from
# 1 m/s at 0.8 m/s2 makes 1.3 deg of it
WANDER_RAD, WANDER_S = math.radians(0.1), 20.0  # of roll and pitch besides, 1 sigma, and how slowly
RATE_BIAS_RADPS, ACCEL_BIAS_MPS2 = math.radians(0.1), 0.02  # 1 sigma of each axis
RATE_DRIFT_RADPS, DRIFT_S = math.radians(0.03), 120.0  # of the rates' bias, 1 sigma
RATE_NOISE_RADPS = math.radians(0.05) * math.sqrt(40.0 * math.pi / 2)
ACCEL_NOISE_MPS2 = 0.002 * math.sqrt(30.0 * math.pi / 2)
HEADING_S = 60.0  # how slowly the heading's error wanders
TIMES_S = np.array([WANDER_S, WANDER_S, HEADING_S, DRIFT_S, DRIFT_S, DRIFT_S])
WANDERS_RAD = np.array([WANDER_RAD, WANDER_RAD, HEADING_RAD / 2])  # lean 2, heading
LONGEST_S = 1.0  # a gap between two samples counts as no longer


class SheetErrors:
    """The errors of one sensor in one run; to be asked at instants that grow."""

    def __init__(self, seed: int) -> None:
        self._random = random = np.random.default_rng([seed, 7])
        roll, pitch = np.clip(random.normal(0.0, STATIC_RAD / 2, 2), -STATIC_RAD, STATIC_RAD)
        self._R_case = turn_about(roll, pitch, 0.0)
        self._rate_bias_radps = random.normal(0.0, RATE_BIAS_RADPS, 3)
        self.accel_bias_mps2: F64 = random.normal(0.0, ACCEL_BIAS_MPS2, 3)
        self._lean_rad = np.zeros(2)  # about north and west
        self._wander = random.normal(0.0, 1.0, 6)  # lean 2, heading 1, rate of turn 3; in sigmas
        self._at_s: float | None = None

    def goes_on(self, t_s: float, R_earth_sensor: F64, accel_mps2: F64) -> None:
        """Up to an instant, at which the truth is this."""
        gone_s = 0.0 if self._at_s is None else min(LONGEST_S, max(0.0, t_s - self._at_s))
        if self._at_s is None or t_s > self._at_s:
            self._at_s = t_s
        if gone_s == 0.0:
            return
        noise = self._random.standard_normal(6)
        go_on(
            gone_s, R_earth_sensor, accel_mps2, LEAN_S, self._lean_rad, TIMES_S, self._wander, noise
        )

    @property
    def rate_bias_radps(self) -> F64:
        return np.asarray(self._rate_bias_radps + RATE_DRIFT_RADPS * self._wander[3:])

    def orientation(self, R_earth_sensor: F64) -> F64:
        """What it takes the true orientation (3, 3) for, now."""
        return believed(R_earth_sensor, self._lean_rad, self._wander, WANDERS_RAD, self._R_case)
