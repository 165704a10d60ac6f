"""Whole runs and short campaigns: judged, repeated, recorded; blind planners are caught."""

import dataclasses
import json
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from rich.console import Console

from config_file import with_changes
from fakes.lms1xx.recorded import RecordedLms111
from fakes.scenes.scene import Scene, Solid
from tests import Capsys
from tests.support.robot.blind_pilot import BlindPilot
from tests.support.robot.shipped import FLOOR
from tools.rig import campaign
from tools.rig.campaign import Outcomes, Task, outcome_of, spec_of
from tools.rig.planner.build import program
from tools.rig.runs import record
from tools.rig.runs.loop import rig_config
from tools.rig.runs.one_run import FIRST_GOAL_S, GIVEN_UP_S, Run, RunResult, RunSpec
from tools.rig.runs.outcomes import Outcome, as_json, is_well, show
from tools.rig.runs.picture import draw_run
from tools.rig.runs.record import Recorder
from tools.rig.runs.sheet import words_of
from tools.rig.runs.watch import Watcher, image_of, line_of, picture
from tools.sweep.local import LocalProcesses

WALL = Solid("wall", (14.0, 14.5), (-6.0, 6.0), (0.0, 2.0))
LOW_BOX = Solid("low box", (0.8, 1.2), (-0.5, 0.5), (0.0, 0.2))  # where nobody may have left one
BEHIND = Solid("wall behind", (-0.7, -0.5), (-6.0, 6.0), (0.0, 2.0))
Caught = tuple[Run, Path, str]
GOALS = ((0.7, 0.0), (1.1, 0.1))
SCENES = ("hall", "passage")


def place(*things: Solid, goals: Any = GOALS) -> Scene:
    return Scene("hall", (FLOOR, WALL, *things), goals=goals)


def result_of(
    scene: Scene, pilot: BlindPilot | None = None, limit_s: float = 25.0, **robot: Any
) -> RunResult:
    config = with_changes(rig_config(scene), robot=robot) if robot else None
    return Run(RunSpec(scene, 1, limit_s=limit_s), pilot or BlindPilot(), config).to_end()


@pytest.fixture(scope="module")
def arrived() -> RunResult:
    return result_of(place())


@pytest.fixture(scope="module")
def caught(tmp_path_factory: pytest.TempPathFactory) -> Caught:
    """A run that ends at a low box, the folder in which it was written down, what was told of it
    meanwhile."""
    folder, told = tmp_path_factory.mktemp("run"), StringIO()
    run = Run(RunSpec(place(LOW_BOX), 1), BlindPilot())
    with Recorder(run, folder) as recorder, Watcher(Console(file=told), speed=0.0) as watcher:
        recorder.finish(run.to_end(recorder, watcher))
    return run, folder, told.getvalue()


def test_a_run_without_anything_in_the_way_reaches_its_goals(arrived: RunResult) -> None:
    assert (arrived.reached, arrived.goals, arrived.ended) == (2, 2, "all goals were tried")
    assert not arrived.collisions
    assert not arrived.stops
    assert 0.5 < arrived.driven_m < 1.5
    assert 0.0 < arrived.worst_stop_m < 0.5


@pytest.mark.slow
def test_another_place_than_its_goal_is_none() -> None:
    result = result_of(place(goals=((1.0, 0.0),)), BlindPilot(radius_m=0.9))
    assert result.reached == 0
    assert "a place for it that is " in result.missed[0].cause


def test_two_runs_of_one_spec_agree_to_the_bit_and_another_seed_does_not() -> None:
    one, same, other = (
        Run(RunSpec(place(), seed, limit_s=0.5), BlindPilot()).to_end().digest for seed in (1, 1, 2)
    )
    assert one == same != other


def test_a_blind_planner_is_caught(caught: Caught) -> None:
    result = caught[0].result()
    (contact,) = result.collisions
    assert contact.what == "low box"
    assert result.ended.startswith("collision with low box")
    assert [missed.number for missed in result.missed] == [1, 2]
    assert "never tried" in result.missed[1].cause


@pytest.mark.slow
def test_one_that_backs_into_a_wall_with_mapods_zone_off_is_caught() -> None:
    scene = place(BEHIND, goals=((-4.0, 0.0),))
    result = result_of(scene, BlindPilot(v_mps=-0.4), unknown_stops=False, start_clear_m=0.0)
    assert result.collisions[0].what == "wall behind"


@pytest.mark.slow  # tests/app/test_drive.py has a short form
def test_before_a_wall_mapod_stops_it_and_the_run_tells_why() -> None:
    scene = place(Solid("box", (2.0, 2.5), (-1.0, 1.0), (0.0, 1.2)), goals=((8.0, 0.0),))
    result = result_of(scene, limit_s=9.0)
    assert not result.collisions
    assert result.stops[0].in_way == "box"
    (missed,) = result.missed
    assert "time was up" in missed.cause
    assert "mapod: an obstacle is in the way" in missed.cause
    assert 0.1 < result.least_gap_m < 0.7


@pytest.mark.slow
def test_a_planner_that_gives_up_ends_the_run_with_its_cause() -> None:
    pilot = BlindPilot()
    pilot.gives_up = "no way over seen ground"
    result = result_of(place(goals=GOALS[:1]), pilot, limit_s=30.0)
    assert result.sim_s == pytest.approx(FIRST_GOAL_S + GIVEN_UP_S, abs=0.5)
    assert "the planner: no way over seen ground" in result.missed[0].cause


@pytest.mark.slow
def test_a_fault_stops_the_robot_and_its_stop_is_not_called_false() -> None:
    scene = place(goals=((7.0, 0.0),))
    run = Run(RunSpec(scene, 1, ("scanner.wire.mute@5s+1.2s",), limit_s=7.5), BlindPilot())
    (stop,) = run.to_end().stops
    told = [said for _, said in run.loop.happened]
    assert told == ["scanner.wire.mute on", "scanner.wire.mute off"]
    assert (stop.in_way, stop.why) == ("a fault", "the scanner delivers no scans")


def test_a_recorded_run_can_be_played_and_drawn_again(caught: Caught) -> None:
    run, folder, _ = caught
    facts = json.loads((folder / "run.json").read_text(encoding="utf-8"))
    assert facts["digest"] == run.result().digest
    assert facts["collisions"][0]["what"] == "low box"
    played = RecordedLms111.from_files(folder / "scanner_d2h.bin")
    assert played.scans > 50
    for wire in record.WIRES:
        index = (folder / f"{wire}_index.csv").read_text(encoding="ascii").splitlines()
        for way in ("d2h", "h2d"):
            rows = [row.split(",") for row in index if f",{way}," in row]
            size = (folder / f"{wire}_{way}.bin").stat().st_size
            assert sum(int(row[3]) for row in rows) == size > 0
    lines = (folder / "events.jsonl").read_text(encoding="utf-8").splitlines()
    events = {json.loads(line)["event"] for line in lines}
    assert {"goal_changed", "collision_noted", "run_ended"} <= events
    (folder / "picture.png").unlink()
    with Image.open(draw_run(folder, run.scene)) as drawn:
        colours = np.array(drawn.convert("RGB")).reshape(-1, 3)
    assert (colours == (255, 174, 0)).all(axis=1).any()  # the robot


def test_a_watched_run_tells_a_person_what_happens(caught: Caught) -> None:
    run, _, told = caught
    assert "goal 1 of 2" in told
    assert f"{run.since_begin_s:.1f} s" in line_of(run)
    image = image_of(run)
    assert (image == 4).sum() > 5  # the robot, in its middle
    console = Console(width=120, height=40, force_terminal=True, color_system="truecolor")
    with console.capture() as drawn:
        console.print(picture(run, console))
    assert "hall, seed 1" in drawn.get()


def test_run_k_of_a_seed_is_the_same_whatever_else_is_run() -> None:
    specs = [spec_of(1, number, SCENES) for number in range(40)]
    assert [spec.scene for spec in specs[:4]] == ["hall", "passage", "hall", "passage"]
    assert len({spec.seed for spec in specs}) == 40
    assert spec_of(1, 17, SCENES) == specs[17]
    assert spec_of(2, 17, SCENES) != specs[17]
    assert spec_of(1, 3, SCENES, faults=2).faults == spec_of(1, 3, SCENES, faults=2).faults
    assert len(spec_of(1, 3, SCENES, faults=2).faults) >= 2


@pytest.mark.slow
def test_a_short_campaign_collides_nowhere_and_agrees_across_processes() -> None:
    program("gcc")
    tasks = [Task(k, spec_of(1, k, SCENES, limit_s=3.0)) for k in range(2)]
    nowhere = Task(2, RunSpec("no such scene", 1))
    ended = Outcomes([*tasks, nowhere]).missing(LocalProcesses(1))
    outcomes = {outcome.number: outcome for outcome in ended}
    assert "FileNotFoundError" in outcomes[2].crash
    for task in tasks:
        result, here = outcomes[task.number].result, outcome_of(task).result
        assert result is not None
        assert here is not None
        assert not result.collisions
        assert result.digest == here.digest
    assert not is_well(list(outcomes.values()), 3)


@pytest.mark.slow
def test_a_run_that_missed_its_goals_is_recorded_once_more_with_a_picture(
    tmp_path: Path, capsys: Capsys
) -> None:
    short = ["--runs", "1", "--scene", "passage", "--limit", "2", "--jobs", "1"]
    assert campaign.main([*short, "--misses", str(tmp_path)]) == 1
    assert "recording 1 of these runs" in capsys.readouterr().out
    assert json.loads((tmp_path / "run_000" / "run.json").read_text())["missed"]
    for name in ("run_000/picture.png", "misses.png"):
        with Image.open(tmp_path / name) as picture:
            assert picture.size > (100, 100)
    assert words_of(tmp_path / "run_000").startswith("run_000, passage; goal 1: ")


def test_the_report_tells_how_to_repeat(arrived: RunResult, caught: Caught) -> None:
    bad = caught[0].result()
    outcomes = [
        Outcome(0, RunSpec("hall", 1), arrived),
        Outcome(1, RunSpec("hall", 2), bad),
        Outcome(2, RunSpec("hall", 3), crash="it fell"),
        Outcome(3, RunSpec("hall", 1), arrived),
    ]
    console = Console(width=200, no_color=True)
    with console.capture() as shown:
        show(console, outcomes, 5, "make campaign ONLY={number}", 10.0, markdown=True)
    for words in (
        "| all   |    3 |",
        "4 of 6 goals (66.7 %), 1 collisions, 1 crashes",
        "again: make campaign ONLY=1",
        "crashed: it fell",
        "broken off after 4 of 5 runs",
        "NOT WELL",
    ):
        assert words in shown.get()
    assert json.loads(json.dumps(as_json(outcomes)))[1]["collisions"]


def test_well_is_all_runs_no_harm_and_most_goals(arrived: RunResult, caught: Caught) -> None:
    spec, few = RunSpec("hall", 1), dataclasses.replace(arrived, reached=1)
    faulty = RunSpec("hall", 1, ("scanner.mute@1s",))
    assert is_well([Outcome(0, spec, arrived)], 1)
    assert not is_well([Outcome(0, spec, arrived)], 2)
    assert not is_well([Outcome(0, spec, caught[0].result())], 1)
    assert not is_well([Outcome(0, spec, few)], 1)
    assert is_well([Outcome(0, faulty, few)], 1)


@pytest.mark.parametrize(
    ("scene", "words"), [("nowhere", "nowhere"), ("yard", "'yard' has no goals")]
)
def test_a_scene_without_goals_is_refused(scene: str, words: str, capsys: Capsys) -> None:
    assert campaign.main(["--runs", "1", "--scene", scene]) == 2
    told = capsys.readouterr().err
    assert words in told
    assert "hall" in told, "what there is"


@pytest.mark.parametrize("option", ["--record", "--misses"])
def test_a_folder_that_is_a_file_is_refused(option: str, tmp_path: Path, capsys: Capsys) -> None:
    (tmp_path / "file").touch()
    assert campaign.main(["--runs", "1", option, str(tmp_path / "file")]) == 2
    assert str(tmp_path / "file") in capsys.readouterr().err


def test_mixed_scenes_are_a_campaign_of_their_own(capsys: Capsys) -> None:
    options = campaign.arguments_of(["--mixed", "--runs", "3", "--seed", "4"])
    tasks = campaign.tasks_of(options)
    assert [task.spec.name for task in tasks] == ["mixed"] * 3
    assert len({task.spec.seed for task in tasks}) == 3
    assert "SCENE=mixed" in campaign.again(options)
    with pytest.raises(SystemExit, match="2"):
        campaign.arguments_of(["--mixed", "--scene", "hall"])
    assert "no --scene with it" in capsys.readouterr().err


def test_another_robot_on_the_same_body_drives_a_campaign_of_its_own(capsys: Capsys) -> None:
    options = campaign.arguments_of(["--robot", "urg04lx", "--runs", "1", "--limit", "2"])
    (task,) = campaign.tasks_of(options)
    assert 'ARGS="--robot urg04lx --limit 2"' in campaign.again(options)
    usual = dataclasses.replace(task, spec=dataclasses.replace(task.spec, robot=""))
    assert len(campaign.tasks_by_key([task, usual])) == 2
    assert Run(task.spec, BlindPilot()).loop.config.scanner.driver == "urg04lx"
    for robot in ("messor", "nobody"):
        assert campaign.main(["--robot", robot]) == 2
        assert f"must be one of urg04lx, is '{robot}'" in capsys.readouterr().err
