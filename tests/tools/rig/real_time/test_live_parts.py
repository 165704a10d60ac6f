"""The parts of the live rig: rig.toml and its errors, goals, doubts, the app's log, the truth."""

import argparse
import json
import math
from pathlib import Path

import pytest

from core.config import ConfigError
from fakes.scenes.scene import load_scene
from fakes.world.truth_log import GroundTruthLog
from fakes.world.world import World
from tests import ROOT, Patch
from tools.rig.live import ON_HOST, Bench, form_of
from tools.rig.planner.build import build_planner_library, shipped_robot
from tools.rig.planner.host import PlannerState
from tools.rig.real_time.rig_file import BOARD, load_rig_config, load_rig_file
from tools.rig.real_time.story import GIVE_UP_S, AppLog, Doubts, Tour, TruthLog

SHIPPED = (ROOT / "rig.toml").read_text(encoding="utf-8")
REAL_DRIVE = {"devices.drive": "serial:///dev/ax3500?baud=9600&parity=E&bytesize=7"}
REAL = {
    **REAL_DRIVE,
    "devices.scanner": "tcp://192.168.0.1:2112",
    "devices.ahrs": "serial:///dev/mti?baud=115200",
}
LOOKED_AT = REAL | {"planner.start_clear_m": 2.0}


def test_the_shipped_file_loads_and_each_key_has_a_comment() -> None:
    config = load_rig_file(ROOT / "rig.toml")
    assert (config.devices.planner, config.devices.real) == (BOARD, {})
    assert config.planner.unknown_mps == 0.0
    assert Path(config.robot.config) == ROOT / "mapod.toml"
    values = [line for line in SHIPPED.splitlines() if "=" in line and not line.startswith("#")]
    assert all("#" in line for line in values if not line.startswith(" "))


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("world.seed", -1, "world.seed: Expected `int` >= 0, is -1"),
        ("world.goals", [[1.0, 2e3]], "world.goals: Expected `float` <= 1000.0"),
        ("world.sensors", "good", "world.sensors: expected Literal['sheet', 'clean'], is 'good'"),
        ("devices.scanner", "192.168.0.1", "devices.scanner: must be 'fake', or a port ("),
        ("devices.planner", "fake", "devices.planner: must be 'board' or 'host', or a port ("),
        ("planner.board_baud", 9600, "planner.board_baud: expected Literal[115200, 230400"),
        ("planner.start_clear_m", "far", "start_clear_m: expected Union[float, Literal['scene']]"),
        ("planner.unknown_mps", math.nan, "planner.unknown_mps: Expected `float` >= 0.0, is nan"),
        ("extra.key", 3, "Object contains unknown field `extra`"),
    ],
)
def test_a_wrong_value_is_named_with_what_is_allowed(key: str, value: object, words: str) -> None:
    with pytest.raises(ConfigError) as caught:
        load_rig_config(SHIPPED, {key: value})
    assert words in str(caught.value)


def test_missing_keys_sections_and_files_are_named(tmp_path: Path) -> None:
    for text, words in (
        (SHIPPED.replace("seed = 1 ", "# "), "world: Object missing required field `seed`"),
        (SHIPPED.partition("[robot]")[0], "Object missing required field `robot`"),
        ("[world", "not TOML"),
    ):
        with pytest.raises(ConfigError, match=f"^{words}"):
            load_rig_config(text)
    with pytest.raises(ConfigError, match=r"nowhere\.toml"):
        load_rig_file(tmp_path / "nowhere.toml")
    (tmp_path / "rig.toml").write_text(SHIPPED)
    with pytest.raises(ConfigError, match=r"robot\.config: must be a file that is there"):
        load_rig_file(tmp_path / "rig.toml")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (REAL_DRIVE, "fake scanner and a fake ahrs"),
        (REAL | {"devices.ahrs": "fake"}, "beside a fake ahrs"),
        (REAL, r"^planner\.start_clear_m: must be a number with a real"),
        (LOOKED_AT | {"planner.unknown_mps": 0.1}, r"^planner\.unknown_mps: must be 0 with a real"),
    ],
)
def test_a_real_drive_takes_nothing_from_a_scene(changes: dict[str, object], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        load_rig_config(SHIPPED, changes)
    lifted = {"planner.start_clear_m": 2.0, "devices.wheels_off_the_ground": True}
    load_rig_config(SHIPPED, REAL_DRIVE | lifted)
    assert list(load_rig_config(SHIPPED, LOOKED_AT).devices.real) == ["scanner", "ahrs", "drive"]


@pytest.mark.parametrize("real", [False, True])
def test_motors_are_enabled_for_a_simulated_robot_only(real: bool, tmp_path: Path) -> None:
    changes: dict[str, object] = {"devices.planner": "serial:///dev/planner?baud=921600"}
    if real:
        changes |= LOOKED_AT
    config = load_rig_config(SHIPPED, changes)
    bench = Bench(config, argparse.Namespace(fault=[], seconds=None), tmp_path)
    values = bench.values()
    assert values.get("robot.enable_motors") == (None if real else True)
    assert values["robot.start_clear_m"] == (
        2.0 if real else load_scene(config.world.scene).start_clear_m
    )
    assert (bench.tour.total == 0) is real
    bench.close()


def test_goals_are_told_one_after_the_other_and_kept_with_what_became_of_them() -> None:
    told: list[tuple[float, float]] = []
    tour = Tour([(1.0, 2.0), (3.0, 4.0)], lambda x_m, y_m: told.append((x_m, y_m)))

    def step(now_s: float, state: PlannerState | None) -> None:
        tour.step(now_s, state, lambda x_m, y_m: 0.25)

    step(0.0, None)
    assert told == []
    step(1.0, PlannerState())
    step(1.5, PlannerState("arrived"))  # of the goal before: too early to be of this one
    step(5.0, PlannerState("driving"))
    step(9.0, PlannerState("arrived"))
    assert tour.visits[0].words(9.0) == "(1.0, 2.0) m reached in 8 s, truly 0.25 m off"
    step(9.2, PlannerState())
    assert told == [(1.0, 2.0), (3.0, 4.0)]
    stopped = PlannerState("stopped", "no way over seen ground")
    step(12.0, stopped)
    step(12.0 + GIVE_UP_S, PlannerState("driving"))
    step(20.0 + GIVE_UP_S, stopped)
    assert not tour.is_over
    step(20.0 + 2 * GIVE_UP_S, stopped)
    assert tour.is_over
    assert tour.reached == 1
    assert tour.visits[1].words(99.0) == "(3.0, 4.0) m not reached: no way over seen ground"


def test_doubts_count_from_the_first_go_on() -> None:
    doubts = Doubts()
    for now_s, advice, why in (
        (0.0, "stop", "no map yet"),
        (1.0, "go", ""),
        (2.0, "stop", "link stale"),
        (2.5, "slow", "a frame is missing"),
        (4.0, "stop", "link stale"),
        (4.2, "go", ""),
        (4.5, "stop", "mode 3"),
    ):
        doubts.step(now_s, advice, why)
    assert doubts.words(5.0) == [
        "link stale: 2 times, 0.50 s at most",
        "mode fault: 1 times, 0.50 s at most",
    ]


def test_the_apps_log_is_followed_as_it_grows(tmp_path: Path) -> None:
    path = tmp_path / "app.log"
    log = AppLog(path)
    log.step()
    first = {"event": "ticks_counted", "ticks": 200, "slots_missed": 1, "latest_s": 0.003}
    second = {"event": "drive_changed", "blocked_by": "an obstacle"}
    path.write_text(f"words of no event\n{json.dumps(first)}\n{json.dumps(second)[:9]}")
    log.step()
    assert (log.ticks, log.missed, log.blocked_by) == (200, 1, "")
    path.write_text(f"words of no event\n{json.dumps(first)}\n{json.dumps(second)}\n")
    log.step()
    assert log.blocked_by == "an obstacle"
    assert (log.has_started, log.missing) == (False, "")
    for event in (
        {"event": "app_started"},
        {"event": "device_changed", "device": "ahrs", "state": "closed", "cause": "no /dev/mti"},
        {"event": "device_changed", "device": "drive", "state": "starting", "cause": "asks"},
        {"event": "device_changed", "device": "drive", "state": "running", "cause": "hot"},
    ):
        with path.open("a") as file:
            file.write(json.dumps(event) + "\n")
    log.step()
    assert (log.has_started, log.missing) == (True, "ahrs: no /dev/mti")
    assert log.words == "1 ticks lost, late by 3.0 ms at most"


def test_the_judge_sees_what_the_fakes_process_tells(tmp_path: Path) -> None:
    path, scene = tmp_path / "truth.jsonl", load_scene("corridor")
    world = World(scene, 1)
    with path.open("w", encoding="ascii") as out:
        witness = GroundTruthLog(out, world, "corridor", 1)
        for tick in range(100):
            now_s = 50.0 + tick * 0.02
            world.wheels.set_power(0.3, 0.3)
            world.step_to(now_s)
            witness.step(now_s)
    truth = TruthLog(path, scene)
    truth.step()
    assert truth.judge.truth.since_s == pytest.approx(1.98, abs=0.021)
    x_m, y_m, _ = world.pose()[:3]
    assert truth.gap_m(x_m, y_m) < 0.02
    assert truth.judge.driven_m > 0.1
    assert not truth.judge.collisions


def test_without_an_emulator_the_planner_runs_here(monkeypatch: Patch, tmp_path: Path) -> None:
    build_planner_library(shipped_robot())
    monkeypatch.setenv("PATH", str(tmp_path))
    form = form_of(load_rig_config(SHIPPED), 0.0, tmp_path)
    assert form.words == ON_HOST
    assert "apt install" in form.remark
    assert form.remark.endswith("taking the planner's C on this machine instead")
    assert form.url.startswith("udp://127.0.0.1:")
    form.close()
