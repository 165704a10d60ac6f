"""The driver on the shipped route, and the rig."""

import math
import re
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fakes.world import robot
from fakes.world.driver import PERIOD_S, TURN_RADPS, Driver
from fakes.world.rig import Rig
from fakes.world.world import World

F64 = npt.NDArray[np.float64]


class Lap(NamedTuple):
    """One lap of the shipped route."""

    world: World
    poses: F64  # (n, 5) every 10 ms
    reached_at: list[tuple[float, float]]


@pytest.fixture(scope="module")
def lap() -> Lap:
    world = World("corridor", 3)

    def command(one: int, two: int) -> None:
        world.wheels.set_power(one / 127, two / 127)

    scene = world.scene
    driver = Driver(world.pose, command, scene.waypoints, scene.speed_mps, 3.0)
    poses, reached_at, now_s = [], [], 0.0
    while driver.laps < 1 and now_s < 90.0:
        now_s += 0.01
        world.step_to(now_s)
        before = driver.reached
        driver.step(now_s)
        poses.append(world.pose())
        if driver.reached > before:
            reached_at.append(world.pose()[:2])
    return Lap(world, np.array(poses), reached_at)


def test_the_robot_stays_clear_of_all_that_is_higher_or_lower_than_the_cable_cover(
    lap: Lap,
) -> None:
    ahead = np.linspace(-robot.HALF_WIDTH_M, robot.HALF_LENGTH_M, 9) * 1.2
    aside = np.linspace(-robot.HALF_WIDTH_M, robot.HALF_WIDTH_M, 7) * 1.2
    u, v = (part.ravel() for part in np.meshgrid(ahead, aside))
    x, y, yaw = (lap.poses[::20, k, None] for k in range(3))
    ground = lap.world.height_at(
        (x + u * np.cos(yaw) - v * np.sin(yaw)).ravel(),
        (y + u * np.sin(yaw) + v * np.cos(yaw)).ravel(),
    )
    assert np.abs(ground).max() <= 0.006


def test_the_driver_reaches_each_waypoint_at_its_speeds_and_the_drive_nods_the_body(
    lap: Lap,
) -> None:
    np.testing.assert_allclose(lap.reached_at, lap.world.scene.waypoints, atol=0.11)
    velocity = np.diff(lap.poses[:, :2], axis=0) / 0.01
    turning = np.diff(np.unwrap(lap.poses[:, 2])) / 0.01
    assert np.hypot(*velocity.T).max() < 1.1 * lap.world.scene.speed_mps
    assert np.abs(np.convolve(turning, np.full(10, 0.1), "valid")).max() < 1.1 * TURN_RADPS
    pitch_deg = np.degrees(lap.poses[:, 3])
    assert -3.0 < pitch_deg.min() < -0.5
    assert 0.5 < pitch_deg.max() < 3.0
    assert np.degrees(np.abs(lap.poses[:250, 3:])).max() < 0.05  # standing, before the start


def test_the_driver_waits_and_then_commands_twenty_times_a_second() -> None:
    given_at: list[float] = []
    now_s = 100.0
    driver = Driver(
        lambda: (0.0, 0.0, 0.0, 0.0, 0.0), lambda one, two: given_at.append(now_s), [(5, 0)], 0.5, 2
    )
    for k in range(1001):
        now_s = 100.0 + k * 0.004
        driver.step(now_s)
    assert given_at[0] == pytest.approx(102.0, abs=0.005)
    assert len(given_at) == pytest.approx(2.0 / PERIOD_S, abs=1)


@given(goal=st.tuples(st.floats(-3, 3), st.floats(-3, 3)), yaw=st.floats(-math.pi, math.pi))
def test_from_anywhere_the_driver_finds_its_waypoint(goal: tuple[float, float], yaw: float) -> None:
    """On wheels that do at once what they are told."""
    pose = [0.0, 0.0, yaw]
    power = [0, 0]

    def command(one: int, two: int) -> None:
        power[:] = one, two

    driver = Driver(lambda: (pose[0], pose[1], pose[2], 0.0, 0.0), command, [goal], 0.6, 0.0)
    for k in range(2000):
        driver.step(k * 0.02)
        if driver.reached:
            break
        left, right = (p / 127 for p in power)
        pose[0] += (left + right) / 2 * math.cos(pose[2]) * 0.02
        pose[1] += (left + right) / 2 * math.sin(pose[2]) * 0.02
        pose[2] += (right - left) / 0.5 * 0.02
    assert driver.reached == 1
    assert math.dist(pose[:2], goal) < 0.15


def test_the_rig_drives_through_its_motor_controller() -> None:
    rig, answers = Rig("corridor", 5, start_delay_s=0.5), b""
    for k in range(800):
        now_s = 20.0 + k * 0.005
        rig.step(now_s)
        answers += rig.drive.exchange(now_s, b"?Q0\r" if k % 20 == 0 else b"")
    x_m = rig.world.pose()[0]
    assert x_m > 1.0
    last = int(re.findall(rb"\?Q0\r([0-9A-F]+)\r", answers)[-1], 16)
    assert abs(last / 2000 * math.tau * robot.WHEEL_RADIUS_M - x_m) < 0.15


def test_the_driver_goes_no_faster_than_its_robot() -> None:
    fastest = {}
    for most_mps in (0.3, math.inf):
        rig, places = Rig("corridor", 5, start_delay_s=0.5, most_mps=most_mps), []
        for k in range(800):
            rig.step(20.0 + k * 0.005)
            places.append(rig.world.pose()[:2])
        fastest[most_mps] = max(map(math.dist, places[:-20], places[20:])) / 0.1
    assert 0.2 < fastest[0.3] < 0.35
    assert fastest[math.inf] > 0.5


def test_without_a_driver_the_wheels_obey_the_wire_alone() -> None:
    rig = Rig("corridor", 5, start_delay_s=0.0, drives=False)
    for k in range(400):
        now_s = 20.0 + k * 0.005
        rig.step(now_s)
        rig.drive.exchange(now_s, b"!A40\r!B40\r" if k == 200 else b"")
        if k == 200:
            assert abs(rig.world.pose()[0]) < 0.001
    assert rig.world.pose()[0] > 0.1
    rig.drive.command(-127, -127)  # the radio counts for nothing
    assert rig.drive.exchange(now_s + 0.1, b"?V\r") == b""
    assert b"40\r40\r" in rig.drive.exchange(now_s + 0.2, b"")
