"""Layers put together from blocks while the window moves, and single cells, asked of a sender."""

import json
import math
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapod_link import tiles as wire
from mapod_link.frames import GEOM, MAP, POSE, bytes_from_frame
from tests.mapod_link.test_tiles import LAYERS, Sender
from tests.support.cases import examples
from tests.support.link.planner_sender import geom_body, map_body, op, pose_body
from tools.view.layers import OFFERED, CellQuestion, Layers, about
from tools.view.window import F32, Window

HEIGHT = 1  # its number on the wire
SIDE = 9


class WithoutSlope(Sender):
    """It knows of no such layer."""

    def answer(self, body: bytes) -> None:
        tile_id, layer = struct.unpack_from("<HxB", body)
        if layer == LAYERS.index("slope"):
            self.say(tile_id, layer, 1, (0, 0, SIDE, SIDE))
        else:
            super().answer(body)


def window(i: int, j: int, epoch: int = 1) -> Window:
    return Window(1.0, epoch, i, j, 0.05, np.zeros((SIDE, SIDE), np.uint8))


def told(pump: Layers, name: str) -> tuple[dict[str, object], F32]:
    layer = pump.maybe_layer(name)
    assert layer is not None
    message = layer.encoded()
    assert layer.encoded() is message  # nothing is new
    kind, _, size = struct.unpack_from("<BBH", message)
    assert kind == 3
    header = json.loads(message[4 : 4 + size])
    return header, np.frombuffer(message[4 + size :], "<f4").reshape(SIDE, SIDE)


def filled(sender: Sender, pump: Layers, at: Window, names: tuple[str, ...], steps: int) -> None:
    for _ in range(steps):
        pump.poll(sender.now_s, at, names)
        sender.step()


@settings(max_examples=examples(20))
@given(moves=st.lists(st.tuples(st.integers(-12, 12), st.integers(-4, 4)), max_size=4))
def test_each_cell_lies_where_it_is_in_the_world(moves: list[tuple[int, int]]) -> None:
    sender, at, names = Sender(), window(500, -20), ("slope", "height")
    pump = Layers(sender.receiver, block_cells=2 * SIDE)
    for i, j in [(0, 0), *moves]:
        at = window(at.i + i, at.j + j)
        filled(sender, pump, at, names, 3)
        values = told(pump, "height")[1]
        for row, column in np.argwhere(np.isfinite(values)):
            raw = sender.raw(HEIGHT, at.i + int(column), at.j + int(row))
            assert values[row, column] == pytest.approx(raw / 1000)
    filled(sender, pump, at, names, 24)
    header, values = told(pump, "height")
    assert (header["i"], header["j"], header["unit"]) == (at.i, at.j, "m")
    cells = [[sender.raw(HEIGHT, at.i + i, at.j + j) for i in range(SIDE)] for j in range(SIDE)]
    unknown = [[raw == -32_768 for raw in row] for row in cells]
    np.testing.assert_array_equal(np.isnan(values), unknown)


def test_every_layer_of_the_wire_but_the_class_is_offered_with_words_and_unit() -> None:
    assert wire.LAYERS[1:] == OFFERED
    offered = {name: about(name) for name in OFFERED}
    assert all(told["label"] and "unit" in told for told in offered.values())
    ranges = {name: told["range"] for name, told in offered.items() if "range" in told}
    assert ranges == {"edge": (0.0, 0.5), "foothold": (0.0, 1.0)}  # as far as they can reach
    assert (offered["edge"]["unit"], offered["foothold"]["unit"]) == ("m", "")


def test_one_block_is_under_way_at_a_time_and_none_that_nobody_wants() -> None:
    sender = Sender()
    pump = Layers(sender.receiver)
    sender.loses = lambda: True
    filled(sender, pump, window(0, 0), ("height", "slope"), 20)
    sender.loses = lambda: False
    filled(sender, pump, window(0, 0), (), 20)
    assert len(sender.asked) <= 1
    assert pump.maybe_layer("height") is None


def test_a_layer_that_the_sender_has_not_is_asked_for_once_and_another_epoch_forgets() -> None:
    sender = WithoutSlope()
    pump = Layers(sender.receiver)
    filled(sender, pump, window(0, 0), ("slope",), 5)
    assert pump.refused == {"slope": "the sender has no such layer"}
    filled(sender, pump, window(0, 0), ("height",), 5)
    assert np.isfinite(told(pump, "height")[1]).any()
    pump.poll(sender.now_s, window(0, 0, epoch=2), ("height",))
    assert not np.isfinite(told(pump, "height")[1]).any()
    assert pump.refused == {}


def test_a_cell_is_told_in_all_layers_or_as_far_as_it_is_known_in_time() -> None:
    sender = Sender()
    told = (
        (GEOM, geom_body(stale_ms=5000)),
        (POSE, pose_body()),
        (MAP, map_body(op(1, 9) + op(2, 2))),
    )
    for seq, (kind, body) in enumerate(told, 2):
        sender.receiver.feed_datagram(1.0, bytes_from_frame(kind, seq, 1000, body))
    sender.seq = 4
    question = CellQuestion(sender.now_s, sender.receiver, 1, 1)
    assert question.maybe_answer(sender.now_s) is None
    for _ in range(3):
        sender.step(0.05)
    answer = question.maybe_answer(sender.now_s)
    assert answer is not None
    assert [answer[name] for name in ("i", "j", "state")] == [1, 1, 2]
    assert [answer["x_m"], answer["y_m"]] == pytest.approx([0.075, 0.075])
    assert answer["height_m"] == pytest.approx(sender.raw(HEIGHT, 1, 1) / 1000)
    assert str(answer["text"]).startswith(f"unknown (cause {sender.raw(4, 1, 1)})")
    sender.loses = lambda: True
    question = CellQuestion(sender.now_s, sender.receiver, 0, 0)
    sender.step(0.5)
    assert question.maybe_answer(sender.now_s) is None
    sender.step(0.6)
    answer = question.maybe_answer(sender.now_s)
    assert answer is not None
    assert answer["state"] == 1
    assert math.isnan(float(str(answer["height_m"])))
    assert answer["text"] == ""
    sender.step(5.0)
    late = CellQuestion(sender.now_s, sender.receiver, 0, 0).maybe_answer(sender.now_s)
    assert late is not None
    assert "not heard" in str(late["text"])
    outside = CellQuestion(sender.now_s, sender.receiver, 65_536, 0).maybe_answer(sender.now_s)
    assert outside is not None
    assert (outside["state"], outside["height_m"], outside["text"]) == (
        0,
        None,
        "outside of the map",
    )
