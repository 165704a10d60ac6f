"""The sender's frames against the worked example of the protocol, byte for byte."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.records import PoseReport
from fakes.wires.wire import MemoryPort
from hw.device import BadFrame
from hw.planner_link.frames import (
    DIGEST,
    GEOM,
    MAP,
    MORE,
    POSE,
    STOP_ZONE,
    TICK_BYTES,
    TILE,
    TILE_HEAD,
    Deframer,
    FrameInput,
    Secret,
    encode_digest,
    encode_frame,
    encode_geom,
    encode_map,
    encode_pose,
    encode_serial,
    encode_stop_zone,
    serial_bytes,
)
from hw.planner_link.messages import (
    ASK_GEOM,
    ASK_POSE,
    ASK_TILE,
    ASK_ZONE,
    IN_WINDOW,
    Ack,
    Ask,
    Drive,
    External,
    Hello,
    decode_answer,
)
from hw.planner_link.tiles import pack_values
from tests.support.planner_line import ZONE
from tests.support.planner_sender import VECTORS, vector

OPS = bytes.fromhex("82 ff22 82 ff22 7f06")
SESSION = 0x5A17C0DE
SECRET = Secret(bytes(range(32)), SESSION, 0x11223344)
EXAMPLE = PoseReport(
    12.34, -2.5, 0.7854, -0.0052, 0.0017, 0.65, -0.12, 0x7F, 0.012, 0.004, 0.008, 1
)


NAN = math.nan
TILES = {  # layer, first cell, values
    "tile_class": (0, 0, [1, 1, 1, NAN, 0, 1, 1, 1, 0, 0, -1, -1, -1, -1, -1]),
    "tile_height": (
        1, 0, [0.152, 0.149, 0.151, NAN, NAN, 0.04, 0.148, 0.15, NAN, NAN, 0.003, -0.002, 0.0,
               0.001, -0.004],
    ),
    "tile_variance": (2, 5, [4e-4, 25e-6, 30e-6, NAN, NAN, 9e-6, 8.7e-6, 9e-6, 1e-5, 0.07]),
    "tile_slope": (3, 0, [0.7854, 0.785, 0.786, NAN, NAN]),
}  # fmt: skip


def tile_body(layer: int, first: int, values: list[float]) -> bytes:
    place = (236, -40, 5, 3, first.to_bytes(3, "little"), 7, len(values), 50)
    packed = pack_values(layer, np.array(values, dtype=np.float32), True)
    return TILE_HEAD.pack(0x0102, layer, 0, *place) + packed


SENT = {  # type, flags, number, time, body
    "geom": (GEOM, 0, 1, 1000, encode_geom(7, 101, 50, SESSION, 0.02, 150)),
    "pose": (POSE, MORE, 2, 1020, encode_pose(EXAMPLE)),
    "map": (MAP, 0, 3, 1020, encode_map((196, -100), 0, 7, 6100, OPS)),
    "digest": (DIGEST, 0, 4, 1040, encode_digest(7, 0x55964B82)),
    "stop_zone": (STOP_ZONE, 0, 5, 1040, encode_stop_zone(ZONE)),
    **{
        name: (TILE, *((MORE, 9) if name == "tile_slope" else (0, 6 + tile[0])), 1060,
               tile_body(*tile))
        for name, tile in TILES.items()
    },
}  # fmt: skip
HEARD = {
    "ack": Ack(1, 52_310, 3, 0b11, 1020, 8, 7),
    "drive": Drive(2, 52_340, SESSION, 0x11223344, 0.65, -0.12, 0.3),
    "external_pose": External(
        3, 52_360, SESSION, 0x11223344, 105.25, -48.9, 1.2345, 0.02, 0.03, -0.25, 0.0175, 0.04
    ),
    "ask_tile": Ask(0x0102, ASK_TILE, 1, 236, -40, 5, 3),
    "ask_now": Ask(0x0103, ASK_GEOM | ASK_POSE | ASK_ZONE, 0, 0, 0, 0, 0),
    "ask_window": Ask(0x0104, ASK_TILE | IN_WINDOW, 0, 40, 60, 5, 3),
}


@pytest.mark.parametrize("name", SENT)
def test_what_is_sent_is_the_example_of_the_protocol(name: str) -> None:
    assert encode_frame(*SENT[name]) == vector(name)
    assert encode_serial(vector(name)) == vector(f"{name}_serial")
    if f"{name}_auth" in VECTORS:
        assert encode_frame(*SENT[name], SECRET) == vector(f"{name}_auth")


@pytest.mark.parametrize("name", HEARD)
def test_the_answers_of_the_example_are_understood_and_with_a_key_only_signed_ones(
    name: str,
) -> None:
    assert decode_answer(vector(name)) == HEARD[name]
    assert Deframer().feed(vector(f"{name}_serial")) == [vector(name)]
    refused = decode_answer(vector(name), SECRET)
    assert isinstance(refused, BadFrame)
    assert refused.reason == "no valid tag"
    if f"{name}_auth" in VECTORS:
        signed = vector(f"{name}_auth")
        assert decode_answer(signed, SECRET) == HEARD[name]
        assert isinstance(decode_answer(signed[:-5] + bytes(5), SECRET), BadFrame)


def test_a_hello_needs_no_tag() -> None:
    assert decode_answer(vector("hello")) == Hello(4, 52_370, 0x11223344, 10_201, 368, False)
    polls = Hello(4, 52_370, 0x11223344, 10_201, 128, True)
    assert decode_answer(vector("hello_poll"), SECRET) == polls


def test_a_pose_beyond_the_fields_is_told_as_the_nearest_that_fits() -> None:
    inf = math.inf
    body = encode_pose(
        PoseReport(1e9, -1e9, -math.pi, 9.0, -9.0, 99.0, float("nan"), 0x1FFFF, inf, -1, 0.0159, 4)
    )
    assert body[:8] == (2**31 - 1).to_bytes(4, "little") + (-(2**31)).to_bytes(
        4, "little", signed=True
    )
    assert int.from_bytes(body[8:10], "little", signed=True) == -31416
    assert int.from_bytes(body[10:12], "little", signed=True) == 32767
    assert int.from_bytes(body[16:18], "little") == 0
    assert body[18:20] == b"\xff\xff"
    assert body[20:24] == bytes([255, 0, 3, 4])


@given(data=st.binary(max_size=500))
def test_no_bytes_make_the_decoder_raise(data: bytes) -> None:
    assert isinstance(decode_answer(data), BadFrame)
    assert isinstance(decode_answer(data, SECRET), BadFrame)


@given(
    frames=st.lists(st.binary(min_size=12, max_size=368), max_size=6),
    cuts=st.lists(st.integers(0, 3000), max_size=8),
)
def test_where_the_serial_stream_is_cut_makes_no_difference(
    frames: list[bytes], cuts: list[int]
) -> None:
    stream = b"\0".join(encode_serial(frame) for frame in frames)  # with empty frames between
    edges = [0, *sorted(min(cut, len(stream)) for cut in cuts), len(stream)]
    deframer = Deframer()
    pieces = [stream[a:b] for a, b in pairwise(edges)]
    assert [found for piece in pieces for found in deframer.feed(piece)] == frames
    assert all(len(encode_serial(frame)) <= serial_bytes(len(frame)) for frame in frames)


def test_a_line_without_a_zero_is_dropped_and_the_next_frame_is_taken() -> None:
    deframer = Deframer()
    found = deframer.feed(b"\x55" * 5000)
    assert [type(event) for event in found] == [BadFrame]
    assert deframer.feed(b"\x55\0" + vector("ack_serial")) == [vector("ack")]


# What a port has read


@pytest.mark.parametrize("datagrams", [True, False])
def test_a_flood_is_taken_in_bounded_portions_and_in_order(datagrams: bool) -> None:
    port, flood = MemoryPort(datagrams), [bytes([k % 250 + 1]) * (13 + k % 300) for k in range(400)]
    source = FrameInput(port)
    for frame in flood:
        port.give(frame if datagrams else encode_serial(frame))
    found: list[bytes | BadFrame] = []
    while portion := source.read():
        assert sum(len(frame) for frame in portion if isinstance(frame, bytes)) <= TICK_BYTES + 368
        found += portion
    assert found == flood


@pytest.mark.parametrize("waits", [b"\x09half of", encode_serial(bytes(range(20))) * 2000])
def test_a_new_connection_begins_with_a_whole_frame_and_nothing_of_the_old_one(
    waits: bytes,
) -> None:
    port = MemoryPort()
    source = FrameInput(port)
    port.give(encode_serial(bytes(range(20))) + waits)
    assert source.read()[0] == bytes(range(20))
    port.connected = False
    port.connected = True
    port.give(encode_serial(bytes(range(1, 21))))
    assert source.read() == [bytes(range(1, 21))]
