"""The AX3500 session on the fake controller: modes, restarts, and everything that goes wrong."""

import math
import random
from itertools import pairwise
from typing import Literal

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.records import WheelCounts
from hw.ax3500.conversation import RESTART_S
from hw.ax3500.session import IN_RC_MODE
from tests.support.cases import examples
from tests.support.devices.bench_ax3500 import TICK_S, FakeBench

Stored = Literal["rc", "rs232"]


def moving(counts_per_s: float = 400.0, mode: Stored = "rs232", **how: object) -> FakeBench:
    bench = FakeBench(mode, **how)  # type: ignore[arg-type]
    bench.wheels.counts_per_s = [counts_per_s, counts_per_s]
    return bench


def check_travel(measured: list[WheelCounts], counts_per_s: float, abs_counts: float) -> None:
    """From the first to the last."""
    passed_s = measured[-1].t_s - measured[0].t_s
    travelled = measured[-1].left - measured[0].left
    assert travelled == pytest.approx(counts_per_s * passed_s, abs=abs_counts)


# ---- modes


@pytest.mark.parametrize("enter", [True, False])
def test_identity_is_asked_once_and_then_the_counters_by_turns(enter: bool) -> None:
    bench = FakeBench(enter=enter)
    bench.wheels.turned = [250.0, -235.0]
    measured = bench.run(2.0)
    assert bench.port.written.startswith(b"^8A\r?Q1\r?Q0\r?Q1\r?Q0\r")
    counters = [line for line in bytes(bench.port.written).split(b"\r") if b"?Q" in line]
    assert set(counters[0::2]) == {b"?Q1"}
    assert set(counters[1::2]) == {b"?Q0"}
    assert (bench.state, bench.cause) == ("running", "")
    assert {(counts.left, counts.right) for counts in measured} == {(250.0, -235.0)}
    assert bench.ax.status.rejected == 0


def test_channels_and_signs_are_those_of_the_settings() -> None:
    bench = FakeBench(left_channel=2, right_channel=1, invert=[1])
    bench.wheels.counts_per_s = [-300.0, 500.0]
    measured = bench.run(2.0)
    check_travel(measured, 500.0, 5)
    turned = measured[-1].right - measured[0].right
    assert turned == pytest.approx(300.0 * (measured[-1].t_s - measured[0].t_s), abs=5)


def test_a_controller_in_radio_mode_is_left_alone_unless_allowed() -> None:
    bench = FakeBench("rc")
    assert bench.run(3.0) == []
    assert (bench.state, bench.cause) == ("starting", IN_RC_MODE)
    assert bench.port.written == b""
    bench.fake.mode = "rs232"  # somebody else took it over
    bench.run(2.5)
    assert bench.state == "running"


@pytest.mark.parametrize(
    ("plus", "minus", "echoes"), [(True, False, False), (False, True, True), (True, True, True)]
)
def test_it_is_taken_over_where_allowed_whatever_the_sheet_leaves_open(
    plus: bool, minus: bool, echoes: bool
) -> None:
    bench = FakeBench("rc", enter=True)
    bench.fake.plus_after_read, bench.fake.minus_on_empty = plus, minus
    bench.fake.echoes_take_over = echoes
    assert len(bench.run(3.0)) > 15
    assert bench.state == "running"
    assert bench.port.written.startswith(b"\r" * 10)
    assert bench.port.written.lstrip(b"\r").startswith(b"^8A\r?Q1\r?Q0\r")


@pytest.mark.parametrize("identity", [["-"], [], ["28"]])
def test_identity_is_tolerated_in_every_form(identity: list[str]) -> None:
    bench = FakeBench()
    bench.fake.odd["^8A"] = identity
    bench.run(2.5)
    assert bench.state == "running"


def test_a_controller_without_encoder_module_is_named() -> None:
    bench = FakeBench()
    bench.fake.encoder = False
    assert bench.run(2.0) == []
    assert bench.cause == "the controller has no encoder module: ^8A says 48"


# ---- counters


def test_an_impossible_jump_is_dropped_and_counted() -> None:
    bench = FakeBench()
    bench.wheels.turned = [300.0, 300.0]
    bench.run(1.0)
    bench.fake.odd["?Q1"] = ["7D0"]
    asked = bench.port.written.count(b"?Q1\r")
    while bench.port.written.count(b"?Q1\r") == asked:
        bench.run(TICK_S)
    bench.run(0.02)
    del bench.fake.odd["?Q1"]
    measured = bench.run(1.0)
    assert bench.ax.status.rejected == 1
    assert bench.ax.status.rejections[0].reason.startswith("counter 2 jumped by 1700")
    assert {(counts.left, counts.right, counts.restarts) for counts in measured} == {(300, 300, 0)}


# ---- restarts

LINE_S = 0.03  # of a line that tells of one


@pytest.mark.parametrize("mode", ["rc", "rs232"])
def test_a_controller_that_is_still_booting_is_waited_for(mode: Stored) -> None:
    bench = FakeBench(mode, enter=True)
    bench.run(TICK_S)
    bench.fake.restart(bench.now_s)
    bench.run(5.0)
    assert bench.state == "running"
    assert bench.run(1.0)[-1].restarts == 0


@pytest.mark.parametrize(("mode", "boot_s"), [("rc", 0.05), ("rs232", 0.7), ("rc", 3.0)])
def test_a_restart_in_the_middle_of_polling_is_a_new_zero(mode: Stored, boot_s: float) -> None:
    bench = moving(800.0, mode, enter=True)
    bench.fake.boot_s = boot_s
    before, restarted_s = bench.run(4.0)[-1], bench.now_s
    bench.fake.restart(bench.now_s)
    after = bench.run(4.0 + 2 * boot_s)[-30:]
    assert bench.state == "running"
    assert before.restarts == 0
    assert {counts.restarts for counts in after} == {1}
    [unpowered_s] = {counts.unpowered_s for counts in after}
    if mode == "rc":  # a radio may have driven meanwhile
        assert unpowered_s == math.inf
    else:
        assert restarted_s - RESTART_S < unpowered_s <= restarted_s + boot_s - RESTART_S + LINE_S
    check_travel(after, 800.0, 5)


@pytest.mark.parametrize("radio", [True, False])
def test_a_restart_into_radio_mode_is_told_where_it_may_not_be_taken_over(radio: bool) -> None:
    bench = FakeBench(radio=radio)
    bench.wheels.turned = [9000.0, 9000.0]
    bench.run(1.0)
    bench.fake.parameters[0x00] = 0
    restarted_s = bench.now_s
    bench.fake.restart(restarted_s)
    bench.run(2.0)
    assert (bench.state, bench.cause) == ("starting", IN_RC_MODE)
    bench.fake.mode = "rs232"
    newest = bench.run(3.0)[-1]
    assert newest.restarts == 1
    if radio:  # it may have driven
        assert newest.unpowered_s == math.inf
    else:
        woke_s = restarted_s + bench.fake.boot_s
        assert woke_s - RESTART_S <= newest.unpowered_s <= woke_s - RESTART_S + LINE_S


# ---- faults of the line


@pytest.mark.parametrize("cut", [False, True], ids=["silence", "a pulled cable"])
def test_travel_goes_on_over_an_outage_which_silence_becomes_after_two_seconds(cut: bool) -> None:
    bench = moving()
    measured = bench.run(2.0)
    bench.fake.mute, bench.wire.cut = not cut, cut
    bench.run(1.9)
    assert bench.ax.status.losses == cut
    bench.run(0.5)
    assert (bench.state, bench.ax.status.losses) == ("closed" if cut else "starting", 1)
    assert cut or "no echo" in bench.cause
    assert "baud" not in bench.cause
    bench.run(5.0)
    bench.fake.mute = bench.wire.cut = False
    measured += bench.run(3.0)
    assert bench.state == "running"
    assert measured[-1].restarts == 0
    check_travel(measured, 400.0, 8)


def test_an_answer_slower_than_the_time_out_never_gets_a_wrong_time() -> None:
    bench = moving(1000.0)
    begin = bench.run(1.0)[-1]
    for delay_s in (0.15, 0.25, 0.01, 0.5, 0.0):
        bench.fake.reply_delay_s = delay_s
        for counts in bench.run(1.5):
            check_travel([begin, counts], 1000.0, delay_s * 1000 / 2 + 10)
    assert bench.state == "running"


def test_watchdog_letters_anywhere_are_counted_and_cost_no_reading() -> None:
    bench = moving(800.0)
    bench.run(1.0)
    for k in range(40):
        bench.run(TICK_S * (1 + k % 7))
        bench.port.give(b"W")
    bench.run(TICK_S)
    assert bench.ax.measured()["watchdog_stops"] == 40
    bench.fake.w_rate = 0.2
    assert len(bench.run(3.0)) > 45
    assert bench.ax.status.rejected == 0


@pytest.mark.parametrize("damaged", ["7G0", "123456789", "?Q1", ""])
def test_damaged_values_are_dropped_and_asked_again(damaged: str) -> None:
    bench = FakeBench()
    bench.run(1.0)
    bench.fake.odd["?Q0"] = [damaged]
    assert len(bench.run(0.5)) <= 1
    del bench.fake.odd["?Q0"]
    assert bench.ax.status.rejected >= 1
    assert len(bench.run(1.0)) >= 15
    assert bench.ax.status.losses == 0


@pytest.mark.parametrize(
    ("odd", "why"),
    [
        ({"?Q0": [], "?Q1": []}, "?Q0 and ?Q1: no value after the echo"),
        ({"?Q1": ["-"]}, "?Q1: refused"),
    ],
)
def test_counters_that_are_not_told_are_a_loss_with_its_cause(
    odd: dict[str, list[str]], why: str
) -> None:
    bench = FakeBench()
    bench.run(1.0)
    bench.fake.odd = odd
    bench.run(2.5)
    assert (bench.state, bench.ax.status.losses) == ("starting", 1)
    assert bench.cause == f"no counters for 2 s: {why}"


@settings(max_examples=examples(8))
@given(offset=st.integers(0, 300), mask=st.integers(1, 127), dropped=st.booleans())
def test_any_byte_altered_or_lost_is_survived(offset: int, mask: int, dropped: bool) -> None:
    bench = moving(mode="rc", enter=True)
    if dropped:
        bench.wire.drop_at = {offset}
    else:
        bench.wire.alter_at = {offset: mask}
    bench.run(4.0)
    measured = bench.run(1.0)
    assert bench.state == "running"
    assert len(measured) >= 19
    assert len({counts.restarts for counts in measured}) == 1
    check_travel(measured, 400.0, 6)


def garbled(data: bytes, seed: int) -> bytes:
    """What a receiver at another baud rate makes of it: other bits, and of a CR no CR."""
    chance = random.Random(seed)
    return bytes(byte for byte in (chance.randrange(1, 256) for _ in data) if byte & 0x7F != 0x0D)


def test_a_wrong_baud_rate_is_named() -> None:
    bench = FakeBench()
    bench.fake.deaf = True
    for k in range(100):
        bench.port.give(garbled(b":0000000000FE00", k))
        bench.run(0.05)
    assert bench.state == "starting"
    assert "check baud rate, parity E and 7 bits" in bench.cause
    bench.fake.deaf = False
    bench.run(6.0)
    assert (bench.state, bench.cause) == ("running", "")


@pytest.mark.parametrize(
    ("mode", "enter"), [("rc", True), ("analog", False), ("rs232", True), ("rs232_watchdog", False)]
)
def test_a_monitor_says_nothing_but_queries_in_any_mode(mode: str, enter: bool) -> None:
    bench = FakeBench(mode, enter=enter)  # type: ignore[arg-type]
    bench.run(2.5, (1.0, 1.0))
    bench.fake.restart(bench.now_s)
    bench.run(2.5, (1.0, 1.0))
    bench.ax.stop()
    lines = set(bytes(bench.port.written).split(b"\r"))
    assert all(line[:1] in (b"", b"?", b"^") and b" " not in line for line in lines)
    assert lines <= {b"", b"^8A", b"^89"} | {b"?" + c for c in (b"Q0", b"Q1")} | {
        b"?" + bytes([letter]) for letter in b"AMEI"
    }
    assert (b"?Q0" in lines) is (enter or mode.startswith("rs232"))


def test_there_is_never_more_than_one_line_on_the_way() -> None:
    bench = FakeBench("rs232_watchdog", enable=True, poll_hz=60.0, look_s=0.0005)
    bench.fake.minus_on_empty = True
    bench.start()
    begun = len(bench.port.written)
    sizes = []
    for _ in range(200):
        bench.tick((0.2, 0.2))
        sizes.append(bytes(bench.port.written[begun:]).count(b"\r"))
    assert max(b - a for a, b in pairwise(sizes)) == 1
    assert bench.ax.status.rejected == 0
