"""What the flight recorder has saved in mid-run, played: it stops for what it had stopped for."""

import json
import os
from collections.abc import Callable, Mapping
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app import App
from core.records import FREE, OBSTACLE
from logs import LOG, set_up_logging
from recording.mcap_file import RecordingFile
from recording.reader import Recording
from recording.records import BYE, CHECK, FIRST, IN, OF_CALLS, OPENED, OUT
from recording.writer import Writer
from tests import Capsys
from tests.support.robot.recorded import DriveToBox, note_line
from tools.cli import replay, why
from tools.replay.player import Player
from tools.rig.runs.loop import START_S

pytestmark = pytest.mark.slow

BOX_X_M, READY_S, FLIGHT_S = 12.33, 3.0, 13.0
UNKNOWN = "it begins in the middle of a run: the map is unknown at its begin"


class WriterTap:
    """Hands all to a writer in this very process, whose flights are shorter."""

    def __init__(self, clock: Callable[[], float], **wanted: Any) -> None:
        self.calls, self.clock, self.trouble = 0, clock, ""
        self._writer, self._wanted = Writer(os.open(os.devnull, os.O_WRONLY), FLIGHT_S), wanted
        self._synced_s = START_S

    def begin(self, first: Mapping[str, Any]) -> None:
        self.note(0.0, FIRST, 0, json.dumps({**first, **self._wanted}).encode())

    def note(
        self, t_s: float, kind: bytes, port: int = 0, data: bytes = b"", more: bytes = b""
    ) -> None:
        self._writer.take(t_s, kind, port, data + more)

    def line(self, t_s: float, level: str, event: str, keys: Mapping[str, Any]) -> None:
        note_line(self, t_s, level, event, keys)

    def flush(self, now_s: float) -> None:
        if now_s - self._synced_s >= 1.0:
            self._synced_s = now_s
            self._writer.sync()

    def end(self, wait_s: float) -> None:
        self.note(self.clock(), BYE, 0, b"{}")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[DriveToBox, Path]:
    """To the box, and its folder.

    The scanner's wire was off for a while, long before the stop; that of the attitude sensor is
    cut long after it.
    """
    folder = tmp_path_factory.mktemp("run")
    wanted: dict[str, Any] = {
        "path": f"{folder}/all.mcap",
        "file_mb": 0.2,
        "flight": f"{folder}/flight",
    }
    tap_with = partial(WriterTap, **wanted)
    loop = DriveToBox(tap_with, BOX_X_M, start_clear_m=20.0, asked_mps=0.9)
    with (folder / "log").open("w") as log:
        writer = set_up_logging(loop.config, log.fileno())
        loop.run(2.0)
        loop.wires["scanner"].cut = True
        loop.run(0.3)
        loop.wires["scanner"].cut = False
        loop.run(READY_S - 2.3)
        loop.drive(16.0)
        loop.run(9.0)
        loop.wires["ahrs"].cut = True
        loop.run(0.4)
        loop.wires["ahrs"].cut = False
        loop.run(1.5)
        loop.recorder.close()
        LOG.close()
        writer.close()
    return loop, folder


@pytest.fixture(scope="module")
def flight(run: tuple[DriveToBox, Path]) -> Path:
    [path] = (run[1] / "flight").glob("*-stop.mcap")
    return path


def cells_at(app: App, places: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """States of the cells of (n, 2) places in the map frame."""
    window = app.mapper.maps.window
    i, j = np.floor(places / app.config.map.cell_m).astype(int).T
    states: np.ndarray[Any, Any] = window.cells[j % window.grid.size, i % window.grid.size]
    return states


def test_a_flight_stops_where_and_why_the_robot_stopped(
    run: tuple[DriveToBox, Path], flight: Path
) -> None:
    recording = Recording(flight)
    assert not recording.from_start
    told = [line.keys for line in recording.logs() if line.event == "drive_changed"]
    assert told[-1] == {"blocked_by": "an obstacle is in the way"}
    player = Player(recording)
    player.play_until(player.begin_s + 2.0)
    app = player.app
    assert {status.state for status in app.states.statuses.values()} == {"running"}
    assert player.app.report(player.now_s)[1].mode == 1
    while not player.done:
        player.step()
    assert app.pilot.control.blocked_by == told[-1]["blocked_by"]
    whole = Player(Recording(run[1] / "all.mcap"))
    whole.play_until(player.now_s)
    mine, its = app.mapper.maybe_pose(player.now_s), whole.app.mapper.maybe_pose(whole.now_s)
    assert mine is not None
    assert its is not None
    assert np.hypot(mine.x_m - its.x_m, mine.y_m - its.y_m) < 0.05  # the frame is the run's own
    assert abs(mine.yaw_rad - its.yaw_rad) < 0.005
    corner = np.stack(np.meshgrid(np.arange(8.0, 16.0, 0.2), np.arange(-4.0, 4.0, 0.2)), -1)
    now, then = (cells_at(one.app, corner.reshape(-1, 2) + 0.1) for one in (player, whole))
    known = (now != 0) & (then != 0)
    assert (now == OBSTACLE).sum() > 10
    assert (now == FREE).sum() > 500
    assert (now[known] == then[known]).mean() > 0.98
    for name, status in app.states.statuses.items():
        assert (status.state, status.losses) == ("running", 0), name
    assert app.mapper.counts.erased == 0
    assert app.devices.drive.measured() == whole.app.devices.drive.measured()


def test_it_is_played_and_asked_by_the_commands(flight: Path, capsys: Capsys) -> None:
    assert replay.main([str(flight), "--from", "5"]) == 0
    said = capsys.readouterr().out
    assert "saved because: an obstacle is in the way" in said
    assert UNKNOWN in said
    assert "identical" not in said
    assert replay.main([str(flight), "--set", "scanner.last_deg=60"]) == 0
    assert "with these settings: points" in capsys.readouterr().out
    seconds = Player(Recording(flight)).begin_s
    [stopped_s] = [
        line.t_s
        for line in Recording(flight).logs()
        if line.keys == {"blocked_by": "an obstacle is in the way"}
    ]
    assert why.main([str(flight), "--at", str(stopped_s - seconds + 0.05)]) == 0
    said = capsys.readouterr().out
    assert "stands: an obstacle is in the way" in said
    assert "obstacle (stands)" in said
    assert UNKNOWN in said


def test_a_device_is_lost_again_for_the_same_cause_and_comes_back(
    run: tuple[DriveToBox, Path],
) -> None:
    files = (run[1] / "flight").glob("*.mcap")  # names of one second are in no order of time
    [path] = (path for path in files if not path.stem.endswith(("-stop", "-scanner-lost")))
    assert path.stem.endswith(("-fault", "-ahrs-lost"))  # whichever came first after the pause
    recording = Recording(path)
    assert not recording.from_start
    keys = "state", "cause"
    recorded = [
        tuple(line.keys[key] for key in keys)
        for line in recording.logs()
        if line.event == "device_changed" and line.keys["device"] == "ahrs"
    ]
    assert recorded[0][0] != "running"
    player, played = Player(recording), [("running", "")]
    while not player.done:
        player.step()
        status = player.app.states.statuses["ahrs"]
        if player.now_s > player.begin_s + 1.0 and played[-1] != (status.state, status.cause):
            played.append((status.state, status.cause))
    assert played[1:] == recorded


def test_a_flight_of_an_older_version_is_refused_in_one_line(
    flight: Path, tmp_path: Path, capsys: Capsys
) -> None:
    recording = Recording(flight)
    left_out = (CHECK, "opening")
    said = {key: text for key, text in recording.metadata.items() if key not in left_out}
    file = RecordingFile(tmp_path / "old.mcap", said, recording.ports)
    for number, record in enumerate(islice(recording.records(), 1000)):
        port = 0 if record.kind in OF_CALLS else record.port
        file.wire(record.t_s, record.kind, port, record.data, number + 10_000)
    file.finish({})
    assert replay.main([str(tmp_path / "old.mcap")]) == 2
    assert why.main([str(tmp_path / "old.mcap"), "--at", "1"]) == 1
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 2
    assert all("what its devices had answered before is not in it" in line for line in lines)


def test_a_flight_that_is_cut_is_played_up_to_there_or_refused_in_one_line(
    flight: Path, tmp_path: Path, capsys: Capsys
) -> None:
    data, path = flight.read_bytes(), tmp_path / "cut.mcap"
    path.write_bytes(data[: 2 * len(data) // 3])
    assert replay.main([str(path)]) == 0
    assert "the recording was cut off" in capsys.readouterr().out
    path.write_bytes(data[: len(data) // 40])
    assert replay.main([str(path)]) == 2
    assert why.main([str(path), "--at", "1"]) == 1
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 2
    assert all("cut off before all that could be played" in line for line in said)


def test_a_recording_whose_first_file_is_gone_is_played_from_its_next_one(
    run: tuple[DriveToBox, Path],
) -> None:
    second = Recording(run[1] / "all.2.mcap")
    assert not second.from_start
    player = Player(second)
    player.play_until(player.begin_s + 3.0)
    assert {status.state for status in player.app.states.statuses.values()} == {"running"}
    assert player.app.mapper.counts.scans_added > 40


def test_what_stands_at_its_head_is_bounded_and_of_the_newest_connections(flight: Path) -> None:
    recording = Recording(flight)
    opening = recording.opening()
    begin_s = next(recording.records()).t_s
    opened = {record.port: record.t_s - START_S for record in opening if record.kind == OPENED}
    assert opened[1] < 1.0 < 2.2 < opened[0] < 3.0  # the scanner's second connection
    assert all(record.t_s < begin_s for record in opening)
    for port in range(3):
        said = [record for record in opening if record.port == port]
        assert {IN, OUT} <= {record.kind for record in said}
        assert sum(len(record.data) for record in said) < 1 << 16
