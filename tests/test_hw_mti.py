"""MT frames and data messages: the sheet's own, recorded ones, and damaged ones."""

import math
import struct
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hw.mti import Mid, MtFrame, MtParser, encode_frame
from hw.mti_data import (
    MtDataDecoder,
    MtSample,
    decode_mtdata2,
    maybe_from_columns,
    maybe_from_euler_deg,
    maybe_unit,
)
from hw.session import BadFrame

BAUD = 115200
FRAMES = [
    line.split("\t")
    for line in (Path(__file__).parent / "vectors/mti_frames.tsv").read_text().splitlines()
    if not line.startswith("#")
]
EULER_FRAME = next(bytes.fromhex(row[2]) for row in FRAMES if row[1] == "MTData 0006 00000005")
DATA_WITH_PREAMBLE = bytes.fromhex("3F80 0000 0000 0000 0000 0000 FAFF")
MIDS = st.integers(0, 255)
JUNK = st.binary(max_size=20).map(lambda junk: junk.replace(b"\xfa", b""))


def frames_of(data: bytes, now_s: float = 0.0) -> list[MtFrame]:
    return [e for e in MtParser(BAUD).feed(now_s, data) if isinstance(e, MtFrame)]


def sample_of(message: str) -> MtSample:
    """The sheet's message, decoded."""
    [row] = [row for row in FRAMES if row[1] == message]
    [frame] = frames_of(bytes.fromhex(row[2]))
    _, mode, settings = message.split()
    sample = MtDataDecoder(int(mode, 16), int(settings, 16)).decode(frame.data)
    assert isinstance(sample, MtSample)
    return sample


def euler_deg(q: tuple[float, float, float, float] | None) -> list[float]:
    """Roll, pitch and yaw by the formulas of section 6."""
    assert q is not None
    w, x, y, z = q
    roll = math.atan2(2 * (y * z + w * x), 2 * w * w + 2 * z * z - 1)
    pitch = -math.asin(2 * x * z - 2 * w * y)
    yaw = math.atan2(2 * (x * y + w * z), 2 * w * w + 2 * x * x - 1)
    return [math.degrees(angle) for angle in (roll, pitch, yaw)]


@pytest.mark.parametrize("row", FRAMES, ids=lambda row: f"{row[1]} {row[3]}")
def test_each_frame_of_the_sheet_is_read_and_written_byte_for_byte(row: list[str]) -> None:
    wire = bytes.fromhex(row[2])
    events = MtParser(BAUD).feed(0.0, wire)
    assert events == [MtFrame(wire[2], wire[4:-1])]
    assert encode_frame(wire[2], wire[4:-1]) == wire
    assert frames_of(wire)[0].wire_bytes == len(wire)


def test_the_extended_length_begins_at_255_bytes() -> None:
    assert encode_frame(0x36, bytes(260)).hex(" ").startswith("fa ff 36 ff 01 04")
    for size in (254, 255, 256, 1320, 2048):
        wire = encode_frame(0x91, bytes(size))
        assert frames_of(wire) == [MtFrame(0x91, bytes(size))]
        assert frames_of(wire)[0].wire_bytes == len(wire)
    with pytest.raises(ValueError, match="2048"):
        encode_frame(0x91, bytes(2049))


def test_a_device_on_bus_id_1_is_heard_and_other_ids_are_not() -> None:
    assert frames_of(bytes.fromhex("FA 01 00 00 FF")) == [MtFrame(0, b"")]
    assert MtParser(BAUD).feed(0.0, bytes.fromhex("FA 02 00 00 FE")) == [
        BadFrame("unknown bus id", bytes.fromhex("FA 02 00 00 FE"))
    ]


@pytest.mark.parametrize("wire", ["FA FF 31 00 D1", "FA FF 42 01 04 BB"])
def test_a_wrong_checksum_is_dropped(wire: str) -> None:
    [event] = MtParser(BAUD).feed(0.0, bytes.fromhex(wire))
    assert event == BadFrame("bad checksum", bytes.fromhex(wire))


def test_an_extended_length_over_2048_is_refused_at_once() -> None:
    [bad, good] = MtParser(BAUD).feed(0.0, bytes.fromhex("FA FF 36 FF 08 01 FA FF 31 00 D0"))
    assert isinstance(bad, BadFrame)
    assert bad.reason == "bad extended length"
    assert good == MtFrame(0x31, b"")


def test_a_preamble_inside_data_does_not_split_its_frame() -> None:
    assert (
        frames_of(encode_frame(0x32, DATA_WITH_PREAMBLE) * 3)
        == [MtFrame(0x32, DATA_WITH_PREAMBLE)] * 3
    )


def test_a_claimed_frame_that_never_completes_is_given_up_in_time() -> None:
    parser = MtParser(BAUD)
    assert parser.feed(0.0, bytes.fromhex("FA FF 32 FE 00 00") + EULER_FRAME) == []
    assert parser.feed(0.1, b"") == []
    [bad, good] = parser.feed(0.13, b"")
    assert isinstance(bad, BadFrame)
    assert bad.reason == "frame not completed in time"
    assert good == MtFrame(0x32, EULER_FRAME[4:-1])


def test_a_frame_that_a_stalled_host_reads_in_two_halves_is_whole() -> None:
    parser = MtParser(BAUD)
    assert parser.feed(0.0, EULER_FRAME[:20]) == []
    [frame] = parser.feed(1.0, EULER_FRAME[20:])
    assert isinstance(frame, MtFrame)


@given(position=st.integers(0, len(EULER_FRAME) - 1), other=st.integers(1, 255))
def test_a_frame_with_any_one_byte_altered_is_rejected(position: int, other: int) -> None:
    wire = bytearray(EULER_FRAME)
    wire[position] ^= other
    parser = MtParser(BAUD)
    events = parser.feed(0.0, bytes(wire)) + parser.feed(1.0, b"\0" * 2100)
    assert not [event for event in events if isinstance(event, MtFrame)]


@given(
    parts=st.lists(st.tuples(JUNK, MIDS, st.binary(max_size=300))),
    cuts=st.lists(st.integers(0, 2000)),
)
def test_frames_survive_junk_and_any_cutting(
    parts: list[tuple[bytes, int, bytes]], cuts: list[int]
) -> None:
    stream = b"".join(junk + encode_frame(mid, data) for junk, mid, data in parts)
    edges = [0, *sorted(min(cut, len(stream)) for cut in cuts), len(stream)]
    parser = MtParser(BAUD)
    events = [event for a, b in pairwise(edges) for event in parser.feed(0.0, stream[a:b])]
    frames = [event for event in events if isinstance(event, MtFrame)]
    assert frames == [MtFrame(mid, data) for _, mid, data in parts]
    skipped = b"".join(event.skipped for event in events if isinstance(event, BadFrame))
    assert skipped == b"".join(junk for junk, _, _ in parts)


@given(junk=st.lists(st.sampled_from([b"\xfa", b"\xff", b"\x32", b"\x36", b"\x00"])).map(b"".join))
def test_any_junk_has_passed_by_the_second_frame_after_its_time_out(junk: bytes) -> None:
    parser = MtParser(BAUD)
    parser.feed(0.0, junk)
    for k in range(30):  # claims within claims, each with its own time
        parser.feed(0.5 * k, b"\0")
    assert parser.feed(20.0, EULER_FRAME)[-1] == MtFrame(0x32, EULER_FRAME[4:-1])


@given(st.lists(st.tuples(st.floats(0.0, 1.0), st.binary(max_size=64))))
def test_no_bytes_make_the_parser_or_the_decoders_raise(pieces: list[tuple[float, bytes]]) -> None:
    parser = MtParser(BAUD)
    for now_s, piece in pieces:
        parser.feed(now_s, b"\xfa\xff\x36" + piece)
        parser.feed(now_s, piece)
        decode_mtdata2(piece)


@given(mode=st.integers(0, 0xFFFF), settings=st.integers(0, 2**32 - 1), data=st.data())
def test_no_data_of_any_mode_and_settings_makes_the_decoder_raise(
    mode: int, settings: int, data: st.DataObject
) -> None:
    decoder = MtDataDecoder(mode, settings)
    given_bytes = data.draw(st.binary(min_size=decoder.size, max_size=decoder.size))
    decoder.decode(given_bytes)
    assert isinstance(decoder.decode(given_bytes + b"\0"), BadFrame)


@pytest.mark.parametrize(
    ("mode", "settings", "size"),
    [
        (0x0004, 0x001, 18),
        (0x0004, 0x005, 14),
        (0x0004, 0x009, 38),
        (0x0002, 0x001, 38),
        (0x0006, 0x005, 50),
        (0x0006, 0x001, 54),
        (0x0006, 0x009, 74),
        (0x0806, 0x005, 51),
        (0x0006, 0x055, 26),
        (0x0007, 0x005, 54),
        (0x0006, 0x105, 50),
        (0x0006, 0x205, 74),
        (0x0006, 0x305, 98),
        (0x4000, 0x001, 22),
        (0x5806, 0x003, 20 + 44 + 1 + 2 + 12),  # raw keeps only GPS, status, counter and UTC
        (0x003E, 0x400, 4 * (9 + 4 + 3 + 3) + 2),
    ],
)
def test_data_lengths_are_those_of_the_sheet(mode: int, settings: int, size: int) -> None:
    assert MtDataDecoder(mode, settings).size == size


def test_calibrated_data_and_euler_angles_of_the_sheet() -> None:
    sample = sample_of("MTData 0006 00000005")
    np.testing.assert_allclose(sample.accel_mps2 or (), [0.12, -0.34, 9.81], rtol=1e-6)
    np.testing.assert_allclose(sample.rate_radps or (), [0.01, -0.02, 0.25], rtol=1e-6)
    np.testing.assert_allclose(sample.magnetic or (), [0.45, -0.10, -0.89], rtol=1e-6)
    np.testing.assert_allclose(euler_deg(sample.q_earth_sensor), [1.5, -2.25, 90.0], rtol=1e-9)
    assert (sample.counter, sample.status) == (4660, None)
    with_status = sample_of("MTData 0806 00000005")
    assert (with_status.counter, with_status.status) == (4661, 3)
    assert with_status.q_earth_sensor == sample.q_earth_sensor


def test_the_other_number_formats_and_the_quaternion_of_the_sheet() -> None:
    for message, counter in (("MTData 0004 00000105", 0x1236), ("MTData 0004 00000205", 0x1237)):
        sample = sample_of(message)
        np.testing.assert_allclose(euler_deg(sample.q_earth_sensor), [1.5, -2.25, 90], rtol=1e-9)
        assert sample.counter == counter
        assert sample.rate_radps is None
    yaw_90 = sample_of("MTData 0004 00000001")
    np.testing.assert_allclose(yaw_90.q_earth_sensor or (), [0.5**0.5, 0, 0, 0.5**0.5], atol=1e-7)
    assert sample_of("MTData 0004 00000005").counter == 64255


@pytest.mark.parametrize(
    ("number_format", "wire", "value"),
    [
        (1, "00180000", 1.5),
        (1, "FFDC0000", -2.25),
        (1, "009CF5C3", 9.81),
        (2, "800000000001", 1.5),
        (2, "C0000000FFFD", -2.25),
        (2, "00000000005A", 90.0),
        (2, "A8F5C28FFFFF", -0.34),
        (3, struct.pack(">d", 9.81).hex(), 9.81),
    ],
)
def test_fixed_point_numbers_of_the_sheet(number_format: int, wire: str, value: float) -> None:
    decoder = MtDataDecoder(0x0001, number_format << 8)
    sample = decoder.decode(bytes.fromhex(wire))
    assert isinstance(sample, MtSample)
    assert sample.temperature_c == pytest.approx(value, abs=1e-6)
    packet = bytes.fromhex("081" + str(number_format)) + bytes([len(wire) // 2])
    assert decode_mtdata2(packet + bytes.fromhex(wire)) == sample


def test_mtdata2_messages_of_the_sheet() -> None:
    first, second = (
        decode_mtdata2(frames_of(bytes.fromhex(row[2]))[0].data)
        for row in FRAMES
        if row[1] == "MTData2"
    )
    assert isinstance(first, MtSample)
    assert isinstance(second, MtSample)
    assert (first.counter, first.fine_ticks, first.status) == (4660, 12345678, 3)
    np.testing.assert_allclose(euler_deg(first.q_earth_sensor), [1.5, -2.25, 90.0], rtol=1e-9)
    np.testing.assert_allclose(first.rate_radps or (), [0.01, -0.02, 0.25], rtol=1e-6)
    assert (second.counter, second.fine_ticks, second.status) == (57285, 4562336, 0x81)
    np.testing.assert_allclose(second.accel_mps2 or (), [-0.430870, 0.830554, 9.795761], atol=1e-6)
    np.testing.assert_allclose(second.rate_radps or (), [-0.005199, 0.004283, -0.003943], atol=1e-6)
    assert second.q_earth_sensor is None


@pytest.mark.parametrize("number", range(1, 6))
def test_every_frame_of_the_recordings_is_read(vectors: Path, number: int) -> None:
    events = MtParser(BAUD).feed(0.0, (vectors / f"mti_rec{number}.bin").read_bytes())
    assert len(events) == 100
    assert all(isinstance(event, MtFrame) and event.mid == Mid.MTData2 for event in events)
    samples = [decode_mtdata2(event.data) for event in events if isinstance(event, MtFrame)]
    good = [sample for sample in samples if isinstance(sample, MtSample)]
    assert len(good) == 100
    counters = [sample.counter or 0 for sample in good]
    assert counters == list(range(counters[0], counters[0] + 100))
    oriented = [sample for sample in good if sample.q_earth_sensor]
    assert len(oriented) >= 90
    ticks = np.diff([sample.fine_ticks or 0 for sample in good])
    assert np.median(ticks) == 100


def test_the_first_values_of_a_recording(vectors: Path) -> None:
    frame = frames_of((vectors / "mti_rec1.bin").read_bytes())[0]
    sample = decode_mtdata2(frame.data)
    assert isinstance(sample, MtSample)
    assert (sample.counter, sample.fine_ticks) == (43398, 51703123)
    np.testing.assert_allclose(
        sample.accel_mps2 or (), [-0.017374, -7.255745, -1.209553], atol=1e-6
    )
    np.testing.assert_allclose(
        sample.rate_radps or (), [-0.0029657, 0.0022035, 0.0017226], atol=1e-7
    )
    assert sample.q_earth_sensor is None


def test_the_recorded_matrix_says_the_same_as_the_quaternion_beside_it(vectors: Path) -> None:
    compared = 0
    for frame in frames_of((vectors / "mti_rec5.bin").read_bytes()):
        packets = {}
        start = 0
        while start < len(frame.data):
            identifier, size = struct.unpack_from(">HB", frame.data, start)
            packets[identifier] = frame.data[start : start + 3 + size]
            start += 3 + size
        if 0x2010 in packets and 0x2020 in packets:
            by_quaternion, by_matrix = (
                decode_mtdata2(packets[identifier]) for identifier in (0x2010, 0x2020)
            )
            assert isinstance(by_quaternion, MtSample)
            assert isinstance(by_matrix, MtSample)
            q, r = np.array(by_quaternion.q_earth_sensor), np.array(by_matrix.q_earth_sensor)
            assert abs(q @ r) == pytest.approx(1.0, abs=1e-6)
            compared += 1
    assert compared > 50


ANGLES = st.tuples(st.floats(-180, 180), st.floats(-89, 89), st.floats(-180, 180))


def rotation(roll: float, pitch: float, yaw: float) -> np.ndarray:
    """Rz(yaw) Ry(pitch) Rx(roll) from degrees, written out."""
    (a, b, c) = np.radians([roll, pitch, yaw])
    rx = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
    ry = np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]])
    rz = np.array([[np.cos(c), -np.sin(c), 0], [np.sin(c), np.cos(c), 0], [0, 0, 1]])
    return np.asarray(rz @ ry @ rx)


def matrix(q: tuple[float, float, float, float] | None) -> np.ndarray:
    """The rotation of a quaternion."""
    assert q is not None
    w, x, y, z = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


@given(ANGLES)
def test_euler_angles_and_matrices_become_the_quaternion_of_their_rotation(
    angles: tuple[float, float, float],
) -> None:
    expected = rotation(*angles)
    np.testing.assert_allclose(matrix(maybe_from_euler_deg(*angles)), expected, atol=1e-12)
    columns = [float(value) for value in expected.T.ravel()]
    np.testing.assert_allclose(matrix(maybe_from_columns(*columns)), expected, atol=1e-12)


@given(ANGLES)
def test_north_east_down_is_turned_z_up(angles: tuple[float, float, float]) -> None:
    z_up_from_z_down = np.diag([1.0, -1.0, -1.0])
    data = struct.pack(">3d", *angles)
    by_mtdata = MtDataDecoder(0x0004, 0x8000_0304).decode(data)
    by_mtdata2 = decode_mtdata2(bytes.fromhex("2037 18") + data)
    assert isinstance(by_mtdata, MtSample)
    assert by_mtdata == by_mtdata2
    expected = z_up_from_z_down @ rotation(*angles)
    np.testing.assert_allclose(matrix(by_mtdata.q_earth_sensor), expected, atol=1e-12)


def test_what_is_no_rotation_is_refused() -> None:
    nan, inf = math.nan, math.inf
    assert maybe_unit(1.0, 0.1, 0.3, 0.0) is None
    assert maybe_unit(nan, 0.0, 0.0, 0.0) is None
    assert maybe_unit(inf, 0.0, 0.0, 0.0) is None
    assert maybe_from_euler_deg(nan, 0.0, 0.0) is None
    assert maybe_from_euler_deg(0.0, 91.0, 0.0) is None
    assert maybe_from_columns(*(1.0, 0, 0, 0, 1.0, 0, 0, 0, -1.0)) is None  # left-handed
    assert maybe_from_columns(*(1e200, 0, 0, 0, 1.0, 0, 0, nan, 1.0)) is None


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e30])
def test_values_that_no_device_measures_make_a_bad_frame(value: float) -> None:
    data = bytearray(EULER_FRAME[4:-1])
    data[12:16] = struct.pack(">f", value)
    assert isinstance(MtDataDecoder(6, 5).decode(bytes(data)), BadFrame)
    assert isinstance(decode_mtdata2(b"\x80\x20\x0c" + bytes(data[12:24])), BadFrame)


@pytest.mark.parametrize("packets", ["1020", "1020 03 1234", "2030 0C 3FC00000", "1020 03 123456"])
def test_packets_that_do_not_fit_make_a_bad_frame(packets: str) -> None:
    assert isinstance(decode_mtdata2(bytes.fromhex(packets)), BadFrame)


def test_unknown_packets_are_stepped_over() -> None:
    sample = decode_mtdata2(bytes.fromhex("ABC0 02 0000 1020 02 1234 7010 00"))
    assert isinstance(sample, MtSample)
    assert sample.counter == 0x1234
