"""Returns that stand alone in the air: dust, rain, sunlight. They count when they come again.

Whatever is as wide as a beam returns several neighbours, or the same place in the next scan. A
rising return whose neighbours both end elsewhere is left out unless the cell had such a one within
half a second: so grains of dust leave no obstacles, and a thin post is there one scan later.
Source: design, section 7 (what was seen once is looked at again).
"""

import numpy as np

from core.grid.places import flat_index
from core.mapping.beams.cells import CellGrid
from core.mapping.beams.ground_plane import Ground, ground_m
from core.mapping.rays import MIN_RANGE_M, Sweep
from core.records import F64, U8
from jit import kernel

ALONE_M = 0.3  # neighbours that end so much nearer or farther are of something else
SOON_S = 0.5


@kernel
def _is_alone(ranges_m: F64, i: int) -> bool:
    """Whether no echo of the beams on either side ends near a beam's first one; edges are not."""
    if not 0 < i < ranges_m.shape[1] - 1:
        return False
    for e in range(ranges_m.shape[0]):
        for k in (i - 1, i + 1):
            if abs(ranges_m[e, k] - ranges_m[0, i]) <= ALONE_M:
                return False
    return True


@kernel
def _find(
    origins: F64,
    rays: F64,
    ranges_m: F64,
    ground: Ground,
    h_pos_m: float,
    window: tuple[int, int, int, float],
    t_s: float,
    last_s: F64,
    skipped: U8,
) -> None:
    """Which beams (n,) are left out; `last_s`: when each cell had its newest one."""
    for i in range(rays.shape[0]):
        skipped[i], r = 0, ranges_m[0, i]
        if not r >= MIN_RANGE_M or not _is_alone(ranges_m, i):
            continue
        x, y = origins[i, 0] + r * rays[i, 0], origins[i, 1] + r * rays[i, 1]
        at = flat_index(x, y, window[3], (window[0], window[1]), window[2])
        if at < 0 or origins[i, 2] + r * rays[i, 2] - ground_m(ground, x, y) < h_pos_m:
            continue
        before_s, last_s[at] = last_s[at], t_s
        if not 0.0 < t_s - before_s <= SOON_S:
            skipped[i] = 1


class IsolatedReturns:
    """Finds the lone returns of sweeps over the cells of a `CellGrid`."""

    def __init__(self, cells: CellGrid, h_pos_m: float, max_beams: int) -> None:
        self._cells, self._h_pos_m = cells, h_pos_m
        self._last_s: F64 = cells.grid.layer(np.float64, -np.inf).reshape(-1)
        self._skipped: U8 = np.zeros(max_beams, dtype=np.uint8)

    def find(self, sweep: Sweep, ground: Ground) -> U8:
        """(n,), 1 for each beam that is not to be believed; kept until the next call."""
        skipped = self._skipped[: len(sweep.rays)]
        _find(
            sweep.origins,
            sweep.rays,
            sweep.ranges_m,
            ground,
            self._h_pos_m,
            self._cells.window,
            sweep.t_s,
            self._last_s,
            skipped,
        )
        return skipped
