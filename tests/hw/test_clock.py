"""Device time to host time, against a simulated clock whose truth is known."""

import doctest
import math

import numpy as np
import pytest

from hw import clock as device_clock
from hw.clock import DeviceClock
from tests.support.cases import few

MICROSECOND, WRAP_32 = 1e-6, 2**32


def fed(
    rate_hz: float,
    seed: int = 1,
    *,
    seconds: float = 60.0,
    jitter_s: float = 0.005,
    drift: float = 0.0,
    wander: float = 0.0,
    lost: float = 0.0,
    begin_s: float = 0.0,
) -> tuple[DeviceClock, np.ndarray]:
    """A clock, and (n, 4) of what it said: seconds, error, locked, uncertainty.

    The first sample is taken at 1000 s; its own clock then says begin_s and wanders in 2 minutes.
    """
    random = np.random.default_rng(seed)
    clock = DeviceClock(MICROSECOND, WRAP_32)
    rows, arrived_s, device_s = [], -math.inf, begin_s
    for k in range(int(seconds * rate_hz)):
        true_s = k / rate_hz
        arrived_s = max(arrived_s, 1000 + true_s + random.exponential(jitter_s))
        if random.random() >= lost:
            error_s = clock.host_s(round(device_s * 1e6) % WRAP_32, arrived_s) - (1000 + true_s)
            rows.append((true_s, error_s, clock.locked, clock.uncertainty_s))
        device_s += (1 + drift + wander * math.sin(2 * math.pi * true_s / 120)) / rate_hz
    return clock, np.array(rows, dtype=float)


def test_it_says_that_it_knows_nothing_yet_and_no_time_is_later_than_its_arrival() -> None:
    clock = DeviceClock(MICROSECOND, WRAP_32)
    assert clock.uncertainty_s == math.inf
    assert not clock.locked
    clock.host_s(0, 1.0)
    assert clock.uncertainty_s == device_clock.UNLOCKED_S
    random = np.random.default_rng(4)
    for k in range(2000):
        arrived_s = k * 0.02 + random.exponential(0.01)
        assert clock.host_s(k * 20_002, arrived_s) <= arrived_s + 1e-9


def test_wraps_while_no_sample_came_are_made_up_by_the_time_that_passed() -> None:
    clock = DeviceClock(0.01, 2**16)  # wraps every 655.36 s
    for k in range(200):
        clock.host_s(k, k * 0.01)
    ticks = 200 + 3 * 65_536 + 500
    assert clock.host_s(ticks % 65_536, ticks * 0.01) == pytest.approx(ticks * 0.01)
    assert clock.restarts == 0
    assert not clock.locked  # nothing of the window is left


def test_another_stamp_of_the_same_counter_is_placed_beside_the_newest_across_the_wrap() -> None:
    clock = DeviceClock(MICROSECOND, WRAP_32)
    assert clock.host_s(1_000, 50.0) == pytest.approx(50.0)
    assert clock.host_s_near(WRAP_32 - 2_000) == pytest.approx(49.997)
    assert clock.host_s_near(4_000) == pytest.approx(50.003)


def test_one_least_delay_tells_nothing_of_its_own_error() -> None:
    clock = DeviceClock(MICROSECOND, WRAP_32)
    for k in range(100):
        clock.host_s(k * 20_000, 1000.0 + k * 0.02)
    assert clock.locked
    window_s = device_clock.BUCKETS * device_clock.BUCKET_S
    after_s = 99 * 0.02 + window_s - 0.1  # a gap within the window, of which nothing kept is left
    clock.host_s(round(after_s * 1e6), 1000.0 + after_s)
    assert clock.restarts == 0
    assert clock.uncertainty_s == device_clock.UNLOCKED_S
    assert not clock.locked


PROMISED = [(10, 0.8e-3, 0.8e-3), (25, 0.75e-3, 0.45e-3), (50, 0.75e-3, 0.2e-3)]
PROMISED += [(100, 0.75e-3, 0.15e-3)]
DRIFTS = [(0.0, 0.0), (200e-6, 0.0), (-200e-6, 0.0), (100e-6, 100e-6)]
CASES = [(*PROMISED[k % 4], *DRIFTS[(k + k // 4) % 4]) for k in range(16)]


@pytest.mark.parametrize(
    ("rate_hz", "from_lock_s", "later_s", "drift", "wander"), few(CASES, len(PROMISED))
)
def test_times_keep_the_promise_and_the_uncertainty_covers_their_errors(
    rate_hz: float, from_lock_s: float, later_s: float, drift: float, wander: float
) -> None:
    runs = [fed(rate_hz, seed, drift=drift, wander=wander) for seed in range(6)]
    assert {clock.restarts for clock, _ in runs} == {0}
    rows = np.vstack([rows for _, rows in runs])
    locked = rows[rows[:, 2] > 0]
    assert np.percentile(np.abs(locked[:, 1]), 99) < from_lock_s
    assert np.percentile(np.abs(locked[locked[:, 0] > 13, 1]), 99) < later_s
    for begin_s, end_s in ((0.0, 2.0), (2.0, 6.0), (6.0, 60.0)):
        part = rows[(rows[:, 0] >= begin_s) & (rows[:, 0] < end_s)]
        assert np.mean(np.abs(part[:, 1]) <= part[:, 3]) >= 0.95
    assert rows[rows[:, 0] > 2, 2].mean() > 0.99  # and is small enough to be locked


@pytest.mark.parametrize(
    "how",
    [{"begin_s": 4294.967296 - 30}, {"lost": 0.5}, {"drift": 200e-6}],
    ids=["the counter wraps", "every second sample is lost", "drift"],
)
def test_times_stay_right_whatever_the_stream(how: dict[str, float]) -> None:
    clock, rows = fed(50, **how)  # type: ignore[arg-type]
    assert np.percentile(np.abs(rows[100:, 1]), 99) < 1e-3
    assert np.percentile(np.abs(rows[:, 1]), 99) < 2e-3  # from the very first sample
    assert clock.restarts == 0


@pytest.mark.parametrize("new_start_s", [0.0, 15.0, 999.0, 3000.0])
def test_a_reboot_is_noticed_at_the_first_sample_and_counted_once(new_start_s: float) -> None:
    clock, _ = fed(50, seconds=10, jitter_s=0.002, begin_s=1000.0)
    assert clock.restarts == 0
    for k in range(100):
        true_s = 1030.0 + k * 0.02
        ticks = round((new_start_s + k * 0.02) * 1e6)
        assert clock.host_s(ticks, true_s + 0.001) == pytest.approx(true_s, abs=2e-3)
    assert clock.restarts == 1


@pytest.mark.parametrize(("stalled_s", "restarts", "error_s"), [(1.5, 0, 1e-3), (10.0, 1, 0.03)])
def test_a_backlog_of_a_stalled_host_heals(stalled_s: float, restarts: int, error_s: float) -> None:
    clock, _ = fed(50, seconds=10, jitter_s=0.001)
    errors_s = [
        clock.host_s(k * 20_000, 1010.0 + stalled_s) - (1000 + k * 0.02)
        for k in range(500, 500 + round(stalled_s * 50))
    ]
    assert np.abs(errors_s if restarts == 0 else errors_s[-1]).max() < error_s
    assert clock.restarts <= restarts


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


@pytest.mark.parametrize(
    ("host_slept_s", "restarts"), [(0.0, 1), (60.0, 0)], ids=["its clock slept too", "a gap"]
)
def test_a_device_that_went_on_is_placed_at_once(host_slept_s: float, restarts: int) -> None:
    clock = DeviceClock(MICROSECOND, WRAP_32)
    for k in range(500):
        clock.host_s(k * 20_000, k * 0.02)
    for k in range(500, 600):  # 60 s of the device's time later
        now_s = k * 0.02 + host_slept_s
        host_s = clock.host_s(k * 20_000 + 60_000_000, now_s + 0.001)
        assert host_s == pytest.approx(now_s, abs=2e-3)
    assert clock.restarts == restarts
    assert clock.locked


def test_it_keeps_a_bounded_number_of_samples() -> None:
    clock = DeviceClock(MICROSECOND, WRAP_32)
    for k in range(5000):
        clock.host_s(k * 10_000, k * 0.01 + 1e-6 * (k * 7 % 1000))
        assert len(clock._least) <= device_clock.BUCKETS
    assert doctest.testmod(device_clock).failed == 0
