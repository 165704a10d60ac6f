"""The sender whatever befalls it, and its marks, against what the marks themselves say."""

import random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.records import I32, ObstacleMap
from fakes.planner_mcu.receiver import FakePlanner
from hw.planner_link.kernels import BLOCK, EVERY, MISSING, NEAR, REFRESH, URGENT
from hw.planner_link.published import PublishedMap
from mapod_link.frames import ACK, bytes_from_frame
from tests.support.cases import examples, few
from tests.support.link.planner_line import ZONE, HeldPort, Line, Sky, SkyTiles


class Upsets:
    """All that may happen to a line by chance: moves, doubt, epochs, restarts, noise, stops."""

    def __init__(self, line: Line, seed: int) -> None:
        self.line, self.chance = line, random.Random(seed)
        self.back = (0, 0)  # the window's newest move, which may be taken back
        self.late: list[bytes] = []  # acknowledgements that were overtaken
        self.has_restarted = False
        self.repaired: dict[int, int] = {}  # newest by epoch

    def happen(self) -> None:
        line, sky, chance = self.line, self.line.sky, self.chance
        sky.change(chance.choice([0, 0, 1, 5, 20]))
        if chance.random() < 0.4:
            self.back = (-self.back[0], -self.back[1]) if any(self.back) else (
                chance.randint(-3, 3), chance.randint(-2, 2)
            )  # fmt: skip
            sky.move(*self.back)
        sky.trusted = chance.random() < 0.95
        if chance.random() < 0.01:
            sky.cells[:] = 0
            sky.epoch += 1
        if chance.random() < 0.005:  # started again, and says so or can say nothing
            self.has_restarted = True
            line.planner = FakePlanner(chance.randrange(2**32), ack_every=chance.choice([0, 1]))
        if chance.random() < 0.1:
            body = line.planner.ack(line.now_s) if chance.random() < 0.5 else chance.randbytes(16)
            self.late.append(bytes_from_frame(ACK, chance.randrange(2**16), 3, body))
        if self.late and line.port.datagrams and chance.random() < 0.1:
            line.port.give(self.late.pop(0))
        assert isinstance(line.port, HeldPort)
        line.port.held = chance.random() < 0.05

    def check(self) -> bool:
        """Whether there was something to compare; `repaired` never goes back or beyond."""
        line, planner, repair = self.line, self.line.planner, self.line.link._repair
        assert self.repaired.get(repair.epoch_seq, 0) <= repair.repaired
        assert repair.repaired <= line.link._scheduler.seq
        self.repaired[repair.epoch_seq] = repair.repaired
        assert not planner.needs.full or self.has_restarted
        if line.port.backlog or not line.is_up_to_date() or planner.suspect:
            return False
        held, told = planner.window(), line.told()
        assert not ((held == 1) & (told != 1)).any()
        assert not ((held == 2) & (told == 1)).any() or line.link._map.lost
        return True


@pytest.mark.parametrize("seed", few(range(6), 1))
@pytest.mark.parametrize(
    ("baud", "loss", "ack_every"),
    few([(460_800, 0.3, 5), (None, 0.01, 0), (115_200, 0.02, 1), (None, 0.2, 1)], 2),
)
def test_whatever_happens_who_is_not_suspect_holds_no_free_that_was_not_told(
    seed: int, baud: int | None, loss: float, ack_every: int
) -> None:
    sky = Sky(9 + 3 * seed, seed, (32_760, -32_770))
    line = Line(
        sky, baud=baud, loss=loss, ack_every=ack_every, seed=seed, first_seq=65_000, zone=ZONE,
        tiles=SkyTiles(sky), port=HeldPort(datagrams=baud is None),
    )  # fmt: skip
    upsets, compared = Upsets(line, seed), 0
    for _ in range(200):
        upsets.happen()
        line.tick()
        compared += upsets.check()
    assert compared > 5
    line.loss, sky.trusted, line.port.held = 0.0, True, False  # type: ignore[attr-defined]
    line.settle(3.0)
    assert not line.planner.suspect
    assert line.holds_what_is_meant()
    assert line.planner.needs.digest_ok


@settings(max_examples=examples(25))
@given(
    size=st.integers(3, 40),
    seed=st.integers(0, 10_000),
    steps=st.lists(
        st.tuples(
            st.sampled_from([EVERY, URGENT, MISSING, EVERY | NEAR, REFRESH]),
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
    for wanted, room, move, event in steps:
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
        measured = ring.encode(wanted, 0, size * size, room, for_good=False)
        start, ops, _, cleared = ring.encode(wanted, 0, size * size, room)
        assert measured[:2] == (start, ops)
        assert len(ops) <= room
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
