"""The fake camera's lens: the way of each pixel. Body axes: x ahead, y left, z up.

Source: visionary sheet, section 6.
"""

import math
from typing import NamedTuple

import numpy as np

from fakes.visionary.models import Kind
from fakes.wires.timing import F64
from fakes.world.rotations import rotation_y


class Lens(NamedTuple):
    """What the pixels see, at the size that is sent."""

    size_px: tuple[int, int]
    focal_px: tuple[float, float]  # of either sign
    centre_px: tuple[float, float]
    distortion: tuple[float, float]


def lens_of(kind: Kind, halvings: int) -> Lens:
    """The same lens before a sensor whose pixels are put together in pairs, so often."""
    step = 2**halvings
    (w, h), (fx, fy), (cx, cy) = kind.size_px, kind.focal_px, kind.centre_px
    centre = ((cx + 0.5) / step - 0.5, (cy + 0.5) / step - 0.5)
    return Lens((w // step, h // step), (fx / step, fy / step), centre, kind.distortion)


def ways_of(lens: Lens, tilt_deg: float) -> F64:
    """(rows * columns, 3) of unit length, row by row, of a camera that looks down so much."""
    (w, h), (fx, fy), (cx, cy), (k1, k2) = lens
    columns, rows = np.meshgrid(np.arange(w, dtype=float), np.arange(h, dtype=float))
    right, down = (columns - cx) / abs(fx), (rows - cy) / abs(fy)
    square = right**2 + down**2
    bend = 1 + k1 * square + k2 * square**2
    ways = np.stack([np.ones_like(right), -right * bend, -down * bend], axis=2).reshape(-1, 3)
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    return np.ascontiguousarray(ways @ rotation_y(math.radians(tilt_deg)).T)


def axis_of(tilt_deg: float) -> F64:
    """The way of the optical axis, (3,)."""
    return np.asarray(rotation_y(math.radians(tilt_deg))[:, 0])
