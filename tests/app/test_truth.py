"""The shipped drive in a closed loop: the map that the planner holds against the world's truth."""

import numpy as np
import pytest

from tests.support.cases import few
from tests.support.robot.closed_loop import ClosedLoop, Comparison, compare

EVERY_S = 3.0


Drive = tuple[ClosedLoop, list[Comparison]]


@pytest.fixture(scope="module", params=few([9.0, 45.0], 1))
def drive(request: pytest.FixtureRequest) -> Drive:
    """The begin of the shipped drive, or all, compared with the truth every few seconds."""
    loop = ClosedLoop()
    comparisons = []
    for _ in range(round(request.param / EVERY_S)):
        loop.run(EVERY_S)
        comparisons.append(compare(loop))
    return loop, comparisons


def test_97_percent_are_right_no_box_is_free_and_the_floor_flat_within_15_mm(drive: Drive) -> None:
    loop, comparisons = drive
    seen = [comparison.seen for comparison in comparisons]
    assert max(seen) > 18 * loop.since_begin_s  # beside the ramps
    for comparison in comparisons:
        assert comparison.right >= 0.97 * comparison.seen, comparison.wrong
        assert comparison.free_on_obstacle == []  # a box, the ditch
    errors_m = np.concatenate([comparison.floor_error_m for comparison in comparisons])
    assert errors_m.size > 20 * loop.since_begin_s
    assert float(np.sqrt(np.mean(errors_m**2))) <= 0.015


def test_the_planner_holds_the_apps_map(drive: Drive) -> None:
    loop, _ = drive
    told = loop.planner.window()
    meant = np.array([0, 2, 1], dtype=np.uint8)[loop.map_now()]  # unknown, obstacle (1), free (-1)
    grid = loop.app.mapper.maps.window.grid
    assert loop.planner.origin == (grid.corner_i, grid.corner_j)
    assert int((told != meant).sum()) <= 20  # what this very tick's scan changed
    assert not loop.planner.suspect
    assert not loop.planner.stale(loop.now_s)


def test_nothing_was_lost_or_rejected_and_the_pose_is_right_to_centimetres(drive: Drive) -> None:
    loop, _ = drive
    counts = loop.app.mapper.counts
    assert counts.scans_added > 25 * (loop.since_begin_s - 5)
    assert counts.scans_dropped == 0
    assert counts.erased == 0
    for device in (loop.app.devices.scanner, loop.app.devices.ahrs, loop.app.devices.drive):
        status = device.status
        assert (status.state, status.cause, status.losses, status.rejected) == ("running", "", 0, 0)
    pose = loop.planner.pose
    assert pose is not None
    assert pose.mode == 1
    assert pose.health & 0x7F == 0x7F
    assert sum(loop.planner.rejected.values()) == 0
    x, y, yaw, _, _ = loop.rig.world.pose()
    assert np.hypot(pose.x_m - x, pose.y_m - y) < 0.10
    assert abs(pose.yaw_rad - yaw) < np.radians(0.5)


@pytest.mark.slow
def test_with_six_times_the_attitude_noise_it_errs_to_the_side_of_obstacle() -> None:
    for seed in (1, 2):
        loop = ClosedLoop(seed=seed)
        loop.rig.ahrs.angle_noise_rad = np.radians(0.3)
        loop.run(15.0)
        comparison = compare(loop)
        assert all(cell != -1 for _, _, cell in comparison.wrong)
        # over four seeds all are right; cells half in the ditch: 0.3, 1 at worst
        assert comparison.right >= 0.97 * comparison.seen
        assert len(comparison.free_on_obstacle) <= 3
