"""Rotations as the world has them: R = Rz(yaw) Ry(pitch) Rx(roll), right-handed, radians."""

import math

import numpy as np
import numpy.typing as npt

F64 = npt.NDArray[np.float64]


def R_from_angles(yaw: F64, pitch: F64, roll: F64) -> F64:
    """Rotation matrices (n, 3, 3) of angles (n,)."""
    cy, sy, cp, sp = np.cos(yaw), np.sin(yaw), np.cos(pitch), np.sin(pitch)
    cr, sr = np.cos(roll), np.sin(roll)
    rows = (
        (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
        (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
        (-sp, cp * sr, cp * cr),
    )
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def rotation_y(angle_rad: float) -> F64:
    """(3, 3): positive lowers what is ahead."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def rotation_z(angle_rad: float) -> F64:
    """(3, 3): positive turns to the left."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
