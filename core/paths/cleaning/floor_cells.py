"""A square of cells of the floor that counts something of each, and what it says of outlines.

Outside of the square nothing is known. Map frame, metres.
"""

import math
from collections.abc import Iterable
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt
import shapely
from shapely import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from core.paths.geometry.space import polygons_in
from core.records import F64
from jit import kernel

U8 = npt.NDArray[np.uint8]
Mask = npt.NDArray[np.bool_]
Corners = TypeVar("Corners", bound=npt.NDArray[Any])


@kernel
def _fill(points: F64, crossings: F64, nodes: U8) -> None:
    """Set nodes (n, m) that lie in a ring (k, 2): node i, j is at i, j."""
    count = len(points)
    for i in range(nodes.shape[0]):
        x, found = float(i), 0
        for k in range(count):
            ax, ay = points[k, 0], points[k, 1]
            bx, by = points[(k + 1) % count, 0], points[(k + 1) % count, 1]
            if (ax <= x) != (bx <= x):
                y = ay + (x - ax) * (by - ay) / (bx - ax)
                place = found
                while place > 0 and crossings[place - 1] > y:
                    crossings[place] = crossings[place - 1]
                    place -= 1
                crossings[place] = y
                found += 1
        for k in range(0, found - 1, 2):
            first = max(0, math.ceil(crossings[k]))
            last = min(nodes.shape[1] - 1, math.floor(crossings[k + 1]))
            for j in range(first, last + 1):
                nodes[i, j] = 1


def all_corners(nodes: Corners) -> Corners:
    """(n, m) whether all four corners of a cell are set, of nodes (n + 1, m + 1)."""
    whole: Corners = nodes[:-1, :-1] & nodes[1:, :-1] & nodes[:-1, 1:] & nodes[1:, 1:]
    return whole


def some_corner(nodes: Corners) -> Corners:
    """(n, m) whether one is."""
    touched: Corners = nodes[:-1, :-1] | nodes[1:, :-1] | nodes[:-1, 1:] | nodes[1:, 1:]
    return touched


class FloorCells:
    """Cells around a place; those that count to `least` are seen, or whatever is counted."""

    def __init__(
        self, middle: tuple[float, float], size_m: float, cell_m: float, least: int
    ) -> None:
        self.cell_m, self._least = cell_m, least
        cells = math.ceil(size_m / cell_m)
        self.low = np.floor((np.array(middle) - size_m / 2) / cell_m) * cell_m
        self.count: U8 = np.zeros((cells, cells), np.uint8)
        self._nodes: U8 = np.zeros((cells + 1, cells + 1), np.uint8)
        self._used = np.array([cells, cells, 0, 0])  # lowest cell that was written, and highest

    def _use(self, window: tuple[slice, slice]) -> None:
        for axis, part in enumerate(window):
            self._used[axis] = min(self._used[axis], part.start)
            self._used[axis + 2] = max(self._used[axis + 2], part.stop)

    @property
    def window(self) -> tuple[slice, slice]:
        """The cells among which all seen ones are, and one more on each side."""
        i0, j0, i1, j1 = self._used.tolist()
        most = len(self.count)
        return slice(max(0, i0 - 1), min(most, i1 + 1)), slice(max(0, j0 - 1), min(most, j1 + 1))

    def _within(self, ring: F64) -> tuple[tuple[slice, slice], U8]:
        """The window of cells around a ring, and its nodes, which are 1 inside."""
        if len(ring) < 3 or not np.isfinite(ring).all():
            return (slice(0, 0), slice(0, 0)), np.zeros((1, 1), np.uint8)
        own = (np.asarray(ring, np.float64) - self.low) / self.cell_m
        cells = len(self.count)
        (i0, j0), (i1, j1) = (
            np.clip(edge, 0, cells).astype(int).tolist()
            for edge in (np.floor(own.min(axis=0)), np.ceil(own.max(axis=0)))
        )
        nodes = self._nodes[i0 : i1 + 1, j0 : j1 + 1]
        nodes[:] = 0
        if i1 > i0 and j1 > j0:
            _fill(own - [i0, j0], np.empty(len(ring) + 1), nodes)
        return (slice(i0, i1), slice(j0, j1)), nodes

    def is_seen(self) -> Mask:
        """(n, m) along x and y, of the cells in `window`."""
        return np.asarray(self.count[self.window] >= self._least)

    @property
    def area_m2(self) -> float:
        """Of all cells that are seen."""
        return int(np.count_nonzero(self.is_seen())) * self.cell_m**2

    def count_below(self, outline: F64) -> int:
        """How many cells within an outline (n, 2) are not seen; outside of the square none is."""
        window, nodes = self._within(outline)
        whole = all_corners(nodes)
        return int(np.count_nonzero(self.count[window][whole == 1] < self._least))

    def mask_of(self, polygons: Iterable[Polygon]) -> Mask:
        """Cells of `window` that polygons touch with a corner."""
        mask = np.zeros(self.count.shape, dtype=bool)
        for polygon in polygons:
            window, nodes = self._within(ring_of(polygon))
            mask[window] |= some_corner(nodes) == 1
        return np.asarray(mask[self.window])

    def centres(self, cells: npt.NDArray[np.int64]) -> F64:
        """(n, 2) m of cells (n, 2), counted within `window`."""
        first = np.array([part.start for part in self.window])
        return np.asarray(self.low + (cells + first + 0.5) * self.cell_m)

    def area(self) -> BaseGeometry:
        """Seen cells as polygons; where only corners touch, they are parted."""
        return self.area_of(self.count[self.window] >= self._least)

    def area_of(self, mask: Mask) -> BaseGeometry:
        """Cells of `window` as polygons."""
        rows, across = self.window
        padded = np.zeros((len(mask), mask.shape[1] + 2), dtype=np.int8)
        padded[:, 1:-1] = mask
        edges = np.diff(padded, axis=1)
        which, begins = np.nonzero(edges == 1)
        ends = np.nonzero(edges == -1)[1] + across.start
        left, begins = which + rows.start, begins + across.start
        x0, x1 = (self.low[0] + edge * self.cell_m for edge in (left, left + 1))
        y0, y1 = (self.low[1] + edge * self.cell_m for edge in (begins, ends))
        return shapely.union_all(shapely.box(x0, y0, x1, y1))  # neighbours share their edges

    def free(self) -> MultiPolygon:
        """Seen floor as polygons with few corners; all of them lies within the seen cells."""
        off_m = 0.71 * self.cell_m  # half a cell's diagonal
        inside = shapely.buffer(self.area(), -off_m, join_style="mitre")
        return MultiPolygon(polygons_in(shapely.make_valid(shapely.simplify(inside, off_m))))


def ring_of(polygon: Polygon) -> F64:
    ring: F64 = shapely.get_coordinates(polygon.exterior)[:-1]
    return ring
