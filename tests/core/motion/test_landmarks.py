"""A place that wheels tell, kept by walls that stand."""

import math

import numpy as np
import pytest

from core.pose_fix import PoseFix
from core.records import F64
from tests.support.robot.turning_robot import Errors, Robot

SIGMAS = 0.03, math.radians(1.0)  # of the pose, as a frame's steps are told
ALONG_X = np.diag([0.0, 0.01**-2.0, 0.005**-2.0])  # of a wall: it tells y and yaw
ALONG_Y = np.diag([0.01**-2.0, 0.0, 0.005**-2.0])
LOOK_S = 0.2
AHEAD = np.array([0.4, 0.1])  # of the body: the lens


def fix_of(off: F64, told: F64) -> PoseFix:
    """As a frame's steps tell an error (3,) at the lens: with their own knowledge in it."""
    prior = np.diag(np.repeat([SIGMAS[0] ** -2.0, SIGMAS[1] ** -2.0], [2, 1]))
    covariance = np.linalg.inv(told + prior)
    return PoseFix.of(covariance @ told @ off, np.asarray(covariance), SIGMAS)


def look(robot: Robot, told: F64, random: np.random.Generator, off_m: float = 0.0) -> bool:
    """A frame of a moment ago: the robot has gone on since."""
    odometry, yaw = robot.odometry, robot.yaw_rad + robot.yaw_error_rad
    c, s = math.cos(yaw), math.sin(yaw)
    lever = np.array([[c, -s], [s, c]]) @ AHEAD
    off = odometry.owed - robot.error  # of the told pose: truth less told
    noise = random.standard_normal(3) * [0.01, 0.01, 0.005] + [off_m, off_m, 0.0]
    there = off + noise + np.array([-off[2] * lever[1], off[2] * lever[0], 0.0])
    return odometry.correct_by(fix_of(there, told).of_body(lever, odometry.owed), robot.t_s)


def slipping(t_s: float) -> float:
    return 0.25 if t_s > 4.0 and t_s % 4.0 < 0.5 else 0.0


def test_wheels_slip_and_the_place_stays() -> None:
    """What does not fit at first is believed when it stays."""
    errors = Errors(slip_left_mps=slipping, slip_right_mps=slipping)
    lost = Robot(lambda t: 0.4, lambda t: 0.2, errors).drive(60)
    assert math.hypot(*lost.error[:2]) > 0.2
    off_m = list[float]()
    for seed in range(4):
        random = np.random.default_rng(seed)
        robot = Robot(lambda t: 0.4, lambda t: 0.2, errors, seed=seed).drive(2)
        for k in range(290):
            look(robot, ALONG_X if k % 20 < 10 else ALONG_Y, random)
            robot.drive(LOOK_S)
            off_m.append(math.hypot(*robot.error[:2]))
    assert max(off_m) < 0.15  # a burst is 12.5 cm, and no look fits at first
    assert np.median(off_m) < 0.03


def test_a_wall_that_is_none_of_those_known_moves_nothing() -> None:
    random = np.random.default_rng(1)
    robot = Robot(lambda t: 0.4, lambda t: 0.0).drive(2)
    for _ in range(10):
        look(robot, ALONG_X, random)
        robot.drive(LOOK_S)
    owed, P = robot.odometry.owed, robot.odometry.covariance
    assert not look(robot, ALONG_X, random, off_m=0.15)
    assert np.array_equal(robot.odometry.owed, owed)
    assert 0.0 < np.diag(robot.odometry.covariance - P).max() < 0.025**2


def test_many_looks_in_a_moment_are_hardly_more_than_one() -> None:
    robot = Robot(lambda t: 0.4, lambda t: 0.0).drive(4)
    still = PoseFix(ALONG_X, np.zeros(3))
    assert robot.odometry.correct_by(still, 4.0)
    once = robot.odometry.covariance[1, 1]
    for k in range(10):
        robot.odometry.correct_by(still, 4.0 + 0.001 * k)
    assert robot.odometry.covariance[1, 1] == pytest.approx(once, rel=0.02)


def test_a_turn_at_the_lens_moves_the_body_by_its_lever() -> None:
    at_lens, lever = np.array([-0.002, 0.008, 0.02]), np.array([0.4, 0.1])
    fix = fix_of(at_lens, np.eye(3) * 1e8).of_body(lever, np.zeros(3))
    assert np.linalg.solve(fix.M, fix.y) == pytest.approx([0.0, 0.0, 0.02], abs=1e-9)
    less = fix_of(at_lens, np.eye(3) * 1e8).of_body(lever, np.array([0.01, 0.0, 0.02]))
    assert np.linalg.solve(less.M, less.y) == pytest.approx([-0.01, 0.0, 0.0], abs=1e-9)


@pytest.mark.parametrize("told", [np.zeros((3, 3)), np.diag([1e-5, 0.0, 0.0])])
def test_what_tells_nothing_changes_nothing(told: F64) -> None:
    robot = Robot(lambda t: 0.4, lambda t: 0.0).drive(3)
    before = robot.odometry.covariance
    assert robot.odometry.correct_by(PoseFix(told, np.zeros(3)), 3.0)
    assert np.array_equal(robot.odometry.covariance, before)
