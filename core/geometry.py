"""Rotations: angles, matrices and quaternions, in the signs of the design.

Right-handed; quaternions are w x y z and unit; R = Rz(yaw) Ry(pitch) Rx(roll), so that positive
pitch is nose down and positive roll is right side down for x forward, y left, z up.
"""

import math

import numpy as np

from core.records import F64
from jit import allocating_kernel, kernel

Rpy = tuple[float, float, float]
Rates = tuple[float, float, float]  # of turn about x, y, z, rad/s; NaN where not delivered
Quaternion = tuple[float, float, float, float]
Vector = tuple[float, float, float]
Matrix = tuple[Vector, Vector, Vector]  # rows
ORTHOGONAL = 1e-9  # how far R R' may be from the identity


def R_from_rpy(roll_rad: float, pitch_rad: float, yaw_rad: float) -> F64:
    """Rotation matrix (3, 3) of roll about x, then pitch about y, then yaw about z.

    >>> R_from_rpy(0.0, 0.1, 0.0)[2, 0] < 0  # nose down: the x axis points below the horizon
    True
    """
    cr, sr = math.cos(roll_rad), math.sin(roll_rad)
    cp, sp = math.cos(pitch_rad), math.sin(pitch_rad)
    cy, sy = math.cos(yaw_rad), math.sin(yaw_rad)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def check_rotation(R: F64) -> None:
    """Raises ValueError unless R is a proper rotation matrix (3, 3)."""
    if R.shape != (3, 3) or np.abs(R @ R.T - np.eye(3)).max() > ORTHOGONAL or np.linalg.det(R) < 0:
        raise ValueError(f"not a rotation matrix: {R.tolist()}")


def q_from_R(R: F64) -> F64:
    """Quaternion (4,) of a rotation matrix; stable for every angle (largest component first)."""
    check_rotation(R)
    trace = R[0, 0] + R[1, 1] + R[2, 2]
    squares = np.array([trace, R[0, 0], R[1, 1], R[2, 2]])
    k = int(np.argmax(squares))
    if k == 0:
        w = 0.5 * math.sqrt(1 + trace)
        q = [w, *((np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])) / (4 * w))]
    else:
        a, b, c = k - 1, k % 3, (k + 1) % 3
        big = 0.5 * math.sqrt(1 + R[a, a] - R[b, b] - R[c, c])
        q = [0.0] * 4
        q[0] = (R[c, b] - R[b, c]) / (4 * big)
        q[1 + a] = big
        q[1 + b] = (R[b, a] + R[a, b]) / (4 * big)
        q[1 + c] = (R[c, a] + R[a, c]) / (4 * big)
    return np.array(q)


@allocating_kernel
def q_from_rpy(roll_rad: float, pitch_rad: float, yaw_rad: float) -> F64:
    """Unit quaternion (4,) of roll about x, then pitch about y, then yaw about z.

    >>> np.allclose(rpy_from_q(q_from_rpy(0.1, -0.2, 3.0)), (0.1, -0.2, 3.0))
    True
    """
    cr, sr = math.cos(0.5 * roll_rad), math.sin(0.5 * roll_rad)
    cp, sp = math.cos(0.5 * pitch_rad), math.sin(0.5 * pitch_rad)
    cy, sy = math.cos(0.5 * yaw_rad), math.sin(0.5 * yaw_rad)
    return np.array(
        [
            cy * cp * cr + sy * sp * sr,
            cy * cp * sr - sy * sp * cr,
            cy * sp * cr + sy * cp * sr,
            sy * cp * cr - cy * sp * sr,
        ]
    )


@kernel
def rpy_of(w: float, x: float, y: float, z: float) -> Rpy:
    """(roll, pitch, yaw) of a unit quaternion."""
    return (
        math.atan2(2 * (y * z + w * x), 2 * (w * w + z * z) - 1),
        -math.asin(max(-1.0, min(1.0, 2 * (x * z - w * y)))),
        math.atan2(2 * (x * y + w * z), 2 * (w * w + x * x) - 1),
    )


@kernel
def turned(a: Quaternion, b: Quaternion) -> Quaternion:
    """Rotation b followed by rotation a, of unit length."""
    w = a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3]
    x = a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2]
    y = a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1]
    z = a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0]
    scale = 1.0 / math.sqrt(w * w + x * x + y * y + z * z)
    return scale * w, scale * x, scale * y, scale * z


@kernel
def q_of_turn(x: float, y: float, z: float) -> Quaternion:
    """The rotation about a vector by its length, rad."""
    angle = math.sqrt(x * x + y * y + z * z)
    half = math.sin(0.5 * angle) / angle if angle > 1e-9 else 0.5
    return math.cos(0.5 * angle), half * x, half * y, half * z


@kernel
def matrix_of(q: Quaternion) -> Matrix:
    """The rotation matrix of a unit quaternion."""
    w, x, y, z = q
    return (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )


def rpy_from_q(q: F64) -> Rpy:
    """(roll, pitch, yaw) of a unit quaternion (4,)."""
    w, x, y, z = q.tolist()
    return rpy_of(w, x, y, z)


def wrapped(angle_rad: float) -> float:
    """The same direction within -pi <= angle < pi."""
    return (angle_rad + math.pi) % (2 * math.pi) - math.pi


wrapped_in_kernels = kernel(wrapped)


def slope_of(u: F64, z: F64) -> float:
    """Of the straight line nearest in z to points (n,); 0 where all of them stand at one u.

    In plain sums: a solver of the linear algebra library may wait for threads of its own.
    """
    off = u - u.mean()
    spread = float((off * off).sum())
    return float((off * (z - z.mean())).sum()) / spread if spread > 0.0 else 0.0
