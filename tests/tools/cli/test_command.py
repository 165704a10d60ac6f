"""`mapod`: which commands there are, their help, and what wrong use is answered with."""

import os
import re
import signal
import subprocess
import sys
from pathlib import Path
from subprocess import PIPE

import pytest

from tests import ROOT, Capsys
from tools.cli import options, run
from tools.cli.command import COMMANDS, help_text, main


def test_every_file_of_a_command_is_in_the_table_and_in_the_help() -> None:
    parts = {
        "__init__",
        "calibrate_camera",
        "calibrate_depth",
        "calibrate_range",
        "calibrate_stripe",
        "command",
        "conversation",
        "options",
        "scip",
    }
    files = {path.stem for path in (ROOT / "tools" / "cli").glob("*.py")} - parts
    assert files == {file.partition(":")[0] for file, _ in COMMANDS.values()}
    assert all(re.search(rf"^  {name} ", help_text(), re.MULTILINE) for name in COMMANDS)


def test_who_stops_reading_ends_a_command_without_a_word() -> None:
    reading, writing = os.pipe()
    os.close(reading)
    command = [sys.executable, "-m", "mapod", "--help"]
    try:
        ended = subprocess.run(command, cwd=ROOT, stdout=writing, stderr=PIPE, check=False)
    finally:
        os.close(writing)
    assert (ended.returncode, ended.stderr) == (128 + signal.SIGPIPE, b"")


INTERRUPTED = """
import sys
class Interrupting:
    def find_spec(self, name, *rest):
        if name == "tools.cli.command":
            raise KeyboardInterrupt
sys.meta_path.insert(0, Interrupting())
from mapod.__main__ import main
sys.exit(main())
"""


def test_ctrl_c_while_it_is_loaded_ends_it_without_a_word() -> None:
    ended = subprocess.run(
        [sys.executable, "-c", INTERRUPTED], cwd=ROOT, capture_output=True, check=False
    )
    assert (ended.returncode, ended.stdout, ended.stderr) == (128 + signal.SIGINT, b"", b"")


@pytest.mark.parametrize("name", COMMANDS)
def test_help_ends_with_an_example(name: str, capsys: Capsys) -> None:
    with pytest.raises(SystemExit, match="0"):
        main([name, "--help"])
    told = capsys.readouterr().out
    assert told.startswith(f"usage: mapod {name}")
    _, _, examples = told.partition("example")
    assert f"  mapod {name}" in examples


@pytest.mark.parametrize(
    "words",
    [
        ["nothing"],
        ["run", "--nothing"],
        ["run", "--conf", "mapod.toml"],
        ["demo", "--seconds", "0"],
        ["demo", "--seconds", "soon"],
        ["demo", "--seed", "-1"],
        ["replay", "--speed", "quick"],
        ["why", "x.mcap", "--at", "3", "--cell", "1.5,2"],
        ["sweep", "x.mcap", "--jobs", "many"],
        ["export", "x.mcap", "--to", "csv", "--ascii"],
        ["export", "x.mcap", "--to", "ros", "--layer", "slope"],
        ["scanner"],
        ["scanner", "dance"],
        ["attitude", "baud", "12"],
        ["calibrate", "--seconds", "1"],
        ["link-test"],
        ["flash"],
        ["flash", "--bundle", "x", "--status"],
        ["flash", "--bundle", "x", "--python-version", "3.10"],
        ["check", "--config", "no/such.toml"],
        ["run", "--config", "no/such.toml"],
        ["scanner", "info", "--config", "no/such.toml"],
        ["scanner", "info", "--port", "nowhere"],
        ["compare", "scanner", "--port", "nowhere"],
        ["view", "--port", "nowhere"],
        ["record", "--out", "no/such/folder/x.rec"],
    ],
    ids=" ".join,
)
def test_wrong_use_is_told_in_one_line(words: list[str], capsys: Capsys) -> None:
    try:
        status = main(words)
    except SystemExit as end:
        status = int(str(end.code))
    told = capsys.readouterr()
    assert status == 2
    assert len(told.err.splitlines()) == 1, told.err
    assert "invalid a_" not in told.err  # no name of ours, but what is allowed
    assert told.out == ""


@pytest.mark.parametrize("robot", options.ROBOTS)
def test_settings_of_another_robot_are_written(robot: str, tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    assert main(["init", "--robot", robot, "--out", str(path)]) == 0
    assert path.read_bytes() == options.ROBOTS[robot].read_bytes()
    with pytest.raises(SystemExit):
        main(["init", "--robot", "none", "--out", str(tmp_path / "other.toml")])


def test_settings_are_written_once(tmp_path: Path, capsys: Capsys) -> None:
    path = tmp_path / "mine.toml"
    assert main(["init", "--out", str(path)]) == 0
    assert path.read_bytes() == options.SHIPPED_CONFIG.read_bytes()
    path.write_text("mine", encoding="utf-8")
    assert main(["init", "--out", str(path)]) == 2
    assert path.read_text(encoding="utf-8") == "mine"
    assert "is there already" in capsys.readouterr().err
    assert main(["init", "--out", str(tmp_path / "no" / "folder.toml")]) == 2
    assert run.HEADER.is_file()


def test_check_and_version_are_those_of_the_app(capsys: Capsys) -> None:
    assert main(["check", "--config", str(options.SHIPPED_CONFIG)]) == 0
    checked = capsys.readouterr().out
    for told in ("centre beam meets the ground", "8.45 m ahead", "101 x 101 cells", "bytes/s"):
        assert told in checked
    assert main(["--version"]) == main(["version"]) == 0
    first, second = capsys.readouterr().out.splitlines()
    assert first == second
    assert re.fullmatch(r"mapod \d+\.\d+\.\d+", first)
