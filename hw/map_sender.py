"""What the planner has been told of each cell, and which cells to tell next.

Both ends keep the window as a ring; a cell is *marked* while what the planner holds may differ from
what is meant now: it changed, or a frame that told it got lost. Encoding clears marks; nothing is
ever queued. The kernels walk rows that hold marks, and leave the others out.
Source: planner link, sections 3 (operations), 4 and 7.
"""

from collections.abc import Callable
from typing import ParamSpec, TypeVar, cast

import numba
import numpy as np

from core.records import I8, I32, U8, ObstacleWindow

UNKNOWN, FREE, OBSTACLE, KEEP = 0, 1, 2, 3
CHANGED, LOST = 1, 2  # why a cell is marked, bits

ALL, NEW_NEAR, NEW, GONE, NEAR, REST, REFRESH = range(7)  # which cells a pass writes
IN_ORDER = (NEW_NEAR, NEW, GONE, NEAR, REST)
NEAR_SHARE = 3  # near is within a third of the half-width
OP_ROOM = 8  # bytes that one KEEP and one run may take

Snapshot = tuple[U8, U8, I32, int]
Span = tuple[int, int, int, int]  # lowest and highest corner i, lowest and highest corner j
NO_SPAN: Span = (0, -(2**40), 0, -(2**40))  # holds no cell
P = ParamSpec("P")
R = TypeVar("R")


def kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile with Numba, kept on disk beside the source."""
    return cast(Callable[P, R], numba.njit(cache=True)(function))


@kernel
def _code(cell: int, trusted: bool) -> int:
    """The state to tell for a cell of the obstacle map: 1 obstacle, 0 unknown, -1 free."""
    if cell == 1:
        return OBSTACLE
    return FREE if cell == -1 and trusted else UNKNOWN


@kernel
def _remark(at: int, bit: int, on: bool, marks: U8, row_marks: I32, size: int) -> int:
    """Set or clear one reason of one cell; returns the change in the number of LOST cells."""
    old = marks[at]
    new = old | bit if on else old & ~bit
    marks[at] = new
    row_marks[at // size] += int(new != 0) - int(old != 0)
    return int(new & LOST != 0) - int(old & LOST != 0)


@kernel
def _note(
    cells: I8, trusted: bool, changed: I32, told: U8, marks: U8, row_marks: I32, size: int
) -> None:
    """Mark those of the listed cells that are meant otherwise than told."""
    for at in changed:
        differs = _code(cells[at], trusted) != told[at]
        _remark(at, CHANGED, differs, marks, row_marks, size)


@kernel
def _enter(
    cells: I8,
    trusted: bool,
    old: tuple[int, int],
    new: tuple[int, int],
    span: Span,
    told: U8,
    marks: U8,
    row_marks: I32,
    size: int,
) -> int:
    """Cells that come in are unknown on both ends; returns the change in LOST cells.

    Those that a window within `span` had are told all the same: a planner that missed the move
    by which they left has not forgotten them.
    """
    lost = 0
    end = new[0] + size
    first_in, end_in = new[0], min(old[0], end)  # columns that come in, when moving to lower i
    if new[0] > old[0]:
        first_in, end_in = max(new[0], old[0] + size), end
    for j in range(new[1], new[1] + size):
        row_in = not old[1] <= j < old[1] + size
        row_spanned = span[2] <= j < span[3] + size
        for i in range(new[0] if row_in else first_in, end if row_in else end_in):
            at = (j % size) * size + i % size
            told[at] = UNKNOWN
            back = row_spanned and span[0] <= i < span[1] + size
            lost += _remark(at, LOST, back, marks, row_marks, size)
            differs = _code(cells[at], trusted) != UNKNOWN
            _remark(at, CHANGED, differs, marks, row_marks, size)
    return lost


@kernel
def _wanted(kind: int, mark: int, code: int, was: int, near: bool) -> bool:
    """Whether a pass of this kind writes a cell."""
    if kind == REFRESH:
        return True
    if mark == 0:
        return False
    if kind == NEW_NEAR:
        return code == OBSTACLE and near
    if kind == NEW:
        return code == OBSTACLE
    if kind == GONE:
        return was == OBSTACLE
    return kind != NEAR or near


@kernel
def _put(state: int, run: int, ops: U8, used: int) -> int:
    """Append one operation; returns the new length."""
    if run <= 63:
        ops[used] = state << 6 | run - 1
        return used + 1
    ops[used] = state << 6 | 63
    rest, used = run - 64, used + 1
    while rest >= 128:
        ops[used] = rest % 128 | 128
        rest, used = rest // 128, used + 1
    ops[used] = rest
    return used + 1


@kernel
def _encode(
    kind: int,
    first: int,
    end: int,
    room: int,
    cells: I8,
    trusted: bool,
    corner: tuple[int, int],
    told: U8,
    marks: U8,
    row_marks: I32,
    size: int,
    ops: U8,
) -> tuple[int, int, int, int]:
    """Write wanted cells of first..end (window raster) into `ops`, at most `room` bytes.

    Returns the first cell written (-1: none), bytes, where to go on, and the change in LOST cells.
    """
    start, used, lost = -1, 0, 0
    state, run, gap = KEEP, 0, 0
    half, third = size // 2, max(1, size // 2 // NEAR_SHARE)
    at_cell = first
    while at_cell < end:
        row, column = at_cell // size, at_cell % size
        ring_row = (corner[1] + row) % size
        if kind != REFRESH and row_marks[ring_row] == 0:
            gap += min(end, (row + 1) * size) - at_cell
            at_cell = (row + 1) * size
            continue
        at = ring_row * size + (corner[0] + column) % size
        code = _code(cells[at], trusted)
        near = abs(row - half) <= third and abs(column - half) <= third
        if not _wanted(kind, marks[at], code, told[at], near):
            gap, at_cell = gap + 1, at_cell + 1
            continue
        if run == 0 or gap > 0 or code != state:
            if used + 2 * OP_ROOM > room:
                break
            if run > 0:
                used = _put(state, run, ops, used)
                if gap > 0:
                    used = _put(KEEP, gap, ops, used)
            else:
                start = at_cell
            state, run, gap = code, 0, 0
        run += 1
        told[at] = code
        lost += _remark(at, LOST, False, marks, row_marks, size)
        _remark(at, CHANGED, False, marks, row_marks, size)
        at_cell += 1
    if run > 0:
        used = _put(state, run, ops, used)
    return start, used, min(at_cell, end), lost


@kernel
def _mark_lost(
    start: int,
    ops: U8,
    origin: tuple[int, int],
    corner: tuple[int, int],
    marks: U8,
    row_marks: I32,
    size: int,
) -> int:
    """Mark the cells that a lost frame wrote, where the window still covers them."""
    lost, cursor, k = 0, start, 0
    while k < ops.size:
        state, run = ops[k] >> 6, int(ops[k] & 63) + 1
        k += 1
        if run == 64:
            shift = 0
            while True:
                run += int(ops[k] & 127) << shift
                shift, k = shift + 7, k + 1
                if ops[k - 1] < 128:
                    break
        if state != KEEP:
            for cell in range(cursor, cursor + run):
                i, j = origin[0] + cell % size, origin[1] + cell // size
                if 0 <= i - corner[0] < size and 0 <= j - corner[1] < size:
                    at = (j % size) * size + i % size
                    lost += _remark(at, LOST, True, marks, row_marks, size)
        cursor += run
    return lost


def _span_of(corners: list[tuple[int, int]]) -> Span:
    i, j = [corner[0] for corner in corners], [corner[1] for corner in corners]
    return min(i), max(i), min(j), max(j)


class MapSender:
    """The sender's side of the ring: `told` and marks, (size, size) flat, [j % size, i % size]."""

    def __init__(self, size: int) -> None:
        self.size = size
        self.told: U8 = np.zeros(size * size, dtype=np.uint8)
        self._marks: U8 = np.zeros(size * size, dtype=np.uint8)
        self._row_marks: I32 = np.zeros(size, dtype=np.int32)
        self._every: I32 = np.arange(size * size, dtype=np.int32)
        self._ops: U8 = np.zeros(512, dtype=np.uint8)
        self._cells: I8 = np.zeros(size * size, dtype=np.int8)
        self._trusted = False
        self._span = NO_SPAN  # of the windows whose cells the planner may still hold
        self.corner: tuple[int, int] | None = None
        self.lost = 0  # cells of lost frames, not told again yet
        self._warm()

    def _warm(self) -> None:
        """Run the kernels that only a move or a loss needs: none is compiled in the loop."""
        self.corner = (0, 0)
        self.mark_lost(0, b"", self.corner)
        self._enter(self.corner, False, NO_SPAN)
        self.corner = None

    @property
    def marked(self) -> int:
        """Cells to be told."""
        return int(self._row_marks.sum())

    def update(self, window: ObstacleWindow, careful: bool) -> tuple[int, int] | None:
        """Take in the map as it is meant now; the old corner if the window has moved.

        `careful` tells what comes back into the window before the planner is known to have
        forgotten it.
        """
        self._cells = window.cells.ravel()
        old, corner = self.corner, (window.corner_i, window.corner_j)
        listed = window.changed
        if old is None or window.trusted != self._trusted:
            listed = self._every
        self.corner, self._trusted = corner, window.trusted
        moved = old is not None and old != corner
        if old is None:
            self._span = _span_of([corner])
        elif moved:
            self._enter(old, window.trusted, self._span if careful else NO_SPAN)
            low_i, high_i, low_j, high_j = self._span
            self._span = _span_of([(low_i, low_j), (high_i, high_j), corner])
        self._note(listed)
        return old if moved else None

    def _enter(self, old: tuple[int, int], trusted: bool, span: Span) -> None:
        assert self.corner is not None
        self.lost += _enter(
            self._cells,
            trusted,
            old,
            self.corner,
            span,
            self.told,
            self._marks,
            self._row_marks,
            self.size,
        )

    def _note(self, listed: I32) -> None:
        _note(
            self._cells,
            self._trusted,
            listed,
            self.told,
            self._marks,
            self._row_marks,
            self.size,
        )

    def forget(self) -> None:
        """The planner holds nothing any more: all cells unknown there."""
        self.told[:] = UNKNOWN
        self._marks[:] = 0
        self._row_marks[:] = 0
        self.lost = 0
        self._span = NO_SPAN if self.corner is None else _span_of([self.corner])
        self._note(self._every)

    def retell(self) -> None:
        """Nobody knows what the planner holds: tell every cell again."""
        self._marks |= LOST
        self._row_marks[:] = self.size
        self.lost = self.size**2

    def encode(self, kind: int, first: int, end: int, room: int) -> tuple[int, bytes, int]:
        """Operations for the wanted cells of first..end in window raster order.

        Returns the first cell addressed (-1: nothing to tell), the operations, where to go on.
        """
        assert self.corner is not None
        start, used, next_cell, lost = _encode(
            kind,
            first,
            end,
            min(room, self._ops.size),
            self._cells,
            self._trusted,
            self.corner,
            self.told,
            self._marks,
            self._row_marks,
            self.size,
            self._ops,
        )
        self.lost += lost
        return start, self._ops[:used].tobytes(), next_cell

    def mark_lost(self, start: int, ops: bytes, origin: tuple[int, int]) -> None:
        """A frame did not arrive: tell its cells again."""
        if self.corner is not None:
            written = np.frombuffer(ops, dtype=np.uint8)
            self.lost += _mark_lost(
                start, written, origin, self.corner, self._marks, self._row_marks, self.size
            )

    def note_seen(self, seen: tuple[int, int], since: list[tuple[int, int]]) -> None:
        """The planner has had the window at `seen`, and perhaps at those corners since."""
        if self.corner is not None:
            self._span = _span_of([seen, *since, self.corner])

    def snapshot(self) -> Snapshot:
        """What has been told and is still to tell, for `restore`."""
        return self.told.copy(), self._marks.copy(), self._row_marks.copy(), self.lost

    def restore(self, snapshot: Snapshot) -> None:
        """As if nothing had been encoded since."""
        self.told[:], self._marks[:], self._row_marks[:] = snapshot[:3]
        self.lost = snapshot[3]
