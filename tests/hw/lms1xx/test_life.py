"""The life of a link to an LMS111: its dialect, its start, other hosts, silence, how it is."""

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.scripted_lms111 import (
    CONFIGURING,
    SFA,
    TICK_S,
    WANTED,
    Bench,
    framed,
    with_beams,
)

SHORT = 7  # commands to one that measures as wanted


def willing(**changes: object) -> Bench:
    """A device that measures as wanted."""
    bench = Bench(**changes)
    bench.fake.settings = dict(WANTED)
    return bench


# --- dialect and start


@pytest.mark.parametrize("dialect", ["auto", "ascii"])
def test_a_device_that_speaks_text_is_found_and_delivers_the_same(dialect: str) -> None:
    text, packed = willing(dialect=dialect), willing()
    text.fake.is_text = True
    one, other = text.run(0.6), packed.run(0.4)
    assert (text.state, text.cause, text.lms.status.rejected) == ("running", "", 0)
    assert one[0].ranges_m.shape == (1, 541)
    assert one[0].ranges_m.tobytes() == other[0].ranges_m.tobytes()
    assert (one[0].first_rad, one[0].step_rad) == (other[0].first_rad, other[0].step_rad)


def test_the_dialect_that_answered_is_tried_first_next_time_and_may_change() -> None:
    bench = willing()
    bench.fake.is_text = True
    bench.run(1.0)
    bench.reconnect()
    sent = []
    for _ in range(3):
        bench.lms.step(bench.now_s)
        sent.append(bench.port.take())
        bench.now_s += TICK_S
    assert b"".join(sent).startswith(b"\x02sRN SCdevicestate\x03")
    bench.run(1.0)
    bench.fake.is_text = False  # somebody set EIHstCola
    bench.reconnect()
    assert bench.run(0.8)
    assert (bench.state, bench.cause) == ("running", "")


@pytest.mark.parametrize(("dialect", "is_text"), [("binary", True), ("ascii", False)])
def test_a_set_dialect_never_tries_the_other_and_the_cause_names_it(
    dialect: str, is_text: bool
) -> None:
    bench = willing(dialect=dialect)
    bench.fake.is_text = is_text
    bench.run(30.0)
    assert bench.cause.startswith("waiting for the scanner to answer")
    bench.run(10.0)
    other = "CoLa-A (EIHstCola 0)" if is_text else "CoLa-B (EIHstCola 1)"
    assert f"or it may be set to {other} instead of" in bench.cause
    bench.run(85.0)
    assert bench.cause.startswith(f"the scanner does not answer: it may be set to {other}")
    assert not bench.fake.asked
    bench.fake.is_text = not is_text
    assert bench.run(1.0)


def test_one_that_speaks_neither_dialect_is_said_after_two_minutes() -> None:
    bench = willing()
    bench.run(119.0, deaf=True)
    assert bench.cause.startswith("waiting for the scanner to answer")
    bench.run(2.0, deaf=True)
    assert bench.cause == "the scanner answers in neither dialect"
    assert bench.run(1.0)


@pytest.mark.parametrize("is_text", [False, True], ids=["binary", "ascii"])
@pytest.mark.parametrize("silent_s", [30.0, 30.13, 30.31])
def test_the_first_scan_comes_within_a_second_after_a_start_that_takes_half_a_minute(
    silent_s: float, is_text: bool
) -> None:
    bench = willing()
    bench.fake.is_text = is_text
    bench.fake.deaf_until_s = bench.now_s + silent_s
    assert not bench.run(silent_s)
    assert bench.cause.startswith("waiting for the scanner to answer")
    assert bench.run(1.0)
    assert bench.cause == ""


def test_many_late_answers_to_the_greeting_do_no_harm() -> None:
    bench = willing()
    bench.fake.answers["sRN SCdevicestate"] = SFA + b"\x00\x03"
    bench.fake.late_s["sRN SCdevicestate"] = 1.5
    assert bench.run(4.0)
    assert (bench.state, bench.cause) == ("running", "")


def test_a_stream_that_runs_proves_its_dialect() -> None:
    bench = willing()
    bench.fake.is_text = True
    bench.fake.answers["sRN SCdevicestate"] = None
    bench.run(TICK_S)
    bench.port.give(bench.fake.frame(bench.fake.scan_payload(100.0)))
    assert bench.run(0.5)


# --- other hosts


def test_two_hosts_with_one_setting_leave_each_other_alone() -> None:
    bench = willing()
    bench.run(2.0)
    for _ in range(5):
        bench.reconnect()
        bench.run(2.0)
        assert "sMN SetAccessMode" not in bench.fake.asked
    assert bench.state == "running"


def test_a_host_that_logs_in_is_named_and_not_fought_faster_than_every_three_seconds() -> None:
    bench = Bench()
    bench.run(1.0)
    assert bench.fake.asked.count("sMN SetAccessMode") == 1
    for _ in range(800):  # for 16 s, the other logs in whenever we have set it running
        bench.run(0.02)
        if bench.state == "running":
            bench.fake.streams, bench.fake.state = False, CONFIGURING
    assert "the scanner is being configured: another host may be configuring it" in bench.causes
    assert 3 <= bench.fake.asked.count("sMN SetAccessMode") <= 6
    bench.run(10.0)
    assert (bench.state, bench.cause) == ("running", "")


def test_a_host_that_logs_in_and_finishes_soon_is_not_fought_at_all() -> None:
    bench = willing()
    bench.run(20.0)
    bench.fake.streams, bench.fake.state = False, CONFIGURING
    bench.run(2.5)
    assert bench.cause == "the scanner is being configured: another host may be configuring it"
    bench.fake.state = 7
    assert bench.run(1.0)
    assert "sMN SetAccessMode" not in bench.fake.asked
    bench.fake.streams, bench.fake.state = False, CONFIGURING  # and now it forgets its Run
    bench.run(6.5)
    assert bench.fake.asked.count("sMN SetAccessMode") == 1
    assert bench.state == "running"


def test_settings_that_are_others_after_a_new_connection_are_set_again_at_once() -> None:
    bench = Bench()
    bench.run(1.0)
    bench.fake.settings["LMPscancfg"] = (2500, 1, 2500, -450000, 2250000)  # or it has restarted
    bench.reconnect()
    bench.run(1.0)
    assert bench.fake.settings["LMPscancfg"] == WANTED["LMPscancfg"]
    assert bench.state == "running"


# --- running


def test_silence_is_a_loss_after_a_second_and_the_session_begins_anew() -> None:
    bench = willing()
    bench.run(1.0)
    bench.fake.streams = False
    bench.run(0.9)
    assert bench.state == "running"
    bench.run(0.2)
    assert (bench.state, bench.lms.status.losses) == ("starting", 1)
    assert "no scan from the scanner for 1 s" in bench.causes
    bench.run(1.0)
    assert bench.state == "running"
    assert bench.fake.asked.count("sEN LMDscandata") == 2
    assert bench.lms.status.missed == 0


def test_a_telegram_sent_again_and_again_is_silence() -> None:
    bench = willing()
    bench.run(1.0)
    bench.fake.streams = False
    telegram = framed(bench.fake.scan_payload(bench.now_s))
    for _ in range(250):
        bench.port.give(telegram)
        bench.run(TICK_S)
    assert bench.lms.status.losses == 1
    assert bench.lms.status.rejected > 100


def test_a_new_connection_begins_a_new_session() -> None:
    bench = willing()
    bench.run(1.0)
    bench.port.connected = False
    bench.run(0.1)
    assert (bench.state, bench.lms.status.losses) == ("closed", 1)
    bench.reconnect()
    bench.run(0.4)
    assert len(bench.fake.asked) == SHORT
    assert bench.state == "running"


def test_events_between_command_and_answer_do_not_disturb() -> None:
    bench = Bench()
    event = framed(b"sSN LIDoutputstate \x00\x01")
    for _ in range(300):
        bench.port.give(event)
        bench.port.give(framed(bench.fake.scan_payload(bench.now_s)))
        bench.run(TICK_S)
    assert bench.state == "running"
    assert bench.fake.asked.count("sMN SetAccessMode") == 1


def test_scans_that_never_came_are_counted_also_across_the_wrap() -> None:
    bench = willing()
    bench.fake.scan_number = 65_530
    bench.fake.step_by, bench.fake.period_s = 2, 0.04
    scans = bench.run(1.0)
    assert len(scans) > 20
    assert bench.lms.status.missed == len(scans) - 1


def test_a_scan_counter_that_begins_anew_is_not_taken_for_missed_scans() -> None:
    bench = willing()
    bench.fake.scan_number = 5000
    bench.run(0.5)
    bench.fake.scan_number = 0
    bench.run(0.5)
    assert bench.lms.status.missed == 0
    assert bench.state == "running"


def test_damage_is_counted_and_the_next_scans_are_taken() -> None:
    bench = willing()
    bench.run(0.5)
    telegram = bytearray(framed(bench.fake.scan_payload(bench.now_s)))
    telegram[500] ^= 0x10
    bench.port.give(bytes(telegram))
    assert bench.run(0.2)
    status = bench.lms.status
    assert (status.rejected, status.skipped_bytes, status.state) == (1, 1191, "running")
    assert [frame.reason for frame in status.rejections] == ["wrong checksum"]


HOSTILE = {  # looks like telegrams, each time anew
    "text": b"\x02sRA \x03",
    "scan": b"\x02sSN LMDscandata 1 1 1 1 1 1 1 1 1 1\x03",
    "binary": b"\x02\x02\x02\x02\x00\x00\x20\x00ss",
    "answers": b"\x02sFA 1\x03",
}


@pytest.mark.parametrize("junk", HOSTILE.values(), ids=HOSTILE.keys())
def test_hostile_bytes_cost_little_in_one_step_and_the_scans_behind_them_are_taken(
    junk: bytes,
) -> None:
    bench = willing()
    bench.run(1.0)
    bench.port.give(junk * (65_536 // len(junk)))
    decoded, most = [0], 0
    parser: Any = bench.lms._intake._parser
    decode = parser._decode

    def counted(*arguments: Any) -> Any:
        decoded[0] += 1
        return decode(*arguments)

    parser._decode = counted
    scans = []
    for _ in range(100):
        before = decoded[0]
        scans += bench.run(TICK_S)
        most = max(most, decoded[0] - before)
    assert most <= 1500  # of the 2000 to 11000 in the flood: a few ms
    assert len(scans) == pytest.approx(25, abs=1)
    assert (bench.state, bench.lms.status.missed) == ("running", 0)


# --- how it is


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
    bench.fake._scan = with_beams(bench.fake._scan, bench.lms.max_beams)
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


NOISE = [framed(SFA + b"\x00\x03"), framed(b"sAN Run "), b"\x02sFA A\x03", b"\x02sAN Run 1\x03"]


@settings(max_examples=25)
@given(st.lists(st.binary(max_size=60) | st.sampled_from(NOISE)), st.booleans())
def test_no_bytes_at_any_time_stop_the_session_for_good(noise: list[bytes], is_text: bool) -> None:
    bench = Bench()
    bench.fake.is_text = is_text
    for piece in noise:
        bench.port.give(piece)
        bench.run(0.02)
    for _ in range(20):
        bench.run(1.0)
        if bench.state == "running":
            break
    assert bench.run(0.5)
    assert bench.state == "running"
