"""Rotations in the forms that an MTi sends, and between the earth frames that it knows.

Source: MTi sheet, sections 3 and 6. Euler angles: R = Rz(yaw) Ry(pitch) Rx(roll), degrees.
"""

import math

import numpy as np
import numpy.typing as npt

F64 = npt.NDArray[np.float64]

QUATERNION, EULER, MATRIX = 0, 1, 2
NWU, ENU, NED = "NWU", "ENU", "NED"
R_FROM_NWU: dict[str, F64] = {
    NWU: np.eye(3),
    ENU: np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
    NED: np.diag([1.0, -1.0, -1.0]),
}


def orientation(R: F64, kind: int) -> list[float]:
    """A rotation as a quaternion, as Euler angles in degrees, or as a matrix, column by column."""
    if kind == EULER:
        roll = math.atan2(R[2, 1], R[2, 2])
        pitch = -math.asin(max(-1.0, min(1.0, R[2, 0]))) if math.isfinite(R[2, 0]) else math.nan
        yaw = math.atan2(R[1, 0], R[0, 0])
        return [math.degrees(angle) + 0.0 for angle in (roll, pitch, yaw)]  # no -0
    if kind == MATRIX:
        return [float(value) for value in R.T.ravel()]
    return quaternion(R)


def quaternion(R: F64) -> list[float]:
    """w x y z of a rotation matrix, w not negative; by its largest part, so that none is lost."""
    xx, yy, zz = R[0, 0], R[1, 1], R[2, 2]
    parts = [1 + xx + yy + zz, 1 + xx - yy - zz, 1 - xx + yy - zz, 1 - xx - yy + zz]
    k = max(range(4), key=lambda part: parts[part])
    w, x, y = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]
    xy, xz, yz = R[0, 1] + R[1, 0], R[0, 2] + R[2, 0], R[1, 2] + R[2, 1]
    row = (
        (parts[0], w, x, y), (w, parts[1], xy, xz), (x, xy, parts[2], yz), (y, xz, yz, parts[3])
    )[k]  # fmt: skip
    scale = 0.5 / math.sqrt(parts[k])
    sign = -1.0 if row[0] < 0 else 1.0
    return [sign * scale * float(part) + 0.0 for part in row]
