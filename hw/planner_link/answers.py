"""What one planner has asked for that comes in pieces: the newest sweep, then tiles.

A sweep is taken when its first piece is due, and kept until the last has gone. Pieces of tiles are
made when they are sent.
Source: planner link, section 3 (ASK, SCAN, TILE; docs/protocols/planner-link.md).
"""

import math
from typing import Protocol

import numpy as np

from core.records import ObstacleMap, SweepPoints
from hw.planner_link.frames import SCAN, SCAN_HEAD, encode_scan_head, lens_mm_of
from hw.planner_link.messages import ASK_SCAN, ASK_TILE, Ask
from hw.planner_link.scheduler import FrameScheduler
from hw.planner_link.tiles import PIECE_BYTES, Tiles, TileSource

POINT_BYTES, MOST_OFFSET, MOST_UNIT_MM = 6, 32_767, 255


class AnswerSource(TileSource, Protocol):
    """Where values and sweeps come from; what is not to be trusted is already left out."""

    def maybe_scan(self) -> SweepPoints | None:
        """The returns of the newest sweep in the map; none while there is none to be trusted."""


def pack_points(sweep: SweepPoints) -> tuple[int, bytes]:
    """All points of a sweep, 6 bytes each, and the millimetres that they count in.

    Those are as few as let the farthest point be told.
    """
    offsets_mm = sweep.points_m * 1000 - np.array(lens_mm_of(sweep), dtype=np.float64)
    far_mm = float(np.abs(offsets_mm).max(initial=0.0))
    unit_mm = min(MOST_UNIT_MM, max(1, math.ceil(far_mm / MOST_OFFSET)))
    told = np.clip(np.rint(offsets_mm / unit_mm), -MOST_OFFSET, MOST_OFFSET)
    return unit_mm, told.astype("<i2").tobytes()


class ScanAnswer:
    """The sweep that a planner has asked for, as far as it has not been sent."""

    def __init__(self, scheduler: FrameScheduler) -> None:
        self._scheduler, self.waiting = scheduler, False
        self._id = 0
        self._sweep: SweepPoints | None = None  # once the first piece is due
        self._unit_mm, self._packed, self._sent = 1, b"", 0

    def take(self, ask: Ask) -> None:
        """One more question replaces the one under way."""
        self._id, self.waiting, self._sweep = ask.id, True, None

    def forget(self) -> None:
        self.waiting, self._sweep = False, None

    def publish(self, budget: float, source: AnswerSource | None) -> None:
        """Pieces into the scheduler, under a budget of wire bytes."""
        scheduler = self._scheduler
        floor, most = scheduler.budget.credit - budget, scheduler.most_body - SCAN_HEAD.size
        if most < POINT_BYTES:  # no frame that this planner takes holds a point
            self.forget()
        while self.waiting:
            room = scheduler.room(scheduler.budget.credit - floor, SCAN_HEAD.size)
            if room < 0:
                return
            if self._sweep is None and not self._begin(source):
                scheduler.queue(SCAN, encode_scan_head(self._id, 0, 0, 0, None))
                self.forget()
                return
            left = len(self._packed) - POINT_BYTES * self._sent
            if room < min(left, max(POINT_BYTES, min(PIECE_BYTES, most))):
                return
            self._publish_piece(min(left, room) // POINT_BYTES)

    def _begin(self, source: AnswerSource | None) -> bool:
        """Take the newest sweep; False: there is none to be told."""
        self._sweep = source.maybe_scan() if source is not None else None
        if self._sweep is None:
            return False
        self._unit_mm, self._packed = pack_points(self._sweep)
        self._sent = 0
        return True

    def _publish_piece(self, points: int) -> None:
        total, first = len(self._packed) // POINT_BYTES, self._sent
        head = encode_scan_head(self._id, self._unit_mm, total, first, self._sweep)
        part = self._packed[POINT_BYTES * first : POINT_BYTES * (first + points)]
        self._scheduler.queue(SCAN, head + part)
        self._sent += points
        if self._sent == total:
            self.forget()


class Answers:
    """Both, of one planner."""

    def __init__(self, scheduler: FrameScheduler, cell_mm: int) -> None:
        self._scheduler = scheduler
        self.tiles, self.scan = Tiles(scheduler, cell_mm), ScanAnswer(scheduler)
        self.waiting = False

    def forget(self) -> None:
        """A planner has started: what its forerunner wanted is nobody's wish."""
        self.scan.forget()
        self.tiles.forget()
        self.waiting = False

    def take(self, ask: Ask) -> None:
        if ask.wants & ASK_SCAN:
            self.scan.take(ask)
        if ask.wants & ASK_TILE:
            self.tiles.take(ask)
        self.waiting = self.scan.waiting or self.tiles.waiting

    def publish(
        self, budget: float, window: ObstacleMap | None, geom_id: int, source: AnswerSource | None
    ) -> None:
        """Pieces into the scheduler, under a budget of wire bytes; no window: none is announced."""
        before = self._scheduler.budget.credit
        self.scan.publish(budget, source)
        spent = before - self._scheduler.budget.credit
        self.tiles.publish(budget - spent, window, geom_id, source)
        self.waiting = self.scan.waiting or self.tiles.waiting
