"""The sender against a slow and obvious receiver: a dict of world cells, section 5 word by word."""

import random
import struct
import zlib
from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.records import I32, U8, ObstacleMap
from fakes.wires.wire import MemoryPort
from hw.planner_link.kernels import BLOCK, EVERY, LOST_ANY, NEAR, REFRESH, REST, URGENT
from hw.planner_link.published import PublishedMap
from hw.planner_link.receivers import one_link
from mapod_link.frames import Frame, bytes_from_frame, frame_from_bytes
from tests.support.cases import few
from tests.support.planner_line import POSE_REPORT, ZONE, HeldPort, Sky, SkyTiles

GEOM, MAP, DIGEST = 1, 3, 4


def runs(ops: bytes) -> list[tuple[int, int]]:
    """Operations as (state, length)."""
    found, k = [], 0
    while k < len(ops):
        state, length, k = ops[k] >> 6, ops[k] & 63, k + 1
        if length == 63:
            shift = 0
            while True:
                length += (ops[k] & 127) << shift
                shift, k = shift + 7, k + 1
                if ops[k - 1] < 128:
                    break
        found.append((state, length + 1))
    return found


class SlowReceiver:
    """Holds what it was told, by world cell; what it does not hold is unknown."""

    def __init__(self, near: tuple[int, int]) -> None:
        self.near = near  # about where the window begins: the wire tells it modulo 65 536
        self.cells: dict[tuple[int, int], int] = {}
        self.origin: tuple[int, int] | None = None
        self.size = self.session = self.last = 0
        self.last_t_ms = 0
        self.geom_id = -1
        self.gap: int | None = None
        self.got: list[int] = []  # numbers accepted
        self.kinds: Counter[int] = Counter()
        self.differs = self.is_stranger = False  # stranger: began within an epoch, unknown to all
        self.sent = 0

    def take(self, data: bytes) -> None:
        """One datagram, undamaged."""
        frame = frame_from_bytes(data)
        assert isinstance(frame, Frame)
        if frame.type == GEOM and struct.unpack_from("<I", frame.body, 8)[0] != self.session:
            self.got = []
        ahead = (frame.seq - self.last + 2**15) % 2**16 - 2**15
        if self.got and ahead <= 0:
            return
        if self.got and ahead > 1:
            self.gap = (frame.seq - 1) % 2**16
        self.last, self.last_t_ms = frame.seq, frame.t_ms
        self.got = [*self.got[-40:], frame.seq]
        self.kinds[frame.type] += 1
        if frame.type == GEOM:
            self.adopt(frame.body)
        elif frame.type == MAP and frame.body[6] == self.geom_id:
            self.apply(frame.body)
        elif frame.type == DIGEST and frame.body[0] == self.geom_id and self.gap is None:
            self.differs |= struct.unpack_from("<I", frame.body, 4)[0] != self.digest()

    def adopt(self, body: bytes) -> None:
        """GEOM."""
        geom_id, size, session = body[0], body[2] + 256 * body[3], struct.unpack_from("<I", body, 8)
        if (geom_id, size, session[0]) != (self.geom_id, self.size, self.session):
            self.is_stranger = self.gap is not None or (self.is_stranger and self.geom_id < 0)
            self.cells, self.origin, self.gap, self.differs = {}, None, None, False
        self.geom_id, self.size, self.session = geom_id, size, session[0]

    def apply(self, body: bytes) -> None:
        """MAP."""
        ox, oy, repaired = struct.unpack_from("<hhH", body)
        old = self.origin or self.near
        i, j = (
            at + (part - at + 2**15) % 2**16 - 2**15 for at, part in zip(old, (ox, oy), strict=True)
        )
        if self.origin is None or max(abs(i - old[0]), abs(j - old[1])) >= self.size:
            self.is_stranger |= self.gap is not None  # unknown, not wrong: the sheet wants it so
            self.cells, self.gap = {}, None
        self.origin, size = (i, j), self.size
        inside = [
            cell for cell in self.cells if 0 <= cell[0] - i < size and 0 <= cell[1] - j < size
        ]
        self.cells = {cell: self.cells[cell] for cell in inside}
        at = int.from_bytes(body[7:10], "little")
        for state, length in runs(body[10:]):
            for k in range(at, at + length):
                if state != 3:
                    self.cells[i + k % size, j + k // size] = state
            at += length
        assert at <= size * size
        if self.gap is not None and (repaired - self.gap + 2**15) % 2**16 >= 2**15:
            self.gap = None

    def window(self) -> U8:
        """(size, size) from the origin."""
        assert self.origin is not None
        i, j = self.origin
        return np.array(
            [
                [self.cells.get((i + x, j + y), 0) for x in range(self.size)]
                for y in range(self.size)
            ],
            dtype=np.uint8,
        )

    def digest(self) -> int:
        """As the sheet says it."""
        flat = [*self.window().ravel().tolist(), 0, 0, 0]
        quads = [flat[k : k + 4] for k in range(0, self.size**2, 4)]
        return zlib.crc32(bytes(a | b << 2 | c << 4 | d << 6 for a, b, c, d in quads))

    def ack(self, t_ms: int, status: int = 0) -> bytes:
        """As a datagram."""
        self.sent += 1
        mask = sum(1 << k for k in range(32) if (self.last - 1 - k) % 2**16 in self.got)
        geom_id = max(0, self.geom_id)
        body = struct.pack(
            "<HIIHHBB", self.last, mask, self.last_t_ms, 0, 0, status | (self.geom_id < 0), geom_id
        )
        return bytes_from_frame(8, self.sent % 2**16, t_ms, body)


class Run:
    """A sender, a slow receiver, and everything that may happen between them, by chance."""

    def __init__(
        self, seed: int, size: int, baud: int | None, loss: float, answers: float = 0.7
    ) -> None:
        self.chance, self.answers = random.Random(seed), answers
        self.sky = Sky(size, seed, (32_760, -32_770))
        self.port: MemoryPort = HeldPort(datagrams=True)
        self.loss, self.now_s = loss, 1000.0
        self.link = one_link(self.port, size=size, session=seed, line_baud=baud, first_seq=65_000)
        self.end = SlowReceiver(self.sky.corner)
        self.acks: list[tuple[float, bytes]] = []  # on their way
        self.repaired: dict[int, int] = {}  # newest by epoch

    def upset(self) -> None:
        """Now and then: moves, doubt, new epochs, restarts, noise, a full wire."""
        chance, sky = self.chance, self.sky
        sky.change(chance.choice([0, 0, 1, 3, 12]))
        if chance.random() < 0.3:
            sky.move(chance.randint(-2, 2), chance.randint(-2, 2))
        sky.trusted = chance.random() < 0.95
        if chance.random() < 0.01:
            sky.cells[:] = 0
            sky.epoch += 1
        if chance.random() < 0.01:  # started again, and says so or does not
            nonce, self.end = chance.randrange(1, 2**32), SlowReceiver(sky.corner)
            self.end.is_stranger = chance.random() < 0.5
            if not self.end.is_stranger:
                hello = struct.pack("<IIHH", nonce, 2**31, chance.choice([60, 368]), 0)
                self.port.give(bytes_from_frame(9, 1, 1, hello))
        if chance.random() < 0.05:
            body = bytes(chance.randrange(256) for _ in range(16))
            self.port.give(bytes_from_frame(8, chance.randrange(2**16), 3, body))
        assert isinstance(self.port, HeldPort)
        self.port.held = chance.random() < 0.05

    def tick(self) -> None:
        """One tick of the sender; what arrives; an answer that arrives late, or never, or twice."""
        chance = self.chance
        self.now_s += 0.02
        due = [ack for at_s, ack in self.acks if at_s <= self.now_s]
        self.acks = [(at_s, ack) for at_s, ack in self.acks if at_s > self.now_s]
        for ack in due:
            self.port.give(ack)
        self.link.step(self.now_s, POSE_REPORT, self.sky.window(), ZONE, SkyTiles(self.sky))
        frames = self.port.take_datagrams()
        if len(frames) > 1 and chance.random() < self.loss:
            frames[-1], frames[-2] = frames[-2], frames[-1]
        for data in frames:
            if chance.random() >= self.loss:
                self.end.take(data)
                if chance.random() < self.loss:
                    self.end.take(data)
        if chance.random() < self.answers and self.end.got:
            needs_full = self.end.differs or chance.random() < 0.01 * (self.loss > 0)
            ack = self.end.ack(round(1000 * self.now_s), 2 * needs_full)
            for _ in range(chance.choice([0, 1, 1, 1, 2])):
                self.acks.append((self.now_s + chance.choice([0.0, 0.0, 0.02, 0.3]), ack))

    def check(self) -> bool:
        """Whether there was something to compare; `repaired` never goes back or beyond."""
        repair = self.link._repair
        assert repair.repaired >= self.repaired.get(repair.epoch_seq, 0)
        assert repair.repaired <= self.link._scheduler.seq
        self.repaired[repair.epoch_seq] = repair.repaired
        assert not self.end.differs or self.end.is_stranger
        corner = self.link._map.corner
        assert corner is not None
        if self.port.backlog:
            return False  # what has changed since was told to nobody
        complete = self.end.last == self.link._scheduler.seq % 2**16  # else no gap can show yet
        if not complete or self.end.gap is not None or self.end.origin != corner:
            return False
        size, told = self.sky.size, self.link._map.published
        here = np.roll(told.reshape(size, size), (-corner[1], -corner[0]), axis=(0, 1))
        held = self.end.window()
        if self.end.geom_id != self.link.geom_id:
            return False
        assert not ((held == 1) & (here != 1)).any()
        assert not ((held == 2) & (here == 1)).any() or self.link._map.lost
        return True


@pytest.mark.parametrize("seed", few(range(6), 2))
@pytest.mark.parametrize(
    ("baud", "loss", "answers"),
    [(115_200, 0.02, 0.7), (None, 0.2, 0.7), (460_800, 0.4, 0.7), (None, 0.01, 0.0)],
)
def test_whatever_happens_who_is_not_suspect_holds_no_free_that_was_not_told(
    seed: int, baud: int | None, loss: float, answers: float
) -> None:
    run = Run(seed, 11 + 3 * seed, baud, loss, answers)
    compared = 0
    for _ in range(350):
        run.upset()
        run.tick()
        compared += run.check()
    assert compared > 10
    run.loss, run.sky.trusted, run.port.held = 0.0, True, False  # type: ignore[attr-defined]
    for _ in range(120):
        run.tick()
        run.check()
    assert run.end.gap is None
    assert (run.end.window() == run.sky.meant()).all()
    assert run.end.kinds[DIGEST] > 0


@given(
    size=st.integers(3, 70),
    seed=st.integers(0, 10_000),
    steps=st.lists(
        st.tuples(
            st.sampled_from([EVERY, URGENT, LOST_ANY, NEAR, REST, REFRESH]),
            st.integers(12, 60),
            st.integers(-3, 3),
            st.sampled_from(["", "", "lost", "again", "retell", "forget", "doubt"]),
        ),
        max_size=12,
    ),
)
def test_the_counts_of_marks_are_those_of_the_marks(
    size: int, seed: int, steps: list[tuple[int, int, int, str]]
) -> None:
    sky, ring = Sky(size, seed), PublishedMap(size)
    lost: list[tuple[I32, tuple[int, int]]] = []
    for kind, room, move, event in steps:
        sky.move(move, -move)
        sky.change(10)
        sky.trusted = event != "doubt"
        ring.update(sky.window(), careful=True)
        if event == "lost" and lost:
            ring.mark_lost(*lost.pop())
        elif event == "again":
            ring.mark_again()
        elif event == "retell":
            ring.publish_again()
        elif event == "forget":
            ring.forget()
        used, _ = ring.measure(kind, 0, size * size, room)
        start, ops, _, cleared = ring.encode(kind, 0, size * size, room)
        assert len(ops) == used <= room
        assert (start < 0) == (not ops)
        assert ring.corner is not None
        lost.append((cleared, ring.corner))
        check_counts(ring)
        marked = ring._ring.marks.reshape(size, size) != 0
        meant = np.where(sky.cells == 1, 2, np.where((sky.cells == -1) & sky.trusted, 1, 0))
        assert (marked | (ring.published.reshape(size, size) == meant)).all()


def check_counts(ring: PublishedMap) -> None:
    """Counts of rows, blocks and all, at all levels, are those of the cells' marks."""
    size, marks = ring.size, ring._ring.marks.reshape(ring.size, ring.size)
    blocks = -(-size // BLOCK)
    for level, bits in enumerate((255, 8 | 16, 2 | 4)):
        rows = ((marks & bits) != 0).astype(np.int32)
        assert ring._ring.counts[level] == rows.sum()
        assert (ring._ring.rows[level] == rows.sum(axis=1)).all()
        padded = np.pad(rows, ((0, 0), (0, blocks * BLOCK - size)))
        assert (ring._ring.blocks[level] == padded.reshape(-1, BLOCK).sum(axis=1)).all()
    assert ring.lost == ((marks & 2) != 0).sum()


def test_a_tick_with_a_full_window_to_tell_allocates_nothing_of_its_size() -> None:
    sky = Sky(101, 1)
    sky.show(sky.every_other, 1)
    ring = PublishedMap(101)
    ring.update(sky.window(), careful=True)
    told = ring.published
    ring.update(ObstacleMap(sky.cells, 5, 5, np.zeros(0, np.int32), 0, False), careful=True)
    ring.forget()
    ring.publish_again()
    assert ring.published is told
    assert ring.encode(EVERY, 0, 101 * 101, 300)[3].size < 1000
