"""A long run: mapod's sender, rough wires, both receivers on the same bytes, compared all the way.

After every piece that arrives, the Python and the C receiver must agree on all that they know.
While *suspect* is clear no cell may be FREE that one which misses nothing does not hold FREE.
A leg is one kind of link; what happens in it follows from its number and the seed alone.
"""

import random
from collections import Counter, deque
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from core.records import StopZoneReport
from hw.planner_link.receivers import one_link
from mapod_link.receiver import Receiver
from tools.conformance.c_receiver import CReceiver
from tools.conformance.exam import DeviationError
from tools.conformance.rough_wire import Roughness, RoughWire
from tools.conformance.soak_leg import Leg, SoakPort
from tools.conformance.wire import FREE, U8, int16
from tools.conformance.world import STANDING, World

TICK_MS, SETTLE_TICKS, SETTLE_EVERY = 20, 220, 900
KEY = bytes(range(32))
F32 = npt.NDArray[np.float32]
INF = float("inf")
ZONE = StopZoneReport(
    1.25, 1.5, 0.0, INF, INF, 0.6, 0.0, 0.4, -0.8, (1.5, INF, INF, INF, INF, INF, 0.7, 0.6), 2, 1
)
SMOOTH = Roughness()


class _Ground:
    """Every cell of every layer, for those who ask for tiles."""

    def values(self, layer: str, i: int, j: int, width: int, first: int, count: int) -> F32 | None:
        """A quarter of everything."""
        return np.full(count, 0.25, dtype=np.float32)


class Soak:
    """One leg under way."""

    def __init__(self, leg: Leg, seed: int) -> None:
        self.leg, self.now_ms = leg, 1_000
        self.chance = random.Random(f"{seed} events {leg.number}")
        number = self.chance.getrandbits
        self.world = World(leg.size, number(32), (number(17) - 2**16, number(17) - 2**16))
        self.there = RoughWire(leg.roughness, leg.datagrams, number(32))
        back = Roughness(loss=leg.roughness.loss, damage=leg.roughness.damage)
        self.back = RoughWire(back, leg.datagrams, number(32))
        self.port = SoakPort(leg.datagrams)
        self.frames = self.ticks = self.wraps = 0
        self.counts: Counter[str] = Counter()
        self.tail: deque[bytes] = deque(maxlen=12)
        self.cut_ticks = 0  # that nothing arrives any more
        self.pending: deque[tuple[int, bytes]] = deque()
        self.first_seq = 65_535 - number(8)
        self.start_receivers()
        self.start_sender()

    def start_receivers(self) -> None:
        """Both, as after their power was off; and the one that misses nothing."""
        self.nonce = self.chance.getrandbits(32) | 1 if self.leg.way_back else 0
        key = KEY if self.leg.keyed else None
        every = 16 if self.leg.way_back else 0
        self.python = Receiver(self.nonce, key=key, ack_every=every)
        self.c = CReceiver(self.nonce, key=key)
        self._forget()

    def start_sender(self) -> None:
        """A new run, under another session, from any number."""
        self.session = self.chance.getrandbits(32)
        self.link = one_link(
            self.port, size=self.leg.size, session=self.session, tick_s=TICK_MS / 1000,
            line_baud=self.leg.baud, key=KEY if self.leg.keyed else None, first_seq=self.first_seq,
        )  # fmt: skip
        self.first_seq = self.chance.randrange(1, 65_536)
        self.port.answers.clear()
        self._forget()

    def _forget(self) -> None:
        """What was on its way is lost; who misses nothing begins anew."""
        self.there.flush()
        self.pending.clear()
        self.perfect = Receiver(self.nonce, key=KEY if self.leg.keyed else None, ack_every=0)

    # Time

    def tick(self, changes: int = 5) -> None:
        """One tick of the sender, all that it brings about, and all comparisons."""
        self.now_ms += TICK_MS
        self.ticks += 1
        now_s = self.now_ms / 1000
        self.world.change(changes)
        self.link.step(now_s, STANDING, self.world.window(), ZONE, _Ground())
        written, self.port.written = self.port.written, []
        self.cut_ticks -= self.cut_ticks > 0
        for whole in written:
            self.frames += 1
            seq = int.from_bytes(whole[2:4], "little")
            self.wraps += seq == 0
            self.pending.append((seq, whole))
            for piece in [] if self.cut_ticks else self.there.carry(whole):
                self._deliver(now_s, piece)
        self._expect("stale", self.python.stale(now_s), self.c.stale(now_s))
        answers = {False: self.python.poll(now_s), True: self.c.poll(now_s)}[self.leg.c_answers]
        for answer in answers if self.leg.way_back and not self.cut_ticks else []:
            self.port.answers += self.back.carry(answer)

    def _deliver(self, now_s: float, piece: bytes) -> None:
        self.tail.append(piece)
        for receiver in (self.python, self.c):
            if self.leg.datagrams:
                receiver.feed_datagram(now_s, piece)
            else:
                receiver.feed_stream(now_s, piece)
        self._compare_receivers()
        self._compare_with_told(now_s)

    def _compare_receivers(self) -> None:
        """All that both know."""
        python, state = self.python, self.c.state()
        geom = python.geom
        numbers = python.numbers
        mine = (
            geom.session if geom else None,
            geom.geom_id if geom else None,
            (numbers.last, numbers.mask) if numbers.any else None,
            None if numbers.gap is None else numbers.gap & 0xFFFF,
            python.rejected.total() % 2**16,
            (python.suspect, python.blank, python.needs.geom or not geom, python.needs.full),
            (python.needs.digest_ok, python.needs.auth_failed),
        )
        its = (
            state.session if state.has_geom else None,
            state.geom_id if state.has_geom else None,
            (state.last, state.mask) if state.any else None,
            state.gap if state.suspect else None,
            state.bad_frames,
            tuple(map(bool, (state.suspect, state.blank, state.need_geom, state.need_full))),
            (bool(state.digest_ok), bool(state.auth_failed)),
        )
        self._expect("session, geom_id, numbers, gap, bad frames, states, flags", mine, its)
        if python.geom is not None:
            self._expect_cells("cells of both receivers", python.cells, self.c.cells)

    def _compare_with_told(self, now_s: float) -> None:
        """Nothing is FREE that was not told FREE, while *suspect* is clear."""
        python = self.python
        if python.geom is None or python.geom.session != self.session or not python.numbers.any:
            return
        while self.pending and int16(python.numbers.last - self.pending[0][0]) >= 0:
            self.perfect.feed_datagram(now_s, self.pending.popleft()[1])
        self.counts["suspect" if python.suspect else "clear"] += 1
        told = self.perfect.cells
        if python.suspect or python.blank or python.cells.shape != told.shape:
            return
        if self.perfect.geom is None or self.perfect.geom.geom_id != python.geom.geom_id:
            return
        self.counts["compared"] += 1
        wrong = (python.cells == FREE) & (told != FREE)
        self._expect("cells FREE that were told otherwise, suspect clear", 0, int(wrong.sum()))
        self.counts["equal"] += bool(np.array_equal(python.cells, told))

    # What happens

    def live(self) -> None:
        """One tick with whatever befalls it."""
        chance = self.chance
        draw = chance.random()
        if draw < 0.2:
            self.world.wander()
        for what, odds in EVENTS.items():
            if chance.random() < odds:
                self.counts[what.__name__[1:]] += 1
                what(self)
        self.tick(chance.choice((0, 1, 4, 30)))

    def settle(self) -> None:
        """The wires are smooth for a while: both receivers hold what the sender means."""
        self.world.trusted, self.cut_ticks = True, 0
        rough, rough_back = self.there.roughness, self.back.roughness
        self.there.roughness = self.back.roughness = SMOOTH
        for _ in range(SETTLE_TICKS):
            self.tick(0)
        now_s = self.now_ms / 1000
        self._expect("settled: suspect, stale", (False, False), self._doubts(now_s))
        self._expect_cells("settled: cells", self.world.meant(), self.python.cells)
        self.counts["settled"] += 1
        self.there.roughness, self.back.roughness = rough, rough_back

    def _doubts(self, now_s: float) -> tuple[bool, bool]:
        return self.python.suspect, self.python.stale(now_s)

    def run(self, frames: int) -> None:
        """So many frames, ending settled.

        Raises:
            DeviationError: a receiver, or the sender, does not what the sheet says.
        """
        while self.frames < frames:
            self.live()
            if self.ticks % SETTLE_EVERY == 0:
                self.settle()
        self.settle()

    def sums(self) -> dict[str, int]:
        """What has happened, in numbers."""
        wire = self.there
        return {
            "frames": self.frames,
            "lost": wire.lost,
            "damaged": wire.damaged,
            "repeated": wire.repeated,
            "swapped": wire.swapped,
            "wraps of seq": self.wraps,
            **{name.replace("_", " "): count for name, count in sorted(self.counts.items())},
        }

    # Failing

    def _expect(self, what: str, wanted: object, got: object) -> None:
        if wanted != got:
            place = f"leg {self.leg.number} ({self.leg.words}), tick {self.ticks}: {what}"
            raise DeviationError(place, str(wanted), str(got), tuple(self.tail))

    def _expect_cells(self, what: str, wanted: U8, got: U8) -> None:
        if not np.array_equal(wanted, got):
            differ = np.argwhere(wanted != got)[:5].tolist() if wanted.shape == got.shape else "all"
            self._expect(f"{what}, (row, column) {differ}", wanted.tolist(), got.tolist())


def _receiver_restart(soak: Soak) -> None:
    soak.start_receivers()


def _sender_restart(soak: Soak) -> None:
    soak.start_sender()


def _cut(soak: Soak) -> None:
    soak.cut_ticks = soak.chance.randint(3, 120)


def _long_cut(soak: Soak) -> None:
    soak.cut_ticks = 65_000 // TICK_MS


def _map_begun_anew(soak: Soak) -> None:
    soak.world.erase()


def _distrust(soak: Soak) -> None:
    soak.world.trusted = not soak.world.trusted


def _need_full(soak: Soak) -> None:
    if soak.leg.way_back and soak.python.geom is not None:
        soak.python.needs.full = True
        soak.c.want_full()


def _tile(soak: Soak) -> None:
    if soak.leg.way_back and not soak.leg.c_answers:
        layer = soak.chance.choice(("class", "height", "variance", "slope"))
        soak.python.ask_tile(layer, *soak.world.corner, 7, 5)


EVENTS: dict[Callable[[Soak], None], float] = {
    _receiver_restart: 0.0008,
    _sender_restart: 0.0008,
    _cut: 0.002,
    _long_cut: 0.00004,
    _map_begun_anew: 0.001,
    _distrust: 0.01,
    _need_full: 0.002,
    _tile: 0.01,
}
