"""What a cell means: obstacle, free or unknown, in the window that the planner gets.

Definition 1 of the paper on the average height, a cell at a bound counting as obstacle; and two
contradictions make an obstacle whatever the average says, while a cell with only one is unknown
until the laser has looked again several times. Of a wall's foot, the laser first sees what looks
like floor. So a new cell is not free before something has been seen behind it, and one in which
something rises not before something has been seen all around it. Only touched cells are decided.
Source: the paper, Definition 1; design, section 7.
"""

import numpy as np

from core.elevation import MeanCells
from core.grid import RingGrid
from core.jit import kernel
from core.records import F64, FREE, I8, I32, OBSTACLE, U8, UNKNOWN

ENOUGH = 2  # contradicting scans that make an obstacle
LOOKED_AGAIN = 6  # scans after which a single contradiction no longer holds a cell unknown
NEW_LOOKS = 25  # scans that have hit a cell before it no longer counts as new: 1 s at 25 Hz

AROUND = ((1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1))  # (di, dj), octants


@kernel
def _goes_on(
    i: int, j: int, sides: int, count: I32, beyond: I32, window: tuple[int, int, int]
) -> bool:
    """Whether the neighbours on these sides (bits by octant) have all been seen."""
    size = window[2]
    for side in range(8):
        if not sides >> side & 1:
            continue
        ni, nj = i + AROUND[side][0], j + AROUND[side][1]
        if not (0 <= ni - window[0] < size and 0 <= nj - window[1] < size):
            return False
        at = (nj % size) * size + ni % size
        if count[at] == 0 and beyond[at] == 0:
            return False
    return True


@kernel
def _decide(
    touched: I32,
    mean: F64,
    count: I32,
    beyond: I32,
    rising: U8,
    far_sides: U8,
    looks: I32,
    bounds: tuple[float, float],
    from_window: tuple[int, int, int],
    to_window: tuple[int, int, int],
    cells: I8,
    marked: I8,
    changed: I32,
    used: int,
) -> int:
    """Decide touched cells of the elevation window; windows are (corner i, corner j, size)."""
    size, out = from_window[2], to_window[2]
    for at in touched:
        row, column = at // size, at % size
        i = from_window[0] + (column - from_window[0]) % size
        j = from_window[1] + (row - from_window[1]) % size
        if not (0 <= i - to_window[0] < out and 0 <= j - to_window[1] < out):
            continue
        if count[at] == 0 and beyond[at] == 0:
            state = UNKNOWN
        elif beyond[at] >= ENOUGH or not (bounds[1] < mean[at] < bounds[0]):
            state = OBSTACLE
        elif beyond[at] == 1 and looks[at] < LOOKED_AGAIN:
            state = UNKNOWN
        else:
            sides = 0
            if rising[at] == 1:
                sides = 0xFF
            elif looks[at] < NEW_LOOKS:
                far = int(far_sides[at])
                sides = (far | far << 1 | far >> 7 | far >> 1 | far << 7) & 0xFF
            state = FREE if _goes_on(i, j, sides, count, beyond, from_window) else UNKNOWN
        to = (j % out) * out + i % out
        if cells[to] != state:
            cells[to] = state
            if marked[to] == 0:
                marked[to] = 1
                changed[used] = to
                used += 1
    return used


class ObstacleMap:
    """The tri-state window, (size, size) int8, and which of its cells changed."""

    def __init__(
        self, elevation: MeanCells, window_cells: int, h_pos_m: float, h_neg_m: float
    ) -> None:
        self.grid = RingGrid(window_cells, elevation.grid.cell_m)
        self.cells: I8 = self.grid.layer(np.int8, UNKNOWN)
        self._marked: I8 = np.zeros((window_cells, window_cells), dtype=np.int8)
        self._elevation, self._bounds = elevation, (h_pos_m, h_neg_m)
        self._changed = np.zeros(window_cells**2, dtype=np.int32)
        self._used = 0
        self.epoch = 0  # grows when everything was erased

    def decide(self, touched: I32) -> None:
        """Decide again the cells that the elevation map touched (flat indices of its window)."""
        source = self._elevation.grid
        self._used = _decide(
            touched,
            self._elevation.mean_m.ravel(),
            self._elevation.count.ravel(),
            self._elevation.beyond.ravel(),
            self._elevation.rising.ravel(),
            self._elevation.far_sides.ravel(),
            self._elevation.looks.ravel(),
            self._bounds,
            (source.corner_i, source.corner_j, source.size),
            (self.grid.corner_i, self.grid.corner_j, self.grid.size),
            self.cells.ravel(),
            self._marked.ravel(),
            self._changed,
            self._used,
        )

    def follow(self, x_m: float, y_m: float) -> None:
        """Move the window with the robot; what enters and is known in the elevation map is decided.

        The elevation window must have moved before.
        """
        old_i, old_j = self.grid.corner_i, self.grid.corner_j
        if not self.grid.follow(x_m, y_m) or self.grid.size == self._elevation.grid.size:
            return
        size, source = self.grid.size, self._elevation.grid.size
        i = np.arange(self.grid.corner_i, self.grid.corner_i + size)
        j = np.arange(self.grid.corner_j, self.grid.corner_j + size)
        new_i = i[(i < old_i) | (i >= old_i + size)]
        new_j = j[(j < old_j) | (j >= old_j + size)]
        columns = (j[:, None] % source) * source + new_i[None, :] % source
        rows = (new_j[:, None] % source) * source + i[None, :] % source
        entered = np.concatenate([columns.ravel(), rows.ravel()]).astype(np.int32)
        self.decide(entered)

    def erase(self) -> None:
        """Everything unknown, and nothing told before holds."""
        self.grid.erase()
        self._marked[...] = 0
        self._used = 0
        self.epoch += 1

    def take_changed(self) -> I32:
        """Flat indices of the cells that changed since the last call."""
        changed = self._changed[: self._used].copy()
        self._marked.ravel()[changed] = 0
        self._used = 0
        return changed
