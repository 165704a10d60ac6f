"""What walls say of a pose, over frames."""

import numpy as np
import pytest

from core.objects.frame.wall_lines import Correction
from core.records import F64
from tools.rig.cleaning.wall_fix import SIGMAS, WallFix

LENS = np.array([0.3, -0.1])  # from the machine
WALL = np.diag([0.0, 0.01**-2.0, 0.003**-2.0])  # information of one that tells y and yaw


def told(off: F64, information: F64 = WALL) -> Correction:
    """As a frame's steps tell an error of the machine's pose, with their own knowledge in it."""
    at_lens = off + np.array([-off[2] * LENS[1], off[2] * LENS[0], 0.0])
    whole = np.asarray(np.linalg.inv(information + np.diag(SIGMAS**-2.0)), np.float64)
    x, y, yaw = (whole @ information @ at_lens).tolist()
    return Correction(x, y, yaw, whole, 500)


def test_frames_that_agree_tell_the_error_and_what_no_wall_tells_stays() -> None:
    fix, off = WallFix(), np.array([0.0, 0.02, 0.004])
    for _ in range(40):
        fix.step(0.25)
        assert fix.measure(told(off), LENS)
    assert fix.off == pytest.approx(off, abs=0.003)
    assert abs(fix.off[0]) < 0.001


def test_one_frame_that_says_something_else_moves_nothing_but_if_it_stays_it_is_believed() -> None:
    fix, other = WallFix(), np.array([0.0, 0.054, 0.005])
    for _ in range(20):
        fix.step(0.25)
        assert fix.measure(told(np.zeros(3)), LENS)
    before = fix.off
    assert not fix.measure(told(other), LENS)
    assert np.array_equal(fix.off, before)
    believed = []
    for _ in range(120):  # half a minute: the pose may have wandered so far meanwhile
        fix.step(0.25)
        believed.append(fix.measure(told(other), LENS))
    assert believed[-1]
    assert fix.off[1] > 0.04


def test_what_walls_said_ends_as_the_pose_wanders() -> None:
    fix = WallFix()
    fix.step(10.0)
    fix.measure(told(0.8 * SIGMAS, np.eye(3) * 1e8), LENS)
    assert fix.off == pytest.approx(0.8 * SIGMAS, abs=1e-4)
    fix.step(60.0)
    assert np.abs(fix.off).max() < 1e-4
