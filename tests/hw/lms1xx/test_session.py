"""How a session with an LMS111 begins: what it reads, sets, and does where it is refused."""

import math
import struct
from pathlib import Path

import pytest

from fakes.lms1xx.recorded import RecordedLms111
from fakes.wires.wire import MemoryPort
from hw.lms1xx.session import Lms111
from tests.support.devices.scripted_lms111 import TICK_S, UNKNOWN, USUAL, WANTED, Bench, willing

READS = ["sRN LMPscancfg", "sRN LMDscandatacfg", "sRN LMPoutputRange", "sRN STlms"]
GREETING = ["sRN SCdevicestate", "sRN FirmwareVersion"]
SETTING_UP = [
    "sMN SetAccessMode",
    "sMN mLMPsetscancfg",
    "sWN LMDscandatacfg",
    "sWN LMPoutputRange",
    "sMN LMCstartmeas",
    "sMN Run",
]
WHOLE = [*GREETING, *READS, *SETTING_UP, "sRN STlms", *READS[:3], "sEN LMDscandata"]
SHORT = [*GREETING, *READS, "sEN LMDscandata"]


def state_is(code: int) -> bytes:
    return b"sRA STlms " + struct.pack(">HB", code, 0)


# --- the recorded device


def test_the_recorded_device_accepts_our_commands_and_delivers_its_scans(vectors: Path) -> None:
    fake = RecordedLms111.from_files(vectors / "lms111_session_d2h.bin")
    port, scans = MemoryPort(), []
    lms = Lms111(port, USUAL)
    now_s = 0.0
    while not fake.done:
        port.give(fake.exchange(now_s, port.take()))
        scans += lms.step(now_s)
        now_s += TICK_S
        assert now_s < 20
    assert lms.status.state == "running"
    assert lms.status.rejected == lms.status.missed == lms.status.losses == 0
    for name in ("LMPscancfg", "mLMPsetscancfg", "STlms"):
        assert f"refuses {name}" in lms.status.cause
    assert lms.status.cause.endswith("says that it is busy")
    assert [scan.counter for scan in scans] == list(range(11, 62))  # 4 to 10 had status 01 00
    assert {scan.ranges_m.shape for scan in scans} == {(1, 541)}
    assert scans[-1].first_rad == pytest.approx(math.radians(-135))
    assert scans[-1].beam_dt_s == pytest.approx(27.78e-6, abs=1e-8)
    assert lms.identity == "firmware V1.80.2, serial number 18090362"


# --- the order of a session


@pytest.mark.parametrize("is_text", [False, True], ids=["binary", "ascii"])
def test_a_device_is_set_up_in_the_sheets_order_then_read_back_and_streams(is_text: bool) -> None:
    bench = Bench()
    bench.fake.is_text = is_text
    scans = bench.run(0.7)
    assert [name for name in bench.fake.asked if name != "sRN LCMstate"] == WHOLE
    assert (bench.state, bench.cause, bench.lms.status.rejected) == ("running", "", 0)
    assert len(scans) > 15
    whole = {"LMPoutputRange": (1, 5000, -450_000, 2_250_000)}
    assert bench.fake.settings == WANTED | whole


def test_a_device_that_measures_as_wanted_is_not_logged_in_to_on_any_connection() -> None:
    bench = willing()
    for lost in range(1, 4):
        assert len(bench.run(0.4)) > 10
        assert bench.fake.asked == SHORT
        assert (bench.state, bench.cause) == ("running", "")
        bench.reconnect()
        assert bench.lms.status.losses == lost


@pytest.mark.parametrize("variable", list(WANTED))
@pytest.mark.parametrize(
    ("answer", "said"),
    [(UNKNOWN, "refuses"), (None, "does not answer"), (b"", ""), (b" \x00\x01 too short", "")],
    ids=["refused", "silent", "without values", "too short"],
)
def test_a_setting_that_can_not_be_read_is_set(
    variable: str, answer: bytes | None, said: str
) -> None:
    bench = willing()
    given = f"sRA {variable}".encode() + (answer or b"")
    bench.fake.answers[f"sRN {variable}"] = answer if said else given
    bench.run(4.0 if answer is None else 0.7)
    assert "sMN Run" in bench.fake.asked
    assert bench.fake.asked.count(f"sRN {variable}") == (1 if said else 2)
    assert (bench.state, f"{said} {variable}" in bench.cause) == ("running", bool(said))


@pytest.mark.parametrize(("echo", "channels"), [("first", 1), ("last", 3), ("both", 3)])
def test_the_echo_setting_chooses_the_channels(echo: str, channels: int) -> None:
    bench = Bench(echo=echo)
    bench.run(0.8)
    assert bench.fake.settings["LMDscandatacfg"][0] == channels
    missing = "the scanner sends no second echo"  # the scripted device's scans have one echo
    assert bench.cause == ("" if echo == "first" else missing)


@pytest.mark.parametrize("state", [1, 4, 5, 6])
def test_one_that_starts_with_the_wanted_settings_is_waited_for_without_a_login(state: int) -> None:
    bench = willing()
    bench.fake.state = state
    assert not bench.run(8.0)
    assert bench.cause.startswith("the scanner is not ready yet: ")
    bench.fake.state = 7
    assert bench.run(0.3)
    assert "sMN SetAccessMode" not in bench.fake.asked


def test_one_that_was_left_idle_is_set_running_and_one_that_never_gets_ready_anew() -> None:
    for state in (2, 3):
        bench = willing()
        bench.fake.state = state
        assert bench.run(0.5)
        assert "sMN Run" in bench.fake.asked
    bench = Bench()
    bench.fake.answers["sRN STlms"] = state_is(1)
    bench.run(125.0, tick_s=0.1)
    assert "the scanner does not get ready: initialising" in bench.causes


def test_one_that_stays_idle_after_run_is_thought_to_have_another_host() -> None:
    bench = Bench()
    bench.fake.answers["sRN STlms"] = state_is(2)
    bench.run(20.0, tick_s=0.02)
    another = "the scanner is being configured: another host may be configuring it"
    assert another in bench.causes
    assert 2 <= bench.fake.asked.count("sMN SetAccessMode") <= 5
    del bench.fake.answers["sRN STlms"]
    bench.run(8.0)
    assert bench.state == "running"


def test_without_a_status_the_older_device_state_is_believed_for_a_while() -> None:
    bench = Bench()
    bench.fake.answers["sRN STlms"] = UNKNOWN
    bench.fake.answers["sRN SCdevicestate"] = b"sRA SCdevicestate \x02"
    bench.run(0.5)
    assert any("reports an error (SCdevicestate 2)" in cause for cause in bench.causes)
    assert "sEN LMDscandata" not in bench.fake.asked
    bench = Bench()
    bench.fake.answers["sRN STlms"] = UNKNOWN
    bench.fake.answers["sRN SCdevicestate"] = b"sRA SCdevicestate \x00"
    bench.run(1.5)
    assert bench.cause == "the scanner is not ready yet: busy"
    bench.run(1.5)
    assert bench.state == "running"
    assert bench.cause == "the scanner refuses STlms (unknown variable), says that it is busy"


# --- refusals


@pytest.mark.parametrize(
    ("refusal", "reason"),
    [(b"sFA\x00\x0a", "write access denied"), (b"sFA 11", "text: invalid character")],
    ids=["binary", "ascii"],
)
@pytest.mark.parametrize("name", SETTING_UP[1:])
def test_what_a_device_refuses_while_it_is_set_up_is_said_and_it_goes_on(
    name: str, refusal: bytes, reason: str
) -> None:
    bench = Bench()
    bench.fake.is_text = refusal[3:4] == b" "
    bench.fake.answers[name] = refusal
    if name == "sMN Run":  # else it would not measure
        bench.fake.answers["sRN STlms"] = b"sRA STlms 7 0"
    bench.run(0.7)
    assert bench.state == "running"
    assert f"refuses {name.split()[1]} ({reason})" in bench.cause


def test_firmware_that_refuses_the_output_range_goes_on_with_its_own() -> None:
    bench = Bench(first_deg=0.0, last_deg=180.0)  # which is what it has
    bench.fake.answers["sWN LMPoutputRange"] = b"sFA\x00\x0a"  # firmware 1.23
    bench.run(1.0)
    assert bench.cause == "the scanner refuses LMPoutputRange (write access denied)"
    bench.reconnect(4.0)
    bench.run(0.3)
    assert bench.state == "running"
    assert "sMN SetAccessMode" not in bench.fake.asked  # it would change nothing


TOLD = "not 1 0 0 0 0 0 0 0 0 0 1 1 as it was told"


@pytest.mark.parametrize(
    ("name", "answer", "cause"),
    [
        ("sRN STlms", UNKNOWN, "refuses STlms (unknown variable)"),
        ("sMN LMCstartmeas", b"sAN LMCstartmeas \x01", "answers LMCstartmeas with 1, which is no"),
        ("sWN LMPoutputRange", b"sFA\x00\x04", "refuses LMPoutputRange (value out of range)"),
        *(
            (
                "sMN mLMPsetscancfg",
                b"sAN mLMPsetscancfg " + bytes([status, *bytes(18)]),
                f"did not take the scan rate and step: {what}",
            )
            for status, what in ((1, "bad frequency"), (4, "bad area"), (5, "status 5"))
        ),
        (
            "sRN LMDscandatacfg",
            b"sRA LMDscandatacfg \x03" + bytes(11) + b"\x01",
            f"has LMDscandatacfg 3 0 0 0 0 0 0 0 0 0 0 1, {TOLD}",
        ),
        *(
            (
                "sMN SetAccessMode",
                answer,
                f"refuses the login ({why}), has LMDscandatacfg 1 0 1 1 0 0 0 0 0 0 0 1, {TOLD}",
            )
            for answer, why in (
                (b"sAN SetAccessMode \x00", "was its password changed?"),
                (b"sFA\x00\x02", "unknown method"),
            )
        ),
    ],
)
def test_what_the_device_did_not_do_is_said_and_what_measures_is_used_as_it_is(
    name: str, answer: bytes, cause: str
) -> None:
    bench = Bench()
    bench.fake.answers[name] = answer
    bench.run(0.7)
    assert (bench.state, bench.cause) == ("running", f"the scanner {cause}")


def test_a_refused_login_to_one_that_does_not_measure_is_said_and_tried_again() -> None:
    bench = Bench()
    bench.fake.answers["sMN SetAccessMode"] = b"sFA\x00\x02"
    bench.fake.state = 3
    bench.run(5.0)
    before = len(bench.causes)
    bench.run(20.0, tick_s=0.02)
    assert len(bench.causes) == before  # one cause, as long as nothing changes
    assert bench.cause.startswith("the scanner refuses the login: unknown method")
    assert 5 <= bench.fake.asked.count("sMN SetAccessMode") <= 16
    del bench.fake.answers["sMN SetAccessMode"]
    bench.run(5.0)
    assert bench.state == "running"


def test_a_refused_subscription_begins_all_anew() -> None:
    bench = Bench()
    bench.fake.answers["sEN LMDscandata"] = b"sFA\x00\x0f"
    bench.run(0.5)
    assert bench.cause.startswith("the scanner refuses LMDscandata (unknown event)")
    bench.run(3.0)
    assert 3 <= bench.fake.asked.count("sEN LMDscandata") <= 6
    del bench.fake.answers["sEN LMDscandata"]
    bench.run(3.5)
    assert bench.state == "running"


def test_rate_and_step_of_the_scans_themselves_are_held_against_the_settings() -> None:
    bench = Bench(scan_rate_hz=25, angular_step_deg=0.25)
    bench.run(0.7)
    scans = "scans at 50 Hz in steps of 0.5 deg, configured are 25 Hz and 0.25 deg"
    assert bench.cause == f"the scanner {scans}"


# --- Run is never forgotten: commands that are lost, late or cut off


@pytest.mark.parametrize("name", [*SETTING_UP, "sEN LMDscandata", "sRN STlms"])
def test_silence_at_any_command_ends_in_scans_or_in_a_new_attempt(name: str) -> None:
    bench = Bench()
    bench.fake.answers[name] = None
    bench.run(6.0)
    said = f"does not answer {name.split()[1]}"
    assert any(said in cause for cause in bench.causes)
    del bench.fake.answers[name]
    for _ in range(12):
        if bench.run(1.0):
            break
    assert (bench.state, bench.fake.state) == ("running", 7)


@pytest.mark.parametrize("name", ["sMN SetAccessMode", "sMN LMCstartmeas"])
def test_run_is_sent_where_only_the_answer_to_the_login_or_to_what_follows_was_lost(
    name: str,
) -> None:
    bench = Bench()
    bench.fake.late_s[name] = 1e6
    bench.run_until_asked("sMN Run")
    assert ("sWN LMDscandatacfg" in bench.fake.asked) is (name == "sMN LMCstartmeas")
    assert f"the scanner does not answer {name.split()[1]}" in bench.causes
    assert bench.fake.state == 7  # other hosts have their scans


def test_run_is_sent_on_the_next_connection_where_the_login_was_cut_off() -> None:
    bench = Bench()
    bench.fake.answers["sWN LMDscandatacfg"] = None
    bench.run_until_asked("sWN LMDscandatacfg")
    bench.fake.settings = dict(WANTED)
    bench.reconnect()
    bench.run(1.0)
    assert bench.fake.asked[:3] == [*GREETING, "sMN Run"]
    assert "sMN SetAccessMode" not in bench.fake.asked
    assert bench.state == "running"


def test_a_refusal_that_comes_too_late_is_not_taken_for_the_next_commands() -> None:
    bench = willing()
    bench.fake.answers["sRN LMPscancfg"] = UNKNOWN
    bench.fake.late_s["sRN LMPscancfg"] = 2.7  # we wait for 2.5 s
    bench.run(5.0)
    assert bench.state == "running"
    assert bench.cause == "the scanner does not answer LMPscancfg"


@pytest.mark.parametrize("answer", [None, UNKNOWN])
def test_a_device_that_does_not_tell_its_firmware_is_not_waited_for_at_every_command(
    answer: bytes | None,
) -> None:
    bench = Bench()
    bench.fake.answers["sRN FirmwareVersion"] = answer
    bench.run(1.5)
    assert (bench.state, bench.cause) == ("running", "")
    assert "firmware" not in bench.lms.identity
