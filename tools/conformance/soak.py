"""A long run: mapod's sender, rough wires, both receivers on the same bytes, compared all the way.

After every piece that arrives, the Python and the C receiver must agree on all that they know.
While *suspect* is clear no cell may be FREE that one which misses nothing does not hold FREE.
A leg is one kind of link; what happens in it follows from its number and the seed alone.
"""

import random
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from core.records import StopZoneReport, SweepPoints
from mapod_link.receiver import Receiver
from mapod_link.tiles import LAYERS
from tools.conformance.c_receiver import CReceiver
from tools.conformance.exam import DeviationError
from tools.conformance.rough_wire import Roughness, RoughWire
from tools.conformance.sender import TICK_S, Sender, World
from tools.conformance.wire import FREE, U8

SETTLE_TICKS, SETTLE_EVERY = 220, 900
KEY = bytes(range(32))
F32 = npt.NDArray[np.float32]
INF = float("inf")
ZONE = StopZoneReport(
    1.25, 1.5, 0.0, INF, INF, 0.6, 0.0, 0.4, -0.8, (1.5, INF, INF, INF, INF, INF, 0.7, 0.6), 2, 1
)


@dataclass(frozen=True, slots=True)
class Leg:
    """One kind of link; all kinds are in eight legs, and in sixteen with either one's answers."""

    number: int
    datagrams: bool
    keyed: bool
    way_back: bool
    c_answers: bool  # the C receiver's answers go back, not the Python one's
    size: int
    baud: int | None
    roughness: Roughness

    @property
    def words(self) -> str:
        """For a person."""
        kind = "UDP" if self.datagrams else f"serial {self.baud}"
        back = ("C answers" if self.c_answers else "Python answers") if self.way_back else "no ACK"
        return f"{kind}, {'AUTH' if self.keyed else 'no AUTH'}, {back}, {self.size} x {self.size}"


def leg_of(number: int, seed: int) -> Leg:
    """Sizes and chances differ from leg to leg."""
    chance = random.Random(f"{seed} leg {number}")
    datagrams = number % 2 == 0
    upset = 0.03 if datagrams else 0.0
    loss, damage = chance.choice((0.01, 0.05, 0.15)), chance.choice((0.005, 0.03))
    return Leg(
        number,
        datagrams,
        keyed=number // 2 % 2 == 0,
        way_back=number // 4 % 2 == 0,
        c_answers=number // 8 % 2 == (number // 2 % 2),
        size=chance.randint(5, 40),
        baud=None if datagrams else chance.choice((115_200, 230_400, 921_600)),
        roughness=Roughness(loss, 0.002, damage, repeat=upset, swap=upset),
    )


class _Ground:
    """Every cell of every layer, and one sweep, for those who ask."""

    def values(self, layer: str, i: int, j: int, width: int, first: int, count: int) -> F32 | None:
        """A quarter of everything."""
        return np.full(count, 0.25, dtype=np.float32)

    def maybe_scan(self) -> SweepPoints | None:
        """A hundred points."""
        return SweepPoints(1.0, (0.0, 0.0, 0.3), np.ones((100, 3)), 100)


class Soak:
    """One leg under way."""

    def __init__(self, leg: Leg, seed: int) -> None:
        self.leg, self.chance = leg, random.Random(f"{seed} events {leg.number}")
        number = self.chance.getrandbits
        self.world = World(leg.size, number(32), (number(17) - 2**16, number(17) - 2**16))
        self.sender = Sender(self.world, leg.datagrams, self._key, leg.baud)
        self.there = RoughWire(leg.roughness, leg.datagrams, number(32))
        back = Roughness(loss=leg.roughness.loss, damage=leg.roughness.damage)
        self.back = RoughWire(back, leg.datagrams, number(32))
        self.ticks = self.cut_ticks = 0  # since the begin; that nothing arrives any more
        self.counts: Counter[str] = Counter()
        self.tail: deque[bytes] = deque(maxlen=12)
        self.first_seq = 65_535 - number(8)
        self.start_receivers()
        self.start_sender()

    @property
    def _key(self) -> bytes | None:
        return KEY if self.leg.keyed else None

    @property
    def now_s(self) -> float:
        """One clock for all."""
        return 1.0 + self.ticks * TICK_S

    def start_receivers(self) -> None:
        """Both, as after their power was off; and the one that misses nothing."""
        nonce = self.chance.getrandbits(32) | 1 if self.leg.way_back else 0
        self.python = Receiver(nonce, key=self._key, ack_every=16 if self.leg.way_back else 0)
        self.c = CReceiver(nonce, key=self._key)
        self._forget()

    def start_sender(self) -> None:
        """A new run, under another session, from any number."""
        self.sender.start(self.chance.getrandbits(32), self.first_seq)
        self.first_seq = self.chance.randrange(1, 65_536)
        self._forget()

    def _forget(self) -> None:
        """What was on its way is lost; who misses nothing begins anew."""
        self.there.flush()
        self.sender.sent.clear()
        self.perfect = Receiver(self.python.nonce, key=self._key, ack_every=0)

    # Time

    def tick(self, changes: int = 5) -> None:
        """One tick of the sender, all that it brings about, and all comparisons."""
        self.ticks += 1
        self.world.change(changes)
        self.cut_ticks -= self.cut_ticks > 0
        for whole in self.sender.step(self.now_s, ZONE, _Ground()):
            self.counts["frames"] += 1
            self.counts["wraps of seq"] += whole[2:4] == b"\0\0"
            for piece in [] if self.cut_ticks else self.there.carry(whole):
                self._deliver(piece)
        self._expect("stale", self.python.stale(self.now_s), self.c.stale(self.now_s))
        mine, its = self.python.poll(self.now_s), self.c.poll(self.now_s)
        if self.leg.way_back and not self.cut_ticks:
            for answer in its if self.leg.c_answers else mine:
                self.sender.port.answers += self.back.carry(answer)

    def _deliver(self, piece: bytes) -> None:
        self.tail.append(piece)
        for receiver in (self.python, self.c):
            if self.leg.datagrams:
                receiver.feed_datagram(self.now_s, piece)
            else:
                receiver.feed_stream(self.now_s, piece)
        self._compare_receivers()
        self._compare_with_told()

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
            (state.suspect, state.blank, state.need_geom, state.need_full),
            (state.digest_ok, state.auth_failed),
        )
        self._expect("session, geom_id, numbers, gap, bad frames, states, flags", mine, its)
        if geom is not None:
            self._expect_cells("cells of both receivers", python.cells, self.c.window())

    def _compare_with_told(self) -> None:
        """Nothing is FREE that was not told FREE, while *suspect* is clear."""
        python, perfect = self.python, self.perfect
        geom, numbers = python.geom, python.numbers
        if geom is None or geom.session != self.sender.session or not numbers.any:
            return
        for whole in self.sender.sent_until(numbers.last):
            perfect.feed_datagram(self.now_s, whole)
        self.counts["suspect" if python.suspect else "clear"] += 1
        if python.suspect or python.blank or python.cells.shape != perfect.cells.shape:
            return
        if perfect.geom is None or perfect.geom.geom_id != geom.geom_id:
            return
        self.counts["compared"] += 1
        wrong = (python.cells == FREE) & (perfect.cells != FREE)
        self._expect("cells FREE that were told otherwise, suspect clear", 0, int(wrong.sum()))
        self.counts["equal"] += bool(np.array_equal(python.cells, perfect.cells))

    # What happens

    def cut(self, ticks: int) -> None:
        """For so long nothing arrives."""
        self.cut_ticks = ticks

    def distrust(self) -> None:
        """The sender does not trust its map, or trusts it again."""
        self.world.trusted = not self.world.trusted

    def want_full(self) -> None:
        """Both receivers ask for a new epoch."""
        if self.leg.way_back and self.python.geom is not None:
            self.python.needs.full = True
            self.c.say("need_full")

    def ask_tile(self) -> None:
        """The Python receiver asks for a piece of some layer."""
        if self.leg.way_back and not self.leg.c_answers:
            self.python.ask_tile(self.chance.choice(LAYERS), *self.world.corner, 7, 5)

    def ask_scan(self) -> None:
        """The Python receiver asks for the newest sweep."""
        if self.leg.way_back and not self.leg.c_answers:
            self.python.ask_scan()

    def live(self) -> None:
        """One tick with whatever befalls it."""
        if self.chance.random() < 0.2:
            self.world.wander()
        for name, (odds, happen) in EVENTS.items():
            if self.chance.random() < odds:
                self.counts[name] += 1
                happen(self)
        self.tick(self.chance.choice((0, 1, 4, 30)))

    def settle(self) -> None:
        """The wires are smooth for a while: both receivers hold what the sender means."""
        self.world.trusted, self.cut_ticks = True, 0
        rough = self.there.roughness, self.back.roughness
        self.there.roughness = self.back.roughness = Roughness()
        for _ in range(SETTLE_TICKS):
            self.tick(0)
        doubts = self.python.suspect, self.python.stale(self.now_s)
        self._expect("settled: suspect, stale", (False, False), doubts)
        self._expect_cells("settled: cells", self.world.meant(), self.python.cells)
        self.counts["settled"] += 1
        self.there.roughness, self.back.roughness = rough

    def run(self, frames: int) -> None:
        """So many frames, ending settled.

        Raises:
            DeviationError: a receiver, or the sender, does not what the sheet says.
        """
        while self.counts["frames"] < frames:
            self.live()
            if self.ticks % SETTLE_EVERY == 0:
                self.settle()
        self.settle()

    def sums(self) -> dict[str, int]:
        """What has happened, in numbers."""
        return {**self.counts, **self.there.counts}

    # Failing

    def _expect(self, what: str, wanted: object, got: object) -> None:
        if wanted != got:
            place = f"leg {self.leg.number} ({self.leg.words}), tick {self.ticks}: {what}"
            raise DeviationError(place, str(wanted), str(got), tuple(self.tail))

    def _expect_cells(self, what: str, wanted: U8, got: U8) -> None:
        if not np.array_equal(wanted, got):
            differ = np.argwhere(wanted != got)[:5].tolist() if wanted.shape == got.shape else "all"
            self._expect(f"{what}, (row, column) {differ}", wanted.tolist(), got.tolist())


EVENTS: dict[str, tuple[float, Callable[[Soak], None]]] = {  # chance at each tick
    "receiver restart": (0.0008, Soak.start_receivers),
    "sender restart": (0.0008, Soak.start_sender),
    "cut": (0.002, lambda soak: soak.cut(soak.chance.randint(3, 120))),
    "long cut": (0.00004, lambda soak: soak.cut(round(65 / TICK_S))),
    "map begun anew": (0.001, lambda soak: soak.world.erase()),
    "distrust": (0.01, Soak.distrust),
    "need full": (0.002, Soak.want_full),
    "tile": (0.01, Soak.ask_tile),
    "scan": (0.01, Soak.ask_scan),
}
