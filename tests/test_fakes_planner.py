"""The planner's end of the link: the sheet's example, a slow model of the map, damage.

Source: planner link, sections 13 and 14, items 1 to 4.
"""

import random
import struct
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fakes.planner import FakePlanner
from fakes.planner_frames import (
    ACK,
    AUTH,
    FREE,
    GEOM,
    KEEP,
    MAP,
    OBSTACLE,
    POSE,
    UNKNOWN,
    Deframer,
    bytes_from_frame,
    cobs_from_bytes,
    crc32,
    frame_from_bytes,
    int16,
    maybe_bytes_from_cobs,
    maybe_runs,
    serial_from_frame,
    tag_of,
)
from tests.planner_sender import (
    SESSION,
    VECTORS,
    Line,
    begun,
    geom_body,
    map_body,
    op,
    pose_body,
    vector,
)

# The sheet's example


def planner_of_the_example() -> FakePlanner:
    planner = FakePlanner()
    for name in ("geom", "pose", "map"):
        planner.feed_datagram(52.3087, vector(name))
    return planner


def test_the_example_frames_are_read_as_the_sheet_says() -> None:
    planner = planner_of_the_example()
    assert planner.geom is not None
    assert (planner.geom.width, planner.geom.cell_m, planner.geom.stale_s) == (101, 0.05, 0.15)
    assert planner.geom.session == SESSION
    assert planner.origin == (196, -100)
    pose = planner.pose
    assert pose is not None
    assert (pose.x_m, pose.y_m, pose.v_mps, pose.w_radps) == (12.34, -2.5, 0.65, -0.12)
    assert (pose.yaw_rad, pose.pitch_rad, pose.roll_rad) == (0.7854, -0.0052, 0.0017)
    assert (pose.health, pose.mode, pose.t_ms) == (0x7F, 1, 1020)
    assert (pose.age_scan_s, pose.age_ahrs_s, pose.age_enc_s) == (0.012, 0.004, 0.008)
    assert not planner.rejected


def test_the_example_ends_in_the_cells_and_the_digest_of_the_sheet() -> None:
    planner = planner_of_the_example()
    expected = np.zeros((101, 101), np.uint8)
    expected[60:62, 40:43] = OBSTACLE
    expected[62, 40:] = FREE
    expected[63, :9] = FREE
    np.testing.assert_array_equal(planner.window(), expected)
    assert planner.cell(40, 61) == OBSTACLE
    assert planner.cell(9, 63) == planner.cell(-1, 0) == planner.cell(0, 101) == UNKNOWN
    assert planner.digest() == int(VECTORS["digest_crc"], 16)


def test_the_acknowledgement_is_that_of_the_sheet() -> None:
    planner = planner_of_the_example()
    planner.gap = 3  # set here only to show the bit, as in the sheet
    [ack] = planner.poll(52.31)
    assert ack == vector("ack")


@pytest.mark.parametrize("name", ["geom", "pose", "map", "ack"])
def test_serial_form_and_crc_hold_both_ways(name: str) -> None:
    plain, serial = vector(name), vector(f"{name}_serial")
    assert serial_from_frame(plain) == serial
    assert Deframer().feed(serial) == [plain]
    frame = frame_from_bytes(plain)
    assert not isinstance(frame, str)
    assert bytes_from_frame(frame.type, frame.seq, frame.t_ms, frame.body, frame.flags) == plain


def test_the_running_value_of_the_sheet_is_the_hashed_constant() -> None:
    assert crc32(b"MPL1") == 0x2994717F


@pytest.mark.parametrize("right", [True, False])
def test_the_authenticated_frame_of_the_sheet_is_taken_with_its_key_alone(right: bool) -> None:
    key = vector("auth_key") if right else bytes(32)
    planner = keyed(key, int(VECTORS["auth_nonce"], 16))
    planner.feed_datagram(0.0, vector("map_auth"))
    assert (planner.cell(40, 60) == OBSTACLE) is right
    assert planner.auth_failed is not right
    assert planner.rejected["tag"] == (not right)
    planner.feed_datagram(0.0, vector("pose"))
    assert planner.auth_failed
    assert planner.pose is None


def signed_frame(
    key: bytes, nonce: int, kind: int, seq: int, t_ms: int, body: bytes, session: int = SESSION
) -> bytes:
    signed = struct.pack("<BBHI", 0x10 | kind, AUTH, seq, t_ms) + body
    return bytes_from_frame(kind, seq, t_ms, body, AUTH, tag_of(signed, key, session, nonce))


def keyed(key: bytes, nonce: int) -> FakePlanner:
    """A planner that asks for tags and has adopted the example's geometry."""
    planner = FakePlanner(key=key)
    planner.nonce = nonce
    body = geom_body(width=101, height=101)
    planner.feed_datagram(0.0, signed_frame(key, nonce, GEOM, 1, 1000, body))
    return planner


def test_what_was_sent_before_cannot_be_played_to_a_planner_with_a_key() -> None:
    key, nonce = bytes(range(32)), 5
    planner = keyed(key, nonce)
    old = signed_frame(key, nonce, GEOM, 1, 1000, geom_body(width=101, height=101))
    planner.feed_datagram(0.0, signed_frame(key, nonce, POSE, 2, 1020, pose_body()))
    planner.feed_datagram(0.1, signed_frame(key, nonce, POSE, 3, 1010, pose_body(mode=2)))
    assert planner.pose is not None
    assert planner.pose.mode == 1
    new = signed_frame(key, nonce, GEOM, 1, 7, geom_body(session=2), session=2)
    planner.feed_datagram(0.2, new)
    planner.feed_datagram(0.3, old)
    assert planner.geom is not None
    assert planner.geom.session == 2
    assert planner.rejected == {"tag": 1}


def test_a_planner_with_a_key_signs_its_acknowledgements() -> None:
    key = bytes(range(32))
    planner = keyed(key, 5)
    [data] = planner.poll(0.1)
    ack = frame_from_bytes(data)
    assert not isinstance(ack, str)
    assert (ack.type, ack.flags) == (ACK, AUTH)
    assert ack.tag == tag_of(ack.signed, key, SESSION, 5)


# The map


def a_run() -> st.SearchStrategy[tuple[int, int]]:
    return st.tuples(st.integers(UNKNOWN, KEEP), st.integers(1, 400))


@st.composite
def drives(draw: st.DrawFn) -> tuple[int, int, list[tuple[int, int, int, list[tuple[int, int]]]]]:
    """Width, height and MAP frames: origin, start and runs that fit; origins walk and jump."""
    width, height = draw(st.integers(3, 60)), draw(st.integers(3, 60))
    ox, oy = draw(st.sampled_from([0, 32_760, -32_768])), draw(st.sampled_from([0, 32_767, -5]))
    frames = []
    for _ in range(draw(st.integers(1, 12))):
        ox += draw(st.integers(-width - 1, width + 1))
        oy += draw(st.integers(-3, 3))
        start = left = draw(st.integers(0, width * height - 1))
        runs = []
        for state, length in draw(st.lists(a_run(), max_size=8)):
            length = min(length, width * height - left)
            if length:
                runs.append((state, length))
            left += length
        frames.append((ox, oy, start, runs))
    return width, height, frames


@given(drives(), st.integers(0, 2**32))
def test_the_map_is_that_of_a_dict_that_saw_the_same_frames(
    drive: tuple[int, int, list[tuple[int, int, int, list[tuple[int, int]]]]], seed: int
) -> None:
    width, height, frames = drive
    line, lost = Line(FakePlanner(), seq=0xFFF8), random.Random(seed)
    line.send(GEOM, geom_body(width=width, height=height))
    model: dict[tuple[int, int], int] = {}
    for ox, oy, start, runs in frames:
        gone = lost.random() < 0.05
        ops = b"".join(op(state, length) for state, length in runs)
        line.send(MAP, map_body(ops, start, ox, oy), lost=gone)
        if gone:
            continue
        model = {
            (i, j): state
            for (i, j), state in model.items()
            if ox <= i < ox + width and oy <= j < oy + height
        }
        at = start
        for state, length in runs:
            for cell in range(at, at + length):
                if state != KEEP:
                    model[ox + cell % width, oy + cell // width] = state
            at += length
        seen = [[model.get((ox + c, oy + r), 0) for c in range(width)] for r in range(height)]
        np.testing.assert_array_equal(line.planner.window(), seen)
        origin = line.planner.origin
        assert origin is not None
        assert (int16(origin[0] - ox), int16(origin[1] - oy)) == (0, 0)
    assert not line.planner.rejected


@given(st.lists(a_run(), max_size=20), st.integers(0, 3000))
def test_operations_are_walked_as_written(runs: list[tuple[int, int]], start: int) -> None:
    ops, end = b"".join(op(*run) for run in runs), start + sum(length for _, length in runs)
    walked = maybe_runs(ops, start, end)
    assert walked is not None
    assert [(state, after - first) for state, first, after in walked] == runs
    assert not runs or maybe_runs(ops, start, end - 1) is None


@pytest.mark.parametrize("ops", ["7f", "3f", "7f 80", "7f 80 80 80 00", "bf ff ff 7f"])
def test_a_number_cut_off_or_too_long_is_refused(ops: str) -> None:
    assert maybe_runs(bytes.fromhex(ops), 0, 10_000) is None


# Damage


def state_of(planner: FakePlanner) -> tuple[object, ...]:
    """All that a rejected frame must leave alone."""
    return (
        planner.geom, planner.pose, planner.origin, planner.gap, planner.window().tobytes(),
        planner.accepted.copy(), planner.ack(9.0)[:12], planner.repeated,
    )  # fmt: skip


def flipped(data: bytes, mask: int) -> bytes:
    return (int.from_bytes(data, "little") ^ mask).to_bytes(len(data), "little")


@pytest.mark.parametrize("name", ["geom", "pose", "map"])
def test_every_error_of_one_bit_is_rejected(name: str) -> None:
    planner, data = FakePlanner(), vector(name)
    before = state_of(planner)
    for bit in range(8 * len(data)):
        planner.feed_datagram(0.0, flipped(data, 1 << bit))
    assert state_of(planner) == before
    assert sum(planner.rejected.values()) == 8 * len(data)


def test_every_error_of_two_bits_in_the_header_and_many_elsewhere_are_rejected() -> None:
    data, chance = vector("map"), random.Random(1)
    pairs = [(a, b) for a in range(64) for b in range(a)]
    bits = range(8 * len(data))
    pairs += [(a, b) for a, b in (chance.sample(bits, 2) for _ in range(3000))]
    assert all(isinstance(frame_from_bytes(flipped(data, 1 << a | 1 << b)), str) for a, b in pairs)


@given(st.integers(1, 2**32 - 1), st.integers(0, 8 * 30 - 32), st.sampled_from(["geom", "map"]))
def test_every_burst_of_up_to_32_bits_is_rejected(burst: int, at: int, name: str) -> None:
    data = vector(name)
    mask = burst << at & (1 << 8 * len(data)) - 1
    assert mask == 0 or isinstance(frame_from_bytes(flipped(data, mask)), str)


@given(st.lists(st.tuples(st.integers(0, 31), st.integers(1, 255)), min_size=1, max_size=6))
def test_damage_on_a_serial_line_never_changes_the_map(damage: list[tuple[int, int]]) -> None:
    planner = FakePlanner()
    planner.feed_stream(0.0, vector("geom_serial") + vector("pose_serial"))
    before, hurt = state_of(planner), bytearray(vector("map_serial"))
    for at, change in damage:
        hurt[at] ^= change
    planner.feed_stream(0.1, bytes(hurt))
    if bytes(hurt) != vector("map_serial"):
        assert state_of(planner) == before
    planner.feed_stream(0.2, b"\0" + vector("map_serial"))
    assert planner.cell(40, 60) == OBSTACLE


@given(st.lists(st.binary(max_size=400)))
def test_no_bytes_make_the_planner_raise(pieces: list[bytes]) -> None:
    planner = FakePlanner()
    before = state_of(planner)
    for now_s, piece in enumerate(pieces):
        planner.feed_datagram(float(now_s), piece)
        planner.exchange(float(now_s), piece)
    assert state_of(planner) == before


@given(st.integers(0, 15), st.integers(0, 255), st.binary(max_size=356), st.booleans())
def test_a_frame_with_an_arbitrary_body_acts_whole_or_not_at_all(
    kind: int, flags: int, body: bytes, right_geometry: bool
) -> None:
    planner = begun().planner
    if right_geometry and kind == MAP:
        body = body[:6] + b"\x07" + body[7:]
    before, accepted = state_of(planner), planner.accepted.total()
    planner.feed_datagram(1.0, bytes_from_frame(kind, 9, 1, body, flags))
    if planner.accepted.total() == accepted:
        assert state_of(planner) == before
    planner.poll(1.0)


@given(st.lists(st.integers(0, 120)), st.lists(st.sampled_from([b"", b"\0", b"\0\0"]), min_size=4))
def test_where_the_stream_is_cut_makes_no_difference(cuts: list[int], idle: list[bytes]) -> None:
    names = ("geom_serial", "pose_serial", "map_serial")
    stream = b"".join(gap + vector(name) for gap, name in zip(idle, names, strict=False))
    edges = [0, *sorted(min(cut, len(stream)) for cut in cuts), len(stream)]
    planner = FakePlanner()
    for a, b in pairwise(edges):
        planner.feed_stream(0.0, stream[a:b])
    assert planner.digest() == int(VECTORS["digest_crc"], 16)
    assert planner.accepted == {GEOM: 1, POSE: 1, MAP: 1}
    assert not planner.rejected


@given(st.binary(max_size=700).map(lambda data: data.replace(b"\x07", b"\0")))
def test_cobs_gives_back_what_went_in_and_has_no_zeros(data: bytes) -> None:
    encoded = cobs_from_bytes(data)
    assert 0 not in encoded
    assert maybe_bytes_from_cobs(encoded) == data


@pytest.mark.parametrize("size", [253, 254, 255, 508])
def test_both_forms_of_a_run_of_254_are_read(size: int) -> None:
    data = bytes(1 + i % 255 for i in range(size))
    assert maybe_bytes_from_cobs(cobs_from_bytes(data)) == data
    if size % 254 == 0:
        assert maybe_bytes_from_cobs(cobs_from_bytes(data) + b"\x01") == data


def test_a_frame_that_never_ends_is_one_rejection_and_holds_no_memory() -> None:
    planner = FakePlanner()
    for _ in range(100):
        planner.feed_stream(0.0, b"\x01" * 1000)
    planner.feed_stream(0.0, b"\0" + vector("geom_serial"))
    assert planner.rejected == {"cobs": 1}
    assert planner.geom is not None
