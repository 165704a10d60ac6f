"""Steel that bends the earth's magnetic field around it.

Not a field that solves Maxwell's equations: the horizontal part turns and grows, the upright part
shrinks, most at the steel and fading with the distance, so that heading, strength and dip are all
wrong together, as beside a steel door.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fakes.world.rotations import F64, rotation_z


@dataclass(frozen=True, slots=True)
class MagneticDisturbance:
    """A piece of steel at a place x, y of the map.

    Args:
        yaw_rad: by how much the horizontal field is turned at the place itself, left positive.
        reach_m: where of that a share of 1/e is left; at twice the reach 2 %.
        strength: share by which the horizontal part grows and the upright part shrinks there.
    """

    name: str
    at: tuple[float, float]
    yaw_rad: float
    reach_m: float = 1.5
    strength: float = 0.3


def distortion(steels: Sequence[MagneticDisturbance], x_m: float, y_m: float) -> F64:
    """What (3, 3) all steel makes of the field (north, west, up) at a place of the map."""
    bent = np.eye(3)
    for steel in steels:
        away_m = math.hypot(x_m - steel.at[0], y_m - steel.at[1])
        nearness = math.exp(-((away_m / steel.reach_m) ** 2))
        more, less = 1.0 + steel.strength * nearness, 1.0 - steel.strength * nearness
        bent = rotation_z(steel.yaw_rad * nearness) @ np.diag([more, more, less]) @ bent
    return bent
