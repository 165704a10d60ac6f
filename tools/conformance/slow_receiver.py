"""A receiver that is slow and obvious: what the others are compared with, cell by cell.

The map is a dictionary of world cells; cells that are not in it are UNKNOWN. Every rule is a small
method, so that a test can make it wrong and see whether the conformance tests find out.
Source: planner link, sections 2 to 6 and 9.
"""

import math
import struct
from itertools import chain

import numpy as np

from tools.conformance.wire import (
    ACK,
    AUTH,
    DIGEST,
    GEOM,
    HELLO,
    KEEP,
    MAP,
    MAX_FRAME,
    POSE,
    SCAN,
    SEED,
    SHORTEST,
    STOP_ZONE,
    TILE,
    U8,
    UNKNOWN,
    Geom,
    Key,
    Splitter,
    digest_body,
    frame,
    int16,
    sealed,
)

TO_SENDER = range(8, 13)  # types that only the other direction has
SILENCE_MS = 60_000
LENGTHS = {GEOM: 16, POSE: 24, DIGEST: 8, STOP_ZONE: 20}
Run = tuple[int, int, int]  # state, first cell, cell after the last


class SlowReceiver:
    """Sections 4 to 6. Time comes with each call; nothing raises on bytes.

    Args:
        key: 32 bytes: frames without a valid tag are dropped, answers are tagged. None: no tags.
    """

    seed, max_frame, ack_period_s, ack_every = SEED, MAX_FRAME, 0.1, 16

    def __init__(
        self, nonce: int = 1, max_cells: int = 401 * 401, key: bytes | None = None
    ) -> None:
        self.nonce, self.max_cells, self.key = nonce, max_cells, key
        self.cells: dict[tuple[int, int], int] = {}  # unwrapped world cell: FREE or OBSTACLE
        self.geom: Geom | None = None
        self.origin: tuple[int, int] | None = None  # lowest column and row, unwrapped
        self.last: int | None = None
        self.gap: int | None = None
        self.mask = self.newest_t_ms = self.bad = 0
        self.need_geom = self.need_full = self.digest_ok = self.auth_failed = False
        self.pose_s = self.map_s = self.newest_s = -math.inf
        self.left: list[int] = []  # sessions that were left
        self._splitter = Splitter()
        self._sent = self._unacked = 0
        self._hello_s = self._ack_s = -math.inf
        self._outbox: list[bytes] = []

    # What it holds

    @property
    def suspect(self) -> bool:
        """Some cell may be outdated."""
        return self.gap is not None

    @property
    def blank(self) -> bool:
        """There is no map yet."""
        return self.geom is None or self.origin is None

    def stale(self, now_s: float) -> bool:
        """Poses or maps do not come in time."""
        if self.geom is None:
            return True
        return now_s - min(self.pose_s, self.map_s) > self.geom.stale_ms / 1000 + 1e-9

    def window(self) -> U8:
        """(height, width) codes, row-major from the window's origin."""
        if self.geom is None:
            return np.zeros((0, 0), np.uint8)
        window = np.zeros((self.geom.height, self.geom.width), np.uint8)
        if self.origin is not None and self.cells:
            places = np.fromiter(chain.from_iterable(self.cells), np.int64).reshape(-1, 2)
            columns, rows = (places - self.origin).T
            states = np.fromiter(self.cells.values(), np.uint8)
            inside = (columns >= 0) & (columns < self.geom.width)
            inside &= (rows >= 0) & (rows < self.geom.height)
            window[rows[inside], columns[inside]] = states[inside]
        return window

    # Bytes in, bytes out

    def feed_stream(self, now_s: float, data: bytes) -> None:
        """Bytes of a serial line, cut anywhere."""
        for piece in self._splitter.feed(data):
            if piece is None:
                self.bad += 1
            else:
                self.feed_datagram(now_s, piece)

    def feed_datagram(self, now_s: float, data: bytes) -> None:
        """One frame."""
        if not self.is_whole(data):
            self.bad += 1
            return
        kind, flags, seq, t_ms = struct.unpack_from("<BBHI", data)
        end = len(data) - 4 - (8 if flags & AUTH else 0)
        kind, body = kind & 15, data[8:end]
        if end < 8 or not self.tag_is_right(flags, data[:end], data[end:-4], kind, body):
            self.bad += 1
            return
        if kind in TO_SENDER:
            return
        geom = self.maybe_geom(body) if kind == GEOM else None
        begins = geom is not None and (self.geom is None or geom.session != self.geom.session)
        anew = self.is_after_silence(t_ms)
        if not begins and not anew and not self.is_newer(seq, t_ms):
            return
        foreign = kind == MAP and (self.geom is None or body[6:7] != bytes([self.geom.geom_id]))
        runs = self.maybe_runs(body) if kind == MAP and not foreign else None
        means = {GEOM: geom is not None, MAP: foreign or runs is not None}.get(kind, True)
        if not self.has_right_length(kind, body) or not means:
            self.bad += 1
            return
        if anew and not begins:
            self.forget()
        self.count(now_s, seq, t_ms, begins or anew)
        if foreign:
            self.need_geom = True
        else:
            self.act(now_s, kind, body, geom, runs)
        if self._unacked >= self.ack_every:
            self._acknowledge(now_s)

    def poll(self, now_s: float) -> list[bytes]:
        """Frames to send, not COBS-encoded."""
        if self.geom is None and now_s >= self._hello_s + 0.25:
            self._hello_s = now_s
            self._say(now_s, HELLO, struct.pack("<IIHH", self.nonce, self.max_cells, 368, 0))
        if self.last is not None and now_s >= self._ack_s + self.ack_period_s:
            self._acknowledge(now_s)
        frames, self._outbox = self._outbox, []
        return frames

    # Rules, each for a test to make wrong

    def is_whole(self, data: bytes) -> bool:
        """Version, flags, length and CRC."""
        if not SHORTEST <= len(data) <= self.max_frame:
            return False
        return self.has_right_crc(data) and data[0] >> 4 == 1 and not data[1] & 0xE0

    def has_right_crc(self, data: bytes) -> bool:
        """Over the seed and all that stands before it."""
        return sealed(data[:-4]) == data

    def tag_is_right(self, flags: int, content: bytes, tag: bytes, kind: int, body: bytes) -> bool:
        """Section 9; a GEOM names its own session, and one that was left may not come back."""
        if self.key is None:
            return True
        session = self.geom.session if self.geom else 0
        if kind == GEOM and len(body) == 16:
            (session,) = struct.unpack_from("<I", body, 8)
        right = bool(flags & AUTH) and Key(self.key, session, self.nonce).tag(content) == tag
        right = right and (self.geom is not None or kind == GEOM) and session not in self.left
        self.auth_failed = not right
        return right

    def is_newer(self, seq: int, t_ms: int) -> bool:
        """Older and repeated frames are dropped in silence."""
        if self.key is not None and self.last is not None and t_ms < self.newest_t_ms:
            return False
        return self.last is None or int16(seq - self.last) > 0

    def is_after_silence(self, t_ms: int) -> bool:
        """So long after the newest frame that numbers mean nothing any more."""
        passed_ms = (t_ms - self.newest_t_ms) & 0xFFFFFFFF
        return self.last is not None and SILENCE_MS <= passed_ms < 2**31

    def forget(self) -> None:
        """All cells UNKNOWN, where they are."""
        self.cells.clear()
        self.gap = None

    def count(self, now_s: float, seq: int, t_ms: int, begins: bool) -> None:
        """The books of a frame that counts."""
        if self.last is None or begins:
            self.mask = 0
        else:
            step = int16(seq - self.last)
            if step > 1:
                self.gap = (seq - 1) & 0xFFFF
            self.mask = (self.mask << step | 1 << step - 1) & 0xFFFFFFFF
        self.last, self.newest_t_ms, self.newest_s = seq, t_ms, now_s
        self._unacked += 1

    def act(
        self, now_s: float, kind: int, body: bytes, geom: Geom | None, runs: list[Run] | None
    ) -> None:
        """What a counted frame does besides being counted."""
        if geom is not None:
            self.adopt(geom)
        elif kind == POSE:
            self.pose_s = now_s
        elif kind == DIGEST:
            self.compare(body)
        elif runs is not None:
            self.map_s = now_s
            self.move(*struct.unpack_from("<hh", body))
            (repaired,) = struct.unpack_from("<H", body, 4)
            if self.gap is not None and self.clears(repaired, self.gap):
                self.gap = None
            self.apply(runs)
        else:
            assert kind in (0, 13, 14, 15, STOP_ZONE, TILE, SCAN)

    def adopt(self, geom: Geom) -> None:
        """A new epoch or run sets every cell to UNKNOWN."""
        old, self.geom, self.need_geom = self.geom, geom, False
        if old is None or geom.session != old.session:
            self.pose_s = self.map_s = -math.inf
            self.left += [old.session] if old else []
        if self.is_other_epoch(old, geom):
            self.origin = None
            self.forget()
            self.digest_ok = self.need_full = False

    def is_other_epoch(self, old: Geom | None, new: Geom) -> bool:
        """Whether the cells that are held mean nothing any more."""
        if old is None or old.session != new.session or old.geom_id != new.geom_id:
            return True
        return (old.width, old.height, old.cell_mm) != (new.width, new.height, new.cell_mm)

    def clears(self, repaired: int, gap: int) -> bool:
        """Whether `repaired` tells that all that was lost has been sent again."""
        return int16(repaired - gap) >= 0

    def move(self, ox: int, oy: int) -> None:
        """Section 4, before operations."""
        assert self.geom is not None
        i, j = self.origin or (0, 0)
        di, dj = int16(ox - i), int16(oy - j)
        if self.origin is None or abs(di) >= self.geom.width or abs(dj) >= self.geom.height:
            self.forget()
        self.origin = i + di, j + dj
        if di or dj:
            self.forget_outside()

    def forget_outside(self) -> None:
        """Cells that have left the window are unknown when they come back."""
        assert self.geom is not None
        assert self.origin is not None
        low_i, low_j = self.origin
        for i, j in list(self.cells):
            if not (0 <= i - low_i < self.geom.width and 0 <= j - low_j < self.geom.height):
                del self.cells[i, j]

    def apply(self, runs: list[Run]) -> None:
        """Every operation is an absolute value."""
        assert self.geom is not None
        assert self.origin is not None
        width = self.geom.width
        for state, first, end in runs:
            if state == KEEP:
                continue
            for cell in range(first, end):
                place = self.origin[0] + cell % width, self.origin[1] + cell // width
                if state == UNKNOWN:
                    self.cells.pop(place, None)
                else:
                    self.cells[place] = state

    def compare(self, body: bytes) -> None:
        """A difference that no gap explains needs a new epoch."""
        known = self.geom is not None and body[:1] == bytes([self.geom.geom_id])
        compares = known and not self.suspect and not self.blank
        self.digest_ok = compares and digest_body(body[0], self.window())[4:] == body[4:]
        if compares:
            self.need_full = not self.digest_ok

    # Bodies

    def has_right_length(self, kind: int, body: bytes) -> bool:
        """Of those bodies that have but one, and of the head of a MAP."""
        return len(body) == LENGTHS.get(kind, len(body)) and (kind != MAP or len(body) >= 10)

    def maybe_geom(self, body: bytes) -> Geom | None:
        """None if it tells no window that fits."""
        if len(body) != 16:
            return None
        geom_id, _, width, height, cell_mm = struct.unpack_from("<BBHHH", body)
        session, tick_ms, stale_ms = struct.unpack_from("<IHH", body, 8)
        if not width * height * cell_mm or width * height > self.max_cells:
            return None
        return Geom(geom_id, width, height, session, stale_ms, tick_ms, cell_mm)

    def maybe_runs(self, body: bytes) -> list[Run] | None:
        """What the operations of a MAP body do; None if they do not fit."""
        assert self.geom is not None
        if len(body) < 10:
            return None
        cursor, at = int.from_bytes(body[7:10], "little"), 10
        runs: list[Run] = []
        while at < len(body):
            state, run = body[at] >> 6, (body[at] & 63) + 1
            at += 1
            if run == 64:
                number = self.maybe_leb128(body, at)
                if number is None:
                    return None
                run, at = self.long_run(number[0]), number[1]
            if cursor + run > self.geom.width * self.geom.height:
                return self.rest_of_bad_runs(runs)
            runs.append((state, cursor, cursor + run))
            cursor += run
        return runs

    def rest_of_bad_runs(self, runs: list[Run]) -> list[Run] | None:
        """What is left of a MAP frame whose operations pass the last cell: nothing."""
        return None

    def long_run(self, number: int) -> int:
        """Cells of an operation with a LEB128 number."""
        return 64 + number

    def maybe_leb128(self, body: bytes, at: int) -> tuple[int, int] | None:
        """The number and where it ends; None if it is cut off or has a fourth byte."""
        number = 0
        for k in range(3):
            if at + k >= len(body):
                return None
            number |= (body[at + k] & 0x7F) << 7 * k
            if body[at + k] < 0x80:
                return number, at + k + 1
        return None

    # Answers

    def status(self, now_s: float) -> int:
        """The bits of an ACK."""
        blind = self.need_geom or self.geom is None
        doubts = self.stale(now_s), self.suspect, False
        bits = blind, self.need_full, *doubts, self.digest_ok, self.auth_failed
        return sum(bit << k for k, bit in enumerate(bits))

    def _acknowledge(self, now_s: float) -> None:
        self._ack_s, self._unacked = now_s, 0
        hold = round(min(now_s - self.newest_s, 6.5) * 10_000)
        geom_id = self.geom.geom_id if self.geom else 0
        books = struct.pack("<HIIH", self.last or 0, self.mask, self.newest_t_ms, hold)
        told = struct.pack("<HBB", self.bad & 0xFFFF, self.status(now_s), geom_id)
        self._say(now_s, ACK, books + told)

    def _say(self, now_s: float, kind: int, body: bytes) -> None:
        self._sent += 1
        key = None
        if self.key is not None and self.geom is not None and kind != HELLO:
            key = Key(self.key, self.geom.session, self.nonce)
        self._outbox.append(frame(kind, self._sent, round(now_s * 1000), body, 0, key))
