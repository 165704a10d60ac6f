"""What the LMS111's scans and its answers say about it, and which of its scans are used."""

import pytest

from hw.lms1xx.telegrams import MAX_BEAMS
from tests.support.scripted_lms111 import SFA, TICK_S, Bench, willing, with_beams


@pytest.mark.parametrize(
    "status", [(1, 0), (0, 1), (2, 0), (0, 2), (4, 0), (0, 4), (6, 0), (8, 0), (255, 255)]
)
def test_scans_whose_status_is_not_documented_as_good_are_counted_and_not_delivered(
    status: tuple[int, int],
) -> None:
    bench = willing()
    bench.run(0.5)
    bench.fake.status = status
    assert not bench.run(3.0)
    said = (
        f"the scanner sends scans with device status {status[0]} {status[1]} (a warning, an error"
    )
    assert bench.cause.startswith(said)
    assert (bench.state, bench.lms.status.losses) == ("starting", 1)
    assert bench.lms.not_ready == pytest.approx(150, abs=2)
    assert bench.lms.condition.device_status == status
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
    assert bool(bench.run(1.0)) is is_used
    assert bench.state == ("running" if is_used else "starting")
    assert bench.cause == f"the scanner {message}"
    assert bench.lms.condition.message == message
    assert bench.lms.is_impaired
    assert bool(bench.lms.doubt) is not is_used
    bench.fake.answers["sRN LCMstate"] = b"sRA LCMstate \x00"
    assert bench.run(6.0)
    assert (bench.state, bench.cause, bench.lms.condition.message) == ("running", "", "")
    assert bench.fake.asked.count("sEN LMDscandata") == 1


def test_more_beams_than_the_family_has_are_refused_and_the_cause_says_so() -> None:
    bench = willing()
    bench.fake._scan = with_beams(bench.fake._scan, 1141)  # an LMS5xx: 190 deg at 1/6 deg
    assert not bench.run(3.0)
    assert bench.state == "starting"
    reason = "1141 points a scan, more than 1081"
    assert f"no scan from the scanner for 2 s: {reason}" in bench.causes
    assert {frame.reason for frame in bench.lms.status.rejections} == {reason}
    bench = willing(scan_rate_hz=25, angular_step_deg=0.25)
    bench.fake._scan = with_beams(bench.fake._scan, MAX_BEAMS)
    assert {scan.ranges_m.shape for scan in bench.run(1.0)} == {(1, 1081)}


def test_what_the_session_is_doing_can_be_printed() -> None:
    bench, seen = Bench(), []
    for _ in range(200):
        bench.run(TICK_S)
        if bench.lms.session.state not in seen:
            seen.append(bench.lms.session.state)
    bench.fake.streams = False
    bench.run(1.1)
    assert [str(state) for state in (*seen, bench.lms.session.state)] == [
        "State.GREETING",
        "State.READING",
        "State.SETTING_UP",
        "State.SUBSCRIBING",
        "State.MEASURING",
        "State.WAITING",
    ]


@pytest.mark.parametrize("is_text", [False, True], ids=["binary", "ascii"])
def test_contamination_and_temperature_are_asked_for_and_scans_go_on(is_text: bool) -> None:
    bench = willing()
    bench.fake.is_text = is_text
    bench.run(0.5)
    for _ in range(2):
        bench.fake.asked.clear()
        scans = bench.run(10.0)
        assert len(scans) == pytest.approx(500, abs=2)
        assert bench.fake.asked.count("sRN LCMstate") == 2
        assert bench.fake.asked.count("sRN STlms") == 2
    condition = bench.lms.condition
    assert (condition.contamination, condition.temperature_ok) == (0, True)
    bench.fake.temperature_flag = 1
    bench.run(6.0)
    assert bench.cause == "the scanner is out of its range of temperatures"
    assert bench.lms.condition.temperature_ok is False


@pytest.mark.parametrize("answer", [None, SFA + b"\x00\x03", b"sRA LCMstate "])
def test_a_device_that_does_not_tell_its_contamination_is_not_asked_for_ever(
    answer: bytes | None,
) -> None:
    bench = willing()
    bench.fake.answers["sRN LCMstate"] = answer
    bench.run(40.0)
    assert (bench.state, bench.cause, bench.lms.status.losses) == ("running", "", 0)
    assert bench.lms.condition.contamination is None
    assert bench.fake.asked.count("sRN STlms") >= 6
    if answer != b"sRA LCMstate ":
        assert bench.fake.asked.count("sRN LCMstate") == 2


def test_beams_without_a_measurement_are_told_apart() -> None:
    bench = willing(first_deg=-45.0, last_deg=0.0)  # 91 beams
    scan = bytearray(bench.fake._scan)
    scan[77 : 77 + 2 * 91] = b"".join(
        value.to_bytes(2, "big")
        for value in [0] * 5 + [1] * 4 + [2] * 3 + [3] * 2 + [9] + [16] * 76
    )
    bench.fake._scan = bytes(scan)
    assert bench.lms.condition.beams_lost == {}
    bench.run(0.5)
    assert bench.lms.condition.beams_lost == {
        "no echo": 5,
        "dazzled": 4,
        "implausible": 3,
        "filtered": 2,
        "reserved": 1,
    }
