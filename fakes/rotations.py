"""Rotations as the world has them: R = Rz(yaw) Ry(pitch) Rx(roll), right-handed, radians."""

import math
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt

F64 = npt.NDArray[np.float64]
mj: Any = mujoco  # compiled: it comes without types


def R_from_q(q: F64) -> F64:
    """Rotation matrix (3, 3) of a quaternion (4,) w x y z, which need not be of unit length."""
    flat, unit = np.empty(9), q / np.sqrt(q @ q)
    mj.mju_quat2Mat(flat, unit)
    return flat.reshape(3, 3)


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


def angles_from_R(R: F64) -> tuple[float, float, float]:
    """(yaw, pitch, roll) of a matrix (3, 3): nose down and right side down are positive."""
    yaw = math.atan2(R[1, 0], R[0, 0])
    pitch = -math.asin(max(-1.0, min(1.0, R[2, 0])))
    return yaw, pitch, math.atan2(R[2, 1], R[2, 2])
