"""Poses of a positioning system: alignment, correction, outliers, jumps, and silent wheels."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from msgspec.structs import replace

from core.geometry import wrapped
from core.motion.external_pose import is_sound
from core.records import ExternalPose
from tests.support.cases import few
from tests.support.robot.turning_robot import Errors, Robot

RAD = math.radians
SIGMA_M, SIGMA_RAD, TURN_RAD = 0.03, RAD(0.5), 0.7
SOUND = ExternalPose(1.0, 2.0, 3.0, 0.1, 0.01, 0.0, 0.01, 1e-4)


@dataclass(slots=True)
class Beacons:
    """A positioning system far away and turned, that sees a robot every so often."""

    yaw: bool = True
    every_s: float = 0.5
    jump_m: Callable[[float], float] = lambda t_s: 0.0

    def __call__(self, robot: Robot) -> ExternalPose | None:
        if robot.k % round(100 * self.every_s):
            return None
        noise = robot.random.standard_normal(3)
        x = robot.x_m + SIGMA_M * float(noise[0]) + self.jump_m(robot.t_s)
        y = robot.y_m + SIGMA_M * float(noise[1])
        c, s = math.cos(TURN_RAD), math.sin(TURN_RAD)
        yaw_rad = wrapped(robot.yaw_rad + TURN_RAD + SIGMA_RAD * float(noise[2]))
        return ExternalPose(
            robot.t_s,
            1000 + c * x - s * y,
            2000 + s * x + c * y,
            yaw_rad if self.yaw else math.nan,
            SIGMA_M**2,
            0.0,
            SIGMA_M**2,
            SIGMA_RAD**2,
        )


def speed(t_s: float) -> float:
    return 0.5 * max(0.0, min(1.0, (t_s - 1.0) / 0.5))


def winding(t_s: float) -> float:
    return 0.3 * math.sin(0.5 * t_s)


def watched(beacons: Beacons, *, scale: float = 0.0) -> Robot:
    return Robot(speed, winding, Errors(scale=scale), external=beacons)


def told_error_m(robot: Robot) -> float:
    x_m, y_m = robot.odometry.xy_at(robot.t_s)
    return math.hypot(float(x_m) - robot.x_m, float(y_m) - robot.y_m)


@pytest.mark.parametrize("yaw", [True, False])
def test_wheels_that_count_five_percent_too_much_are_found_out(yaw: bool) -> None:
    robot = watched(Beacons(yaw=yaw), scale=-0.05).drive(30)
    assert robot.odometry.scale == pytest.approx(0.95, abs=0.004)
    assert told_error_m(robot) < 0.1
    assert (robot.odometry.breaks, robot.odometry.positioning.outliers) == (0, 0)


def test_without_a_positioning_system_they_are_not_and_the_covariance_says_so() -> None:
    robot = Robot(speed, winding, Errors(scale=-0.05)).drive(30)
    assert robot.odometry.scale == 1.0
    assert told_error_m(robot) > 0.5
    assert math.sqrt(np.trace(robot.odometry.covariance[:2, :2])) > 0.5


def test_single_outliers_are_left_out_and_counted() -> None:
    beacons = Beacons(jump_m=lambda t_s: 3.0 if round(2 * t_s) % 7 == 3 else 0.0)
    robot = watched(beacons).drive(14)
    assert robot.odometry.positioning.outliers == 4
    assert robot.odometry.breaks == 0
    assert told_error_m(robot) < 0.1


@pytest.mark.parametrize("every_s", few([0.5, 0.1, 0.02], 2))
def test_a_jump_that_persists_is_believed_and_breaks_the_chain_once(every_s: float) -> None:
    """However often poses come: five in a row at least, and half a second."""
    beacons = Beacons(every_s=every_s, jump_m=lambda t_s: 3.0 if t_s > 5 else 0.0)
    robot = watched(beacons).drive(10)
    assert robot.odometry.breaks == 1
    assert 4 <= robot.odometry.positioning.outliers <= 26
    assert robot.odometry.xy_at(robot.t_s)[0] - robot.x_m == pytest.approx(3.0, abs=0.1)


def test_a_correction_goes_in_no_faster_than_a_map_can_stand() -> None:
    robot = watched(Beacons(), scale=-0.05)
    robot.drive(1)
    steps_m = []
    for _ in range(100):
        before_m, t_s = robot.odometry.xy_at(robot.t_s), robot.t_s
        robot.drive(0.05)
        moved_m = float(np.hypot(*(robot.odometry.xy_at(robot.t_s) - before_m)))
        steps_m.append(moved_m - 1.06 * 0.5 * (robot.t_s - t_s))
    assert max(steps_m) <= 0.1 * 0.05 + 1e-3


def test_while_the_wheels_are_silent_the_positioning_system_tells_the_place() -> None:
    robot = watched(Beacons(every_s=0.2))
    robot.counts_told = lambda t_s: not 6 < t_s < 12
    robot.drive(7)
    for _ in range(5):
        robot.drive(1)
        assert robot.odometry.covers(robot.t_s - 0.1, robot.t_s)
        assert told_error_m(robot) < 0.25
    robot.drive(8)
    assert told_error_m(robot) < 0.1
    assert robot.odometry.breaks == 0
    never = watched(Beacons(every_s=0.2))
    never.counts_told = lambda t_s: False
    assert told_error_m(never.drive(5)) < 0.25


@pytest.mark.parametrize(("seen", "breaks"), [(True, 0), (False, 1)])
def test_counters_that_restart_break_the_chain_unless_the_robot_was_seen_meanwhile(
    seen: bool, breaks: int
) -> None:
    robot = watched(Beacons(every_s=0.2))
    robot.counts_told = lambda t_s: not 6 < t_s < 9
    robot.drive(6)
    robot.external = robot.external if seen else None
    robot.drive(2.5)
    robot.restarts, robot.left, robot.right = 1, 0.0, 0.0
    robot.drive(2)
    assert robot.odometry.breaks == breaks
    if seen:
        assert told_error_m(robot) < 0.25


def test_after_a_break_the_frames_are_found_anew() -> None:
    robot = watched(Beacons()).drive(5)
    assert robot.odometry.positioning.aligned
    robot.odometry._break(robot.t_s + 1e-3, "for a test")
    assert not robot.odometry.positioning.aligned
    robot.drive(5)
    assert robot.odometry.positioning.aligned
    assert robot.odometry.breaks == 1


def test_a_pose_that_cannot_be_true_is_not_taken_and_a_good_one_once() -> None:
    odometry = Robot(speed, winding).odometry
    assert is_sound(replace(SOUND, yaw_rad=math.nan, var_yaw_rad2=math.nan))
    for field, wrong in (
        ("t_s", math.nan),
        ("x_m", math.inf),
        ("y_m", 1e9),
        ("yaw_rad", math.inf),
        ("var_xx_m2", -1.0),
        ("var_yy_m2", 1e7),
        ("var_xy_m2", 0.02),
        ("var_xy_m2", math.nan),
        ("var_yaw_rad2", math.nan),
        ("var_yaw_rad2", 3.2**2),
    ):
        assert not is_sound(replace(SOUND, **{field: wrong})), field
        assert not odometry.add_external(replace(SOUND, **{field: wrong}))
    assert odometry.outliers == 10
    assert odometry.add_external(SOUND)
    assert not odometry.add_external(SOUND)
    assert not odometry.add_external(replace(SOUND, t_s=0.5))
