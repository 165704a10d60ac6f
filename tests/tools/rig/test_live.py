"""The live rig as its user runs it: real processes, real sockets and ptys, real time."""

import re
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from tests import ROOT, Capsys, Patch
from tools.rig import live
from tools.rig.planner.build import program

SECONDS = "60"  # at most; it ends once the goal is reached


def bench(folder: Path, planner: str) -> Path:
    """A rig.toml of a goal straight ahead in the corridor."""
    text = (ROOT / "rig.toml").read_text(encoding="utf-8")
    for key, value in (("scene", '"corridor"'), ("goals", "[[2.5, 0.0]]"), ("sensors", '"clean"')):
        text = re.sub(rf"^{key} = \S+", f"{key} = {value}", text, flags=re.MULTILINE)
    text = re.sub(r"^planner = \S+", f'planner = "{planner}"', text, flags=re.MULTILINE)
    path = folder / "rig.toml"
    path.write_text(text.replace('"mapod.toml"', f'"{ROOT / "mapod.toml"}"'), encoding="utf-8")
    return path


def ran(*words: str) -> "subprocess.CompletedProcess[str]":
    command = [sys.executable, "-m", "tools.rig.live", *words]
    return subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, timeout=150, check=False
    )


NEEDED = {"host": ["gcc"], "board": ["arm-none-eabi-gcc", "qemu-system-arm"]}


@pytest.mark.real_time
@pytest.mark.parametrize("planner", ["host", "board"])
def test_the_robot_comes_to_its_goal_in_spite_of_faults(planner: str, tmp_path: Path) -> None:
    for name in NEEDED[planner]:
        program(name)
    words = ["--config", str(bench(tmp_path, planner)), "--seconds", SECONDS]
    for second in range(2, 60, 3):  # it drives for 6 s: two of them strike meanwhile
        words += ["--fault", f"scanner.mute@{second}s+0.3s"]
    done = ran(*words)
    assert done.returncode == 0, done.stdout + done.stderr
    driven = re.search(r"0 collisions; driven ([\d.]+) m", done.stdout)
    assert driven is not None, done.stdout
    assert float(driven[1]) > 1.8
    assert re.search(r"the link said stop: .+: \d+ times", done.stdout), done.stdout
    assert "the planner's map equals the second receiver's in all 10201 cells" in done.stdout
    assert "1 of 1 goals reached" in done.stdout
    assert "all processes have ended" in done.stdout
    form = {"host": "the planner's C on this machine", "board": "an emulated Cortex-M3"}[planner]
    assert form in done.stdout
    assert done.stderr == ""


def test_wrong_settings_are_an_error_at_once(tmp_path: Path, capsys: Capsys) -> None:
    assert live.main(["--config", str(bench(tmp_path, "host")), "--seed", "-4"]) == 2
    said = capsys.readouterr()
    assert "world.seed: Expected `int` >= 0" in said.err
    assert said.out == ""


def test_a_scene_that_is_not_there_is_an_error(tmp_path: Path, capsys: Capsys) -> None:
    given = ["--config", str(bench(tmp_path, "host")), "--scene", "moon", "--seconds", "1"]
    assert live.main(given) == 1
    assert "moon" in capsys.readouterr().err


@pytest.mark.real_time
def test_a_device_that_does_not_answer_is_named(
    tmp_path: Path, capsys: Capsys, monkeypatch: Patch
) -> None:
    program("gcc")
    monkeypatch.setattr(live, "DEVICES_S", 8.0)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))  # what is kept lies there
    path = bench(tmp_path, "host")
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace('ahrs = "fake"', f'ahrs = "serial://{tmp_path}/mti?baud=115200"'))
    assert live.main(["--config", str(path), "--seconds", "60"]) == 1
    said = capsys.readouterr().err
    assert "no map 8 s after the app's start; " in said
    assert f"ahrs: no such device {tmp_path}/mti" in said
