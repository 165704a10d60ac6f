"""What was published to one planner of each cell, and which cells to publish next.

Both ends keep the window as a ring; a cell is *marked* while what the planner holds may differ from
what is meant now: it changed, or the frame with it got lost. Encoding clears marks; nothing is
ever queued. Blocks of cells without a mark are left out, so that a tick costs what has changed and
its slice of the refresh.
Source: planner link, sections 3 (operations), 4 and 7.
"""

import zlib
from collections.abc import Iterable

import numpy as np

from core.records import I8, I32, U8, ObstacleMap
from hw.planner_link.kernels import (
    AGAIN,
    ANY,
    BLOCK,
    CHANGED,
    HOT,
    LOST,
    LOST_CELLS,
    MISSED,
    NO_SPAN,
    Ring,
    Span,
    encode_cells,
    enter_cells,
    mark_again,
    mark_cells,
    note_cells,
    pack_published,
)


def _span_of(corners: Iterable[tuple[int, int]]) -> Span:
    i, j = zip(*corners, strict=True)
    return min(i), max(i), min(j), max(j)


class PublishedMap:
    """The sender's side of the ring: states and marks, (size, size) flat, [j % size, i % size]."""

    def __init__(self, size: int) -> None:
        self.size = size
        blocks = (size + BLOCK - 1) // BLOCK
        self._ring = Ring(
            published=np.full(size * size, 0, dtype=np.uint8),
            marks=np.full(size * size, 0, dtype=np.uint8),
            rows=np.zeros((3, size), dtype=np.int32),
            blocks=np.full((3, size * blocks), 0, dtype=np.int32),
            counts=np.zeros(4, dtype=np.int32),
            once=np.full(size * size + 1, 0, dtype=np.int32),
            cleared=np.full(size * size, 0, dtype=np.int32),
        )
        self._every: I32 = np.arange(size * size, dtype=np.int32)
        self._ops: U8 = np.zeros(512, dtype=np.uint8)
        self._packed: U8 = np.full((size * size + 3) // 4, 0, dtype=np.uint8)
        self._cells: I8 = np.full(size * size, 0, dtype=np.int8)
        self._trusted = False
        self._span = NO_SPAN  # of the windows whose cells the planner may still hold
        self.corner: tuple[int, int] | None = None  # None: nothing was ever shown
        self._warm()

    def _warm(self) -> None:
        """Run what only an obstacle, a move or a loss needs: no kernel is compiled in the loop."""
        self.corner = (0, 0)
        mark_again(self._cells, self._ring)
        self._enter(self.corner, NO_SPAN)
        self.publish_again()
        self.forget()
        self.digest()
        self.corner = None

    @property
    def published(self) -> U8:
        """What the planner holds if all frames have arrived: (size * size,) link codes."""
        return self._ring.published

    @property
    def urgent(self) -> bool:
        """Whether obstacles came or went, or cells of lost frames are to be sent again."""
        return bool(self._ring.counts[HOT] or self._ring.counts[MISSED])

    @property
    def lost(self) -> int:
        """Cells of lost frames, not sent again yet."""
        return int(self._ring.counts[LOST_CELLS])

    def update(self, window: ObstacleMap, careful: bool) -> tuple[int, int] | None:
        """Take in the map as it is meant now; the old corner if the window has moved.

        `careful` publishes what comes back into the window before the planner is known to have
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
            self._enter(old, self._span if careful else NO_SPAN)
            low_i, high_i, low_j, high_j = self._span
            self._span = _span_of([(low_i, low_j), (high_i, high_j), corner])
        if len(listed):  # of a tick between two scans nothing
            note_cells(self._cells, self._trusted, listed, self._ring)
        return old if moved else None

    def _enter(self, old: tuple[int, int], span: Span) -> None:
        assert self.corner is not None
        enter_cells(self._cells, self._trusted, old, self.corner, span, self._ring)

    def forget(self) -> None:
        """The planner holds nothing any more: all cells unknown there."""
        for array in self._ring:
            array[:] = 0
        if self.corner is not None:
            self._span = _span_of([self.corner])
            note_cells(self._cells, self._trusted, self._every, self._ring)

    def put_away(self) -> None:
        """Nothing is published from now on: until the next `update`, as at the start."""
        self.corner = None
        self.forget()

    def publish_again(self) -> None:
        """Nobody knows what the planner holds: send every cell again."""
        self._mark(self._every, 0, LOST | CHANGED)

    def _mark(self, listed: I32, kept: int, reason: int) -> None:
        mark_cells(self._cells, self._trusted, listed, kept, reason, self._ring)

    def encode(
        self, wanted: int, first: int, end: int, room: int, for_good: bool = True
    ) -> tuple[int, bytes, int, I32]:
        """Operations for the wanted cells of first..end in window raster order.

        Returns the first cell addressed (-1: nothing to send), the operations, where to go on, and
        the cells that had been marked: (k,) raster indices. Nothing is published if not for good.
        """
        assert self.corner is not None
        room = min(room, self._ops.size)
        meant = self._cells, self._trusted, self.corner
        start, used, count, next_cell = encode_cells(
            wanted, first, end, room, for_good, *meant, self._ring, self._ops
        )
        return start, self._ops[:used].tobytes(), next_cell, self._ring.cleared[:count].copy()

    def mark_again(self) -> int:
        """New obstacles published since the last call are to be once more; all cells to publish."""
        if self._ring.once[0]:
            mark_again(self._cells, self._ring)
        return int(self._ring.counts[ANY])

    def mark_lost(self, lost: I32, origin: tuple[int, int]) -> None:
        """Send (k,) cells again, raster indices in the window at `origin` as `encode` gave them."""
        if self.corner is not None:
            size, (corner_i, corner_j) = self.size, self.corner
            j, i = np.divmod(lost, size)
            i, j = i + origin[0] - corner_i, j + origin[1] - corner_j  # in the present window
            inside = (i >= 0) & (i < size) & (j >= 0) & (j < size)
            at = (j[inside] + corner_j) % size * size + (i[inside] + corner_i) % size
            self._mark(at.astype(np.int32), CHANGED | AGAIN, LOST)

    def note_seen(self, seen: tuple[int, int], since: Iterable[tuple[int, int]]) -> None:
        """The planner has had the window at `seen`, and perhaps at those corners since."""
        low_i, high_i, low_j, high_j = self._span
        has_moved = low_i < high_i or low_j < high_j
        if has_moved and self.corner is not None:
            self._span = _span_of([seen, *since, self.corner])

    def digest(self) -> int:
        """CRC-32 of the window as published, four cells a byte: what a DIGEST frame says."""
        assert self.corner is not None
        pack_published(self.corner, self._ring, self._packed)
        return zlib.crc32(self._packed.data)
