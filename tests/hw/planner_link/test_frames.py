"""The sender's frames against the worked example of the protocol, byte for byte."""

import math
import struct
import zlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.records import (
    OBJECT_MOVING,
    OBJECT_STATIC,
    ObjectReport,
    PathReport,
    PathSegment,
    PoseReport,
    SweepPoints,
)
from fakes.wires.wire import MemoryPort
from hw.device import BadFrame
from hw.planner_link import frames, messages
from hw.planner_link.answers import pack_points
from hw.planner_link.object_records import AGE, OBJECTS_HEAD, age_ms, gone_record, maybe_record
from hw.planner_link.paths import PathPublisher
from hw.planner_link.scheduler import FrameScheduler
from hw.planner_link.tiles import pack_values
from tests.support.cases import cut
from tests.support.link.planner_line import ZONE
from tests.support.link.planner_sender import VECTORS, vector

OPS = bytes.fromhex("82 ff22 82 ff22 7f06")
SESSION = 0x5A17C0DE
SECRET = frames.Secret(bytes(range(32)), SESSION, 0x11223344)
EXAMPLE = PoseReport(
    12.34, -2.5, 0.7854, -0.0052, 0.0017, 0.65, -0.12, 0x7F, 0.012, 0.004, 0.008, 1
)


NAN = math.nan
TILES: dict[str, tuple[int, int, list[float]]] = {  # layer, first cell, values
    "tile_class": (0, 0, [1, 1, 1, NAN, 0, 1, 1, 1, 0, 0, -1, -1, -1, -1, -1]),
    "tile_height": (
        1, 0, [0.152, 0.149, 0.151, NAN, NAN, 0.04, 0.148, 0.15, NAN, NAN, 0.003, -0.002, 0.0,
               0.001, -0.004],
    ),
    "tile_variance": (2, 5, [4e-4, 25e-6, 30e-6, NAN, NAN, 9e-6, 8.7e-6, 9e-6, 1e-5, 0.07]),
    "tile_slope": (3, 0, [0.7854, 0.785, 0.786, NAN, NAN]),
    "tile_cause": (4, 0, [128, 128, 130, 1, 8, 128, 131, 129, 1, 6, 64, 64, 66, 67, 64]),
    "tile_age": (5, 5, [0.1, 0.04, 12.5, NAN, 3.0, 0.0, 0.1, 0.2, 0.3, 7000.0]),
    "tile_z": (6, 0, [0.31, 0.305, -1.2, NAN, NAN]),
    "tile_edge": (7, 5, [0.05, 0.05, 0.05, NAN, NAN, 0.0707, 0.05, 0.05, 0.0707, 0.1118]),
    "tile_foothold": (8, 0, [1.0, 0.7512, 0.0, NAN, NAN]),
}  # fmt: skip
POINTS_M = [[2.0, 0.5, -0.45], [2.01, 0.25, -0.448], [1.5, 0.0, -0.12], [1.49, -0.26, -0.118],
            [2.03, -0.52, -0.451]]  # fmt: skip
LENS_M = (12.6, -2.1, 0.45)
SWEEP = SweepPoints(1.052, LENS_M, np.array(POINTS_M) + LENS_M, 541)


def tile_body(layer: int, first: int, values: list[float]) -> bytes:
    place = (236, -40, 5, 3, first.to_bytes(3, "little"), 7, len(values), 50)
    packed = pack_values(layer, np.array(values, dtype=np.float32), True)
    return frames.TILE_HEAD.pack(0x0102, layer, 0, *place) + packed


NUMBERS = {  # flags, number and time of tiles that are not the next one
    "tile_slope": (frames.MORE, 9, 1060),
    "tile_cause": (0, 11, 1060),
    "tile_age": (0, 12, 1060),
    "tile_z": (frames.MORE, 13, 1060),
    "tile_edge": (0, 17, 1100),
    "tile_foothold": (frames.MORE, 18, 1100),
}


def scan_body(first: int, end: int) -> bytes:
    unit_mm, packed = pack_points(SWEEP)
    head = frames.encode_scan_head(0x0105, unit_mm, len(POINTS_M), first, SWEEP)
    return head + packed[6 * first : 6 * end]


SENT = {  # type, flags, number, time, body
    "geom": (frames.GEOM, 0, 1, 1000, frames.encode_geom(7, 101, 50, SESSION, 0.02, 150)),
    "pose": (frames.POSE, frames.MORE, 2, 1020, frames.encode_pose(EXAMPLE)),
    "map": (frames.MAP, 0, 3, 1020, frames.encode_map((196, -100), 0, 7, 6100, OPS)),
    "digest": (frames.DIGEST, 0, 4, 1040, frames.encode_digest(7, 0x55964B82)),
    "stop_zone": (frames.STOP_ZONE, 0, 5, 1040, frames.encode_stop_zone(ZONE)),
    **{
        name: (frames.TILE, *NUMBERS.get(name, (0, 6 + tile[0], 1060)), tile_body(*tile))
        for name, tile in TILES.items()
    },
    "scan": (frames.SCAN, frames.MORE, 14, 1080, scan_body(0, 3)),
    "scan_end": (frames.SCAN, 0, 15, 1080, scan_body(3, 5)),
    "scan_refused": (frames.SCAN, 0, 16, 1080, frames.encode_scan_head(0x0106, 0, 0, 0, None)),
}  # fmt: skip
HEARD = {
    "ack": messages.Ack(1, 52_310, 3, 0b11, 1020, 8, 7),
    "drive": messages.Drive(2, 52_340, SESSION, 0x11223344, 0.65, -0.12, 0.3),
    "external_pose": messages.External(
        3, 52_360, SESSION, 0x11223344, 105.25, -48.9, 1.2345, 0.02, 0.03, -0.25, 0.0175, 0.04
    ),
    "external_pose_upright": messages.External(
        9,
        52_420,
        SESSION,
        0x11223344,
        105.25,
        -48.9,
        1.2345,
        0.02,
        0.03,
        -0.25,
        0.0175,
        0.04,
        1.25,
        0.015,
        -0.0052,
        0.0017,
        0.0035,
    ),
    "ask_tile": messages.Ask(5, 52_380, 0x0102, messages.ASK_TILE, 1, 236, -40, 5, 3),
    "ask_now": messages.Ask(
        6, 52_390, 0x0103, messages.ASK_GEOM | messages.ASK_POSE | messages.ASK_ZONE, 0, 0, 0, 0, 0
    ),
    "ask_scan": messages.Ask(8, 52_410, 0x0105, messages.ASK_SCAN, 0, 0, 0, 0, 0),
    "ask_window": messages.Ask(
        7, 52_400, 0x0104, messages.ASK_TILE | messages.IN_WINDOW, 0, 40, 60, 5, 3
    ),
}


@pytest.mark.parametrize("name", SENT)
def test_what_is_sent_is_the_example_of_the_protocol(name: str) -> None:
    assert frames.encode_frame(*SENT[name]) == vector(name)
    assert frames.encode_serial(vector(name)) == vector(f"{name}_serial")
    if f"{name}_auth" in VECTORS:
        assert frames.encode_frame(*SENT[name], SECRET) == vector(f"{name}_auth")


@pytest.mark.parametrize("name", HEARD)
def test_the_answers_of_the_example_are_understood_and_with_a_key_only_signed_ones(
    name: str,
) -> None:
    assert messages.decode_answer(vector(name)) == HEARD[name]
    assert frames.Deframer().feed(vector(f"{name}_serial")) == [vector(name)]
    refused = messages.decode_answer(vector(name), SECRET)
    assert isinstance(refused, BadFrame)
    assert refused.reason == "no valid tag"
    if f"{name}_auth" in VECTORS:
        signed = vector(f"{name}_auth")
        assert messages.decode_answer(signed, SECRET) == HEARD[name]
        assert isinstance(messages.decode_answer(signed[:-5] + bytes(5), SECRET), BadFrame)


def test_a_hello_needs_no_tag() -> None:
    assert messages.decode_answer(vector("hello")) == messages.Hello(
        4, 52_370, 0x11223344, 10_201, 368, False
    )
    polls = messages.Hello(4, 52_370, 0x11223344, 10_201, 128, True)
    assert messages.decode_answer(vector("hello_poll"), SECRET) == polls


def test_a_pose_beyond_the_fields_is_told_as_the_nearest_that_fits() -> None:
    pose = PoseReport(1e9, -1e9, -math.pi, 9.0, -9.0, 99.0, NAN, 0x1FFFF, math.inf, -1, 0.0159, 4)
    x, y, yaw, roll, *_, w, health, s1, s2, s3, mode = struct.unpack(
        "<iihhhhhHBBBB", frames.encode_pose(pose)
    )
    assert (x, y, yaw, roll, w, health) == (2**31 - 1, -(2**31), -31416, 32767, 0, 0xFFFF)
    assert (s1, s2, s3, mode) == (255, 0, 3, 4)


@given(data=st.binary(max_size=500))
def test_no_bytes_make_the_decoder_raise(data: bytes) -> None:
    assert isinstance(messages.decode_answer(data), BadFrame)
    assert isinstance(messages.decode_answer(data, SECRET), BadFrame)


@given(
    sent=st.lists(st.binary(min_size=12, max_size=368), max_size=6),
    cuts=st.lists(st.integers(0, 3000), max_size=8),
)
def test_where_the_serial_stream_is_cut_makes_no_difference(
    sent: list[bytes], cuts: list[int]
) -> None:
    encoded = [frames.encode_serial(frame) for frame in sent]
    deframer = frames.Deframer()
    pieces = cut(b"\0".join(encoded), cuts)  # with empty frames between
    assert [found for piece in pieces for found in deframer.feed(piece)] == sent
    assert all(
        len(line) <= frames.serial_bytes(len(frame))
        for line, frame in zip(encoded, sent, strict=True)
    )


def test_a_line_without_a_zero_is_dropped_and_the_next_frame_is_taken() -> None:
    deframer = frames.Deframer()
    found = deframer.feed(b"\x55" * 5000)
    assert [type(event) for event in found] == [BadFrame]
    assert deframer.feed(b"\x55\0" + vector("ack_serial")) == [vector("ack")]


# What a port has read


@pytest.mark.parametrize("datagrams", [True, False])
def test_a_flood_is_taken_in_bounded_portions_and_in_order(datagrams: bool) -> None:
    port, flood = MemoryPort(datagrams), [bytes([k % 250 + 1]) * (13 + k % 300) for k in range(400)]
    source = frames.FrameInput(port)
    for frame in flood:
        port.give(frame if datagrams else frames.encode_serial(frame))
    found: list[bytes | BadFrame] = []
    while portion := source.read():
        assert (
            sum(len(frame) for frame in portion if isinstance(frame, bytes))
            <= frames.TICK_BYTES + 368
        )
        found += portion
    assert found == flood


@pytest.mark.parametrize("waits", [b"\x09half of", frames.encode_serial(bytes(range(20))) * 2000])
def test_a_new_connection_begins_with_a_whole_frame_and_nothing_of_the_old_one(
    waits: bytes,
) -> None:
    port = MemoryPort()
    source = frames.FrameInput(port)
    port.give(frames.encode_serial(bytes(range(20))) + waits)
    assert source.read()[0] == bytes(range(20))
    port.connected = False
    port.connected = True
    port.give(frames.encode_serial(bytes(range(1, 21))))
    assert source.read() == [bytes(range(1, 21))]


def test_records_of_objects_are_the_example_of_the_protocol() -> None:
    triangle = np.array([(14.2, -1.4), (14.5, -1.4), (14.35, -1.0)])
    box = np.array([(9.6, -3.3), (10.4, -3.3), (10.4, -2.7), (9.6, -2.7)])
    person = ObjectReport(258, OBJECT_MOVING, triangle, 0.0, 1.74, (0.6, -0.25), 0.8, 1.04)
    table = ObjectReport(3, OBJECT_STATIC, box, 0.0, 0.72, (0.0, 0.0), 0.8, -0.38)
    ages = [AGE.pack(age_ms(1.12, seen_s)) for seen_s in (1.04, -0.38)]
    records = [maybe_record(told, 64) or b"" for told in (person, table)]
    told = vector("objects")[8:-4]
    assert told[20:] == ages[0] + records[0] + ages[1] + records[1] + bytes(2) + gone_record(2)
    digest = sum(map(zlib.crc32, records)) % 2**32
    assert told[:20] == OBJECTS_HEAD.pack(7, 2, 1, 80, digest, 1, 0)


def test_pieces_of_the_path_are_the_example_of_the_protocol() -> None:
    port = MemoryPort(datagrams=True)
    scheduler = FrameScheduler(port, None, 0.02, None, 130, 20)
    scheduler.limit(48)  # three points
    scheduler.earn(1.1)
    scheduler.earn(1.12)
    path, place = PathPublisher(scheduler), np.array((12.4, -2.5))
    path.begin_epoch(7)
    way = np.array([(0.0, 0.0), (0.5, 0.0), (0.5, -0.3), *[(0.0, 0.0)] * 4]) + place
    for version in range(1, 6):
        segments = PathSegment(False, way[:2]), PathSegment(True, way)
        path.follow(PathReport(version, segments, 3))
    path.publish(1.12, scheduler.budget.credit)
    scheduler.write(1.12)
    assert port.take_datagrams()[1] == vector("path")
