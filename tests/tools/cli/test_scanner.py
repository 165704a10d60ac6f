"""`mapod scanner` against a fake scanner on a simulated network, in both dialects."""

from pathlib import Path

import numpy as np
import pytest

from fakes.lms1xx.device import FakeLms111
from fakes.urg04lx.device import FakeUrg04lx
from tests import ROOT, Capsys
from tests.support.devices.simulated_lines import Said, SimulatedLines
from tests.support.devices.streaming_urg04lx import streams_at_19200
from tools.cli import scanner


def five_metres() -> FakeLms111:
    return FakeLms111(lambda t_s, times_s, bearings_rad: np.full(len(times_s), 5.0), 1)


@pytest.fixture
def said(capsys: Capsys, lines: SimulatedLines) -> Said:
    return Said(capsys, lines, scanner.main)


@pytest.mark.parametrize("binary", [True, False])
def test_it_tells_who_the_scanner_is_in_either_dialect(binary: bool, said: Said) -> None:
    fake = five_metres()
    fake.binary = binary
    fake.contamination = 1
    told = said(fake, "info")
    assert f"speaks CoLa-{'B' if binary else 'A'}" in told
    assert "firmware V1.80.2" in told
    assert "dirty window (warning)" in told
    assert "63 times powered on" in told
    assert "25 scans/s" in told or "50 scans/s" in told


def test_what_it_is_told_is_done(said: Said) -> None:
    fake = five_metres()
    assert "stored" in said(fake, "store")
    assert fake.state != 2  # not left being configured
    for what in ("set-clock", "start", "stop"):
        assert said(fake, what).startswith("it")
    power_ons = fake.power_ons
    assert said(fake, "reboot").startswith("it")
    assert fake.power_ons == power_ons + 1


def test_the_dialect_is_changed_for_the_next_connection(said: Said) -> None:
    fake = five_metres()
    said(fake, "dialect", "ascii")
    assert "speaks CoLa-A" in said(fake, "info")


def test_refusals_and_silence_are_told_in_words(said: Said) -> None:
    fake = five_metres()
    fake.refuse = {"SetAccessMode": 1}
    assert "refuses SetAccessMode: access denied" in said(fake, "store", status=1)
    silent = five_metres()
    silent.mute = True
    assert "no answer in CoLa-B nor in CoLa-A" in said(silent, "info", status=1)


@pytest.fixture
def line_said(capsys: Capsys, lines: SimulatedLines) -> Said:
    return Said(capsys, lines, scanner.main, "baud=19200")


def test_a_hokuyo_scanner_tells_who_it_is_and_does_what_it_is_told(line_said: Said) -> None:
    """As it powers up: in SCIP 1.1, at 19200 baud."""
    fake = FakeUrg04lx(lambda t_s, times_s, bearings_rad: np.full(len(times_s), 2.0), 1)
    told = line_said(fake, "info")
    for words in ("speaks SCIP 2.0", "serial number H0614967", "to 5600 mm", "laser OFF"):
        assert words in told
    assert "laser is on" in line_said(fake, "start")
    assert fake.head.is_lit
    assert "laser is off" in line_said(fake, "stop")
    assert "those of power on" in line_said(fake, "reboot")
    assert "no such command" in line_said(fake, "store", status=1)
    fake.laser_fails = True
    assert "refuses BM: its laser has a fault" in line_said(fake, "start", status=1)
    fake.mute = True
    assert "no answer" in line_said(fake, "info", status=1)


def test_a_hokuyo_scanner_that_streams_at_19200_baud_is_stopped(
    line_said: Said, lines: SimulatedLines
) -> None:
    fake = streams_at_19200(lines)
    assert "laser is off" in line_said(fake, "stop")
    assert not fake.head.is_lit


def configured(folder: Path, robot: str, port: str) -> str:
    """Shipped settings of a robot, but for its scanner's port."""
    text = (ROOT / "robots" / f"{robot}.toml").read_text(encoding="utf-8")
    head, scanner_at = text.split("[scanner]\n")
    driver, _, rest = scanner_at.split("\n", 2)
    (folder / "mapod.toml").write_text(f'{head}[scanner]\n{driver}\nport = "{port}"\n{rest}')
    return str(folder / "mapod.toml")


def test_the_settings_driver_tells_what_it_speaks_and_not_their_port(
    tmp_path: Path, capsys: Capsys, lines: SimulatedLines
) -> None:
    fake = FakeUrg04lx(lambda t_s, times_s, bearings_rad: np.full(len(times_s), 2.0), 1, "UTM-30LX")
    path = configured(tmp_path, "messor", f"tcp://{lines.tcp(fake, '4001')}")
    assert scanner.main(["info", "--config", path]) == 0
    assert "speaks SCIP 2.0" in capsys.readouterr().out
    path = configured(tmp_path, "ragno", f"tcp://{lines.tcp(fake, '4001')}")
    assert scanner.main(["info", "--config", path]) == 2
    assert "scanner.driver: must be 'lms111' or 'urg04lx', is 'stripe'" in capsys.readouterr().err


def test_a_hokuyo_scanner_that_damages_its_number_still_tells_the_rest(line_said: Said) -> None:
    fake = FakeUrg04lx(lambda t_s, times_s, bearings_rad: np.full(len(times_s), 2.0), 1)
    fake.splits_serial = True
    line_said(fake, "info")  # from now on it speaks SCIP 2.0
    told = line_said(fake, "info")
    assert "VV not told" in told
    assert "to 5600 mm" in told
