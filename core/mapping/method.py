"""What a mapping method gives to the rest of the app, whichever it is, and planners of it."""

from typing import Protocol

import numpy as np
import numpy.typing as npt

from core.grid.window import ObstacleWindow
from core.mapping.layers import LayerView
from core.motion.attitude import AttitudeRing
from core.motion.odometry import Odometry
from core.records import F64, I64, OBSTACLE, PointSweep, Scan

F32 = npt.NDArray[np.float32]

MAX_SLOPE_RAD = 0.35  # a robot that leans more, 20 deg, has no use for a map


class Maps(Protocol):
    """An elevation map and the obstacle map made of it, kept up by one method."""

    window: ObstacleWindow

    def warm(self) -> None:
        """Run the kernels to which the first scans do not come, once; the maps stay as they are."""

    def add(self, scan: Scan | PointSweep, attitudes: AttitudeRing, odometry: Odometry) -> int:
        """Take a sweep that both cover from first beam to last; how many returns were used."""

    def erase(self) -> None:
        """Forget everything: nothing in it can be placed any more."""

    def maybe_layer(self, name: str) -> LayerView | None:
        """A layer by its name in `core.mapping.layers.UNITS`; none where the method has none."""

    def maybe_values(self, name: str, i: I64, j: I64) -> F64 | None:
        """What a layer holds at world cells i, j (n,); NaN: not known. None: no such layer."""

    def is_low(self, i: int, j: int) -> bool:
        """Whether an obstacle cell (world cell indices) is a drop, not something that stands."""


class TileValues:
    """Values of one run's map for who asks for a rectangle of it, piece by piece, as they are now.

    What is not to be trusted is held back: no free cell is told then, and no height, variance or
    slope but those of obstacles, for a planner that reads heights would take low ground for free.
    Source: planner link, section 3 (TILE).
    """

    def __init__(self, maps: Maps) -> None:
        self._maps = maps
        self.trusted = False  # free may be told; set at each tick by who knows

    def values(self, layer: str, i: int, j: int, width: int, first: int, count: int) -> F32 | None:
        """Cells first..first+count, row-major, of the rectangle from world cell (i, j) on.

        Args:
            layer: "state" (OBSTACLE, FREE), "height" (m), "variance" (m2), "slope" (rad).

        Returns:
            (count,); NaN: not known. None: this method has no such layer.
        """
        at = np.arange(first, first + count, dtype=np.int64)
        column, row = i + at % width, j + at // width
        values = self._maps.maybe_values(layer, column, row)
        if values is None:
            return None
        if not self.trusted:
            states = self._maps.maybe_values("state", column, row)
            assert states is not None
            values = np.where(states == OBSTACLE, values, np.nan)
        return values.astype(np.float32)
