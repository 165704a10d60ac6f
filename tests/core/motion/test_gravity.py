"""The attitude against gravity: no motion and no error of the sheet is doubted, a wrong tilt is."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from core.geometry import R_from_rpy, q_from_R
from core.motion.attitude import AttitudeRing
from core.motion.gravity import (
    BLOCK_S,
    LONGEST_S,
    MOST_MPS2,
    SHEET_RAD,
    SPAN_S,
    SWAY_MPS,
    GravityCheck,
)
from core.motion.lean import GRAVITY_MPS2
from core.motion.odometry import Odometry
from core.motion.pose_track import PoseTrack
from core.records import F64, Attitude, ExternalPose, WheelCounts
from tests.support.cases import examples

PERIOD_S = 0.01
FASTEST_MPS = 1.0
MOST_MPS = 2.0 * FASTEST_MPS + SWAY_MPS
UPRIGHT_MPS2 = np.array([0.0, 0.0, GRAVITY_MPS2])  # felt at rest, earth's axes
Of = Callable[[float], float]


def tilt(rad: float, towards_rad: float) -> F64:
    """(3, 3): a turn about a level axis."""
    c, s = math.cos(towards_rad), math.sin(towards_rad)
    yaw = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(yaw @ R_from_rpy(rad, 0.0, 0.0) @ yaw.T)


def zero(t_s: float) -> float:
    return 0.0


@dataclass(slots=True)
class Robot:
    """Goes with a speed and a rate of turn along a plane; its sensor tells and feels."""

    v: Of = zero
    w: Of = zero
    slope: F64 = field(default_factory=lambda: np.eye(3))
    mount: tuple[float, float, float] = (0.0, 0.0, 0.0)
    bias: F64 = field(default_factory=lambda: np.zeros(3))  # of the force, sensor axes
    t_s: float = 0.0
    yaw_rad: float = 0.0
    check: GravityCheck = field(init=False)
    ring: AttitudeRing = field(init=False)
    worst: float = 0.0

    def __post_init__(self) -> None:
        self.ring, self.check = AttitudeRing(*self.mount), GravityCheck(FASTEST_MPS, self.mount)

    def velocity(self, t_s: float, yaw_rad: float) -> F64:
        return np.asarray(self.slope @ (math.cos(yaw_rad), math.sin(yaw_rad), 0.0)) * self.v(t_s)

    def run(self, seconds: float, wrong: F64 | None = None) -> float:
        """By samples, in which the told tilt is wrong; after how long it was doubted, inf: never.

        wrong: (3, 3) turns the told orientation about the earth's axes.
        """
        found_s, R_body_sensor = math.inf, R_from_rpy(*self.mount)
        for k in range(round(seconds / PERIOD_S)):
            w, before = self.w(self.t_s), self.velocity(self.t_s, self.yaw_rad)
            self.t_s, self.yaw_rad = self.t_s + PERIOD_S, self.yaw_rad + w * PERIOD_S
            R = self.slope @ R_from_rpy(0.0, 0.0, self.yaw_rad)
            a = (self.velocity(self.t_s, self.yaw_rad) - before) / PERIOD_S
            felt = R_body_sensor.T @ R.T @ (a + UPRIGHT_MPS2) + self.bias
            told = (R if wrong is None else wrong @ R) @ R_body_sensor
            rate = R_body_sensor.T @ (0.0, 0.0, w)
            sample = Attitude(self.t_s, tuple(q_from_R(told).tolist()), tuple(rate.tolist()))
            assert self.ring.add(sample)
            self.check.take(self.t_s, tuple(felt.tolist()), self.ring)
            self.worst = max(self.worst, self.check.ratio)
            if self.check.doubted and found_s == math.inf:
                found_s = (k + 1) * PERIOD_S
        return found_s


KNOTS = st.lists(st.floats(-1.0, 1.0), min_size=24, max_size=24)
TOWARDS = st.floats(-math.pi, math.pi)
MOUNTS = st.tuples(st.floats(-3.1, 3.1), st.floats(-1.5, 1.5), st.floats(-3.1, 3.1))
SLOPES = st.builds(tilt, st.floats(0.0, math.radians(12.0)), TOWARDS)


def through(knots: list[float], most: float, each_s: float) -> Of:
    """Lines between values of -most..most, so far apart."""
    return lambda t_s: float(most * np.interp(t_s / each_s, np.arange(len(knots)), knots))


@settings(max_examples=examples(8), deadline=None)
@given(
    speeds=KNOTS, turns=KNOTS, slope=SLOPES, mount=MOUNTS, towards=TOWARDS, share=st.floats(0, 1)
)
@example([1.0] * 12 + [-1.0] * 12, [0.0] * 24, np.eye(3), (0.0, 0.0, 0.0), math.pi / 2, 1.0)
def test_whatever_a_robot_does_within_its_limits_is_not_doubted(
    speeds: list[float],
    turns: list[float],
    slope: F64,
    mount: tuple[float, float, float],
    towards: float,
    share: float,
) -> None:
    """Also full reversals at 4 m/s2, as wrong as the sheet allows, of tilt and force together."""
    robot = Robot(through(speeds, 1.0, 0.5), through(turns, 1.0, 0.5), slope, mount)
    robot.bias = GRAVITY_MPS2 * (1.0 - share) * SHEET_RAD * np.array([math.cos(towards), 0.0, 0.0])
    assert robot.run(12.5, tilt(share * SHEET_RAD, towards)) == math.inf
    assert robot.worst < 1.0


def alone_s(wrong_rad: float, opposed: int) -> float:
    """How long a wrong tilt needs, the sheet's errors and motion against it so many times."""
    left = math.sin(wrong_rad) - opposed * SHEET_RAD
    return opposed * MOST_MPS / (GRAVITY_MPS2 * left)


LEAST_RAD = math.radians(3.0)  # that is found at all, of an even drive
SURE_RAD = math.radians(6.0)  # whatever the robot does


@settings(max_examples=examples(6), deadline=None)
@given(
    wrong=st.floats(LEAST_RAD, 1.2), towards=TOWARDS, slope=SLOPES, mount=MOUNTS, v=st.floats(-1, 1)
)
@example(wrong=LEAST_RAD, towards=0.0, slope=np.eye(3), mount=(0.0, 0.0, 0.0), v=0.0)
@example(wrong=math.radians(5.0), towards=1.0, slope=np.eye(3), mount=(0.0, 0.1, 3.0), v=1.0)
def test_a_wrong_tilt_of_an_even_drive_is_doubted_in_time(
    wrong: float, towards: float, slope: F64, mount: tuple[float, float, float], v: float
) -> None:
    robot = Robot(lambda t_s: v, slope=slope, mount=mount)
    assert robot.run(1.0) == math.inf
    within_s = alone_s(wrong, 1) + 2 * BLOCK_S
    assert robot.run(within_s, tilt(wrong, towards)) <= within_s
    assert alone_s(LEAST_RAD, 1) < SPAN_S


@settings(max_examples=examples(6), deadline=None)
@given(speeds=KNOTS, turns=KNOTS, wrong=st.floats(SURE_RAD, 1.2), towards=TOWARDS)
def test_a_greater_one_is_doubted_whatever_the_robot_does(
    speeds: list[float], turns: list[float], wrong: float, towards: float
) -> None:
    robot = Robot(through(speeds, 1.0, 0.5), through(turns, 1.0, 0.5))
    robot.bias = GRAVITY_MPS2 * SHEET_RAD * np.array([1.0, 0.0, 0.0])
    within_s = alone_s(wrong, 2) + 2 * BLOCK_S
    assert within_s <= SPAN_S + 2 * BLOCK_S
    assert robot.run(within_s, tilt(wrong, towards)) <= within_s


def test_it_is_believed_again_when_both_have_agreed_for_long_enough() -> None:
    robot, wrong = Robot(lambda t_s: 0.5), tilt(math.radians(6.0), 0.4)
    robot.run(9.0, wrong)
    assert (robot.check.doubted, robot.check.times, robot.check.changes) == (True, 1, 1)
    robot.run(SPAN_S - 3.0 - BLOCK_S)  # a third one may have begun before it ended
    assert robot.check.doubted
    robot.run(3.0 + 2 * BLOCK_S)
    assert (robot.check.doubted, robot.check.times, robot.check.changes) == (False, 1, 2)


NONE = (math.nan, math.inf, -math.inf, 1e300, 2 * MOST_MPS2)


@pytest.mark.parametrize("wrong", NONE)
def test_what_no_device_feels_is_as_if_it_had_not_been_delivered(wrong: float) -> None:
    robot = Robot()
    robot.run(2.0)
    for axis in range(3):
        felt = [0.0, 0.0, GRAVITY_MPS2]
        felt[axis] = wrong
        robot.check.take(robot.t_s, (felt[0], felt[1], felt[2]), robot.ring)
    robot.run(SPAN_S)
    assert not robot.check.doubted
    assert robot.worst < 0.01


def test_over_a_gap_nothing_is_added_up_and_a_doubt_stays() -> None:
    robot, wrong = Robot(), tilt(math.radians(6.0), 0.4)
    for _ in range(4):
        assert robot.run(2.5, wrong) == math.inf
        robot.t_s += 2 * LONGEST_S
    robot.run(4.0, wrong)
    assert robot.check.doubted
    for _ in range(4):
        robot.run(SPAN_S - 2.0)
        robot.t_s += 2 * LONGEST_S
    assert robot.check.doubted


def test_both_tracks_go_on_from_the_same_place_as_an_island_of_its_own() -> None:
    for track in (Odometry(AttitudeRing(0, 0, 0), 0.15, 500, 1.0, 0.5), None):
        ring = AttitudeRing(0, 0, 0) if track is None else track._attitudes
        one = track or PoseTrack(ring)
        one.break_off("there is nothing yet")
        assert one.breaks == 0
        for k in range(60):
            t_s = 0.02 * k
            ring.add(Attitude(t_s, (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
            one.add(WheelCounts(t_s, 10.0 * k, 10.0 * k, 0))
            one.add_external(ExternalPose(t_s, 0.005 * k, 0.0, 0.0, 1e-4, 0.0, 1e-4, 1e-4))
            one.settle()
        newest_s, place_m = one.newest_s, one.place_at(one.newest_s)
        assert one.covers(newest_s - 0.2, newest_s)
        one.break_off("it leans")
        assert (one.breaks, one.broken_by, one.newest_s) == (1, "it leans", newest_s)
        assert one.place_at(newest_s) == pytest.approx(place_m)
        assert one.covers(newest_s, newest_s)
        assert not one.covers(newest_s - 0.2, newest_s)
