"""Values of the map and the newest sweep's returns, for who asks, and made only then.

What is not to be trusted is held back: no free cell is told then, and no height, variance, slope, z
or age but those of obstacles, for a planner that reads heights would take low ground for free; the
cause of all other cells is the input that is not to be trusted. Nor are edges, footholds, heights
that were filled in, or a sweep told then.
Source: planner link, section 3 (TILE, SCAN).
"""

import math

import numpy as np
import numpy.typing as npt

from core.device_settings import Scanner
from core.mapping.causes import NOT_MAPPED, OUTSIDE
from core.mapping.footing import FOOTING
from core.mapping.layers import FILL
from core.mapping.mapper import Mapper
from core.mapping.rays import BeamGeometry, span_s
from core.records import OBSTACLE, SweepPoints

F32 = npt.NDArray[np.float32]
MOST_POINTS = 541  # of a sweep that is told


class TileValues:
    """Pieces of one run's map. Each tick sets what time it is, and whether free may be told."""

    def __init__(self, mapper: Mapper, scanner: Scanner) -> None:
        self._mapper, self._scanner = mapper, scanner
        self._geometry: BeamGeometry | None = None  # once somebody has asked
        self.now_s = -math.inf
        self.doubt = NOT_MAPPED  # the cause for which free is held back; 0: it may be told

    @property
    def trusted(self) -> bool:
        """Whether free may be told."""
        return self.doubt == 0

    def values(self, layer: str, i: int, j: int, width: int, first: int, count: int) -> F32 | None:
        """Cells first..first+count, row-major, of the rectangle from world cell (i, j) on.

        Args:
            layer: "state" (OBSTACLE, FREE), "height" (m), "variance" (m2), "slope" (rad), "cause"
                (of `core.mapping.causes`), "age" (s since a beam met or passed it), "z" (m),
                "edge" (m), "foothold" (0..1), "foothold_sigma" (m; all three of a usual foot),
                "filled" (m), "filled_sigma" (m).

        Returns:
            (count,); NaN: not known. None: this method has no such layer.
        """
        at, mapper = np.arange(first, first + count, dtype=np.int64), self._mapper
        column, row = i + at % width, j + at // width
        values = mapper.maybe_values(layer, column, row)
        if values is None:
            return None
        if layer == "age":
            values = values + max(0.0, self.now_s - mapper.maps.fresh.now_s)
        if self.doubt and layer in (*FOOTING, *FILL):
            values = np.full(count, np.nan)  # a foothold on an obstacle says that it can be trodden
        elif self.doubt:
            states = mapper.maybe_values("state", column, row)
            assert states is not None
            if layer == "cause":
                held = np.where(values == OUTSIDE, OUTSIDE, self.doubt)
            else:
                held = np.full(count, np.nan)
            values = np.where(states == OBSTACLE, values, held)
        return values.astype(np.float32)

    def maybe_scan(self) -> SweepPoints | None:
        """The returns of the newest sweep in the map; none while there is none to be trusted."""
        mapper = self._mapper
        scan, attitudes, odometry = mapper.newest_scan, mapper.attitudes, mapper.odometry
        if scan is None or self.doubt:
            return None
        first_s, last_s = span_s(scan)
        if not (attitudes.reaches(first_s, last_s) and odometry.covers(first_s, last_s)):
            return None
        if self._geometry is None:
            self._geometry = BeamGeometry.of(self._scanner)
        sweep = self._geometry.cast(scan, attitudes, odometry)
        points = sweep.points()
        returns = len(points)
        if returns > MOST_POINTS:
            points = points[np.arange(MOST_POINTS) * returns // MOST_POINTS]
        x_m, y_m, z_m = sweep.origins[-1].tolist()
        return SweepPoints(last_s, (x_m, y_m, z_m), points, returns)
