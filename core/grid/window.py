"""`ObstacleWindow`: the tri-state cells that the planner gets, and which of them changed.

It decides nothing: a method puts states in, the link takes changes out.
"""

import numpy as np

from core.grid.ring import RingGrid
from core.records import I8, I32, UNKNOWN
from jit import kernel


@kernel
def put_state(to: int, state: int, cells: I8, marked: I8, changed: I32, used: int) -> int:
    """Set one cell, by its flat index, and note it once; returns how many are noted."""
    if cells[to] != state:
        cells[to] = state
        if marked[to] == 0:
            marked[to] = 1
            changed[used] = to
            return used + 1
    return used


@kernel
def _put(at: I32, states: I8, cells: I8, marked: I8, changed: I32, used: int) -> int:
    """Set many cells; returns how many are noted."""
    for k in range(at.size):
        used = put_state(at[k], states[k], cells, marked, changed, used)
    return used


class ObstacleWindow:
    """Cells (size, size) int8, OBSTACLE, UNKNOWN or FREE, laid out as `RingGrid` says."""

    def __init__(self, cells: int, cell_m: float) -> None:
        self.grid = RingGrid(cells, cell_m)
        self.cells: I8 = self.grid.layer(np.int8, UNKNOWN)
        count = self.cells.size
        self.marked: I8 = np.full(count, 0, dtype=np.int8)  # flat; 1: is in `changed`
        self.changed: I32 = np.full(count, 0, dtype=np.int32)  # flat indices, `used` of them
        self.used = 0
        self.epoch = 0  # grows when everything was erased

    def put(self, at: I32, states: I8) -> None:
        """Set cells by their flat indices (k,), row * size + column, to states (k,)."""
        cells = self.cells.ravel()
        self.used = _put(at, states, cells, self.marked, self.changed, self.used)

    def follow(self, x_m: float, y_m: float) -> bool:
        """Keep a point of the map frame near the middle; True if the window moved."""
        return self.grid.follow(x_m, y_m)

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
