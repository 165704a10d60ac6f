"""A pinhole camera's matrix to the ray of each pixel. The sensor frame: x ahead, y left, z up.

Images are rectified: no distortion is left in them, as in public data sets; a Kinect's is small.
"""

import math

import numpy as np
from msgspec import Struct

from core.records import F32, DepthCamera

LEAST_FIELD, MOST_FIELD = math.radians(10.0), math.radians(150.0)


class Pinhole(Struct, frozen=True):
    """What the pixels see; u to the right, v down, from the middle of the top left pixel."""

    size_px: tuple[int, int]  # width, height
    focal_px: tuple[float, float]
    centre_px: tuple[float, float]
    unit_m: float  # of an image's numbers
    is_along_ray: bool  # they count along each ray; else along the optical axis
    is_mirrored: bool  # left and right are exchanged, as OpenNI does


def fault_of(lens: Pinhole) -> str:
    """Why such a lens can't be; "" if it can."""
    for name, size, focal, centre in zip(
        ("x", "y"), lens.size_px, lens.focal_px, lens.centre_px, strict=True
    ):
        sees = 2.0 * math.atan2(size / 2.0, focal)
        if not (LEAST_FIELD <= sees <= MOST_FIELD and 0.0 <= centre <= size):
            return (
                f"a camera matrix that can't be: f{name} {focal:g}, c{name} {centre:g} for {size} "
                "px; it must see 10 .. 150 deg, and have its centre in the image"
            )
    return ""


def camera_of(lens: Pinhole) -> DepthCamera:
    """Rays (rows, columns, 3) of a lens that can be."""
    (width, height), (fx, fy), (cx, cy) = lens.size_px, lens.focal_px, lens.centre_px
    left = (cx - np.arange(width)) / fx * (-1.0 if lens.is_mirrored else 1.0)
    up = ((cy - np.arange(height)) / fy)[:, None]
    along = np.full((height, width), lens.unit_m)
    if lens.is_along_ray:
        along /= np.sqrt(left * left + up * up + 1.0)
    rays: F32 = np.empty((height, width, 3), np.float32)
    rays[..., 0], rays[..., 1], rays[..., 2] = along, left * along, up * along
    rays.setflags(write=False)
    return DepthCamera(rays, (0.0, 0.0, 0.0))
