"""The objects of the sender's vector map, and whether the list at this end may be outdated.

Each frame tells how many objects there must be now and a digest of them, as far as they were told.
An object that is not in the list says nothing: only the map tells what is free.
Source: planner link, section 3 (OBJECTS), 5 and 6.
"""

import math
import struct
import zlib
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

F64 = npt.NDArray[np.float64]
OBJECTS_HEAD = struct.Struct("<BxHHHIII")  # geom_id, count, waiting, look age, digest, first, last
GONE_RECORD = struct.Struct("<HBBI")  # age, kind, corners, id
RECORD = struct.Struct("<HBBIiihhhhBBBx")  # likewise, then place, heights, velocity, ...
CORNER_BYTES, FEWEST_CORNERS, MOST_CORNERS = 4, 3, 64
GONE, STATIC, MOVED, MOVING, WALL = range(5)  # kinds; higher ones are of later days, and stand
ENLARGED = 1 << 0  # flag: the outline is larger than the object's own
FARTHEST_MM, OLDEST_MS = 2_100_000_000, 0xFFFF
MOST_HELD = 0xFFFF  # as many as can be told to be there
LIST_STALE_S = 0.35  # no frame for so long: the list may be outdated
MOVING_STALE_S = 0.5  # a moving object that was not seen for so long is somewhere else
LOOK_STALE_S = 1.0  # nothing has looked for objects for so long
SETTLE_S, RETRY_S = 0.3, 1.0  # the sender repairs by itself before it is asked; between questions


@dataclass(frozen=True, slots=True, eq=False)
class LinkObject:
    """One object, map frame."""

    id: int  # never that of another object in one run of the sender
    kind: int  # STATIC: has never moved, MOVED: has, MOVING: moves now, WALL; others stand
    outline_m: F64  # (n, 2) corners in order, counter-clockwise
    bottom_m: float  # above the floor
    top_m: float  # 32.767: that or more
    velocity_mps: tuple[float, float]  # along map x and y
    confidence: float  # 0 to 1: that it is there
    enlarged: bool  # the outline contains the object's own, which has more corners
    seen_ms: int  # sender's clock, modulo 2^32, when it was last seen
    forgotten: bool  # it was not seen for 65 s or more when it was told
    digest: int  # of all but its age

    @property
    def moves(self) -> bool:
        return self.kind == MOVING


@dataclass(frozen=True, slots=True)
class ObjectsPiece:
    """One OBJECTS frame."""

    geom_id: int
    count: int  # objects that there must be behind this frame
    waiting: int  # that the sender still has to tell, or to tell again
    look_ms: int  # age of the newest frame of the camera in what is told
    digest: int
    first: int  # of the ids from `first` to `last`, just those in this frame are there
    last: int  # below `first`: nothing is said of others
    records: list[tuple[int, LinkObject | None]]  # by id; None: it is gone


def maybe_objects_piece(body: bytes, t_ms: int) -> ObjectsPiece | None:
    """None if a record has a number that can't be, or does not end with the frame."""
    if len(body) < OBJECTS_HEAD.size:
        return None
    geom_id, count, waiting, look_ms, digest, first, last = OBJECTS_HEAD.unpack_from(body)
    at = OBJECTS_HEAD.size
    records: list[tuple[int, LinkObject | None]] = []
    while at < len(body):
        size = _record_bytes(body, at)
        if not size:
            return None
        if body[at + 2] == GONE:
            records.append((GONE_RECORD.unpack_from(body, at)[3], None))
        else:
            told = _maybe_object(body[at : at + size], t_ms)
            if told is None:
                return None
            records.append((told.id, told))
        at += size
    return ObjectsPiece(geom_id, count, waiting, look_ms, digest, first, last, records)


def _record_bytes(body: bytes, at: int) -> int:
    """How long a record is; 0 if it goes past the frame, or its number of corners can't be."""
    left = len(body) - at
    if left < GONE_RECORD.size:
        return 0
    _, kind, corners, _ = GONE_RECORD.unpack_from(body, at)
    if kind == GONE:
        return GONE_RECORD.size if corners == 0 else 0
    size = RECORD.size + CORNER_BYTES * corners
    return size if FEWEST_CORNERS <= corners <= MOST_CORNERS and size <= left else 0


def _maybe_object(record: bytes, t_ms: int) -> LinkObject | None:
    age_ms, kind, corners, number, x_mm, y_mm, *rest = RECORD.unpack_from(record)
    bottom_mm, top_mm, vx, vy, confidence, flags, unit_mm = rest
    if max(abs(x_mm), abs(y_mm)) > FARTHEST_MM or not unit_mm or bottom_mm > top_mm:
        return None
    offsets = np.frombuffer(record, "<i2", 2 * corners, RECORD.size).reshape(corners, 2)
    outline_m = (np.array([x_mm, y_mm], np.float64) + unit_mm * offsets.astype(np.float64)) / 1000
    return LinkObject(
        number, kind, outline_m, bottom_mm / 1000, top_mm / 1000, (vx / 1000, vy / 1000),
        confidence / 255, bool(flags & ENLARGED), (t_ms - age_ms) % 2**32, age_ms == OLDEST_MS,
        zlib.crc32(record[2:]),
    )  # fmt: skip


class Objects:
    """The list at this end.

    Attributes:
        by_id: all objects that were told and are not known to be gone.
        told: how many there must be, as the newest frame says; None before the first one.
    """

    def __init__(self) -> None:
        self.by_id: dict[int, LinkObject] = {}
        self.forget()

    def forget(self) -> None:
        """A new epoch or run, or a long silence: what was told means nothing any more."""
        self.by_id.clear()
        self.told: int | None = None
        self._waiting = self._look_ms = 0
        self._t_ms, self._arrived_s = 0, -math.inf
        self._agrees, self._gaps = False, -1
        self._doubtful_since_s = self._asked_s = -math.inf

    def damage(self) -> None:
        """A frame has come that could not be read."""
        self._agrees = False

    def take(self, now_s: float, piece: ObjectsPiece, t_ms: int, gaps: int) -> None:
        """One frame of the epoch in use; `gaps`: how often frames were missing so far."""
        listed = {number for number, told in piece.records if told is not None}
        for number in [n for n in self.by_id if piece.first <= n <= piece.last]:
            if number not in listed:
                del self.by_id[number]
        for number, told in piece.records:
            if told is None:
                self.by_id.pop(number, None)
            elif number in self.by_id or len(self.by_id) < MOST_HELD:
                self.by_id[number] = told
        digest = sum(one.digest for one in self.by_id.values()) % 2**32
        was_doubtful = not self._agrees and self.told is not None
        self._agrees = len(self.by_id) == piece.count and digest == piece.digest
        if self._agrees or not was_doubtful:
            self._doubtful_since_s = now_s
        self.told, self._waiting, self._look_ms = piece.count, piece.waiting, piece.look_ms
        self._t_ms, self._arrived_s, self._gaps = t_ms, now_s, gaps

    def state(self, now_s: float, gaps: int) -> tuple[str, str]:
        """("known" | "suspect" | "none", why): what the list is worth."""
        if self.told is None:
            return "none", "no objects told yet"
        if now_s - self._arrived_s > LIST_STALE_S:
            return "suspect", "objects come late"
        if gaps != self._gaps:
            return "suspect", "a frame is missing"
        if not self._agrees:
            return "suspect", "the list is not the sender's"
        if self._waiting:
            return "suspect", f"{self._waiting} objects are still to be told"
        if self._look_ms / 1000 + now_s - self._arrived_s > LOOK_STALE_S:
            return "suspect", "nothing looks for objects"
        return "known", ""

    def is_stale(self, now_s: float) -> bool:
        """Nobody tells of objects any more, or nobody looks for them: they may be anywhere."""
        silent_s = now_s - self._arrived_s
        return silent_s > LIST_STALE_S or self._look_ms / 1000 + silent_s > LOOK_STALE_S

    def age_s(self, told: LinkObject, now_s: float) -> float:
        """Since the object was seen, at least; inf: 65 s or more when it was told."""
        if told.forgotten:
            return math.inf
        return (self._t_ms - told.seen_ms) % 2**32 / 1000 + max(0.0, now_s - self._arrived_s)

    def is_old(self, told: LinkObject, now_s: float) -> bool:
        """It moved, and was not seen lately: nobody knows where it is now."""
        return told.moves and self.age_s(told, now_s) > MOVING_STALE_S

    def is_question_due(self, now_s: float) -> bool:
        """The list has not been the sender's for a while: it is to be asked for, and noted so."""
        if self.told is None or self._agrees or now_s - self._doubtful_since_s < SETTLE_S:
            return False
        is_due = now_s - self._asked_s >= RETRY_S
        self._asked_s = now_s if is_due else self._asked_s
        return is_due
