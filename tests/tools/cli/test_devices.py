"""`mapod devices` against fakes on simulated lines: which device speaks where, what it prints."""

import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fakes.ax3500.device import FakeAx3500
from fakes.lms1xx.device import FakeLms111
from fakes.stripe.video import FakeVideo
from fakes.urg04lx.device import FakeUrg04lx
from hw.ports.url import parse_url
from tests import Capsys, Patch
from tests.support.devices.simulated_lines import START_S, SimulatedLines
from tests.support.devices.streaming_urg04lx import streams_at_19200
from tests.support.machine.plain_user import as_plain_user
from tests.support.machine.real_time import StillWheels, level_sensor
from tools.cli import devices, scip
from tools.cli.devices import Found, toml_lines, udev_rules


@pytest.mark.parametrize("mode", ["rs232", "rc"])
def test_both_serial_devices_are_found(mode: str, capsys: Capsys, lines: SimulatedLines) -> None:
    wheels, sensor = StillWheels(), level_sensor()
    drive = FakeAx3500(wheels, 1, "rc" if mode == "rc" else "rs232")
    ahrs_path, drive_path = lines.serial(sensor), lines.serial(drive)
    assert devices.main([ahrs_path, drive_path]) == 0
    printed = capsys.readouterr().out
    urls = dict(re.findall(r'^\[(\w+)\]\nport = "(.+)"$', printed, re.MULTILINE))
    assert parse_url(urls["ahrs"]).path == ahrs_path
    assert parse_url(urls["ahrs"]).baud == 115_200
    assert parse_url(urls["drive"]).path == drive_path
    assert parse_url(urls["drive"]).baud == 9600
    assert "MTi-28A53G35" in printed
    assert ("R/C" in printed) == (mode == "rc")
    assert wheels.power == (0.0, 0.0)
    assert drive.mode == mode  # looking does not take the vehicle from its radio
    lines.run(ahrs_path, lambda: sensor.state.value == "measuring")


def test_a_silent_port_is_told_in_words(capsys: Capsys, lines: SimulatedLines) -> None:
    silent = level_sensor()
    silent.mute = True
    path = lines.serial(silent)
    assert devices.main([path, "/dev/no-such-line"]) == 1
    printed = capsys.readouterr().out
    assert f"# {path}: silent" in printed
    assert "no such device" in printed


@pytest.mark.parametrize("binary", [True, False])
def test_a_scanner_is_found_with_its_dialect(
    binary: bool, capsys: Capsys, lines: SimulatedLines
) -> None:
    fake = FakeLms111(lambda t_s, times_s, bearings_rad: np.full(len(times_s), 5.0), 1)
    fake.binary = binary
    place = lines.tcp(fake)
    assert devices.main(["/dev/no-such-line", "--scanner", place]) == 0
    printed = capsys.readouterr().out
    assert f'port = "tcp://{place}"' in printed
    assert f'dialect = "{"binary" if binary else "ascii"}"' in printed
    assert "V1.80.2" in printed


@pytest.mark.parametrize("model", ["URG-04LX", "URG-04LX-UG01"])
def test_a_hokuyo_scanner_is_found_on_a_line_and_measures_on(
    model: str, capsys: Capsys, lines: SimulatedLines
) -> None:
    fake = FakeUrg04lx(lambda t_s, times_s, bearings_rad: np.full(len(times_s), 2.0), 1, model)
    path = lines.serial(fake)
    assert devices.main([path]) == 0
    printed = capsys.readouterr().out
    url = re.findall(r'^\[scanner\]\ndriver = "urg04lx".*\nport = "(.+)"$', printed, re.MULTILINE)[
        0
    ]
    assert (parse_url(url).path, parse_url(url).baud in (19_200, 115_200)) == (path, True)
    assert "serial number H0614967" in printed


@pytest.mark.parametrize("wait_s", [0.0, 0.5, 1.12])  # within a scan, and between two
def test_a_hokuyo_scanner_that_streams_at_its_slowest_is_found_and_stopped(
    wait_s: float, capsys: Capsys, lines: SimulatedLines
) -> None:
    """A scan takes 1.11 s on the line then."""
    fake = streams_at_19200(lines)
    path = lines.serial(fake)
    until_s = lines.clocks[path] + wait_s
    lines.run(path, lambda: lines.clocks[path] >= until_s)
    assert devices.main([path]) == 0
    printed = capsys.readouterr().out
    assert f'port = "serial://{path}?baud=19200"' in printed
    assert "serial number H0614967" in printed
    assert not fake.head.is_lit


class Colons:
    """Sends the same bytes as long as somebody listens, 100 a second."""

    def __init__(self, said: bytes) -> None:
        self._said, self._sent = said, 0

    def exchange(self, now_s: float, received: bytes) -> bytes:
        count, at = round(100 * (now_s - START_S)) - self._sent, self._sent % len(self._said)
        self._sent += count
        return (self._said[at:] + count * self._said)[:count]


@pytest.mark.parametrize("said", [b":12\r:34\r", b":" + b"0" * 24 + b"\r\x03\x04\r"])
def test_lines_that_begin_with_a_colon_are_no_controller_yet(
    said: bytes, capsys: Capsys, lines: SimulatedLines
) -> None:
    assert devices.main([lines.serial(Colons(said))]) == 1
    assert "motor controller in R/C" not in capsys.readouterr().out


@pytest.mark.parametrize("port", [scip.PORT, "4001"])
def test_a_hokuyo_scanner_is_found_on_the_network(
    port: str, capsys: Capsys, lines: SimulatedLines
) -> None:
    truth = lambda t_s, times_s, bearings_rad: np.full(len(times_s), 2.0)  # noqa: E731
    place = lines.tcp(FakeUrg04lx(truth, 1, "UTM-30LX"), port)
    assert devices.main(["/dev/no-such-line", "--scanner", place]) == 0
    printed = capsys.readouterr().out
    assert f'port = "tcp://{place}"' in printed
    assert "UTM-30LX" in printed


@pytest.mark.parametrize("host", ["127.0.0.1:99999", 64 * "x"])  # too long to be looked up
def test_a_host_that_cannot_be_is_told_in_one_line(host: str, capsys: Capsys) -> None:
    assert devices.main(["--scanner", host]) == 2
    told = capsys.readouterr().err
    assert told.startswith("mapod devices: 'tcp://")
    assert len(told.splitlines()) == 1


def test_rules_know_a_device_by_its_serial_number_or_else_by_its_socket() -> None:
    by_number = SimpleNamespace(serial_number="A10X", vid=0x0403, pid=0x6001, location="1-1.2")
    by_place = SimpleNamespace(serial_number=None, location="1-1.3")
    found = [
        Found("/dev/ttyUSB0", "ahrs", "serial:///dev/ttyUSB0?baud=115200", ""),
        Found("/dev/ttyUSB1", "drive", "serial:///dev/ttyUSB1?baud=9600&parity=E&bytesize=7", ""),
        Found("/dev/ttyUSB2", "", "", "silent"),
        Found("192.0.2.1", "scanner", "tcp://192.0.2.1:2112", ""),  # has a name of its own
    ]
    one, two = udev_rules(found, {"/dev/ttyUSB0": by_number, "/dev/ttyUSB1": by_place})
    assert 'ATTRS{serial}=="A10X"' in one
    assert 'ATTRS{idVendor}=="0403"' in one
    assert one.endswith('SYMLINK+="mti"')
    assert 'KERNELS=="1-1.3"' in two
    assert two.endswith('SYMLINK+="ax3500"')
    assert next(iter(toml_lines(found))) == "[ahrs]"


def test_a_machine_without_ports_is_told_so(capsys: Capsys, monkeypatch: Patch) -> None:
    monkeypatch.setattr(devices, "LIST_PORTS", list)
    assert devices.main([]) == 1
    told = capsys.readouterr().err
    assert "this machine lists no serial port and no camera: plug the adapters in" in told
    assert len(told.splitlines()) == 1


def test_a_camera_is_told_with_what_it_gives(tmp_path: Path) -> None:
    video, node = FakeVideo(), tmp_path / "video0"
    kernel: Any = video

    def says() -> str:
        return devices.find_camera(str(node), kernel).says

    assert says() == "No such device"
    node.touch()
    found = devices.find_camera(str(node), kernel)
    assert found.says == "camera 'Fake camera' with MJPEG"
    lines = list(toml_lines([found]))
    assert lines[1] == 'driver = "stripe"  # its other keys: mapod init --robot ragno'
    assert parse_url(lines[2].partition('"')[2][:-1]).path == str(node)
    video.formats = [b"YUYV"]
    assert says().startswith("gives no MJPEG, but YUYV")
    assert not video.is_open
    node.chmod(0)
    told = as_plain_user(lambda: devices.find_camera(str(node), kernel).says)
    assert told.startswith("no permission for it: join its group, ")
