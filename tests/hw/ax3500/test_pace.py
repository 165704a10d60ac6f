"""How many pairs a paced line carries: derived from its bytes, measured on the fake."""

import itertools
import math

import pytest

from hw.ax3500.lines import CHARACTER_S
from hw.ax3500.schedule import Schedule
from tests.support.cases import few
from tests.support.devices.bench_ax3500 import FakeBench

AT_DIGITS = {4: 4_000, 6: 2_000_000, 8: 1_000_000_000}  # counts whose text is so long
LOOK_S = 0.0005  # what a character takes, halved: a loop that wakes when bytes arrive


def measured_hz(bench: FakeBench, digits: int, wish: tuple[float, float] | None = None) -> float:
    bench.fake.counter_offset = (AT_DIGITS[digits],) * 2
    bench.start(wish)
    return len(bench.run(2.0, wish)) / 2.0


def pairs_per_s(digits: int, motors_hz: float = 0.0) -> float:
    """As hw/ax3500/schedule.py derives it: slow values, motor commands, and the rest for pairs."""
    return (1 / CHARACTER_S - 38 - 16 * motors_hz) / (2 * (6 + digits))


@pytest.mark.parametrize(("digits", "motors"), [(4, False), (8, True)])
def test_a_loop_that_wakes_for_each_answer_gets_what_is_derived(digits: int, motors: bool) -> None:
    bench = FakeBench("rs232_watchdog", enable=motors, poll_hz=60.0, look_s=LOOK_S)
    bench.fake.reply_delay_s = 0.0
    hz = measured_hz(bench, digits, (0.01, 0.01) if motors else None)
    assert 0.95 < hz / pairs_per_s(digits, 2.5 if motors else 0.0) < 1.06
    assert bench.ax.status.rejected == 0
    assert (bench.wheels.power() != (0.0, 0.0)) is motors


@pytest.mark.parametrize(("poll_hz", "look_s"), [(5.0, math.inf), (30.0, math.inf), (20.0, LOOK_S)])
def test_the_paced_line_carries_the_pairs_that_are_asked_for(poll_hz: float, look_s: float) -> None:
    bench = FakeBench(poll_hz=poll_hz, look_s=look_s)
    assert measured_hz(bench, 6) == pytest.approx(poll_hz, rel=0.02, abs=0.25)
    assert (bench.ax.status.rejected, bench.ax.status.cause) == (0, "")


def test_more_than_fits_is_said_with_figures() -> None:
    bench = FakeBench(poll_hz=30.0)
    bench.fake.reply_delay_s = 0.025
    bench.start(seconds=4.0)
    hz = measured_hz(bench, 6)
    asked, _, fits = bench.ax.status.cause.partition(" pairs/s asked, ")
    assert asked == "30"
    assert float(fits.removesuffix(" fit")) == pytest.approx(hz, rel=0.1)


@pytest.mark.parametrize("delay_s", few([0.08, 0.04], 1))
def test_a_slow_controller_is_still_polled_by_turns(delay_s: float) -> None:
    """Two counters and at most one slow value: no gap beyond that, and no restart made up."""
    bench = FakeBench(poll_hz=20.0, look_s=LOOK_S)
    bench.fake.reply_delay_s = delay_s
    bench.start()
    bench.wheels.counts_per_s = [1500.0, 1490.0]
    measured = bench.run(3.0)
    exchange_s = 0.012 + delay_s
    assert len(measured) / 3.0 > 0.95 / (3 * exchange_s + 0.01)
    gaps_s = [b.t_s - a.t_s for a, b in itertools.pairwise(measured)]
    assert max(gaps_s) < 3 * exchange_s + 0.03 < 0.4
    assert {counts.restarts for counts in measured} == {0}
    taken_s = bench.ax.stream.controller.taken_s
    assert bench.now_s - min(taken_s["^89"], taken_s["?I"]) < 2.5


@pytest.mark.parametrize("delay_s", few([0.06, 0.002], 1))
def test_a_stick_that_moves_all_the_time_leaves_the_counters_their_turn(delay_s: float) -> None:
    """Between two pairs at most seven exchanges: two commands, a counter, two, a slow value."""
    bench = FakeBench("rs232_watchdog", enable=True, poll_hz=20.0, look_s=LOOK_S)
    bench.fake.reply_delay_s = delay_s
    bench.start((0.0, 0.0))
    measured = []
    for k in range(100):
        wish = 0.2 + 0.005 * k
        measured += bench.run(0.02, (wish, wish))
    gaps_s = [b.t_s - a.t_s for a, b in itertools.pairwise(measured)]
    assert max(gaps_s) < 7 * (delay_s + 0.0125)
    assert (bench.ax.status.losses, bench.ax.motors.why_off) == (0, "")
    assert min(bench.wheels.power()) > 0.3
    bench.run(0.1 + 3 * (delay_s + 0.012), (0.0, 0.0))  # the exchange under way, and two zeros
    assert bench.wheels.power() == (0.0, 0.0)


def remark_at(schedule: Schedule, now_s: float) -> str:
    if now_s >= schedule.judge_s:
        schedule.judge(now_s, 0.0)
    return schedule.remark


def test_a_controller_that_turns_slow_and_quick_again_is_told_and_no_longer_told() -> None:
    schedule = Schedule(20.0)
    schedule.begin(0.0)
    told = []
    for k in range(600):
        schedule.counter_took(0.08 if 100 <= k < 300 else 0.015)
        told.append(remark_at(schedule, 0.1 * k))
    assert told[0] == told[-1] == ""
    assert "20 pairs/s asked, 5 fit" in told
    assert sum(a != b for a, b in itertools.pairwise(told)) == 2


def test_nearly_all_the_pairs_that_are_asked_are_no_complaint() -> None:
    for exchange_s, remark in ((0.0142, ""), (0.0158, ""), (0.02, "30 pairs/s asked, 23 fit")):
        schedule = Schedule(30.0)
        schedule.begin(0.0)
        for _ in range(200):
            schedule.counter_took(exchange_s)
        assert remark_at(schedule, 4.9) == ""
        assert remark_at(schedule, 6.0) == remark


def test_counts_are_true_at_their_instant_when_heard_between_ticks() -> None:
    bench = FakeBench(poll_hz=30.0, look_s=LOOK_S)
    bench.start()
    bench.wheels.counts_per_s = [1500.0, 1500.0]
    measured = bench.run(2.0)[10:]
    assert len(measured) > 30
    zero = measured[0].left - 1500.0 * measured[0].t_s
    for counts in measured:
        assert counts.left - zero == pytest.approx(1500.0 * counts.t_s, abs=4)
        assert counts.right == pytest.approx(counts.left, abs=4)


@pytest.mark.parametrize("delay_s", few([0.004, 0.0], 1))
def test_an_answer_that_lies_in_the_line_for_a_step_has_its_true_time(delay_s: float) -> None:
    """Steps come each 20 ms, and turns when one is due: hardly any, and no pair too few."""
    bench = FakeBench(poll_hz=20.0, look_s=LOOK_S)
    bench.fake.reply_delay_s = delay_s
    bench.start()
    bench.wheels.counts_per_s = [1500.0, 1500.0]
    measured, own_turns = [], 0
    for k in range(12_000):
        bench.elapse(LOOK_S)
        if k % 40 == 0:
            measured += bench.ax.step(bench.now_s)
        elif bench.now_s >= bench.ax.status.due_s > -math.inf:
            own_turns += 1
            bench.ax.hear(bench.now_s)
        bench.wire.step(bench.now_s)
    assert len(measured) == pytest.approx(120, abs=2)
    assert own_turns < 60  # of 240 answers; slow values, which are looked at in time, are 21
    zero = measured[10].left - 1500.0 * measured[10].t_s
    for counts in measured[10:]:
        assert counts.left - zero == pytest.approx(1500.0 * counts.t_s, abs=2)
        assert counts.right == pytest.approx(counts.left, abs=2)
