"""Each request of the start refused, unanswered, or answered by a WakeUp: what is said and done."""

import struct

import pytest

from tests.support.devices.mti_frames import framed, wire
from tests.support.devices.scripted_mti import (
    CONVERSATION,
    NEW_CONVERSATION,
    NEW_READ,
    NEW_REQUEST,
    Bench,
    Scripted,
)

ASKED = dict.fromkeys(NEW_CONVERSATION, "MTi-30")
ASKED |= dict.fromkeys(CONVERSATION, "MTi-28")  # of either, where both are asked
HARMLESS = {0x1C, 0x12, 0x1E, 0x0C, 0xD4}
every_request = pytest.mark.parametrize(
    ("request_", "model"), ASKED.items(), ids=lambda x: getattr(x, "hex", str)()
)


def error(code: int) -> bytes:
    return framed(0x42, bytes([code]))


def bench_with(model: str, answers: dict[bytes, bytes | None], rate_hz: float = 100) -> Bench:
    bench = Bench(Scripted(model), rate_hz)
    bench.device.answers |= answers
    return bench


@every_request
def test_every_error_to_every_request_is_said_or_done_without(model: str, request_: bytes) -> None:
    for code in (0x04, 0x29):
        bench = bench_with(model, {request_: error(code)})
        bench.run(1.0)
        if request_[2] in HARMLESS:
            assert bench.run_until("running", 2.0), (code, bench.cause())
            assert bench.cause() == ""
        elif bench.state() != "running":
            known = code == 0x04 and request_[2] in (0xC0, 0xD0)  # "not this kind of device"
            assert f"error {code:02X}, " in bench.cause() or known, (code, bench.cause())
        bench.device.answers.clear()
        assert bench.run_until("running", 4.0), (code, bench.cause())


@every_request
def test_silence_to_every_request_is_said_or_done_without(model: str, request_: bytes) -> None:
    bench = bench_with(model, {request_: None})
    bench.run(3.5)
    if request_[2] in HARMLESS:
        assert bench.run_until("running", 1.0), bench.cause()
    else:
        assert bench.state() == "starting"
        assert "answer" in bench.cause() or "knows neither" in bench.cause()
    bench.device.answers.clear()
    assert bench.run_until("running", 6.0), bench.cause()


@every_request
def test_a_brown_out_at_any_point_of_the_start_is_survived(model: str, request_: bytes) -> None:
    bench = Bench(Scripted(model))
    while request_ not in bench.device.heard:
        bench.run(0.005)
    bench.device.brown_out(bench.now_s, forgets=True)
    assert bench.run_until("running", 4.0), bench.cause()
    bench.run(0.1)  # it may have run for a moment when the dip came
    assert bench.run_until("running", 4.0), bench.cause()
    assert bench.device.heard.count(wire("WakeUpAck")) == 1


@pytest.mark.parametrize(
    ("changes", "request_", "state", "cause"),
    [
        ({}, wire("SetOutputMode"), "starting", "0004 and settings 00000005, not 0006 and 00000"),
        ({}, wire("SetOutputSettings"), "starting", "settings 00000001, not 0006 and 00000005"),
        ({"skip": 0xFFFF}, framed(0xD4, b"\0\0"), "starting", "sends only on request"),
        ({"skip": 3}, framed(0xD4, b"\0\0"), "running", "the MTi gives 25.0 samples a second, not"),
        ({"period": 2304}, wire("SetPeriod"), "running", "the MTi gives 50.0 samples a second, no"),
    ],
)
def test_a_setting_that_is_not_kept_is_read_back_and_said(
    changes: dict[str, int], request_: bytes, state: str, cause: str
) -> None:
    bench = bench_with("MTi-28", {request_: framed(request_[2] + 1)})
    for name, value in changes.items():
        setattr(bench.device.memory, name, value)
    bench.run(1.0)
    assert (bench.state(), cause in bench.cause()) == (state, True), bench.cause()
    bench.device.answers.clear()
    bench.reconnect()
    bench.run(1.5)
    assert (bench.state(), bench.cause()) == ("running", "")


@pytest.mark.parametrize("code", [0x03, 0x1E])
def test_a_period_that_the_device_cannot_do_gives_way_to_a_longer_one(code: int) -> None:
    refused = framed(0x04, struct.pack(">H", 115200 // 200))
    bench = bench_with("MTi-28", {refused: error(code)}, rate_hz=200)
    assert bench.run_until("running", 2.0)
    assert bench.device.memory.period == 960  # 120 Hz
    assert bench.cause().startswith(f"the MTi refuses SetPeriod: error {code:02X}")


@pytest.mark.parametrize("code", [0x1E, 0x23, 0x24, 0x29])
def test_a_newer_device_that_finds_the_output_too_much_is_asked_for_less(code: int) -> None:
    bench = bench_with("MTi-30", {NEW_REQUEST: error(code)})
    assert bench.run_until("running", 2.0)
    assert [output for output, _ in bench.device.memory.outputs] == [0x1020, 0x1060, 0x2010, 0x8020]
    assert f"error {code:02X}, " in bench.cause()


@pytest.mark.parametrize("model", ["MTi-28", "MTi-30"])
def test_a_device_that_knows_neither_kind_of_output_is_named(model: str) -> None:
    bench = bench_with(model, {framed(0xD0): error(4), NEW_READ: error(4)})
    bench.run(1.0)
    assert bench.cause() == "the MTi knows neither SetOutputMode nor SetOutputConfiguration"


def test_an_unanswered_setting_is_asked_three_times_and_named() -> None:
    bench = bench_with("MTi-28", {wire("SetOutputSettings"): None})
    bench.run(1.75)
    assert bench.device.heard.count(wire("SetOutputSettings")) == 3
    assert bench.cause() == "the MTi does not answer SetOutputSettings"
