"""The command line, as a person uses it: the real process."""

import os
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from tests import ROOT

SHIPPED = (ROOT / "mapod.toml").read_text(encoding="utf-8")


def mapod(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run main.py to its end."""
    return subprocess.run(
        [sys.executable, "main.py", *arguments],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


def test_check_tells_the_robot_in_words() -> None:
    done = mapod("--config", "mapod.toml", "--check")
    assert done.returncode == 0
    assert done.stderr == ""
    for told in ("8.45 m ahead", "width of ground seen", "101 x 101 cells", "MB", "bytes/s"):
        assert told in done.stdout


def test_version_and_help_are_told() -> None:
    assert mapod("--version").stdout.startswith("mapod 0.")
    assert "--config" in mapod("--help").stdout


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("rate_hz = 200 ", "rate_hz = 0 ", "loop.rate_hz: must be a number from 10 to 1000, is 0"),
        ("[log]", "[lag]", "[lag]: unknown section"),
        ("serial:///dev/mti?baud=115200", "mti", "ahrs.port: "),
        ('key_file = ""', 'key_file = "no/such/key"', "planner.key_file: can't read"),
        ('key_file = ""', 'key_file = "mapod.toml"', "only its owner may have access"),
    ],
)
def test_a_bad_setting_ends_with_status_2_and_one_line_that_names_it(
    tmp_path: Path, old: str, new: str, told: str
) -> None:
    assert old in SHIPPED
    path = tmp_path / "robot.toml"
    path.write_text(SHIPPED.replace(old, new, 1), encoding="utf-8")
    done = mapod("--config", str(path))
    assert done.returncode == 2
    assert told in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert done.stdout == ""


def test_a_file_that_is_not_there_ends_with_status_2() -> None:
    done = mapod("--config", "no_such.toml")
    assert done.returncode == 2
    assert "no_such.toml" in done.stderr


@pytest.mark.parametrize("ending", [signal.SIGINT, signal.SIGTERM])
def test_without_any_device_it_runs_tells_the_planner_so_and_ends_cleanly(
    tmp_path: Path, ending: signal.Signals
) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as planner:
        planner.bind(("127.0.0.1", 0))
        planner.settimeout(60)
        text = SHIPPED.replace("127.0.0.1:9750", f"127.0.0.1:{planner.getsockname()[1]}")
        text = text.replace("tcp://192.168.0.1:2112", "tcp://127.0.0.1:1")
        text = text.replace("/dev/", f"{tmp_path}/no_").replace('"console"', '"json"', 1)
        path = tmp_path / "robot.toml"
        path.write_text(text, encoding="utf-8")
        process = subprocess.Popen(
            [sys.executable, "main.py", "--config", str(path)],
            cwd=ROOT,
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, "PYTHONUNBUFFERED": "1"},
        )
        try:
            frames = [planner.recv(2048) for _ in range(60)]
            process.send_signal(ending)
            _, log = process.communicate(timeout=120)
        finally:
            process.kill()
    assert process.returncode == 0
    kinds = {frame[0] & 0x0F for frame in frames}
    assert {1, 2, 3} <= kinds
    poses = [frame for frame in frames if frame[0] & 0x0F == 2]
    assert all(pose[8 + 23] == 0 for pose in poses)  # mode: booting
    assert all(int.from_bytes(pose[8 + 18 : 8 + 20], "little") & 0x37 == 0 for pose in poses)
    for device in ("scanner", "ahrs", "drive"):
        assert f'"device": "{device}"' in log
    assert "Traceback" not in log
