"""Kernels of the world's memory: a ring of rows, one a step, asked at any instants.

A row (m,) begins with the body's place x y z and its quaternion w x y z, of any length. Instants
are counted in steps since the world's begin; before the oldest row and behind the newest that row
holds.
"""

import math

import numpy as np

from fakes.rays.kernels import F64
from jit import allocating_kernel, kernel


@kernel
def _neighbours(kept: int, steps: int, step: float) -> tuple[int, int, float]:
    """Places in the ring of the rows around an instant, and the later one's share."""
    oldest = max(0, steps - kept + 1)
    step = min(max(step, float(oldest)), float(steps))
    before = min(int(step), max(oldest, steps - 1))
    return before % kept, min(before + 1, steps) % kept, step - before


@allocating_kernel
def row_at(ring: F64, steps: int, step: float) -> F64:
    """The row (m,) at an instant, interpolated."""
    before, after, share = _neighbours(len(ring), steps, step)
    row = np.empty(ring.shape[1])
    for k in range(len(row)):
        row[k] = (1.0 - share) * ring[before, k] + share * ring[after, k]
    return row


@kernel
def _rotation_from(row: F64, R: F64) -> None:
    """Put the rotation of a row's quaternion into R (3, 3)."""
    w, x, y, z = row[3], row[4], row[5], row[6]
    scale = 1.0 / math.sqrt(w * w + x * x + y * y + z * z)
    w, x, y, z = w * scale, x * scale, y * scale, z * scale
    ww, xx, yy, zz = w * w, x * x, y * y, z * z
    R[0, 0], R[1, 1], R[2, 2] = ww + xx - yy - zz, ww - xx + yy - zz, ww - xx - yy + zz
    R[0, 1], R[1, 0] = 2 * (x * y - w * z), 2 * (x * y + w * z)
    R[0, 2], R[2, 0] = 2 * (x * z + w * y), 2 * (x * z - w * y)
    R[1, 2], R[2, 1] = 2 * (y * z - w * x), 2 * (y * z + w * x)


@allocating_kernel
def pose_at(row: F64) -> tuple[float, float, float, float, float]:
    """(x, y, yaw, pitch, roll) of a row: nose down and right side down are positive."""
    R = np.empty((3, 3))
    _rotation_from(row, R)
    pitch = -math.asin(max(-1.0, min(1.0, R[2, 0])))
    return row[0], row[1], math.atan2(R[1, 0], R[0, 0]), pitch, math.atan2(R[2, 1], R[2, 2])


@allocating_kernel
def motion_at(ring: F64, steps: int, step: float, R_earth_map: F64) -> tuple[F64, F64, F64]:
    """R_earth_body (3, 3), and columns 9..11 and 12..14 (3,) of the row, at an instant."""
    row, R, R_earth_body = row_at(ring, steps, step), np.empty((3, 3)), np.zeros((3, 3))
    _rotation_from(row, R)
    for i in range(3):
        for j in range(3):
            for k in range(3):
                R_earth_body[i, j] += R_earth_map[i, k] * R[k, j]
    return R_earth_body, row[9:12].copy(), row[12:15].copy()


@allocating_kernel
def rows_at(ring: F64, known_s: F64, steps: int, times_s: F64) -> F64:
    """Rows (n, k, m) of a ring (KEPT, k, m) at instants (n,), interpolated.

    Args:
        known_s: (KEPT,) instants of the rows, of which `steps` were written so far, at least one.
    """
    kept, n = len(ring), len(times_s)
    count = min(steps, kept)
    rows = np.empty((n, ring.shape[1], ring.shape[2]))
    for i in range(n):
        after = min(1, count - 1)
        while after < count - 1 and known_s[(steps - count + after) % kept] < times_s[i]:
            after += 1
        a, b = (steps - count + max(after - 1, 0)) % kept, (steps - count + after) % kept
        span_s = max(known_s[b] - known_s[a], 1e-9)
        share = min(max((times_s[i] - known_s[a]) / span_s, 0.0), 1.0) if a != b else 1.0
        for k in range(ring.shape[1]):
            for part in range(ring.shape[2]):
                rows[i, k, part] = (1 - share) * ring[a, k, part] + share * ring[b, k, part]
    return rows


@allocating_kernel
def poses_at(ring: F64, steps: int, at_steps: F64) -> tuple[F64, F64]:
    """t_map_body (n, 3) and R_map_body (n, 3, 3) at instants (n,), interpolated."""
    n = len(at_steps)
    places, turns, part = np.empty((n, 3)), np.empty((n, 3, 3)), np.empty(7)
    for i in range(n):
        before, after, share = _neighbours(len(ring), steps, at_steps[i])
        for k in range(7):
            part[k] = (1.0 - share) * ring[before, k] + share * ring[after, k]
        for k in range(3):
            places[i, k] = part[k]
        _rotation_from(part, turns[i])
    return places, turns
