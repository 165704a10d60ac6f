"""A floor cleaner with app, fakes and a planner that drives the path: from frames to floor."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cleaner import Cleaner
from config_file import load_config, with_changes
from core.motion.odometry import Odometry
from fakes.planner_mcu.path_driving import PathDriving
from fakes.scenes.scene import Scene, Solid
from fakes.world.slip import Slip
from recording.reader import Recording
from recording.records import PLANNED
from tests import ROOT
from tests.support.robot.depth_loop import DepthLoop
from tools.replay.player import Player

UP = (-1.0, 2.5)
ROOM = Scene(
    "room",
    (
        Solid("floor", (-2.0, 3.0), (-2.5, 2.5), (-1.0, 0.0)),
        Solid("wall behind", (-0.95, -0.75), (-1.5, 1.5), UP),
        Solid("wall ahead", (2.25, 2.45), (-1.5, 1.5), UP),
        Solid("right wall", (-0.95, 2.45), (-1.7, -1.5), UP),
        Solid("left wall", (-0.95, 2.45), (1.5, 1.7), UP),
    ),
)
CLEANER = with_changes(
    load_config((ROOT / "robots" / "cleaner.toml").read_text(encoding="utf-8")),
    robot={"enable_motors": True, "start_clear_m": 1.2},
)


def cleaner_of(loop: DepthLoop) -> Cleaner:
    assert loop.app.cleaner is not None
    return loop.app.cleaner


@pytest.mark.slow
def test_a_path_is_planned_told_driven_held_back_in_doubt_and_replayed_to_the_bit(
    tmp_path: Path,
) -> None:
    loop = DepthLoop(ROOM, CLEANER, tmp_path / "drive.mcap", drives=False)
    driving, cleaner = PathDriving(loop.planner), cleaner_of(loop)

    def go(seconds: float) -> None:
        loop.run(seconds, lambda: driving.step(loop.now_s))

    go(5.2)
    told = loop.planner.vectors.path
    meant = np.vstack([one.points_m for one in cleaner.path.segments])
    assert cleaner.goal == "look"
    assert loop.planner.vectors.path_state(loop.now_s) == ("known", "")
    np.testing.assert_allclose(told.points_m, meant, atol=0.0006)
    assert told.ahead == cleaner.path.ahead
    assert loop.rig.world.pose()[0] > 0.15
    loop.camera.all_invalid = True  # it sees nothing any more
    go(1.5)
    version = cleaner.path.version
    before, speed_mps = loop.rig.world.pose()[:3], loop.planner.pose.v_mps  # type: ignore[union-attr]
    go(3.0)
    assert cleaner.doubt == "the depth camera tells nothing"
    assert (cleaner.path.version, told.ahead) == (version, None)
    assert speed_mps == pytest.approx(0.0, abs=0.01)
    np.testing.assert_allclose(loop.rig.world.pose()[:3], before, atol=0.002)
    loop.recorder.close()
    recording = Recording(tmp_path / "drive.mcap")
    assert sum(record.kind == PLANNED for record in recording.records()) == version > 0
    player = Player(recording)
    while not player.done:
        player.step()
    [check] = player.checks
    assert check.is_identical, check.describe()
    assert check.played_bytes == len(loop.sent) > 1000
    again = player.app.cleaner
    assert again is not None
    assert (again.goal, again.path.version, again.doubt) == (cleaner.goal, version, cleaner.doubt)


@pytest.mark.slow
def test_walls_keep_the_place_where_wheels_slip(monkeypatch: pytest.MonkeyPatch) -> None:
    """Both wheels count 60 % too much for a second in seven, which no gyro tells."""
    slips = tuple(Slip(0.6, 0.6, t_s, t_s + 1.0) for t_s in range(20, 62, 7))

    def off_m() -> float:
        """In the mean: what slips there and back cancels out."""
        loop = DepthLoop(replace(ROOM, slips=slips), CLEANER, drives=False)
        driving, begin = PathDriving(loop.planner), loop.rig.world.pose()[:2]
        far_m = list[float]()

        def step() -> None:
            driving.step(loop.now_s)
            there = loop.rig.world.pose()[:2]
            x_m, y_m = loop.app.mapper.odometry.xy_at(loop.now_s)
            far_m.append(math.hypot(begin[0] + x_m - there[0], begin[1] + y_m - there[1]))

        loop.run(62.0, step)
        return float(np.nanmean(far_m))

    with_walls_m = off_m()
    monkeypatch.setattr(Odometry, "correct_by", lambda odometry, fix, at_s: True)
    assert with_walls_m < 0.05
    assert off_m() > 2.0 * with_walls_m
