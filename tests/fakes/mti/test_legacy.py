"""The fake's legacy models: all modes and settings, and requests."""

import struct
from collections.abc import Callable
from itertools import pairwise, product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fakes.mti.device import FakeMti, State
from fakes.mti.messages import mtdata, orientation
from fakes.mti.models import MODELS
from tests.support.cases import examples
from tests.support.devices.bench_mti import (
    ACCEL_MPS2,
    RATE_RADPS,
    Bench,
    frames,
    messages,
    numbers,
    rotated,
    turned,
)
from tests.support.devices.mti_frames import framed, wire

MAGNETIC = (0.45, -0.10, -0.89)
MODES = (1, 2, 4, 0x800)


def check_truth(bench: Bench, data: bytes, mode: int, word: int) -> None:
    """Every block of an MTData message against what is true."""
    number_format, kind, expected = word >> 8 & 3, word >> 2 & 3, list[float]()
    if mode & 0x1:
        expected.append(35.0)
    if mode & 0x2:
        for bit, truth in zip((4, 5, 6), (ACCEL_MPS2, RATE_RADPS, MAGNETIC), strict=True):
            expected += () if word >> bit & 1 else truth
    oriented = (4, 3, 9)[kind] if mode & 0x4 else 0
    size = (4, 4, 6, 8)[number_format] * (len(expected) + oriented)
    told = numbers(data[:size], number_format)
    np.testing.assert_allclose(told[: len(expected)], expected, atol=3e-5)
    if oriented:
        R = (np.diag([1.0, -1.0, -1.0]) if word >> 31 else np.eye(3)) @ bench.R
        matrix = (rotated, lambda e: turned(*e), lambda m: np.array(m).reshape(3, 3).T)[kind]
        np.testing.assert_allclose(matrix(told[len(expected) :]), R, atol=3e-5)
    if mode & 0x800:
        assert data[size] & 0x03 == 0x03
    assert len(data) == size + (1 if mode & 0x800 else 0) + (2 if word & 1 else 0)


@pytest.mark.parametrize("kind", [0, 1])
@given(*[st.floats(-179.0, 179.0)] * 3)
def test_quaternion_and_euler_angles_tell_any_rotation(
    kind: int, roll_deg: float, pitch_deg: float, yaw_deg: float
) -> None:
    R = turned(roll_deg, pitch_deg / 2, yaw_deg)
    told = orientation(R, kind)
    np.testing.assert_allclose(turned(*told) if kind else rotated(told), R, atol=1e-9)


@pytest.mark.parametrize("mode_bits", [1, 4, 15])
def test_every_mode_in_all_settings_decodes_back_to_the_truth(mode_bits: int) -> None:
    mode = sum(bit for k, bit in enumerate(MODES) if mode_bits >> k & 1)
    bench = Bench(model="MTi-G")
    bench.fake.baud = 921600
    bench.write(wire("GoToConfig"))
    for counter, kind, off, number_format, ned in product(
        (0, 1), range(3), (0, 1, 2, 5), range(4), (0, 1)
    ):
        word = counter | kind << 2 | off << 4 | number_format << 8 | ned << 31
        bench.fake.memory.mode, bench.fake.memory.settings = mode, word
        data = mtdata(bench.fake.sensor.sample(0.0), mode, word)
        check_truth(bench, data, mode, word)
        assert len(data) == bench.fake.memory.length()


def test_the_mti_g_has_its_own_configuration_and_no_heading_reset() -> None:
    bench = Bench(model="MTi-G")
    bench.write(wire("GoToConfig"))
    [(_, configuration)] = frames(bench.write(wire("ReqConfiguration")))
    assert configuration[110:] == bytes.fromhex("070A 020601 360202")  # as a real one's
    bench.write(wire("GoToMeasurement"), 0.05)
    assert wire("Error", 3) in bench.write(wire("ResetOrientation", 0))


@pytest.mark.parametrize(
    ("mode", "errors", "state"),
    [(0, False, State.MEASURING), (1, False, State.MEASURING), (2, True, State.MEASURING),
     (3, True, State.CONFIG)],
)  # fmt: skip
def test_the_error_mode_says_what_a_full_line_does(mode: int, errors: bool, state: State) -> None:
    bench = Bench()
    bench.configure(framed(0xDA, struct.pack(">H", mode)))
    bench.fake.baud = 9600
    heard = bench.listen(3.0)
    assert ((0x42, b"\x1e") in heard) is errors
    assert bench.fake.state is state
    counted = [int.from_bytes(data[-2:], "big") for data in messages(heard)]
    steps = {b - a for a, b in pairwise(counted)}
    assert (max(steps) > 1) is (mode in (1, 2))  # 3 stops at once


def test_the_byte_de_at_power_up_brings_the_usual_baud_rate_back() -> None:
    bench = Bench()
    bench.configure(framed(0x18, b"\x09"))
    bench.fake.power_up(bench.now_s)
    assert bench.write(b"\xde" * 8, 0.02) == wire("WakeUp")
    assert bench.fake.baud == 115200
    bench.write(wire("WakeUpAck"))
    assert bench.write(wire("ReqBaudrate")) == wire("Baudrate")


def whole(stream: bytes) -> list[bytes]:
    """The data of undamaged messages among anything."""
    parts = [b"\xfa\xff\x32" + part for part in stream.split(b"\xfa\xff\x32")[1:]]
    return [part[4:-1] for part in parts if sum(part[1:]) & 0xFF == 0 and len(part) == part[3] + 5]


@pytest.mark.parametrize("word", [0x001, 0x105, 0x205, 0x309])
def test_fa_ff_occurs_in_data_that_are_nearly_true(word: int) -> None:
    bench = Bench()
    bench.fake.fa_ff = True
    bench.configure(wire("SetOutputMode"), framed(0xD2, struct.pack(">I", word)))
    told = messages(bench.listen(0.1))
    assert len(told) > 5
    for data in told:
        assert b"\xfa\xff" in data
        acceleration = numbers(data[: 3 * (4, 4, 6, 8)[word >> 8 & 3]], word >> 8 & 3)
        np.testing.assert_allclose(acceleration, ACCEL_MPS2, atol=1e-3)


@pytest.mark.parametrize(
    ("fault", "value", "sizes", "counts"),
    [
        ("half_frame", True, {18}, (98, 99)),
        ("length_off", 3, {18, 21}, (99, 101)),
        ("length_off", -3, {18, 15}, (99, 101)),
        ("lost_byte_rate", 0.02, {18}, (43, 80)),
        ("wrong_checksum_rate", 0.5, {18}, (30, 70)),
    ],
)
def test_faults_that_damage_what_it_says(
    fault: str, value: float, sizes: set[int], counts: tuple[int, int]
) -> None:
    bench = Bench()
    bench.listen(0.1)
    setattr(bench.fake, fault, value)
    heard = whole(b"".join(data for _, data in bench.pieces(1.0, 0.001)))
    assert {len(data) for data in heard} <= sizes
    assert counts[0] <= len(heard) <= counts[1]
    assert len(heard[-1]) == 18 + (int(value) if fault == "length_off" else 0)


def test_late_bytes_and_jitter_move_arrivals_and_keep_the_order() -> None:
    def arrivals_s(change: Callable[[FakeMti], None]) -> list[float]:
        bench = Bench()
        change(bench.fake)
        return [when_s for when_s, data in bench.pieces(2.0, 0.0005) for _ in data][22::23]

    plain, late = arrivals_s(lambda f: None), arrivals_s(lambda f: setattr(f, "late_s", 0.03))
    np.testing.assert_allclose(np.array(late) - plain[: len(late)], 0.03, atol=0.0006)
    jittered = arrivals_s(lambda f: setattr(f, "jitter_s", 0.005))
    delays_s = np.array(jittered) - plain[: len(jittered)]
    assert delays_s.min() > -0.0006
    assert 0.003 < delays_s.mean() < 0.009
    assert jittered == sorted(jittered)


@pytest.mark.parametrize(("model", "data"), [("MTi-28", 0x32), ("MTi-30", 0x36)])
def test_an_error_unasked_and_data_before_the_acknowledgement(model: str, data: int) -> None:
    bench = Bench(model=model)
    bench.listen(0.1)
    bench.fake.error_next = 0x1E
    assert (0x42, b"\x1e") in bench.listen(0.05)
    bench.fake.late_data = 3
    mids = [mid for mid, _ in frames(bench.write(wire("GoToConfig"), 0.2))]
    assert mids[-4:] == [data] * 3 + [0x31]


def test_deaf_it_speaks_on_and_another_host_changes_what_it_says() -> None:
    bench = Bench()
    bench.fake.deaf = True
    bench.write(wire("GoToConfig"))
    bench.fake.another_host(0x0002, 0x1)
    bench.write(b"", 0.05)
    assert 38 in {len(data) for data in whole(bench.write(b"", 0.1))}


def test_a_self_test_that_failed_is_told_in_the_status_too() -> None:
    bench = Bench()
    bench.fake.self_test = 0x00F7
    bench.configure(framed(0xD0, b"\x08\0"))
    assert messages(bench.listen(0.1))[0][0] & 1 == 0
    bench.write(wire("GoToConfig"), 0.2)
    assert bench.write(framed(0x24), 1.2) == framed(0x25, b"\0\xf7")


REQUESTS = st.tuples(
    st.sampled_from([*range(0, 256, 2), 0x30, 0x10, 0x40, 0x3F, 0xC0, 0xD0, 0xEC]),
    st.sampled_from([b"", b"\0", b"\0\0", b"\0\4", b"\1\2\3", bytes(4), bytes(12), bytes(17)])
    | st.binary(max_size=24),
    st.sampled_from([0.03, 0.6]),
)


@settings(max_examples=examples(20))
@given(st.sampled_from(list(MODELS)), st.lists(REQUESTS, max_size=12))
def test_any_request_gets_one_answer_or_silence_and_settings_last(
    model: str, requests: list[tuple[int, bytes, float]]
) -> None:
    bench = Bench(model=model)
    bench.write(wire("GoToConfig"), 0.2)
    for mid, data, wait_s in requests:
        if mid == 0x24:  # takes a second, and all answers after it wait
            continue
        before = bench.fake.state
        heard = bench.fake.exchange(bench.now_s, b"") + bench.write(framed(mid, data), wait_s)
        if before is State.CONFIG and mid not in (0x10, 0x3E, 0x40):
            answers = [answered for answered, _ in frames(heard)]
            silent = mid in MODELS[model].silent_mids
            assert answers in ([mid + 1], [0x42]) if not silent else answers == []
    memory = bench.fake.memory
    if bench.fake.state is State.CONFIG:
        kept = memory.configuration()
        bench.fake.power_up(bench.now_s)
        assert bench.listen(1.0)[1] == (0x0D, kept)
        assert bench.fake.memory.configuration() == kept
