"""What the LMS111's telegrams become, which of them are used, and how the scanner is."""

import math
from dataclasses import replace

import numpy as np
import pytest

from core.records import Scan
from fakes.lms1xx.scan import Channel
from hw.lms1xx.session import PIECE
from hw.lms1xx.telegrams import MAX_BEAMS
from tests.support.devices.scripted_lms111 import UNKNOWN, Bench, ScriptedLms111, willing


def one_scan(**changes: object) -> Scan:
    return Bench(**changes).run(0.5)[0]


def test_only_the_used_beams_are_delivered_each_at_its_bearing_and_time() -> None:
    whole, part = one_scan(), one_scan(first_deg=30.0, last_deg=150.0)
    assert part.ranges_m.shape == (1, 241)
    assert part.ranges_m.flags.c_contiguous
    np.testing.assert_array_equal(part.ranges_m[0], whole.ranges_m[0, 150:391])
    assert part.first_rad == pytest.approx(math.radians(-60))
    assert part.first_rad + 240 * part.step_rad == pytest.approx(math.radians(60))
    assert part.t_s - whole.t_s == pytest.approx(150 * whole.beam_dt_s)
    assert part.arrived_s == whole.arrived_s
    between = one_scan(first_deg=29.8, last_deg=31.2)  # the beams inside are taken
    assert between.ranges_m.shape == (1, 3)
    assert between.first_rad == pytest.approx(math.radians(-60))


def test_a_sweep_ends_no_later_than_its_transmission_begins() -> None:
    scan = one_scan()
    assert scan.t_s + 540 * scan.beam_dt_s <= scan.arrived_s + 1e-9
    bench = Bench()
    bench.fake.late_stamp_us = 40_000  # a device that buffers: its stamp is to be believed
    early = bench.run(0.5)[0]
    assert early.t_s == pytest.approx(early.arrived_s - 0.04, abs=0.006)


@pytest.mark.parametrize("is_sent", [True, False], ids=["two echoes", "one echo"])
@pytest.mark.parametrize("echo", ["first", "last", "both"])
def test_the_second_echo_is_a_row_of_its_own_or_fills_in_or_is_missing(
    echo: str, is_sent: bool
) -> None:
    bench = Bench(echo=echo)
    third = np.arange(541) % 3 == 0  # the beams that have one
    if is_sent:
        second_mm = np.where(third, 5000, 0).astype(np.uint16)
        bench.fake.channels.append(Channel(b"DIST2", second_mm, -450_000, 5000))
    ranges_m = bench.run(0.5)[0].ranges_m
    first_m = one_scan().ranges_m[0]
    second_m = np.where(third & is_sent, 5.0, np.nan)
    expected = {
        "first": [first_m],
        "last": [np.where(np.isnan(second_m), first_m, second_m)],
        "both": [first_m, second_m],
    }[echo]
    assert ranges_m.flags.c_contiguous
    np.testing.assert_array_equal(ranges_m, expected)
    assert bool(bench.cause) is (echo != "first" and not is_sent)


def test_a_scan_without_a_used_beam_is_rejected_and_said() -> None:
    bench = Bench(first_deg=10.0, last_deg=20.0)
    bench.fake.channels = [replace(bench.fake.channels[0], first=900_000)]
    assert not bench.run(0.5)
    assert bench.cause == "the scanner sends 90 to 360 deg only"
    assert bench.lms.status.rejections[0].reason.endswith("in the used field of view")


def test_a_scan_of_all_beams_fits_into_what_is_parsed_at_once() -> None:
    fake = ScriptedLms111()
    fake.channels = [Channel(b"DIST1", np.full(MAX_BEAMS, 1000, np.uint16), -450_000, 2500)]
    assert 2 * MAX_BEAMS < len(fake.scan(1.0)) <= PIECE


# --- how the scanner is


@pytest.mark.parametrize("status", [(1, 0), (0, 1), (2, 0), (255, 255)])
def test_scans_whose_status_is_not_documented_as_good_are_not_delivered(
    status: tuple[int, int],
) -> None:
    bench = willing()
    bench.run(0.5)
    bench.fake.status = status
    assert not bench.run(1.5)
    said = f"sends scans with device status {status[0]} {status[1]} (a warning, an error"
    assert bench.cause.startswith(f"the scanner {said}")
    assert (bench.state, bench.lms.status.losses) == ("starting", 1)
    bench.fake.status = (0, 0)
    assert bench.run(0.5)
    assert (bench.state, bench.cause) == ("running", "")
    assert bench.fake.asked.count("sEN LMDscandata") == 1  # it was never silent


@pytest.mark.parametrize("status", [(2, 0), (0, 2)])
def test_a_device_status_that_the_settings_accept_is_said_and_its_scans_are_used(
    status: tuple[int, int],
) -> None:
    bench = willing(accepted_status=[2])
    bench.fake.status = status
    assert bench.run(0.4)
    assert bench.state == "running"
    assert f"sends scans with device status {status[0]} {status[1]}" in bench.cause
    assert not bench.lms.is_impaired  # which is known from LCMstate only
    bench.fake.status = (2, 1)
    assert not bench.run(0.4)


@pytest.mark.parametrize(
    ("dirt", "message", "is_used"),
    [
        (1, "has a dirty window (warning): clean it", True),
        (2, "has a dirty window (error): clean it", False),
        (3, "has a window too dirty to see through: clean it", False),
    ],
)
def test_a_dirty_window_is_said_and_one_that_hides_things_is_not_looked_through(
    dirt: int, message: str, is_used: bool
) -> None:
    bench = willing()
    bench.fake.answers["sRN LCMstate"] = b"sRA LCMstate " + bytes([dirt])
    bench.run(1.5)
    assert bool(bench.run(0.3)) is is_used
    assert bench.state == ("running" if is_used else "starting")
    assert bench.cause == f"the scanner {message}"
    assert bench.lms.is_impaired
    assert bool(bench.lms.doubt) is not is_used
    bench.fake.answers["sRN LCMstate"] = b"sRA LCMstate \x00"
    assert bench.run(6.0, tick_s=0.02)
    assert (bench.state, bench.cause, bench.lms.is_impaired) == ("running", "", False)
    assert bench.fake.asked.count("sEN LMDscandata") == 1


def test_more_beams_than_the_family_has_are_refused_and_the_cause_says_so() -> None:
    def beams(count: int) -> list[Channel]:
        return [Channel(b"DIST1", np.full(count, 5000, np.uint16), -450_000, 2500)]

    bench = willing()
    bench.fake.channels = beams(1141)  # an LMS5xx: 190 deg at 1/6 deg
    assert not bench.run(3.0)
    assert bench.state == "starting"
    reason = "1141 points a scan, more than 1081"
    assert f"no scan from the scanner for 2 s: {reason}" in bench.causes
    assert {frame.reason for frame in bench.lms.status.rejections} == {reason}
    bench = willing(scan_rate_hz=25, angular_step_deg=0.25)
    bench.fake.channels = beams(MAX_BEAMS)
    assert {scan.ranges_m.shape for scan in bench.run(0.4)} == {(1, 1081)}


@pytest.mark.parametrize("is_text", [False, True], ids=["binary", "ascii"])
def test_contamination_and_temperature_are_asked_for_and_scans_go_on(is_text: bool) -> None:
    bench = willing()
    bench.fake.is_text = is_text
    bench.fake.period_s = 0.1
    bench.run(0.5)
    bench.fake.asked.clear()
    assert len(bench.run(10.0, tick_s=0.02)) == pytest.approx(100, abs=1)
    assert bench.fake.asked.count("sRN LCMstate") == bench.fake.asked.count("sRN STlms") == 2
    assert bench.cause == ""
    bench.fake.temperature_flag = 1
    bench.run(6.0, tick_s=0.02)
    assert bench.cause == "the scanner is out of its range of temperatures"


@pytest.mark.parametrize("answer", [None, UNKNOWN, b"sRA LCMstate "])
def test_a_device_that_does_not_tell_its_contamination_is_not_asked_for_ever(
    answer: bytes | None,
) -> None:
    bench = willing()
    bench.fake.answers["sRN LCMstate"] = answer
    bench.fake.period_s = 0.2
    bench.run(20.0, tick_s=0.05)
    assert (bench.state, bench.cause, bench.lms.status.losses) == ("running", "", 0)
    assert not bench.lms.is_impaired
    assert bench.fake.asked.count("sRN STlms") >= 4
    if answer != b"sRA LCMstate ":
        assert bench.fake.asked.count("sRN LCMstate") == 2
