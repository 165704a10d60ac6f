"""The command line, as a person uses it."""

import os
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from main import run
from tests import ROOT
from tests.support.cases import few

SHIPPED = (ROOT / "mapod.toml").read_text(encoding="utf-8")


def test_check_tells_the_robot_in_words() -> None:
    command = [sys.executable, "main.py", "--config", "mapod.toml", "--check"]
    done = subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, timeout=120, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    for told in ("8.45 m ahead", "width of ground seen", "101 x 101 cells", "MB", "bytes/s"):
        assert told in done.stdout


def test_version_and_help_are_told(capsys: pytest.CaptureFixture[str]) -> None:
    for words, told in (("--version", "mapod 0."), ("--help", "--config")):
        with pytest.raises(SystemExit):
            run([words])
        assert told in capsys.readouterr().out


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("rate_hz = 200 ", "rate_hz = 0 ", "loop.rate_hz: must be a number from 10 to 1000, is 0"),
        ("[log]", "[lag]", "[lag]: unknown section"),
        ("serial:///dev/mti?baud=115200", "mti", "ahrs.port: "),
        ('key_file = ""', 'key_file = "no/such/key"', "planner.key_file: can't read"),
        ('key_file = ""', f'key_file = "{ROOT}/mapod.toml"', "only its owner may have access"),
        (SHIPPED, "", "No such file"),
    ],
)
def test_a_bad_setting_ends_with_status_2_and_one_line_that_names_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], old: str, new: str, told: str
) -> None:
    assert old in SHIPPED
    path = tmp_path / "robot.toml"
    if new:
        path.write_text(SHIPPED.replace(old, new, 1), encoding="utf-8")
    assert run(["--config", str(path)]) == 2
    said = capsys.readouterr()
    assert told in said.err
    assert str(path) in said.err
    assert len(said.err.splitlines()) == 1
    assert said.out == ""


@pytest.mark.parametrize("ending", few([signal.SIGTERM, signal.SIGINT], 1))
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
