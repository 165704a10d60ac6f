"""The parts of the live rig: rig.toml and its errors, goals, doubts, the app's log, the truth."""

import argparse
import io
import json
import math
import struct
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from rich.text import Text

from core.config import ConfigError
from fakes.planner_mcu.receiver import FakePlanner
from fakes.scenes.scene import load_scene
from fakes.world.truth_log import GroundTruthLog
from fakes.world.world import World
from mapod_link.frames import GEOM, MAP, POSE, bytes_from_frame
from tests import ROOT
from tools.rig.bench import Bench
from tools.rig.c_build import build_planner_library, shipped_robot
from tools.rig.c_planner import PlannerSettings, PlannerState
from tools.rig.config import BOARD, KEYS, load_rig_config, load_rig_file
from tools.rig.followed import Followed
from tools.rig.forms import HostForm, form_of
from tools.rig.live_picture import image_of, picture
from tools.rig.story import GIVE_UP_S, AppLog, Doubts, Tour
from tools.rig.watch import GOAL, ROBOT

SHIPPED = (ROOT / "rig.toml").read_text(encoding="utf-8")
IDLE = PlannerState(
    state="idle", why="", recovery="", v_mps=0.0, w_radps=0.0, x_m=0.0, y_m=0.0, yaw_rad=0.0,
    goal=(0.0, 0.0), advice="go", advice_why="", blank=False, suspect=False, stale=False, tries=0,
    accepted=0, rejected=0,
)  # fmt: skip


def test_the_shipped_file_loads_and_has_every_key_with_a_comment() -> None:
    config = load_rig_file(ROOT / "rig.toml")
    assert (config.planner, config.real, config.unknown_mps) == (BOARD, {}, 0.0)
    assert Path(config.config) == ROOT / "mapod.toml"
    table = tomllib.loads(SHIPPED)
    assert {section: set(keys) for section, keys in table.items()} == {
        section: set(keys) for section, keys in KEYS.items()
    }
    values = [line for line in SHIPPED.splitlines() if "=" in line and not line.startswith("#")]
    assert all("#" in line for line in values if not line.startswith(" "))


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("world.seed", -1, "must be a whole number from 0 to 2147483647, is -1"),
        ("world.seed", True, "must be a whole number"),
        ("world.scene", "", "must be a text that is not empty"),
        ("world.goals", [[1.0]], r"must be a list of places \[x_m, y_m\], or \[\]"),
        ("world.goals", [[1.0, 2e3]], "must be a number from -1000 to 1000"),
        ("world.sensors", "good", "must be 'sheet' or 'clean', is 'good'"),
        ("devices.scanner", "192.168.0.1", "must be 'fake', or a port"),
        ("devices.planner", "fake", "must be 'board' or 'host', or a port"),
        ("devices.ahrs", 7, "must be 'fake', or a port"),
        ("planner.board_baud", 9600, "must be 115200 or 230400 or 460800 or 921600, is 9600"),
        ("planner.start_clear_m", 21.0, "must be 'scene', or a number from 0 to 20"),
        ("planner.unknown_mps", math.nan, "must be a number from 0 to 1"),
        ("planner.speed", 1, "unknown; allowed are board_baud, start_clear_m, unknown_mps"),
        ("robot.config", 3, "must be a text"),
    ],
)
def test_a_wrong_value_is_named_with_what_is_allowed(key: str, value: object, words: str) -> None:
    with pytest.raises(ConfigError, match=rf"^{key}: {words}"):
        load_rig_config(SHIPPED, {key: value})


def test_missing_keys_and_sections_are_named() -> None:
    with pytest.raises(ConfigError, match=r"^world\.seed: missing"):
        load_rig_config(SHIPPED.replace("seed = 1 ", "# "))
    with pytest.raises(ConfigError, match=r"^robot: missing"):
        load_rig_config(SHIPPED.partition("[robot]")[0])
    with pytest.raises(ConfigError, match=r"^extra: unknown"):
        load_rig_config(SHIPPED + "[extra]\n")
    with pytest.raises(ConfigError, match=r"^not TOML"):
        load_rig_config("[world")


def test_a_real_drive_beside_a_fake_scanner_wants_the_wheels_off_the_ground() -> None:
    drive = {"devices.drive": "serial:///dev/ax3500?baud=9600&parity=E&bytesize=7"}
    with pytest.raises(ConfigError, match="fake scanner and a fake ahrs"):
        load_rig_config(SHIPPED, drive)
    seeing = drive | {"devices.scanner": "tcp://192.168.0.1:2112"}
    with pytest.raises(ConfigError, match="beside a fake ahrs"):
        load_rig_config(SHIPPED, seeing)
    looked_at = {"planner.start_clear_m": 2.0}
    load_rig_config(SHIPPED, drive | looked_at | {"devices.wheels_off_the_ground": True})


def test_a_real_drive_takes_nothing_from_a_scene_and_enters_no_unseen_ground() -> None:
    real = {
        "devices.drive": "serial:///dev/ax3500?baud=9600&parity=E&bytesize=7",
        "devices.scanner": "tcp://192.168.0.1:2112",
        "devices.ahrs": "serial:///dev/mti?baud=115200",
    }
    with pytest.raises(ConfigError, match=r"^planner\.start_clear_m: must be a number with a real"):
        load_rig_config(SHIPPED, real)
    looked_at = real | {"planner.start_clear_m": 2.0}
    with pytest.raises(ConfigError, match=r"^planner\.unknown_mps: must be 0 with a real drive"):
        load_rig_config(SHIPPED, looked_at | {"planner.unknown_mps": 0.1})
    config = load_rig_config(SHIPPED, looked_at)
    assert list(config.real) == ["scanner", "ahrs", "drive"]


@pytest.mark.parametrize("real", [False, True])
def test_motors_are_enabled_for_a_simulated_robot_only(real: bool, tmp_path: Path) -> None:
    changes: dict[str, object] = {"devices.planner": "serial:///dev/planner?baud=921600"}
    if real:
        changes |= {
            "devices.drive": "serial:///dev/ax3500?baud=9600",
            "devices.wheels_off_the_ground": True,
            "planner.start_clear_m": 2.0,
        }
    config = load_rig_config(SHIPPED, changes)
    bench = Bench(config, argparse.Namespace(fault=[], seconds=None), tmp_path)
    values = bench.values({"scanner": "tcp://127.0.0.1:1"})
    assert values.get("robot.enable_motors") == (None if real else True)
    assert values["robot.start_clear_m"] == (2.0 if real else bench.scene.start_clear_m)
    assert (bench.tour.total == 0) is real
    assert bench.close() == []


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"nowhere\.toml"):
        load_rig_file(tmp_path / "nowhere.toml")
    alone = tmp_path / "rig.toml"
    alone.write_text(SHIPPED)
    with pytest.raises(ConfigError, match=r"robot\.config: must be a file that is there"):
        load_rig_file(alone)


def test_goals_are_told_one_after_the_other_and_kept_with_what_became_of_them() -> None:
    told: list[tuple[float, float]] = []
    tour = Tour([(1.0, 2.0), (3.0, 4.0)], lambda x_m, y_m: told.append((x_m, y_m)))

    def step(now_s: float, state: PlannerState | None) -> None:
        tour.step(now_s, state, lambda x_m, y_m: 0.25)

    step(0.0, None)
    assert told == []
    step(1.0, IDLE)
    step(1.5, replace(IDLE, state="arrived"))  # of the goal before: too early to be of this one
    step(5.0, replace(IDLE, state="driving"))
    step(9.0, replace(IDLE, state="arrived"))
    assert tour.visits[0].words(9.0) == "(1.0, 2.0) m reached in 8 s, truly 0.25 m off"
    step(9.2, IDLE)
    assert told == [(1.0, 2.0), (3.0, 4.0)]
    stopped = replace(IDLE, state="stopped", why="no way over seen ground")
    step(12.0, stopped)
    step(12.0 + GIVE_UP_S, replace(IDLE, state="driving"))
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
    followed = Followed(path, scene)
    followed.step()
    assert followed.newest is not None
    assert followed.newest.since_s == pytest.approx(1.98, abs=0.021)
    x_m, y_m, _ = world.pose()[:3]
    assert followed.gap_m(x_m, y_m) < 0.02
    assert followed.judge.driven_m > 0.1
    assert followed.hits == 0


def test_the_picture_shows_robot_and_goal_in_the_map_that_came() -> None:
    planner = FakePlanner()
    assert image_of(planner, None).size == 0
    geom = struct.pack("<BxHHHIHH", 7, 21, 21, 200, 1, 20, 500)
    pose = struct.pack("<iihhhhhHBBBB", 2000, 2000, 0, 0, 0, 0, 0, 0x7F, 3, 1, 2, 1)
    free = struct.pack("<hhHB3s", 0, 0, 0, 7, bytes(3)) + bytes([0x40 | 63, 0xF9, 0x02])
    for seq, (kind, body) in enumerate(((GEOM, geom), (POSE, pose), (MAP, free))):
        planner.feed_datagram(1.0, bytes_from_frame(kind, seq, 1000, body))
    image = image_of(planner, (3.1, 9.9))  # beyond the left edge: y grows to the left
    assert image.shape == (21, 21)
    rows, columns = np.nonzero(image == GOAL)
    assert rows.mean() == pytest.approx(5.5, abs=1.0)  # x = 3.1 m: 15 cells up from below
    assert columns.max() <= 1
    rows, columns = np.nonzero(image == ROBOT)
    assert rows.mean() < 10.5  # its nose, which is longer, points up
    assert columns.mean() == pytest.approx(10.5, abs=0.6)
    console = Console(file=io.StringIO(), width=100, height=30, color_system="truecolor")
    console.print(picture(planner, None, [Text("planner  driving")], 100, 30))
    assert isinstance(console.file, io.StringIO)
    assert "driving" in console.file.getvalue()


def test_without_an_emulator_the_planner_runs_here_and_the_packages_are_named(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    build_planner_library(shipped_robot())
    monkeypatch.setenv("PATH", str(tmp_path))
    form, remark = form_of(load_rig_config(SHIPPED), PlannerSettings(), tmp_path)
    assert isinstance(form, HostForm)
    assert "apt install" in remark
    assert remark.endswith("taking the planner's C on this machine instead")
    assert form.url.startswith("udp://127.0.0.1:")
    form.close()


def test_a_real_planner_is_left_to_itself(tmp_path: Path) -> None:
    url = "serial:///dev/planner?baud=921600"
    config = load_rig_config(SHIPPED, {"devices.planner": url})
    form, remark = form_of(config, PlannerSettings(), tmp_path)
    form.goal(1.0, 2.0)
    form.halt()
    form.step(1.0)
    assert (form.url, form.state, form.maybe_map(), remark) == (url, None, None, "")
