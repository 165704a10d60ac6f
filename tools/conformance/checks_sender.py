"""Conformance tests 5 and 7 with mapod's own sender: repair, restarts, a line that is full."""

import random
import struct

from tools.conformance.exam import MOST_CELLS, Exam
from tools.conformance.sender import TICK_S, Sender, World
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
    frame,
    int16,
)

LOSS = 0.05
BAUD, LINE_SHARE = 115_200, 0.85
SLOW_S = 0.1
KEPT = 4096  # frames whose suspicion is remembered, for the ACKs that tell of them


class SenderBench:
    """A sender, the receiver under examination, and one receiver that misses nothing.

    Args:
        loss: of frames and answers.
        hears: False: no answer comes back.
    """

    def __init__(
        self, exam: Exam, *, size: int, loss: float, hears: bool = True, baud: int | None = None
    ) -> None:
        self.exam, self.loss, self.hears = exam, loss, hears
        world = World(size, exam.random.getrandbits(32), (32_760, -32_775))
        self.sender = Sender(world, exam.bench.datagrams, exam.key, baud)
        self.suspected: dict[int, bool] = {}  # by number: the model's suspicion after that frame
        self.compared = 0
        self.slowest_s = 0.0  # tick of the newest run
        self._random = random.Random(exam.random.getrandbits(32))
        exam.begin(3, 3)
        self.start_sender()

    def start_sender(self) -> None:
        """A new run of the sender, which has heard the receiver's HELLO."""
        exam = self.exam
        self.sender.start(exam.random.getrandbits(32))
        nonce = exam.nonce or 1
        self.perfect = SlowReceiver(nonce=nonce, max_cells=MOST_CELLS, key=exam.key)
        hello = struct.pack("<IIHH", nonce, self.sender.world.size**2, exam.max_frame, 0)
        key = exam.key_of(self.sender.session)  # without it `max_frame` counts not
        self.sender.port.give(frame(HELLO, 1, exam.t_ms, hello, 0, key))

    def run(self, ticks: int, changes: int = 6, move_every: int = 5) -> None:
        """So many ticks; after each of them, what the receiver holds and tells is compared."""
        self.slowest_s = 0.0
        for k in range(ticks):
            if changes and move_every and k % move_every == 0:
                self.sender.world.wander()
            self.sender.world.change(changes)
            now_s = self.exam.bench.now_s()
            for whole in self.sender.step(now_s):
                self._carry(whole)
            self._compare()
            end_s = now_s + TICK_S
            while (left_s := end_s - self.exam.bench.now_s()) > 1e-6:
                self._hear(left_s)
            self.slowest_s = max(self.slowest_s, self.exam.bench.now_s() - now_s)

    def _carry(self, whole: bytes) -> None:
        """A frame of the sender's, which may get lost."""
        exam, kind = self.exam, whole[0] & 15
        exam.seq = int.from_bytes(whole[2:4], "little")
        exam.skipped_ms = 0
        if kind == GEOM:
            exam.geom = exam.model.maybe_geom(whole[8:24]) or exam.geom
        if kind == MAP:
            exam.origin = struct.unpack_from("<hh", whole, 8)
        if self._random.random() >= self.loss:
            exam.send(whole)
            self.suspected[exam.seq] = exam.model.suspect
            if len(self.suspected) > KEPT:
                self.suspected.pop(next(iter(self.suspected)))

    def _hear(self, seconds: float) -> None:
        for answer in self.exam.bench.listen(seconds):
            if self.hears and self._random.random() >= self.loss:
                self.sender.port.give(answer)
            for ack in self.exam.take([answer]):
                self._compare_ack(ack)

    def _compare_ack(self, ack: Ack) -> None:
        """*suspect* as the model had it after that frame."""
        wanted = self.suspected.get(ack.last_seq)
        same_epoch = ack.geom_id == self.exam.geom.geom_id
        if wanted is not None and same_epoch and int16(self.exam.seq - ack.last_seq) < KEPT // 2:
            told = bool(ack.status & SUSPECT)
            self.exam.expect(f"suspect after frame {ack.last_seq}", wanted, told)

    def _compare(self) -> None:
        """No FREE where the sender has told an OBSTACLE, while *suspect* is clear."""
        model = self.exam.model
        if model.last is None or model.blank or model.suspect:
            return
        if model.geom is None or model.geom.session != self.sender.session:
            return  # the new run's GEOM got lost: what is held is the old one's, and soon stale
        for whole in self.sender.sent_until(model.last):
            self.perfect.feed_datagram(0.0, whole)
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
        exam, self.loss = self.exam, 0.0
        self.run(100, changes=0)
        exam.answers.clear()
        self.run(50, changes=0)
        slow = self.slowest_s > SLOW_S  # we ourselves: then STALE is no fault of the receiver
        bits = SUSPECT | (0 if slow else STALE)
        bits |= NEED_FULL if exam.strict or self.hears else 0
        if not exam.answers:
            exam.check_willing()
        told = {ack.status & bits for ack in exam.answers}
        exam.expect("after the last loss: STALE, SUSPECT, NEED_FULL", {0}, told)
        exam.check("after the last loss")
        whole, mine = self.perfect.window(), exam.model.window()
        exam.expect("cells that differ in the end", 0, int((whole != mine).sum()))


def _drive(exam: Exam, hears: bool) -> str:
    """Changes, moves, losses, a silence, a new epoch and a restart of the sender."""
    exam.needs_map()
    bench = SenderBench(exam, size=exam.side(31), loss=LOSS, hears=hears)
    ticks, world = max(60, round(300 * exam.share)), bench.sender.world
    bench.run(ticks)
    world.trusted = False
    bench.run(10)
    world.trusted = True
    world.erase()
    bench.run(ticks // 2)
    stale = [ack.status & STALE for ack in exam.hear_all(0.5)]
    exam.expect("the sender is silent for 0.5 s: STALE", True, any(stale))
    bench.run(ticks // 3)
    bench.start_sender()
    bench.run(ticks // 2)
    bench.finish()
    frames = bench.sender.frames_sent
    return f"{bench.compared} maps compared, {frames} frames of the last run, {LOSS:.0%} loss"


def repair_by_ack(exam: Exam) -> str:
    """5: what gets lost is told again, for the ACKs show it."""
    return _drive(exam, hears=True)


def repair_by_refresh(exam: Exam) -> str:
    """5: what gets lost is told again by the rolling refresh, without any way back."""
    return _drive(exam, hears=False)


def full_line(exam: Exam) -> str:
    """7: with more changes than the line carries, no tick is late by more than one."""
    exam.needs_map()
    bench = SenderBench(exam, size=exam.side(101), loss=0.0, baud=BAUD)
    rate, per_tick = BAUD / 10, BAUD / 10 * TICK_S  # bytes that the line carries
    waiting, most, written = 0.0, 0.0, 0
    begun_s = tick_s = exam.bench.now_s()
    for _ in range(max(100, round(250 * exam.share))):
        bench.run(1, changes=60, move_every=0)
        now_s, wires = exam.bench.now_s(), bench.sender.port.bytes_written
        waiting = max(0.0, waiting + wires - written - rate * (now_s - tick_s))
        written, tick_s = wires, now_s
        most = max(most, waiting)
    exam.expect("bytes that wait a tick later: at most a tick's", True, most <= per_tick)
    share = written / (rate * (tick_s - begun_s))
    exam.expect("share of the line that is used: at most 0.85", True, share <= LINE_SHARE + 0.02)
    bench.finish()
    return f"{share:.0%} of {BAUD} baud in use, never more than {most / per_tick:.1f} ticks behind"
