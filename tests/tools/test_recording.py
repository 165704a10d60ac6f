"""A run written down and played again: the same map, and a planner that hears the same."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from app import App, Ports
from config_file import load_config
from recorder import Recorder
from recording.direct import DirectTap
from recording.reader import Recording
from tests import ROOT, Capsys, Patch
from tools import laser_replay
from tools.cli import replay as tool
from tools.played import RecordingReplay, why_nothing_was_mapped
from tools.rig.loop import SESSION, START_S, Loop

SHIPPED = (ROOT / "mapod.toml").read_text(encoding="utf-8")


class RecordedLoop(Loop):
    """A simulated robot whose run is written down."""

    def __init__(self, path: Path) -> None:
        config = load_config(SHIPPED)
        self.now_s = START_S
        self.recorder = Recorder(config, "0.1", DirectTap(path, lambda: self.now_s))
        super().__init__("corridor", 1, config, drives=True)

    def _new_app(self, key: bytes | None) -> App:
        scanner, ahrs, drive = self.ports.values()
        ports = self.recorder.ports(Ports(scanner, ahrs, drive, self.link_port))
        app = App(self.config, ports, session=SESSION)
        return self.recorder.begin(app, key is not None, None)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[RecordedLoop, Path]:
    """Three seconds of a drive, the scanner's wire cut for a while."""
    path = tmp_path_factory.mktemp("recording") / "drive.mcap"
    loop = RecordedLoop(path)
    loop.run(2.0)
    loop.wires["scanner"].cut = True
    loop.run(0.3)
    loop.hang(0.15)
    loop.wires["scanner"].cut = False
    loop.run(0.8)
    loop.recorder.close()
    assert loop.recorder.trouble == ""
    return loop, path


def played(path: Path) -> RecordingReplay:
    replay = RecordingReplay(Recording(path))
    while not replay.done:
        replay.step()
    return replay


def test_a_replay_gives_the_map_of_the_run(run: tuple[RecordedLoop, Path]) -> None:
    loop, path = run
    replay, other = played(path), played(path)
    assert loop.app.mapper.counts.scans_added > 20
    assert replay.app.mapper.counts == loop.app.mapper.counts
    np.testing.assert_array_equal(
        replay.app.mapper.maps.window.cells, loop.app.mapper.maps.window.cells
    )
    assert replay.app.devices.scanner.status.losses == loop.app.devices.scanner.status.losses == 1
    assert replay.now_s == loop.now_s
    pose, geom = replay.view.planner.pose, replay.view.planner.geom
    assert pose is not None
    assert geom is not None
    assert (pose.mode, geom.session) == (4, SESSION)
    assert replay.view.outcome(replay.app) == other.view.outcome(other.app)


def test_a_recording_that_was_broken_off_is_played(
    run: tuple[RecordedLoop, Path], tmp_path: Path, capsys: Capsys
) -> None:
    data = run[1].read_bytes()
    (tmp_path / "half.mcap").write_bytes(data[: len(data) // 2 + 1])
    assert tool.main([str(tmp_path / "half.mcap")]) == 0
    assert "scans mapped" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda data: b'{"mapod_recording": 2, "version": "0.1"}\n', "form 2, not 3"),
        (lambda data: data[:40] + data[90:], "damaged"),
        (lambda data: data[:-30_000] + bytes(30_000), "damaged before byte"),
    ],
)
def test_what_is_no_recording_is_refused_in_words(
    damage: Callable[[bytes], bytes], words: str, run: tuple[RecordedLoop, Path], tmp_path: Path,
    capsys: Capsys,
) -> None:  # fmt: skip
    (tmp_path / "bad.mcap").write_bytes(damage(run[1].read_bytes()))
    assert tool.main([str(tmp_path / "bad.mcap")]) == 2
    told = capsys.readouterr().err
    assert words in told
    assert len(told.splitlines()) == 1


def test_a_recording_without_scans_says_why_none_was_mapped(tmp_path: Path) -> None:
    path = tmp_path / "mute.mcap"
    loop = RecordedLoop(path)
    loop.rig.scanner.mute = True
    loop.run(1.0)
    loop.recorder.close()
    replay = played(path)
    assert why_nothing_was_mapped(replay) == "the recording holds no byte of the scanner"


def test_bytes_that_no_session_takes_are_told_so(
    tmp_path: Path, capsys: Capsys, monkeypatch: Patch
) -> None:
    (tmp_path / "junk_d2h.bin").write_bytes(bytes(1000))
    assert tool.main([str(tmp_path / "junk_d2h.bin")]) == 1
    assert "no scan was mapped: the file holds no scan" in capsys.readouterr().err
    monkeypatch.setattr(laser_replay, "LONGEST_START_S", 5.0)
    data = tool.SHIPPED_RECORDING.read_bytes()
    first = data.index(b"sSN LMDscandata") - 8  # all answers of the start-up are lost
    (tmp_path / "late_d2h.bin").write_bytes(data[first : first + 20_000])
    assert tool.main([str(tmp_path / "late_d2h.bin")]) == 1
    assert "no scan was mapped: the scanner is starting: " in capsys.readouterr().err
    assert tool.main(["no/such.rec"]) == 2
    assert "no/such.rec" in capsys.readouterr().err
