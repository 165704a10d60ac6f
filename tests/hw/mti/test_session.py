"""The MTi session against the sheet's conversation, and against devices that do not keep to it."""

import math
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hw.device import DeviceStatus
from hw.mti.frames import MtFrame
from hw.mti.output import legacy_output, new_outputs
from hw.mti.stream import MtStream, StreamReader
from tests.support.cases import examples
from tests.support.devices.mti_frames import configuration, framed, wire
from tests.support.devices.scripted_mti import (
    CONVERSATION,
    NEW_CONVERSATION,
    NEW_READ,
    NEW_REQUEST,
    TICK_S,
    Bench,
    Scripted,
    motion_at,
)

LEGACY, NEW = "MTi-28", "MTi-30"


def running(device: Scripted, rate_hz: float = 100, baud: int = 115200) -> Bench:
    bench = Bench(device, rate_hz, baud)
    assert bench.run_until("running", 3.0), bench.cause()
    return bench


@pytest.mark.parametrize(
    ("model", "requests", "identity"),
    [
        (LEGACY, CONVERSATION, "MTi-28A53G35, firmware 2.6.1, 00300d2a"),
        (NEW, NEW_CONVERSATION, "MTi-30-2A8G4, firmware 1.7.2, hardware 2.0, 03680d2c"),
    ],
)
def test_the_conversation_is_that_of_the_sheet(
    model: str, requests: list[bytes], identity: str
) -> None:
    bench = Bench(Scripted(model))
    attitudes = bench.run(2.0)
    assert bench.device.heard == requests
    assert (bench.state(), bench.cause()) == ("running", "")
    assert bench.mti.identity == identity
    assert len(attitudes) > 170
    assert bench.mti.status.rejected == bench.mti.status.missed == 0


@pytest.mark.parametrize("heard_at", [0, 1, 3])
def test_what_is_heard_while_it_starts_does_not_end_the_listening(heard_at: int) -> None:
    """Between two steps, when nobody knows yet how often samples will come."""
    bench = Bench(Scripted(LEGACY))
    for _ in range(heard_at):
        bench.run(TICK_S)
    bench.mti.hear(bench.now_s)
    assert bench.mti.status.hears_s <= bench.now_s
    assert bench.run_until("running", 3.0), bench.cause()
    assert bench.mti.status.hears_s <= bench.now_s


def test_go_to_config_is_repeated_by_time_however_much_data_comes_first() -> None:
    device = Scripted()
    device.deaf = True
    bench, asked_s = Bench(device), []
    for _ in range(400):
        bench.run(TICK_S)
        asked_s += [bench.now_s] * len(device.heard)
        device.heard.clear()
    assert np.all(np.abs(np.diff(asked_s) - 0.25) < 0.02)
    assert "sends data but does not answer GoToConfig" in bench.cause()
    device.deaf = False
    assert bench.run_until("running", 1.0)


def test_silence_and_foreign_bytes_are_told_apart() -> None:
    device = Scripted()
    device.mute = True
    bench = Bench(device)
    bench.run(1.5)
    assert bench.cause() == "no answer to GoToConfig: check power, cable and baud rate"
    for said in (
        "at 115200 baud but no MT frame: check the baud rate, or it is another",
        "may also be set to 4800, 9600,",
    ):
        for _ in range(40):
            bench.port.give(b"\x01\x80\x7f hello \xfa")
            bench.run(0.05)
        assert said in bench.cause()
    assert bench.mti.status.losses == 0


def test_a_wake_up_in_the_stream_is_acknowledged_at_once() -> None:
    bench = running(Scripted())
    bench.device.heard.clear()
    bench.device.power_up(bench.now_s)
    bench.run(0.05)
    assert bench.device.heard == [wire("WakeUpAck")]
    assert bench.state() == "starting"
    assert bench.run_until("running", 1.0)
    assert not bench.device.settings_heard()  # nothing is set again


@pytest.mark.parametrize("model", [LEGACY, NEW])
def test_the_memory_is_written_once_and_never_by_the_next_start(model: str) -> None:
    bench = running(Scripted(model))
    assert bench.device.settings_heard()
    bench.device.heard.clear()
    bench.device.memory.outputs = bench.device.memory.outputs[::-1]  # in any order
    bench.reconnect()
    assert bench.run_until("running", 3.0)
    assert not bench.device.settings_heard()


def test_lost_samples_are_counted_by_the_sample_counter() -> None:
    bench = running(Scripted())
    bench.device.gap = 7
    bench.run(0.5)
    assert bench.mti.status.missed == 7
    bench.device.gap = 30_000  # began anew: nothing is known
    bench.run(0.5)
    assert bench.mti.status.missed == 7


@pytest.mark.parametrize(
    ("fault", "cause"), [("frozen", "sample counter stands still"), ("nan", "not finite")]
)
def test_a_device_that_repeats_a_sample_or_sends_no_numbers_is_not_running(
    fault: str, cause: str
) -> None:
    bench = running(Scripted())
    setattr(bench.device, fault, True)
    bench.run(TICK_S * 4)
    assert fault == "frozen" or bench.run(0.5) == []
    bench.run(0.7)
    assert (bench.state(), cause in bench.cause()) == ("starting", True)
    setattr(bench.device, fault, False)
    assert bench.run_until("running", 2.0)


def test_a_device_that_keeps_north_east_down_is_turned() -> None:
    device = Scripted("MTi-G")
    device.another_host(0x0006, 0x8000_0005)
    attitude = running(device).run(0.2)[-1]
    w, x, y, z = attitude.q_earth_sensor
    R = motion_at(attitude.t_s)[0]
    yaw = math.atan2(2 * (x * y + w * z), 1 - 2 * (y * y + z * z))
    assert yaw == pytest.approx(math.atan2(R[1, 0], R[0, 0]), abs=0.01)
    assert not device.settings_heard()


def test_an_id_that_says_otherwise_than_the_answers_misleads_nobody() -> None:
    for model, device_id in ((NEW, "00300001"), (LEGACY, "03600001")):
        device = Scripted(model)
        device.answers[wire("ReqDID")] = framed(0x01, bytes.fromhex(device_id))
        running(device)


def test_what_a_newer_device_takes_differently_is_said_while_it_runs() -> None:
    bench = running(Scripted("MTi-3"), rate_hz=200, baud=921600)
    assert bench.cause() == (
        "the MTi gives output 2010 (quaternion, float32, ENU) at 100 Hz, not 200"
    )


@pytest.mark.parametrize(
    ("offered", "state", "cause"),
    [
        ("8020", "starting", "does not offer output 2010 (quaternion, float32, ENU)"),
        ("2010", "running", "the MTi does not offer output 8020 (rate of turn, float32)"),
    ],
)
def test_an_output_that_a_newer_device_has_not_is_named(
    offered: str, state: str, cause: str
) -> None:
    device = Scripted(NEW)
    without = framed(0xC1, bytes.fromhex(f"1020 FFFF 1060 FFFF {offered} 0064"))
    device.answers[NEW_REQUEST] = device.answers[NEW_READ] = without
    bench = Bench(device)
    bench.run(1.0)
    assert bench.state() == state
    assert cause in bench.cause()


def test_a_device_that_takes_a_rate_and_does_not_give_it_is_named() -> None:
    device = Scripted()
    period = struct.pack(">H", 115200 // 200)
    device.answers[framed(0x04, period)] = wire("SetPeriodAck")
    bench = Bench(device, rate_hz=200)
    while framed(0x04, period) not in device.heard:
        bench.run(TICK_S)
    device.answers[wire("ReqPeriod")] = framed(0x05, period)  # its samples come each 10 ms
    bench.run(3.5)
    assert bench.state() == "running"
    assert bench.cause() == "the MTi sends 100 samples a second, not 200 as it was told"


@pytest.mark.parametrize(
    ("unasked", "mode", "cause"),
    [
        (b"", 4, "18 data bytes, 50 by output mode and settings"),
        (3 * wire("MTData2"), 6, "MTData2, which was not asked for"),
        (configuration("0012 0004 00000001"), 6, "has restarted"),  # its WakeUp was lost
    ],
    ids=["another length", "the other kind", "a configuration"],
)
def test_data_that_were_not_set_up_start_the_conversation_at_once(
    unasked: bytes, mode: int, cause: str
) -> None:
    bench = running(Scripted())
    if mode == 4:
        bench.device.another_host(mode, 1)
    bench.device.unasked = unasked
    bench.run(0.1)
    assert cause in bench.cause()
    assert bench.run_until("running", 1.0)
    assert bench.cause() == ""


def test_an_error_in_the_stream_is_told_in_words_for_a_while() -> None:
    bench = running(Scripted())
    bench.device.unasked = framed(0x42, bytes.fromhex("28 0102"))
    bench.run(0.05)
    assert bench.state() == "running"
    assert bench.cause().startswith("the MTi reports error 28 (0102), device error")
    bench.run(5.1)
    assert (bench.state(), bench.cause()) == ("running", "")


@settings(max_examples=examples(12))
@given(offset=st.integers(0, 2000), mask=st.integers(1, 255), dropped=st.booleans())
def test_any_byte_altered_or_lost_at_start_is_survived(
    offset: int, mask: int, dropped: bool
) -> None:
    bench = Bench(Scripted())
    if dropped:
        bench.wire.drop_at = {offset}
    else:
        bench.wire.alter_at = {offset: mask}
    bench.run(0.5)
    assert bench.run_until("running", 3.5)
    assert len(bench.run(0.3)) >= 29


# -- messages in parts ------------------------------------------------------------------------


def test_split_messages_give_every_attitude_with_the_rate_of_its_own_instant() -> None:
    """Orientation and rate of turn in two messages, the rate half as often."""
    status, attitudes = DeviceStatus("mti"), []
    reader = StreamReader(status, MtStream(period_s=0.01), 10 / 115200)
    for counter in range(100):
        stamp = struct.pack(">HBH HBI", 0x1020, 2, counter, 0x1060, 4, 100 * counter)
        parts = [stamp + struct.pack(">HB4f", 0x2010, 16, 1.0, 0.0, 0.0, 0.0)]
        if counter % 2 == 0:
            parts.append(stamp + struct.pack(">HB3f", 0x8020, 12, 0.01, -0.02, 0.25))
        now_s = 0.01 * counter
        attitudes += reader.take([MtFrame(0x36, part, now_s) for part in parts], now_s)
    attitudes += reader.take([], 2.0)
    with_rate = [a for a in attitudes if math.isfinite(a.rate_radps[0])]
    assert (len(attitudes), len(with_rate)) == (100, 50)
    assert status.missed == status.rejected == 0


# -- what the line carries --------------------------------------------------------------------


@pytest.mark.parametrize(
    ("rate_hz", "baud", "settings", "cause"),
    [
        (100, 115200, 0x05, ""),
        (100, 57600, 0x05, ""),
        (100, 38400, 0x55, ""),
        (100, 28800, 0x05, "28800 baud carry no rate of turn at 100 samples a second"),
        (100, 9600, 0x55, "9600 baud carry 30.0"),
        (200, 115200, 0x05, ""),
    ],
)
def test_a_legacy_output_is_chosen_that_its_line_carries(
    rate_hz: float, baud: int, settings: int, cause: str
) -> None:
    bench = running(Scripted(), rate_hz, baud)
    assert bench.device.memory.settings == settings
    assert bench.cause().startswith(cause)
    assert bool(bench.cause()) == bool(cause)


def test_a_newer_device_on_a_slow_line_is_asked_for_less_and_says_so() -> None:
    bench = running(Scripted(NEW), 100, 19200)
    assert NEW_REQUEST not in bench.device.heard
    assert "19200 baud carry 25 samples a second, not 100" in bench.cause()


@pytest.mark.parametrize("baud", [4800, 9600, 19200, 38400, 57600, 115200, 921600])
def test_what_is_asked_for_never_exceeds_the_line(baud: int) -> None:
    sizes = {0x1020: 5, 0x1060: 7, 0x2010: 19, 0x2030: 15, 0x8020: 15, 0xC020: 15}
    for rate_hz in (10, 50, 100, 200, 400, 512):
        legacy = legacy_output(rate_hz, baud)
        numbers = 3 * (legacy.mode == 6) * (3 - bin(legacy.settings & 0x70).count("1")) + 3
        assert 115200 / legacy.period * (5 + 4 * numbers + 2) * 10 < baud
        assert legacy.remark or 115200 / legacy.period == pytest.approx(rate_hz, rel=0.01)
        for choice in new_outputs(rate_hz, baud):
            frame = 5 + sum(sizes[identifier] for identifier, _ in choice.outputs)
            assert choice.rate_hz * frame * 10 < baud
            assert choice.remark or choice.rate_hz == rate_hz
