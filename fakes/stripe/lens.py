"""The fake camera's lens: from pixels to rays, and from points to pixels.

Axes of the camera: x ahead along its optical axis, y left, z up. Source: OpenCV's documentation,
Camera Calibration and 3D Reconstruction.
"""

import numpy as np

from fakes.stripe.faults import Faults
from fakes.wires.timing import F64

ITERATIONS = 30  # of the way back through the distortion
LEAST_AHEAD_M = 1e-6


def _bent(faults: Faults, right: F64, down: F64) -> tuple[F64, F64]:
    """Where the lens puts slopes (n,) to the right and down."""
    k1, k2, p1, p2, k3 = faults.distortion
    square = right**2 + down**2
    radial = 1 + k1 * square + k2 * square**2 + k3 * square**3
    bent_right = right * radial + 2 * p1 * right * down + p2 * (square + 2 * right**2)
    bent_down = down * radial + p1 * (square + 2 * down**2) + 2 * p2 * right * down
    return bent_right, bent_down


def pixels_from_points(faults: Faults, points: F64) -> tuple[F64, F64]:
    """Columns and rows (n,) of points (n, 3) in the camera's axes; NaN behind it."""
    ahead = np.where(points[:, 0] > LEAST_AHEAD_M, points[:, 0], np.nan)
    right, down = _bent(faults, -points[:, 1] / ahead, -points[:, 2] / ahead)
    (fx, fy), (cx, cy) = faults.focal_px, faults.centre_px
    return cx + fx * right, cy + fy * down


def ways_from_pixels(faults: Faults, columns: F64, rows: F64) -> F64:
    """Ways (n, 3) of unit length in the camera's axes, of pixels (n,)."""
    (fx, fy), (cx, cy) = faults.focal_px, faults.centre_px
    goal_right, goal_down = (columns - cx) / fx, (rows - cy) / fy
    right, down = goal_right.copy(), goal_down.copy()
    for _ in range(ITERATIONS):
        bent_right, bent_down = _bent(faults, right, down)
        right, down = right + goal_right - bent_right, down + goal_down - bent_down
    ways = np.stack([np.ones_like(right), -right, -down], axis=1)
    return np.asarray(ways / np.linalg.norm(ways, axis=1)[:, None])
