"""The fake's newer models: MTData2 against the sheet, the recordings and the truth."""

import struct
from collections import Counter
from itertools import pairwise

import numpy as np
import pytest

from tests import VECTORS
from tests.support.devices.bench_mti import (
    ACCEL_MPS2,
    F64,
    RATE_RADPS,
    Bench,
    frames,
    numbers,
    rotated,
    turned,
)
from tests.support.devices.mti_frames import framed, wire

NEWER = ("MTi-30", "MTi-3", "MTi-G-700", "MTi-630")
MEASURED = (0x0810, 0x2010, 0x2020, 0x2030, 0x4020, 0x8020, 0xC020)
HEADERS = (0x1020, 0x1060, 0xE010, 0xE020)
FAST = framed(0x18, b"\x80")


def packets(data: bytes) -> list[tuple[int, bytes]]:
    """(id, data) of an MTData2 message by the packets' own rule."""
    found = []
    while data:
        identifier, size = struct.unpack(">HB", data[:3])
        assert len(data) >= 3 + size
        found.append((identifier, data[3 : 3 + size]))
        data = data[3 + size :]
    return found


def entries(*asked: tuple[int, int]) -> bytes:
    return framed(0xC0, b"".join(struct.pack(">HH", *entry) for entry in asked))


def asked_for(
    bench: Bench, *asked: tuple[int, int], seconds: float = 0.1
) -> list[dict[int, bytes]]:
    """The messages of a configuration as id to data; the line is fast."""
    bench.write(wire("GoToConfig"), 0.2)
    bench.write(FAST)
    bench.fake.baud = 921600
    assert frames(bench.write(entries(*asked), 0.2))[0][0] == 0xC1
    assert bench.write(wire("GoToMeasurement"), 0.002)[2] == 0x11
    return [dict(packets(data)) for mid, data in bench.listen(seconds) if mid == 0x36]


def test_the_message_of_the_sheet_comes_byte_for_byte() -> None:
    bench = Bench(1.5, -2.25, 0.0, model="MTi-30")  # x to north: ENU yaw is 90
    bench.write(wire("GoToConfig"), 0.2)
    assert bench.write(wire("SetOutputConfiguration", 1), 0.1) == wire("OutputConfiguration")
    assert bench.write(wire("ReqOutputConfiguration"), 0.1) == wire("OutputConfiguration")
    bench.write(wire("GoToMeasurement"), 0.015)  # the first has no orientation
    bench.fake.counter, bench.fake.fine_next = 0x1234, 12_345_678
    assert wire("MTData2") in bench.write(b"", 0.02)


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5])
def test_messages_have_the_structures_that_were_recorded(n: int) -> None:
    """Of what the fake can send; a message of the receiver leaves headers alone."""
    recorded = frames((VECTORS / f"mti_rec{n}.bin").read_bytes())
    outputs = struct.iter_unpack(">HH", (VECTORS / f"mti_rec{n}.cfg.bin").read_bytes())
    came = asked_for(Bench(model="MTi-G-700"), *outputs, seconds=2.0)
    ours = {tuple((i, len(content)) for i, content in message.items()) for message in came}
    kinds = Counter(tuple((i, len(c)) for i, c in packets(data)) for _, data in recorded)
    for kind, count in kinds.items():
        known = tuple(packet for packet in kind if packet[0] & 0xFFF0 in (*MEASURED, *HEADERS))
        if count > 1 and any(i & 0xFFF0 in MEASURED for i, _ in known):
            assert known in ours


@pytest.mark.parametrize("number_format", [0, 1, 2, 3])
@pytest.mark.parametrize(
    ("bits", "R_nwu"), [(0, turned(0, 0, 90)), (4, np.diag([1.0, -1.0, -1.0])), (8, np.eye(3))]
)
def test_orientation_is_the_truth_in_each_earth_frame(
    number_format: int, bits: int, R_nwu: F64
) -> None:
    bench = Bench(10.0, -20.0, 30.0, model="MTi-630")
    asked = [kind | bits | number_format for kind in (0x2010, 0x2020, 0x2030)]
    message = asked_for(bench, *((identifier, 100) for identifier in asked))[-1]
    quaternion, matrix, euler_deg = (numbers(message[i], number_format) for i in asked)
    R = R_nwu @ bench.R
    np.testing.assert_allclose(np.array(matrix).reshape(3, 3).T, R, atol=2e-6)
    np.testing.assert_allclose(turned(*euler_deg), R, atol=1e-5)
    np.testing.assert_allclose(rotated(quaternion), R, atol=1e-5)


def test_vectors_and_temperature_are_the_truth_also_in_a_message_of_extended_length() -> None:
    bench = Bench(model="MTi-G-700")
    truths = {0x4023: ACCEL_MPS2, 0x8023: RATE_RADPS, 0xC023: (0.45, -0.10, -0.89), 0x0813: [35.0]}
    asked = (*truths, 0x2013, 0x2023, 0x2027, 0x202B)
    message = asked_for(bench, *((identifier, 100) for identifier in asked))[-2]
    assert sum(len(data) + 3 for data in message.values()) > 255
    for identifier, truth in truths.items():
        np.testing.assert_allclose(numbers(message[identifier], 3), truth, atol=1e-9)


def test_rates_differ_and_packets_are_split_over_messages() -> None:
    bench = Bench(model="MTi-30")
    asked = ((0x1020, 0xFFFF), (0x4020, 200), (0x2010, 50), (0x0810, 0), (0xC020, 400))
    messages = asked_for(bench, *asked, seconds=2.0)
    counts = Counter(identifier for message in messages for identifier in message)
    assert counts[0x1020] == len(messages)
    assert counts[0x4020] == pytest.approx(400, abs=3)
    assert counts[0x2010] == pytest.approx(100, abs=2)
    assert counts[0x0810] == pytest.approx(2, abs=1)
    assert counts[0xC020] == pytest.approx(200, abs=2)  # 100 Hz is its most
    counters = [int.from_bytes(message[0x1020], "big") for message in messages]
    assert {(b - a) % 2**16 for a, b in pairwise(counters)} == {1}


@pytest.mark.parametrize(("model", "wrap"), [("MTi-30", 864_000_000), ("MTi-630", 2**32)])
def test_counter_and_fine_time_wrap(model: str, wrap: int) -> None:
    bench = Bench(model=model)
    asked_for(bench, (0x1020, 0), (0x1060, 0), (0x4020, 100))
    bench.fake.counter, bench.fake.fine_next = 65534, wrap - 150
    messages = [dict(packets(data)) for _, data in bench.listen(0.08)]
    while messages[0][0x1020] != b"\xff\xfe":  # what was sampled before
        messages.pop(0)
    assert [int.from_bytes(m[0x1020], "big") for m in messages][:4] == [65534, 65535, 0, 1]
    fine = [int.from_bytes(m[0x1060], "big") for m in messages][:4]
    assert fine == [wrap - 150, wrap - 50, 50, 150]


def test_a_list_that_the_line_cannot_carry_is_error_29() -> None:
    bench = Bench(model="MTi-30")
    bench.write(wire("GoToConfig"), 0.2)
    before = bench.write(wire("ReqOutputConfiguration"))
    assert bench.write(entries((0x2023, 400), (0x4023, 400))) == framed(0x42, b"\x29")
    assert bench.write(wire("ReqOutputConfiguration")) == before
    bench.write(framed(0x18, b"\x0b"))  # 4800
    assert bench.write(wire("ReqOutputConfiguration")) == before
    bench.fake.baud = 4800  # as from its next power-up on
    assert bench.write(wire("ReqOutputConfiguration"), 0.05) == framed(0x42, b"\x29")


def test_values_are_taken_as_the_device_can() -> None:
    bench = Bench(model="MTi-30")
    bench.write(wire("GoToConfig"), 0.2)
    asked = entries((0x1020, 1), (0x4020, 150), (0x5040, 4), (0xC020, 0xFFFF), (0xE020, 7))
    taken = [(0x1020, 0xFFFF), (0x4020, 100), (0xC020, 100), (0xE020, 0xFFFF)]
    answer = framed(0xC1, b"".join(struct.pack(">HH", *entry) for entry in taken))
    assert bench.write(asked, 0.1) == answer
    assert bench.write(entries(*[(0x4020, 1)] * 33), 0.1) == framed(0x42, b"\x21")
    newest = Bench(model="MTi-630")
    newest.write(wire("GoToConfig"), 0.2)
    assert newest.write(entries((0x5040, 4))) == framed(0x42, b"\x21")


@pytest.mark.parametrize("model", NEWER)
def test_a_newer_model_streams_and_wakes_up_and_knows_new_requests_alone(model: str) -> None:
    bench = Bench(model=model)
    assert {mid for mid, _ in bench.listen(0.2)} == {0x36}
    bench.fake.power_up(bench.now_s)
    assert [mid for mid, _ in bench.listen(1.0)[:4]] == [0x3E, 0x0D, 0x91, 0x36]
    bench.write(wire("GoToConfig"), 0.2)
    for mid in (0xD0, 0xD2, 0xD4, 0x0A, 0x82, 0xE0, 0x55):
        assert bench.write(framed(mid)) == framed(0x42, b"\x04"), hex(mid)
    for mid, size in ((0x00, 8 if model == "MTi-630" else 4), (0x12, 11), (0x1E, 2)):
        assert len(frames(bench.write(framed(mid)))[0][1]) == size
    [(mid, configuration)] = frames(bench.write(framed(0x0C)))
    assert (mid, len(configuration)) == (0x0D, 118)
    assert configuration[102:110] == bytes(8)
    for mid in (0xDA, 0xDC, 0x8E, 0x86):
        assert (bench.write(framed(mid)) == b"") is (model == "MTi-3")
    [(_, profile)] = frames(bench.write(framed(0x64)))
    [(_, profiles)] = frames(bench.write(framed(0x62)))
    assert bytes([profile[1], profile[0]]) in profiles  # (version, type) against (type, version)


def test_a_fourth_generation_device_can_be_switched_to_legacy_data() -> None:
    bench = Bench(model="MTi-30")
    bench.write(wire("GoToConfig"), 0.2)
    assert bench.write(wire("SetOutputConfiguration", 0)) == framed(0xC1, bytes(4))
    assert bench.write(wire("SetOutputMode")) == wire("SetOutputModeAck")
    assert bench.write(wire("SetOutputSettings")) == wire("SetOutputSettingsAck")
    bench.write(wire("GoToMeasurement"), 0.002)
    assert {(mid, len(data)) for mid, data in bench.listen(0.1)} == {(0x32, 50)}
