"""mapod's own sender at work on a receiver under examination, with a wire that loses frames."""

import random
import struct
from collections import deque

import numpy as np

from hw.planner_link.receivers import one_link
from tools.conformance.exam import MOST_CELLS, Exam
from tools.conformance.slow_receiver import SlowReceiver
from tools.conformance.wire import (
    FREE,
    GEOM,
    HELLO,
    MAP,
    NEED_FULL,
    OBSTACLE,
    STALE,
    SUSPECT,
    Ack,
    Geom,
    Key,
    Splitter,
    cobs,
    frame,
    int16,
)
from tools.conformance.world import STANDING, World

TICK_S = 0.02
SLOW_S = 0.1
KEPT = 4096  # frames whose suspicion is remembered, for the ACKs that tell of them


class ExamPort:
    """The sender's port: frames go to the receiver under examination, some get lost.

    Args:
        hears: False: no answer comes back.
    """

    cause, opened, backlog = "", 1, 0

    def __init__(self, exam: Exam, loss: float, hears: bool, seed: int) -> None:
        self.exam, self.loss, self.hears = exam, loss, hears
        self.datagrams = exam.bench.datagrams
        self.sent: deque[tuple[int, bytes]] = deque()  # every frame, for the one that misses none
        self.suspected: dict[int, bool] = {}  # by number: the model's suspicion after that frame
        self.wires = 0  # bytes written
        self._random = random.Random(seed)
        self._answers: list[bytes] = []
        self._splitter = Splitter()

    def fileno(self) -> int:
        """None that the operating system knows."""
        return -1

    def poll(self, now_s: float) -> bool:
        """Always open."""
        return True

    def read(self) -> list[bytes]:
        """Answers since the last call."""
        answers, self._answers = self._answers, []
        return answers

    def close(self) -> None:
        """Nothing is held."""

    def write(self, data: bytes) -> None:
        """Frames on their way."""
        self.wires += len(data)
        for whole in [data] if self.datagrams else self._splitter.feed(data):
            assert whole is not None
            self._carry(whole)

    def _carry(self, whole: bytes) -> None:
        """One frame, which may get lost."""
        exam = self.exam
        exam.seq = int.from_bytes(whole[2:4], "little")
        exam.skipped_ms = 0
        self.sent.append((exam.seq, whole))
        if whole[0] & 15 == GEOM:
            exam.geom = _geom(whole)
        if whole[0] & 15 == MAP:
            ox, oy = struct.unpack_from("<hh", whole, 8)
            exam.origin = ox, oy
        if self._random.random() < self.loss:
            return
        exam.send(whole)
        self.suspected[exam.seq] = exam.model.suspect
        if len(self.suspected) > KEPT:
            self.suspected.pop(next(iter(self.suspected)))

    def give(self, answer: bytes) -> None:
        """A frame from the receiver, without COBS."""
        if self.hears and self._random.random() >= self.loss:
            self._answers.append(answer if self.datagrams else cobs(answer) + b"\0")


def _geom(whole: bytes) -> Geom:
    """What a GEOM frame tells."""
    number = int.from_bytes
    body = whole[8:24]
    fields = [number(body[k : k + 2], "little") for k in (2, 4, 6, 12, 14)]
    width, height, cell_mm, tick_ms, stale_ms = fields
    return Geom(body[0], width, height, number(body[8:12], "little"), stale_ms, tick_ms, cell_mm)


class SenderBench:
    """A sender, the receiver under examination, and one receiver that misses nothing."""

    def __init__(
        self, exam: Exam, *, size: int, loss: float, hears: bool = True, baud: int | None = None
    ) -> None:
        self.exam, self.size, self.baud = exam, size, baud
        self.world = World(size, exam.random.getrandbits(32), (32_760, -32_775))
        self.port = ExamPort(exam, loss, hears, exam.random.getrandbits(32))
        self.compared = 0
        self.slowest_s = 0.0  # tick of the newest run
        exam.begin(3, 3)
        self.start_sender()

    def start_sender(self) -> None:
        """A new run of the sender, as after its power was off."""
        exam, session = self.exam, self.exam.random.getrandbits(32)
        self.session = session
        self.link = one_link(
            self.port, size=self.size, session=session, tick_s=TICK_S, line_baud=self.baud,
            key=exam.key,
        )  # fmt: skip
        nonce = exam.hello.nonce if exam.hello else 1
        self.perfect = SlowReceiver(nonce=nonce, max_cells=MOST_CELLS, key=exam.key)
        self.port.sent.clear()
        hello = np.array([nonce, self.size**2], "<u4").tobytes()
        hello += np.array([exam.max_frame, 0], "<u2").tobytes()
        hears, loss, self.port.hears, self.port.loss = self.port.hears, self.port.loss, True, 0.0
        key = Key(exam.key, session, nonce) if exam.key else None  # else `max_frame` counts not
        self.port.give(frame(HELLO, 1, exam.t_ms, hello, 0, key))
        self.port.hears, self.port.loss = hears, loss

    def run(self, ticks: int, changes: int = 6, move_every: int = 5) -> None:
        """So many ticks; after each of them, what the receiver holds and tells is compared."""
        self.slowest_s = 0.0
        for k in range(ticks):
            if changes and move_every and k % move_every == 0:
                self.world.wander()
            self.world.change(changes)
            now_s = self.exam.bench.now_s()
            self.link.step(now_s, STANDING, self.world.window())
            self.compare()
            end_s = now_s + TICK_S
            while (left_s := end_s - self.exam.bench.now_s()) > 1e-6:
                self._hear(left_s)
            self.slowest_s = max(self.slowest_s, self.exam.bench.now_s() - now_s)

    def _hear(self, seconds: float) -> None:
        for answer in self.exam.bench.listen(seconds):
            self.port.give(answer)
            for ack in self.exam.take([answer]):
                self._compare_ack(ack)

    def _compare_ack(self, ack: Ack) -> None:
        """*suspect* as the model had it after that frame."""
        wanted = self.port.suspected.get(ack.last_seq)
        same_epoch = ack.geom_id == self.exam.geom.geom_id
        if wanted is not None and same_epoch and int16(self.exam.seq - ack.last_seq) < KEPT // 2:
            told = bool(ack.status & SUSPECT)
            self.exam.expect(f"suspect after frame {ack.last_seq}", wanted, told)

    def compare(self) -> None:
        """No FREE where the sender has told an OBSTACLE, while *suspect* is clear."""
        model = self.exam.model
        if model.last is None or model.blank or model.suspect:
            return
        if model.geom is None or model.geom.session != self.session:
            return  # the new run's GEOM got lost: what is held is the old one's, and soon stale
        sent = self.port.sent
        while sent and int16(model.last - sent[0][0]) >= 0:
            self.perfect.feed_datagram(0.0, sent.popleft()[1])
        window = self.exam.bench.window()
        held = model.window() if window is None else window
        told = self.perfect.window()
        if held.shape != told.shape:
            return
        self.compared += 1
        wrong = (held == FREE) & (told == OBSTACLE)
        self.exam.expect("FREE where the sender has told OBSTACLE: cells", 0, int(wrong.sum()))
        lost = int(((held == FREE) & (told != FREE)).sum())
        self.exam.expect("FREE where the sender has told something else: cells", 0, lost)

    def finish(self) -> None:
        """The loss ends: all is repaired, and the receiver holds what the sender means."""
        self.port.loss = 0.0
        self.run(100, changes=0)
        self.exam.answers.clear()
        self.run(50, changes=0)
        slow = self.slowest_s > SLOW_S  # we ourselves: then STALE is no fault of the receiver
        bits = SUSPECT | (0 if slow else STALE)
        bits |= NEED_FULL if self.exam.strict or self.port.hears else 0
        if not self.exam.answers:
            self.exam.check_willing()
        told = {ack.status & bits for ack in self.exam.answers}
        self.exam.expect("after the last loss: STALE, SUSPECT, NEED_FULL", {0}, told)
        self.exam.check("after the last loss")
        whole, mine = self.perfect.window(), self.exam.model.window()
        self.exam.expect("cells that differ in the end", 0, int((whole != mine).sum()))
