"""When a sample was taken: jitter, bursts, drift, wraps, losses, and devices without a clock."""

import math
from random import Random

import numpy as np
import numpy.typing as npt
import pytest

from hw.mti.sample import MtSample
from hw.mti.times import ARRIVAL_UNCERTAINTY_S, LATENCY_S, RateWatch, SampleTimes

F64 = npt.NDArray[np.float64]
PERIOD_S, BYTE_S, BYTES = 0.01, 10 / 115200, 55
SENT_S = LATENCY_S + BYTES * BYTE_S  # 7.3 ms, the figure of the sheet


class Line:
    """Samples on their way from a device whose clock drifts; errors of the times they get."""

    def __init__(self, *, drift_ppm: float = 30.0, fine: bool = False, wrap: int = 2**32) -> None:
        self.times = SampleTimes(PERIOD_S, BYTE_S)
        self.random = Random(7)
        self.true_period_s = PERIOD_S * (1 + drift_ppm * 1e-6)
        self.fine, self.wrap = fine, wrap
        self.burst_s = self.jitter_s = self.lost_rate = 0.0
        self.number = 65_000
        self.ticks = wrap - 50_000  # 5 s before its wrap
        self.taken_s = 100.0

    def stamped(self) -> MtSample:
        if self.fine:
            return MtSample(counter=self.number % 65536, fine_ticks=self.ticks % self.wrap)
        return MtSample(counter=self.number % 65536)

    def errors_s(self, seconds: float) -> F64:
        """Of all samples that arrived in that time."""
        errors = []
        for _ in range(round(seconds / PERIOD_S)):
            self.taken_s += self.true_period_s
            self.number, self.ticks = self.number + 1, self.ticks + 100
            arrived_s = self.taken_s + SENT_S
            if self.jitter_s:
                arrived_s += self.random.expovariate(1 / self.jitter_s)
            if self.burst_s:
                arrived_s = math.ceil(arrived_s / self.burst_s) * self.burst_s
            if self.random.random() >= self.lost_rate:
                errors.append(self.times.t_s(self.stamped(), arrived_s, BYTES) - self.taken_s)
        return np.array(errors)


def test_the_time_from_sampling_to_the_last_byte_is_that_of_the_sheet() -> None:
    assert pytest.approx(0.0073, abs=5e-5) == SENT_S
    assert np.abs(Line(drift_ppm=0.0).errors_s(1.0)).max() < 1e-9


@pytest.mark.parametrize("fine", [False, True])
def test_bursts_of_an_adapter_as_shipped_with_losses_and_drift_leave_two_milliseconds(
    fine: bool,
) -> None:
    """10 ms against 16 ms: the least delayed of 8 samples waits for 2 ms at most."""
    line = Line(fine=fine)
    line.burst_s, line.lost_rate = 0.016, 0.05
    line.errors_s(12.0)
    assert line.times.locked
    errors_s = line.errors_s(20.0)
    assert errors_s.min() > -0.0005
    assert errors_s.max() < 0.0025
    assert np.abs(np.diff(errors_s)).max() < 0.0025  # when the window lets go of its best sample


@pytest.mark.parametrize("drift_ppm", [-200.0, 200.0])
def test_five_milliseconds_of_exponential_jitter_leave_one_for_99_of_100_samples(
    drift_ppm: float,
) -> None:
    line = Line(drift_ppm=drift_ppm)
    line.jitter_s = 0.005
    line.errors_s(15.0)
    assert np.quantile(np.abs(line.errors_s(20.0)), 0.99) < 0.001
    assert line.times.uncertainty_s < 0.003


@pytest.mark.parametrize("wrap", [None, 864_000_000, 2**32])
def test_a_counter_and_a_fine_time_run_on_over_their_wraps(wrap: int | None) -> None:
    line = Line(drift_ppm=0.0, fine=wrap is not None, wrap=wrap or 2**32)
    assert np.abs(line.errors_s(20.0)).max() < 1e-6
    assert line.times.locked


def test_a_counter_that_begins_anew_is_dated_by_its_arrival_at_once() -> None:
    line = Line(drift_ppm=0.0)
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


def test_a_device_that_sends_less_than_it_was_told_is_noticed() -> None:
    assert watched(1 / 120, 3.0).remark == (
        "the MTi sends 120 samples a second, not 200 as it was told"
    )


def test_a_device_that_loses_samples_on_the_line_is_not_taken_for_a_slow_one() -> None:
    assert watched(0.005, 3.0).remark == ""
    assert watched(0.010, 3.0, steps=2).remark == ""


def test_a_counter_that_begins_anew_begins_the_watch_anew() -> None:
    watch = watched(0.005, 1.9)
    watch.count(0, 60.0)
    for k in range(500):
        watch.count(1, 60.0 + 0.005 * k)
    assert watch.remark == ""
