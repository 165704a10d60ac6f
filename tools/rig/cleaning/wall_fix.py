"""What a told pose lacks, by the walls of the map: a Kalman filter of x, y and yaw.

The error of the pose wanders slowly (first-order Markov, `SIGMAS` and `TIME_S`), so what the frames
before said holds for the next one: a frame that sees a strip of wall alone, at ranges that are bent
in a corner, does not move the machine. Each frame's walls are a measurement with its information N:

    d = H off + noise,  H = [[1, 0, -ly], [0, 1, lx], [0, 0, 1]]    l: from the machine to the lens

`FrameSteps` tells d with what it knew of the pose in it, C = (N + prior)^-1; that is taken out.
"""

import math

import numpy as np

from core.objects.frame.wall_lines import Correction
from core.objects.records import POSE_GATE2
from core.records import F64

SIGMAS = np.array([0.02, 0.02, 0.01])  # x, y m, yaw rad: how far the pose may be off
TIME_S = 10.0  # in which it changes
PRIOR = np.diag(SIGMAS**-2.0)


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
        H = np.eye(3)
        H[:2, 2] = -lens[1], lens[0]
        told = np.linalg.inv(by.covariance)
        N = H.T @ (told - PRIOR) @ H
        z = H.T @ told @ np.array([by.x_m, by.y_m, by.yaw_rad])  # N d: the prior's own is 0
        new = z - N @ self.off
        if new @ np.linalg.pinv(N + N @ self._P @ N) @ new > POSE_GATE2:
            return False
        gain = np.linalg.solve(np.eye(3) + self._P @ N, self._P)
        self.off = self.off + gain @ new
        self._P = 0.5 * (gain + gain.T)
        return True
