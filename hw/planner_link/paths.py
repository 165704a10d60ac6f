"""The path for one planner, in pieces of absolute points, and where the robot is on it.

A piece is a stretch of one segment. A new path has a new number, and replaces the one before.
Source: planner link, sections 3 (PATH), 6 and 7.
"""

import math
import struct
from collections import deque

import numpy as np
from msgspec import Struct

from core.records import F64, PathReport
from hw.planner_link.frames import PATH, REFRESH
from hw.planner_link.messages import Ack
from hw.planner_link.scheduler import FrameScheduler

PATH_HEAD = struct.Struct("<HBBHHHHHHii")  # see the sheet; the points follow
POINT_BYTES, MOST_PIECE, MOST_OFFSET = 4, 24, 32_767  # points of a piece
FARTHEST_MM, MOST_POINTS = 2_100_000_000, 16_384
EVERY_S, AHEAD_S = 0.2, 0.1  # a frame at least so often; and after the robot has passed a point
NOWHERE, ROUNDING_S = 0xFFFF, 1e-6
REMEMBERED, ACKED = 512, 33


class Piece(Struct, frozen=True):
    """Points of one segment that follow each other."""

    first: int  # point, counted through all segments
    segment: int
    sweeps: bool
    corner_mm: tuple[int, int]
    points: bytes  # offsets from there


class PathPublisher:
    """Tells one planner of the path."""

    def __init__(self, scheduler: FrameScheduler) -> None:
        self._scheduler, self._geom_id = scheduler, 0
        self._number = 0  # of the path; 0: none was told
        self._version: int | None = None
        self._most_points = 0  # of a piece
        self._pieces: list[Piece] = []
        self._total = self._segments = self._left_out = 0
        self._ahead = self._told_ahead = NOWHERE
        self._wanted: dict[int, None] = {}  # pieces to be told
        self._sent: deque[tuple[int, int]] = deque()  # frame, piece
        self._cursor, self._published_s = 0, -math.inf

    @property
    def waiting(self) -> bool:
        """Pieces are to be told."""
        return bool(self._wanted)

    def begin_epoch(self, geom_id: int) -> None:
        """The planner holds no path any more."""
        self._geom_id, self._version, self._published_s = geom_id, None, -math.inf
        self._wanted.clear()
        self._sent.clear()

    def tell_again(self) -> None:
        """Nobody knows what the planner holds, or it asks: pieces that wait already come first.

        So a planner that asks again and again gets to the end of a long path on a slow line.
        """
        if len(self._wanted) < len(self._pieces):
            self._wanted |= dict.fromkeys(range(len(self._pieces)))

    def follow(self, path: PathReport) -> None:
        """Take in the path as it is meant now."""
        most = (self._scheduler.most_body - PATH_HEAD.size) // POINT_BYTES
        most = min(MOST_PIECE, most)
        if path.version != self._version or most != self._most_points:
            if path.version != self._version:
                self._number = self._number % 0xFFFF + 1
            self._version, self._most_points = path.version, most
            self._cut(path)
            self._sent.clear()
            self._wanted.clear()
            self.tell_again()
        ahead = path.ahead
        self._ahead = ahead if ahead is not None and 0 <= ahead <= self._total else NOWHERE

    def _cut(self, path: PathReport) -> None:
        """Into pieces, as far as a frame can tell the points."""
        self._pieces, self._cursor, self._total = [], 0, 0
        self._segments = min(len(path.segments), 0xFFFF)
        points = sum(len(segment.points_m) for segment in path.segments)
        for number, segment in enumerate(path.segments[:0xFFFF]):
            told = _tellable(segment.points_m, MOST_POINTS - self._total)
            self._cut_segment(number, segment.sweeps, told)
            self._total += len(told)
            if len(told) < len(segment.points_m):
                break
        self._left_out = min(points - self._total, 0xFFFF)
        if not self._pieces:
            self._pieces = [Piece(0, 0, False, (0, 0), b"")]  # there are none: that is told

    def _cut_segment(self, number: int, sweeps: bool, points_mm: F64) -> None:
        begun = 0
        while begun < len(points_mm):
            part = points_mm[begun : begun + max(1, self._most_points)]
            offsets = part - part[0]
            far = np.abs(offsets).max(axis=1) > MOST_OFFSET
            count = int(far.argmax()) if far.any() else len(part)
            corner_mm = int(part[0, 0]), int(part[0, 1])
            told = offsets[:count].astype("<i2").tobytes()
            self._pieces.append(Piece(self._total + begun, number, sweeps, corner_mm, told))
            begun += count

    def take_ack(self, newest: int, ack: Ack) -> None:
        """An ACK of frames of this epoch, `newest` unwrapped: what it shows to be lost."""
        arrived = ack.mask << 1 | 1
        while self._sent and self._sent[0][0] <= newest:
            seq, piece = self._sent.popleft()
            if newest - seq >= ACKED or not arrived >> newest - seq & 1:
                self._wanted[piece] = None

    def publish(self, now_s: float, budget: float) -> None:
        """Frames into the scheduler, under a budget of wire bytes."""
        if self._most_points < 1:
            return  # no frame that this planner takes holds a point
        floor = self._scheduler.budget.credit - budget
        self.publish_wanted(now_s, budget)
        since_s = now_s - self._published_s
        passed = self._ahead != self._told_ahead and since_s >= AHEAD_S - ROUNDING_S
        if passed or since_s >= EVERY_S - ROUNDING_S:
            piece = self._cursor % len(self._pieces)
            if self._publish_piece(now_s, floor, piece, REFRESH):
                self._cursor = piece + 1

    def publish_wanted(self, now_s: float, budget: float) -> None:
        """Pieces that are new, got lost or were asked for, likewise."""
        floor = self._scheduler.budget.credit - budget
        while self._wanted and self._most_points > 0:
            if not self._publish_piece(now_s, floor, next(iter(self._wanted)), 0):
                break

    def _publish_piece(self, now_s: float, floor: float, number: int, flags: int) -> bool:
        """One piece, if there is room for it."""
        scheduler, piece = self._scheduler, self._pieces[number]
        room = scheduler.room(scheduler.budget.credit - floor, PATH_HEAD.size)
        if room < len(piece.points):
            return False
        head = PATH_HEAD.pack(
            *(self._number, self._geom_id, int(piece.sweeps), self._total, piece.first),
            *(piece.segment, self._segments, self._ahead, self._left_out, *piece.corner_mm),
        )
        self._sent.append((scheduler.seq + 1, number))
        if len(self._sent) > REMEMBERED:
            self._sent.popleft()
        scheduler.queue(PATH, head + piece.points, flags)
        self._wanted.pop(number, None)
        self._published_s, self._told_ahead = now_s, self._ahead
        return True


def _tellable(points_m: F64, most: int) -> F64:
    """(n, 2) whole millimetres: the points up to the first that no frame can tell."""
    points_mm = np.asarray(points_m, dtype=np.float64).reshape(-1, 2)[:most] * 1000
    fine = np.abs(points_mm).max(axis=1, initial=0.0) <= FARTHEST_MM  # no number is not fine
    count = len(points_mm) if fine.all() else int((~fine).argmax())
    told: F64 = np.rint(points_mm[:count])
    return told
