"""`mapod sweep` on a drive of the campaign: rows, table, page; begun again; and wrong use."""

import json
import sys
from pathlib import Path

import pytest

from config_file import load_config, with_changes
from fakes.scenes.scene import Scene, Solid
from recording.reader import Recording
from tests import Capsys
from tests.support.robot.blind_pilot import BlindPilot
from tests.support.robot.shipped import FLOOR
from tools.cli.sweep import main
from tools.replay.player import Player
from tools.rig.runs.one_run import RunSpec
from tools.rig.runs.record import Recorder, recorded_run
from tools.sweep.page import page_of
from tools.sweep.scores import SCORES
from tools.sweep.tables import lines_of

pytestmark = pytest.mark.slow

SECONDS = 7.0
PLACE = Scene(
    "hall", (FLOOR, Solid("wall", (9.0, 9.5), (-6.0, 6.0), (0.0, 2.0))), goals=((4.0, 0.0),)
)
GENTLE = {"robot": {"max_accel_mps2": 0.2}}  # so that the motors are told other things


@pytest.fixture(scope="module")
def drives(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a drive that mapod steered, and its truth."""
    folder = tmp_path_factory.mktemp("drives")
    run = recorded_run(RunSpec(PLACE, 1, limit_s=SECONDS), folder / "run", BlindPilot())
    with Recorder(run, folder / "run") as recorder:
        result = run.to_end(recorder)
        recorder.finish(result)
    assert result.driven_m > 0.5
    return folder


@pytest.fixture(scope="module")
def recording(drives: Path) -> Recording:
    return Recording(drives / "run" / "drive.mcap")


def played(player: Player) -> Player:
    while not player.done:
        player.step()
    return player


def test_a_sweep_scores_each_drive_with_each_setting_and_begun_again_does_nothing(
    drives: Path, tmp_path: Path, capsys: Capsys
) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    out = tmp_path / "out"
    words = [str(drives), "--set", "map.cell_m=0.1,0.2", "--jobs", "1", "--out", str(out)]
    assert main(words) == 0
    rows = parquet.read_table(out / "rows.parquet").to_pylist()
    assert [row["map.cell_m"] for row in rows] == [0.1, 0.2]
    for row in rows:
        assert row["drive"] == "run/drive.mcap"
        assert row["recorded_s"] == pytest.approx(SECONDS, abs=0.1)
        assert row["scans"] > 100
        assert (row["scans_lost"], row["failed"]) == (0.0, None)
        assert row["place_error_m"] < 0.1
        assert row["free_on_danger_m2"] == 0.0
        assert row["cpu_ms_per_scan"] > 0.0
    page = (out / "page.html").read_text(encoding="utf-8")
    assert all(f"<h2>{score.name}" in page for score in SCORES if rows[0][score.name] is not None)
    assert "http" not in page, "nothing from elsewhere"
    assert "cell_m 0.1" in capsys.readouterr().out
    before = (out / "rows.jsonl").read_bytes()
    assert main(words) == 0
    assert "2 jobs, 2 of them done before" in capsys.readouterr().out
    assert (out / "rows.jsonl").read_bytes() == before
    assert main([str(drives), "--set", "map.cell_m=0.1", "--out", str(out)]) == 2
    assert "another sweep: its set is" in capsys.readouterr().err


def test_a_job_without_a_map_is_a_row_with_its_cause(
    drives: Path, tmp_path: Path, capsys: Capsys, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)  # as where it is not installed
    words = ["--set", "scanner.dialect=ascii", "--jobs", "1", "--out", str(tmp_path)]
    assert main([str(drives), *words]) == 1
    told = capsys.readouterr().out
    assert "run/drive.mcap scanner.dialect=ascii: no scan was mapped: " in told
    assert "rows.csv instead" in told
    head, row = (tmp_path / "rows.csv").read_text(encoding="utf-8").splitlines()
    assert head.startswith("drive,recording,scanner.dialect")
    assert "no scan was mapped" in row
    assert "failed" in json.loads((tmp_path / "rows.jsonl").read_text(encoding="utf-8"))


def test_with_other_settings_the_wheels_turn_as_they_were_recorded(recording: Recording) -> None:
    own = load_config(recording.config)
    as_it_was = played(Player(recording, own))
    assert as_it_was.checks[0].is_identical
    gentle = played(Player(recording, with_changes(own, **GENTLE)))
    assert gentle.app.mapper.counts == as_it_was.app.mapper.counts


def test_the_page_of_many_drives_draws_boxes_and_names_what_has_no_scores() -> None:
    table = [
        {"drive": f"drive {k}", "map.cell_m": 0.1, "lone_cells": float(k), "scans_lost": 0.0}
        for k in range(40)
    ]
    lines = lines_of(table, [{"map.cell_m": 0.1}, {"map.cell_m": 0.2}])
    page = page_of("a < b", "facts", lines, ["drive 3: it fell"])
    assert page.count('class="box"') == 1
    assert "no drive has it" in page
    assert "0 in every drive, with all settings" in page
    assert "a &lt; b" in page
    assert "<li>drive 3: it fell</li>" in page


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--set", "map.cellm=0.1"], "--set map.cellm: unknown key"),
        (["--set", "maps.cell_m=0.1"], "--set maps: unknown section"),
        (["--set", "map.cell_m=0.1,7"], "--set map.cell_m: must be"),
        (["--set", "map.cells=11", "--set", "obstacle.window_cells=101"], "window_cells"),
        (["--set", "drive.invert=[],[1]"], "--set drive: has no effect"),
        (["--set", "map.cell_m"], "must be section.key=value"),
        (["nowhere"], "nowhere: no such file or folder"),
        (["{empty}"], "holds no recording"),
        (["{letter}"], "letter.txt"),
        (["--config", "nowhere.toml"], "nowhere.toml"),
        (["--config", "{letter}"], "not valid TOML"),
        (["--out", "{letter}"], "--out: must be a folder"),
        (["--out", "{other}"], "holds other things (letter.txt)"),
        (["--sample", "0"], "must be a whole number, 1 or more"),
        (["--scheduler", "nowhere"], "no scheduler answers at nowhere"),
    ],
    ids=lambda given: given if isinstance(given, str) else " ".join(given),
)
def test_wrong_use_is_told_in_one_line(
    words: list[str], told: str, drives: Path, tmp_path: Path, capsys: Capsys
) -> None:
    if "--scheduler" in words:
        pytest.importorskip("distributed")
    (tmp_path / "empty").mkdir()
    (tmp_path / "other").mkdir()
    letter = tmp_path / "other" / "letter.txt"
    letter.write_text("dear", encoding="utf-8")
    places = {"empty": tmp_path / "empty", "letter": letter, "other": tmp_path / "other"}
    given = [word.format(**places) if "{" in word else word for word in words]
    if "--out" not in given:
        given += ["--out", str(tmp_path / "out")]
    try:
        status = main([str(drives), *given])
    except SystemExit as end:
        status = int(end.code or 0)
    complained = capsys.readouterr().err
    assert (status, complained.count("\n")) == (2, 1), complained
    assert complained.startswith("mapod sweep: ")
    assert told in complained


def test_a_cluster_without_its_library_is_told(
    drives: Path, tmp_path: Path, capsys: Capsys, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)  # as where it is not installed
    words = [str(drives), "--scheduler", "tcp://127.0.0.1:8786", "--out", str(tmp_path)]
    assert main(words) == 2
    assert "pip install 'mapod[sweep]'" in capsys.readouterr().err
