"""The LMS111 session: the recorded device, and one that refuses, forgets and falls silent."""

import math
import struct
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fakes.recorded import RecordedLms111
from fakes.wire import MemoryPort
from hw.lms111_session import Lms111
from tests.scripted_lms111 import GOOD, SFA, TICK_S, Bench, framed

ORDER = [
    "sMN SetAccessMode",
    "sRN LMPscancfg",
    "sMN mLMPsetscancfg",
    "sWN LMDscandatacfg",
    "sRN LMPoutputRange",
    "sMN LMCstartmeas",
    "sMN Run",
    "sRN STlms",
    "sEN LMDscandata",
]
OPTIONAL = ["sRN LMPscancfg", "sMN mLMPsetscancfg", "sRN LMPoutputRange", "sRN STlms"]
NEEDED = ["sWN LMDscandatacfg", "sMN LMCstartmeas", "sMN Run", "sEN LMDscandata"]
GOOD_HEADS = {name: b" ".join((answer or b"").split(b" ")[:2]) for name, answer in GOOD.items()}
UNKNOWN = SFA + b"\x00\x03"


# --- the recorded device


class SilentToUnknown(RecordedLms111):
    """The recorded device, if it does not answer at all what the recording does not hold."""

    def exchange(self, now_s: float, received: bytes) -> bytes:
        sent = super().exchange(now_s, received)
        return b"" if sent.startswith(b"\x02\x02\x02\x02\x00\x00\x00\x05sFA") else sent


@pytest.mark.parametrize(
    ("device", "remark"), [(RecordedLms111, "refuses"), (SilentToUnknown, "does not answer")]
)
def test_the_recorded_device_accepts_our_commands_and_delivers_its_scans(
    device: type[RecordedLms111], remark: str, vectors: Path
) -> None:
    fake = device.from_files(vectors / "lms111_session_d2h.bin")
    port, scans, ranges_m = MemoryPort(), [], []
    lms = Lms111(
        port, scan_rate_hz=50, angular_step_deg=0.5, first_deg=-45, last_deg=225, echo="first"
    )
    now_s = 0.0
    while not fake.done:
        port.give(fake.exchange(now_s, port.take()))
        for scan in lms.step(now_s):
            scans.append(scan)
            ranges_m.append(scan.ranges_m.copy())
        now_s += TICK_S
        assert now_s < 20
    assert lms.status.state == "running"
    assert lms.status.rejected == lms.status.missed == lms.status.losses == 0
    for name in ("LMPscancfg", "mLMPsetscancfg", "STlms"):
        assert f"{remark} {name}" in lms.status.cause
    assert lms.status.cause.endswith("says that it is busy")
    assert lms.not_ready == 7  # as recorded: status 01 00
    assert [scan.counter for scan in scans] == list(range(11, 62))
    assert {values.shape for values in ranges_m} == {(1, 541)}
    assert {fake_name.split(b" ")[1] for fake_name in fake.unknown} == {
        b"LMPscancfg",
        b"mLMPsetscancfg",
        b"STlms",
    }
    assert scans[-1].first_rad == pytest.approx(math.radians(-135))
    assert scans[-1].beam_dt_s == pytest.approx(27.78e-6, abs=1e-8)


# --- the order of a session


def test_a_willing_device_is_set_up_in_the_sheets_order_and_streams() -> None:
    bench = Bench()
    scans = bench.run(1.0)
    assert bench.fake.asked == ORDER
    assert (bench.state, bench.lms.status.cause) == ("running", "")
    assert len(scans) > 40
    assert bench.lms.status.heard_s == pytest.approx(bench.now_s, abs=0.03)


def test_a_device_that_scans_as_configured_is_not_told_so_again() -> None:
    bench = Bench()
    bench.fake.answers["sRN LMPscancfg"] = b"sRA LMPscancfg " + struct.pack(
        ">IHIii", 5000, 1, 5000, -450000, 2250000
    )
    bench.run(0.5)
    assert "sMN mLMPsetscancfg" not in bench.fake.asked
    assert bench.state == "running"


def test_the_output_range_is_written_only_where_it_does_not_cover_the_used_field() -> None:
    narrow = b"sRA LMPoutputRange " + struct.pack(">HIii", 1, 2500, 300_000, 1_500_000)
    for first_deg, written in ((30.0, False), (29.0, True)):
        bench = Bench(first_deg=first_deg, last_deg=150.0)
        bench.fake.answers["sRN LMPoutputRange"] = narrow
        bench.run(0.5)
        assert ("sWN LMPoutputRange" in bench.fake.asked) == written
        assert bench.state == "running"
    assert bench.fake.frames["sWN LMPoutputRange"][19:] == struct.pack(
        ">HIii", 1, 5000, -450_000, 2_250_000
    )


@pytest.mark.parametrize(("echo", "channels"), [("first", 1), ("last", 3), ("both", 3)])
def test_the_echo_setting_chooses_the_channels(echo: str, channels: int) -> None:
    bench = Bench(echo=echo)
    bench.run(0.5)
    assert bench.fake.frames["sWN LMDscandatacfg"][19] == channels
    missing = "the scanner sends no second echo"  # the scripted device does not obey
    assert bench.lms.status.cause == ("" if echo == "first" else missing)


def test_events_between_command_and_answer_do_not_disturb() -> None:
    bench = Bench()
    event = framed(b"sSN LIDoutputstate \x00\x01")
    for _ in range(200):
        bench.port.give(event)
        bench.port.give(framed(bench.fake.scan_payload(bench.now_s)))
        bench.run(TICK_S)
    assert bench.state == "running"
    assert bench.fake.asked == ORDER


def test_it_waits_until_the_device_says_that_it_is_ready() -> None:
    bench = Bench()
    bench.fake.answers["sRN STlms"] = b"sRA STlms " + struct.pack(">HB", 4, 0)
    assert not bench.run(30.0)
    assert bench.lms.status.cause == ("the scanner is not ready yet: its mirror is speeding up")
    assert "sEN LMDscandata" not in bench.fake.asked
    bench.fake.answers["sRN STlms"] = b"sRA STlms 7 0 8 00:34:19 A 01.01.1970 0 0 0"
    bench.run(0.5)
    assert bench.state == "running"


def test_one_that_never_gets_ready_is_set_up_anew() -> None:
    bench = Bench()
    bench.fake.answers["sRN STlms"] = b"sRA STlms " + struct.pack(">HB", 1, 0)
    bench.run(125.0)
    assert "the scanner does not get ready: initialising" in bench.causes
    assert bench.fake.asked.count("sMN Run") == 2


def test_without_a_status_the_older_device_state_is_believed_for_a_while() -> None:
    bench = Bench()
    bench.fake.answers["sRN STlms"] = UNKNOWN
    bench.fake.answers["sRN SCdevicestate"] = b"sRA SCdevicestate \x00"
    bench.run(1.5)
    assert bench.lms.status.cause == "the scanner says that it is busy"
    bench.run(1.5)
    assert bench.state == "running"
    assert bench.lms.status.cause == (
        "the scanner refuses STlms (unknown variable), says that it is busy"
    )
    bench = Bench()
    bench.fake.answers["sRN STlms"] = UNKNOWN
    bench.run(0.5)
    assert bench.state == "running"


def test_a_device_that_reports_an_error_is_not_subscribed_to() -> None:
    bench = Bench()
    bench.fake.answers["sRN STlms"] = UNKNOWN
    bench.fake.answers["sRN SCdevicestate"] = b"sRA SCdevicestate \x02"
    bench.run(3.0)
    assert "the scanner reports an error (SCdevicestate 2)" in bench.causes
    assert "sEN LMDscandata" not in bench.fake.asked


# --- refusals, silence, lost answers


@pytest.mark.parametrize("name", OPTIONAL)
@pytest.mark.parametrize("answer", [UNKNOWN, None], ids=["refused", "silent"])
def test_a_command_that_it_can_do_without_is_no_obstacle(name: str, answer: bytes | None) -> None:
    bench = Bench()
    bench.fake.answers[name] = answer
    bench.run(4.0)
    assert bench.state == "running"
    word = "does not answer" if answer is None else "refuses"
    assert f"{word} {name.split()[1]}" in bench.lms.status.cause


@pytest.mark.parametrize("name", ["sRN LMPscancfg", "sMN mLMPsetscancfg", "sRN LMPoutputRange"])
@pytest.mark.parametrize("values", [b"", b" ", b" \x00", b" \x00\x01 too short"])
def test_an_answer_without_its_values_is_no_obstacle(name: str, values: bytes) -> None:
    bench = Bench()
    bench.fake.answers[name] = GOOD_HEADS[name] + values
    bench.run(4.0)
    assert bench.state == "running"


@pytest.mark.parametrize("name", NEEDED)
def test_a_command_that_must_be_answered_is_asked_twice_then_all_begins_anew(name: str) -> None:
    bench = Bench()
    bench.fake.answers[name] = None
    bench.run(6.2)
    assert f"the scanner does not answer {name.split()[1]}" in bench.causes
    assert bench.state == "starting"
    assert bench.fake.asked.count(name) == 2 or bench.fake.asked.count("sMN SetAccessMode") == 2
    bench.fake.answers[name] = GOOD[name]
    bench.run(7.0)
    assert bench.state == "running"
    assert bench.lms.status.losses == 0  # it never ran before


@pytest.mark.parametrize("name", ["sWN LMDscandatacfg", "sMN LMCstartmeas", "sMN Run"])
def test_a_needed_command_refused_is_said_and_scans_are_taken_all_the_same(name: str) -> None:
    bench = Bench()
    bench.fake.answers[name] = SFA + b"\x00\x0a"
    bench.run(1.0)
    assert bench.state == "running"
    assert bench.lms.status.cause == (
        f"the scanner refuses {name.split()[1]} (write access denied)"
    )


def test_a_start_that_is_not_allowed_is_said() -> None:
    bench = Bench()
    bench.fake.answers["sMN LMCstartmeas"] = b"sAN LMCstartmeas \x01"
    bench.run(1.0)
    assert bench.lms.status.cause == "the scanner answers LMCstartmeas with 01"


@pytest.mark.parametrize(
    ("answer", "cause"),
    [
        (b"sAN SetAccessMode \x00", "the scanner refuses the login: was its password changed?"),
        (SFA + b"\x00\x02", "the scanner refuses the login: unknown method"),
    ],
)
def test_a_refused_login_is_said_and_tried_again(answer: bytes, cause: str) -> None:
    bench = Bench()
    bench.fake.answers["sMN SetAccessMode"] = answer
    bench.run(5.0)
    assert bench.lms.status.cause == cause
    assert set(bench.fake.asked) == {"sMN SetAccessMode"}
    assert len(bench.fake.asked) == 5
    bench.fake.answers["sMN SetAccessMode"] = GOOD["sMN SetAccessMode"]
    bench.run(2.0)
    assert bench.state == "running"


def test_a_refused_subscription_begins_all_anew() -> None:
    bench = Bench()
    bench.fake.answers["sEN LMDscandata"] = SFA + b"\x00\x0f"
    bench.run(0.5)
    assert bench.lms.status.cause == "the scanner refuses LMDscandata (unknown event)"
    bench.run(2.0)
    assert bench.fake.asked.count("sMN SetAccessMode") >= 2


def test_a_device_that_is_starting_up_is_asked_every_few_seconds_and_then_works() -> None:
    bench = Bench()
    bench.run(60.0, deaf=True)
    assert bench.fake.asked == ["sMN SetAccessMode"] * 20
    assert bench.lms.status.cause.startswith("waiting for the scanner to answer")
    bench.run(70.0, deaf=True)
    assert bench.lms.status.cause.startswith("the scanner does not answer: is it set to CoLa-B")
    bench.run(4.0)
    assert bench.state == "running"


def test_settings_that_the_device_did_not_take_are_said() -> None:
    bench = Bench(scan_rate_hz=25, angular_step_deg=0.25)
    bench.run(0.5)
    assert bench.state == "running"
    assert bench.lms.status.cause == (
        "the scanner took 50 Hz and steps of 0.5 deg, "
        "scans at 50 Hz in steps of 0.5 deg, configured are 25 Hz and 0.25 deg"
    )
    bench.fake.answers["sMN mLMPsetscancfg"] = b"sAN mLMPsetscancfg \x02" + bytes(18)
    bench.run(1.5, deaf=True)
    bench.run(6.0)
    assert bench.lms.status.cause.startswith(
        "the scanner did not take the scan rate and step: bad resolution, scans at 50 Hz"
    )


# --- running


def test_silence_is_a_loss_after_a_second_and_the_session_begins_anew() -> None:
    bench = Bench()
    bench.run(1.0)
    bench.fake.streams = False
    bench.run(0.9)
    assert bench.state == "running"
    bench.run(0.2)
    assert (bench.state, bench.lms.status.losses) == ("starting", 1)
    assert bench.lms.status.cause == "no scan from the scanner for 1 s"
    bench.run(2.0)
    assert bench.state == "running"
    assert bench.fake.asked == ORDER * 2
    assert bench.lms.status.missed == 0


def test_a_telegram_sent_again_and_again_is_silence() -> None:
    bench = Bench()
    bench.run(1.0)
    bench.fake.streams = False
    telegram = framed(bench.fake.scan_payload(bench.now_s))
    for _ in range(250):
        bench.port.give(telegram)
        bench.run(TICK_S)
    assert bench.lms.status.losses == 1
    assert bench.lms.status.rejected > 100


def test_a_new_connection_begins_a_new_session() -> None:
    bench = Bench()
    bench.run(1.0)
    bench.port.connected = False
    bench.run(0.1)
    assert (bench.state, bench.lms.status.losses) == ("closed", 1)
    bench.port.connected = True
    bench.run(1.0)
    assert bench.fake.asked == ORDER * 2
    assert bench.state == "running"


def test_scans_that_never_came_are_counted_also_across_the_wrap() -> None:
    bench = Bench()
    bench.fake.scan_number = 65_530
    bench.fake.step_by, bench.fake.period_s = 2, 0.04
    scans = bench.run(1.0)
    assert len(scans) > 20
    assert bench.lms.status.missed == len(scans) - 1


def test_a_scan_counter_that_begins_anew_is_not_taken_for_missed_scans() -> None:
    bench = Bench()
    bench.fake.scan_number = 5000
    bench.run(0.5)
    bench.fake.scan_number = 0
    bench.run(0.5)
    assert bench.lms.status.missed == 0
    assert bench.state == "running"


def test_scans_that_are_marked_as_not_valid_are_counted_and_not_delivered() -> None:
    bench = Bench()
    bench.run(0.5)
    bench.fake.status = (0, 2)
    assert not bench.run(3.0)
    assert bench.lms.status.cause == "the scanner's scans carry device status 0 2"
    assert (bench.state, bench.lms.status.losses) == ("starting", 1)
    assert bench.lms.not_ready == pytest.approx(150, abs=2)
    bench.fake.status = (0, 0)
    assert bench.run(0.5)
    assert (bench.state, bench.lms.status.cause) == ("running", "")
    assert bench.fake.asked == ORDER  # it was never silent


def test_damage_is_counted_and_the_next_scans_are_taken() -> None:
    bench = Bench()
    bench.run(0.5)
    telegram = bytearray(framed(bench.fake.scan_payload(bench.now_s)))
    telegram[500] ^= 0x10
    bench.port.give(bytes(telegram))
    assert bench.run(0.2)
    status = bench.lms.status
    assert (status.rejected, status.skipped_bytes, status.state) == (1, 1191, "running")
    assert [frame.reason for frame in status.rejections] == ["wrong checksum"]


@given(st.lists(st.binary(max_size=60) | st.sampled_from([framed(UNKNOWN), framed(b"sAN Run ")])))
def test_no_bytes_at_any_time_stop_the_session_for_good(noise: list[bytes]) -> None:
    bench = Bench()
    for piece in noise:
        bench.port.give(piece)
        bench.run(0.02)
    bench.run(8.0)
    assert bench.state == "running"
    assert bench.run(0.1)
