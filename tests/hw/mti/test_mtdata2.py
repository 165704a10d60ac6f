"""MTData2: every packet of the sheet, recordings of a real device, and split messages."""

import math
import struct
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hw.device import BadFrame
from hw.mti.frames import Mid, MtFrame, MtParser
from hw.mti.mtdata import decode_mtdata2
from hw.mti.sample import MtSample
from hw.mti.stream import Received, SampleMerger
from tests.support.mti_frames import ROWS as FRAMES
from tests.support.mti_frames import euler_deg, framed, slow_number

BAUD = 115200


def frames_of(data: bytes) -> list[MtFrame]:
    return [event for event in MtParser(BAUD).feed(0.0, data) if isinstance(event, MtFrame)]


def test_mtdata2_messages_of_the_sheet() -> None:
    first, second = (
        decode_mtdata2(frames_of(bytes.fromhex(row[2]))[0].data)
        for row in FRAMES
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


Q, RATE = (1.0, 0.0, 0.0, 0.0), (0.1, 0.2, 0.3)


def received(at_s: float, **fields: object) -> Received:
    return Received(MtSample(**fields), MtFrame(0x36, b"", at_s))  # type: ignore[arg-type]


@pytest.mark.parametrize("rate_first", [False, True])
def test_orientation_and_rate_of_one_instant_become_one_sample(rate_first: bool) -> None:
    parts: list[dict[str, object]] = [{"q_earth_sensor": Q}, {"rate_radps": RATE}]
    first, second = parts[::-1] if rate_first else parts
    merger = SampleMerger(0.01)
    assert merger.take(received(1.0, fine_ticks=100, counter=1, **first)) == []
    [whole] = merger.take(received(1.001, fine_ticks=100, counter=2, **second))
    assert (whole.sample.q_earth_sensor, whole.sample.rate_radps) == (Q, RATE)
    assert whole.frame.arrived_s == (1.001 if rate_first else 1.0)  # that of the orientation


def test_an_orientation_waits_for_one_period_at_most_and_goes_without_rate() -> None:
    merger = SampleMerger(0.01)
    assert merger.take(received(1.0, fine_ticks=100, q_earth_sensor=Q)) == []
    assert merger.flush(1.009) == []
    [alone] = merger.flush(1.011)
    assert alone.sample.rate_radps is None
    assert merger.flush(2.0) == []
    merger.take(alone)
    [again] = merger.take(received(1.02, fine_ticks=200, rate_radps=RATE))  # of another instant
    assert (again.sample.fine_ticks, again.sample.rate_radps) == (100, None)


@given(st.lists(st.tuples(st.integers(0, 3), st.booleans(), st.booleans()), max_size=20))
def test_nothing_that_is_put_into_the_merger_is_lost(
    steps: list[tuple[int, bool, bool]],
) -> None:
    merger, out, tick = SampleMerger(0.01), [], 0
    oriented = rated = 0
    for k, (step, with_q, with_rate) in enumerate(steps):
        tick += step
        fields: dict[str, object] = {"fine_ticks": tick}
        fields |= {"q_earth_sensor": Q} if with_q else {}
        fields |= {"rate_radps": RATE} if with_rate else {}
        oriented, rated = oriented + with_q, rated + with_rate
        out += merger.take(received(k * 0.001, **fields))
    out += merger.flush(99.0)
    assert sum(r.sample.q_earth_sensor is not None for r in out) == oriented
    assert sum(r.sample.rate_radps is not None for r in out) == rated
    ticks = [r.sample.fine_ticks or 0 for r in out]
    assert all(a <= b for a, b in pairwise(ticks))
