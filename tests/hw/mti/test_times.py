"""When a sample was taken: the wire's share, wraps, and devices without a clock.

What jitter, bursts, losses and drift do to a clock is tested in tests/hw/test_clock.py.
"""

import math

import numpy as np
import pytest

from hw.mti.sample import MtSample
from hw.mti.times import ARRIVAL_UNCERTAINTY_S, LATENCY_S, RateWatch, SampleTimes

PERIOD_S, BYTE_S, BYTES = 0.01, 10 / 115200, 55
SENT_S = LATENCY_S + BYTES * BYTE_S  # 7.3 ms, the figure of the sheet


class Line:
    """Samples on their way from a device; errors of the times they get."""

    def __init__(self, wrap: int | None = None) -> None:
        self.times, self.wrap = SampleTimes(PERIOD_S, BYTE_S), wrap
        self.number, self.taken_s = 65_000, 100.0
        self.ticks = (wrap or 0) - 50_000  # 5 s before its wrap

    def errors_s(self, seconds: float) -> list[float]:
        """Of all samples that arrived in that time."""
        errors = []
        for _ in range(round(seconds / PERIOD_S)):
            self.taken_s += PERIOD_S
            self.number, self.ticks = self.number + 1, self.ticks + 100
            fine = None if self.wrap is None else self.ticks % self.wrap
            sample = MtSample(counter=self.number % 65536, fine_ticks=fine)
            errors.append(self.times.t_s(sample, self.taken_s + SENT_S, BYTES) - self.taken_s)
        return errors


def test_the_time_from_sampling_to_the_last_byte_is_that_of_the_sheet() -> None:
    assert pytest.approx(0.0073, abs=5e-5) == SENT_S
    assert np.abs(Line().errors_s(1.0)).max() < 1e-9


@pytest.mark.parametrize("wrap", [None, 864_000_000, 2**32])
def test_a_counter_and_a_fine_time_run_on_over_their_wraps(wrap: int | None) -> None:
    line = Line(wrap)
    assert np.abs(line.errors_s(15.0)).max() < 1e-6
    assert line.times.locked


def test_a_counter_that_begins_anew_is_dated_by_its_arrival_at_once() -> None:
    line = Line()
    line.errors_s(5.0)
    line.number, line.taken_s = 30_000, line.taken_s + 3.0
    assert np.abs(line.errors_s(3.0)).max() < 0.001


def test_samples_without_counter_and_stamp_are_dated_by_their_arrival_and_never_locked() -> None:
    times = SampleTimes(PERIOD_S, BYTE_S)
    for k in range(500):
        t_s = times.t_s(MtSample(), 50.0 + 0.01 * k, BYTES)
        assert t_s == pytest.approx(50.0 + 0.01 * k - SENT_S)
    assert not times.locked
    assert times.uncertainty_s == ARRIVAL_UNCERTAINTY_S


def watched(period_s: float, seconds: float, steps: int = 1) -> RateWatch:
    """A device set to 200 Hz that sends every period_s."""
    watch = RateWatch(0.005)
    for k in range(round(seconds / period_s)):
        watch.count(steps, 16e-3 * math.ceil(k * period_s / 16e-3))  # in bursts
    return watch


@pytest.mark.parametrize(
    ("period_s", "steps", "remark"),
    [
        (1 / 120, 1, "the MTi sends 120 samples a second, not 200 as it was told"),
        (0.005, 1, ""),
        (0.010, 2, ""),  # samples lost on the line
    ],
)
def test_a_device_that_sends_less_than_it_was_told_is_noticed(
    period_s: float, steps: int, remark: str
) -> None:
    assert watched(period_s, 3.0, steps).remark == remark


def test_a_counter_that_begins_anew_begins_the_watch_anew() -> None:
    watch = watched(0.005, 1.9)
    watch.count(0, 60.0)
    for k in range(500):
        watch.count(1, 60.0 + 0.005 * k)
    assert watch.remark == ""
