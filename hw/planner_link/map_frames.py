"""The map frames of one tick: changes in the order of their weight, then a slice of the refresh.

Source: planner link, sections 4, 6 and 7.
"""

import math
from collections import deque
from dataclasses import dataclass

from core.records import I32, ObstacleMap
from hw.planner_link import kernels
from hw.planner_link.frames import MAP, MAP_HEAD, REFRESH, encode_map
from hw.planner_link.kernels import EVERY, GONE, LONGEST_OP, MISSING, NEAR, NEW, URGENT
from hw.planner_link.published import PublishedMap
from hw.planner_link.recovery import Repair
from hw.planner_link.scheduler import FrameScheduler

SLICE_OPS = 120  # bytes of operations that a refresh slice is saved up for
SLICE_BODY = MAP_HEAD.size + SLICE_OPS
LEAST_SLICE_OPS = 32  # the MAP frame that every tick has
PASS_S = 0.2  # one refresh pass, where bandwidth allows
MOST_PER_CELL = LONGEST_OP + 1  # bytes of operations: its run, and a KEEP up to it
MOST_URGENT_FIRST = (NEW | NEAR, NEW, MISSING, GONE)
MARKS = 64  # places of a refresh round that are remembered
LEAST_ROOM = 3 * LONGEST_OP  # bytes of operations, without which no frame is begun


class MapPublisher:
    """Publishes the map to one planner: changes first, then the refresh."""

    def __init__(
        self, scheduler: FrameScheduler, ring: PublishedMap, repair: Repair, geom_id: int
    ) -> None:
        self._scheduler, self._map, self._repair = scheduler, ring, repair
        self._cells = ring.size**2
        self._due_cells = 0.0  # of the refresh, by its pace
        self._cursor = RefreshCursor(ring.size)
        self._rest_cell = 0  # where to go on with what did not fit
        self._origin: tuple[int, int] | None = None  # of the newest MAP frame
        self._has_map = False  # a MAP frame goes out in this tick
        self._slice_cost = scheduler.costs[SLICE_BODY]
        self._least_cost = scheduler.costs[MAP_HEAD.size + LEAST_SLICE_OPS] + 2
        self.geom_id = geom_id

    def begin_epoch(self) -> None:
        """Both ends start from unknown, under the next number."""
        self.geom_id = (self.geom_id + 1) % 256
        self._map.forget()
        self._repair.begin_epoch(self._scheduler.seq)
        self._cursor.begin()

    def follow(self, window: ObstacleMap) -> None:
        careful = self._repair.in_step or self._map.corner != self._origin
        old = self._map.update(window, careful)
        if old is not None:
            self._cursor.follow(window.corner_i - old[0], window.corner_j - old[1])

    def publish_changes(self) -> None:
        """All marked cells in one raster pass if they fit; else what weighs most first."""
        self._has_map = False
        marked = self._map.mark_again()
        if marked == 0:
            return
        if self._fit(EVERY, marked):
            self._publish_from(EVERY, 0, self._cells)
        elif self._publish_urgent(marked) and self._publish(EVERY | NEAR):
            # what is left, from where the last tick had to stop: no corner waits for ever
            begun = self._rest_cell
            self._rest_cell = self._publish_from(EVERY, begun, self._cells)
            if self._rest_cell == self._cells:
                self._rest_cell = self._publish_from(EVERY, 0, begun)

    def _publish_urgent(self, marked: int) -> bool:
        if not self._map.urgent:
            return True
        if self._fit(URGENT, marked):
            return self._publish(URGENT)
        return all(self._publish(wanted) for wanted in MOST_URGENT_FIRST)

    def _fit(self, wanted: int, marked: int) -> bool:
        """Whether one raster pass over the cells with such marks fits into this tick's budget.

        `marked`: cells with any.
        """
        scheduler, cell, most_bytes = self._scheduler, 0, marked * MOST_PER_CELL
        budget = scheduler.budget.credit - scheduler.budget.kept
        room = scheduler.room(budget, MAP_HEAD.size)
        if most_bytes + LEAST_ROOM < room:
            return True
        most = scheduler.most_body - MAP_HEAD.size
        if room == most and most > LEAST_ROOM:  # a frame ends when so little room is left
            frames = 1 + most_bytes // (most - LEAST_ROOM)
            if frames * (scheduler.costs[scheduler.most_body] + 2) < budget:
                return True
        while cell < self._cells:
            room = scheduler.room(budget, MAP_HEAD.size)
            if room < LEAST_ROOM:
                return False
            _, ops, cell, _ = self._map.encode(wanted, cell, self._cells, room, for_good=False)
            budget -= scheduler.costs[MAP_HEAD.size + len(ops)] if ops else 0
        return True

    def _publish(self, wanted: int) -> bool:
        return self._publish_from(wanted, 0, self._cells) == self._cells

    def _publish_from(self, wanted: int, cell: int, end: int) -> int:
        """MAP frames with those of cell..end; where to go on."""
        scheduler, budget = self._scheduler, self._scheduler.budget
        while cell < end:
            room = scheduler.room(budget.credit - budget.kept, MAP_HEAD.size)
            if room < LEAST_ROOM:
                return cell
            start, ops, cell, marked = self._map.encode(wanted, cell, end, room)
            if start >= 0:
                self._queue(0, start, ops, marked)
        return cell

    def refresh(self, dt_s: float, spare: float) -> None:
        """Slices of the rolling refresh, by its pace, of its share and `spare` wire bytes.

        A short slice at least goes out if no other MAP frame does.
        """
        scheduler, budget, cursor = self._scheduler, self._scheduler.budget, self._cursor
        self._due_cells = min(self._due_cells + self._cells * dt_s / PASS_S, self._cells)
        floor = budget.credit - spare
        while True:
            left = max(budget.credit - floor, min(budget.saved, budget.credit))
            if budget.saved < budget.most_saved:  # else its share is due, whatever it delays
                left = min(left, budget.line_left)
            if self._has_map and (self._due_cells < 1 or left < self._slice_cost):
                break
            begun, before = cursor.cell, budget.credit
            end = min(self._cells, begun + max(1, math.floor(self._due_cells)))
            room = scheduler.room(max(self._least_cost, left), MAP_HEAD.size)
            start, ops, cell, marked = self._map.encode(kernels.REFRESH, begun, end, room)
            # of a whole round of the refresh, which this frame ends, the first frame
            passed_seq = cursor.advance(scheduler.seq + 1, cell)
            self._repair.repaired = max(self._repair.repaired, passed_seq - 1)
            self._queue(REFRESH, start, ops, marked)
            self._due_cells = max(0.0, self._due_cells - (cell - begun))
            budget.saved = max(0.0, budget.saved - (before - budget.credit))
        if self._due_cells < 1:
            budget.saved = 0.0  # it keeps its pace: what it leaves is free for all else

    def _queue(self, flags: int, start: int, ops: bytes, marked: I32) -> None:
        """A frame with cells that were just encoded: it may say that it has repaired all."""
        origin, scheduler = self._map.corner, self._scheduler
        assert origin is not None
        self._origin, self._has_map = origin, True
        repaired = self._repair.note_map(scheduler.seq + 1, marked, origin)
        scheduler.queue(MAP, encode_map(origin, repaired, self.geom_id, start, ops), flags)


@dataclass(slots=True)
class Mark:
    """A slice of the refresh began here."""

    seq: int  # of its frame, unwrapped
    lap: int  # in which the refresh comes by again
    row: int  # of the window; may lie outside it
    column: int


class RefreshCursor:
    """The refresh's way round the window, cell by cell; `cell` is the next one to send.

    A receiver that lost a frame is whole again, even if it never answers, as soon as the refresh
    has come round to where it was when the frame after that one was sent: every cell has then
    either been sent again, or entered the window since, and is unknown to all who heard of that.
    """

    def __init__(self, size: int) -> None:
        self._size = size
        self.cell, self._lap = 0, 0
        self._marks: deque[Mark] = deque()
        self._marked_cell = -1  # where the newest mark was set, as `cell` then was

    def begin(self) -> None:
        self.cell, self._lap, self._marked_cell = 0, 0, -1
        self._marks.clear()

    def advance(self, seq: int, cell: int) -> int:
        """Frame `seq` has the cells up to `cell`; the frame of the newest mark passed, or 0."""
        size, marks, apart = self._size, self._marks, self.cell - self._marked_cell
        if self._marked_cell < 0 or not 0 <= apart < size**2 // MARKS:
            marks.append(Mark(seq, self._lap + 1, *divmod(self.cell, size)))
            self._marked_cell = self.cell
        self.cell = cell
        if cell >= size**2:
            self.cell, self._lap = 0, self._lap + 1
        newest, (row, column) = 0, divmod(self.cell, size)
        while marks and (self._lap, row, column) >= (marks[0].lap, marks[0].row, marks[0].column):
            newest = marks.popleft().seq
        return newest

    def follow(self, di: int, dj: int) -> None:
        """The window moved by (di, dj) cells: all places stay where they are in the world."""
        most = self._size - 1
        row, column = divmod(self.cell, self._size)
        if self.cell > 0:
            row, column = row - dj, max(0, min(most, column - di))
            self.cell = max(0, min(most, row)) * self._size + (column if row >= 0 else 0)
        for mark in self._marks:
            mark.row, mark.column = mark.row - dj, mark.column - di
        self._marked_cell = -1
