"""Each cause that the doctor knows, made with real files, lines and sockets."""

import os
import shutil
import socket
import subprocess
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from config_file import load_config, with_changes
from hw.ports.url import parse_url
from hw.ports.v4l2 import KERNEL
from tests import ROOT
from tests.support.machine.plain_user import as_plain_user
from tests.support.machine.real_wires import pty_at
from tools.calibration.noted import with_note, with_ranges_note
from tools.doctor import calibrated, machine, network, service, storage, wires
from tools.doctor.finding import Finding, status_of

HOKUYO = load_config((ROOT / "robots" / "urg04lx.toml").read_text(encoding="utf-8"))
CORRECTED = with_changes(HOKUYO, scanner={"correction": [0.01, 0.0, 0.0, 0.0]})
UNIT = {
    "LoadState": "loaded",
    "ActiveState": "active",
    "SubState": "running",
    "StatusText": "scanner running",
    "NRestarts": "0",
    "MainPID": str(os.getpid()),
    "LimitRTPRIO": "20",
    "LimitMEMLOCK": "infinity",
}


def test_a_line_that_is_there_absent_no_line_or_not_permitted(tmp_path: Path) -> None:
    with pty_at() as (_, path):
        assert wires.of_line("ahrs", path).level == "OK"
        os.chmod(path, 0)
        told = as_plain_user(lambda: wires.of_line("ahrs", path))
        group = wires.group_name(os.stat(path).st_gid)
    assert told.startswith(f"warning  ahrs       {path}: no permission")
    assert f"usermod --append --groups {group}" in told
    absent = wires.of_line("ahrs", f"{tmp_path}/mti")
    assert (absent.level, absent.says) == ("warning", f"{tmp_path}/mti: No such file or directory")
    assert "is no serial line" in wires.of_line("drive", str(tmp_path)).says


def test_a_camera_that_is_none_and_a_folder_without_images(tmp_path: Path) -> None:
    assert "video0: No such file" in wires.of_camera("scanner", f"{tmp_path}/video0", KERNEL).says
    assert "is no camera" in wires.of_camera("scanner", str(tmp_path), KERNEL).says
    assert "/dev/null is no camera" in wires.of_camera("scanner", "/dev/null", KERNEL).says
    absent = wires.of_folder("scanner", str(tmp_path))
    assert (absent.level, "times.csv" in absent.says) == ("warning", True)
    (tmp_path / "1.jpg").write_bytes(b"an image")
    (tmp_path / "times.csv").write_text("1.jpg,1.0\n1.jpg,1.5\n")
    there = wires.of_folder("scanner", str(tmp_path))
    assert (there.level, "2 images over 0.5 s" in there.says) == ("OK", True)


@pytest.mark.parametrize(("held", "levels"), [("16", ["warning"]), ("1", []), (None, [])])
def test_an_adapter_that_holds_bytes_back(
    tmp_path: Path, held: str | None, levels: list[str]
) -> None:
    folder = tmp_path / "sys/bus/usb-serial/devices/ttyUSB7"
    folder.mkdir(parents=True)
    if held is not None:
        (folder / "latency_timer").write_text(f"{held}\n")
    found = wires.latency_of("drive", "/dev/ttyUSB7", tmp_path)
    assert [finding.level for finding in found] == levels


def test_a_host_that_answers_refuses_or_has_no_address() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        url = f"tcp://127.0.0.1:{server.getsockname()[1]}"
        assert f"{url} answers in " in str(wires.of_host("scanner", parse_url(url)))
    refused = wires.of_host("scanner", parse_url(url))
    assert (refused.level, refused.says) == ("warning", f"{url}: Connection refused")
    nowhere = wires.of_host("planner", parse_url("udp://no..host:9750"))
    assert nowhere.level == "fault"
    assert wires.of_host("planner", parse_url("udp://127.0.0.1:9750")).level == "OK"


@pytest.mark.parametrize(
    ("path", "text", "find", "level", "told"),
    [
        (f"{machine.CPUS}/cpu0/cpufreq/scaling_governor", "powersave", "cores", "warning", "power"),
        (f"{machine.CPUS}/cpu1/cpufreq/scaling_governor", "performance", "cores", "OK", ""),
        (machine.CLOCK, "hpet", "clock", "warning", "hpet"),
        (machine.CLOCK, "tsc", "clock", "OK", "tsc"),
        ("nothing", "", "clock", "OK", "does not say"),
    ],
)
def test_cores_and_clock(
    tmp_path: Path, path: str, text: str, find: str, level: str, told: str
) -> None:
    (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / path).write_text(f"{text}\n")
    found = {"cores": machine.of_cores, "clock": machine.of_clock}[find](tmp_path)
    assert (found.level, told in found.says) == (level, True)


@pytest.mark.parametrize(
    ("priority", "locked", "lacks"),
    [
        (20, -1, ""),
        (-1, 2**30, ""),
        (0, -1, "has no SCHED_FIFO"),
        (99, 8 * 2**20, "has no locked memory"),
        (0, 0, "has no SCHED_FIFO and no locked memory"),
    ],
)
def test_real_time_rights(priority: int, locked: int, lacks: str) -> None:
    found = machine.of_rights(priority, locked, "who asks")
    assert (found.level == "warning") == bool(lacks)
    assert lacks in found.says


@pytest.mark.parametrize(
    ("changes", "levels"),
    [
        ({}, ["OK", "warning"]),  # this process has taken no rights
        ({"NRestarts": "3"}, ["warning", "warning"]),
        ({"ActiveState": "failed", "SubState": "failed"}, ["warning", "OK"]),
        ({"ActiveState": "inactive", "LimitRTPRIO": "0"}, ["warning", "warning"]),
        ({"ActiveState": "inactive", "LimitMEMLOCK": "8388608"}, ["warning", "warning"]),
        ({"ActiveState": "inactive", "LimitMEMLOCK": str(2**64 - 1)}, ["warning", "OK"]),
        ({"LoadState": "not-found"}, ["OK", None]),
    ],
)
def test_the_service(changes: dict[str, str], levels: list[str | None]) -> None:
    found = list(service.find_service({**UNIT, **changes}, "0.1.0"))
    for finding, level in zip(found, levels, strict=False):
        assert level is None or finding.level == level, finding


def test_another_version_than_the_service_s() -> None:
    assert service.of_version("mapod 0.1.0", "mapod 0.1.0").level == "OK"
    assert service.of_version("", "mapod 0.1.0").level == "warning"


def test_the_worst_finding_is_the_exit_status() -> None:
    ok, warning, fault = (Finding(level, "", "") for level in ("OK", "warning", "fault"))
    assert [status_of(few) for few in ([], [ok], [ok, warning], [fault, ok])] == [0, 0, 1, 2]
    assert machine.of_room(10**6, Path()).level == "warning"


@pytest.mark.parametrize(
    ("synchronised", "level"), [(True, "OK"), (False, "warning"), (None, "OK")]
)
def test_the_time_of_day(synchronised: bool | None, level: str) -> None:
    assert machine.of_time(synchronised, 0.004).level == level


def test_the_kernel_says_the_same_of_its_time_as_its_own_program() -> None:
    synchronised, error_s = machine.clock_state()
    if shutil.which("timedatectl") is None or synchronised is None:
        assert error_s >= 0.0
        return
    command = ["timedatectl", "show", "--property", "NTPSynchronized", "--value"]
    told = subprocess.run(command, capture_output=True, text=True, check=False)
    if told.returncode == 0:
        assert told.stdout.strip() == ("yes" if synchronised else "no")


def test_a_way_that_is_slow() -> None:
    assert wires.of_answer("scanner", "tcp://a:1", 0.0004).level == "OK"
    assert wires.of_answer("scanner", "tcp://a:1", 0.2).level == "warning"


# 10.0.0.0/8 by way of 192.168.1.1 and, dearer, 192.168.1.2; 192.168.1.0/24 and 10.1.0.0/16 on
# links; 172.16.0.0/12 on a link that is down
ROUTES = """Iface Destination Gateway Flags RefCnt Use Metric Mask MTU Window IRTT
eth0 0000000A 0201A8C0 0003 0 0 100 000000FF 0 0 0
eth0 0000000A 0101A8C0 0003 0 0 10 000000FF 0 0 0
eth0 0001A8C0 00000000 0001 0 0 100 00FFFFFF 0 0 0
eth1 0000010A 00000000 0001 0 0 100 0000FFFF 0 0 0
eth2 000010AC 00000000 0000 0 0 100 0000F0FF 0 0 0
"""


@pytest.mark.parametrize(
    ("address", "route"),
    [
        ("192.168.1.7", network.Route("eth0", "")),
        ("10.1.9.9", network.Route("eth1", "")),
        ("10.2.9.9", network.Route("eth0", "192.168.1.1")),
        ("172.16.0.1", None),
        ("8.8.8.8", None),
    ],
)
def test_the_route_to_an_address(address: str, route: network.Route | None) -> None:
    assert network.maybe_route(ROUTES, address) == route


def test_what_is_wrong_with_the_way_to_the_scanner(tmp_path: Path) -> None:
    def found(address: str) -> Finding:
        return network.of_path("scanner", address, ROUTES, tmp_path)

    folder = tmp_path / network.INTERFACES / "eth0"
    folder.mkdir(parents=True)
    for name, value in {"mtu": "1500", "carrier": "1", "speed": "1000"}.items():
        (folder / name).write_text(f"{value}\n")
    good = found("192.168.1.7")
    assert (good.level, good.advice) == ("OK", "")
    assert good.says == "scanner 192.168.1.7 by eth0, MTU 1500, 1000 Mb/s"
    assert "through 192.168.1.1" in found("10.2.9.9").says
    assert found("10.2.9.9").level == found("8.8.8.8").level == "warning"
    for name, value, told in (("mtu", "576", "small"), ("carrier", "0", "cable")):
        before = (folder / name).read_text()
        (folder / name).write_text(value)
        assert told in found("192.168.1.7").advice
        (folder / name).write_text(before)
    (folder / "wireless").mkdir()
    assert "over the air" in found("192.168.1.7").advice


NOW = datetime(2026, 3, 1, tzinfo=UTC)


@pytest.mark.parametrize(
    ("days", "level", "told"),
    [(3, "OK", "3 days ago"), (300, "warning", "300 days"), (-2, "warning", "yet to come")],
)
def test_days_since_the_calibration(days: int, level: str, told: str) -> None:
    text = with_note("[robot]\n[scanner]\nport = 1\n", NOW - timedelta(days=days))
    found = calibrated.of_calibration(text, NOW)
    assert (found.level, told in found.says) == (level, True)


def test_settings_that_note_no_calibration() -> None:
    for text in ("[scanner]\n", "[scanner]\n# calibrated last week\n"):
        assert calibrated.of_calibration(text, NOW).says.startswith("never")


@pytest.mark.parametrize(
    ("days", "level", "told"),
    [(3, "OK", "3 days ago"), (300, "warning", "300 days"), (-2, "warning", "yet to come")],
)
def test_days_since_the_ranges_were_calibrated(days: int, level: str, told: str) -> None:
    text = with_note("[scanner]\nport = 1\n", NOW - timedelta(days=40))
    text = with_ranges_note(text, NOW - timedelta(days=days))
    found = calibrated.maybe_of_ranges(text, NOW, CORRECTED.scanner)
    assert found is not None
    assert (found.about, found.level, told in found.says) == ("ranges", level, True)
    assert "40 days" in calibrated.of_calibration(text, NOW).says  # the mount has its own date


def test_a_scanner_that_takes_a_correction_of_ranges_and_has_none() -> None:
    text = with_note("[scanner]\n", NOW)
    never = calibrated.maybe_of_ranges(text, NOW, HOKUYO.scanner)
    assert never is not None
    assert (never.level, never.says) == ("warning", "never calibrated: they are not corrected")
    assert "mapod calibrate range" in never.advice
    unknown = calibrated.maybe_of_ranges(text, NOW, CORRECTED.scanner)
    assert unknown is not None
    assert (unknown.level, "don't say when" in unknown.says) == ("warning", True)
    undone = calibrated.maybe_of_ranges(with_ranges_note(text, NOW), NOW, HOKUYO.scanner)
    assert undone is not None
    assert (undone.level, "correction is 0" in undone.says) == ("warning", True)
    shipped = load_config((ROOT / "mapod.toml").read_text(encoding="utf-8"))
    assert calibrated.maybe_of_ranges(text, NOW, shipped.scanner) is None


def test_folders_of_recordings(tmp_path: Path) -> None:
    (tmp_path / "a.mcap").write_bytes(bytes(2_000_000))
    assert storage.of_folder("flights", tmp_path, 1.0).says.startswith("1 of 2 MB in all in ")
    assert storage.of_folder("flights", tmp_path, 1e12).advice.startswith("Up to 1000000000000 MB")
    assert storage.of_folder("flights", tmp_path / "not" / "yet", 1.0).level == "OK"
    assert storage.fsync_s(tmp_path) > 0.0
    assert [path.name for path in tmp_path.iterdir()] == ["a.mcap"]
    tmp_path.chmod(0o555)
    told = as_plain_user(lambda: storage.of_folder("flights", tmp_path, 1.0))
    tmp_path.chmod(0o755)
    assert "can't be written" in told


def test_a_robot_without_a_drive_and_who_could_tell_its_place() -> None:
    cart = load_config((ROOT / "robots" / "cart.toml").read_text(encoding="utf-8"))
    told = {one.about: one for one in wires.find_wires(cart, ROOT)}
    assert (told["drive"].level, told["drive"].says) == (
        "OK",
        "there is none: nothing commands motors",
    )
    assert told["motion"].level == "OK"
    [fault] = wires.of_place(with_changes(cart, planner={"port": "udp://10.0.0.2:9750"}))
    assert (fault.level, "takes a key" in fault.says) == ("fault", True)


def test_a_kinects_library_and_a_dump_are_looked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(wires, "LIBRARY", "libnowhere.so.1")
    lacks = wires.of_kinect("depth", parse_url("kinect:///0?format=mm"))
    assert (lacks.level, lacks.advice) == ("fault", "apt install libfreenect0.5")
    monkeypatch.setattr(wires, "LIBRARY", "libc.so.6")  # any that is there
    dump = parse_url(f"fakenect://{tmp_path}")
    assert wires.of_kinect("depth", dump).says == f"{tmp_path} has no INDEX.txt"
    (tmp_path / "INDEX.txt").touch()
    assert wires.of_kinect("depth", dump).level == "OK"
