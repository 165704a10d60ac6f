"""Where beams enter and leave boxes and cylinders, in closed formulas over whole sweeps."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

F64 = npt.NDArray[np.float64]
TINY = 1e-12  # instead of a zero that something is divided by


class Beams(NamedTuple):
    """Begins (n, 3), metres, and directions (n, 3) of unit length, one frame."""

    begins: F64
    directions: F64


def across_box(beams: Beams, low: F64, high: F64) -> tuple[F64, F64, F64]:
    """Where beams cross an upright box, or one box a beam; inf where they do not.

    Args:
        low, high: corners, (3,) or (n, 3).

    Returns:
        (n,) way to where they enter, 0 from inside; way to where they leave; cosine of the angle
        to the normal of the side where they enter.
    """
    steps = np.where(np.abs(beams.directions) < TINY, TINY, beams.directions)
    ways = np.stack([(low - beams.begins) / steps, (high - beams.begins) / steps])
    enters, leaves = ways.min(axis=0), ways.max(axis=0)
    side = np.argmax(enters, axis=1)
    enter, leave = np.maximum(enters.max(axis=1), 0.0), leaves.min(axis=1)
    cosine = np.abs(np.take_along_axis(beams.directions, side[:, None], axis=1)[:, 0])
    is_met = enter < leave
    return np.where(is_met, enter, np.inf), np.where(is_met, leave, np.inf), cosine


def across_cylinder(
    beams: Beams, middles: F64, radius_m: float, z: tuple[float, float]
) -> tuple[F64, F64]:
    """Where beams enter (n,), 0 from inside, and leave (n,) an upright cylinder; else inf.

    Args:
        middles: x, y (n, 2), one a beam.
    """
    away, ahead = beams.begins[:, :2] - middles, beams.directions[:, :2]
    a = np.maximum((ahead**2).sum(axis=1), TINY)
    b = (away * ahead).sum(axis=1)
    inside = b**2 - a * ((away**2).sum(axis=1) - radius_m**2)
    half = np.sqrt(np.maximum(inside, 0.0))
    rise = beams.directions[:, 2]
    rise = np.where(np.abs(rise) < TINY, TINY, rise)
    caps = np.stack([(end - beams.begins[:, 2]) / rise for end in z])
    enter = np.maximum(np.maximum((-b - half) / a, caps.min(axis=0)), 0.0)
    leave = np.minimum((-b + half) / a, caps.max(axis=0))
    is_met = (inside > 0.0) & (enter < leave)
    return np.where(is_met, enter, np.inf), np.where(is_met, leave, np.inf)
