"""A target area as cells, and how often each is swept. It chooses; polygons measure."""

import math
from collections.abc import Sequence

import numpy as np
from shapely import Polygon

from core.paths.coverage.raster_kernels import exchange, fill
from core.paths.coverage.scan import edges_of
from core.records import F64

COARSE, FINE = 14, 18  # cells across the band, at least; and at most, on small floors,
FINER = 2.5  # times as many at the end
USUAL = 60_000  # cells of the target
MOST = 3_000_000  # cells; a larger floor has larger ones
NONE = np.empty((0, 4))


def edges_along(points: F64) -> F64:
    """(n - 1, 4) of (n, 2)."""
    return np.hstack([points[:-1], points[1:]])


class Raster:
    """Cells by row along y and column along x."""

    def __init__(self, target: Sequence[Polygon], width_m: float, finer: float = 1.0) -> None:
        """`finer`: its cells are by so much smaller than usual."""
        bounds = np.array([polygon.bounds for polygon in target])
        self._low = bounds[:, :2].min(axis=0) - width_m
        size_m = bounds[:, 2:].max(axis=0) + width_m - self._low
        wanted_m = math.sqrt(sum(polygon.area for polygon in target) / USUAL)
        fine_m = min(max(wanted_m, width_m / FINE), width_m / COARSE)
        self.cell_m = max(fine_m / finer, math.sqrt(float(size_m.prod()) / MOST))
        columns, rows = np.ceil(size_m / self.cell_m).astype(int) + 1
        self.grid = np.array([*self._low, self.cell_m, width_m / 2])
        self.is_target = np.zeros((rows, columns), dtype=bool)
        for polygon in target:
            edges = edges_of(polygon)
            fill(edges, self.grid, self.is_target, np.empty(len(edges)))
        self.count = np.zeros((rows, columns), dtype=np.int32)
        self.cells = int(self.is_target.sum())
        self.swept = 0

    @property
    def share(self) -> float:
        """Of the target that is swept."""
        return self.swept / max(self.cells, 1)

    def area(self, cells: int) -> float:
        return cells * self.cell_m**2

    def clear(self) -> None:
        """Nothing is swept any more."""
        self.count[:] = 0
        self.swept = 0

    def gain(self, old: F64, new: F64, keep: bool = False) -> int:
        """Cells won if edges (n, 4) were driven instead of others (m, 4); negative: lost."""
        change = exchange(self.count, self.is_target, self.grid, old, new, keep)
        if keep:
            self.swept += change
        return change

    def missed(self, least_m2: float) -> list[F64]:
        """Areas that nothing sweeps, the largest first: (n, 2) centres of their cells."""
        left = np.argwhere(self.is_target & (self.count == 0))
        waiting = {(int(r), int(c)) for r, c in left}
        found = []
        while waiting:
            stack = [waiting.pop()]
            group = []
            while stack:
                r, c = stack.pop()
                group.append((c, r))
                for near in ((r + 1, c), (r - 1, c), (r, c + 1), (r, c - 1)):
                    if near in waiting:
                        waiting.remove(near)
                        stack.append(near)
            if self.area(len(group)) >= least_m2:
                found.append((np.array(sorted(group)) + 0.5) * self.cell_m + self._low)
        return sorted(found, key=lambda cells: (-len(cells), tuple(cells[0])))
