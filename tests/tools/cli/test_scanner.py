"""`mapod scanner` against a fake scanner on TCP, in both dialects."""

import numpy as np
import pytest

from fakes.lms1xx.device import FakeLms111
from fakes.wires.wire import TcpWire
from tests.support.real_time import served
from tools.cli import scanner

REFUSES_LOGIN = {"SetAccessMode": 1}


def five_metres() -> FakeLms111:
    return FakeLms111(lambda t_s, times_s, bearings_rad: np.full(len(times_s), 5.0), 1)


def said(capsys: pytest.CaptureFixture[str], fake: FakeLms111, *what: str, status: int = 0) -> str:
    """What the tool prints of a fake, on either stream."""
    wire = TcpWire(fake)
    with served(wire):
        got = scanner.main([*what, "--port", f"tcp://127.0.0.1:{wire.port}"])
    printed = capsys.readouterr()
    assert got == status, printed
    return printed.out + printed.err


@pytest.mark.parametrize("binary", [True, False])
def test_it_tells_who_the_scanner_is_in_either_dialect(
    binary: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    fake = five_metres()
    fake.binary = binary
    fake.contamination = 1
    told = said(capsys, fake, "info")
    assert f"speaks CoLa-{'B' if binary else 'A'}" in told
    assert "firmware V1.80.2" in told
    assert "dirty window (warning)" in told
    assert "63 times powered on" in told
    assert "25 scans/s" in told or "50 scans/s" in told


def test_settings_are_stored_only_on_request_and_run_follows(
    capsys: pytest.CaptureFixture[str],
) -> None:
    fake = five_metres()
    assert "stored" in said(capsys, fake, "store")
    assert fake.state not in (2,)  # not left being configured


@pytest.mark.parametrize("what", ["set-clock", "start", "stop", "reboot"])
def test_other_commands_are_done(what: str, capsys: pytest.CaptureFixture[str]) -> None:
    fake = five_metres()
    power_ons = fake.power_ons
    assert said(capsys, fake, what).startswith("it")
    assert fake.power_ons == power_ons + (what == "reboot")


def test_the_dialect_is_changed_for_the_next_connection(
    capsys: pytest.CaptureFixture[str],
) -> None:
    fake = five_metres()
    said(capsys, fake, "dialect", "ascii")
    assert "speaks CoLa-A" in said(capsys, fake, "info")


def test_refusals_and_silence_are_told_in_words(capsys: pytest.CaptureFixture[str]) -> None:
    fake = five_metres()
    fake.refuse = dict(REFUSES_LOGIN)
    assert "refuses SetAccessMode: access denied" in said(capsys, fake, "store", status=1)
    silent = five_metres()
    silent.mute = True
    assert "no answer in CoLa-B nor in CoLa-A" in said(capsys, silent, "info", status=1)
    assert scanner.main(["info", "--port", "nowhere"]) == 2
