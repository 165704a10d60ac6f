"""What of a place, known by its heights every 5 cm, is floor: what is reached without a step."""

from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from jit import allocating_kernel

F64 = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]
SAMPLE_M = 0.05
BOUND_M = 0.0995  # a step of 0.10 m is an obstacle,
DANGER_M = 0.1495  # and of one of 0.15 m none may be missed


@allocating_kernel
def _reach(
    heights: F64, begin: tuple[int, int], bound: float, reached: npt.NDArray[np.int8]
) -> None:
    """Flood from one sample over all steps below the bound; NaN is never reached."""
    rows, columns = heights.shape
    waiting = np.empty((rows * columns, 2), dtype=np.int64)
    waiting[0, 0], waiting[0, 1] = begin
    reached[begin] = 1
    used = 1
    while used > 0:
        used -= 1
        r, c = waiting[used]
        for k in range(4):
            nr, nc = r + (k == 0) - (k == 1), c + (k == 2) - (k == 3)
            if not (0 <= nr < rows and 0 <= nc < columns) or reached[nr, nc] == 1:
                continue
            if abs(heights[nr, nc] - heights[r, c]) < bound:
                reached[nr, nc] = 1
                waiting[used, 0], waiting[used, 1] = nr, nc
                used += 1


def floor_of(heights: F64, begins: Iterable[tuple[int, int]], bound: float) -> Bools:
    """Samples (rows, columns) that are reached from these ones (row, column)."""
    reached = np.zeros(heights.shape, dtype=np.int8)
    for begin in begins:
        if not reached[begin]:
            _reach(heights, begin, bound, reached)
    return np.asarray(reached == 1)


def edges_of(heights: F64, bound: float) -> Bools:
    """Samples with a step of the bound or more to one of their four neighbours."""
    filled = np.where(np.isnan(heights), -1e3, heights)
    edges = np.zeros(heights.shape, dtype=bool)
    for axis in (0, 1):
        step = np.abs(np.diff(filled, axis=axis)) >= bound
        low, high = [slice(None)] * 2, [slice(None)] * 2
        low[axis], high[axis] = slice(None, -1), slice(1, None)
        edges[tuple(low)] |= step
        edges[tuple(high)] |= step
    return edges
