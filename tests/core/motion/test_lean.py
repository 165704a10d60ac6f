"""A sensor that takes what it feels for the vertical, and a robot that starts, brakes and turns."""

import math

import numpy as np
import pytest

from core.geometry import R_from_rpy, q_from_R
from core.motion.attitude import AttitudeRing
from core.motion.error_state import SHARE
from core.motion.lean import GRAVITY_MPS2, LEAN_RAD, LEAN_S
from core.records import Attitude

PERIOD_S = 0.01
Way = tuple[float, float]  # speed, rate of turn


def to_and_fro(t_s: float) -> Way:
    """At rest for 6 s, then 0.8 m/s within 0.8 s for 6 s."""
    return 0.8 * max(0.0, min(1.0, (t_s % 12.0 - 6.0) / 0.8, (12.0 - t_s % 12.0) / 0.8)), 0.0


def in_curves(t_s: float) -> Way:
    return 0.8, 0.6 * math.sin(0.5 * t_s)


class Drive:
    """A level robot, whose sensor leans by a share of what it feels; how far its tilt is off."""

    def __init__(self, share: float) -> None:
        self.share, self.ring, self.t_s = share, AttitudeRing(0, 0, 0, levels=True), 0.0
        self.lean, self.yaw, self.speed = np.zeros(2), 0.0, np.zeros(2)  # earth's x and y
        self.worst_rad = 0.0

    def go(self, seconds: float, way: object, *, has_wheels: bool = True) -> float:
        """The worst error, rad, of roll and pitch on a way of so many seconds."""
        assert callable(way)
        self.worst_rad = 0.0
        for _ in range(round(seconds / PERIOD_S)):
            self.t_s += PERIOD_S
            v, w = way(self.t_s)
            self.yaw += w * PERIOD_S
            speed = v * np.array([math.cos(self.yaw), math.sin(self.yaw)])
            felt, self.speed = (speed - self.speed) / PERIOD_S / GRAVITY_MPS2, speed
            self.lean += PERIOD_S / LEAN_S * (np.array([felt[1], -felt[0]]) - self.lean)
            if has_wheels:
                self.ring.orientation.note_speed(PERIOD_S, v, self.yaw)
            x, y = (self.share * self.lean).tolist()
            q = q_from_R(R_from_rpy(x, y, 0.0) @ R_from_rpy(0.0, 0.0, self.yaw)).tolist()
            self.ring.add(Attitude(self.t_s, tuple(q), (0.0, 0.0, w)))
            roll, pitch, _ = self.ring.newest_rpy()
            self.worst_rad = max(self.worst_rad, abs(roll), abs(pitch))
        return self.worst_rad

    @property
    def learnt(self) -> float:
        return float(self.ring.orientation.state.value[SHARE])

    @property
    def leant_rad(self) -> list[float]:
        """As the wheels say, about earth's x and y, if it leant wholly."""
        x, y = self.ring.orientation.record["lean"]["rad"][0].tolist()
        return [float(x), float(y)]


@pytest.mark.parametrize("way", [to_and_fro, in_curves])
def test_what_a_sensor_leans_by_the_robots_driving_is_learnt_and_taken_out(way: object) -> None:
    blind, drive = Drive(share=1.0), Drive(share=1.0)
    blind.go(120.0, way, has_wheels=False)
    drive.go(120.0, way)
    assert drive.learnt == pytest.approx(1.0, abs=0.25)
    assert drive.go(24.0, way) < 0.35 * blind.go(24.0, way, has_wheels=False)


@pytest.mark.parametrize("way", [to_and_fro, in_curves])
def test_a_sensor_that_does_not_lean_is_believed(way: object) -> None:
    drive = Drive(share=0.0)
    assert drive.go(60.0, way) < 1e-6
    assert drive.learnt == pytest.approx(0.0, abs=1e-6)


def test_a_wheel_that_spins_moves_the_tilt_by_no_more_than_its_bound() -> None:
    drive = Drive(share=1.0)
    drive.go(120.0, to_and_fro)
    for _ in range(100):
        drive.ring.orientation.note_speed(PERIOD_S, 50.0, 5.0)
    assert max(map(abs, drive.leant_rad)) <= LEAN_RAD


def test_what_wheels_said_fades_where_they_fall_silent() -> None:
    drive = Drive(share=1.0)
    drive.go(7.0, to_and_fro)
    leant = drive.leant_rad[1]
    drive.go(3 * LEAN_S, lambda t_s: (0.8, 0.0), has_wheels=False)
    faded = drive.leant_rad[1]
    assert leant < -0.005
    assert abs(faded) < 0.1 * abs(leant)


def test_a_robot_that_is_under_way_at_the_first_news_has_not_just_set_out() -> None:
    drive = Drive(share=1.0)
    drive.ring.orientation.note_speed(PERIOD_S, 0.8, 0.3)
    assert drive.leant_rad == [0.0, 0.0]
    drive.ring.orientation.note_speed(0.5, 0.0, 0.3)
    assert math.hypot(*drive.leant_rad) > 0.01
