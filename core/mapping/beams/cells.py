"""What method `beams` keeps of each cell: one record, so that a beam touches one place in memory.

Heights are metres above the tracked ground (`ground.py`), but for `z_m`, which is of the map
frame. A cell is divided into `sub` x `sub` parts of some 5 cm; the bits say in which of them
something was seen. Counts of scans grow once per scan: the errors of one scan come together.
"""

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from core.grid.places import parts_of
from core.grid.ring import RingGrid
from core.records import I32
from jit import kernel, with_fields

Cells = npt.NDArray[Any]  # flat, of CELL

CELL = np.dtype(
    [
        ("mean_m", np.float64),  # height: average, or filtered by its own error model
        ("var_m2", np.float64),  # its variance
        ("floor_m", np.float64),  # average of the returns within the bounds alone
        ("z_m", np.float64),  # average height in the map frame
        ("z_low_m", np.float64),  # lowest and highest return, map frame
        ("z_high_m", np.float64),
        ("low_m", np.float64),  # lowest and highest return that rises off the floor
        ("top_m", np.float64),
        ("span_low_m", np.float64),  # lowest and highest return of the newest scan that hit it
        ("span_high_m", np.float64),
        ("t_s", np.float64),  # when it was last hit
        ("count", np.int32),  # returns
        ("floor_count", np.int32),
        ("looks", np.int32),  # scans of which a return fell in; -1: of a loaded map, none yet
        ("floor_run", np.int32),  # the newest of them, in a row, that saw floor alone
        ("above", np.int32),  # scans with a return at or above h_pos,
        ("below", np.int32),  # or at or below h_neg,
        ("miss", np.int32),  # or in which floor was due here and did not show
        ("miss_sure", np.int32),  # those of them that found nothing, or nothing above h_neg
        ("through", np.int32),  # scans in a row in which a beam passed through what stood here
        ("outliers", np.int32),  # returns in a row that the filter did not believe
        ("soft", np.int32),  # rising returns that scatter or echo twice,
        ("hard", np.int32),  # and those that do not
        ("doubles", np.int32),  # rising returns that echo twice
        ("hit_scan", np.int32),  # number of the newest scan that did each of these
        ("stamp", np.int32),
        ("above_scan", np.int32),
        ("below_scan", np.int32),
        ("miss_scan", np.int32),
        ("miss_sure_scan", np.int32),
        ("through_scan", np.int32),
        ("floor_bits", np.int32),  # parts where floor was seen,
        ("high_bits", np.int32),  # or something at or above h_pos,
        ("miss_bits", np.int32),  # or where floor was due and did not show
        ("rising", np.int8),  # 1 once something rose or fell in it
        ("gone", np.int8),  # why what stood or lacked here is gone, below; 0: nothing did
        ("far_sides", np.int32),  # bit k: a beam went on towards octant k
    ],
    align=True,
)
BLANK = np.zeros((), dtype=CELL)
GONE_PASSED, GONE_FLOOR_AGAIN, GONE_JUDGED = 1, 2, 3


@kernel
def known(cells: Cells, at: int) -> bool:
    """Whether anything at all was seen of a cell; of a loaded map's, in this run."""
    cell = cells[at]
    return bool((cell.count > 0 and cell.looks >= 0) or cell.miss > 0)


@kernel
def touch(at: int, cells: Cells, serial: int, touched: I32, used: int) -> int:
    """Note a flat cell index once per scan."""
    if cells[at].stamp != serial and used < touched.size:
        cells[at].stamp = serial
        touched[used] = at
        return used + 1
    return used


@kernel
def touch_around(at: int, size: int, cells: Cells, serial: int, touched: I32, used: int) -> int:
    """Note a cell that is seen for the first time, and its neighbours: they wait for it."""
    row, column = at // size, at % size
    for dj in range(-1, 2):
        for di in range(-1, 2):
            near = ((row + dj) % size) * size + (column + di) % size
            used = touch(near, cells, serial, touched, used)
    return used


@kernel
def forget(cells: Cells, at: int, gone: int) -> None:
    """What stood in the cell is gone, and why; the floor that was seen there stays."""
    cell = cells[at]
    cell.gone = gone
    cell.above, cell.high_bits, cell.rising, cell.through = 0, 0, 0, 0
    cell.soft, cell.hard, cell.doubles, cell.outliers = 0, 0, 0, 0
    cell.low_m, cell.top_m = math.inf, -math.inf
    cell.mean_m, cell.count = cell.floor_m, cell.floor_count
    cell.z_high_m = cell.z_low_m
    cell.z_m = cell.z_low_m


class CellGrid:
    """A RingGrid of CELL records, (size, size), and the list of those that one scan touched."""

    def __init__(self, size: int, cell_m: float) -> None:
        self.grid = RingGrid(size, cell_m)
        self.cells: Cells = self.grid.layer(CELL, BLANK)
        self.flat: Cells = with_fields(self.cells.reshape(-1))
        self.sub = parts_of(cell_m)
        self.touched: I32 = np.full(size**2, 0, dtype=np.int32)
        self.used = 0  # of `touched`
        self.scan = 0  # number of the newest scan

    @property
    def window(self) -> tuple[int, int, int, float]:
        """Corner i, corner j, size, edge of a cell in metres."""
        return self.grid.corner_i, self.grid.corner_j, self.grid.size, self.grid.cell_m

    def begin_scan(self) -> int:
        """A new scan: nothing is touched yet; returns its number."""
        self.scan += 1
        self.used = 0
        return self.scan
