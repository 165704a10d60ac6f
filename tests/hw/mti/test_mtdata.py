"""MTData and MTData2: all modes, settings and packets of the sheet, recordings, orientations."""

import math
import struct
from itertools import pairwise, product
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hw.device import BadFrame
from hw.mti.frames import Mid, MtFrame, MtParser
from hw.mti.mtdata import MtDataDecoder, decode_mtdata2
from hw.mti.sample import (
    ENU,
    EULER,
    NED,
    NWU,
    MtSample,
    maybe_from_euler_deg,
    maybe_orientation,
    maybe_unit,
)
from hw.mti.stream import Received, SampleMerger
from tests.support.cases import examples
from tests.support.devices.bench_mti import rotated, turned
from tests.support.devices.mti_frames import ROWS, euler_deg, framed, slow_number

BAUD = 115200


def frames_of(data: bytes) -> list[MtFrame]:
    return [event for event in MtParser(BAUD).feed(0.0, data) if isinstance(event, MtFrame)]


def test_mtdata2_messages_of_the_sheet() -> None:
    first, second = (
        decode_mtdata2(frames_of(bytes.fromhex(row[2]))[0].data)
        for row in ROWS
        if row[1] == "MTData2"
    )
    assert isinstance(first, MtSample)
    assert isinstance(second, MtSample)
    assert (first.counter, first.fine_ticks, first.status) == (4660, 12345678, 3)
    np.testing.assert_allclose(euler_deg(first.q_earth_sensor), [1.5, -2.25, 0.0], atol=1e-9)
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
    assert sum(sample.q_earth_sensor is not None for sample in good) >= 90
    ticks = np.diff([sample.fine_ticks or 0 for sample in good])
    assert np.median(ticks) == 100


NUMBERS = {  # kind: field, values
    0x0810: ("temperature_c", (36.5,)),
    0x4020: ("accel_mps2", (0.5, -0.25, 9.75)),
    0x8020: ("rate_radps", (0.5, -0.25, 0.125)),
    0xC020: ("magnetic", (0.5, -0.25, -0.75)),
}
PACKETS = [  # identifier, payload, field, value
    (0x1020, bytes.fromhex("1234"), "counter", 0x1234),
    (0x1060, bytes.fromhex("00BC614E"), "fine_ticks", 12345678),
    (0xE010, bytes.fromhex("81"), "status", 0x81),
    (0xE020, bytes.fromhex("01800045"), "status", 0x01800045),
    *(
        (
            kind | form,
            b"".join(slow_number(value, form) for value in values),
            field,
            values if len(values) > 1 else values[0],
        )
        for kind, (field, values) in NUMBERS.items()
        for form in range(4)
    ),
]


@pytest.mark.parametrize(("identifier", "payload", "field", "value"), PACKETS)
def test_every_packet_is_read_in_every_format_and_refused_where_it_is_cut(
    identifier: int, payload: bytes, field: str, value: object
) -> None:
    sample = decode_mtdata2(struct.pack(">HB", identifier, len(payload)) + payload)
    assert sample == MtSample(**{field: value})  # type: ignore[arg-type]
    cut = decode_mtdata2(struct.pack(">HB", identifier, len(payload) - 1) + payload[:-1])
    assert isinstance(cut, BadFrame)


def test_a_message_of_extended_length_is_decoded() -> None:
    satellites = struct.pack(">IB3x", 1, 50) + bytes(240)  # stepped over by their length
    packets = struct.pack(">HBH", 0x1020, 2, 7) + struct.pack(">HB", 0x7020, 248) + satellites
    packets += struct.pack(">HB4f", 0x2018, 16, 1, 0, 0, 0)
    assert 255 <= len(packets) <= 2048
    sample = decode_mtdata2(frames_of(framed(0x36, packets))[0].data)
    assert isinstance(sample, MtSample)
    assert (sample.counter, sample.q_earth_sensor) == (7, (1.0, 0.0, 0.0, 0.0))


@given(st.binary(max_size=80))
def test_no_bytes_make_the_decoder_raise(data: bytes) -> None:
    decode_mtdata2(data)
    decode_mtdata2(b"\x20\x10\x10" + data)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e30])
def test_rates_that_no_device_measures_make_a_bad_message(value: float) -> None:
    assert isinstance(decode_mtdata2(struct.pack(">HB3f", 0x8020, 12, 0, value, 0)), BadFrame)


@pytest.mark.parametrize("packets", ["1020", "1020 03 1234", "2030 0C 3FC00000", "1020 03 123456"])
def test_packets_that_do_not_fit_make_a_bad_frame(packets: str) -> None:
    assert isinstance(decode_mtdata2(bytes.fromhex(packets)), BadFrame)


Q, TURNING = (1.0, 0.0, 0.0, 0.0), (0.1, 0.2, 0.3)


def received(at_s: float, **fields: object) -> Received:
    return Received(MtSample(**fields), MtFrame(0x36, b"", at_s))  # type: ignore[arg-type]


@pytest.mark.parametrize("rate_first", [False, True])
def test_orientation_and_rate_of_one_instant_become_one_sample(rate_first: bool) -> None:
    parts: list[dict[str, object]] = [{"q_earth_sensor": Q}, {"rate_radps": TURNING}]
    first, second = parts[::-1] if rate_first else parts
    merger = SampleMerger(0.01)
    assert merger.take(received(1.0, fine_ticks=100, counter=1, **first)) == []
    [whole] = merger.take(received(1.001, fine_ticks=100, counter=2, **second))
    assert (whole.sample.q_earth_sensor, whole.sample.rate_radps) == (Q, TURNING)
    assert whole.frame.arrived_s == (1.001 if rate_first else 1.0)  # that of the orientation


def test_an_orientation_waits_for_one_period_at_most_and_goes_without_rate() -> None:
    merger = SampleMerger(0.01)
    assert merger.take(received(1.0, fine_ticks=100, q_earth_sensor=Q)) == []
    assert merger.flush(1.009) == []
    [alone] = merger.flush(1.011)
    assert alone.sample.rate_radps is None
    assert merger.flush(2.0) == []
    merger.take(alone)
    [again] = merger.take(received(1.02, fine_ticks=200, rate_radps=TURNING))  # of another instant
    assert (again.sample.fine_ticks, again.sample.rate_radps) == (100, None)


@given(st.lists(st.tuples(st.integers(0, 3), st.booleans(), st.booleans()), max_size=20))
def test_nothing_that_is_put_into_the_merger_is_lost(steps: list[tuple[int, bool, bool]]) -> None:
    merger, out, tick = SampleMerger(0.01), [], 0
    oriented = rated = 0
    for k, (step, with_q, with_rate) in enumerate(steps):
        tick += step
        fields: dict[str, object] = {"fine_ticks": tick}
        fields |= {"q_earth_sensor": Q} if with_q else {}
        fields |= {"rate_radps": TURNING} if with_rate else {}
        oriented, rated = oriented + with_q, rated + with_rate
        out += merger.take(received(k * 0.001, **fields))
    out += merger.flush(99.0)
    assert sum(r.sample.q_earth_sensor is not None for r in out) == oriented
    assert sum(r.sample.rate_radps is not None for r in out) == rated
    ticks = [r.sample.fine_ticks or 0 for r in out]
    assert all(a <= b for a, b in pairwise(ticks))


TO_NWU = {  # rows: where the axes of the frame point, in north, west, up
    ENU: np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
    NED: np.diag([1.0, -1.0, -1.0]),
    NWU: np.eye(3),
}


@pytest.mark.parametrize("frame", TO_NWU)
@settings(max_examples=examples(12))
@given(st.tuples(st.floats(-180, 180), st.floats(-89, 89), st.floats(-180, 180)))
def test_every_earth_frame_becomes_north_west_up(
    frame: int, angles: tuple[float, float, float]
) -> None:
    samples = []
    if frame != ENU:  # which no legacy device has
        word = 0x304 | (0x8000_0000 if frame == NED else 0)
        samples.append(MtDataDecoder(0x0004, word).decode(struct.pack(">3d", *angles)))
    for packet, data in (
        (0x2033, struct.pack(">3d", *angles)),
        (0x2013, struct.pack(">4d", *(maybe_from_euler_deg(*angles) or ()))),
    ):
        head = struct.pack(">HB", packet | frame << 2, len(data))
        samples.append(decode_mtdata2(head + data))
    for sample in samples:
        assert isinstance(sample, MtSample)
        expected = TO_NWU[frame] @ turned(*angles)
        np.testing.assert_allclose(rotated(sample.q_earth_sensor or ()), expected, atol=1e-12)


def test_what_is_no_rotation_is_refused() -> None:
    assert maybe_orientation(EULER, (0.0, 0.0, 0.0), 3) is None  # no such earth frame
    assert maybe_unit(1.0, 0.1, 0.3, 0.0) is None
    assert maybe_unit(math.nan, 0.0, 0.0, 0.0) is None
    assert maybe_unit(math.inf, 0.0, 0.0, 0.0) is None
    assert maybe_from_euler_deg(math.nan, 0.0, 0.0) is None
    assert maybe_from_euler_deg(0.0, 91.0, 0.0) is None


MODES = [
    *(
        sum(bits)
        for bits in product((0, 1), (0, 2), (0, 4), (0, 8), (0, 0x30), (0, 0x800), (0, 0x1000))
    ),
    *(0x4000, 0x5000, 0x4800, 0x5806, 0x403F),  # raw
]
SETTINGS = [
    sum(bits)
    for bits in product(
        (0, 1), (0, 2), (0, 4, 8), (0, 0x10), (0, 0x20), (0, 0x40), (0, 0x100, 0x200, 0x300),
        (0, 0x400), (0, 0x800),
    )
]  # fmt: skip
TEMPERATURE, STATUS, COUNTER = 36.5, 3, 4660
ACCEL, RATE, MAGNETIC = (0.12, -0.34, 9.81), (0.01, -0.02, 0.25), (0.45, -0.10, -0.89)
ORIENTATIONS = ((0.5, 0.5, 0.5, 0.5), (90.0, 0.0, 90.0), 9 * (0.5,))  # the last: not read
UTC = bytes.fromhex("00000001 07DA 0102030405 01")


def slow_mtdata(mode: int, settings: int) -> bytes:
    """By the table of section 4, one row after the other."""
    data = bytes(range(20)) if mode & 0x4000 else b""
    data += bytes(44) if mode & 0x1000 else b""
    processed = 0 if mode & 0x4000 else mode
    values = [TEMPERATURE] if processed & 0x0001 else []
    if processed & 0x0002:
        values += [] if settings & 0x10 else ACCEL
        values += [] if settings & 0x20 else RATE
        values += [] if settings & 0x40 else MAGNETIC
    values += ORIENTATIONS[settings >> 2 & 3] if processed & 0x0004 else ()
    data += b"".join(slow_number(value, settings // 256 % 4) for value in values)
    if processed & 0x0008:
        data += b"" if settings & 0x400 else b"\1\2"
        data += b"" if settings & 0x800 else b"\3\4"
    position_velocity = 3 * (bool(processed & 0x0010) + bool(processed & 0x0020))
    data += position_velocity * slow_number(57.6, settings // 256 % 4)
    data += bytes([STATUS]) if mode & 0x0800 else b""
    data += struct.pack(">H", COUNTER) if settings & 1 else b""
    return data + (UTC if settings & 2 else b"")


def sample_of(message: str) -> MtSample:
    [row] = [row for row in ROWS if row[1] == message]
    _, mode, settings = message.split()
    sample = MtDataDecoder(int(mode, 16), int(settings, 16)).decode(bytes.fromhex(row[2])[4:-1])
    assert isinstance(sample, MtSample)
    return sample


def near(value: tuple[float, ...] | None, expected: tuple[float, ...] | None) -> bool:
    """Equal but for a number's format: 12.20 is the coarsest of small, float32 of large ones."""
    if value is None or expected is None:
        return value is expected
    return len(value) == len(expected) and all(
        abs(a - b) <= 1e-6 + 1e-7 * abs(b) for a, b in zip(value, expected, strict=True)
    )


def check(mode: int, settings: int) -> None:
    data, decoder = slow_mtdata(mode, settings), MtDataDecoder(mode, settings)
    assert decoder.size == len(data)
    sample = decoder.decode(data)
    assert isinstance(sample, MtSample), sample
    computed = 0 if mode & 0x4000 else mode
    calibrated, oriented = computed & 2, computed & 4 and not settings & 8
    assert near(sample.accel_mps2, ACCEL if calibrated and not settings & 0x10 else None)
    assert near(sample.rate_radps, RATE if calibrated and not settings & 0x20 else None)
    assert near(sample.magnetic, MAGNETIC if calibrated and not settings & 0x40 else None)
    assert near(sample.q_earth_sensor, ORIENTATIONS[0] if oriented else None)
    assert sample.temperature_c == (TEMPERATURE if computed & 1 else None)
    assert sample.status == (STATUS if mode & 0x800 else None)
    assert sample.counter == (COUNTER if settings & 1 else None)


def test_every_output_mode_is_decoded_with_settings_that_cover_each_switch() -> None:
    """A 13th of the 1536 settings for the modes that they change most; a 61st for the others."""
    for mode in MODES:
        step = 13 if mode in (0x0006, 0x000F, 0x183F) else 61
        for word in SETTINGS[mode % step :: step]:
            check(mode, word)


def test_a_position_that_is_no_number_harms_nothing() -> None:
    sample = MtDataDecoder(0x0030, 1).decode(struct.pack(">6fH", *[math.nan] * 6, 7))
    assert sample == MtSample(counter=7)


@given(mode=st.integers(0, 0xFFFF), settings=st.integers(0, 2**32 - 1), data=st.data())
def test_no_data_of_any_mode_and_settings_makes_the_decoder_raise(
    mode: int, settings: int, data: st.DataObject
) -> None:
    decoder = MtDataDecoder(mode, settings)
    given_bytes = data.draw(st.binary(min_size=decoder.size, max_size=decoder.size))
    decoder.decode(given_bytes)
    assert isinstance(decoder.decode(given_bytes + b"\0"), BadFrame)


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
