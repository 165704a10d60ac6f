"""Each request of the start refused, unanswered, or answered by a WakeUp: what is said and done."""

import pytest

from hw.mti.frames import ERRORS
from tests.support.mti_frames import framed, wire
from tests.support.scripted_mti import (
    CONVERSATION,
    NEW_READ,
    NEW_REQUEST,
    NOT_IMPLEMENTED,
    Bench,
    Scripted,
    ScriptedNew,
)

REQUESTS = list(dict.fromkeys(CONVERSATION))
NEW_REQUESTS = [
    wire("GoToConfig"),
    wire("ReqDID"),
    wire("ReqProductCode"),
    wire("ReqFWRev"),
    framed(0x1E),
    wire("ReqConfiguration"),
    NEW_READ,
    NEW_REQUEST,
    wire("GoToMeasurement"),
]
BOTH = [(Scripted, request) for request in REQUESTS] + [
    (ScriptedNew, request) for request in NEW_REQUESTS
]
HARMLESS = {0x1C, 0x12, 0x1E, 0x0C, 0xD4}


def spoiled(device_type: type[Scripted], request: bytes, answer: bytes | None) -> Bench[Scripted]:
    """A bench whose device answers one request in its own way."""
    bench = Bench(device_type())
    bench.device.answers[request] = answer
    return bench


def mend(bench: Bench[Scripted], request: bytes) -> None:
    """The device is as it should be again."""
    original = type(bench.device)().answers
    del bench.device.answers[request]
    if request in original:
        bench.device.answers[request] = original[request]


@pytest.mark.parametrize(("device_type", "request_"), BOTH, ids=lambda x: getattr(x, "hex", str)())
def test_every_error_to_every_request_is_said_or_done_without(
    device_type: type[Scripted], request_: bytes
) -> None:
    for code in [*ERRORS, 0x77]:
        bench = spoiled(device_type, request_, framed(0x42, bytes([code])))
        bench.run(1.2)
        if request_[2] in HARMLESS:
            assert bench.run_until("running", 2.0), (code, bench.cause())
            assert bench.cause() == ""
        elif bench.state() != "running" and request_ != wire("GoToConfig"):
            assert bench.cause(), code
            known = code == 0x04 and request_[2] in (0xC0, 0xD0)  # "not this kind of device"
            assert f"error {code:02X}, " in bench.cause() or known, (code, bench.cause())
        mend(bench, request_)
        assert bench.run_until("running", 4.0), (code, bench.cause())
        assert len(bench.run(0.5)) >= 49


@pytest.mark.parametrize(("device_type", "request_"), BOTH, ids=lambda x: getattr(x, "hex", str)())
def test_silence_to_every_request_is_said_or_done_without(
    device_type: type[Scripted], request_: bytes
) -> None:
    bench = spoiled(device_type, request_, None)
    bench.run(4.0)
    if request_[2] in HARMLESS or request_ == wire("GoToMeasurement"):  # data proves that one
        assert bench.state() == "running" or "GoToMeasurement" in bench.cause()
    else:
        assert bench.state() == "starting"
        assert "answer" in bench.cause() or "knows neither" in bench.cause()
    mend(bench, request_)
    assert bench.run_until("running", 6.0), bench.cause()


@pytest.mark.parametrize(("device_type", "request_"), BOTH, ids=lambda x: getattr(x, "hex", str)())
def test_a_wake_up_at_any_point_of_the_start_is_acknowledged_and_survived(
    device_type: type[Scripted], request_: bytes
) -> None:
    bench = spoiled(device_type, request_, wire("WakeUp"))
    while request_ not in bench.device.heard:
        bench.run(0.005)
    bench.device.registers.update(type(bench.device)().registers)  # a brown-out that forgets
    mend(bench, request_)
    assert bench.run_until("running", 4.0), bench.cause()
    assert bench.device.heard.count(wire("WakeUpAck")) == 1


@pytest.mark.parametrize(
    ("register", "kept", "state", "cause"),
    [
        (0xD0, "0004", "starting", "0004 and settings 00000005, not 0006 and 00000005"),
        (0xD2, "00000001", "starting", "settings 00000001, not 0006 and 00000005"),
        (0xD4, "FFFF", "starting", "sends only on request"),
        (0xD4, "0003", "running", "the MTi gives 25.0 samples a second, not 100 as configured"),
        (0x04, "0900", "running", "the MTi gives 50.0 samples a second, not 100 as configured"),
    ],
)
def test_a_setting_that_is_not_kept_is_read_back_and_said(
    register: int, kept: str, state: str, cause: str
) -> None:
    device = Scripted()
    device.registers[register], device.stubborn = kept, {register: kept}
    bench = Bench(device)
    bench.run(2.0)
    assert (bench.state(), cause in bench.cause()) == (state, True), bench.cause()
    device.stubborn = {}
    bench.wire.cut = True
    bench.run(0.1)
    bench.wire.cut = False
    bench.run(2.0)
    assert (bench.state(), bench.cause()) == ("running", "")


@pytest.mark.parametrize("code", [0x03, 0x1E])
def test_a_period_that_the_device_cannot_do_gives_way_to_a_longer_one(code: int) -> None:
    device = Scripted()
    refusal = framed(0x42, bytes([code]))
    for hz in (400, 256, 200):
        device.answers[framed(0x04, (115200 // hz).to_bytes(2, "big"))] = refusal
    bench = Bench(device, rate_hz=200)
    bench.run(2.0)
    assert bench.state() == "running"
    assert device.registers[0x04] == "03c0"  # 120 Hz
    assert bench.cause().startswith(f"the MTi refuses SetPeriod: error {code:02X}")


@pytest.mark.parametrize("code", [0x1E, 0x23, 0x24, 0x29])
def test_a_newer_device_that_finds_the_output_too_much_is_asked_for_less(code: int) -> None:
    device = ScriptedNew()
    device.answers[NEW_REQUEST] = framed(0x42, bytes([code]))
    bench = Bench(device)
    bench.run(2.0)
    assert bench.state() == "running"
    assert device.registers[0xC0] == "1020ffff1060ffff2010006480200064"
    assert f"error {code:02X}, " in bench.cause()


def test_a_device_that_knows_neither_kind_of_output_is_named() -> None:
    for device_type in (Scripted, ScriptedNew):
        device = device_type()
        device.registers = {}
        device.answers[framed(0x0C)] = NOT_IMPLEMENTED
        bench = Bench(device)
        bench.run(3.0)
        assert bench.cause() == "the MTi knows neither SetOutputMode nor SetOutputConfiguration"
