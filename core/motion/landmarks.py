"""What stands corrects the pose: walls that a map of objects knows, seen by a depth camera.

Each look tells how far the told pose is off, as information (`core/pose_fix.py`). It goes into the
place and the heading alone, for its errors hang together: those of looks within ALIKE_S are one,
and a map that is askew turns every look at it alike. A look that does not fit was at something
else, or wheels have slipped unseen. It is left out, and makes the pose less sure: what stays will
fit.
Source: scalar measurements one after another, along the principal axes of their information;
gate by chi-square; Schmidt's filter for the states that are left as they are.
"""

import math

import numpy as np

from core.motion.error_state import SIZE, YAW, ErrorState, X, Y, travel
from core.pose_fix import PoseFix
from core.records import F64

ALIKE_S = 1.0  # looks at the same walls within that err alike
SLIPPED_M, TURNED_RAD = 0.05, math.radians(1.0)  # a second of looks that do not fit: less sure
NOTHING_TOLD = 1e-3  # information of less than that is rounding: 30 m, or 30 rad, at 1 sigma
POSE = (X, Y, YAW)


class Landmarks:
    """Looks at what stands, one after the other, into an error state."""

    def __init__(self, state: ErrorState) -> None:
        self._state, self._newest_s = state, -math.inf

    @property
    def owed(self) -> F64:
        """By what (3,) the told x, y (m) and yaw (rad) are still to be corrected, map frame."""
        return self._state.value[list(POSE)].copy()

    def take(self, fix: PoseFix, at_s: float) -> bool:
        """A look at an instant, at what the told pose was off then; False: it does not fit."""
        share = min(1.0, max(0.0, at_s - self._newest_s) / ALIKE_S)
        self._newest_s, P = at_s, self._state.P
        if not fix.fits(P[:3, :3]):
            travel(P, 0.0, 0.0, share * SLIPPED_M**2, 0.0)
            P[YAW, YAW] += share * TURNED_RAD**2
            return False
        told, axes = np.linalg.eigh(share * fix.M)
        values, before = axes.T @ (share * fix.y), self.owed
        for information, axis, value in zip(told, axes.T, values, strict=True):
            if information > NOTHING_TOLD:
                h = np.zeros(SIZE)
                h[list(POSE)] = axis
                new = float(value) / information - float(axis @ (self.owed - before))
                self._state.correct_some(POSE, h, new, 1.0 / information)
        return True
