"""The driver of a Hokuyo scanner on the fake: found in any mode, true ranges at true instants."""

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from core.records import Scan
from fakes.urg04lx.device import FakeUrg04lx
from fakes.wires.wire import MemoryPort, Wire
from hw.urg04lx.options import Urg04lxOptions
from hw.urg04lx.session import Urg04lx
from tests.hw.urg04lx.test_scans import options_of
from tests.support.cases import examples

F64 = npt.NDArray[np.float64]
TICK_S = 0.005
SPEED_MPS, LAP_S = 0.2, 10.0
FOUND_S = 12.0  # all rates, one after the other


def ranges_m_at(t_first_s: float, times_s: F64, bearings_rad: F64) -> F64:
    """Farther to the left and later: each range tells bearing and instant of its beam."""
    ranges_m: F64 = 2.0 + 0.3 * bearings_rad + SPEED_MPS * np.mod(times_s, LAP_S)
    return ranges_m


class RatedPort(MemoryPort):
    """A serial line in memory: at another rate than the device's, nothing goes through whole."""

    def __init__(self, fake: FakeUrg04lx, baud: int) -> None:
        super().__init__()
        self._fake, self.baud = fake, baud

    def set_rate(self, baud: int) -> None:
        self.baud = baud

    def _carried(self, data: bytes) -> bytes:
        fits = self._fake.baud in (None, self.baud)
        return data if fits else bytes(byte | 0x80 for byte in data)

    def read(self) -> list[bytes]:
        return [self._carried(piece) for piece in super().read()]

    def write(self, data: bytes) -> None:
        super().write(self._carried(data))


class Bench:
    """The fake, a wire, a clock, the driver."""

    def __init__(self, model: str = "URG-04LX", baud: int = 115_200, **given: Any) -> None:
        self.fake = FakeUrg04lx(ranges_m_at, seed=1, model=model)
        self.options: Urg04lxOptions = options_of(model=model, **given)
        is_tcp = model == "UTM-30LX"
        self.port = MemoryPort() if is_tcp else RatedPort(self.fake, baud)
        self.wire = Wire(self.fake, self.port, seed=1)
        self.urg = Urg04lx(self.port, self.options, None if is_tcp else baud)
        self.now_s = 50.0

    @property
    def state(self) -> str:
        return self.urg.status.state

    def run(self, seconds: float) -> list[Scan]:
        scans = []
        for _ in range(round(seconds / TICK_S)):
            self.wire.step(self.now_s)
            scans += self.urg.step(self.now_s)
            self.now_s += TICK_S
        return scans


def off_m(scan: Scan) -> F64:
    """How far ranges are from those at their own bearings and instants."""
    beams = np.arange(scan.ranges_m.shape[1], dtype=np.float64)
    times_s = scan.t_s + beams * scan.beam_dt_s
    told = ranges_m_at(scan.t_s, times_s, scan.first_rad + beams * scan.step_rad)
    return np.asarray(scan.ranges_m[0] - told)


@pytest.mark.parametrize(
    ("model", "baud", "given", "rate_hz"),
    [
        ("URG-04LX", 500_000, {}, 10.0),
        ("URG-04LX", 115_200, {"characters": 2, "cluster": 2}, 10.0),
        ("URG-04LX", 115_200, {"stream": False, "cluster": 3}, 10.0),
        ("URG-04LX-UG01", 115_200, {}, 10.0),
        ("URG-04LX-UG01", 115_200, {"skip_scans": 1}, 5.0),
        ("UTM-30LX", 0, {}, 40.0),
    ],
)
def test_ranges_lie_at_their_bearings_and_instants(
    model: str, baud: int, given: dict[str, Any], rate_hz: float
) -> None:
    bench = Bench(model, baud, **given)
    bench.fake.noise, bench.fake.mixed = 0.0, False
    bench.run(FOUND_S)
    assert bench.state == "running", bench.urg.status.cause
    assert bench.urg.status.cause == ""
    rejected = bench.urg.status.rejected  # while it was looked for
    scans = bench.run(5.0)
    assert len(scans) >= 5.0 * rate_hz * 0.9
    assert bench.urg.clock_locked
    rms_m = [float(np.sqrt(np.nanmean(off_m(scan) ** 2))) for scan in scans]
    mean_m = [float(np.nanmean(off_m(scan))) for scan in scans]
    assert max(rms_m) < 0.03
    assert abs(float(np.median(mean_m))) < 0.003  # 15 ms
    assert bench.urg.status.rejected == rejected
    for scan in scans:
        assert scan.ranges_m.shape[1] <= bench.options.spec.max_beams
        assert scan.t_s + scan.ranges_m.shape[1] * scan.beam_dt_s <= scan.arrived_s + 1e-3
    assert "URG" in bench.urg.identity or "UTM" in bench.urg.identity


@pytest.mark.parametrize(("baud", "least"), [(19_200, 7), (115_200, 40)])
def test_single_scans_are_as_many_as_a_slow_line_carries_and_true(baud: int, least: int) -> None:
    bench = Bench(baud=baud, stream=False)
    bench.fake.noise, bench.fake.mixed = 0.0, False
    bench.run(FOUND_S)
    scans = bench.run(10.0)
    assert len(scans) >= least
    assert "do not come" in bench.urg.status.cause
    off = [float(np.nanmedian(off_m(scan))) for scan in scans]
    assert abs(float(np.median(off))) < 0.005


def test_it_is_found_at_another_rate_and_brought_to_the_wanted_one() -> None:
    bench = Bench(baud=500_000)
    assert bench.fake.baud == 19_200
    bench.run(FOUND_S)
    assert bench.state == "running"
    assert isinstance(bench.port, RatedPort)
    assert bench.fake.baud == bench.port.baud == 500_000


@pytest.mark.parametrize("mode", ["streams", "keeps time", "SCIP 2.0", "splits its number"])
def test_it_is_found_in_whatever_mode_a_host_has_left_it(mode: str) -> None:
    bench = Bench("URG-04LX-UG01")
    if mode == "streams":
        bench.fake.leave_streaming(bench.now_s)
    elif mode == "keeps time":
        bench.fake.exchange(bench.now_s, b"TM0\n")
    elif mode == "splits its number":
        bench.fake.splits_serial = True
    bench.run(5.0)
    assert bench.state == "running", bench.urg.status.cause


def until_it_measures(bench: Bench) -> float:
    """Seconds to the first scan of now or later."""
    began_s, scans = bench.now_s, list[Scan]()
    while bench.now_s - began_s < FOUND_S and (not scans or scans[-1].t_s < began_s):
        scans = bench.run(TICK_S)
    assert bench.state == "running", bench.urg.status.cause
    return bench.now_s - began_s


def checks_an_error(bench: Bench, trouble: int, seconds: float) -> None:
    bench.fake.trouble = trouble
    bench.run(seconds)
    bench.fake.trouble = 0


@pytest.mark.parametrize("phase_s", [0.0, 0.045, 0.09])
@pytest.mark.parametrize(
    "fault",
    [
        lambda bench: bench.fake.switch_laser_off(bench.now_s),
        lambda bench: bench.fake.restart(bench.now_s),
        lambda bench: checks_an_error(bench, 21, 0.3),
        lambda bench: checks_an_error(bench, 21, 7.0),
        lambda bench: checks_an_error(bench, 63, 7.0),
    ],
    ids=["laser off", "restart", "short check", "long check", "trouble"],
)
@pytest.mark.parametrize("model", ["URG-04LX", "URG-04LX-UG01", "UTM-30LX"])
def test_within_a_second_of_a_faults_end_it_measures_again(
    model: str, fault: Callable[[Bench], None], phase_s: float
) -> None:
    bench = Bench(model, characters=2, cluster=2)
    bench.fake.baud = None  # by USB or TCP
    bench.run(6.0 + phase_s)
    fault(bench)
    bench.fake.baud = None
    assert until_it_measures(bench) <= 1.0
    assert all(np.nanmax(np.abs(off_m(scan))) < 0.1 for scan in bench.run(3.0)[-10:])


@pytest.mark.parametrize(("is_mute", "most_a_second"), [(True, 4), (False, 9)])
def test_one_that_does_not_measure_is_asked_a_few_times_a_second(
    is_mute: bool, most_a_second: int
) -> None:
    bench, asked = Bench("URG-04LX-UG01"), 0
    bench.run(6.0)
    bench.fake.mute, bench.fake.trouble = is_mute, 63
    for _ in range(round(20.0 / TICK_S)):
        bench.urg.step(bench.now_s)
        heard = bench.port.take()
        bench.port.give(bench.fake.exchange(bench.now_s, heard))
        asked += sum(len(line) > 0 for line in heard.split(b"\n"))
        bench.now_s += TICK_S
    assert bench.state == "starting"
    assert asked <= 20 * most_a_second


def test_a_restarted_classic_one_is_found_again_though_it_has_another_rate_and_protocol() -> None:
    bench = Bench(baud=500_000)
    bench.run(FOUND_S)
    bench.fake.restart(bench.now_s)
    bench.run(FOUND_S)
    assert bench.state == "running"
    assert bench.fake.baud == 500_000


def test_damaged_scans_are_counted_and_cost_no_other() -> None:
    bench = Bench("URG-04LX-UG01")
    bench.run(5.0)
    bench.fake.damaged_rate = 0.5
    scans = bench.run(10.0)
    assert 20 < len(scans) < 80
    assert bench.urg.status.rejected >= 20
    assert bench.state == "running"


def test_trouble_is_told_in_words_and_nothing_is_delivered() -> None:
    bench = Bench("URG-04LX-UG01")
    bench.run(5.0)
    bench.fake.trouble = 63
    scans = bench.run(3.0)
    assert len(scans) <= 2
    assert bench.state == "starting"
    assert "hardware" in bench.urg.status.cause
    bench.fake.trouble = 0
    bench.run(4.0)
    assert bench.state == "running"


def test_a_wrong_model_is_named() -> None:
    bench = Bench("UTM-30LX")
    bench.urg = Urg04lx(bench.port, options_of(model="URG-04LX"), None)
    bench.run(5.0)
    assert bench.state == "starting"
    assert "scanner.model" in bench.urg.status.cause
    assert "UTM-30LX" in bench.urg.status.cause


def test_it_stops_what_it_started() -> None:
    bench = Bench("URG-04LX-UG01")
    bench.run(5.0)
    bench.urg.stop()
    bench.wire.step(bench.now_s)
    assert not bench.fake.head.is_lit


class Life(RuleBasedStateMachine):
    """Whatever happens to it, it delivers true ranges and is found again."""

    def __init__(self) -> None:
        super().__init__()
        self.bench = Bench("URG-04LX-UG01")
        self.scans: list[Scan] = []

    @rule(seconds=st.floats(0.01, 1.0))
    def runs(self, seconds: float) -> None:
        self.scans = self.bench.run(seconds)

    @rule()
    def restarts(self) -> None:
        self.bench.fake.restart(self.bench.now_s)

    @rule()
    def laser_off(self) -> None:
        self.bench.fake.switch_laser_off(self.bench.now_s)

    @rule(rate=st.sampled_from([0.0, 0.2]))
    def damage(self, rate: float) -> None:
        self.bench.fake.damaged_rate = rate

    @rule(answers=st.integers(1, 3))
    def lose(self, answers: int) -> None:
        self.bench.fake.answers_lost = answers

    @rule(is_in=st.booleans())
    def plug(self, is_in: bool) -> None:
        self.bench.port.connected = is_in

    @invariant()
    def ranges_are_true(self) -> None:
        for scan in self.scans:
            off = off_m(scan)
            assert not np.isfinite(off).any() or float(np.nanmedian(np.abs(off))) < 0.15

    def teardown(self) -> None:
        fake = self.bench.fake
        fake.damaged_rate, fake.answers_lost, self.bench.port.connected = 0.0, 0, True
        self.bench.run(10.0)
        assert self.bench.state == "running", self.bench.urg.status.cause


TestLife = Life.TestCase
TestLife.settings = settings(max_examples=examples(8), stateful_step_count=12)
