"""`PaperGrid`: the paper's two maps, centred on the laser, which turn and scroll by copying cells.

X is right and Y ahead of the laser, metres; arrays are [row, column], row along Y, column along X.
A length belongs to index floor(length / cell_m + cells / 2): with an odd number of cells the laser
stands in the middle of the middle cell, with an even one on a corner. A cell is turned as its
centre. Refuses to know of beams and of the robot: it is told how far to turn and to scroll.
Source: the paper, Definition 1 and sections 4.5 and 4.6.
"""

import math

import numpy as np

from core.mapping import causes
from core.mapping.causes import FLOOR, TOO_HIGH, TOO_LOW
from core.records import F64, I8, I32, UNKNOWN
from jit import kernel

state_of = kernel(causes.state_of)


@kernel
def index_of(at_m: float, cell_m: float, cells: int) -> int:
    """Row or column of a length along Y or X; outside 0..cells - 1 it lies beyond the maps."""
    return math.floor(at_m / cell_m + 0.5 * cells)


@kernel
def centre_of(index: int, cell_m: float, cells: int) -> float:
    """Where the middle of a row or column is, along Y or X, metres."""
    return (index + 0.5 - 0.5 * cells) * cell_m


@kernel
def _nearest_ahead(count: I32) -> int:
    """First row ahead of the laser where the central column holds information; -1: none.

    The laser's own cell, which no turn moves, is not asked.
    """
    cells = count.shape[0]
    for row in range((cells + 1) // 2, cells):
        if count[row, cells // 2] > 0:
            return row
    return -1


@kernel
def _turn(
    average_m: F64,
    count: I32,
    states: I8,
    seen_s: F64,
    cell_m: float,
    turned_rad: float,
    to_average_m: F64,
    to_count: I32,
    to_states: I8,
    to_seen_s: F64,
) -> None:
    """Copy each cell to where its centre lands; of two that meet, the last in reading order."""
    cells = count.shape[0]
    c, s = math.cos(turned_rad), math.sin(turned_rad)
    for row in range(cells):
        y_m = centre_of(row, cell_m, cells)
        for column in range(cells):
            if count[row, column] == 0:
                continue
            x_m = centre_of(column, cell_m, cells)
            to_column = index_of(c * x_m - s * y_m, cell_m, cells)
            to_row = index_of(s * x_m + c * y_m, cell_m, cells)
            if 0 <= to_row < cells and 0 <= to_column < cells:
                to_average_m[to_row, to_column] = average_m[row, column]
                to_count[to_row, to_column] = count[row, column]
                to_states[to_row, to_column] = states[row, column]
                to_seen_s[to_row, to_column] = seen_s[row, column]


@kernel
def _move_row(
    average_m: F64, count: I32, states: I8, seen_s: F64, from_row: int, to_row: int
) -> None:
    """Copy a row; from outside the maps comes an empty one."""
    cells = count.shape[0]
    inside = 0 <= from_row < cells
    for column in range(cells):
        average_m[to_row, column] = average_m[from_row, column] if inside else np.nan
        count[to_row, column] = count[from_row, column] if inside else 0
        states[to_row, column] = states[from_row, column] if inside else UNKNOWN
        seen_s[to_row, column] = seen_s[from_row, column] if inside else -np.inf


@kernel
def _scroll(average_m: F64, count: I32, states: I8, seen_s: F64, rows: int) -> None:
    """Move all rows towards smaller Y by `rows`, or towards larger Y where that is negative."""
    cells = count.shape[0]
    for k in range(cells):
        to_row = k if rows > 0 else cells - 1 - k
        _move_row(average_m, count, states, seen_s, to_row + rows, to_row)


@kernel
def put_height(average_m: F64, count: I32, row: int, column: int, height_m: float) -> None:
    """Take one more height into a cell's average."""
    n = count[row, column] + 1
    if n == 1:
        average_m[row, column] = height_m
    else:
        average_m[row, column] += (height_m - average_m[row, column]) / n
    count[row, column] = n


@kernel
def rule_of(height_m: float, h_pos_m: float, h_neg_m: float) -> int:
    """Definition 1: which rule decides a cell of that average height, a cause."""
    if h_neg_m < height_m < h_pos_m:
        return FLOOR
    return TOO_LOW if height_m <= h_neg_m else TOO_HIGH


@kernel
def _decide(touched: I32, average_m: F64, states: I8, h_pos_m: float, h_neg_m: float) -> None:
    """Decide cells by their flat indices; only those whose average changed can have changed."""
    cells = states.shape[1]
    for at in touched:
        row, column = at // cells, at % cells
        states[row, column] = state_of(rule_of(average_m[row, column], h_pos_m, h_neg_m))


class PaperGrid:
    """Average height, number of heights and state of each cell, (cells, cells) each."""

    def __init__(self, cells: int, cell_m: float, h_pos_m: float, h_neg_m: float) -> None:
        self.cells, self.cell_m = cells, cell_m
        self.average_m = np.full((cells, cells), np.nan)  # NaN: nothing seen
        self.count: I32 = np.full((cells, cells), 0, dtype=np.int32)
        self.states: I8 = np.full((cells, cells), UNKNOWN, dtype=np.int8)
        self.seen_s = np.full((cells, cells), -np.inf)  # when each was met last, by who knows
        self._h_pos_m, self._h_neg_m = h_pos_m, h_neg_m
        average_m, count, states, seen_s = self._arrays
        self._spare = average_m.copy(), count.copy(), states.copy(), seen_s.copy()

    @property
    def _arrays(self) -> tuple[F64, I32, I8, F64]:
        return self.average_m, self.count, self.states, self.seen_s

    def turn_needed(self, turned_rad: float) -> bool:
        """Whether turning by an angle (counter-clockwise) moves the deciding cell by over a cell.

        That is the nearest cell with information in the central column, ahead of the laser; where
        there is none, no turn is needed.
        """
        row = _nearest_ahead(self.count)
        if row < 0:
            return False
        x_m = centre_of(self.cells // 2, self.cell_m, self.cells)
        y_m = centre_of(row, self.cell_m, self.cells)
        c, s = math.cos(turned_rad), math.sin(turned_rad)
        moved_m = max(abs(c * x_m - s * y_m - x_m), abs(s * x_m + c * y_m - y_m))
        return moved_m > self.cell_m

    def turn(self, turned_rad: float) -> None:
        """Turn the maps' content counter-clockwise about the laser."""
        now = self._arrays
        self.average_m, self.count, self.states, self.seen_s = self._spare
        self._spare = now
        self.erase()
        _turn(*now, self.cell_m, turned_rad, *self._arrays)

    def scroll(self, rows: int) -> None:
        """Move the content back by whole rows, as the robot goes ahead; forth where negative."""
        if rows != 0:
            _scroll(*self._arrays, rows)

    def warm(self) -> None:
        """Run the kernels that only a robot which moves needs; the maps stay as they are."""
        centre_of(0, self.cell_m, self.cells)
        self.turn(0.0)
        _scroll(*self._arrays, 0)

    def decide(self, touched: I32) -> None:
        """Decide the cells (flat indices) whose averages changed; one at a bound is an obstacle."""
        _decide(touched, self.average_m, self.states, self._h_pos_m, self._h_neg_m)

    def erase(self) -> None:
        self.average_m[...] = np.nan
        self.count[...] = 0
        self.states[...] = UNKNOWN
        self.seen_s[...] = -np.inf
