"""The objects of the vector map for one planner: changes first, then the rolling refresh.

Each frame tells how many objects the planner must hold now and a digest of them, as far as they
were told: so it knows whether something is missing. A slice of the refresh tells all objects of a
range of ids, and thereby that there is no other in it. Nothing here says that anything is free.
Source: planner link, sections 3 (OBJECTS), 6 and 7.
"""

import math
import zlib
from bisect import bisect_left
from collections import deque
from collections.abc import Iterator
from typing import Protocol

from msgspec import Struct

from core.records import OBJECT_MOVING, ObjectChanges, ObjectReport
from hw.planner_link.frames import OBJECTS, REFRESH
from hw.planner_link.messages import Ack
from hw.planner_link.object_records import (
    AGE,
    CORNER_BYTES,
    LEAST_BODY,
    MOST_BODY,
    MOST_CORNERS,
    OBJECTS_HEAD,
    REST,
    age_ms,
    gone_record,
    maybe_record,
)
from hw.planner_link.scheduler import FrameScheduler

EVERY_S = 0.1  # an OBJECTS frame at least so often, and the state of one moving object at most
ROUND_S = 2.0  # one round of the refresh, where the line has room
ROUNDING_S = 1e-6
REMEMBERED = 512  # frames without an ACK
MOST_OBJECTS, LAST_ID = 4096, 2**32 - 1
NO_RANGE = (1, 0)
ACKED = 33  # newest frames that an ACK tells of


class ObjectSource(Protocol):
    """The objects as the planners are to know them, in the map frame of the present epoch."""

    @property
    def version(self) -> int:
        """From 0; another one with each change."""

    @property
    def looked_s(self) -> float:
        """Host time of the newest frame that the objects take into account; -inf: none."""

    def changes(self, since: int) -> ObjectChanges:
        """What is different from an older version; since -1: all objects that there are."""


class Meant(Struct):
    """An object as it is meant now."""

    record: bytes  # without its age
    seen_s: float
    moves: bool
    told_s: float = -math.inf


class Sent(Struct, frozen=True):
    """A frame on its way: what to tell again if it gets lost."""

    seq: int  # unwrapped
    ids: list[int]  # told, or told to be gone


class ObjectPublisher:
    """Tells one planner of the objects."""

    def __init__(self, scheduler: FrameScheduler) -> None:
        self._scheduler, self._geom_id = scheduler, 0
        self._corners = 0  # that a record may have; 0: no frame that this planner takes holds one
        self._version = -1
        self._meant: dict[int, Meant] = {}
        self._ids: list[int] = []  # sorted
        self._told: dict[int, int] = {}  # digest of each object that the planner must hold now
        self._digest = 0  # sum of those
        self._moving: dict[int, None] = {}  # to be told, in this order
        self._waiting: dict[int, None] = {}  # likewise, standing ones and ids that are gone
        self._untold: set[int] = set()  # that no record can tell
        self._crowded = False  # some of them only because there are so many
        self._sent: deque[Sent] = deque()
        self._newest: dict[int, int] = {}  # by id, newest frame on its way that told of it
        self._cursor, self._round_due = 0, False
        self._published_s = self._refreshed_s = -math.inf

    @property
    def round_due(self) -> bool:
        """A whole round of the refresh is under way."""
        return self._round_due

    def begin_epoch(self, geom_id: int) -> None:
        """The planner holds no object any more, and what is meant is read anew."""
        self._geom_id, self._round_due = geom_id, False
        self._published_s = self._refreshed_s = -math.inf
        self._clear()

    def _clear(self) -> None:
        self._version, self._crowded = -1, False
        self._ids.clear()
        self._untold.clear()
        self._sent.clear()
        self._meant.clear()
        for by_id in (self._told, self._newest):
            by_id.clear()
        for queue in (self._moving, self._waiting):
            queue.clear()
        self._digest = self._cursor = 0

    def tell_again(self) -> None:
        """Nobody knows what the planner holds, or it asks: a whole round of the refresh is due."""
        self._cursor, self._round_due = 0, True

    def follow(self, source: ObjectSource) -> None:
        """Take in the objects as they are meant now."""
        most_body = min(self._scheduler.most_body, MOST_BODY)
        corners = (most_body - MOST_BODY) // CORNER_BYTES + MOST_CORNERS
        if most_body < LEAST_BODY:
            corners = 0
        if corners != self._corners:
            self._clear()
            self._round_due, self._corners = self._corners > 0, corners
        if not corners or source.version == self._version:
            return
        changes = source.changes(self._version)
        self._version = source.version
        for number in changes.gone:
            self._forget(number)
        if changes.gone and self._crowded:  # there may be room for others now
            self._crowded, changes = False, source.changes(-1)
        for told in changes.changed:
            self._take(told)
        self._ids = sorted(self._meant)

    def _take(self, told: ObjectReport) -> None:
        number, before = told.id, self._meant.get(told.id)
        is_full = before is None and len(self._meant) >= MOST_OBJECTS
        self._crowded |= is_full
        record = None if is_full else maybe_record(told, self._corners)
        if record is None:  # what the planner may hold of it is outdated
            self._forget(number)
            self._untold.add(number)
            return
        self._untold.discard(number)
        moves, is_seen = told.kind == OBJECT_MOVING, before is None or before.seen_s != told.seen_s
        told_s = before.told_s if before and before.moves else -math.inf
        self._meant[number] = Meant(record, told.seen_s, moves, told_s)
        self._moving.pop(number, None)
        if moves and (is_seen or zlib.crc32(record) != self._told.get(number)):
            self._waiting.pop(number, None)
            self._moving[number] = None
        elif zlib.crc32(record) != self._told.get(number):
            self._waiting[number] = None

    def _forget(self, number: int) -> None:
        self._untold.discard(number)
        self._moving.pop(number, None)
        if self._meant.pop(number, None) is None:
            return
        self._waiting.pop(number, None)
        if number in self._told or number in self._newest:
            self._waiting[number] = None

    def take_ack(self, newest: int, ack: Ack) -> None:
        """An ACK of frames of this epoch, `newest` unwrapped: what it shows to be lost."""
        arrived = ack.mask << 1 | 1  # bit k: frame newest - k
        while self._sent and self._sent[0].seq <= newest:
            sent = self._sent.popleft()
            back = newest - sent.seq
            lost = back >= ACKED or not arrived >> back & 1
            for number in sent.ids:
                if self._newest.get(number) != sent.seq:
                    continue  # it was told again since
                del self._newest[number]
                if lost:
                    meant = self._meant.get(number)
                    (self._moving if meant and meant.moves else self._waiting)[number] = None
                    if meant:
                        meant.told_s = -math.inf

    def publish(self, now_s: float, budget: float, looked_s: float) -> None:
        """Frames into the scheduler, under a budget of wire bytes: changes, then the refresh."""
        if not self._corners:
            return
        floor = self._scheduler.budget.credit - budget
        wanted = iter([*self._due(now_s), *self._waiting])
        following = next(wanted, None)
        while following is not None:
            ids, body, following = self._filled(now_s, following, wanted, floor)
            if not ids:
                break
            self._queue(now_s, looked_s, ids, body, NO_RANGE)
        since_s = now_s - self._refreshed_s
        if since_s >= EVERY_S - ROUNDING_S:
            self._refresh(now_s, looked_s, floor, min(since_s, ROUND_S))
        self.publish_round(now_s, self._scheduler.budget.credit - floor, looked_s)
        is_silent = now_s - self._published_s >= EVERY_S - ROUNDING_S
        if is_silent and self._room(floor) >= 0:
            self._queue(now_s, looked_s, [], b"", NO_RANGE)

    def publish_round(self, now_s: float, budget: float, looked_s: float) -> None:
        """What is left of the round under way, likewise."""
        floor = self._scheduler.budget.credit - budget
        while self._round_due and self._corners:
            if not self._refresh(now_s, looked_s, floor, ROUND_S):
                return

    def _due(self, now_s: float) -> list[int]:
        """Moving objects of which the planner was not told a moment ago."""
        return [n for n in self._moving if now_s - self._meant[n].told_s >= EVERY_S - ROUNDING_S]

    def _room(self, floor: float) -> int:
        budget = self._scheduler.budget.credit - floor
        return self._scheduler.room(budget, OBJECTS_HEAD.size)

    def _filled(
        self, now_s: float, first: int, others: Iterator[int], floor: float
    ) -> tuple[list[int], bytes, int | None]:
        """Ids that fit into one frame, their records, and the id that does not."""
        room, body = self._room(floor), bytearray()
        ids: list[int] = []
        following: int | None = first
        while following is not None:
            record = self._record(now_s, following)
            if len(body) + len(record) > room:
                break
            body += record
            ids.append(following)
            following = next(others, None)
        return ids, bytes(body), following

    def _record(self, now_s: float, number: int) -> bytes:
        meant = self._meant.get(number)
        if meant is None:
            return AGE.pack(0) + gone_record(number)
        return AGE.pack(age_ms(now_s, meant.seen_s)) + meant.record

    def _refresh(self, now_s: float, looked_s: float, floor: float, dt_s: float) -> bool:
        """One slice of the refresh, by its pace; False: the line has no room for it."""
        room, begun = self._room(floor), self._cursor
        if room < 0:
            return False
        whole = sum(AGE.size + len(meant.record) for meant in self._meant.values())
        pace = max(AGE.size + REST.size, math.ceil(whole * dt_s / ROUND_S))
        at, body = bisect_left(self._ids, begun), bytearray()
        ids: list[int] = []
        while at < len(self._ids) and len(body) < pace:
            record = self._record(now_s, self._ids[at])
            if len(body) + len(record) > room:
                break
            body += record
            ids.append(self._ids[at])
            at += 1
        last = self._ids[at] - 1 if at < len(self._ids) else LAST_ID
        if last < begun:  # not even one object fits
            return False
        gone = [n for n in (*self._told, *self._waiting) if begun <= n <= last]
        ids += sorted({number for number in gone if number not in self._meant})
        self._queue(now_s, looked_s, ids, bytes(body), (begun, last))
        self._cursor, self._refreshed_s = (last + 1) % 2**32, now_s
        self._round_due &= self._cursor > 0
        return True

    def _queue(
        self, now_s: float, looked_s: float, ids: list[int], body: bytes, told: tuple[int, int]
    ) -> None:
        """An OBJECTS frame of those ids, and of all that there are in a range."""
        self._note(now_s, self._scheduler.seq + 1, ids)
        waiting = len(self._untold) + len(self._waiting) + len(self._due(now_s))
        head = OBJECTS_HEAD.pack(
            *(self._geom_id, len(self._told), min(waiting, 0xFFFF)),
            *(age_ms(now_s, looked_s), self._digest, *told),
        )
        self._scheduler.queue(OBJECTS, head + body, 0 if told == NO_RANGE else REFRESH)
        self._published_s = now_s

    def _note(self, now_s: float, seq: int, ids: list[int]) -> None:
        """Frame `seq` tells of those: what the planner holds behind it."""
        for number in ids:
            self._digest -= self._told.pop(number, 0)
            self._moving.pop(number, None)
            self._waiting.pop(number, None)
            self._newest[number] = seq
            if (meant := self._meant.get(number)) is not None:
                self._told[number] = zlib.crc32(meant.record)
                self._digest += self._told[number]
                meant.told_s = now_s
        self._digest %= 2**32
        self._sent.append(Sent(seq, ids))
        if len(self._sent) > REMEMBERED:  # no ACKs: the refresh alone repairs
            for number in self._sent.popleft().ids:
                if self._newest.get(number, seq) <= self._sent[0].seq:
                    self._newest.pop(number, None)
