"""A camera's description to the ray of each pixel, float32: computed once for each description.

The camera's axes are z ahead, and x and y to where its focal lengths are positive: left and up, or
right and down where they are negative. The sensor frame has x ahead, y left, z up.
Source: visionary sheet, section 6.
"""

import math

import numpy as np

from core.records import F32, DepthCamera
from hw.visionary.description import Description

MM = 1e-3  # metres


def camera_of(told: Description) -> DepthCamera | str:
    """Rays and offset in the sensor frame; or why there are none, in words."""
    (fx, fy), (cx, cy), (k1, k2) = told.focal_px, told.centre_px, told.distortion
    x = (cx - np.arange(told.width)) / fx
    y = ((cy - np.arange(told.height)) / fy)[:, None]
    unit_m = MM * told.unit_mm
    square = x * x + y * y
    bend = np.ones_like(square) if told.is_planar else 1.0 + k1 * square + k2 * square * square
    slope = 1.0 + 3.0 * k1 * square + 5.0 * k2 * square * square
    if not told.is_planar and not (bend.min() > 0.0 and slope.min() > 0.0):
        return f"the camera's distortion folds its image: K1 {k1:g}, K2 {k2:g}"
    along = np.full_like(bend, unit_m)
    if not told.is_planar:
        along /= np.sqrt((x * bend) ** 2 + (y * bend) ** 2 + 1.0)
    left, up = math.copysign(1.0, fx), math.copysign(1.0, fy)
    rays: F32 = np.empty((told.height, told.width, 3), np.float32)
    rays[..., 0] = along
    rays[..., 1] = left * x * bend * along
    rays[..., 2] = up * y * bend * along
    rays.setflags(write=False)
    x_mm, y_mm, ahead_mm = told.away_mm
    return DepthCamera(rays, (MM * ahead_mm, MM * left * x_mm, MM * up * y_mm))
