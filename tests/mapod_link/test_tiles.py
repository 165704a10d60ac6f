"""Tiles put together from their pieces: whatever gets lost is asked for again, and nothing else.

Source: planner link, sections 3 (ASK, TILE) and 14, item 10.
"""

import random
import struct
from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapod_link.asking import ASK_BODY
from mapod_link.frames import ASK, GEOM, HELLO, TILE, bytes_from_frame, frame_from_bytes, int16
from mapod_link.receiver import Receiver
from mapod_link.tiles import Tile
from tests.support.cases import examples
from tests.support.link.planner_sender import NONCE, geom_body

RAW: dict[int, tuple[int, ...]] = {
    0: (0, 1, 2),
    1: (-32_768, -500, 0, 1234),
    2: (65_535, 0, 65_534),
    3: (65_535, 0, 7854),
    4: (0, 1, 64, 255),
    5: (65_535, 0, 125),
    6: (-32_768, -500, 0, 1234),
    7: (65_535, 0, 500),
    8: (65_535, 0, 10_000),
    9: (-32_768, -500, 0, 1234),
    10: (65_535, 0, 123),
    11: (65_535, 0, 123),
}
SCALE = {0: 1.0, 1: 1e-3, 2: 1e-6, 3: 1e-4, 4: 1.0, 5: 1e-1, 6: 1e-3, 7: 1e-3, 8: 1e-4}
SCALE |= {9: 1e-3, 10: 1e-4, 11: 1e-4}
UNKNOWN = {1: -32_768, 2: 65_535, 3: 65_535, 5: 65_535, 6: -32_768, 7: 65_535, 8: 65_535}
UNKNOWN |= {9: -32_768, 10: 65_535, 11: 65_535}
FORMATS = {1: "h", 4: "B", 6: "h", 9: "h"}


class Sender:
    """Answers ASK frames cell by cell from a function of the endless grid; may lose frames."""

    def __init__(self, cells_a_piece: int = 7) -> None:
        self.receiver, self.cells_a_piece = Receiver(NONCE), cells_a_piece
        self.now_s, self.seq, self.geom_id, self.window = 1.0, 1, 7, (0, 0)
        self.asked: list[tuple[int, ...]] = []
        self.hellos = 0
        self.loses: Callable[[], bool] = lambda: False
        self.before_piece: Callable[[int], None] = lambda first: None
        self.receiver.feed_datagram(0.9, bytes_from_frame(GEOM, 1, 900, geom_body()))

    def raw(self, layer: int, i: int, j: int) -> int:
        """The value of a cell, modulo 65 536 as its place."""
        kinds = RAW[layer]
        return kinds[(int16(i) * 31 + int16(j) * 17 + self.geom_id) % len(kinds)]

    def step(self, dt_s: float = 0.1) -> None:
        self.now_s += dt_s
        for data in self.receiver.poll(self.now_s):
            frame = frame_from_bytes(data)
            assert not isinstance(frame, str)
            self.hellos += frame.type == HELLO
            if frame.type == ASK and not self.loses():
                self.answer(frame.body)

    def answer(self, body: bytes) -> None:
        tile_id, what, layer, i, j, width, height = ASK_BODY.unpack(body)
        self.asked.append((tile_id, what, layer, i, j, width, height))
        if what & 0x80:
            i, j = i + self.window[0], j + self.window[1]
        for first in range(0, width * height, self.cells_a_piece):
            self.before_piece(first)
            cells = range(first, min(first + self.cells_a_piece, width * height))
            raws = [self.raw(layer, i + k % width, j + k // width) for k in cells]
            values = struct.pack(f"<{len(raws)}{FORMATS.get(layer, 'H')}", *raws)
            if layer == 0:
                quads = [[*raws, 0, 0, 0][k : k + 4] for k in range(0, len(raws), 4)]
                values = bytes(a | b << 2 | c << 4 | d << 6 for a, b, c, d in quads)
            self.say(tile_id, layer, 0, (i, j, width, height), first, len(raws), values)

    def say(
        self,
        tile_id: int,
        layer: int,
        status: int,
        rectangle: tuple[int, int, int, int],
        first: int = 0,
        count: int = 0,
        values: bytes = b"",
    ) -> None:
        i, j, width, height = rectangle
        body = struct.pack("<HBBhhHH", tile_id, layer, status, int16(i), int16(j), width, height)
        body += first.to_bytes(3, "little") + struct.pack("<BHH", self.geom_id, count, 50) + values
        self.seq += 1
        frame = bytes_from_frame(TILE, self.seq, round(self.now_s * 1000), body)
        if not self.loses():
            self.receiver.feed_datagram(self.now_s, frame)

    def meant(self, layer: int, place: tuple[int, int], tile: Tile) -> npt.NDArray[np.float64]:
        raws = np.array(
            [
                [self.raw(layer, place[0] + col, place[1] + row) for col in range(tile.shape[1])]
                for row in range(tile.shape[0])
            ]
        )
        return np.where(raws == UNKNOWN.get(layer, -1), np.nan, raws * SCALE[layer])


LAYERS = (
    *("class", "height", "variance", "slope", "cause", "age", "z", "edge", "foothold"),
    *("filled", "filled_sigma", "foothold_sigma"),
)


@settings(max_examples=examples(30))
@given(
    layer=st.sampled_from(LAYERS),
    place=st.tuples(st.sampled_from([-32_768, -3, 32_760, 70_000]), st.integers(-9, 9)),
    size=st.tuples(st.integers(1, 12), st.integers(1, 12)),
    in_window=st.booleans(),
    loss=st.sampled_from([0.0, 0.2, 0.6]),
    seed=st.integers(0, 99),
)
def test_a_tile_is_that_of_the_sender_whatever_gets_lost(
    layer: str,
    place: tuple[int, int],
    size: tuple[int, int],
    in_window: bool,
    loss: float,
    seed: int,
) -> None:
    chance = random.Random(seed)
    sender = Sender(cells_a_piece=chance.choice([1, 5, 300]))
    sender.window = (1000, -70)
    sender.loses = lambda: chance.random() < loss
    tile = sender.receiver.ask_tile(layer, *place, *size, in_window=in_window)
    for _ in range(1600):
        sender.step()
        if tile.done:
            break
    there = (place[0] + 1000, place[1] - 70) if in_window else place
    assert tile.complete
    assert tile.values.shape == (size[1], size[0])
    assert tile.place is not None
    assert [int16(a - b) for a, b in zip(tile.place, there, strict=True)] == [0, 0]
    meant = sender.meant(LAYERS.index(layer), there, tile)
    np.testing.assert_allclose(tile.values, meant, rtol=1e-6)
    assert (tile.geom_id, tile.cell_m) == (7, 0.05)


def test_only_the_rows_that_miss_are_asked_for_again_and_soon() -> None:
    sender = Sender(cells_a_piece=4)
    lost = iter([False] + [k in (2, 3) for k in range(6)])
    sender.loses = lambda: next(lost, False)
    tile = sender.receiver.ask_tile("height", 5, 6, 4, 6)
    sender.step()
    assert tile.here.all(axis=1).tolist() == [True, True, False, False, True, True]
    sender.step(0.04)
    assert len(sender.asked) == 1
    sender.step(0.02)
    assert tile.complete
    assert sender.asked == [(tile.id, 8, 1, 5, 6, 4, 6), (tile.id, 8, 1, 5, 8, 4, 2)]


def test_four_at_a_time_and_the_others_wait() -> None:
    sender = Sender()
    tiles = [sender.receiver.ask_tile("slope", k, 0, 5, 5) for k in range(6)]
    sender.step()
    assert [tile.complete for tile in tiles] == [True] * 4 + [False] * 2
    sender.step()
    assert all(tile.complete for tile in tiles)
    assert len(sender.asked) == 6


@pytest.mark.parametrize(("status", "why"), [(1, "no such layer"), (2, "too many"), (9, "9")])
def test_a_refusal_ends_the_asking(status: int, why: str) -> None:
    sender = Sender()
    tile = sender.receiver.ask_tile("slope", 0, 0, 5, 5)
    sender.receiver.poll(1.0)
    sender.say(tile.id, 3, status, (0, 0, 5, 5))
    assert why in tile.refusal
    assert tile.done
    assert not tile.complete
    sender.step(10.0)
    assert not sender.asked


def test_too_many_at_a_time_is_asked_again_later_and_a_dropped_tile_no_more() -> None:
    sender = Sender()
    tile, other = (sender.receiver.ask_tile("slope", 0, 0, 5, 5) for _ in range(2))
    assert np.isnan(tile.values).all()
    sender.receiver.poll(1.0)
    sender.say(tile.id, 3, 3, (0, 0, 5, 5))
    sender.receiver.tiles.drop(other)
    sender.step(0.1)
    assert not tile.done
    sender.step(0.5)
    assert tile.complete
    assert (other.done, len(sender.asked)) == (True, 1)


def test_a_map_begun_anew_in_the_middle_begins_the_tile_anew() -> None:
    sender = Sender()

    def anew(first: int) -> None:
        sender.geom_id = 8 if first >= 14 else sender.geom_id

    sender.before_piece = anew
    tile = sender.receiver.ask_tile("height", 3, 4, 7, 5)
    sender.step()
    assert tile.here.all(axis=1).tolist() == [False, False, True, True, True]
    sender.step()
    assert (tile.complete, tile.geom_id) == (True, 8)
    np.testing.assert_allclose(tile.values, sender.meant(1, (3, 4), tile), rtol=1e-6)


def test_another_run_of_the_sender_is_asked_all_of_it() -> None:
    sender = Sender()
    tile = sender.receiver.ask_tile("height", 3, 4, 7, 5, in_window=True)
    lost = iter([False] * 3)
    sender.loses = lambda: next(lost, True)
    sender.step()
    assert 0 < tile.here.sum() < tile.here.size
    sender.loses, sender.window, sender.seq = lambda: False, (50, 50), 1
    sender.receiver.feed_datagram(1.2, bytes_from_frame(GEOM, 1, 5, geom_body(session=99)))
    assert not tile.here.any()
    sender.step()
    assert (tile.complete, tile.place) == (True, (53, 54))


def test_a_sender_that_does_not_answer_is_greeted_and_asked_once_a_second() -> None:
    sender = Sender()
    tile, asked = sender.receiver.ask_tile("class", 0, 0, 9, 9), 0
    for _ in range(100):
        sender.now_s += 0.1
        frames = [frame_from_bytes(data) for data in sender.receiver.poll(sender.now_s)]
        kinds = [getattr(frame, "type", -1) for frame in frames]
        asked += kinds.count(ASK)
        sender.hellos += kinds.count(HELLO)
    assert 9 <= asked <= 14
    assert sender.hellos > 15  # it may have started again, and then knows nobody
    sender.step(5.0)
    sender.hellos = 0
    sender.step()
    sender.step()
    assert (sender.hellos, tile.complete) == (0, True)


def test_a_piece_counts_by_its_columns_and_place_modulo_65536() -> None:
    sender = Sender()
    tile = sender.receiver.ask_tile("height", 0, 0, 3, 3)
    sender.receiver.poll(1.0)
    sender.say(tile.id, 1, 0, (0, 0, 4, 3), 0, 3, bytes(6))
    assert not tile.here.any()
    sender.say(tile.id, 1, 0, (65_536, 65_538, 3, 1), 0, 3, bytes(6))  # its last row
    assert tile.here.tolist() == [[False] * 3, [False] * 3, [True] * 3]


@settings(max_examples=examples(30))
@given(
    rectangle=st.tuples(*[st.integers(-5, 12)] * 2, *[st.integers(0, 12)] * 2),
    first=st.integers(0, 60),
    count=st.integers(1, 60),
    layer=st.integers(0, 3),
    tile_id=st.integers(0, 3),
)
def test_pieces_of_other_questions_never_put_a_value_at_a_wrong_place(
    rectangle: tuple[int, int, int, int], first: int, count: int, layer: int, tile_id: int
) -> None:
    sender = Sender()
    tile = sender.receiver.ask_tile("height", 0, 0, 6, 6)
    sender.receiver.poll(1.0)
    i, j, width, _ = rectangle
    cells = range(first, first + count)
    raws = [sender.raw(1, i + k % max(width, 1), j + k // max(width, 1)) for k in cells]
    sender.say(tile_id, layer, 0, rectangle, first, count, struct.pack(f"<{count}h", *raws))
    meant = sender.meant(1, (0, 0), tile)
    np.testing.assert_allclose(tile.values[tile.here], meant[tile.here], rtol=1e-6)
    assert np.isnan(tile.values[~tile.here]).all()


@pytest.mark.parametrize(
    ("width", "height"), [(0, 5), (5, 0), (402, 401), (-3, 3), (70_000, 1), (1, 40_000)]
)
def test_no_cells_or_too_many_are_not_even_asked_for(width: int, height: int) -> None:
    with pytest.raises(ValueError, match=f"has width {width} and height {height}"):
        Receiver(NONCE).ask_tile("class", 0, 0, width, height)
    with pytest.raises(ValueError, match="'colour'"):
        Receiver(NONCE).ask_tile("colour", 0, 0, 5, 5)
