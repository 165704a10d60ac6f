"""What a told pose lacks, by the walls of the map: a Kalman filter of x, y and yaw.

The error of the pose wanders slowly (first-order Markov, `SIGMAS` and `TIME_S`), so what the frames
before said holds for the next one: a frame that sees a strip of wall alone, at ranges that are bent
in a corner, does not move the machine.
"""

import math

import numpy as np

from core.objects.frame.wall_lines import Correction
from core.pose_fix import PoseFix
from core.records import F64

SIGMAS = np.array([0.02, 0.02, 0.01])  # x, y m, yaw rad: how far the pose may be off
TIME_S = 10.0  # in which it changes


class WallFix:
    """The error of a pose that something else tells; 0 at first, and known to be."""

    def __init__(self) -> None:
        self.off, self._P = np.zeros(3), np.zeros((3, 3))

    def step(self, dt_s: float) -> None:
        keep = math.exp(-dt_s / TIME_S)
        self.off *= keep
        self._P = keep * keep * self._P + (1.0 - keep * keep) * np.diag(SIGMAS**2)

    def measure(self, by: Correction, lens: F64) -> bool:
        """One frame's walls; `lens` (2,) m from the machine, map frame. Whether it is believed."""
        off, sigmas = np.array([by.x_m, by.y_m, by.yaw_rad]), (float(SIGMAS[0]), float(SIGMAS[2]))
        new = PoseFix.of(off, by.covariance, sigmas).of_body(lens, self.off)
        if not new.fits(self._P):
            return False
        P = np.linalg.solve(np.eye(3) + self._P @ new.M, self._P)
        self.off = self.off + P @ new.y
        self._P = 0.5 * (P + P.T)
        return True
