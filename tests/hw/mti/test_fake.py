"""The MTi session on the fake sensor: true attitudes at true instants, and its faults.

What jitter, bursts, losses and drift do to a clock is tested in tests/hw/test_clock.py.
"""

import math

import numpy as np
import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from core.records import Attitude
from fakes.mti.models import MODELS
from hw.mti.sample import MtSample
from hw.mti.times import ARRIVAL_UNCERTAINTY_S, LATENCY_S, RateWatch, SampleTimes
from tests.support.cases import examples
from tests.support.devices.mti_frames import wire
from tests.support.devices.scripted_mti import TICK_S, YAW_RADPS, Bench, Scripted, motion_at


def yaw_rad(attitude: Attitude) -> float:
    w, x, y, z = attitude.q_earth_sensor
    return math.atan2(2 * (x * y + w * z), 1 - 2 * (y * y + z * z))


def late_s(attitude: Attitude) -> float:
    """How much later the time stamp is than the instant at which the robot looked that way."""
    off_rad = YAW_RADPS * attitude.t_s - yaw_rad(attitude)
    return math.remainder(off_rad, math.tau) / YAW_RADPS


def test_bursts_and_drift_move_the_instants_by_a_tick_at_most() -> None:
    bench = Bench(Scripted())
    bench.device.burst_s, bench.device.drift_ppm = 0.016, 200.0
    bench.run(9.0)
    lates_s = [late_s(attitude) for attitude in bench.run(2.0)]
    # arrivals are seen in ticks, whose phase against the samples slides with the drift
    assert max(map(abs, lates_s)) < TICK_S + 0.0015


@pytest.mark.parametrize("model", MODELS)
def test_every_model_gives_the_attitudes_of_the_world_with_x_to_the_north(model: str) -> None:
    bench = Bench(Scripted(model))
    if model in ("MTi-28", "MTi-30"):
        bench.device.exchange(0.0, wire("GoToConfig"))  # by another host
    bench.run(2.5)
    assert (bench.state(), bench.cause()) == ("running", "")
    attitudes = bench.run(0.5)
    assert len(attitudes) == pytest.approx(50, abs=2)
    assert bench.mti.status.rejected == bench.mti.status.missed == 0
    assert bench.mti.clock_locked
    assert 0 < bench.mti.measured()["clock_uncertainty_s"] < 0.002
    for attitude in attitudes:
        assert -0.003 < late_s(attitude) < TICK_S + 0.001  # it is seen in the tick after it came
        w, x, y, z = attitude.q_earth_sensor
        down = (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y))
        np.testing.assert_allclose(down, motion_at(0.0)[0][2], atol=1e-6)
        np.testing.assert_allclose(attitude.rate_radps, motion_at(0.0)[1], atol=1e-6)
        assert attitude.magnetic is not None
        R, _, _ = motion_at(attitude.t_s)
        np.testing.assert_allclose(R @ attitude.magnetic, bench.device.earth_field, atol=0.02)
        if model in ("MTi-28", "MTi-G"):  # newer ones are not asked for what they feel
            felt = motion_at(attitude.t_s)[2]
            np.testing.assert_allclose(attitude.accel_mps2 or (), felt, atol=0.12)
        else:
            assert attitude.accel_mps2 is None


@pytest.mark.parametrize(("model", "forgets"), [("MTi-28", False), *((m, True) for m in MODELS)])
def test_every_model_is_found_again_after_a_brown_out(model: str, forgets: bool) -> None:
    bench = Bench(Scripted(model))
    assert bench.run_until("running", 3.0)
    bench.device.brown_out(bench.now_s, forgets=forgets)
    bench.run(0.5)
    assert bench.run_until("running", 3.0)
    assert (bench.cause(), bench.mti.status.losses) == ("", 1)


class Life(RuleBasedStateMachine):
    """Faults come and go; once they are gone attitudes come again, at their instants."""

    @initialize(model=st.sampled_from(["MTi-28", "MTi-30"]))
    def begin(self, model: str) -> None:
        self.bench = Bench(Scripted(model))

    @rule(mute=st.booleans())
    def silence(self, mute: bool) -> None:
        self.bench.device.mute = mute

    @rule(cut=st.booleans())
    def pull(self, cut: bool) -> None:
        self.bench.wire.cut = cut

    @rule(rate=st.sampled_from([0.0, 0.001, 0.01]))
    def damage(self, rate: float) -> None:
        self.bench.wire.damage_rate = self.bench.wire.drop_rate = rate

    @rule(rate=st.sampled_from([0.0, 0.3]))
    def fail_checksums(self, rate: float) -> None:
        self.bench.device.wrong_checksum_rate = rate

    @rule(acks=st.integers(0, 3))
    def swallow(self, acks: int) -> None:
        self.bench.device.deaf_acks = acks

    @rule(forgets=st.booleans())
    def brown_out(self, forgets: bool) -> None:
        self.bench.device.brown_out(self.bench.now_s, forgets=forgets)

    @rule(wrong=st.sampled_from(["nan", "frozen"]), on=st.booleans())
    def spoil(self, wrong: str, on: bool) -> None:
        setattr(self.bench.device, wrong, on)

    @rule(seconds=st.sampled_from([0.02, 0.3, 1.5]))
    def wait(self, seconds: float) -> None:
        self.bench.run(seconds)

    @rule()
    def mend(self) -> None:
        bench = self.bench
        bench.device.mute = bench.device.nan = bench.device.frozen = bench.wire.cut = False
        bench.wire.damage_rate = bench.wire.drop_rate = bench.device.wrong_checksum_rate = 0.0
        bench.device.deaf_acks = 0
        bench.run(2.0)
        assert bench.run_until("running", 3.0)
        attitudes = bench.run(0.5)
        assert len(attitudes) >= 49
        assert all(-0.002 < late_s(attitude) < 0.025 for attitude in attitudes)

    @invariant()
    def says_why(self) -> None:
        assert self.bench.state() == "running" or self.bench.cause()


TestLife = Life.TestCase
TestLife.settings = settings(max_examples=examples(3), stateful_step_count=8)


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


@pytest.mark.parametrize("wrap", [None, 864_000_000, 2**32])
def test_a_counter_and_a_fine_time_run_on_over_their_wraps(wrap: int | None) -> None:
    assert pytest.approx(0.0073, abs=5e-5) == SENT_S
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
