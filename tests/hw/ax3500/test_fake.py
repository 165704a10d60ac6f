"""The AX3500 session on the fake controller: its pace, its modes, its faults."""

from typing import Literal

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from hw.ax3500.session import IN_RC_MODE
from tests.support.bench_ax3500_session import MAX_COUNTS_PER_S, TICK_S, FakeBench


def test_no_motor_is_ever_told_anything() -> None:
    bench = FakeBench("rc", enter=True)
    bench.run(5.0)
    bench.fake.restart(bench.now_s)
    bench.run(5.0)
    assert bench.ax.status.state == "running"
    assert bench.wheels.powers == []
    assert bench.fake.flash_writes == 0


def test_constant_acceleration_does_not_look_like_a_turn() -> None:
    bench = FakeBench()
    acceleration = MAX_COUNTS_PER_S / 4
    measured = bench.run(4.0, acceleration=acceleration)
    differences = [counts.right - counts.left for counts in measured]
    sagitta = acceleration * 0.05**2 / 8  # of the true curve over the chord of one period
    assert len(differences) > 60
    assert max(map(abs, differences)) < 1.0 + sagitta


@pytest.mark.parametrize("rollover", ["wrap", "zero"])
@pytest.mark.parametrize(("near", "speed"), [(2**31 - 900, 900.0), (-(2**31) + 900, -900.0)])
def test_travel_goes_on_over_both_ends_of_the_counters(
    rollover: Literal["wrap", "zero"], near: int, speed: float
) -> None:
    bench = FakeBench()
    bench.fake.counter_offset, bench.fake.rollover = (near, near), rollover
    bench.wheels.counts_per_s = [speed, speed]
    measured = bench.run(4.0)
    assert (measured[-1].restarts, bench.ax.status.rejected) == (0, 0)
    for counts in measured:
        assert counts.left - measured[0].left == pytest.approx(
            speed * (counts.t_s - measured[0].t_s), abs=5
        )
    assert abs(measured[-1].left - measured[0].left) > 2000


@pytest.mark.parametrize("plus", [True, False])
@pytest.mark.parametrize("minus", [True, False])
@pytest.mark.parametrize("echoes", [True, False])
def test_what_the_sheet_leaves_open_is_taken_in_both_forms(
    plus: bool, minus: bool, echoes: bool
) -> None:
    bench = FakeBench("rc", enter=True)
    bench.fake.plus_after_read, bench.fake.minus_on_empty = plus, minus
    bench.fake.echoes_take_over = echoes
    assert len(bench.run(4.0)) > 30
    assert bench.ax.status.state == "running"


@pytest.mark.parametrize("numbers", [12, 13, 14, 16])
def test_radio_mode_is_told_by_logging_lines_of_every_length(numbers: int) -> None:
    bench = FakeBench("rc")
    bench.fake.log_numbers = numbers
    bench.run(3.0)
    assert bench.ax.status.cause == IN_RC_MODE
    assert bench.fake.mode == "rc"


@pytest.mark.parametrize("mode", ["rc", "rs232"])
def test_a_controller_that_is_still_booting_is_waited_for(mode: Literal["rc", "rs232"]) -> None:
    bench = FakeBench(mode, enter=True)
    bench.run(TICK_S)
    bench.fake.restart(bench.now_s)
    bench.run(5.0)
    assert bench.ax.status.state == "running"
    assert bench.run(1.0)[-1].restarts == 0


@pytest.mark.parametrize("boot_s", [0.05, 0.7, 3.0])
@pytest.mark.parametrize("mode", ["rc", "rs232"])
def test_a_restart_in_the_middle_of_polling_is_a_new_zero(
    mode: Literal["rc", "rs232"], boot_s: float
) -> None:
    bench = FakeBench(mode, enter=True)
    bench.fake.boot_s = boot_s
    bench.wheels.counts_per_s = [800.0, 700.0]
    before = bench.run(6.0)[-1]
    bench.fake.restart(bench.now_s)
    after = bench.run(11.0)
    assert bench.ax.status.state == "running"
    assert before.restarts == 0
    assert {counts.restarts for counts in after[-100:]} == {1}
    passed_s = after[-1].t_s - after[-100].t_s
    assert after[-1].left - after[-100].left == pytest.approx(800.0 * passed_s, abs=5)


def test_watchdog_letters_in_the_stream_cost_no_reading() -> None:
    bench = FakeBench()
    bench.fake.w_rate = 0.2
    bench.wheels.counts_per_s = [800.0, 800.0]
    measured = bench.run(3.0)
    assert bench.ax.stream.watchdog_stops > 20
    assert len(measured) > 45
    assert bench.ax.status.rejected == 0


@pytest.mark.parametrize("delay_s", [0.0, 0.01, 0.04, 0.15])
def test_a_controller_that_takes_its_time_is_read_all_the_same(delay_s: float) -> None:
    bench = FakeBench()
    bench.fake.reply_delay_s = delay_s
    bench.wheels.counts_per_s = [1000.0, 1000.0]
    measured = bench.run(4.0)
    assert bench.ax.status.state == "running"
    assert measured[-1].left - measured[0].left == pytest.approx(
        1000.0 * (measured[-1].t_s - measured[0].t_s), abs=10
    )


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
        assert bench.ax.status.state == "running"
        measured = bench.run(1.0)
        assert len(measured) >= 17
        speed = bench.wheels.counts_per_s[0]
        passed_s = measured[-1].t_s - measured[0].t_s
        if len({counts.restarts for counts in measured}) == 1:
            assert measured[-1].left - measured[0].left == pytest.approx(speed * passed_s, abs=12)

    @precondition(lambda self: self.bench.ax.status.state != "running")
    @invariant()
    def says_why(self) -> None:
        assert self.bench.ax.status.cause

    @invariant()
    def commands_nothing(self) -> None:
        assert self.bench.wheels.powers == []
        assert self.bench.fake.flash_writes == 0


TestLife = Life.TestCase
TestLife.settings = settings(max_examples=25, stateful_step_count=15)
