"""The MTi session against the sheet's conversation, and against devices that do not keep to it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hw.mti.session import State
from tests.support.mti_frames import framed, wire
from tests.support.scripted_mti import (
    BEFORE,
    CONVERSATION,
    NEW_READ,
    NEW_REQUEST,
    TICK_S,
    Bench,
    Scripted,
    ScriptedNew,
)


def test_the_conversation_is_that_of_the_sheet() -> None:
    bench = Bench(Scripted())
    attitudes = bench.run(2.0)
    assert bench.device.heard == CONVERSATION
    assert (bench.state(), bench.cause()) == ("running", "")
    assert bench.mti.identity == "MTi-28A53G35, firmware 2.6.1, 00300d2a"
    assert bench.mti.session.state is State.DELIVERING
    assert len(attitudes) > 170
    assert bench.mti.status.rejected == bench.mti.status.missed == 0


def test_go_to_config_is_repeated_by_time_however_much_data_comes_first() -> None:
    device = Scripted()
    device.deaf = True
    bench = Bench(device)
    asked_s = []
    for _ in range(400):
        written = b"".join(bench.port._to_device)
        asked_s += [bench.now_s] * written.count(wire("GoToConfig"))
        bench.run(TICK_S)
    assert np.all(np.abs(np.diff(asked_s) - 0.25) < 0.02)
    assert "sends data but does not answer GoToConfig" in bench.cause()
    device.deaf = False
    bench.run(1.0)
    assert bench.state() == "running"


def test_silence_and_foreign_bytes_are_told_apart() -> None:
    device = Scripted()
    device.mute = True
    bench = Bench(device)
    bench.run(1.5)
    assert bench.cause() == "no answer to GoToConfig: check power, cable and baud rate"
    for _ in range(40):
        bench.port.give(b"\x01\x80\x7f hello \xfa")
        bench.run(0.05)
    assert "at 115200 baud but no MT frame: check the baud rate, or it is another" in bench.cause()
    for _ in range(40):
        bench.port.give(b"\x01\x80\x7f hello \xfa")
        bench.run(0.05)
    assert "may also be set to 4800, 9600," in bench.cause()
    assert bench.mti.status.losses == 0


def test_a_wake_up_in_the_stream_is_acknowledged_and_what_is_right_is_not_set_again() -> None:
    bench = Bench(Scripted())
    bench.run(2.0)
    bench.device.heard.clear()
    bench.device.measuring = False
    bench.device.unasked = wire("WakeUp")
    bench.run(0.02)
    assert bench.device.heard == [wire("WakeUpAck")]
    assert bench.state() == "starting"
    bench.run(1.0)
    assert [frame[2] for frame in bench.device.heard if len(frame) > 5] == []  # nothing is set
    assert bench.state() == "running"


def test_lost_samples_are_counted_by_the_sample_counter() -> None:
    bench = Bench(Scripted())
    bench.run(2.0)
    bench.device.counter = (bench.device.counter + 7) % 65536
    bench.run(0.5)
    assert bench.mti.status.missed == 7
    bench.device.counter = (bench.device.counter + 30000) % 65536  # began anew: nothing is known
    bench.run(0.5)
    assert bench.mti.status.missed == 7


def test_a_device_that_repeats_one_sample_for_ever_is_not_running() -> None:
    bench = Bench(Scripted())
    bench.run(2.0)
    frozen = bench.device.message()
    bench.device.message = lambda: frozen  # type: ignore[method-assign]
    assert len(bench.run(1.0)) == 1
    assert "sample counter stands still" in bench.cause()
    assert bench.state() == "starting"


def test_a_newer_device_is_given_an_output_configuration() -> None:
    bench = Bench(ScriptedNew())
    attitudes = bench.run(2.0)
    assert NEW_REQUEST in bench.device.heard
    assert bench.state() == "running"
    assert bench.mti.identity == "firmware 1.7.2, 0368248c"
    np.testing.assert_allclose(attitudes[-1].q_earth_sensor, [1, 0, 0, 0], atol=1e-7)  # x to north
    np.testing.assert_allclose(attitudes[-1].rate_radps, [0.01, -0.02, 0.25], rtol=1e-6)
    assert bench.mti.status.missed == 0


def test_what_a_newer_device_takes_differently_is_said_while_it_runs() -> None:
    device = ScriptedNew()
    device.most_hz = 50
    bench = Bench(device)
    bench.run(3.0)
    assert bench.state() == "running"
    assert bench.cause() == "the MTi gives output 2010 (quaternion, float32, ENU) at 50 Hz, not 100"


def test_a_newer_device_that_has_the_wanted_outputs_is_not_written_to() -> None:
    device = ScriptedNew()
    device.registers[0xC0] = "C020006480200064201000641060FFFF1020FFFF"  # in any order
    bench = Bench(device)
    bench.run(3.0)
    assert (bench.state(), bench.cause()) == ("running", "")
    assert NEW_REQUEST not in device.heard


@pytest.mark.parametrize("device_type", [Scripted, ScriptedNew])
def test_the_memory_is_written_once_and_never_by_the_next_start(
    device_type: type[Scripted],
) -> None:
    bench = Bench(device_type())
    bench.run(3.0)
    assert any(len(frame) > 5 for frame in bench.device.heard)
    bench.device.heard.clear()
    bench.wire.cut = True
    bench.run(0.1)
    bench.wire.cut = False
    bench.run(3.0)
    assert bench.state() == "running"
    assert not [frame for frame in bench.device.heard if len(frame) > 5]


def test_a_device_that_takes_a_rate_and_does_not_give_it_is_named() -> None:
    bench = Bench(Scripted(), rate_hz=200)  # its samples come each 10 ms all the same
    bench.run(4.0)
    assert bench.state() == "running"
    assert bench.cause() == "the MTi sends 100 samples a second, not 200 as it was told"


def test_an_unanswered_setting_is_asked_three_times_and_named() -> None:
    device = Scripted()
    device.answers[wire("SetOutputSettings")] = None
    bench = Bench(device)
    bench.run(1.75)
    assert bench.device.heard.count(wire("SetOutputSettings")) == 3
    assert bench.cause() == "the MTi does not answer SetOutputSettings"


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
    device = ScriptedNew()
    without = framed(0xC1, bytes.fromhex(f"1020 FFFF 1060 FFFF {offered} 0064"))
    device.answers[NEW_REQUEST] = device.answers[NEW_READ] = without
    bench = Bench(device)
    bench.run(3.0)
    assert bench.state() == state
    assert cause in bench.cause()


@pytest.mark.parametrize(
    ("unasked", "registers", "cause"),
    [
        (b"", {0xD0: "0004", 0xD2: "00000001"}, "18 data bytes, 50 by output mode and settings"),
        (3 * wire("MTData2"), {}, "MTData2, which was not asked for"),
        (BEFORE, {}, "has restarted"),  # its WakeUp was lost
    ],
    ids=["another length", "the other kind", "a configuration"],
)
def test_data_that_were_not_set_up_start_the_conversation_at_once(
    unasked: bytes, registers: dict[int, str], cause: str
) -> None:
    bench = Bench(Scripted())
    bench.run(2.0)
    bench.device.registers |= registers  # as if another host had set it
    bench.device.unasked = unasked
    bench.run(0.05)
    assert cause in bench.cause()
    bench.run(1.0)
    assert (bench.state(), bench.cause()) == ("running", "")


def test_an_error_in_the_stream_is_told_in_words_for_a_while() -> None:
    bench = Bench(Scripted())
    bench.run(2.0)
    bench.device.unasked = framed(0x42, bytes.fromhex("28 0102"))
    bench.run(0.05)
    assert bench.state() == "running"
    assert bench.cause().startswith("the MTi reports error 28 (0102), device error")
    bench.run(5.1)
    assert (bench.state(), bench.cause()) == ("running", "")


@given(offset=st.integers(0, 2000), mask=st.integers(1, 255), dropped=st.booleans())
def test_any_byte_altered_or_lost_at_start_is_survived(
    offset: int, mask: int, dropped: bool
) -> None:
    bench = Bench(Scripted())
    if dropped:
        bench.wire.drop_at = {offset}
    else:
        bench.wire.alter_at = {offset: mask}
    bench.run(4.0)
    assert bench.state() == "running"
    assert len(bench.run(0.5)) == 50
