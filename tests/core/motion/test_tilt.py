"""Roll and pitch by gyro and angles: what leans, what is noisy, and what is broken."""

import math
import random
from collections.abc import Callable

import numpy as np
import pytest

from core.motion.tilt import ALONE_S, APART_RAD, TiltFilter, tilt_step

PERIOD_S = 0.01
NAN = (math.nan,) * 3
Angles = Callable[[float], tuple[float, float]]  # time to roll, pitch


def rates_of(truth: Angles, t_s: float) -> tuple[float, float, float]:
    """Of a body that does not turn about the vertical: rates about its own axes."""
    roll, _ = truth(t_s)
    after, before = truth(t_s + 1e-4), truth(t_s - 1e-4)
    roll_rate, pitch_rate = ((a - b) / 2e-4 for a, b in zip(after, before, strict=True))
    return roll_rate, pitch_rate * math.cos(roll), -pitch_rate * math.sin(roll)


class Sensor:
    """A body whose true angles are known, and the filter that takes what the sensor says."""

    def __init__(self, truth: Angles, bias_radps: tuple[float, float] = (0.0, 0.0)) -> None:
        self.truth, self.bias = truth, bias_radps
        self.tilt, self.t_s, self.worst_rad = TiltFilter(), 0.0, 0.0
        self.told = 0.0, 0.0

    def run(
        self,
        seconds: float,
        wrong: Angles = lambda t_s: (0.0, 0.0),
        *,
        stands: bool = False,
        has_gyro: bool = True,
        gyro_sees: float = 1.0,
    ) -> None:
        """Samples, of which the angles are wrong by so much at a time since this began."""
        self.worst_rad = 0.0
        for k in range(round(seconds / PERIOD_S)):
            self.t_s += PERIOD_S
            roll, pitch = self.truth(self.t_s)
            off = wrong(k * PERIOD_S)
            x, y, z = (gyro_sees * rate for rate in rates_of(self.truth, self.t_s))
            rates = (x + self.bias[0], y + self.bias[1], z) if has_gyro else NAN
            angles_rad = roll + off[0], pitch + off[1]
            self.told = tilt_step(self.tilt.record[0], self.t_s, angles_rad, rates, stands)
            off_rad = abs(self.told[0] - roll), abs(self.told[1] - pitch)
            self.worst_rad = max(self.worst_rad, *off_rad)


def still(t_s: float) -> tuple[float, float]:
    return 0.0, 0.0


def nodding(t_s: float) -> tuple[float, float]:
    """Two degrees, once a second, and half as much roll."""
    return math.radians(1.0) * math.sin(5.0 * t_s), math.radians(2.0) * math.sin(6.3 * t_s)


def braking(t_s: float) -> tuple[float, float]:
    """1.3 degrees within a second, and back to none within some."""
    return 0.0, math.radians(1.3) * min(1.0, t_s) * math.exp(-max(0.0, t_s - 1.0) / 4.0)


@pytest.mark.parametrize("truth", [still, nodding])
def test_what_the_body_does_is_told_at_once_and_a_leaning_sensor_by_a_third_only(
    truth: Angles,
) -> None:
    sensor = Sensor(truth)
    sensor.run(20.0)
    assert sensor.worst_rad < math.radians(0.05)
    sensor.run(12.0, braking)
    assert sensor.worst_rad < math.radians(0.45)


@pytest.mark.parametrize("off", [(0.04, -0.02), (-0.03, 0.0)])
def test_where_the_body_stands_for_good_the_sensor_is_right(off: tuple[float, float]) -> None:
    sensor = Sensor(still)
    sensor.run(1.0)
    sensor.run(70.0, lambda t_s: off)
    assert sensor.told == pytest.approx(off, abs=5e-4)


def test_the_gyros_bias_is_learnt_while_the_robot_stands() -> None:
    sensor = Sensor(still, bias_radps=(0.01, -0.02))
    sensor.run(15.0, stands=True)
    sensor.run(30.0)
    assert sensor.tilt.bias_radps == pytest.approx((0.01, -0.02), abs=1e-3)
    assert sensor.worst_rad < math.radians(0.4)


def test_a_robot_that_rocks_on_the_spot_teaches_no_bias() -> None:
    sensor = Sensor(nodding)
    sensor.run(30.0, stands=True)
    assert sensor.tilt.bias_radps == pytest.approx((0.0, 0.0), abs=1e-3)
    assert sensor.worst_rad < math.radians(0.1)


def test_noise_of_the_angles_is_no_motion() -> None:
    random = np.random.default_rng(1)
    sensor = Sensor(still)
    sensor.run(20.0)
    sensor.run(10.0, lambda t_s: (random.normal(0.0, 0.02), random.normal(0.0, 0.02)))
    assert sensor.worst_rad < math.radians(0.1)


def test_without_a_gyro_and_after_a_gap_the_sensor_is_believed_as_it_is() -> None:
    sensor = Sensor(nodding)
    sensor.run(5.0, braking, has_gyro=False)
    assert sensor.worst_rad == pytest.approx(math.radians(1.3), rel=0.02)
    sensor.run(5.0)
    sensor.t_s += 0.5
    sensor.run(0.01)
    assert sensor.worst_rad == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_a_gyro_that_does_not_turn_with_the_angles_is_not_believed(sense: float) -> None:
    rise_rad = sense * math.radians(6.0)
    sensor = Sensor(lambda t_s: (0.0, rise_rad * min(1.0, max(0.0, t_s - 15.0) / 3.0)))
    sensor.run(21.0, gyro_sees=0.0)
    assert sensor.tilt.doubted == 1
    assert sensor.told[1] == pytest.approx(rise_rad, abs=2e-3)
    assert sensor.worst_rad < 1.5 * APART_RAD
    sensor.run(ALONE_S + 1.0)
    assert sensor.told[1] == pytest.approx(rise_rad, abs=2e-3)


@pytest.mark.parametrize(("noise_radps", "doubted"), [(0.01, 0), (0.03, 0), (0.1, 1), (0.3, 1)])
def test_a_gyro_that_only_makes_noise_is_not_believed(noise_radps: float, doubted: int) -> None:
    tilt, chance, worst_rad = TiltFilter(), random.Random(3), 0.0
    for k in range(900):
        x, y, z = (chance.gauss(0.0, noise_radps) for _ in range(3))
        told = tilt_step(tilt.record[0], 0.01 * k, (0.0, 0.0), (x, y, z), False)
        worst_rad = max(worst_rad, *map(abs, told))
    assert tilt.doubted == doubted
    assert worst_rad < math.radians(1.0 if doubted else 0.7)
