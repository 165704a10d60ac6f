"""What is not there any more: beams that pass where something stood.

A beam speaks against a thing if it passes through the very part of a cell where the thing was
seen, clearly between its lowest and its highest return, and goes on; before a robot that stands,
also if it passes just where the thing was seen last, and goes on far. Some scans in a row must do
so, without a return from the thing in between; then what stood in the cell is forgotten, and the
floor that was seen there counts again. Each beam is looked at every 20 cm, at other places in each
scan, so that the cost grows with neither the window nor the fineness of the cells.

Where some scans in a row see floor alone in a cell, none is missing there. What was low there, in
each part of which floor has been seen since, was floor lifted by an attitude that leant. Under what
is higher than LOW_M floor may well be seen: that stays.
Source: design, section 7 (clearing).
"""

import math

import numpy as np

from core.grid.places import flat_index, part_bit
from core.mapping.along import MOST_PLACES, REACH_M, STEP_M, first_place_m, places_along
from core.mapping.beams.cells import GONE_FLOOR_AGAIN, GONE_PASSED, CellGrid, Cells, forget, touch
from core.mapping.beams.ground_plane import Ground, ground_m
from core.mapping.freshness import Freshness
from core.mapping.rays import MIN_RANGE_M, Sweep
from core.records import F64, I32, U8
from jit import kernel

THROUGH = 8  # scans in a row
FINER = 5  # places in each step, where something stood
BEFORE_M = 0.3  # of a return, a beam proves nothing: it may graze what it hits
MARGIN_M, MARGIN_SLOPE = 0.02, 0.004  # below the highest and above the lowest return, by range
MARGIN_SHARE = 0.3  # or this share of what is between: who stands sees a thing at one height only
LEAST_HALF_M = 0.005
CLEAR_M = 0.7  # so far behind it, at least, the beam went on: it does not graze an edge
JUST_M = 0.008  # below where it was seen last: who came nearer saw things ever higher up
FLOOR_AGAIN = 4  # scans in a row that see floor alone end what a wrong one has said,
FLOOR_FOR_LONG, LOW_M = 8, 0.20  # and so many that something so low stood where they see floor


@kernel
def _ends_lack(cells: Cells, at: int) -> None:
    """Forget that floor lacked, unless parts still lack it."""
    cell = cells[at]
    if cell.miss_bits & ~cell.floor_bits == 0:
        cell.below, cell.miss, cell.miss_sure, cell.miss_bits = 0, 0, 0, 0
        cell.gone = GONE_FLOOR_AGAIN
        if cell.above == 0:
            cell.mean_m, cell.count = cell.floor_m, cell.floor_count


@kernel
def _was_floor(cells: Cells, at: int) -> bool:
    """Whether all that stood here was low, and floor has since been seen in each part of it."""
    cell = cells[at]
    return bool(cell.above > 0 and cell.top_m <= LOW_M and cell.high_bits & ~cell.floor_bits == 0)


@kernel
def see_floor_again(cells: Cells, at: int) -> None:
    """Floor alone was seen in a cell in FLOOR_AGAIN scans in a row, or more."""
    cell = cells[at]
    if cell.below + cell.miss > 0:
        _ends_lack(cells, at)
    if cell.floor_run >= FLOOR_FOR_LONG and _was_floor(cells, at):
        forget(cells, at, GONE_FLOOR_AGAIN)


@kernel
def _passes(cells: Cells, at: int, bit: int, h: float, r: float, stood: bool, serial: int) -> bool:
    """Whether a beam, at range r and height h, passes through what stood in a part of a cell."""
    cell = cells[at]
    if cell.above == 0 or cell.high_bits & bit == 0 or cell.above_scan == serial:
        return False
    is_last = stood and cell.hit_scan == cell.above_scan
    if is_last and cell.span_low_m - JUST_M <= h <= cell.span_high_m:
        return True  # just there it was seen last
    margin = min(MARGIN_M + MARGIN_SLOPE * r, MARGIN_SHARE * (cell.top_m - cell.low_m))
    middle = 0.5 * (cell.low_m + cell.top_m)
    half = max(0.5 * (cell.top_m - cell.low_m) - margin, LEAST_HALF_M)
    return bool(abs(h - middle) <= half)


@kernel
def _goes_through(
    origin: F64,
    ray: F64,
    middle: float,
    end: float,
    at: int,
    ground: Ground,
    window: tuple[int, int, int, float],
    sub: int,
    cells: Cells,
    stood: bool,
    serial: int,
) -> bool:
    """Whether a beam, about a range, is the first of its scan to pass through what stood in a cell.

    Each 5 cm is tried.
    """
    if cells[at].above == 0 or cells[at].through_scan == serial:
        return False
    for k in range(FINER):
        r = middle + (k - 0.5 * (FINER - 1)) * STEP_M / FINER
        x, y = origin[0] + r * ray[0], origin[1] + r * ray[1]
        if r < end and flat_index(x, y, window[3], (window[0], window[1]), window[2]) == at:
            h, bit = origin[2] + r * ray[2] - ground_m(ground, x, y), part_bit(x, y, window[3], sub)
            if _passes(cells, at, bit, h, r, stood and r < end - CLEAR_M, serial):
                return True
    return False


@kernel
def _note(
    touched: I32, used: int, cells: Cells, serial: int, t_s: float, stands: U8, seen_s: F64
) -> None:
    """Keep up in which cells something stands, and which were just hit."""
    for k in range(used):
        at = touched[k]
        stands[at] = 1 if cells[at].above > 0 else 0
        if cells[at].hit_scan == serial:
            seen_s[at] = t_s


@kernel
def _nearest_m(ranges_m: F64, i: int) -> float:
    """The nearest return of a beam; inf: none."""
    nearest = math.inf
    for e in range(ranges_m.shape[0]):
        if ranges_m[e, i] >= MIN_RANGE_M:
            nearest = min(nearest, ranges_m[e, i])
    return nearest


@kernel
def _was_gone_through(cells: Cells, at: int, serial: int, stands: U8) -> int:
    """Count a beam through what stood in a cell; 1 if that is gone now."""
    cells[at].through_scan = serial
    cells[at].through += 1
    if cells[at].through < THROUGH:
        return 0
    forget(cells, at, GONE_PASSED)
    stands[at] = 0
    return 1


@kernel
def _clear(
    origins: F64,
    rays: F64,
    ranges_m: F64,
    ground: Ground,
    window: tuple[int, int, int, float],
    sub: int,
    cells: Cells,
    stands: U8,
    clears: bool,
    stood: bool,
    serial: int,
    times: tuple[float, float],
    seen_s: F64,
    touched: I32,
    used: int,
    places: I32,
) -> tuple[int, int]:
    """How many cells `touched` lists, and how many were cleared.

    times: of the scan, and the oldest that is fresh. What beams pass over on their way down, and
    was fresh, stays so.
    """
    cleared = 0
    for i in range(rays.shape[0]):
        nearest = _nearest_m(ranges_m, i)
        if math.isinf(nearest):  # black, glass, or nothing: it proves nothing
            continue
        first, end = first_place_m(i, serial), nearest - BEFORE_M
        count = places_along(origins[i], rays[i], first, end, window, places)
        end, oldest_s = min(end, REACH_M), times[1] if rays[i, 2] < 0.0 else math.inf
        for k in range(count):
            at = places[k]
            if at < 0:
                continue
            if seen_s[at] >= oldest_s:
                seen_s[at] = times[0]
            if clears and stands[at] and _goes_through(
                origins[i], rays[i], first + k * STEP_M, end, at, ground, window, sub, cells, stood,
                serial,
            ):  # fmt: skip
                cleared += _was_gone_through(cells, at, serial, stands)
                used = touch(at, cells, serial, touched, used)
    return used, cleared


class FreeSpaceCarver:
    """Clears the cells of a `CellGrid` by the beams of sweeps."""

    def __init__(self, cells: CellGrid, fresh: Freshness) -> None:
        self._cells, self._fresh = cells, fresh
        self._stands: U8 = cells.grid.layer(np.uint8, 0).reshape(-1)  # 1: something stands there
        self._places: I32 = np.zeros(MOST_PLACES, dtype=np.int32)
        self._is_new = True
        self.cleared = 0  # cells so far

    def add(
        self, sweep: Sweep, ground: Ground, *, clears: bool = True, stood: bool = False
    ) -> None:
        """Take a sweep that was added to the cells just before.

        Args:
            clears: False where its heights are not to be trusted, or the ground is not known.
            stood: the robot did not move since the one before.
        """
        cells, seen_s = self._cells, self._fresh.seen_s
        if self._is_new:  # a map that was loaded stands before its first sweep
            self._stands[:] = cells.flat["above"] > 0
            self._is_new = False
        t_s = sweep.t_s
        _note(cells.touched, cells.used, cells.flat, cells.scan, t_s, self._stands, seen_s)
        cells.used, cleared = _clear(
            sweep.origins,
            sweep.rays,
            sweep.ranges_m,
            ground,
            cells.window,
            cells.sub,
            cells.flat,
            self._stands,
            clears,
            stood,
            cells.scan,
            (t_s, self._fresh.oldest_s),
            seen_s,
            cells.touched,
            cells.used,
            self._places,
        )
        self.cleared += int(cleared)
