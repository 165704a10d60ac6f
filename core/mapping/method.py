"""What a mapping method gives to the rest of the app, whichever it is."""

from typing import Protocol

import numpy as np

from core.grid.window import ObstacleWindow
from core.mapping.causes import LOW_GROUND
from core.mapping.freshness import Freshness
from core.mapping.layers import GroundSource, RingLayer
from core.motion.attitude import AttitudeRing
from core.motion.track import Track
from core.records import F64, I64, PointSweep, Scan

MAX_SLOPE_RAD = 0.35  # a robot that leans more, 20 deg, has no use for a map


class Maps(Protocol):
    """An elevation map and the obstacle map made of it, kept up by one method."""

    window: ObstacleWindow
    fresh: Freshness

    def warm(self) -> None:
        """Run the kernels to which the first scans do not come, once; the maps stay as they are."""

    def add(self, scan: Scan | PointSweep, attitudes: AttitudeRing, odometry: Track) -> int:
        """Take a sweep that both cover from first beam to last; how many returns were used."""

    def erase(self) -> None:
        """Forget everything: nothing in it can be placed any more."""

    def maybe_ring(self, name: str) -> RingLayer | None:
        """A layer by its name in `core.mapping.layers.UNITS`, but "state"; none where it has none.

        NaN: not known.
        """

    def maybe_ground(self) -> GroundSource | None:
        """Heights that feet may stand on; none where the method has none of one frame."""

    def causes(self, i: I64, j: I64) -> F64:
        """Codes (n,) of `core.mapping.causes`: why the window shows what it does at world cells."""

    def ages_s(self, i: I64, j: I64) -> F64:
        """Seconds (n,) since world cells were met, passed or stood on; NaN: never, or outside."""

    def evidence(self, i: int, j: int) -> dict[str, float]:
        """What was counted in a world cell inside of the window, by what it counts."""


def is_low(maps: Maps, i: int, j: int) -> bool:
    """Whether a world cell is told as an obstacle for its ground: a drop, nothing that stands."""
    if not maps.window.is_obstacle(i, j):
        return False
    return int(maps.causes(np.array([i]), np.array([j]))[0]) in LOW_GROUND
