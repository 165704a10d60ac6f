"""`ObstacleWindow`: the tri-state cells that the planner gets, and which of them changed.

It decides nothing: a method puts states in, the link takes changes out.
"""

from typing import NamedTuple

import numpy as np

from core.grid.places import Ring
from core.grid.ring import RingGrid
from core.records import F64, I8, I32, OBSTACLE, UNKNOWN
from jit import kernel

NO_CELLS = np.zeros(0, dtype=np.int32)


class Shown(NamedTuple):
    """The window, as kernels are given it; flat."""

    ring: Ring
    cells: I8
    marked: I8  # 1: is in `changed`
    changed: I32  # flat indices, as many as have changed
    under: I8  # states that show wherever UNKNOWN is put,
    under_s: F64  # and when their cells were seen


@kernel
def put_state(to: int, state: int, shown: Shown, used: int) -> int:
    """Set one cell, by its flat index, and note it once; returns how many are noted."""
    if state == UNKNOWN:
        state = shown.under[to]
    else:  # it was looked at anew: what was seen before counts no more, whatever comes then
        shown.under[to] = UNKNOWN
    if shown.cells[to] != state:
        shown.cells[to] = state
        if shown.marked[to] == 0:
            shown.marked[to] = 1
            shown.changed[used] = to
            return used + 1
    return used


@kernel
def _put(at: I32, states: I8, shown: Shown, used: int) -> int:
    """Set many cells; returns how many are noted."""
    for k in range(at.size):
        used = put_state(at[k], states[k], shown, used)
    return used


class ObstacleWindow:
    """Cells (size, size) int8, OBSTACLE, UNKNOWN or FREE, laid out as `RingGrid` says."""

    def __init__(self, cells: int, cell_m: float) -> None:
        self.grid = RingGrid(cells, cell_m)
        self.cells: I8 = self.grid.layer(np.int8, UNKNOWN)
        self.under: I8 = self.grid.layer(np.int8, UNKNOWN)  # shows where nothing is known
        self.under_s: F64 = self.grid.layer(np.float64, -np.inf)  # when that was seen
        count = self.cells.size
        self.marked: I8 = np.full(count, 0, dtype=np.int8)  # flat; 1: is in `changed`
        self.changed: I32 = np.full(count, 0, dtype=np.int32)  # flat indices, `used` of them
        self.used = 0
        self.epoch = 0  # grows when everything was erased

    @property
    def shown(self) -> Shown:
        """It as it is now, for kernels."""
        under = self.under.ravel(), self.under_s.ravel()
        return Shown(self.grid.ring, self.cells.ravel(), self.marked, self.changed, *under)

    def put(self, at: I32, states: I8) -> None:
        """Set cells by their flat indices (k,), row * size + column, to states (k,)."""
        self.used = _put(at, states, self.shown, self.used)

    def lay_under(self, states: I8, seen_s: F64) -> None:
        """Show states (size, size), of cells seen then, wherever nothing is known; laid out alike.

        They go with the cells: as they leave the window, and as all is erased.
        """
        self.under[...], self.under_s[...] = states, seen_s
        unknown = np.flatnonzero(self.cells == UNKNOWN).astype(np.int32)
        self.put(unknown, np.full(unknown.size, UNKNOWN, dtype=np.int8))

    def follow(self, x_m: float, y_m: float) -> bool:
        """Keep a point of the map frame near the middle; True if the window moved."""
        return self.grid.follow(x_m, y_m)

    def follow_in(self, source: RingGrid, x_m: float, y_m: float) -> I32:
        """Follow, and tell which cells came in: flat indices (k,) of a source that holds them.

        The source must have moved before. One as large as the window knows nothing of them.
        """
        grid, size = self.grid, source.size
        old_i, old_j = grid.corner_i, grid.corner_j
        if not self.follow(x_m, y_m) or grid.size == size:
            return NO_CELLS
        i = np.arange(grid.corner_i, grid.corner_i + grid.size)
        j = np.arange(grid.corner_j, grid.corner_j + grid.size)
        new_i = i[(i < old_i) | (i >= old_i + grid.size)]
        new_j = j[(j < old_j) | (j >= old_j + grid.size)]
        columns = (j[:, None] % size) * size + new_i[None, :] % size
        rows = (new_j[:, None] % size) * size + i[None, :] % size
        return np.concatenate([columns.ravel(), rows.ravel()]).astype(np.int32)

    def is_obstacle(self, i: int, j: int) -> bool:
        """Whether it tells a world cell to be an obstacle."""
        grid = self.grid
        inside = 0 <= i - grid.corner_i < grid.size and 0 <= j - grid.corner_j < grid.size
        return inside and int(self.cells[j % grid.size, i % grid.size]) == OBSTACLE

    def erase(self) -> None:
        """Everything unknown, and nothing told before holds."""
        self.grid.erase()
        self.marked[...] = 0
        self.used = 0
        self.epoch += 1

    def take_changed(self) -> I32:
        """Flat indices (k,) of the cells that changed since the last call."""
        changed = self.changed[: self.used].copy()
        if self.used:
            self.marked[changed] = 0
            self.used = 0
        return changed
