"""What is true of each cell: floor that the robot can reach, or something that it must not meet.

Floor is what can be reached from the robot's place, or from another that the scene calls floor,
without a step of the bound or more between neighbouring samples 5 cm apart; all else, the edges of
such steps too, is an obstacle. So a ramp is floor, and so is a slab of 5 cm; a box, a wall and a
ditch are obstacles, whatever their place.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from jit import kernel

F64 = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]
SAMPLE_M = 0.05
BOUND_M = 0.0995  # a step of 0.10 m is an obstacle,
DANGER_M = 0.1495  # and of one of 0.15 m none may be missed


@kernel
def _reach(
    heights: F64, begin: tuple[int, int], bound: float, reached: npt.NDArray[np.int8]
) -> None:
    """Flood from one sample over all steps below the bound; NaN is never reached."""
    rows, columns = heights.shape
    waiting = np.empty((rows * columns, 2), dtype=np.int64)
    waiting[0, 0], waiting[0, 1] = begin
    reached[begin] = 1
    used = 1
    while used > 0:
        used -= 1
        r, c = waiting[used]
        for k in range(4):
            nr, nc = r + (k == 0) - (k == 1), c + (k == 2) - (k == 3)
            if not (0 <= nr < rows and 0 <= nc < columns) or reached[nr, nc] == 1:
                continue
            if abs(heights[nr, nc] - heights[r, c]) < bound:
                reached[nr, nc] = 1
                waiting[used, 0], waiting[used, 1] = nr, nc
                used += 1


def _edges(heights: F64, bound: float) -> Bools:
    """Samples with a step of the bound or more to one of their four neighbours."""
    filled = np.where(np.isnan(heights), -1e3, heights)
    edges = np.zeros(heights.shape, dtype=bool)
    for axis in (0, 1):
        step = np.abs(np.diff(filled, axis=axis)) >= bound
        low, high = [slice(None)] * 2, [slice(None)] * 2
        low[axis], high[axis] = slice(None, -1), slice(1, None)
        edges[tuple(low)] |= step
        edges[tuple(high)] |= step
    return edges


@dataclass(frozen=True, slots=True)
class CellTruth:
    """Truth per cell of a window, all (size, size), [j, i] from its corner on."""

    obstacle: Bools  # something of 0.10 m or more in it
    danger: F64  # share of it that is 0.15 m or more above or below the floor, 0..1
    wall_m: F64  # distance of its centre from the nearest obstacle sample, 0: in one; at most 1 m
    low_m: F64  # lowest and highest surface in it
    high_m: F64
    floor_m: F64  # mean height of the floor in it, NaN where there is none


class Truth:
    """The world's heights at one instant, sampled over the part that a run comes to see.

    Args:
        x_m, y_m: the span sampled, map frame.
        floors_m: places on floor, by which floor is known.
    """

    def __init__(
        self,
        world: Any,
        x_m: tuple[float, float],
        y_m: tuple[float, float],
        floors_m: Sequence[tuple[float, float]] = ((0.0, 0.0),),
    ) -> None:
        self._x0, self._y0 = x_m[0], y_m[0]
        self._x = np.arange(x_m[0] + SAMPLE_M / 2, x_m[1], SAMPLE_M)
        self._y = np.arange(y_m[0] + SAMPLE_M / 2, y_m[1], SAMPLE_M)
        x, y = np.meshgrid(self._x, self._y)
        self.heights = world.height_at(x.ravel(), y.ravel()).reshape(x.shape)
        begins = [(int((y - y_m[0]) / SAMPLE_M), int((x - x_m[0]) / SAMPLE_M)) for x, y in floors_m]
        self.floor = self._floor(begins, BOUND_M)
        self.danger = ~self._floor(begins, DANGER_M)
        self.obstacle = ~self.floor | _edges(self.heights, BOUND_M)

    def _floor(self, begins: Sequence[tuple[int, int]], bound: float) -> Bools:
        reached = np.zeros(self.heights.shape, dtype=np.int8)
        for begin in begins:
            _reach(self.heights, begin, bound, reached)
        return np.asarray(reached == 1)

    def cells(self, corner_i: int, corner_j: int, size: int, cell_m: float) -> CellTruth:
        """Truth of the cells of a window; beyond what was sampled all is obstacle and no danger."""
        per = max(1, round(cell_m / SAMPLE_M))
        columns = self._indices(self._x, self._x0, corner_i, size, cell_m, per)
        rows = self._indices(self._y, self._y0, corner_j, size, cell_m, per)
        beyond = (rows < 0)[:, None] | (columns < 0)[None, :]
        at = np.ix_(rows, columns)

        def tiles(layer: npt.NDArray[Any], blank: float) -> F64:
            values = np.where(beyond, blank, layer[at].astype(np.float64))
            return values.reshape(size, per, size, per).swapaxes(1, 2).reshape(size, size, -1)

        heights, floor = tiles(self.heights, np.nan), tiles(self.floor, 0.0) > 0
        known = np.where(np.isnan(heights), -9.0, heights)
        count = floor.sum(-1)
        total = np.where(floor, known, 0.0).sum(-1)
        mean = np.divide(total, count, out=np.full(total.shape, np.nan), where=count > 0)
        obstacle = np.asarray(tiles(self.obstacle, 1.0).max(axis=-1) > 0)
        return CellTruth(
            obstacle,
            tiles(self.danger, 0.0).mean(-1),
            _distance_m(obstacle, cell_m),
            known.min(-1),
            known.max(-1),
            mean,
        )

    def _indices(
        self, places: F64, begin: float, corner: int, size: int, cell_m: float, per: int
    ) -> npt.NDArray[np.int64]:
        """Nearest samples of `per` places in each cell; -1 beyond."""
        wanted = (corner + (np.arange(size * per) + 0.5) / per) * cell_m
        index = np.floor((wanted - begin) / SAMPLE_M + 1e-9).astype(np.int64)
        return np.where((index >= 0) & (index < len(places)), index, -1)


def grown(mask: Bools, cells: int) -> Bools:
    """The mask and all within so many cells of it, diagonally too."""
    wide = np.pad(mask, cells)
    out = np.zeros_like(mask)
    rows, columns = mask.shape
    for dj in range(2 * cells + 1):
        for di in range(2 * cells + 1):
            out |= wide[dj : dj + rows, di : di + columns]
    return out


def _distance_m(mask: Bools, cell_m: float) -> F64:
    """From the centre of each cell to the centre of the nearest one in the mask, at most 1 m."""
    reach = round(1.0 / cell_m)
    wide = np.pad(mask, reach)
    out = np.full(mask.shape, 1.0)
    rows, columns = mask.shape
    for dj in range(-reach, reach + 1):
        for di in range(-reach, reach + 1):
            away_m = cell_m * float(np.hypot(di, dj))
            if away_m < 1.0:
                part = wide[reach + dj : reach + dj + rows, reach + di : reach + di + columns]
                np.minimum(out, np.where(part, away_m, 1.0), out=out)
    return out
