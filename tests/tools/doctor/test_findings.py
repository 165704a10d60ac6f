"""Each cause that the doctor knows, made with real files, lines and sockets."""

import os
import socket
from pathlib import Path

import pytest

from hw.ports.url import parse_url
from tests.support.plain_user import as_plain_user
from tests.support.real_wires import pty_at
from tools.doctor import machine, service, wires
from tools.doctor.finding import Finding, status_of

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
        assert str(wires.of_host("scanner", parse_url(url))).endswith(f"{url} answers")
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
