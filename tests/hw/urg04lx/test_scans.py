"""Replies with ranges to scans: bearings, instants, codes, the correction, and what is refused."""

import math
from typing import Any

import numpy as np
import pytest

from core.records import Scan
from hw.device import BadFrame
from hw.urg04lx.options import Urg04lxOptions
from hw.urg04lx.scan import LEARNT_SCANS, WRAP_TICKS, ScanMaker, Window
from hw.urg04lx.scip import Reply
from hw.urg04lx.sensor import Sensor

SENSOR = Sensor("URG-04LX", 20, 5600, 1024, 44, 725, 384, 600.0)
STEP_RAD = math.tau / 1024
GIVEN: dict[str, Any] = {
    "model": "URG-04LX", "from_deg": -120.0, "to_deg": 120.0, "cluster": 1, "skip_scans": 0,
    "characters": 3, "stream": True, "correction": [0.0] * 4, "correction_m": [0.02, 5.6],
}  # fmt: skip


def options_of(**changes: Any) -> Urg04lxOptions:
    return Urg04lxOptions(**{**GIVEN, **changes})


def characters_of(value: int, count: int) -> bytes:
    return bytes(0x30 + (value >> 6 * k & 63) for k in reversed(range(count)))


def reply_of(values: list[int], ticks: int, arrived_s: float, characters: int = 3) -> Reply:
    data = b"".join(characters_of(value, characters) for value in values)
    lines = characters_of(ticks % WRAP_TICKS, 4), data
    return Reply("MD0044072501000", "99", lines, arrived_s, 2137)


def scan_of(maker: ScanMaker, window: Window, reply: Reply) -> Scan:
    found = maker.scan(reply, window)
    assert isinstance(found, tuple), found
    return found[0]


def test_all_steps_lie_where_the_sheet_has_them() -> None:
    options = options_of()
    window = Window.of(SENSOR, options)
    assert (window.text, window.beams) == ("0044072501", 682)
    scan = scan_of(ScanMaker(options), window, reply_of([1000] * 682, 0, 50.0))
    assert math.degrees(scan.first_rad) == pytest.approx(-119.53, abs=0.01)
    assert math.degrees(scan.first_rad + 681 * scan.step_rad) == pytest.approx(119.88, abs=0.01)
    assert scan.beam_dt_s == pytest.approx(0.1 / 1024)
    np.testing.assert_array_equal(scan.ranges_m, np.ones((1, 682)))
    assert options.spec.max_beams >= 682


@pytest.mark.parametrize(("cluster", "beams"), [(2, 170), (3, 113), (7, 48)])
def test_clusters_are_whole_and_lie_in_the_middle_of_their_steps(cluster: int, beams: int) -> None:
    options = options_of(from_deg=-60.0, to_deg=60.0, cluster=cluster)
    window = Window.of(SENSOR, options)
    assert window.last - window.first + 1 == beams * cluster
    assert window.beams == beams <= options.spec.max_beams
    scan = scan_of(ScanMaker(options), window, reply_of([500] * beams, 0, 50.0))
    first_rad = (window.first - 384 + (cluster - 1) / 2) * STEP_RAD
    assert (scan.first_rad, scan.step_rad) == pytest.approx((first_rad, cluster * STEP_RAD))


def test_codes_and_what_is_too_far_are_no_ranges_and_are_counted_by_kind() -> None:
    options = options_of(from_deg=0.0, to_deg=8.2)
    window, maker = Window.of(SENSOR, options), ScanMaker(options)
    values = [*range(21), 5599, 5600, 5601]
    scan = scan_of(maker, window, reply_of(values, 0, 50.0))
    assert np.isnan(scan.ranges_m[0]).tolist() == [True] * 20 + [False] * 3 + [True]
    assert maker.sight.invalid() == {
        "beyond its range": 2, "too little light": 2, "neighbours disagree": 2,
        "not the same twice": 1, "too much light": 1, "not measurable": 1, "for other reasons": 12,
    }  # fmt: skip
    assert sum(maker.sight.invalid().values()) == np.isnan(scan.ranges_m).sum()


@pytest.mark.parametrize(
    ("code", "is_doubted"), [(0, False), (5601, False), (1000, False), (1, True), (18, True)]
)
def test_who_sees_nothing_but_codes_is_doubted_and_who_looks_into_the_open_is_not(
    code: int, is_doubted: bool
) -> None:
    options = options_of()
    window, maker = Window.of(SENSOR, options), ScanMaker(options)
    for k in range(50):
        scan_of(maker, window, reply_of([1000] * 682, 100 * k, 50.0 + 0.1 * k))
    for k in range(50, 100):
        scan_of(maker, window, reply_of([code] * 682, 100 * k, 50.0 + 0.1 * k))
    assert bool(maker.sight.doubt) == is_doubted
    if is_doubted:
        assert max(maker.sight.invalid()) in maker.sight.doubt
    scans = [reply_of([1000] * 682, 100 * k, 50.0 + 0.1 * k) for k in range(100, 102)]
    assert all(isinstance(maker.scan(reply, window), tuple) for reply in scans)
    assert maker.sight.doubt == ""


def test_as_far_as_two_characters_reach_is_no_range() -> None:
    options = options_of(from_deg=0.0, to_deg=0.4, characters=2)
    scan = scan_of(
        ScanMaker(options), Window.of(SENSOR, options), reply_of([4094, 4095], 0, 5.0, 2)
    )
    assert scan.ranges_m[0, 0] == pytest.approx(4.094)
    assert np.isnan(scan.ranges_m[0, 1])


def test_the_correction_holds_in_its_interval_and_goes_on_as_at_its_ends() -> None:
    options = options_of(correction=[0.01, 0.02, -0.001, 0.0002], correction_m=[0.5, 3.0])
    r = np.array([0.2, 0.5, 1.0, 3.0, 5.0])

    def added(x: float) -> float:
        return 0.01 + 0.02 * x - 0.001 * x**2 + 0.0002 * x**3

    expected = r + np.array([added(0.5), added(0.5), added(1.0), added(3.0), added(3.0)])
    np.testing.assert_allclose(options.corrected_m(r), expected)


def test_a_correction_leaves_no_range_at_or_behind_the_lens() -> None:
    options = options_of(correction=[-0.05, 0.0, 0.0, 0.0], correction_m=[0.1, 3.0])
    corrected_m = options.corrected_m(np.array([0.02, 0.05, 0.06, 1.0, math.nan]))
    np.testing.assert_allclose(corrected_m, [math.nan, math.nan, 0.01, 0.95, math.nan])


@pytest.mark.parametrize(
    ("correction", "why"),
    [
        ([1.0, 0.0, 0.0, 0.0], "1 m or more"),
        ([0.0, -1.8, 1.2, -0.2], "farther"),  # good at both ends, not between them
        ([math.nan, 0.0, 0.0, 0.0], "1 m or more"),
    ],
)
def test_a_correction_that_no_scanner_needs_is_refused(correction: list[float], why: str) -> None:
    with pytest.raises(ValueError, match=why):
        options_of(correction=correction, correction_m=[0.0, 3.0])


@pytest.mark.parametrize(
    "reply",
    [
        reply_of([1000] * 681, 0, 1.0),
        reply_of([1000] * 683, 0, 1.0),
        Reply("MD0044072501000", "99", (), 1.0, 20),
        Reply("MD0044072501000", "99", (b"0B=5", b"p" * 3 * 682), 1.0, 20),
    ],
)
def test_what_is_no_scan_of_the_window_is_refused(reply: Reply) -> None:
    options = options_of()
    found = ScanMaker(options).scan(reply, Window.of(SENSOR, options))
    assert isinstance(found, BadFrame)


def test_scans_that_never_came_are_counted_and_a_repeated_one_is_none() -> None:
    options = options_of()
    window, maker = Window.of(SENSOR, options), ScanMaker(options)
    told = []
    for ticks in (WRAP_TICKS - 150, WRAP_TICKS - 50, 50, 351, 351):
        found = maker.scan(reply_of([1000] * 682, ticks, 50.0 + ticks % 1000 * 1e-3), window)
        assert not isinstance(found, BadFrame)
        told.append(found and found[1])
    assert told == [0, 0, 0, 2, None]


def test_time_goes_on_over_the_wrap_of_its_24_bits_and_knows_a_restart() -> None:
    options = options_of()
    window, maker = Window.of(SENSOR, options), ScanMaker(options)
    begun_s = []
    for k in range(100):
        ticks = WRAP_TICKS - 5_000 + 100 * k
        begun_s.append(scan_of(maker, window, reply_of([1000] * 682, ticks, 50.0 + 0.1 * k)).t_s)
    np.testing.assert_allclose(np.diff(begun_s), 0.1, atol=1e-6)
    assert maker.clock.restarts == 0
    scan_of(maker, window, reply_of([1000] * 682, 1_000_000, 60.0))
    assert maker.clock.restarts == 1
    assert not maker.clock.locked


def test_a_beam_has_its_own_instant_whatever_the_device_keeps_scans_for() -> None:
    """The device sends a stamp at once, and a scan 12 ms after its last beam."""
    options = options_of()
    window, maker = Window.of(SENSOR, options), ScanMaker(options)
    begun_s, line_s, held_s = 700.0, 0.08, 0.012
    rng = np.random.default_rng(1)
    for k in range(10):
        maker.synchronise(100 * k, begun_s + 0.1 * k + float(rng.exponential(0.001)))
    late_s = []
    for k in range(11, 200):
        measured_s = begun_s + 0.1 * k + window.measured_s
        arrived_s = measured_s + held_s + line_s + float(rng.exponential(0.001))
        found = maker.scan(reply_of([1000] * 682, 100 * k, arrived_s), window)
        assert isinstance(found, tuple)
        late_s.append(found[0].t_s - (begun_s + 0.1 * k + 44 / 1024 * 0.1))
    assert not maker.begin("")
    assert maker.clock.locked
    assert np.abs(late_s[LEARNT_SCANS:]).max() < 0.002
