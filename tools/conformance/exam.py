"""One examination of one receiver: frames go to it and to the slow model, and both must agree.

The receiver is seen by its answers (ACK, HELLO) and by DIGEST frames alone, as over a port; in
process its cells are compared as well. Times are of the examinee's clock, seconds.
"""

import random
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from tools.conformance.slow_receiver import SlowReceiver
from tools.conformance.wire import (
    DIGEST,
    DIGEST_OK,
    FREE,
    GEOM,
    MAP,
    POSE,
    SUSPECT,
    U8,
    Ack,
    Geom,
    Hello,
    Key,
    answer_from_frame,
    cobs,
    digest_body,
    frame,
    int16,
    map_body,
    ops_of,
    pose_body,
)

ACK_WAIT_S = 0.6  # an ACK comes every 100 ms; the rest is for slow lines and slow machines
MARKERS = 3  # POSE frames that an answer is asked with before it counts as none
FEW_RUNS = 4  # of a sender, that a receiver with a key must take under one nonce
QUICK_MARKERS, QUICK_S = 12, 0.004  # one of them is the 16th, after which an ACK comes at once
BATCH = 14  # frames between two questions: an ACK tells of 33
MOST_CELLS = 401 * 401


@dataclass
class DeviationError(Exception):
    """The receiver did something else than the sheet says."""

    what: str
    expected: str
    got: str
    frames: tuple[bytes, ...] = ()  # that led to it, newest last


@dataclass
class UnseenError(Exception):
    """This can't be seen of this receiver."""

    why: str


class Examinee(Protocol):
    """A receiver, and the wire to it.

    It is sent datagrams or bytes of a stream; it is heard as frames without COBS. `window` gives
    its (height, width) codes where they can be seen; `restart` is as after its power was off, and
    gives False where that can't be done from here.
    """

    datagrams: bool
    in_process: bool

    def now_s(self) -> float: ...
    def send(self, data: bytes) -> None: ...
    def listen(self, seconds: float) -> list[bytes]: ...
    def window(self) -> U8 | None: ...
    def restart(self) -> bool: ...


class Exam:
    """The sender's part, the model, and what the receiver answers.

    Args:
        key: 32 bytes where the receiver wants tags.
        budget_s: time for the rounds of one check.
        share: of the rounds of each check, 0 to 1.
        strict: want what the sheet leaves open, or has said only since its first version, as well.
    """

    def __init__(
        self,
        bench: Examinee,
        *,
        seed: int = 1,
        key: bytes | None = None,
        budget_s: float = float("inf"),
        share: float = 1.0,
        strict: bool = True,
    ) -> None:
        self.bench, self.key, self.budget_s, self.share = bench, key, budget_s, share
        self.strict, self.random = strict, random.Random(seed)
        self.hello: Hello | None = None
        self.answers: deque[Ack] = deque(maxlen=64)
        self.has_digest = False
        self.geom, self.origin = Geom(self.random.randrange(256), 0, 0, 0), (0, 0)
        self.seq = self.begun_seq = 0
        self.skipped_ms = 0  # by which the sender's clock was put on
        self.model = SlowReceiver()
        self.undecided: set[int] = set()  # numbers that a receiver may count or not
        self.may_be_suspect = False  # for it did not count one of those
        self.tail: deque[bytes] = deque(maxlen=12)
        self._is_heard = False  # it has answered to this run of the sender
        self._unread = b""  # the newest answer that was none
        self._tired = ""  # why no more can be seen of it

    # The sender's part

    @property
    def max_cells(self) -> int:
        """The most cells that the receiver says it can hold."""
        return min(self.hello.max_cells, MOST_CELLS) if self.hello else MOST_CELLS

    def side(self, most: int) -> int:
        """Of a square window that it can hold."""
        return max(3, min(most, int(self.max_cells**0.5)))

    @property
    def max_frame(self) -> int:
        """The longest frame that it says it can take."""
        return max(64, min(self.hello.max_frame, 368)) if self.hello else 368

    @property
    def nonce(self) -> int:
        """Of its newest HELLO."""
        return self.hello.nonce if self.hello else 0

    def key_of(self, session: int) -> Key | None:
        """What tags are made with in a run of the sender."""
        return Key(self.key, session, self.nonce) if self.key else None

    @property
    def secret(self) -> Key | None:
        """Likewise, now."""
        return self.key_of(self.geom.session)

    @property
    def t_ms(self) -> int:
        """The sender's clock."""
        return round(self.bench.now_s() * 1000) + self.skipped_ms & 0xFFFFFFFF

    def begin(
        self, width: int, height: int, stale_ms: int = 150, first_seq: int | None = None
    ) -> None:
        """A new run of the sender, known to the receiver; with an empty model.

        Raises:
            UnseenError: the receiver has shown that it takes no more of them.
        """
        if self._tired:
            raise UnseenError(self._tired)
        self._is_heard = False
        geom_id, session = (self.geom.geom_id + 1) % 256, self.random.getrandbits(32)
        self.geom = Geom(geom_id, width, height, session, stale_ms)
        self.seq = self.random.getrandbits(16) if first_seq is None else first_seq - 1
        self.begun_seq = self.seq
        old = self.model
        self.model = SlowReceiver(nonce=self.nonce, max_cells=self.max_cells, key=self.key)
        self.model.left = old.left + ([old.geom.session] if old.geom else [])
        self.undecided.clear()
        self.may_be_suspect, self.skipped_ms = False, 0
        self.tail.clear()
        self.send(self.next(GEOM, self.geom.body()))

    def begin_free(self, width: int, height: int, first_seq: int | None = None) -> None:
        """The same, and all cells FREE."""
        self.begin(width, height, first_seq=first_seq)
        self.tell([(FREE, width * height)])

    def next(self, kind: int, body: bytes, flags: int = 0) -> bytes:
        """The next frame, not sent yet: leave it out, and it is lost."""
        self.seq = (self.seq + 1) & 0xFFFF
        return frame(kind, self.seq, self.t_ms, body, flags, self.secret)

    def map_body(
        self, runs: list[tuple[int, int]], start: int = 0, repaired: int | None = None
    ) -> bytes:
        """Of a MAP frame that says that all is repaired, unless told."""
        repaired = self.seq if repaired is None else repaired
        return map_body(self.origin, repaired, self.geom.geom_id, start, ops_of(runs))

    def next_map(
        self,
        runs: list[tuple[int, int]],
        start: int = 0,
        repaired: int | None = None,
        origin: tuple[int, int] | None = None,
    ) -> bytes:
        """The next MAP frame; `repaired` as early as may be, unless told."""
        self.origin = origin or self.origin
        repaired = self.seq - 0x7000 if repaired is None else repaired
        return self.next(MAP, self.map_body(runs, start, repaired))

    def on_wire(self, data: bytes) -> bytes:
        """A frame as it travels."""
        return data if self.bench.datagrams else cobs(data) + b"\0"

    def send(self, data: bytes, undecided: bool = False) -> None:
        """One frame, to the receiver and the model; undecided: the sheet lets it count or not."""
        if undecided:
            self.undecided.add(int.from_bytes(data[2:4], "little"))
            self.may_be_suspect = True
        self.tail.append(data)
        self.model.feed_datagram(self.bench.now_s(), data)
        self.bench.send(self.on_wire(data))

    def send_pose(self) -> None:
        """Of a robot that stands still."""
        self.send(self.next(POSE, pose_body()))

    def send_geom(self) -> None:
        """What the receiver knows, or has to learn, of the window."""
        self.send(self.next(GEOM, self.geom.body()))

    def tell(self, runs: list[tuple[int, int]], start: int = 0) -> None:
        """A MAP frame that says that all is repaired, at once."""
        self.send(self.next_map(runs, start, repaired=self.seq))
        self.may_be_suspect = False

    # What it answers

    def take(self, frames: list[bytes]) -> list[Ack]:
        """The ACKs among some answers; a HELLO is kept."""
        acks = []
        for data in frames:
            answer = answer_from_frame(data, self.secret)
            if isinstance(answer, Hello):
                self.hello = answer
            elif isinstance(answer, Ack):
                acks.append(answer)
                self._is_heard = True
            elif answer != "another type":
                self._unread = data
        self.answers += acks
        return acks

    def hear(self, seconds: float) -> Iterator[Ack]:
        """The ACKs of that time, as they come."""
        end_s = self.bench.now_s() + seconds
        while (left_s := end_s - self.bench.now_s()) > 1e-6:
            yield from self.take(self.bench.listen(left_s))

    def hear_all(self, seconds: float) -> list[Ack]:
        """All ACKs of that time."""
        return list(self.hear(seconds))

    def says_hello(self, seconds: float = 0.6) -> bool:
        """Whether a HELLO comes in that time."""
        before, self.hello = self.hello, None
        self.hear_all(seconds)
        comes, self.hello = self.hello is not None, self.hello or before
        return comes

    def ask(self) -> Ack:
        """The ACK of a POSE frame that is sent now.

        Raises:
            DeviationError: none comes.
        """
        quick = 0 if self.bench.in_process else QUICK_MARKERS
        for wait_s in [QUICK_S] * quick + [ACK_WAIT_S] * MARKERS:
            self.send_pose()
            for ack in self.hear(wait_s):
                if ack.last_seq == self.seq:
                    return ack
        self.check_willing()
        newest = f"newest last_seq {self.answers[-1].last_seq}" if self.answers else "no ACK at all"
        if self._unread:
            why = answer_from_frame(self._unread, self.secret)
            newest += f"; unreadable {why}: {self._unread.hex(' ')}"
        raise self.failed("the newest POSE frame is acknowledged", f"last_seq {self.seq}", newest)

    def check_willing(self) -> None:
        """Called where answers are missing.

        Raises:
            UnseenError: a receiver with a key has room for so many runs of a sender and no more.
        """
        left = self.model.left
        older = [answer_from_frame(self._unread, self.key_of(one)) for one in left[FEW_RUNS:]]
        if self.key and not self._is_heard and any(isinstance(answer, Ack) for answer in older):
            self._tired = (
                f"with its key it takes no new run of a sender after {len(left)}: start it anew "
                "for this test, or give it room for more (MAPOD_LINK_LEFT_SESSIONS)"
            )
            raise UnseenError(self._tired)

    # Comparing

    def failed(self, what: str, expected: str, got: str) -> DeviationError:
        """A failure with the newest frames."""
        return DeviationError(what, expected, got, tuple(self.tail))

    def expect(self, what: str, expected: object, got: object) -> None:
        """Both must be equal, else DeviationError is raised."""
        if expected != got:
            raise self.failed(what, str(expected), str(got))

    def check(self, what: str) -> Ack:
        """Books, suspicion and cells must be the model's."""
        self.check_books(what, self.ask())
        ack = self.check_map(what)
        self.tail.clear()
        return ack

    def check_books(self, what: str, ack: Ack) -> None:
        """What was counted, and whether a gap is known."""
        self.expect(f"{what}: geom_id", self.geom.geom_id, ack.geom_id)
        hidden = 0
        for seq in self.undecided:
            behind = int16(self.seq - seq)
            hidden |= 1 << behind - 1 if 0 < behind <= 32 else 0
        if not self.strict:  # what it says of the run before is nobody's concern
            sent = (self.seq - self.begun_seq) & 0xFFFF
            hidden |= -1 << min(sent, 32) - 1 if sent else -1
        wanted = f"{self.model.mask & ~hidden & 0xFFFFFFFF:032b}"
        self.expect(f"{what}: mask of accepted frames", wanted, f"{ack.mask & ~hidden:032b}")
        if self.model.suspect or not self.may_be_suspect:
            self.expect(f"{what}: suspect", self.model.suspect, bool(ack.status & SUSPECT))

    def check_map(self, what: str) -> Ack:
        """The receiver's cells, by DIGEST and, where they can be seen, one by one.

        While *suspect* or *blank* it compares no DIGEST: then only those that can be seen.
        """
        wanted = self.model.window()
        self.send(self.next(DIGEST, digest_body(self.geom.geom_id, wanted)))
        ack = self.ask()
        compares = not (self.model.suspect or self.may_be_suspect or self.model.blank)
        if self.has_digest and compares:
            told = "DIGEST_OK" if ack.status & DIGEST_OK else "not DIGEST_OK"
            self.expect(f"{what}: map by DIGEST", "DIGEST_OK", told)
        window = self.bench.window()
        if window is not None and not np.array_equal(window, wanted):
            raise self.failed(f"{what}: cells", *_difference(wanted, window))
        return ack

    def needs_map(self) -> None:
        """For checks that are nothing without the map.

        Raises:
            UnseenError: it can't be seen.
        """
        if not self.has_digest and self.bench.window() is None:
            raise UnseenError("the receiver compares no DIGEST: its map can't be seen from here")

    def rounds(self, most: int) -> Iterator[int]:
        """Up to so many rounds, as long as the time lasts; at least three."""
        end_s = self.bench.now_s() + self.budget_s
        for k in range(max(3, round(most * self.share))):
            if k >= 3 and self.bench.now_s() > end_s:
                return
            yield k


def _difference(wanted: U8, got: U8) -> tuple[str, str]:
    """Expected and got, in words."""
    if wanted.shape != got.shape:
        return f"(height, width) {wanted.shape}", f"{got.shape}"
    rows, columns = np.nonzero(wanted != got)
    row, column = int(rows[0]), int(columns[0])
    cells = f"({len(rows)} cells differ)"
    return f"row {row}, column {column}: {wanted[row, column]}", f"{got[row, column]} {cells}"
