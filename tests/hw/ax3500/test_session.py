"""The AX3500 session on the fake controller: modes, restarts, and everything that goes wrong."""

from typing import Literal

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from core.records import WheelCounts
from hw.ax3500.session import IN_RC_MODE, State
from tests.support.bench_ax3500_session import MAX_COUNTS_PER_S, TICK_S, FakeBench
from tests.support.cases import examples

Stored = Literal["rc", "rs232"]


def moving(counts_per_s: float = 400.0, mode: Stored = "rs232", **how: object) -> FakeBench:
    """A bench whose wheels both turn."""
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
    assert (bench.state, bench.cause, bench.ax.session.state) == ("running", "", State.POLLING)
    assert {(counts.left, counts.right) for counts in measured} == {(250.0, -235.0)}
    assert bench.ax.status.rejected == 0


def test_channels_and_signs_are_those_of_the_settings() -> None:
    bench = FakeBench(left_channel=2, right_channel=1, inverted_channels=(1,))
    bench.wheels.counts_per_s = [-300.0, 500.0]
    measured = bench.run(2.0)
    check_travel(measured, 500.0, 5)
    turned = measured[-1].right - measured[0].right
    assert turned == pytest.approx(300.0 * (measured[-1].t_s - measured[0].t_s), abs=5)


@pytest.mark.parametrize("numbers", [12, 13, 14, 16])
def test_a_controller_in_radio_mode_is_left_alone_unless_allowed(numbers: int) -> None:
    bench = FakeBench("rc")
    bench.fake.log_numbers = numbers
    assert bench.run(3.0) == []
    assert (bench.state, bench.cause) == ("starting", IN_RC_MODE)
    assert bench.ax.session.state is State.LISTENING
    assert bench.port.written == b""
    bench.fake.mode = "rs232"  # somebody else took it over
    bench.run(2.5)
    assert bench.state == "running"


@pytest.mark.parametrize("plus", [True, False])
@pytest.mark.parametrize("minus", [True, False])
@pytest.mark.parametrize("echoes", [True, False])
def test_it_is_taken_over_where_allowed_whatever_the_sheet_leaves_open(
    plus: bool, minus: bool, echoes: bool
) -> None:
    bench = FakeBench("rc", enter=True)
    bench.fake.plus_after_read, bench.fake.minus_on_empty = plus, minus
    bench.fake.echoes_take_over = echoes
    assert len(bench.run(4.0)) > 30
    assert bench.state == "running"
    assert bench.port.written.startswith(b"\r" * 10)
    assert bench.port.written.lstrip(b"\r").startswith(b"^8A\r?Q1\r?Q0\r")


@pytest.mark.parametrize("identity", [["-"], [], ["68"], ["68", "+"], ["28"]])
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


def test_constant_acceleration_does_not_look_like_a_turn() -> None:
    bench, acceleration = FakeBench(), MAX_COUNTS_PER_S / 4
    measured = bench.run(4.0, acceleration=acceleration)
    differences = [counts.right - counts.left for counts in measured]
    assert MAX_COUNTS_PER_S * 0.012 > 25  # of travel between the two readings at the end
    sagitta = acceleration * 0.05**2 / 8  # of the true curve over the chord of one period
    assert len(differences) > 60
    assert max(map(abs, differences)) < 1.0 + sagitta


@pytest.mark.parametrize("rollover", ["wrap", "zero"])
@pytest.mark.parametrize(("near", "speed"), [(2**31 - 900, 900.0), (-(2**31) + 900, -900.0)])
def test_travel_goes_on_over_both_ends_of_the_counters(
    rollover: Literal["wrap", "zero"], near: int, speed: float
) -> None:
    bench = moving(speed)
    bench.fake.counter_offset, bench.fake.rollover = (near, near), rollover
    measured = bench.run(4.0)
    assert (measured[-1].restarts, bench.ax.status.rejected) == (0, 0)
    for k in range(1, len(measured)):
        check_travel(measured[: k + 1], speed, 5)
    assert abs(measured[-1].left - measured[0].left) > 2000


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


@pytest.mark.parametrize("mode", ["rc", "rs232"])
def test_a_controller_that_is_still_booting_is_waited_for(mode: Stored) -> None:
    bench = FakeBench(mode, enter=True)
    bench.run(TICK_S)
    bench.fake.restart(bench.now_s)
    bench.run(5.0)
    assert bench.state == "running"
    assert bench.run(1.0)[-1].restarts == 0


@pytest.mark.parametrize("boot_s", [0.05, 0.7, 3.0])
@pytest.mark.parametrize("mode", ["rc", "rs232"])
def test_a_restart_in_the_middle_of_polling_is_a_new_zero(mode: Stored, boot_s: float) -> None:
    bench = moving(800.0, mode, enter=True)
    bench.fake.boot_s = boot_s
    before = bench.run(6.0)[-1]
    bench.fake.restart(bench.now_s)
    after = bench.run(11.0)
    assert bench.state == "running"
    assert before.restarts == 0
    assert {counts.restarts for counts in after[-100:]} == {1}
    check_travel(after[-100:], 800.0, 5)


def test_a_restart_into_radio_mode_is_told_where_it_may_not_be_taken_over() -> None:
    bench = FakeBench()
    bench.wheels.turned = [9000.0, 9000.0]
    bench.run(1.0)
    bench.fake.parameters[0x00] = 0
    bench.fake.restart(bench.now_s)
    bench.run(2.0)
    assert (bench.state, bench.cause) == ("starting", IN_RC_MODE)
    bench.fake.mode = "rs232"
    assert bench.run(3.0)[-1].restarts == 1


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


def test_lost_and_late_answers_cost_one_pair_each() -> None:
    bench = moving()
    bench.run(1.0)
    bench.wire.mute = True
    bench.run(0.1)
    bench.wire.mute = False
    measured = bench.run(2.0)
    assert 1 <= bench.ax.status.rejected <= 2
    assert len(measured) >= 35
    check_travel(measured, 400.0, 6)


def test_an_answer_slower_than_the_time_out_never_gets_a_wrong_time() -> None:
    bench = moving(1000.0)
    begin = bench.run(1.0)[-1]
    for delay_s in (0.15, 0.25, 0.3, 0.01, 0.06, 0.5, 0.0):
        bench.fake.reply_delay_s = delay_s
        for counts in bench.run(2.0):
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


@pytest.mark.parametrize("damaged", ["7G0", "123456789", "?Q1", "-", "7\x01", ""])
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


@given(offset=st.integers(0, 400), mask=st.integers(1, 127), dropped=st.booleans())
def test_any_byte_altered_or_lost_is_survived(offset: int, mask: int, dropped: bool) -> None:
    bench = moving(mode="rc", enter=True)
    if dropped:
        bench.wire.drop_at = {offset}
    else:
        bench.wire.alter_at = {offset: mask}
    bench.run(6.0)
    measured = bench.run(1.0)
    assert bench.state == "running"
    assert len(measured) >= 19
    assert len({counts.restarts for counts in measured}) == 1
    check_travel(measured, 400.0, 6)


class Life(RuleBasedStateMachine):
    """Faults come and go; once they are gone the controller is polled again, and truly."""

    def __init__(self) -> None:
        super().__init__()
        self.bench = FakeBench("rc", enter=True)

    @rule(mute=st.booleans())
    def silence(self, mute: bool) -> None:
        self.bench.fake.mute = mute

    @rule(cut=st.booleans())
    def pull(self, cut: bool) -> None:
        self.bench.wire.cut = cut

    @rule(rate=st.sampled_from([0.0, 0.01, 0.05]))
    def damage(self, rate: float) -> None:
        self.bench.wire.damage_rate = rate

    @rule(rate=st.sampled_from([0.0, 0.02]))
    def lose(self, rate: float) -> None:
        self.bench.wire.host_drop_rate = self.bench.wire.drop_rate = rate

    @rule(boot_s=st.sampled_from([0.1, 0.7]))
    def restart(self, boot_s: float) -> None:
        self.bench.fake.boot_s = boot_s
        self.bench.fake.restart(self.bench.now_s)

    @rule(speed=st.sampled_from([0.0, 700.0, -2000.0]))
    def drive(self, speed: float) -> None:
        self.bench.wheels.counts_per_s = [speed, speed]

    @rule(seconds=st.sampled_from([0.02, 0.3, 1.5]))
    def wait(self, seconds: float) -> None:
        self.bench.run(seconds)

    @rule()
    def mend(self) -> None:
        bench = self.bench
        bench.fake.mute = bench.wire.cut = False
        bench.wire.damage_rate = bench.wire.drop_rate = bench.wire.host_drop_rate = 0.0
        bench.run(6.0)
        assert bench.state == "running"
        measured = bench.run(1.0)
        assert len(measured) >= 17
        if len({counts.restarts for counts in measured}) == 1:
            check_travel(measured, bench.wheels.counts_per_s[0], 12)

    @precondition(lambda self: self.bench.state != "running")
    @invariant()
    def says_why(self) -> None:
        assert self.bench.cause

    @invariant()
    def commands_nothing(self) -> None:
        assert self.bench.wheels.powers == []
        assert self.bench.fake.flash_writes == 0


TestLife = Life.TestCase
TestLife.settings = settings(max_examples=examples(12), stateful_step_count=15)
