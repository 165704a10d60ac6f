"""Floor that was seen, in cells: what a machine may drive on, and what it has not seen yet.

A cell counts how often all of it lay in a view, and down where something stood. It is free only
from `least` on; what was taken away has to be seen anew. What is thinner than a cell may lie unseen
between its corners: things are to be taken away by outlines of their own.
"""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from core.paths.cleaning.floor_cells import U8, FloorCells, Mask, all_corners, ring_of, some_corner
from core.records import F64

MOST = 12  # that a cell counts to: what was there longer takes no longer to be doubted
SPECK_M2 = 0.0026  # so much of a way may be unseen: no thing that counts is as small
DOUBT = 4  # of these a frame takes away in which something stands there


class Doubt(NamedTuple):
    """What one frame took away."""

    window: tuple[slice, slice]
    views: U8  # of each cell there
    explained: Mask  # those that were
    stood: Mask  # those on which nothing had stood before
    when: int  # `explain` had been called so often


class SeenFloor(FloorCells):
    """A square of cells around a place.

    Args:
        least: so often a cell must be seen to be free.
    """

    def __init__(
        self, middle: tuple[float, float], size_m: float, cell_m: float, least: int
    ) -> None:
        super().__init__(middle, size_m, cell_m, least)
        self._explained: Mask = np.zeros(self.count.shape, np.bool_)
        self._explains = 0
        self._stood: Mask = np.zeros(self.count.shape, np.bool_)  # something, when last seen
        self._lost: Mask = np.zeros(self.count.shape, np.bool_)  # to a doubt, at least once

    def add(self, view: F64) -> None:
        """A view (n, 2): cells of which all four corners lie in it were seen once more."""
        window, nodes = self._within(view)
        whole = all_corners(nodes)
        self._use(window)
        count = self.count[window]
        count += whole & (count < MOST)
        self._stood[window] &= whole == 0

    def vouch(self, outline: F64) -> None:
        """Floor known to be free otherwise: where the machine stands, where somebody looked."""
        window, nodes = self._within(outline)
        whole = all_corners(nodes)
        self._use(window)
        self.count[window][whole == 1] = self._least
        self._stood[window] &= whole == 0

    def doubt(self, outline: F64, stays: bool = False) -> Doubt:
        """Something stands there, in this frame: all cells of which a corner lies in it.

        Args:
            stays: so it is until they are seen anew; nothing else explains them.
        """
        window, nodes = self._within(outline)
        touched = some_corner(nodes)
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
            window, nodes = self._within(ring_of(polygon))
            touched = some_corner(nodes)
            self._explained[window] |= (touched == 1) & ~self._stood[window]

    def is_lost(self) -> Mask:
        """The same of cells that were seen, until something was told there."""
        return np.asarray(self._lost[self.window] & ~self.is_seen())

    def is_free(self, outline: F64) -> bool:
        """Whether all cells in an outline (n, 2) are seen or explained, but for a speck.

        Rows of single cells are none either: what counts as a thing is wider.
        """
        window, nodes = self._within(outline)
        touched = nodes[:-1, :-1] & nodes[1:, 1:]
        is_free = (self.count[window] >= self._least) | self._explained[window]
        bad = (touched == 1) & ~is_free
        squares = all_corners(bad)
        wide = np.zeros_like(bad)
        for part in (wide[:-1, :-1], wide[1:, :-1], wide[:-1, 1:], wide[1:, 1:]):
            part |= squares
        return int(np.count_nonzero(wide)) <= SPECK_M2 / self.cell_m**2

    def stood(self) -> BaseGeometry:
        """Where something stood when the place was last seen, though nothing is known there."""
        return self.area_of(self._stood[self.window])
