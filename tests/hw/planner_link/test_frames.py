"""The sender's frames against the worked example of the protocol, byte for byte."""

import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.records import PoseReport
from hw.device import BadFrame
from hw.planner_link.frames import (
    GEOM,
    MAP,
    MORE,
    POSE,
    Deframer,
    Secret,
    encode_frame,
    encode_geom,
    encode_map,
    encode_pose,
    encode_serial,
    serial_bytes,
)
from hw.planner_link.messages import Ack, decode_answer
from tests.support.planner_sender import vector

OPS = bytes.fromhex("82 ff22 82 ff22 7f06")
SESSION = 0x5A17C0DE
SECRET = Secret(bytes(range(32)), SESSION, 0x11223344)
EXAMPLE = PoseReport(
    12.34, -2.5, 0.7854, -0.0052, 0.0017, 0.65, -0.12, 0x7F, 0.012, 0.004, 0.008, 1
)


def test_the_geometry_of_the_example() -> None:
    frame = encode_frame(GEOM, 0, 1, 1000, encode_geom(7, 101, 50, SESSION, 0.02, 150))
    assert frame == vector("geom")
    assert encode_serial(frame) == vector("geom_serial")


def test_the_pose_of_the_example() -> None:
    frame = encode_frame(POSE, MORE, 2, 1020, encode_pose(EXAMPLE))
    assert frame == vector("pose")
    assert encode_serial(frame) == vector("pose_serial")


def test_the_map_of_the_example_plain_and_authenticated() -> None:
    body = encode_map((196, -100), 0, 7, 6100, OPS)
    assert encode_frame(MAP, 0, 3, 1020, body) == vector("map")
    assert encode_serial(vector("map")) == vector("map_serial")
    assert encode_frame(MAP, 0, 3, 1020, body, SECRET) == vector("map_auth")


def test_the_acknowledgement_of_the_example() -> None:
    ack = decode_answer(vector("ack"))
    assert ack == Ack(1, 52_310, 3, 0b11, 1020, pytest.approx(0.0013), 0, 8, 7)  # type: ignore[arg-type]
    assert Deframer().feed(vector("ack_serial")) == [vector("ack")]


def test_with_a_key_an_unsigned_acknowledgement_is_refused() -> None:
    refused = decode_answer(vector("ack"), SECRET)
    assert isinstance(refused, BadFrame)
    assert refused.reason == "no valid tag"


def test_every_one_bit_error_is_refused() -> None:
    frame = vector("ack")
    for bit in range(8 * len(frame)):
        damaged = bytearray(frame)
        damaged[bit // 8] ^= 1 << bit % 8
        assert isinstance(decode_answer(bytes(damaged)), BadFrame), bit


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
