"""Run is never forgotten: commands to an LMS111 that are lost, late or cut off."""

import pytest

from tests.hw.lms1xx.test_session import GREETING, SETTING_UP, UNKNOWN
from tests.support.scripted_lms111 import TICK_S, WANTED, Bench


def run_until_asked(bench: Bench, name: str) -> None:
    for _ in range(4000):
        bench.run(TICK_S)
        if name in bench.fake.asked:
            return
    raise AssertionError(bench.fake.asked)


@pytest.mark.parametrize("name", [*dict.fromkeys(SETTING_UP), "sEN LMDscandata", "sRN STlms"])
def test_silence_at_any_command_ends_in_scans_or_in_a_new_attempt(name: str) -> None:
    bench = Bench()
    bench.fake.answers[name] = None
    bench.run(8.0)
    said = f"does not answer {name.split()[1]}"
    assert any(said in cause for cause in bench.causes)
    del bench.fake.answers[name]
    bench.run(12.0)
    assert bench.state == "running"
    assert bench.fake.state == 7


def test_run_is_sent_whatever_fails_after_the_login() -> None:
    bench, name = Bench(), "sMN LMCstartmeas"
    bench.fake.answers[name] = None
    run_until_asked(bench, "sMN Run")
    assert f"the scanner does not answer {name.split()[1]}" in bench.causes
    asked = bench.fake.asked
    assert asked.index("sMN Run") > asked.index(name)
    assert "sMN SetAccessMode" not in asked[asked.index(name) : asked.index("sMN Run")]
    assert bench.fake.state == 7  # other hosts have their scans


def test_run_is_sent_on_the_next_connection_where_the_login_was_cut_off() -> None:
    bench = Bench()
    bench.fake.answers["sWN LMDscandatacfg"] = None
    run_until_asked(bench, "sWN LMDscandatacfg")
    bench.fake.settings = dict(WANTED)
    bench.reconnect()
    bench.run(1.0)
    assert bench.fake.asked[:3] == [*GREETING, "sMN Run"]
    assert "sMN SetAccessMode" not in bench.fake.asked
    assert bench.state == "running"


def test_run_is_sent_where_only_the_answer_to_the_login_was_lost() -> None:
    bench = Bench()
    bench.fake.late_s["sMN SetAccessMode"] = 1e6
    run_until_asked(bench, "sMN Run")
    assert "sWN LMDscandatacfg" not in bench.fake.asked
    assert bench.fake.state == 7


def test_a_refusal_that_comes_too_late_is_not_taken_for_the_next_commands() -> None:
    bench = Bench()
    bench.fake.answers["sRN LMPscancfg"] = UNKNOWN
    bench.fake.late_s["sRN LMPscancfg"] = 2.7  # we wait for 2.5 s
    bench.fake.settings = dict(WANTED)
    bench.run(5.0)
    assert bench.state == "running"
    assert bench.cause == "the scanner does not answer LMPscancfg"


def test_a_device_that_does_not_tell_its_firmware_is_not_waited_for_at_every_command() -> None:
    bench = Bench()
    bench.fake.answers["sRN FirmwareVersion"] = None
    bench.run(1.5)
    assert (bench.state, bench.cause, bench.lms.condition.firmware) == ("running", "", "")
    refusing = Bench()
    refusing.fake.answers["sRN FirmwareVersion"] = UNKNOWN
    refusing.run(1.0)
    assert (refusing.state, refusing.cause) == ("running", "")
