"""What something that stands says of a told pose: how far it is off, as information.

M off = y, off: x m, y m, yaw rad, to be added to the told pose, map frame. M is the inverse of
their covariance, and singular where nothing is told: along a single wall, say. A turn about a point
at l from the body moves the body as well:

    off there = H off of the body,  H = [[1, 0, -ly], [0, 1, lx], [0, 0, 1]]
"""

import numpy as np
from msgspec import Struct

from core.records import F64

GATE2 = 11.3  # chi-square, 3 degrees of freedom, 1 %: what is farther off is something else


class PoseFix(Struct, frozen=True, eq=False):
    """Information M (3, 3) and y (3,) of one frame."""

    M: F64
    y: F64

    @classmethod
    def of(cls, off: F64, covariance: F64, sigmas: tuple[float, float]) -> "PoseFix":
        """Of an estimate (3,) that has in it that the pose is off by 0, to within sigmas.

        Args:
            sigmas: of x as of y, m, and of yaw, rad.
        """
        whole = np.linalg.inv(covariance)
        prior = np.diag([sigmas[0] ** -2.0, sigmas[0] ** -2.0, sigmas[1] ** -2.0])
        return cls(np.asarray(whole - prior, np.float64), np.asarray(whole @ off, np.float64))

    def of_body(self, lever_m: F64, owed: F64) -> "PoseFix":
        """Of the body, if this is of a point at (2,) from it, beyond what is owed (3,) already."""
        H = np.eye(3)
        H[:2, 2] = -lever_m[1], lever_m[0]
        M = H.T @ self.M @ H
        return PoseFix(M, H.T @ self.y - M @ owed)

    def fits(self, P: F64) -> bool:
        """Whether a pose of such a covariance (3, 3) can be off by so much."""
        return bool(self.y @ np.linalg.pinv(self.M + self.M @ P @ self.M) @ self.y <= GATE2)
