"""`mapod drive` against a fake controller, on a simulated line."""

import sys
from pathlib import Path

import pytest

from fakes.ax3500.device import FakeAx3500
from fakes.ax3500.properties import Mode
from tests import ROOT, Capsys, Patch
from tests.support.devices.simulated_lines import Said, SimulatedLines
from tests.support.machine.real_time import StillWheels
from tools.cli import drive


@pytest.fixture
def said(capsys: Capsys, lines: SimulatedLines) -> Said:
    return Said(capsys, lines, drive.main, "baud=9600&parity=E&bytesize=7")


@pytest.mark.parametrize(
    ("mode", "words"),
    [("rs232_watchdog", "mode RS-232 with watchdog\n"), ("rs232", "mapod moves no motor with it")],
)
def test_info_tells_how_the_controller_is(mode: Mode, words: str, said: Said) -> None:
    wheels = StillWheels()
    told = said(FakeAx3500(wheels, 1, mode), "info")
    assert words in told
    assert "with encoder module" in told
    assert "battery 2" in told
    assert "emergency stop not pressed" in told
    assert "counters 0 and 0" in told
    assert wheels.power == (0.0, 0.0)


def test_watch_tells_counters_and_status_in_a_line(said: Said) -> None:
    told = said(FakeAx3500(StillWheels(), 1), "watch", "--seconds", "0.1")
    assert told.startswith("counters 0 and 0; battery")
    assert len(told.splitlines()) == 1


def test_a_controller_that_logs_or_is_silent_is_told_and_left_as_it_is(said: Said) -> None:
    radio, silent = FakeAx3500(StillWheels(), 1, "rc"), FakeAx3500(StillWheels(), 1)
    assert "R/C or analog mode" in said(radio, "info", status=1)
    assert radio.mode == "rc"
    silent.mute = True
    assert "check power, baud=9600" in said(silent, "info", status=1)


def test_keys_want_a_keyboard(capsys: Capsys, monkeypatch: Patch) -> None:
    with Path("/dev/null").open() as nothing:
        monkeypatch.setattr(sys, "stdin", nothing)
        assert drive.main(["keys", "--port", "udp://127.0.0.1:0"]) == 1
    told = "mapod drive keys: udp://127.0.0.1:0: driving needs a terminal with a keyboard\n"
    assert capsys.readouterr().err == told
    with pytest.raises(SystemExit, match="2"):
        drive.main(["keys", "--speed", "0"])
    assert "mapod drive keys: argument --speed: must be from" in capsys.readouterr().err


def test_of_a_robot_without_a_drive_there_is_nothing_to_read(capsys: Capsys) -> None:
    assert drive.main(["info", "--config", str(ROOT / "robots" / "cart.toml")]) == 2
    assert "[drive] driver is 'none', there is no port" in capsys.readouterr().err
