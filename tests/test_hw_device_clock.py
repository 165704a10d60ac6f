"""Device time to host time, against a simulated clock whose truth is known."""

import doctest
import math

import numpy as np
import pytest

from hw import device_clock
from hw.device_clock import DeviceClock

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


def test_the_same_samples_give_the_same_times_to_the_bit() -> None:
    one, two = (DeviceClock(MICROSECOND, WRAP_32) for _ in range(2))
    first = errors_s(one, rate_hz=50, drift=1e-4, jitter_s=0.005, seconds=10)
    assert np.array_equal(first, errors_s(two, rate_hz=50, drift=1e-4, jitter_s=0.005, seconds=10))


def test_the_examples_in_the_text_are_true() -> None:
    assert doctest.testmod(device_clock).failed == 0
