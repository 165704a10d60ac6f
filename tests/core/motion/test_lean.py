"""A sensor that takes what it feels for the vertical, and a robot that starts, brakes and turns."""

import math

import pytest

from core.motion.lean import GRAVITY_MPS2, LEAN_S, MOST_RAD
from core.motion.tilt import TiltFilter, tilt_step

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
        self.share, self.tilt, self.t_s = share, TiltFilter(), 0.0
        self.felt, self.speed, self.worst_rad = [0.0, 0.0], 0.0, 0.0

    def go(self, seconds: float, way: object, *, has_wheels: bool = True) -> float:
        """The worst error, rad, of roll and pitch on a way of so many seconds."""
        assert callable(way)
        self.worst_rad = 0.0
        for _ in range(round(seconds / PERIOD_S)):
            self.t_s += PERIOD_S
            v, w = way(self.t_s)
            accel, self.speed = (v - self.speed) / PERIOD_S, v
            for k, feels in enumerate((v * w, -accel)):
                self.felt[k] += PERIOD_S / LEAN_S * (feels / GRAVITY_MPS2 - self.felt[k])
            if has_wheels:
                self.tilt.note_wheels(PERIOD_S, v, w)
            angles = self.share * self.felt[0], self.share * self.felt[1]
            told = tilt_step(self.tilt.record[0], self.t_s, angles, (0.0, 0.0, w), False)
            self.worst_rad = max(self.worst_rad, abs(told[0]), abs(told[1]))
        return self.worst_rad

    @property
    def learnt(self) -> float:
        return float(self.tilt.record["lean"]["share"][0])


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
        drive.tilt.note_wheels(PERIOD_S, 50.0, 5.0)
    lean = drive.tilt.record["lean"][0]
    assert max(abs(lean["pitch_rad"]), abs(lean["roll_rad"])) <= MOST_RAD


def test_what_wheels_said_fades_where_they_fall_silent() -> None:
    drive = Drive(share=1.0)
    drive.go(7.0, to_and_fro)
    leant = drive.tilt.record["lean"]["pitch_rad"][0]
    drive.go(3 * LEAN_S, lambda t_s: (0.8, 0.0), has_wheels=False)
    faded = drive.tilt.record["lean"]["pitch_rad"][0]
    assert leant < -0.005
    assert abs(faded) < 0.1 * abs(leant)
