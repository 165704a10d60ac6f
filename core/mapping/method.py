"""What a mapping method gives to the rest of the app, whichever it is."""

from typing import Protocol

from core.grid.window import ObstacleWindow
from core.mapping.freshness import Freshness
from core.mapping.layers import LayerView
from core.motion.attitude import AttitudeRing
from core.motion.odometry import Odometry
from core.records import F64, I64, PointSweep, Scan

MAX_SLOPE_RAD = 0.35  # a robot that leans more, 20 deg, has no use for a map


class Maps(Protocol):
    """An elevation map and the obstacle map made of it, kept up by one method."""

    window: ObstacleWindow
    fresh: Freshness

    def warm(self) -> None:
        """Run the kernels to which the first scans do not come, once; the maps stay as they are."""

    def add(self, scan: Scan | PointSweep, attitudes: AttitudeRing, odometry: Odometry) -> int:
        """Take a sweep that both cover from first beam to last; how many returns were used."""

    def erase(self) -> None:
        """Forget everything: nothing in it can be placed any more."""

    def maybe_layer(self, name: str) -> LayerView | None:
        """A layer by its name in `core.mapping.layers.UNITS`; none where the method has none."""

    def maybe_values(self, name: str, i: I64, j: I64) -> F64 | None:
        """What a layer holds at world cells i, j (n,); NaN: not known. None: no such layer.

        Besides those of UNITS there are `core.mapping.layers.ON_ASKING`.
        """

    def evidence(self, i: int, j: int) -> dict[str, float]:
        """What was counted in a world cell inside of the window, by what it counts."""

    def is_low(self, i: int, j: int) -> bool:
        """Whether an obstacle cell (world cell indices) is a drop, not something that stands."""
