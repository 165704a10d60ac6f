"""Floor that bands of a tool have swept, in cells."""

import numpy as np

from core.paths.cleaning.floor_cells import FloorCells, all_corners
from core.records import F64


class SweptFloor(FloorCells):
    """A cell counts 1 once all its corners were swept.

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
        whole = all_corners(corners)
        self._use(window)
        self.count[window][whole == 1] = 1
