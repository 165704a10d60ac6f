"""Two counters made continuous: common instants, wraps, misreadings, outages, restarts."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hw.ax3500.counters import Pair, WheelCounters
from hw.device import BadFrame

MAX_COUNTS_PER_S = 2122.0  # 1 m/s at 0.15 m and 2000 counts a turn


def signed(count: int) -> int:
    """As the controller holds it, with two's complement wrap."""
    return (count + 2**31) % 2**32 - 2**31


def drive(
    counters: WheelCounters, raws: list[tuple[int, int]], begin_s: float, period_s: float = 0.05
) -> list[Pair | BadFrame]:
    """Read channel 1, then 0 12 ms later, each period."""
    results = []
    for k, (one, two) in enumerate(raws):
        t_s = begin_s + k * period_s
        results += [counters.take(1, t_s, two), counters.take(0, t_s + 0.012, one)]
    return [result for result in results if result is not None]


def pairs(results: list[Pair | BadFrame]) -> list[Pair]:
    return [result for result in results if isinstance(result, Pair)]


def test_both_channels_are_brought_to_one_instant() -> None:
    counters = WheelCounters(MAX_COUNTS_PER_S, 0.5)
    times_s = [0.05 * k for k in range(40)]
    travel = [530.0 * t_s**2 for t_s in times_s]  # 0.5 m/s2 on both wheels
    late = [530.0 * (t_s + 0.012) ** 2 for t_s in times_s]
    raws = [(int(one), int(two)) for one, two in zip(late, travel, strict=True)]
    results = pairs(drive(counters, raws, 0.0))
    assert len(results) == 39
    uncorrected = max(abs(one - two) for one, two in raws)
    bound = 1.0 + 530.0 * 0.05**2 / 4  # one count, and the sagitta of a quadratic over a period
    assert uncorrected > 10 * bound
    for pair in results:
        assert abs(pair.one - pair.two) <= bound


@given(
    begin=st.sampled_from([2**31 - 300, -(2**31) + 300, 0]),
    steps=st.lists(st.tuples(st.integers(-100, 100), st.integers(-100, 100)), min_size=2),
)
def test_travel_is_continuous_over_the_wrap(begin: int, steps: list[tuple[int, int]]) -> None:
    counters = WheelCounters(MAX_COUNTS_PER_S, 0.5)
    one = two = begin
    raws = []
    for step_one, step_two in steps:
        one, two = one + step_one, two + step_two
        raws.append((signed(one), signed(two)))
    begin = signed(begin + steps[0][1]) - steps[0][1]  # the first reading is the zero
    results = drive(counters, raws, 0.0)
    assert len(pairs(results)) == len(results) == len(steps) - 1
    assert counters.restarts == 0
    travelled = pairs(results)[-1].two - begin
    assert travelled == sum(step for _, step in steps)


@pytest.mark.parametrize("direction", [1, -1])
def test_travel_is_continuous_where_the_counter_goes_on_from_zero(direction: int) -> None:
    counters = WheelCounters(MAX_COUNTS_PER_S, 0.5)
    end = 2**31 if direction > 0 else 2**31 + 1
    travel = [end - 200 + 50 * k for k in range(10)]
    rolled = [direction * (count - end if count >= end else count) for count in travel]
    results = drive(counters, [(count, count) for count in rolled], 0.0)
    assert len(pairs(results)) == len(results) == 9
    assert counters.restarts == 0
    assert pairs(results)[-1].two - rolled[0] == direction * 450


@given(st.integers(1, 18), st.integers(0, 1), st.integers(-(2**31), 2**31 - 1))
def test_one_misread_counter_is_dropped_and_leaves_no_trace(
    at: int, channel: int, misread: int
) -> None:
    counters = WheelCounters(MAX_COUNTS_PER_S, 0.5)
    raws = [[100_000 + 40 * k, 100_000 + 40 * k] for k in range(20)]
    raws[at][channel] = misread
    results = drive(counters, [(one, two) for one, two in raws], 0.0)
    if abs(misread - (100_000 + 40 * at)) > 250:
        assert sum(isinstance(result, BadFrame) for result in results) == 1
    last = pairs(results)[-1]
    assert last.two == 100_000 + 40 * 19
    assert counters.restarts == 0


def test_counters_that_stay_elsewhere_are_believed_in_the_end_without_travel() -> None:
    counters = WheelCounters(MAX_COUNTS_PER_S, 0.5)
    drive(counters, [(50 * k, 50 * k) for k in range(10)], 0.0)
    results = drive(counters, [(70_000 + 50 * k, 90_000 + 50 * k) for k in range(10)], 0.5)
    assert counters.restarts == 1
    assert sum(isinstance(result, BadFrame) for result in results) <= 6
    assert pairs(results)[-1].two == 90_450


def test_both_counters_back_near_zero_are_a_restart_at_once() -> None:
    counters = WheelCounters(MAX_COUNTS_PER_S, 0.5)
    drive(counters, [(80_000, 80_000), (80_010, 80_010)], 0.0)
    results = drive(counters, [(0, 0), (0, 0), (4, 4), (8, 8)], 0.1)
    assert counters.restarts == 1
    assert sum(isinstance(result, BadFrame) for result in results) == 2
    assert pairs(results)[-1].two == 8


@pytest.mark.parametrize(
    ("before", "after", "at_s", "restarts", "travel"),
    [
        ([50_000, 50_010], [54_000, 54_010], 5.0, 0, 54_010),  # the zero was kept
        ([50_000, 50_010], [30, 40], 60.0, 1, 40),  # long enough to have driven back to it
        ([500, 500], [500, 500], 10.0, 0, 500),  # stood still near zero
        ([0, 50], [1000, 1050], 0.8, 0, 1050),  # left it behind over a short outage
        ([0, -50], [-1000, -1050], 0.8, 0, -1050),
        ([900, 910], [20, 30], 1.2, 1, 30),  # fell back
    ],
)
def test_an_outage_is_told_from_a_restart(
    before: list[int], after: list[int], at_s: float, restarts: int, travel: int
) -> None:
    counters = WheelCounters(MAX_COUNTS_PER_S, 0.5)
    drive(counters, list(zip(before, before, strict=True)), 0.0)
    results = drive(counters, list(zip(after, after, strict=True)), at_s)
    assert (counters.restarts, counters.unpowered_s) == (restarts, math.inf)
    assert pairs(results)[-1].two == travel


def test_counters_that_cannot_have_come_so_far_since_zero_have_not_restarted() -> None:
    counters = WheelCounters(MAX_COUNTS_PER_S, 0.3)
    drive(counters, [(2100, 2100), (2090, 2090)], 0.0)
    drive(counters, [(1800, 1800), (1790, 1790)], 0.45)  # 0.4 s: from zero 1273 at most
    assert counters.restarts == 0


def test_a_slow_pace_is_no_outage() -> None:
    counters = WheelCounters(MAX_COUNTS_PER_S, 0.5)
    drive(counters, [(15 * k, 15 * k) for k in range(20)], 0.0, period_s=0.3)
    results = drive(counters, [(900, 900), (915, 915)], 6.3)  # one pair was lost: 0.6 s
    assert len(pairs(results)) == len(results) == 2


def test_a_told_restart_makes_the_next_readings_the_new_zero() -> None:
    counters = WheelCounters(MAX_COUNTS_PER_S, 0.5)
    counters.forget_zero()  # before anything was known: nothing is lost
    drive(counters, [(100, 100), (110, 110)], 0.0)
    assert counters.restarts == 0
    counters.forget_zero(0.09)
    results = drive(counters, [(0, 0), (5, 5)], 0.1)
    assert (counters.restarts, counters.unpowered_s) == (1, 0.09)
    [pair] = pairs(results)
    assert pair.t_s == pytest.approx(0.15)
    assert pair.one == pytest.approx(5 * 38 / 50)
    assert pair.two == 5


@given(st.lists(st.tuples(st.integers(0, 1), st.floats(0, 1), st.integers(-(2**31), 2**31 - 1))))
def test_no_readings_raise_and_instants_only_go_forward(
    readings: list[tuple[int, float, int]],
) -> None:
    counters = WheelCounters(MAX_COUNTS_PER_S, 0.5)
    t_s, last_s = 0.0, -1.0
    for channel, dt_s, raw in readings:
        t_s += dt_s
        result = counters.take(channel, t_s, raw)
        if isinstance(result, Pair):
            assert last_s <= result.t_s <= t_s
            last_s = result.t_s
