"""Floor that was seen, in cells: what a machine may drive on, and what it has not seen yet.

A cell counts how often all of it lay in a view, and down where something stood. It is free only
from `least` on; what was taken away has to be seen anew. What is thinner than a cell may lie unseen
between its corners: things are to be taken away by outlines of their own. Outside of its square
nothing is known. Map frame, metres.
"""

import math
from collections.abc import Iterable
from typing import NamedTuple

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
MOST = 12  # that a cell counts to: what was there longer takes no longer to be doubted
SPECK_M2 = 0.0026  # so much of a way may be unseen: no thing that counts is as small
DOUBT = 4  # of these a frame takes away in which something stands there


@kernel
def _fill(points: F64, cell_m: float, crossings: F64, nodes: U8) -> None:
    """Set nodes (n, m) that lie in a ring (k, 2): node i, j is at i * cell_m, j * cell_m."""
    count = len(points)
    for i in range(nodes.shape[0]):
        x, found = i * cell_m, 0
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
            first = max(0, math.ceil(crossings[k] / cell_m))
            last = min(nodes.shape[1] - 1, math.floor(crossings[k + 1] / cell_m))
            for j in range(first, last + 1):
                nodes[i, j] = 1


class Doubt(NamedTuple):
    """What one frame took away."""

    window: tuple[slice, slice]
    views: U8  # of each cell there
    explained: Mask  # those that were
    stood: Mask  # those on which nothing had stood before
    when: int  # `explain` had been called so often


class SeenFloor:
    """A square of cells around a place.

    Args:
        least: so often a cell must be seen to be free.
    """

    def __init__(
        self, middle: tuple[float, float], size_m: float, cell_m: float, least: int
    ) -> None:
        self.cell_m, self._least = cell_m, least
        cells = math.ceil(size_m / cell_m)
        self.low = np.floor((np.array(middle) - size_m / 2) / cell_m) * cell_m
        self.count: U8 = np.zeros((cells, cells), np.uint8)
        self._explained: Mask = np.zeros((cells, cells), np.bool_)
        self._explains = 0
        self._stood: Mask = np.zeros((cells, cells), np.bool_)  # something, when last seen
        self._lost: Mask = np.zeros((cells, cells), np.bool_)  # to a doubt, at least once
        self._nodes: U8 = np.zeros((cells + 1, cells + 1), np.uint8)
        self._used = np.array([cells, cells, 0, 0])  # lowest cell that was written, and highest

    def add(self, view: F64) -> None:
        """A view (n, 2): cells of which all four corners lie in it were seen once more."""
        window, nodes = self._within(view)
        whole = nodes[:-1, :-1] & nodes[1:, :-1] & nodes[:-1, 1:] & nodes[1:, 1:]
        self._use(window)
        count = self.count[window]
        count += whole & (count < MOST)
        self._stood[window] &= whole == 0

    def vouch(self, outline: F64) -> None:
        """Floor known to be free otherwise: where the machine stands, where somebody looked."""
        window, nodes = self._within(outline)
        whole = nodes[:-1, :-1] & nodes[1:, :-1] & nodes[:-1, 1:] & nodes[1:, 1:]
        self._use(window)
        self.count[window][whole == 1] = self._least
        self._stood[window] &= whole == 0

    def doubt(self, outline: F64, stays: bool = False) -> Doubt:
        """Something stands there, in this frame: all cells of which a corner lies in it.

        Args:
            stays: so it is until they are seen anew; nothing else explains them.
        """
        window, nodes = self._within(outline)
        touched = nodes[:-1, :-1] | nodes[1:, :-1] | nodes[:-1, 1:] | nodes[1:, 1:]
        count = self.count[window]
        views = np.minimum(count, touched * np.uint8(DOUBT))
        self._lost[window] |= (count >= self._least) & (count - views < self._least)
        count -= views
        explained = self._explained[window] & (touched == 1)
        self._explained[window] &= touched == 0
        stood = (touched == 1) & ~self._stood[window] & stays
        if stood.any():
            self._use(window)
        self._stood[window] |= stood
        return Doubt(window, views, explained, stood, self._explains)

    def restore(self, doubt: Doubt) -> None:
        """What stood there has moved: the floor below it is as it was."""
        count = self.count[doubt.window]
        np.minimum(count + doubt.views, MOST, out=count)
        if doubt.when == self._explains:
            self._explained[doubt.window] |= doubt.explained
        self._stood[doubt.window] &= ~doubt.stood

    def explain(self, polygons: Iterable[Polygon]) -> None:
        """Floor that what stands beside it hides: free for `is_free`, until something is there."""
        self._explained[:] = False
        self._explains += 1
        for polygon in polygons:
            window, nodes = self._within(_ring(polygon))
            touched = nodes[:-1, :-1] | nodes[1:, :-1] | nodes[:-1, 1:] | nodes[1:, 1:]
            self._explained[window] |= (touched == 1) & ~self._stood[window]

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
            _fill(own - [i0, j0], 1.0, np.empty(len(ring) + 1), nodes)
        return (slice(i0, i1), slice(j0, j1)), nodes

    def is_seen(self) -> Mask:
        """(n, m) along x and y, of the cells in `window`."""
        return np.asarray(self.count[self.window] >= self._least)

    def is_lost(self) -> Mask:
        """The same of cells that were seen, until something was told there."""
        return np.asarray(self._lost[self.window] & ~self.is_seen())

    @property
    def area_m2(self) -> float:
        """Of all cells that are seen."""
        return int(np.count_nonzero(self.is_seen())) * self.cell_m**2

    def is_free(self, outline: F64) -> bool:
        """Whether all cells in an outline (n, 2) are seen or explained, but for a speck.

        Rows of single cells are none either: what counts as a thing is wider.
        """
        window, nodes = self._within(outline)
        touched = nodes[:-1, :-1] & nodes[1:, 1:]
        is_free = (self.count[window] >= self._least) | self._explained[window]
        bad = (touched == 1) & ~is_free
        squares = bad[:-1, :-1] & bad[1:, :-1] & bad[:-1, 1:] & bad[1:, 1:]
        wide = np.zeros_like(bad)
        for part in (wide[:-1, :-1], wide[1:, :-1], wide[:-1, 1:], wide[1:, 1:]):
            part |= squares
        return int(np.count_nonzero(wide)) <= SPECK_M2 / self.cell_m**2

    def count_below(self, outline: F64) -> int:
        """How many cells within an outline (n, 2) are not seen; outside of the square none is."""
        window, nodes = self._within(outline)
        whole = nodes[:-1, :-1] & nodes[1:, :-1] & nodes[:-1, 1:] & nodes[1:, 1:]
        return int(np.count_nonzero(self.count[window][whole == 1] < self._least))

    def mask_of(self, polygons: Iterable[Polygon]) -> Mask:
        """Cells of `window` that polygons touch with a corner."""
        mask = np.zeros(self.count.shape, dtype=bool)
        for polygon in polygons:
            window, nodes = self._within(_ring(polygon))
            mask[window] |= (nodes[:-1, :-1] | nodes[1:, :-1] | nodes[:-1, 1:] | nodes[1:, 1:]) == 1
        return np.asarray(mask[self.window])

    def centres(self, cells: npt.NDArray[np.int64]) -> F64:
        """(n, 2) m of cells (n, 2), counted within `window`."""
        first = np.array([part.start for part in self.window])
        return np.asarray(self.low + (cells + first + 0.5) * self.cell_m)

    def area(self) -> BaseGeometry:
        """Seen cells as polygons; where only corners touch, they are parted."""
        return self._area(self.count[self.window] >= self._least)

    def stood(self) -> BaseGeometry:
        """Where something stood when the place was last seen, though nothing is known there."""
        return self._area(self._stood[self.window])

    def _area(self, mask: Mask) -> BaseGeometry:
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


class SweptFloor(SeenFloor):
    """The same of floor that bands have swept: a cell is clean once all its corners were swept.

    By whichever bands: so there is no seam of cells between two that overlap.
    """

    def __init__(self, middle: tuple[float, float], size_m: float, cell_m: float) -> None:
        super().__init__(middle, size_m, cell_m, 1)
        self._corners = np.zeros_like(self._nodes)

    def add(self, view: F64) -> None:
        """A band's outline (n, 2)."""
        window, nodes = self._within(view)
        rows, across = (slice(part.start, part.stop + 1) for part in window)
        corners = self._corners[rows, across]
        corners |= nodes
        whole = corners[:-1, :-1] & corners[1:, :-1] & corners[:-1, 1:] & corners[1:, 1:]
        self._use(window)
        self.count[window][whole == 1] = 1


def _ring(polygon: Polygon) -> F64:
    ring: F64 = shapely.get_coordinates(polygon.exterior)[:-1]
    return ring
