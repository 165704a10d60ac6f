"""What the LMS111's scans and its answers say about it, and which of its scans are used."""

import numpy as np
import pytest

from fakes.lms1xx.scan import Channel
from hw.lms1xx.telegrams import MAX_BEAMS
from tests.support.scripted_lms111 import UNKNOWN, willing


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
