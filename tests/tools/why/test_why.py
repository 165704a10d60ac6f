"""A drive to a box, asked why: at the box, on the way, and where there is nothing to ask."""

import json
import math
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from config_file import load_config
from core.mapping.causes import CAUSES, FIRST_DOUBT, STANDS, TOO_HIGH
from logs import LOG, set_up_logging
from mapod_link.frames import DRIVE, bytes_from_frame
from recording.direct import DirectTap
from recording.reader import Recording
from tests import ROOT, Capsys
from tests.support.robot.recorded import DriveToBox, note_line
from tools.cli import export, why
from tools.replay.changes import changed
from tools.replay.player import Player
from tools.why.beams import ranges_in
from tools.why.moment import Watch, cell_facts, moment_of
from tools.why.picture import OBSTACLE_RGB
from tools.why.text import lines_of
from tools.why.words import describe_cell

pytestmark = pytest.mark.slow

BOX_X_M, READY_S, DRIVEN_S = 2.33, 1.7, 6.0
TOLD = ("age", "height", "variance")  # of a cell; None where it is not known
PLACE_M = (BOX_X_M + 0.02, 0.02)  # of a cell that is the box's face


class LoggingTap(DirectTap):
    """It keeps the log's lines as well, as that of a robot does."""

    def line(self, t_s: float, level: str, event: str, keys: Mapping[str, Any]) -> None:
        note_line(self, t_s, level, event, keys)


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> tuple[DriveToBox, Path]:
    path = tmp_path_factory.mktemp("why") / "drive.mcap"
    loop = DriveToBox(partial(LoggingTap, path), BOX_X_M, start_clear_m=12.0, asked_mps=0.4)
    with path.with_suffix(".log").open("w") as log:
        writer = set_up_logging(loop.config, log.fileno())
        loop.run(READY_S)
        loop.link_port.give(bytes_from_frame(DRIVE, 9, 9, bytes(16)))  # of another run, no nonce
        loop.drive(DRIVEN_S)
        loop.recorder.close()
        LOG.close()
        writer.close()
    return loop, path


def story(path: Path, capsys: Capsys, *words: str) -> dict[str, Any]:
    assert why.main([str(path), "--json", *words]) == 0
    told: dict[str, Any] = json.loads(capsys.readouterr().out)
    return told


def test_a_robot_before_a_box_stands_because_of_the_boxs_cells(
    drive: tuple[DriveToBox, Path], capsys: Capsys
) -> None:
    loop, path = drive
    told = story(path, capsys, "--at", str(READY_S + DRIVEN_S - 0.1))
    stands, live = told["moment"]["stands"], loop.app.pilot.control
    assert stands["reason"] == live.blocked_by == "an obstacle is in the way"
    assert stands["asked"]["v_mps"] == pytest.approx(0.4)
    bars = stands["way_ends_at"]
    assert bars["state"] == "obstacle"
    assert bars["cause"] in (STANDS, TOO_HIGH)
    assert abs(bars["x_m"] - BOX_X_M) < 0.3
    stop = stands["stops"][-1]
    assert stop["reason"] == stands["reason"]
    assert stop["cell"]["state"] == "obstacle"
    assert told["moment"]["zone"]["causes"] == ["an obstacle"]
    assert told["moment"]["refusals"]["drive requests"] == {"DRIVE out of range": 1}
    planner = next(one for one in told["moment"]["inputs"] if one["name"] == "planner")
    assert planner["frames_rejected"] == 1
    assert planner["reasons"] == ["DRIVE out of range"]
    log = {line["event"]: line for line in told["log"]}
    assert log["drive_changed"]["keys"] == {"blocked_by": "an obstacle is in the way"}
    assert log["drive_changed"]["t_s"] == pytest.approx(stop["t_s"], abs=0.02)
    assert log["answers_rejected"]["keys"]["newest_reason"] == "DRIVE out of range"
    assert "ticks_counted" not in log
    assert told["remarks"] == []  # the replay's bytes are those of the run


def test_the_text_says_the_same_and_the_picture_shows_the_box(
    drive: tuple[DriveToBox, Path], tmp_path: Path, capsys: Capsys
) -> None:
    Image = pytest.importorskip("PIL.Image")
    loop, path = drive
    out = tmp_path / "map.png"
    at = str(READY_S + DRIVEN_S - 0.1)
    assert why.main([str(path), "--at", at, "--xy", "2.35,0.02", "--out", str(out)]) == 0
    text = capsys.readouterr().out
    assert "stands: an obstacle is in the way" in text
    assert CAUSES[STANDS].sentence.rstrip(".") in text
    assert "met it at" in text
    pixels = np.asarray(Image.open(out))
    assert pixels.shape[0] == pixels.shape[1] <= 900
    assert (pixels[..., 3] == 255).all()
    grid = loop.app.mapper.maps.window.grid
    px = pixels.shape[0] // grid.size
    i, j = grid.cell_of(BOX_X_M + 0.05, 0.5)
    row = pixels.shape[0] - 1 - int((j + 0.5 - grid.corner_j) * px)
    column = int((i + 0.5 - grid.corner_i) * px)
    assert tuple(pixels[row, column, :3]) == OBSTACLE_RGB


def test_a_cell_tells_its_rule_its_beams_and_when_it_changed(
    drive: tuple[DriveToBox, Path], capsys: Capsys
) -> None:
    loop, path = drive
    place = f"{PLACE_M[0]},{PLACE_M[1]}"
    told = story(path, capsys, "--at", str(READY_S + DRIVEN_S - 0.1), "--xy", place)
    cell = told["cell"]
    assert cell["state"] == "obstacle"
    known = {name: math.nan if cell[name] is None else cell[name] for name in TOLD}
    assert cell["text"] == describe_cell(cell["cause"], *known.values())
    met, passed = cell["met"][0], cell["passed"][0]  # it stands so near that beams go over it
    assert -0.05 < met["z_m"] < 0.93 + 0.05 < passed["z_m"]
    assert met["t_s"] < passed["t_s"] <= told["t_s"] < passed["t_s"] + 0.2
    assert met["scan"] < passed["scan"]
    x_m = loop.rig.world.pose()[0]
    to_face_m = PLACE_M[0] - x_m - loop.config.scanner.mount_x_m
    assert passed["range_m"] == pytest.approx(to_face_m, abs=0.25)
    change = cell["changes"][0]
    assert change["to"] == "obstacle"
    assert change["t_s"] < told["t_s"]


def test_the_cause_of_each_cell_is_of_its_state_at_every_moment(
    drive: tuple[DriveToBox, Path],
) -> None:
    watch = Watch(Player(Recording(drive[1])), None)
    for after_s in (0.5, 1.8, 3.0, 5.0):
        for _ in watch.steps_until(watch.player.begin_s + after_s):
            pass
        moment = moment_of(watch)
        if after_s < 1.0:
            assert moment["mode"] == "booting"
            assert moment["doubts"]
            assert watch.app.tiles.doubt >= FIRST_DOUBT
        json.dumps(moment, allow_nan=False)
        cell = cell_facts(watch.app, (1, 1))
        assert cell is not None
        assert cell["state"] == cell["text"].split(" ")[0]


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (("--at", "99"), "--at: 99 is not within the recording, which is "),
        (("--at", "noon"), "--at: must be seconds from the begin, "),
        (("--at", "3", "--cell", "-9000,2"), "cell -9000,2 is outside of the map, which is -"),
        (("--at", "3", "--xy", "-1e300,0"), "--xy -1e+300,0 lies beyond any map"),
        (("--at", "3", "--cell", "9000,2"), "cell 9000,2 is outside of the map, which is -"),
        (("--at", "3", "--xy", "1e300,0"), "--xy 1e+300,0 lies beyond any map"),
    ],
)
def test_what_cannot_be_asked_is_one_line(
    drive: tuple[DriveToBox, Path], capsys: Capsys, words: tuple[str, ...], line: str
) -> None:
    assert why.main([str(drive[1]), *words]) in (1, 2)
    said = capsys.readouterr().err
    assert said.startswith(f"mapod why: {line}")
    assert said.count("\n") == 1


@pytest.mark.parametrize("method", ["surface", "reference_plane", "certainty"])
def test_every_method_is_asked(drive: tuple[DriveToBox, Path], method: str) -> None:
    recording = Recording(drive[1])
    config = changed(load_config(recording.config), [f'map.method="{method}"'])
    watch = Watch(Player(recording, config), (1, 1))
    for _ in watch.steps_until(watch.player.begin_s + 5.0):
        pass
    story = why.story_of(recording, watch)
    assert story["cell"]["counts"].keys() == watch.app.mapper.maps.evidence(1, 1).keys()
    assert list(lines_of(story))
    json.dumps(story, allow_nan=False)


@pytest.mark.parametrize("ask", [(why.main, "--at", "3"), (export.main, "--to", "csv")])
def test_of_a_capture_it_is_said_what_plays_it(
    ask: tuple[Callable[[list[str]], int], str, str], capsys: Capsys, tmp_path: Path
) -> None:
    main, *words = ask
    out = ["--out", str(tmp_path / "out")]
    assert main([str(ROOT / "tests/vectors/tim781_1s.pcapng"), *words, *out]) == 1
    said = capsys.readouterr().err
    assert "is a capture of a scanner's network traffic" in said
    assert said.endswith("only mapod replay plays it\n")
    assert not (tmp_path / "out").exists()


def test_beams_are_found_by_the_column_of_the_cell() -> None:
    class Straight:
        """Three beams from (0.05, 0.05, 1): ahead, aslant, and straight down."""

        origins = np.tile([0.05, 0.05, 1.0], (3, 1))
        rays = np.array([[1.0, 0.0, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, -1.0]])

    near, far = ranges_in(Straight, (10, 0), 0.1)  # type: ignore[arg-type]
    np.testing.assert_allclose(near, [0.95, np.nan, np.nan])
    np.testing.assert_allclose(far, [1.05, np.nan, np.nan])
    near, far = ranges_in(Straight, (0, 0), 0.1)  # type: ignore[arg-type]
    assert np.isnan(near[:2]).all()  # it is nearer than a beam can tell
    assert near[2] < far[2] == np.inf
    near, _ = ranges_in(Straight, (6, 8), 0.1)  # type: ignore[arg-type]
    assert np.isnan(near[0])
    assert near[1] == pytest.approx(0.9375)
