"""`mapod replay`: what it says of a recorded drive, of others' files, and of what is wrong."""

import argparse
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from recording.mcap_file import RecordingFile
from recording.reader import Recording
from recording.records import CHECK, OF_CALLS, OUT
from tests import ROOT, Capsys, Patch
from tests.support.robot.recorded import RecordedLoop
from tests.support.robot.shipped import shipped
from tools.cli import replay as tool
from tools.replay import laser
from tools.replay.sources import Source

ZSTD = b"\x28\xb5\x2f\xfd"  # first bytes of what a chunk holds
PLANNER = 3  # its port in a recording
CAPTURE = ROOT / "tests" / "vectors" / "tim781_1s.pcapng"
Told = Callable[..., tuple[int, str, str]]


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three seconds, the scanner's wire cut for a while."""
    path = tmp_path_factory.mktemp("recording") / "drive.mcap"
    loop = RecordedLoop(path, shipped())
    loop.run(2.0)
    loop.wires["scanner"].cut = True
    loop.run(0.3)
    loop.hang(0.15)
    loop.wires["scanner"].cut = False
    loop.run(0.8)
    loop.recorder.close()
    return path


@pytest.fixture
def told(capsys: Capsys) -> Told:
    """The command: its exit status, and what it said on both outputs."""

    def run(*words: str | Path) -> tuple[int, str, str]:
        status = tool.main([str(word) for word in words])
        said = capsys.readouterr()
        return status, said.out, said.err

    return run


def test_a_drive_is_identical_and_its_outcome_is_kept(
    drive: Path, told: Told, tmp_path: Path
) -> None:
    status, out, err = told(drive, "--out", tmp_path / "a.json")
    assert (status, err) == (0, "")
    outcome = json.loads((tmp_path / "a.json").read_text(encoding="utf-8"))
    assert outcome["counts"]["scans_added"] > 20
    assert f"planner: identical: {outcome['link_bytes']} bytes" in out
    assert "times real time" in out


def test_one_other_bit_is_told_with_its_byte_frame_and_time(
    drive: Path, told: Told, tmp_path: Path
) -> None:
    """As if the app had written something else, once."""
    recording = Recording(drive)
    said = {key: text for key, text in recording.metadata.items() if key != CHECK}
    file = RecordingFile(tmp_path / "other.mcap", said, recording.ports)
    before, changed_s, begin_s = 0, 0.0, 0.0
    for number, record in enumerate(recording.records()):
        data, begin_s = record.data, begin_s or record.t_s
        if record.kind == OUT and record.port == PLANNER:
            if before > 2000 and not changed_s:
                changed_s, data = record.t_s, data[:-1] + bytes([data[-1] ^ 1])
                before += len(data) - 1
            before += 0 if changed_s else len(data)
        port = 0 if record.kind in OF_CALLS else record.port
        file.wire(record.t_s, record.kind, port, data, number)
    file.finish({})
    status, out, _ = told(tmp_path / "other.mcap")
    assert status == 1
    assert f"planner: differs from byte {before} of" in out
    assert f"UTC ({changed_s - begin_s:.3f} s)" in out
    assert "frame is another one" in out


def test_signed_frames_are_compared_by_who_has_the_key(told: Told, tmp_path: Path) -> None:
    key, path = bytes(range(32)), tmp_path / "key"
    path.write_bytes(key)
    path.chmod(0o600)
    loop = RecordedLoop(tmp_path / "a.mcap", shipped(), key=key)
    loop.run(1.5)
    loop.recorder.close()
    status, out, _ = told(tmp_path / "a.mcap")
    assert status == 0
    assert "without --key-file they can't be compared" in out
    status, out, _ = told(tmp_path / "a.mcap", "--key-file", path)
    assert status == 0
    assert "planner: identical" in out
    path.write_bytes(bytes(32))
    status, out, _ = told(tmp_path / "a.mcap", "--key-file", path)
    assert status == 1
    assert "planner: differs from byte" in out


def test_other_settings_are_not_compared_but_what_they_change_is_told(
    drive: Path, told: Told
) -> None:
    status, out, _ = told(drive, "--set", "scanner.last_deg=90", "--set", "planner.rate_hz=25")
    assert status == 0
    assert "with these settings: points" in out
    assert "cells differ" in out
    assert "not compared" in out
    assert "identical" not in out
    status, out, _ = told(drive, "--set", "planner.rate_hz=25")  # another pace of steps
    assert "with these settings: the counts are the same" in out


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--set", "map.cel_m=1"), "map.cel_m: unknown key; allowed are method, cells"),
        (("--set", "map.cell_m=9"), "map.cell_m: must be a number from 0.005 to 1, is 9"),
        (("--set", "cells"), "must be section.key=value"),
        (("--set", "mop.x=1"), "[mop]: unknown section; allowed are loop"),
        (("--from", "99"), "--from: 99 is not within the recording, which is 3.2 s"),
        (("--to", "-1"), "--to: must be 0 s from the begin or more, is -1"),
        (("--to", "25:00:00"), "--to: must be seconds from the begin, HH:MM:SS"),
        (("--to", "soon"), "--to: must be seconds from the begin, HH:MM:SS"),
        (("--from", "2", "--to", "1"), "--from 2 is behind --to 1"),
        (("--at", "1"), "--at says when --picture is taken"),
    ],
)
def test_wrong_use_is_one_line(words: tuple[str, ...], said: str, drive: Path, told: Told) -> None:
    status, _, err = told(drive, *words)
    assert status == 2
    assert said in err
    assert len(err.splitlines()) == 1


def test_pictures_and_a_film_of_a_part_of_a_drive(drive: Path, told: Told, tmp_path: Path) -> None:
    image = pytest.importorskip("PIL.Image")
    av = pytest.importorskip("av")
    picture, film = tmp_path / "a.png", tmp_path / "a.mp4"
    status, out, _ = told(
        drive, "--from", "1", "--to", "2", "--picture", picture, "--at", "1.5", "--video", film
    )
    assert status == 0
    assert "2.0 s played" in out
    with image.open(picture) as made:
        colours = {colour for _, colour in made.convert("RGB").getcolors(1 << 20)}
    assert {(30, 30, 36), (230, 159, 0), (196, 198, 204)} <= colours  # obstacle, robot, unknown
    with av.open(str(film)) as made:
        [stream] = made.streams
        assert stream.width % 2 == stream.height % 2 == 0
        assert 18 <= sum(1 for _ in made.decode(stream)) <= 22  # 20 a second


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda data: b'{"mapod_recording": 2, "version": "0.1"}\n', "form 2, not 3"),
        (lambda data: data[:40] + data[90:], "damaged"),
        (lambda data: data[:-30_000] + bytes(30_000), "damaged before byte"),
        (lambda data: b"\x0a\x0d\x0d\x0a" + bytes(40), "damaged before byte"),
    ],
)
def test_what_is_damaged_is_one_line(
    damage: Callable[[bytes], bytes], words: str, drive: Path, told: Told, tmp_path: Path
) -> None:
    (tmp_path / "bad.mcap").write_bytes(damage(drive.read_bytes()))
    status, _, err = told(tmp_path / "bad.mcap")
    assert status == 2
    assert words in err
    assert len(err.splitlines()) == 1


def test_a_recording_that_was_broken_off_is_played_to_its_end(
    drive: Path, told: Told, tmp_path: Path
) -> None:
    data = drive.read_bytes()
    (tmp_path / "half.mcap").write_bytes(data[: len(data) // 2 + 1])
    status, out, _ = told(tmp_path / "half.mcap")
    assert status == 0
    assert "the recording was cut off" in out
    assert "planner: identical" in out


def test_a_recording_without_scans_says_why_none_was_mapped(told: Told, tmp_path: Path) -> None:
    loop = RecordedLoop(tmp_path / "mute.mcap", shipped())
    loop.rig.scanner.mute = True
    loop.run(1.0)
    loop.recorder.close()
    status, _, err = told(tmp_path / "mute.mcap")
    assert status == 1
    assert "the recording holds no byte of the scanner" in err


def test_a_capture_of_a_scanner_is_mapped_without_the_simulation(
    told: Told, monkeypatch: Patch
) -> None:
    monkeypatch.setattr(tool, "lacks_simulation", lambda: "it is not here")
    status, out, _ = told(CAPTURE)
    assert status == 0
    assert "stream 0, 53984 bytes of the scanner 192.168.0.1:2112, 15 Hz" in out
    assert "16 scans mapped, 0 dropped" in out
    status, _, err = told(CAPTURE, "--stream", "7")
    assert (status, len(err.splitlines())) == (2, 1)
    assert "--stream 7" in err


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (("--picture", "map.txt"), "--picture map.txt: must end with .png"),
        (("--picture", "no/such/map.png"), "--picture no/such/map.png: must be a file in a folder"),
        (("--video", "no/such/map.mp4"), "--video no/such/map.mp4: must be a file in a folder"),
        (("--out", "no/such/o.json"), "--out no/such/o.json: must be a file in a folder"),
        (("--config", "broken.toml"), "broken.toml: not valid TOML: "),
    ],
)
def test_a_file_that_cannot_be_is_named_before_anything_is_played(
    drive: Path,
    told: Told,
    tmp_path: Path,
    monkeypatch: Patch,
    words: tuple[str, ...],
    line: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("broken.toml").write_text("x = [", encoding="utf-8")
    status, out, err = told(drive, *words)
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert err.startswith(f"mapod replay: {line}")


def test_a_replay_that_was_stopped_says_so_last(
    drive: Path, told: Told, monkeypatch: Patch
) -> None:
    play = tool.play

    def stopped(source: Source, *rest: Any) -> None:
        options = argparse.Namespace(begin=None, end="1", at=None, picture=None, video=None)
        options.speed = math.inf
        play(source, rest[0], options, rest[2])
        raise KeyboardInterrupt

    monkeypatch.setattr(tool, "play", stopped)
    status, out, err = told(drive)
    assert (status, "identical" in out) == (130, True)  # as far as it was played
    assert err == "mapod replay: stopped by Ctrl-C after 1.0 s: the rest was not played\n"
    status, _, err = told("nothere.mcap")
    assert (status, err) == (2, "mapod replay: nothere.mcap: no such file or folder\n")


def test_a_picture_of_behind_the_end_is_refused(drive: Path, told: Told, tmp_path: Path) -> None:
    status, _, err = told(drive, "--to", "1", "--at", "2", "--picture", tmp_path / "map.png")
    assert (status, err) == (2, "mapod replay: --at 2 is behind --to 1\n")


def test_a_capture_s_option_is_refused_for_a_recording(drive: Path, told: Told) -> None:
    status, _, err = told(drive, "--stream", "0")
    line = f"mapod replay: --stream is of a capture; {drive} is a recording of mapod\n"
    assert (status, err) == (2, line)


def test_a_recording_cut_before_its_first_chunk_says_so(
    drive: Path, told: Told, tmp_path: Path
) -> None:
    """Its settings are there, and no time is known: none is told."""
    cut = tmp_path / "cut.mcap"
    whole = drive.read_bytes()
    cut.write_bytes(whole[: whole.index(ZSTD) + 100])
    status, out, err = told(cut)
    assert (status, out) == (2, "")
    assert err == f"mapod replay: {cut} was cut off before its first second ended\n"


def test_bytes_that_no_session_takes_are_told_so(
    tmp_path: Path, told: Told, monkeypatch: Patch
) -> None:
    (tmp_path / "junk_d2h.bin").write_bytes(bytes(1000))
    status, out, err = told(tmp_path / "junk_d2h.bin")
    assert (status, out) == (2, "")
    assert "is neither a recording of mapod nor a capture: the file holds no scan" in err
    monkeypatch.setattr(laser, "LONGEST_START_S", 5.0)
    data = tool.SHIPPED_RECORDING.read_bytes()
    first = data.index(b"sSN LMDscandata") - 8  # all answers of the start-up are lost
    (tmp_path / "late_d2h.bin").write_bytes(data[first : first + 20_000])
    status, _, err = told(tmp_path / "late_d2h.bin")
    assert status == 1
    assert "no scan was mapped: the scanner is starting: " in err
    status, _, err = told("no/such.mcap")
    assert status == 2
    assert "no/such.mcap" in err
