"""The LMS111 session on the fake scanner: true ranges at true instants, and its faults."""

import math
from typing import Literal

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from core.records import Scan
from fakes.lms1xx.device import FakeLms111
from fakes.wires.wire import MemoryPort, Wire
from hw.lms1xx.options import Lms1xxOptions
from hw.lms1xx.session import Lms111
from tests.support.cases import examples

F64 = npt.NDArray[np.float64]
TICK_S = 0.005
SPEED_MPS, LAP_S = 0.5, 20.0
RECOVERY_S = 12.0  # one command lost twice, a pause, a new start with its spin-up


def ranges_m_at(t_first_s: float, times_s: F64, bearings_rad: F64) -> F64:
    """Farther to the left and later: each range tells bearing and instant of its beam."""
    ranges_m: F64 = 4.0 + bearings_rad + SPEED_MPS * np.mod(times_s, LAP_S)
    return ranges_m


class Bench:
    """The fake, a wire, a clock, the session."""

    def __init__(
        self, rate_hz: Literal[25, 50] = 25, step_deg: float = 0.25, tick_s: float = TICK_S
    ) -> None:
        self.fake = FakeLms111(ranges_m_at, seed=1)
        self.fake.noise_m = 0.0
        self.port, self.now_s, self.tick_s = MemoryPort(), 50.0, tick_s
        self.wire = Wire(self.fake, self.port, seed=1)
        given = Lms1xxOptions("auto", rate_hz, step_deg, 30.0, 150.0, "first", [])
        self.lms = Lms111(self.port, given)

    @property
    def state(self) -> str:
        return self.lms.status.state

    def run(self, seconds: float) -> list[Scan]:
        scans = []
        for _ in range(round(seconds / self.tick_s)):
            self.wire.step(self.now_s)
            scans += self.lms.step(self.now_s)
            self.now_s += self.tick_s
        return scans


def late_s(scan: Scan) -> float:
    """How much later its time stamps are than the instants at which its beams were measured."""
    beams = np.arange(scan.ranges_m.shape[1], dtype=np.float64)
    times_s: F64 = scan.t_s + beams * scan.beam_dt_s
    bearings_rad: F64 = scan.first_rad + beams * scan.step_rad
    off_s = (ranges_m_at(0.0, times_s, bearings_rad) - scan.ranges_m[0]) / SPEED_MPS
    return float(np.mean(np.mod(off_s + LAP_S / 2, LAP_S) - LAP_S / 2))


@pytest.mark.parametrize(("rate_hz", "step_deg", "n"), [(25, 0.25, 481), (50, 0.5, 241)])
def test_beams_are_those_of_the_world_at_their_instants(
    rate_hz: Literal[25, 50], step_deg: float, n: int
) -> None:
    bench = Bench(rate_hz, step_deg)
    bench.run(2.0)
    scans = bench.run(2.0)
    status = bench.lms.status
    assert (status.state, status.cause) == ("running", "")
    assert len(scans) == 2 * rate_hz
    assert status.missed == status.rejected == 0
    assert bench.lms.clock_locked
    assert 0 < bench.lms.measured()["clock_uncertainty_s"] < 0.002
    for scan in scans:
        assert scan.ranges_m.shape == (1, n)
        assert -0.001 < late_s(scan) < TICK_S + 0.001  # it is seen in the tick after it came
        assert 0 < scan.arrived_s - scan.t_s < 0.05


def test_times_hold_while_the_devices_clock_drifts_and_the_wire_is_late() -> None:
    bench = Bench(50, 0.5, tick_s=0.001)
    bench.fake.drift_ppm = 200.0
    bench.fake.clock_offset_us = 2**32 - 6_000_000  # wraps on the way
    errors_s = []
    for tick in range(80):  # a delay that comes and goes, 0 to 30 ms
        bench.wire.delay_s = 0.01 * (1 + math.sin(tick)) if tick % 5 else 0.0
        errors_s += [abs(late_s(scan)) for scan in bench.run(0.1)]
    assert bench.state == "running"
    assert len(errors_s) > 370
    assert np.percentile(errors_s[100:], 99) < 0.002
    assert bench.lms.status.missed == 0


def test_a_device_without_its_newer_state_may_take_long_to_speed_up() -> None:
    bench = Bench(50, 0.5)
    bench.fake.refuse["STlms"] = 0x03
    bench.fake.spin_up_s = 12.0
    bench.run(2.0)
    power_ons = bench.fake.power_ons
    assert bench.run(14.0)
    assert bench.state == "running"
    assert bench.fake.power_ons == power_ons


def test_scans_that_are_not_valid_now_and_then_are_left_out_and_change_no_state() -> None:
    bench = Bench(50, 0.5)
    bench.run(3.0)
    taken = 0
    for turn in range(20):
        bench.fake.device_status = 1 - turn % 2
        taken += len(bench.run(0.1))
        assert bench.state == "running"
    assert taken == pytest.approx(50, abs=2)
    assert bench.lms.status.losses == 0


class Faults(RuleBasedStateMachine):
    """Faults come and go; the session runs again within its time-outs of their end."""

    def __init__(self) -> None:
        super().__init__()
        self.bench = Bench()

    @rule(seconds=st.floats(0.1, 4.0))
    def time_passes(self, seconds: float) -> None:
        self.bench.run(seconds)

    @rule(fault=st.sampled_from(["mute", "frozen"]), seconds=st.floats(0.1, 3.0))
    def silent_for(self, fault: str, seconds: float) -> None:
        setattr(self.bench.fake, fault, True)
        self.bench.run(seconds)
        setattr(self.bench.fake, fault, False)

    @rule(late_s=st.floats(0.0, 0.3))
    def late_by(self, late_s: float) -> None:
        self.bench.fake.late_s = late_s

    @rule(seconds=st.floats(0.1, 3.0), rate=st.floats(0.0, 0.002), chunk=st.integers(0, 300))
    def noisy_for(self, seconds: float, rate: float, chunk: int) -> None:
        wire = self.bench.wire
        wire.chunk, wire.damage_rate, wire.drop_rate = chunk, rate, rate / 4
        wire.host_damage_rate = wire.host_drop_rate = 10 * rate
        self.bench.run(seconds)
        wire.damage_rate = wire.drop_rate = wire.host_damage_rate = wire.host_drop_rate = 0.0

    @rule(seconds=st.floats(0.1, 3.0))
    def cut_for(self, seconds: float) -> None:
        self.bench.wire.cut = True
        self.bench.run(seconds)
        assert self.bench.state == "closed"
        self.bench.wire.cut = False

    @rule()
    def reboot(self) -> None:
        self.bench.fake.reboot(self.bench.now_s)

    @invariant()
    def runs_again(self) -> None:
        for _ in range(round(RECOVERY_S / 0.5)):
            if self.bench.run(0.5) and self.bench.state == "running":
                return
        raise AssertionError(self.bench.lms.status)


Faults.TestCase.settings = settings(max_examples=examples(3), stateful_step_count=6)
TestFaults = Faults.TestCase
