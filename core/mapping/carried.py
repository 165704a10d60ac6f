"""What a map still says of the ground after its robot has moved unseen, by a bounded way.

Free is what was free wherever a cell can have been, an obstacle what was one anywhere there; the
rest is not known. Ages are those of the oldest look.
"""

import numpy as np

from core.mapping.method import Maps
from core.motion.shift import Shift
from core.records import F64, FREE, I8, I64, OBSTACLE, UNKNOWN


def carried(maps: Maps, shift: Shift) -> tuple[I8, F64]:
    """States (size, size) of the window as they hold behind a shift, and when each was seen.

    Both are laid out as the window is; seen_s is host time, of what is free.
    """
    window = maps.window
    grid, size = window.grid, window.grid.size
    rows, columns = ((corner + np.arange(size)) % size for corner in (grid.corner_j, grid.corner_i))
    here = np.ix_(rows, columns)
    j, i = np.indices((size, size)).reshape(2, -1)
    ages_s = maps.ages_s(i + grid.corner_i, j + grid.corner_j).reshape(size, size)
    seen_s = maps.fresh.now_s - np.nan_to_num(ages_s, nan=np.inf)
    laid_under = window.under[here] == FREE  # whichever of both it shows, this is older
    seen_s = np.where(laid_under, window.under_s[here], seen_s)
    states, seen_s = spread(window.cells[here], seen_s, shift.cells(grid.cell_m))
    out, out_s = np.full_like(states, UNKNOWN), np.full_like(seen_s, -np.inf)
    out[here], out_s[here] = states, seen_s
    return out, out_s


def spread(states: I8, seen_s: F64, steps: I64) -> tuple[I8, F64]:
    """States (n, n), row j and column i, of cells that can be any to which a step leads.

    Args:
        steps: (k, 2) i, j. All outside of the states is unknown.
    """
    n, most = len(states), int(np.abs(steps).max())
    around = np.pad(states, most, constant_values=UNKNOWN)
    around_s = np.pad(seen_s, most, constant_values=-np.inf)
    is_free, bars = np.full(states.shape, True), np.full(states.shape, False)
    oldest_s = np.full(states.shape, np.inf)
    for i, j in steps + most:
        part = around[j : j + n, i : i + n]
        is_free &= part == FREE
        bars |= part == OBSTACLE
        np.minimum(oldest_s, around_s[j : j + n, i : i + n], out=oldest_s)
    told = np.where(bars, OBSTACLE, np.where(is_free, FREE, UNKNOWN)).astype(np.int8)
    return told, oldest_s
