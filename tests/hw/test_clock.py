"""Device time to host time, against a simulated clock whose truth is known."""

import doctest
import math

import numpy as np
import pytest

from hw import clock as device_clock
from hw.clock import DeviceClock

MICROSECOND, WRAP_32 = 1e-6, 2**32


def errors_s(
    clock: DeviceClock,
    *,
    rate_hz: float,
    drift: float,
    jitter_s: float,
    start_device_s: float = 0.0,
    seconds: float = 60.0,
    lost: float = 0.0,
    seed: int = 1,
) -> np.ndarray:
    """What the clock says minus the truth, for each sample that came; a stream keeps its order."""
    random = np.random.default_rng(seed)
    errors, arrived_s = [], -math.inf
    for k in range(int(seconds * rate_hz)):
        true_s = 1000.0 + k / rate_hz
        ticks = round((start_device_s + (true_s - 1000.0) * (1 + drift)) * 1e6) % WRAP_32
        arrived_s = max(arrived_s, true_s + random.exponential(jitter_s))
        if random.random() >= lost:
            errors.append(clock.host_s(ticks, arrived_s) - true_s)
    return np.array(errors)


@pytest.mark.parametrize("drift", [0.0, 200e-6, -200e-6])
@pytest.mark.parametrize("rate_hz", [25, 50, 100])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_times_are_right_within_a_millisecond_for_99_of_100_samples(
    drift: float, rate_hz: float, seed: int
) -> None:
    clock = DeviceClock(MICROSECOND, WRAP_32)
    off_s = errors_s(clock, rate_hz=rate_hz, drift=drift, jitter_s=0.005, seed=seed)
    assert np.percentile(np.abs(off_s[int(2 * rate_hz) :]), 99) < 1e-3
    assert np.percentile(np.abs(off_s), 99) < 2e-3  # from the very first sample
    assert clock.restarts == 0
    assert clock.locked
    assert 0 < clock.uncertainty_s < 1e-3


def test_a_time_is_never_later_than_its_arrival() -> None:
    clock = DeviceClock(MICROSECOND, WRAP_32)
    random = np.random.default_rng(4)
    for k in range(2000):
        arrived_s = k * 0.02 + random.exponential(0.01)
        assert clock.host_s(k * 20_002, arrived_s) <= arrived_s + 1e-9


def test_a_wrap_of_the_counter_is_not_seen_in_the_times() -> None:
    clock = DeviceClock(MICROSECOND, WRAP_32)
    off_s = errors_s(
        clock, rate_hz=50, drift=100e-6, jitter_s=0.002, start_device_s=4294.967296 - 30
    )
    assert np.abs(off_s[100:]).max() < 1e-3
    assert clock.restarts == 0


def test_wraps_while_no_sample_came_are_made_up_by_the_time_that_passed() -> None:
    clock = DeviceClock(0.01, 2**16)  # wraps every 655.36 s
    for k in range(200):
        clock.host_s(k, k * 0.01)
    ticks = 200 + 3 * 65_536 + 500
    assert clock.host_s(ticks % 65_536, ticks * 0.01) == pytest.approx(ticks * 0.01)
    assert clock.restarts == 0
    assert not clock.locked  # nothing of the window is left


def test_lost_samples_do_no_harm() -> None:
    clock = DeviceClock(MICROSECOND, WRAP_32)
    off_s = errors_s(clock, rate_hz=50, drift=200e-6, jitter_s=0.005, lost=0.5)
    assert np.percentile(np.abs(off_s[100:]), 99) < 1e-3
    assert clock.restarts == 0


@pytest.mark.parametrize("new_start_s", [0.0, 15.0, 999.0, 3000.0])
def test_a_reboot_is_noticed_at_the_first_sample_and_counted_once(new_start_s: float) -> None:
    clock = DeviceClock(MICROSECOND, WRAP_32)
    errors_s(clock, rate_hz=50, drift=0, jitter_s=0.002, start_device_s=1000.0, seconds=10)
    assert clock.restarts == 0
    for k in range(100):
        true_s = 1030.0 + k * 0.02
        ticks = round((new_start_s + k * 0.02) * 1e6)
        assert clock.host_s(ticks, true_s + 0.001) == pytest.approx(true_s, abs=2e-3)
    assert clock.restarts == 1


def test_a_clock_that_goes_back_by_a_moment_has_begun_anew() -> None:
    clock = DeviceClock(MICROSECOND, WRAP_32)
    for k in range(50):
        clock.host_s(k * 20_000, k * 0.02)
    assert clock.host_s(0, 1.0) == pytest.approx(1.0)
    assert clock.restarts == 1


def test_a_backlog_after_a_stalled_host_is_put_where_it_belongs() -> None:
    clock = DeviceClock(MICROSECOND, WRAP_32)
    off_s = errors_s(clock, rate_hz=50, drift=0, jitter_s=0.001, seconds=10)
    assert len(off_s) == 500
    for k in range(500, 575):  # 1.5 s of samples come at once
        assert clock.host_s(k * 20_000, 1011.5) == pytest.approx(1000 + k * 0.02, abs=1e-3)
    assert clock.restarts == 0


def test_a_worse_backlog_heals_itself_within_the_burst() -> None:
    clock = DeviceClock(MICROSECOND, WRAP_32)
    errors_s(clock, rate_hz=50, drift=0, jitter_s=0.001, seconds=10)
    times_s = [clock.host_s(k * 20_000, 1020.0) for k in range(500, 1000)]
    assert times_s[-1] == pytest.approx(1000 + 999 * 0.02, abs=0.03)
    assert clock.restarts <= 1


def test_another_stamp_of_the_same_counter_is_placed_beside_the_newest_across_the_wrap() -> None:
    clock = DeviceClock(MICROSECOND, WRAP_32)
    assert clock.host_s(1_000, 50.0) == pytest.approx(50.0)
    assert clock.host_s_near(WRAP_32 - 2_000) == pytest.approx(49.997)
    assert clock.host_s_near(4_000) == pytest.approx(50.003)


def test_it_says_that_it_knows_nothing_yet() -> None:
    clock = DeviceClock(MICROSECOND, WRAP_32)
    assert clock.uncertainty_s == math.inf
    assert not clock.locked
    clock.host_s(0, 1.0)
    assert clock.uncertainty_s == device_clock.UNLOCKED_S


# --- what is promised, by rate


def run_of(
    rate_hz: float, seed: int, *, drift: float = 0.0, wander: float = 0.0, poll_s: float = 0.0
) -> np.ndarray:
    """(n, 4): seconds, error, locked, uncertainty of a minute; drift that wanders in 2 minutes."""
    random = np.random.default_rng(seed)
    clock = DeviceClock(MICROSECOND, WRAP_32)
    rows, arrived_s, device_s = [], -math.inf, 0.0
    for k in range(int(60 * rate_hz)):
        true_s = k / rate_hz
        device_s += (1 + drift + wander * math.sin(2 * math.pi * true_s / 120)) / rate_hz
        arrived_s = max(arrived_s, 1000 + true_s + random.exponential(0.005))
        read_s = math.ceil(arrived_s / poll_s) * poll_s if poll_s else arrived_s
        error_s = clock.host_s(round(device_s * 1e6), read_s) - (1000 + true_s + 1 / rate_hz)
        rows.append((true_s, error_s + 1 / rate_hz, clock.locked, clock.uncertainty_s))
    return np.array(rows, dtype=float)


PROMISED = [(10, 0.8e-3, 0.8e-3), (25, 0.75e-3, 0.45e-3), (50, 0.75e-3, 0.2e-3)]
PROMISED += [(100, 0.75e-3, 0.15e-3)]
DRIFTS = [(0.0, 0.0), (200e-6, 0.0), (-200e-6, 0.0), (100e-6, 100e-6)]


@pytest.mark.parametrize(("rate_hz", "from_lock_s", "later_s"), PROMISED)
@pytest.mark.parametrize(("drift", "wander"), DRIFTS)
def test_99_of_100_times_keep_the_promise_from_the_lock_on_and_a_better_one_later(
    rate_hz: float, from_lock_s: float, later_s: float, drift: float, wander: float
) -> None:
    rows = np.vstack([run_of(rate_hz, seed, drift=drift, wander=wander) for seed in range(4)])
    locked = rows[rows[:, 2] > 0]
    assert np.percentile(np.abs(locked[:, 1]), 99) < from_lock_s
    assert np.percentile(np.abs(locked[locked[:, 0] > 13, 1]), 99) < later_s


@pytest.mark.parametrize("rate_hz", [10, 25, 50, 100])
@pytest.mark.parametrize(("drift", "wander"), DRIFTS)
def test_the_uncertainty_covers_95_of_100_errors_also_right_after_the_lock(
    rate_hz: float, drift: float, wander: float
) -> None:
    rows = np.vstack([run_of(rate_hz, seed, drift=drift, wander=wander) for seed in range(6)])
    for begin_s, end_s in ((0.0, 2.0), (2.0, 6.0), (6.0, 60.0)):
        part = rows[(rows[:, 0] >= begin_s) & (rows[:, 0] < end_s)]
        assert np.mean(np.abs(part[:, 1]) <= part[:, 3]) >= 0.95
    assert rows[rows[:, 0] > 2, 2].mean() > 0.99  # and is small enough to be locked


def test_times_read_at_ticks_only_are_late_by_no_more_than_a_tick() -> None:
    rows = run_of(50, 1, drift=200e-6, poll_s=0.005)
    locked = rows[rows[:, 2] > 0, 1]
    assert locked.min() > -0.001
    assert locked.max() < 0.0055


def test_arrivals_too_uneven_to_tell_the_offset_never_lock() -> None:
    clock = DeviceClock(MICROSECOND, WRAP_32)
    random = np.random.default_rng(1)
    arrived_s = 0.0
    for k in range(600):
        arrived_s = max(arrived_s, k * 0.1 + random.exponential(0.2))
        clock.host_s(k * 100_000, arrived_s)
        assert not clock.locked
    assert clock.restarts == 0
    assert clock.uncertainty_s > device_clock.LOCK_BELOW_S


def test_a_device_that_went_on_while_the_host_and_its_clock_slept_is_placed_anew_at_once() -> None:
    clock = DeviceClock(MICROSECOND, WRAP_32)
    for k in range(500):
        clock.host_s(k * 20_000, k * 0.02)
    for k in range(500, 600):  # 60 s of the device's time, none of ours
        host_s = clock.host_s(k * 20_000 + 60_000_000, k * 0.02 + 0.001)
        assert host_s == pytest.approx(k * 0.02, abs=2e-3)
    assert clock.restarts == 1
    assert clock.locked


def test_a_clock_that_ran_on_while_the_host_slept_is_only_a_gap() -> None:
    clock = DeviceClock(MICROSECOND, WRAP_32)
    for k in [*range(500), *range(3500, 3600)]:
        assert clock.host_s(k * 20_000, k * 0.02 + 0.001) == pytest.approx(k * 0.02, abs=2e-3)
    assert clock.restarts == 0
    assert clock.locked


def test_it_keeps_a_bounded_number_of_samples() -> None:
    clock = DeviceClock(MICROSECOND, WRAP_32)
    for k in range(5000):
        clock.host_s(k * 10_000, k * 0.01 + 1e-6 * (k * 7 % 1000))
        assert len(clock._least) <= device_clock.BUCKETS


def test_the_same_samples_give_the_same_times_to_the_bit() -> None:
    one, two = (DeviceClock(MICROSECOND, WRAP_32) for _ in range(2))
    first = errors_s(one, rate_hz=50, drift=1e-4, jitter_s=0.005, seconds=10)
    assert np.array_equal(first, errors_s(two, rate_hz=50, drift=1e-4, jitter_s=0.005, seconds=10))


def test_the_examples_in_the_text_are_true() -> None:
    assert doctest.testmod(device_clock).failed == 0
