"""Values of the map for who asks for a rectangle of it, piece by piece, as they are now.

What is not to be trusted is held back: no free cell is told then, and no height, variance or slope
but those of obstacles, for a planner that reads heights would take low ground for free.
Source: planner link, section 3 (TILE).
"""

import numpy as np
import numpy.typing as npt

from core.mapping.method import Maps
from core.records import OBSTACLE

F32 = npt.NDArray[np.float32]


class TileValues:
    """Pieces of one run's map; `trusted` is set at each tick by who knows."""

    def __init__(self, maps: Maps) -> None:
        self._maps = maps
        self.trusted = False  # free may be told

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
