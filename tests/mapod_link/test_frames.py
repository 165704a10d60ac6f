"""Bytes of the public receiver's frames: every vector both ways, COBS, checksums, operations.

Source: planner link, sections 2, 3, 13 and 14, items 1 and 3.
"""

import math
import struct
import zlib
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapod_link import asking
from mapod_link.asking import Upright
from mapod_link.bodies import KEEP, UNKNOWN, maybe_runs, maybe_stop_zone
from mapod_link.frames import (
    AUTH,
    CRC_START,
    bytes_from_frame,
    frame_from_bytes,
    signed_bytes_from_frame,
    tag_is_right,
)
from mapod_link.receiver import Receiver
from mapod_link.scans import maybe_scan_piece
from mapod_link.serial_line import (
    Deframer,
    cobs_from_bytes,
    maybe_bytes_from_cobs,
    serial_from_frame,
)
from mapod_link.tiles import maybe_tile_piece
from tests.support.link.planner_sender import NONCE, SESSION, VECTORS, op, vector

FRAMES = sorted(name.removesuffix("_serial") for name in VECTORS if name.endswith("_serial"))
SIGNED = sorted(name for name in VECTORS if name.endswith("_auth"))


def body_of(name: str) -> bytes:
    frame = frame_from_bytes(vector(name))
    assert not isinstance(frame, str)
    return frame.body


# Vectors


@pytest.mark.parametrize("name", FRAMES)
def test_serial_form_and_checksum_hold_both_ways(name: str) -> None:
    plain, serial = vector(name), vector(f"{name}_serial")
    assert serial_from_frame(plain) == serial
    assert Deframer().feed(serial) == [plain]
    frame = frame_from_bytes(plain)
    assert not isinstance(frame, str)
    assert frame.size == len(plain)
    assert bytes_from_frame(frame.type, frame.seq, frame.t_ms, frame.body, frame.flags) == plain


@pytest.mark.parametrize("name", SIGNED)
def test_authenticated_vectors_hold_both_ways(name: str) -> None:
    key, frame = vector("auth_key"), frame_from_bytes(vector(name))
    assert not isinstance(frame, str)
    assert tag_is_right(frame, key, SESSION, NONCE)
    assert not tag_is_right(frame, key, SESSION, NONCE ^ 1)
    assert not tag_is_right(frame, key, SESSION ^ 1, NONCE)
    assert not tag_is_right(frame, key[::-1], SESSION, NONCE)
    if frame.flags == AUTH:
        made = signed_bytes_from_frame(
            frame.type, frame.seq, frame.t_ms, frame.body, key, SESSION, NONCE
        )
        assert made == vector(name)


def test_hello_and_questions_are_made_as_in_the_vectors() -> None:
    assert asking.hello_body(NONCE, 10_201) == body_of("hello")
    assert asking.hello_body(NONCE, 10_201, 128, poll=True) == body_of("hello_poll")
    tile = asking.ask_body(0x102, asking.ASK_TILE, 1, (236, -40), (3, 5))
    assert tile == body_of("ask_tile")
    in_window = asking.ASK_TILE | asking.IN_WINDOW
    assert asking.ask_body(0x104, in_window, 0, (40, 60), (3, 5)) == body_of("ask_window")
    assert asking.ask_body(0x105, asking.ASK_SCAN) == body_of("ask_scan")


def test_the_stop_zone_of_the_vectors_is_read_in_metres() -> None:
    zone = maybe_stop_zone(body_of("stop_zone"), 1040, 7.0)
    assert zone is not None
    assert (zone.free_ahead_m, zone.obstacle_ahead_m, zone.free_behind_m) == (1.25, 1.48, 0.0)
    assert (zone.obstacle_behind_m, zone.contact_s) == (float("inf"), 1.92)
    assert (zone.allowed_ahead_mps, zone.allowed_behind_mps) == (0.65, 0.0)
    assert (zone.nearest_m, zone.bearing_rad, zone.state, zone.causes) == (0.43, -0.7854, 2, 3)
    assert zone.describe() == "slow: an obstacle, ground not seen"
    assert (zone.t_ms, zone.arrived_s) == (1040, 7.0)
    assert maybe_stop_zone(body_of("stop_zone") + b"\0", 0, 0.0) is None


NOT = None  # not known
TILES: dict[str, tuple[int, int, Sequence[float | None]]] = {  # layer, first cell, values
    "tile_class": (0, 0, [2, 2, 2, 0, 0] * 2 + [1] * 5),
    "tile_height": (1, 0, [
        0.152, 0.149, 0.151, NOT, NOT, 0.04, 0.148, 0.15, NOT, NOT, 0.003, -0.002, 0, 0.001, -0.004
    ]),
    "tile_variance": (2, 5, [4e-4, 25e-6, 3e-5, NOT, NOT, 9e-6, 9e-6, 9e-6, 1e-5, 0.065534]),
    "tile_slope": (3, 0, [0.7854, 0.785, 0.786, NOT, NOT]),
    "tile_cause": (4, 0, [128, 128, 130, 1, 8, 128, 131, 129, 1, 6, 64, 64, 66, 67, 64]),
    "tile_age": (5, 5, [0.1, 0.1, 12.5, NOT, 3.0, 0.0, 0.1, 0.2, 0.3, 6553.4]),
    "tile_z": (6, 0, [0.31, 0.305, -1.2, NOT, NOT]),
    "tile_edge": (7, 5, [0.05, 0.05, 0.05, NOT, NOT, 0.071, 0.05, 0.05, 0.071, 0.112]),
    "tile_foothold": (8, 0, [1.0, 0.7512, 0.0, NOT, NOT]),
}  # fmt: skip


@pytest.mark.parametrize("name", TILES)
def test_the_tiles_of_the_vectors_are_read(name: str) -> None:
    layer, first, values = TILES[name]
    piece = maybe_tile_piece(body_of(name))
    assert piece is not None
    assert (piece.id, piece.layer, piece.status) == (0x102, layer, 0)
    assert piece[3:10] == (236, -40, 5, 3, first, 7, 0.05)
    assert piece.is_last == (first + len(values) == 15)
    told = np.array([np.nan if value is NOT else value for value in values], np.float32)
    np.testing.assert_allclose(piece.values, told, rtol=1e-6)


def test_the_objects_and_the_path_of_the_vectors_are_read() -> None:
    receiver = Receiver(1)
    receiver.feed_datagram(1.0, vector("geom"))
    for name in ("objects", "objects_range", "path"):
        assert receiver.feed_datagram(1.12, vector(name))
        if name == "objects":
            gap = receiver.vectors.objects_state(1.12)
            assert gap == ("suspect", "1 objects are still to be told")
    vectors = receiver.vectors
    assert vectors.objects_state(1.2) == ("known", "")
    person, table = (vectors.objects.by_id[number] for number in (258, 3))
    assert (person.moves, person.velocity_mps, person.top_m) == (True, (0.6, -0.25), 1.74)
    np.testing.assert_allclose(person.outline_m, [(14.2, -1.4), (14.5, -1.4), (14.35, -1.0)])
    ages = [vectors.objects.age_s(one, 1.12) for one in (person, table)]
    assert ages == pytest.approx([0.08, 1.5])
    assert vectors.path_state(1.2) == ("suspect", "a piece is missing")
    path = vectors.path
    assert (path.number, path.ahead, path.kinds[3], path.segments[3]) == (5, 3, 1, 1)
    np.testing.assert_allclose(path.points_m[2:5], [(12.4, -2.5), (12.9, -2.5), (12.9, -2.8)])
    assert np.isnan(path.points_m[[0, 1, 5, 6, 7, 8]]).all()


def test_the_sweep_of_the_vectors_is_read() -> None:
    first, end = maybe_scan_piece(body_of("scan")), maybe_scan_piece(body_of("scan_end"))
    assert first is not None
    assert end is not None
    assert first[:6] == (0x105, 0, 5, 0, 541, 1052)
    assert (end.id, end.first, end.t_ms) == (0x105, 3, 1052)
    assert first.lens_m == (12.6, -2.1, 0.45)
    points_m = [[14.6, -1.6, 0.0], [14.61, -1.85, 0.002], [14.1, -2.1, 0.33]]
    np.testing.assert_allclose(first.points_m, points_m, atol=1e-9)
    np.testing.assert_allclose(end.points_m, [[14.09, -2.36, 0.332], [14.63, -2.62, -0.001]])
    none = maybe_scan_piece(body_of("scan_refused"))
    assert none is not None
    assert (none.id, none.status, len(none.points_m)) == (0x106, 1, 0)


# Bodies that contradict themselves


@given(
    status=st.integers(0, 2),
    unit=st.integers(0, 3),
    total=st.integers(0, 6),
    first=st.integers(0, 6),
    data=st.binary(max_size=40),
)
def test_a_piece_of_a_sweep_is_taken_only_if_its_length_and_numbers_agree(
    status: int, unit: int, total: int, first: int, data: bytes
) -> None:
    head = struct.pack("<HBBHHHHIiii", 5, status, unit, total, first, 9, 0, 1, 0, 0, 0)
    points, rest = divmod(len(data), 6)
    fits = not rest and first + points <= total and (points > 0 or total == 0) and unit > 0
    piece = maybe_scan_piece(head + data)
    assert (piece is not None) == (not data if status else fits)
    if piece is not None:
        assert len(piece.points_m) == points
    assert maybe_scan_piece(head[:-1]) is None


@given(
    layer=st.integers(0, 10),
    size=st.tuples(st.integers(0, 40), st.integers(0, 40)),
    first=st.integers(0, 2000),
    count=st.integers(0, 170),
    extra=st.integers(-2, 2),
    junk=st.binary(min_size=342, max_size=342),
)
def test_a_tile_is_taken_only_if_length_count_and_rectangle_agree(
    layer: int, size: tuple[int, int], first: int, count: int, extra: int, junk: bytes
) -> None:
    right = {0: -(-count // 4), 4: count}.get(layer, 2 * count)
    data = junk[: max(right + extra, 0)]
    body = struct.pack("<HBBhhHH", 5, layer, 0, 0, 0, *size) + first.to_bytes(3, "little")
    piece = maybe_tile_piece(body + struct.pack("<BHH", 7, count, 50) + data)
    fits = len(data) == right and 0 < count <= size[0] * size[1] - first
    if layer <= 8:
        assert (piece is not None) is fits
    if piece is not None and layer == 0:
        assert set(piece.values.tolist()) <= {0.0, 1.0, 2.0}


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (bytes(7), "length"),
        (bytes(365), "length"),
        (b"\x20" + bytes(7), "version"),
        (b"\x11\x20" + bytes(6), "flags"),
        (b"\x11\x10" + bytes(13), "length"),
    ],
)
def test_what_is_no_frame_is_refused_with_a_reason(content: bytes, reason: str) -> None:
    crc = zlib.crc32(content, CRC_START)
    assert frame_from_bytes(content + struct.pack("<I", crc)) == reason
    if 8 <= len(content) <= 364:
        assert frame_from_bytes(content + struct.pack("<I", crc ^ 1)) == "crc"


@pytest.mark.parametrize(
    "numbers",
    [
        (float("nan"), 0.0, 0.1), (0.0, float("inf"), 0.1), (32.768, 0.0, 0.1),
        (0.0, -32.768, 0.1), (0.0, 0.0, 1.001), (0.0, 0.0, -0.1), (1e307, 0.0, 0.1),
    ],
)  # fmt: skip
def test_a_request_that_no_frame_tells_is_refused(numbers: tuple[float, float, float]) -> None:
    with pytest.raises(ValueError, match="no DRIVE frame"):
        asking.drive_body(1, 2, *numbers)


@pytest.mark.parametrize(
    "changes",
    [
        {"x_m": float("nan")}, {"y_m": 3e6}, {"sigma_x_m": 0.0}, {"sigma_y_m": 66.0},
        {"sigma_yaw_rad": 0.0}, {"correlation": 1.1}, {"age_s": 1.1}, {"yaw_rad": float("inf")},
        {"upright": Upright(math.nan, 0.1)}, {"upright": Upright(3e6, 0.1)},
        {"x_m": 1e306}, {"yaw_rad": 1e306}, {"upright": Upright(1e306, 0.1)},
        {"upright": Upright(1.0, 0.0)}, {"upright": Upright(1.0, 0.1, (0.0, 0.0), 0.0)},
    ],
)  # fmt: skip
def test_an_external_pose_that_no_frame_tells_is_refused(changes: dict[str, Any]) -> None:
    good: dict[str, Any] = {
        "x_m": 1.0,
        "y_m": 2.0,
        "yaw_rad": 3.0,
        "sigma_x_m": 0.1,
        "sigma_y_m": 0.1,
    }
    asking.external_body(1, 2, **good, sigma_yaw_rad=0.1)
    with pytest.raises(ValueError, match="must"):
        asking.external_body(1, 2, **{**good, "sigma_yaw_rad": 0.1, **changes})


@given(st.floats(-100, 100))
def test_the_yaw_of_an_external_pose_may_have_any_number_of_turns(yaw_rad: float) -> None:
    sigmas: dict[str, Any] = {"sigma_x_m": 0.1, "sigma_y_m": 0.1, "sigma_yaw_rad": 0.1}
    body = asking.external_body(1, 2, 0.0, 0.0, yaw_rad, **sigmas)
    told_rad = asking.EXTERNAL_BODY.unpack(body)[4] / 10_000
    assert -3.1416 <= told_rad <= 3.1415
    assert abs(np.exp(1j * told_rad) - np.exp(1j * yaw_rad)) < 2e-4


# Operations, COBS


A_RUN = st.tuples(st.integers(UNKNOWN, KEEP), st.integers(1, 400))


@given(st.lists(A_RUN, max_size=20), st.integers(0, 3000))
def test_operations_are_walked_as_written(runs: list[tuple[int, int]], start: int) -> None:
    ops, end = b"".join(op(*run) for run in runs), start + sum(length for _, length in runs)
    walked = maybe_runs(ops, start, end)
    assert walked is not None
    assert [(state, after - first) for state, first, after in walked] == runs
    assert not runs or maybe_runs(ops, start, end - 1) is None


@pytest.mark.parametrize("ops", ["7f", "3f", "7f 80", "7f 80 80 80 00", "bf ff ff 7f"])
def test_a_number_cut_off_or_too_long_is_refused(ops: str) -> None:
    assert maybe_runs(bytes.fromhex(ops), 0, 10_000) is None


@given(st.binary(max_size=700).map(lambda data: data.replace(b"\x07", b"\0")))
def test_cobs_gives_back_what_went_in_and_has_no_zeros(data: bytes) -> None:
    encoded = cobs_from_bytes(data)
    assert 0 not in encoded
    assert maybe_bytes_from_cobs(encoded) == data


@pytest.mark.parametrize("encoded", ["02 00", "00", "03 01", "01 00 01", "ff 01"])
def test_what_is_no_cobs_is_refused(encoded: str) -> None:
    assert maybe_bytes_from_cobs(bytes.fromhex(encoded)) is None
