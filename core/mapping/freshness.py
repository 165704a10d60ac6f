"""When a cell was last seen to be free of what may come in; what is too old is told as unknown.

Free ground stays fresh where something that comes in would be noticed: where beams end, where they
pass over on their way down, and under the robot itself. Elsewhere it ages. A beam that passes over
ground that is too old does not make it free again, for it does not see what is low: the floor must
be met. Each scan looks at some rows of the window, so that each row is looked at within SWEEP_S.
Source: design, section 8 (free is told only for what is known to be free now).
"""

import math

import numpy as np

from core.grid.ring import RingGrid, cells_about
from core.grid.window import ObstacleWindow, Shown, put_state
from core.records import F64, FREE, UNKNOWN
from jit import Settled, kernel

SWEEP_S = 1.0  # by so much may free ground be older than the settings say: the least age they allow


@kernel
def _cover(
    seen_s: F64,
    window: tuple[int, int, int, float],
    place: tuple[float, float, float, float],
    footprint: tuple[float, float, float],
    t_s: float,
) -> None:
    """Nothing comes in where the robot stands: the cells whose middles its footprint covers.

    place: x, y and unit vector of the heading. footprint: ahead, behind, to either side.
    """
    size, cell_m = window[2], window[3]
    x, y, hx, hy = place
    reach = math.hypot(max(footprint[0], footprint[1]), footprint[2])
    low_i, low_j, count = cells_about(x, y, reach, cell_m)
    first_i, end_i = max(low_i, window[0]), min(low_i + count, window[0] + size)
    for j in range(max(low_j, window[1]), min(low_j + count, window[1] + size)):
        row, dy = j % size * size, (j + 0.5) * cell_m - y
        column = first_i % size
        for i in range(first_i, end_i):
            dx = (i + 0.5) * cell_m - x
            ahead, aside = hx * dx + hy * dy, hx * dy - hy * dx
            if -footprint[1] <= ahead <= footprint[0] and abs(aside) <= footprint[2]:
                seen_s[row + column] = t_s
            column = column + 1 if column + 1 < size else 0  # no division for each of fine cells


@kernel
def _expire(
    seen_s: F64, oldest_s: float, from_size: int, rows: tuple[int, int], shown: Shown, used: int
) -> int:
    """Free cells of some rows (first, count) that are too old become unknown; the changes noted.

    So do those that only show where nothing is known.
    """
    size, low_i, low_j = shown.ring.size, shown.ring.corner_i, shown.ring.corner_j
    for k in range(rows[0], rows[0] + rows[1]):
        row = k % size
        j = low_j + (row - low_j) % size
        for column in range(size):
            at = row * size + column
            if shown.under[at] == FREE and shown.under_s[at] < oldest_s:
                shown.under[at] = UNKNOWN
            if shown.cells[at] != FREE:
                continue
            i = low_i + (column - low_i) % size
            if seen_s[(j % from_size) * from_size + i % from_size] < oldest_s:
                used = put_state(at, UNKNOWN, shown, used)
    return used


class Freshness:
    """The instants of the cells of a grid; another window that shows them may be smaller."""

    def __init__(
        self, grid: RingGrid, max_age_s: float, footprint: tuple[float, float, float]
    ) -> None:
        self._grid, self._max_age_s, self._footprint = grid, max_age_s, footprint
        self.seen_s: F64 = grid.layer(np.float64, -math.inf).ravel()
        self.now_s, self._passed_s = -math.inf, math.inf
        self._row = 0
        self._cover, self._expire = Settled(_cover), Settled(_expire)

    @property
    def oldest_s(self) -> float:
        """What was seen before is too old."""
        return self.now_s - self._max_age_s

    def ages_s(self, seen_s: F64) -> F64:
        """From instants (n,) to now; NaN for those that are none."""
        seen, ages_s = np.isfinite(seen_s), np.full(seen_s.shape, np.nan)
        ages_s[seen] = self.now_s - seen_s[seen]
        return ages_s

    def follow(self, t_s: float, x_m: float, y_m: float, heading: tuple[float, float]) -> None:
        """It is t_s, and the robot stands there; the grid has moved with it before."""
        self._passed_s, self.now_s = t_s - self.now_s, t_s
        grid = self._grid
        window = (grid.corner_i, grid.corner_j, grid.size, grid.cell_m)
        self._cover(self.seen_s, window, (x_m, y_m, *heading), self._footprint, t_s)

    def expire(self, window: ObstacleWindow) -> None:
        """Tell what has become too old as unknown, in so many rows as are due."""
        size = window.grid.size
        rows = math.ceil(size * min(self._passed_s / SWEEP_S, 1.0))
        window.used = self._expire(
            self.seen_s,
            self.oldest_s,
            self._grid.size,
            (self._row, rows),
            window.shown,
            window.used,
        )
        self._row = (self._row + rows) % size
