"""How a session with an LMS111 begins: what it reads, sets, and does where it is refused."""

import math
import struct
from pathlib import Path

import pytest

from fakes.lms1xx.recorded import RecordedLms111
from fakes.wires.wire import MemoryPort
from hw.lms1xx.session import Lms111
from tests.support.scripted_lms111 import SFA, TICK_S, WANTED, Bench

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
BETWEEN = ["sMN mLMPsetscancfg", "sWN LMDscandatacfg", "sWN LMPoutputRange", "sMN LMCstartmeas"]
UNKNOWN = SFA + b"\x00\x03"
CODES = {1: "access denied", 4: "value out of range", 8: "arguments too short"} | {
    0x0A: "write access denied", 0x0D: "server busy", 0x11: "text: invalid character"
}  # fmt: skip


def refusal(bench: Bench, code: int) -> bytes:
    return f"sFA {code:X}".encode() if bench.fake.is_text else SFA + struct.pack(">H", code)


# --- the recorded device


class SilentToUnknown(RecordedLms111):
    """The recorded device, if it does not answer at all what the recording does not hold."""

    def exchange(self, now_s: float, received: bytes) -> bytes:
        sent = super().exchange(now_s, received)
        return b"" if sent.startswith(b"\x02\x02\x02\x02\x00\x00\x00\x05sFA") else sent


@pytest.mark.parametrize(
    ("device", "remark"), [(RecordedLms111, "refuses"), (SilentToUnknown, "does not answer")]
)
@pytest.mark.parametrize("dialect", ["auto", "binary"])
def test_the_recorded_device_accepts_our_commands_and_delivers_its_scans(
    device: type[RecordedLms111], remark: str, dialect: str, vectors: Path
) -> None:
    fake = device.from_files(vectors / "lms111_session_d2h.bin")
    port, scans, ranges_m = MemoryPort(), [], []
    lms = Lms111(
        port,
        dialect=dialect,  # type: ignore[arg-type]
        scan_rate_hz=50,
        angular_step_deg=0.5,
        first_deg=-45,
        last_deg=225,
        echo="first",
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
    assert scans[-1].first_rad == pytest.approx(math.radians(-135))
    assert scans[-1].beam_dt_s == pytest.approx(27.78e-6, abs=1e-8)
    assert (lms.condition.firmware, lms.condition.serial_number) == ("V1.80.2", 18090362)


# --- the order of a session


@pytest.mark.parametrize("is_text", [False, True], ids=["binary", "ascii"])
def test_a_device_is_set_up_in_the_sheets_order_then_read_back_and_streams(is_text: bool) -> None:
    bench = Bench()
    bench.fake.is_text = is_text
    scans = bench.run(1.0)
    asked = [name for name in bench.fake.asked if name != "sRN LCMstate"]
    assert asked == WHOLE
    assert (bench.state, bench.cause) == ("running", "")
    assert len(scans) > 15
    assert bench.fake.settings["LMPscancfg"] == WANTED["LMPscancfg"]
    assert bench.fake.settings["LMDscandatacfg"] == WANTED["LMDscandatacfg"]
    assert bench.fake.settings["LMPoutputRange"] == (1, 5000, -450_000, 2_250_000)
    assert bench.lms.condition.firmware == "V1.80.2"
    assert bench.lms.status.rejected == 0


def test_a_device_that_measures_as_wanted_is_not_logged_in_to_on_any_connection() -> None:
    bench = Bench()
    bench.fake.settings = dict(WANTED)
    for lost in range(1, 4):
        assert len(bench.run(0.4)) > 10
        assert bench.fake.asked == SHORT
        assert (bench.state, bench.cause) == ("running", "")
        bench.reconnect()
        assert bench.lms.status.losses == lost


@pytest.mark.parametrize("variable", list(WANTED))
@pytest.mark.parametrize("answer", [UNKNOWN, None], ids=["refused", "silent"])
def test_a_setting_that_can_not_be_read_is_set(variable: str, answer: bytes | None) -> None:
    bench = Bench()
    bench.fake.settings = dict(WANTED)
    bench.fake.answers[f"sRN {variable}"] = answer
    bench.run(4.0)
    assert "sMN Run" in bench.fake.asked
    assert bench.fake.asked.count(f"sRN {variable}") == 1
    word = "does not answer" if answer is None else "refuses"
    assert (bench.state, f"{word} {variable}" in bench.cause) == ("running", True)


@pytest.mark.parametrize("name", ["sRN LMPscancfg", "sMN mLMPsetscancfg", "sRN LMPoutputRange"])
@pytest.mark.parametrize("values", [b"", b" ", b" \x00", b" \x00\x01 too short"])
def test_an_answer_without_its_values_is_no_obstacle(name: str, values: bytes) -> None:
    bench = Bench()
    kind, _, variable = name.partition(" ")
    head = {"sRN": "sRA", "sMN": "sAN"}[kind] + " " + variable
    bench.fake.answers[name] = head.encode() + values
    bench.run(4.0)
    assert bench.state == "running"


@pytest.mark.parametrize(("echo", "channels"), [("first", 1), ("last", 3), ("both", 3)])
def test_the_echo_setting_chooses_the_channels(echo: str, channels: int) -> None:
    bench = Bench(echo=echo)
    bench.run(0.8)
    assert bench.fake.frames["sWN LMDscandatacfg"][19] == channels
    missing = "the scanner sends no second echo"  # the scripted device's scans have one echo
    assert bench.cause == ("" if echo == "first" else missing)


@pytest.mark.parametrize("state", [1, 4, 5, 6])
def test_one_that_starts_with_the_wanted_settings_is_waited_for_without_a_login(state: int) -> None:
    bench = Bench()
    bench.fake.settings, bench.fake.state = dict(WANTED), state
    assert not bench.run(30.0)
    assert bench.cause.startswith("the scanner is not ready yet: ")
    bench.fake.state = 7
    assert bench.run(0.3)
    assert "sMN SetAccessMode" not in bench.fake.asked


def test_one_that_was_left_idle_is_set_running_and_one_that_never_gets_ready_anew() -> None:
    for state in (2, 3):
        bench = Bench()
        bench.fake.settings, bench.fake.state = dict(WANTED), state
        assert bench.run(0.5)
        assert "sMN Run" in bench.fake.asked
    bench = Bench()
    bench.fake.answers["sRN STlms"] = b"sRA STlms " + struct.pack(">HB", 1, 0)
    bench.run(125.0)
    assert "the scanner does not get ready: initialising" in bench.causes


def test_one_that_stays_idle_after_run_is_thought_to_have_another_host() -> None:
    bench = Bench()
    bench.fake.answers["sRN STlms"] = b"sRA STlms " + struct.pack(">HB", 2, 0)
    bench.run(20.0)
    another = "the scanner is being configured: another host may be configuring it"
    assert another in bench.causes
    assert 2 <= bench.fake.asked.count("sMN SetAccessMode") <= 5
    del bench.fake.answers["sRN STlms"]
    bench.run(8.0)
    assert bench.state == "running"


def test_without_a_status_the_older_device_state_is_believed_for_a_while() -> None:
    bench = Bench()
    bench.fake.answers["sRN STlms"] = UNKNOWN
    bench.fake.answers["sRN SCdevicestate"] = b"sRA SCdevicestate \x00"
    bench.run(1.5)
    assert bench.cause == "the scanner is not ready yet: busy"
    bench.run(1.5)
    assert bench.state == "running"
    assert bench.cause == "the scanner refuses STlms (unknown variable), says that it is busy"
    bench = Bench()
    bench.fake.answers["sRN STlms"] = UNKNOWN
    bench.run(0.5)
    assert bench.state == "running"


def test_a_device_that_reports_an_error_is_not_subscribed_to() -> None:
    bench = Bench()
    bench.fake.answers["sRN STlms"] = UNKNOWN
    bench.fake.answers["sRN SCdevicestate"] = b"sRA SCdevicestate \x02"
    bench.run(3.0)
    assert any("reports an error (SCdevicestate 2)" in cause for cause in bench.causes)
    assert "sEN LMDscandata" not in bench.fake.asked


# --- refusals


@pytest.mark.parametrize("is_text", [False, True], ids=["binary", "ascii"])
@pytest.mark.parametrize("code", list(CODES))
@pytest.mark.parametrize("name", [*BETWEEN, "sMN Run"])
def test_what_a_device_refuses_while_it_is_set_up_is_said_and_it_goes_on(
    name: str, code: int, is_text: bool
) -> None:
    bench = Bench()
    bench.fake.is_text = is_text
    bench.fake.answers[name] = refusal(bench, code)
    if name == "sMN Run":  # else it would not measure
        bench.fake.answers["sRN STlms"] = b"sRA STlms 7 0"
    bench.run(1.0)
    assert bench.state == "running"
    assert f"refuses {name.split()[1]} ({CODES[code]})" in bench.cause


def test_firmware_that_refuses_the_output_range_goes_on_with_its_own() -> None:
    bench = Bench(first_deg=0.0, last_deg=180.0)  # which is what it has
    bench.fake.answers["sWN LMPoutputRange"] = SFA + b"\x00\x0a"  # firmware 1.23
    bench.run(1.0)
    assert bench.cause == "the scanner refuses LMPoutputRange (write access denied)"
    bench.reconnect(4.0)
    bench.run(0.3)
    assert bench.state == "running"
    assert "sMN SetAccessMode" not in bench.fake.asked  # it would change nothing
    narrow = Bench()
    narrow.fake.answers["sWN LMPoutputRange"] = SFA + b"\x00\x04"
    narrow.run(1.0)
    assert "was asked for -45 to 225 deg and says 0 to 180 deg" in narrow.cause


@pytest.mark.parametrize(
    ("answer", "why"),
    [
        (b"sAN SetAccessMode \x00", "was its password changed?"),
        (SFA + b"\x00\x02", "unknown method"),
    ],
)
def test_a_refused_login_is_said_and_what_measures_is_used_as_it_is(
    answer: bytes, why: str
) -> None:
    bench = Bench()
    bench.fake.answers["sMN SetAccessMode"] = answer
    bench.run(1.0)
    assert bench.state == "running"
    assert bench.cause == (
        f"the scanner refuses the login ({why}), was asked for 50 Hz in steps of 0.5 deg and says "
        "25 Hz in steps of 0.5 deg, has remission 1 in its scans, not 0 as it was told, "
        "has 16 bit remission 1 in its scans, not 0 as it was told, "
        "has time 0 in its scans, not 1 as it was told, "
        "was asked for -45 to 225 deg and says 0 to 180 deg"
    )
    idle = Bench()
    idle.fake.answers["sMN SetAccessMode"] = answer
    idle.fake.state = 3
    idle.run(5.0)
    before = len(idle.causes)
    idle.run(60.0)
    assert len(idle.causes) == before  # one cause, as long as nothing changes
    assert idle.cause.startswith(f"the scanner refuses the login: {why}")
    assert 10 <= idle.fake.asked.count("sMN SetAccessMode") <= 40
    del idle.fake.answers["sMN SetAccessMode"]
    idle.run(5.0)
    assert idle.state == "running"


def test_a_refused_subscription_begins_all_anew() -> None:
    bench = Bench()
    bench.fake.answers["sEN LMDscandata"] = SFA + b"\x00\x0f"
    bench.run(0.5)
    assert bench.cause.startswith("the scanner refuses LMDscandata (unknown event)")
    bench.run(3.0)
    assert 3 <= bench.fake.asked.count("sEN LMDscandata") <= 6
    del bench.fake.answers["sEN LMDscandata"]
    bench.run(3.5)
    assert bench.state == "running"


ASKED = "was asked for 50 Hz in steps of 0.5 deg and says 25 Hz in steps of 0.5 deg"
NOT_TAKEN = {1: "bad frequency", 2: "bad resolution", 4: "bad area", 5: "status 5"}


@pytest.mark.parametrize(
    ("answers", "cause"),
    [
        (
            {"sMN LMCstartmeas": b"sAN LMCstartmeas \x01"},
            "answers LMCstartmeas with 1, which is no",
        ),
        *(
            (
                {"sMN mLMPsetscancfg": b"sAN mLMPsetscancfg " + bytes([status, *bytes(18)])},
                f"did not take 50 Hz in steps of 0.5 deg: {what}, {ASKED}",
            )
            for status, what in NOT_TAKEN.items()
        ),
        (
            {"sRN LMDscandatacfg": b"sRA LMDscandatacfg \x03" + bytes(11) + b"\x01"},
            "has echoes 3 in its scans, not 1 as it was told, "
            "has time 0 in its scans, not 1 as it was told",
        ),
    ],
)
def test_what_the_device_did_not_take_is_said(answers: dict[str, bytes], cause: str) -> None:
    bench = Bench()
    bench.fake.answers |= answers
    bench.run(1.0)
    assert (bench.state, bench.cause) == ("running", f"the scanner {cause}")


def test_what_is_read_back_counts_less_than_the_scans_themselves() -> None:
    bench = Bench(scan_rate_hz=25, angular_step_deg=0.25)
    other = b"sRA LMPscancfg " + struct.pack(">IHIii", 5000, 1, 5000, -450000, 2250000)
    bench.fake.answers["sRN LMPscancfg"] = other
    bench.run(1.0)
    scans = "scans at 50 Hz in steps of 0.5 deg, configured are 25 Hz and 0.25 deg"
    assert bench.cause == f"the scanner {scans}"
