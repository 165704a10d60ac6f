"""Each row of the tables of bad input is answered as the table says: one line, and status 2."""

import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from config_file import load_config, read_key, read_settings
from core.config import ConfigError
from fakes.scenes.scene import load_scene
from hw.ax3500.lines import LineParser
from hw.device import BadFrame
from hw.lms1xx.telegrams import new_parser
from hw.modbus.network import take_requests
from hw.mti.frames import MtParser
from hw.planner_link.frames import Deframer
from hw.planner_link.messages import decode_answer
from hw.urg04lx.scip import ScipParser
from map_files import load_map
from tests import ROOT, Capsys, Patch
from tests.app.bad_input import frames, rows_of
from tests.app.bad_input.files import KEYS, MAPS, RECORDINGS, SCENES, SETTINGS
from tests.support.machine.plain_user import as_plain_user
from tests.support.robot.shipped import TEXT, shipped
from tools.cli.command import main

OPTIONAL = (
    "motion",
    "certainty",
    "shadow_filter",
    "depth",
    "objects",
    "object_map",
    "coverage",
)  # sections
PROCESSES = (  # the same as real processes
    ("run --config /dev/zero", "must be at most 1000000 bytes long, is longer"),
    ("link-test --port udp://127.0.0.1:1 --gap-ms -5", "--gap-ms: must be from 0 to 1000"),
)

PARSERS: dict[str, Callable[[], Any]] = {
    "lms111": new_parser,
    "mti": lambda: MtParser(115_200),
    "ax3500": LineParser,
    "urg04lx": ScipParser,
}
DAMAGED = [
    pytest.param(device, *row, id=f"{device}, {name}")
    for device, rows in frames.DEVICES.items()
    for name, row in rows.items()
]


def with_setting(name: str, given: str) -> str:
    """The shipped settings with a key's value changed."""
    section, _, key = name.partition(".")
    begin = TEXT.index(f"\n[{section}]")
    old = re.compile(rf"^{key} = [^#\n]*", re.MULTILINE).search(TEXT, begin)
    assert old is not None
    return TEXT[: old.start()] + f"{key} = {given}" + TEXT[old.end() :]


def said_by(words: list[str], capsys: Capsys) -> str:
    """The one line that a command refuses its input with."""
    try:
        status = main(words)
    except SystemExit as end:
        status = int(str(end.code))
    told = capsys.readouterr()
    assert status == 2, told
    assert told.out == ""
    assert len(told.err.splitlines()) == 1, told.err
    return told.err


@pytest.mark.parametrize(("name", "given", "told"), rows_of("settings.tsv"))
def test_a_setting(name: str, given: str, told: str, tmp_path: Path, capsys: Capsys) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(with_setting(name, given), encoding="utf-8")
    assert f"{path}: {name}: {told}" in said_by(["check", "--config", str(path)], capsys)


@pytest.mark.parametrize(("content", "told"), SETTINGS.values(), ids=SETTINGS)
def test_a_settings_file(content: bytes, told: str, tmp_path: Path, capsys: Capsys) -> None:
    path = tmp_path / "robot.toml"
    path.write_bytes(content)
    assert f"{path}: {told}" in said_by(["check", "--config", str(path)], capsys)


def test_the_mark_that_some_editors_put_before_a_text_is_passed_over(tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(TEXT, encoding="utf-8-sig")
    assert read_settings(path) == TEXT


@pytest.mark.parametrize("section", re.findall(r"^\[(\w+)\]", TEXT, re.MULTILINE))
def test_a_section_or_a_key_that_is_missing(section: str) -> None:
    begin = TEXT.index(f"\n[{section}]")
    end = TEXT.find("\n[", begin + 2)
    left = TEXT[:begin] + (TEXT[end:] if end > 0 else "")
    if section in OPTIONAL:
        load_config(left)
    else:
        with pytest.raises(ConfigError, match=rf"(^|; ){section}\.\w+: missing"):
            load_config(left)


@pytest.mark.parametrize(("line", "told"), rows_of("commands.tsv"))
def test_a_command_line(
    line: str, told: str, tmp_path: Path, capsys: Capsys, monkeypatch: Patch
) -> None:
    (tmp_path / "mapod.toml").write_text(TEXT, encoding="utf-8")
    shutil.copy(ROOT / "robots" / "cleaner.toml", tmp_path)
    (tmp_path / "latin.toml").write_bytes(b"# \xe4\n")
    (tmp_path / "text.mcap").write_bytes(b"hello\n")
    (tmp_path / "empty.mcap").write_bytes(b"")
    (tmp_path / "folder").mkdir()
    monkeypatch.chdir(tmp_path)
    assert told in said_by(shlex.split(line), capsys)


@pytest.mark.parametrize(("line", "told"), PROCESSES)
def test_a_command_line_as_a_process(line: str, told: str) -> None:
    command = [sys.executable, "-m", "mapod", *shlex.split(line)]
    ended = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stdout, len(ended.stderr.splitlines())) == (2, "", 1)
    assert told in ended.stderr


@pytest.mark.parametrize(("content", "told"), MAPS.values(), ids=MAPS)
def test_a_saved_map(content: bytes, told: str, tmp_path: Path, capsys: Capsys) -> None:
    path, config = tmp_path / "hall.map", tmp_path / "mapod.toml"
    path.write_bytes(content)
    config.write_text(TEXT, encoding="utf-8")
    said = said_by(["run", "--config", str(config), "--load-map", str(path)], capsys)
    assert f"can't load the map {str(path)!r}: {told}" in said


def test_a_saved_map_of_terabytes_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "hall.map"
    with path.open("wb") as file:
        file.truncate(1 << 40)
    with pytest.raises(Exception, match="must have at most 1000000000 bytes, has 1099511627776"):
        load_map(str(path), shipped())


@pytest.mark.parametrize(("content", "told"), RECORDINGS.values(), ids=RECORDINGS)
def test_a_recording(content: bytes, told: str, tmp_path: Path, capsys: Capsys) -> None:
    path = tmp_path / "drive.mcap"
    path.write_bytes(content)
    said = said_by(["replay", str(path)], capsys)
    assert str(path) in said
    assert told in said


@pytest.mark.parametrize(("text", "told"), SCENES.values(), ids=SCENES)
def test_a_scene(text: str, told: str, tmp_path: Path) -> None:
    path = tmp_path / "scene.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match=re.escape(told)):
        load_scene(path)


@pytest.mark.parametrize(("mode", "content", "told"), KEYS.values(), ids=KEYS)
def test_a_key_file(mode: int, content: bytes, told: str, tmp_path: Path) -> None:
    path = tmp_path / "key"
    path.write_bytes(content)
    path.chmod(mode)
    with pytest.raises(ConfigError, match=re.escape(f"planner.key_file: {told}")) as error:
        read_key(str(path))
    assert repr(str(path)) in str(error.value)


def test_what_nobody_may_read_is_told(tmp_path: Path) -> None:
    path = tmp_path / "mapod.toml"
    path.write_text(TEXT, encoding="utf-8")
    path.chmod(0)

    def said() -> str:
        try:
            read_key(str(path))
        except ConfigError as error:
            return str(error)
        return ""

    told = f"planner.key_file: can't read {str(path)!r}: Permission denied"
    assert as_plain_user(said) == told


@pytest.mark.parametrize(("data", "reason"), frames.LINK.values(), ids=frames.LINK)
def test_a_datagram_of_the_planner_link(data: bytes, reason: str) -> None:
    refused = decode_answer(data)
    assert isinstance(refused, BadFrame)
    assert refused.reason == reason


@pytest.mark.parametrize(("data", "reason"), frames.SERIAL.values(), ids=frames.SERIAL)
def test_a_line_of_the_planner_link(data: bytes, reason: str) -> None:
    [refused] = Deframer().feed(data)
    assert isinstance(refused, BadFrame)
    assert refused.reason == reason


@pytest.mark.parametrize(("data", "reason"), frames.MODBUS.values(), ids=frames.MODBUS)
def test_a_request_of_modbus(data: bytes, reason: str) -> None:
    assert take_requests(bytearray(data)) == ([], reason)


@pytest.mark.parametrize(("device", "data", "reason"), DAMAGED)
def test_an_answer_of_a_device(device: str, data: bytes, reason: str) -> None:
    """It counts as damaged, whole or cut anywhere, and nothing else comes of it."""
    for size in (len(data), 1, 7):
        parser = PARSERS[device]()
        events = [
            event
            for at in range(0, len(data), size)
            for event in parser.feed(0.0, data[at : at + size])
        ]
        events += [event for now_s in (5.0, 10.0) for event in parser.feed(now_s, b"")]
        assert {type(event) for event in events} == {BadFrame}
        assert reason in {event.reason for event in events}
