"""What one frame of a depth camera tells, in the map frame: objects, walls, space seen through.

A frame's steps fill these records, the map of objects reads them. Metres; heights above the floor.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


class Detection(NamedTuple):
    """One object as a frame saw it."""

    polygon: Floats  # (n, 2) m, counter-clockwise, simple, first corner not repeated
    bottom_m: float  # its lowest point, above the floor
    top_m: float  # its highest one
    points: int  # points of the frame that it stands on, behind voxel thinning
    is_cut: bool = False  # the image ends right above: it may be taller


class FrameObjects(NamedTuple):
    """All that a frame tells. What lies outside `view` was not seen, and nothing is said of it."""

    at_s: float  # the frame's own time, host monotonic
    origin: tuple[float, float]  # m, the lens over the floor
    # (n, 2) m, counter-clockwise: what rays passed through down to the floor. Each bearing from
    # `origin` has one stretch of it, from where floor is seen first: `origin` itself lies outside
    view: Floats
    detections: tuple[Detection, ...]
    walls: Floats  # (n, 4) m: segments x1, y1, x2, y2 of long upright planes
