"""The app of a robot without wheels in a closed loop: its map by external poses alone."""

import numpy as np
import pytest

from config_file import load_config, with_changes
from core.config import Config
from core.driving import health
from core.records import FREE
from fakes.world.kinematic import KinematicWorld
from fakes.world.trajectory import Way, stand, straight
from fakes.world.world import Wheels
from tests import ROOT
from tests.support.cases import few
from tests.support.robot.closed_loop import ClosedLoop, compare
from tests.support.robot.shipped import shipped

CART = with_changes(
    load_config((ROOT / "robots" / "cart.toml").read_text(encoding="utf-8")),
    planner={
        "port": "udp://127.0.0.1:9750"
    },  # the loop's one planner is the positioning system, too
)
POSES = {"motion": {"source": "external"}, "drive": {"driver": "none", "port": ""}}
BY_POSES = shipped(**POSES)
FREE_TOLD = 1  # a cell of the planner's window
UNTOLD_S = 0.4 + 0.15  # after the newest pose that fits: no FREE any more


def walked(config: Config, rate_hz: float, seconds: float, sigma_m: float = 0.01) -> ClosedLoop:
    """A drive along the scene's route, which a positioning system sees.

    It is exact until the map has its frame, which so is the world's; then it errs.
    """
    loop = ClosedLoop(config)
    system = loop.positioning
    noise = (sigma_m, 0.5 * sigma_m, np.radians(0.3))
    system.rate_hz, (system.sigma_m, system.sigma_z_m, system.sigma_rad) = rate_hz, (1e-3,) * 3
    while not loop.app.mapper.odometry.started:
        loop.run(0.1)
    system.sigma_m, system.sigma_z_m, system.sigma_rad = noise
    loop.run(seconds - loop.since_begin_s)
    return loop


def is_free_told(loop: ClosedLoop) -> bool:
    return bool((loop.planner.window() == FREE_TOLD).any()) and not loop.planner.stale(loop.now_s)


@pytest.mark.parametrize(
    ("config", "rate_hz"), [(BY_POSES, 5), (BY_POSES, 50), (CART, 20)], ids=["5", "50", "cart"]
)
def test_the_map_is_right_with_poses_of_any_rate(config: Config, rate_hz: float) -> None:
    loop = walked(config, rate_hz, 15.0)
    comparison = compare(loop)
    assert comparison.seen > 250
    assert comparison.right >= 0.99 * comparison.seen, comparison.wrong
    assert all(cell != FREE for _, _, cell in comparison.wrong)
    assert comparison.free_on_obstacle == []
    assert float(np.sqrt(np.mean(comparison.floor_error_m**2))) <= 0.02
    pose, (x_m, y_m, yaw_rad, _, _) = loop.planner.pose, loop.rig.world.pose()
    assert pose is not None
    assert pose.health & 0x7F == 0x7F
    assert pose.mode == 1
    assert np.hypot(pose.x_m - x_m, pose.y_m - y_m) < 0.1
    assert abs(pose.yaw_rad - yaw_rad) < np.radians(1.0)
    counts = loop.app.mapper.counts
    assert (counts.scans_dropped, counts.erased) == (0, 0)


def test_without_any_pose_there_is_no_map_and_it_says_so() -> None:
    loop = ClosedLoop(BY_POSES)
    loop.positioning.mute = True
    loop.run(4.0)
    pose = loop.planner.pose
    assert pose is not None
    assert (pose.mode, pose.health & (health.WHEELS_OK | health.POSE_VALID)) == (0, 0)
    assert not is_free_told(loop)
    assert loop.app.states.describe(loop.now_s).count("nothing commands motors") == 1


BROKEN = {"stop": ("mute", True), "late": ("delay_s", 0.7), "jump": ("jump_m", 0.8)}


@pytest.mark.parametrize("fault", BROKEN)
@pytest.mark.parametrize("rate_hz", few([50, 5], 1))
def test_poses_that_stop_or_jump_or_come_late_are_told_and_no_cell_is_free_wrongly(
    fault: str, rate_hz: float
) -> None:
    loop = walked(BY_POSES, rate_hz, 9.0)
    assert is_free_told(loop)
    setattr(loop.positioning, *BROKEN[fault])
    wrong: set[tuple[float, float]] = set()

    def look() -> None:
        """While the map's frame is that of the world."""
        if loop.app.mapper.counts.erased:
            return
        if loop.ticks % 20 == 0 and is_free_told(loop):
            wrong.update(compare(loop).free_on_obstacle)

    loop.run(1.0 / rate_hz + UNTOLD_S - 0.2, look)
    loop.run(0.1, look)
    pose = loop.planner.pose
    assert pose is not None
    assert pose.health & (health.WHEELS_OK | health.POSE_VALID | health.MAP_VALID) == 0
    assert not is_free_told(loop)
    loop.run(3.0, look)
    if fault == "jump":  # which is believed in the end, for a map that begins anew
        assert loop.app.mapper.counts.erased == 1
    else:
        assert not is_free_told(loop)
        loop.positioning.mute, loop.positioning.delay_s = False, 0.0
        loop.run(3.0)
        assert is_free_told(loop)
    assert wrong == set()


def test_on_a_rail_one_encoder_makes_the_map() -> None:
    config = shipped(motion={"source": "rail"})
    world = KinematicWorld("corridor", Way(stand(2.0), straight(6.0, 0.5), straight(-2.0, 0.5)))
    world.wheels = Wheels(lambda: (world.wheel_angles_rad()[0], 0.0), 1)  # nothing turns the other
    loop = ClosedLoop(config, world)
    loop.run(16.0)
    comparison = compare(loop)
    assert comparison.seen > 250
    assert comparison.right >= 0.99 * comparison.seen, comparison.wrong
    assert comparison.free_on_obstacle == []
    pose = loop.planner.pose
    assert pose is not None
    assert (pose.mode, pose.health & 0x7F) == (1, 0x7F)
    x_m, y_m = loop.rig.world.pose()[:2]
    assert np.hypot(pose.x_m - x_m, pose.y_m - y_m) < 0.05


def test_one_pose_in_ten_that_is_lost_changes_nothing() -> None:
    loop = walked(BY_POSES, 10, 4.0)
    loop.wires["planner"].drop_rate = 0.1
    loop.run(6.0)
    assert is_free_told(loop)
    assert loop.app.mapper.counts.erased == 0
    assert compare(loop).free_on_obstacle == []
