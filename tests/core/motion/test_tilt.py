"""Roll and pitch of the filter: what leans, what is askew, what is noisy, and what is broken."""

import math
import random
from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.geometry import R_from_rpy, q_from_R, q_from_rpy
from core.motion.attitude import AttitudeRing
from core.motion.error_state import CASE, CASE_RAD, TILT, WANDER_RAD, WANDER_S
from core.motion.tilt import ALONE_S, APART_RAD
from core.records import F64, Attitude
from tests.support.cases import examples

PERIOD_S = 0.01
NAN = (math.nan,) * 3
Angles = Callable[[float], tuple[float, float]]  # time to roll, pitch


def rates_of(truth: Angles, t_s: float) -> tuple[float, float, float]:
    """Of a body that does not turn about the vertical: rates about its own axes."""
    roll, _ = truth(t_s)
    after, before = truth(t_s + 1e-4), truth(t_s - 1e-4)
    roll_rate, pitch_rate = ((a - b) / 2e-4 for a, b in zip(after, before, strict=True))
    return roll_rate, pitch_rate * math.cos(roll), -pitch_rate * math.sin(roll)


def sample(
    t_s: float, roll: float, pitch: float, rates: tuple[float, float, float], yaw: float = 0.0
) -> Attitude:
    w, x, y, z = q_from_rpy(roll, pitch, yaw).tolist()
    return Attitude(t_s, (w, x, y, z), rates)


class Sensor:
    """A body whose true angles are known, and the filter that takes what the sensor says."""

    def __init__(self, truth: Angles, bias_radps: tuple[float, float] = (0.0, 0.0)) -> None:
        self.truth, self.bias = truth, bias_radps
        self.ring, self.t_s, self.worst_rad = AttitudeRing(0, 0, 0, levels=True), 0.0, 0.0
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
            if stands and k > 0:
                still = self.t_s - PERIOD_S, self.t_s, 0.0, 1e-3
                self.ring.orientation.note_wheels(*still, moved=False)
            self.ring.add(sample(self.t_s, roll + off[0], pitch + off[1], rates))
            self.told = self.ring.newest_rpy()[:2]
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
def test_what_the_body_does_is_told_at_once_and_a_leaning_sensor_by_two_fifths_only(
    truth: Angles,
) -> None:
    sensor = Sensor(truth)
    sensor.run(20.0)
    assert sensor.worst_rad < math.radians(0.05)
    sensor.run(12.0, braking)
    assert sensor.worst_rad < math.radians(0.52)


@pytest.mark.parametrize("off", [(0.04, -0.02), (-0.03, 0.0)])
def test_where_the_body_stands_for_good_the_sensor_is_right(off: tuple[float, float]) -> None:
    sensor = Sensor(still)
    sensor.run(1.0)
    sensor.run(70.0, lambda t_s: off)
    assert sensor.told == pytest.approx(off, abs=3e-3)


def test_the_gyros_bias_is_learnt_while_the_robot_stands() -> None:
    sensor = Sensor(still, bias_radps=(0.01, -0.02))
    sensor.run(15.0, stands=True)
    sensor.run(30.0)
    assert tuple(sensor.ring.orientation.bias_radps[:2]) == pytest.approx((0.01, -0.02), abs=1e-3)
    assert sensor.worst_rad < math.radians(0.4)


@pytest.mark.parametrize("bias_radps", [(0.01, -0.02), (0.0, 0.03), (-0.006, 0.0)])
def test_a_gyro_of_any_bias_is_found_out_by_a_robot_that_drives_off_at_once(
    bias_radps: tuple[float, float],
) -> None:
    sensor = Sensor(nodding, bias_radps=bias_radps)
    sensor.run(2.0)
    assert sensor.worst_rad < math.radians(0.45)
    sensor.run(8.0)
    assert sensor.worst_rad < math.radians(0.12)


def low_passed(seed: int, seconds: float, sigma_rad: float, lasts_s: float = 0.3) -> F64:
    """Errors (n, 2) of a sensor's angles as its own filter leaves them, a sample each."""
    steps, kept = round(seconds / PERIOD_S), math.exp(-PERIOD_S / lasts_s)
    off_rad = np.random.default_rng(seed).normal(0.0, sigma_rad, (steps, 2))
    off_rad[1:] *= math.sqrt(1.0 - kept * kept)
    for k in range(1, steps):
        off_rad[k] += kept * off_rad[k - 1]
    return off_rad


def next_of(errors: Iterator[tuple[float, float]], _t_s: float) -> tuple[float, float]:
    return next(errors)


def test_a_calibrated_gyro_keeps_what_is_told_calm_from_the_start_on() -> None:
    """While a sensor's angles wander by 0.05 degrees within 0.3 s."""
    moved = []
    for seed in range(8):
        sensor, told = Sensor(still), []
        errors = iter(low_passed(seed, 3.0, math.radians(0.05)).tolist())
        for _ in range(6):
            sensor.run(0.5, partial(next_of, errors))
            told.append(sensor.told)
        moved.append(np.diff(told, axis=0))
    assert math.degrees(math.sqrt(np.mean(np.square(moved)))) < 0.033


def test_a_robot_that_rocks_on_the_spot_teaches_no_bias() -> None:
    sensor = Sensor(nodding)
    sensor.run(30.0, stands=True)
    assert tuple(sensor.ring.orientation.bias_radps[:2]) == pytest.approx((0.0, 0.0), abs=1e-3)
    assert sensor.worst_rad < math.radians(0.1)


def test_noise_of_the_angles_is_no_motion() -> None:
    random = np.random.default_rng(1)
    sensor = Sensor(still)
    sensor.run(20.0, stands=True)
    sensor.run(10.0, lambda t_s: (random.normal(0.0, 0.02), random.normal(0.0, 0.02)))
    assert sensor.worst_rad < math.radians(0.12)


def test_without_a_gyro_and_after_a_gap_the_sensor_is_believed_as_it_is() -> None:
    sensor = Sensor(nodding)
    sensor.run(5.0, braking, has_gyro=False)
    assert sensor.worst_rad == pytest.approx(math.radians(1.3), rel=0.02)
    sensor.run(5.0)
    sensor.t_s += 0.5
    sensor.run(0.01)
    assert sensor.worst_rad == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_a_gyro_that_does_not_turn_with_the_angles_is_not_believed(sense: float) -> None:
    rise_rad = sense * math.radians(6.0)
    sensor = Sensor(lambda t_s: (0.0, rise_rad * min(1.0, max(0.0, t_s - 15.0) / 3.0)))
    sensor.run(21.0, gyro_sees=0.0)
    assert sensor.ring.orientation.doubted == 1
    assert sensor.told[1] == pytest.approx(rise_rad, abs=2e-3)
    assert sensor.worst_rad < 1.5 * APART_RAD
    sensor.run(ALONE_S + 1.0)
    assert sensor.told[1] == pytest.approx(rise_rad, abs=2e-3)


@pytest.mark.parametrize(("noise_radps", "doubted"), [(0.01, 0), (0.03, 0), (0.1, 1), (0.3, 1)])
def test_a_gyro_that_only_makes_noise_is_not_believed(noise_radps: float, doubted: int) -> None:
    ring, chance, worst_rad = AttitudeRing(0, 0, 0, levels=True), random.Random(3), 0.0
    for k in range(900):
        x, y, z = (chance.gauss(0.0, noise_radps) for _ in range(3))
        ring.add(sample(0.01 * k, 0.0, 0.0, (x, y, z)))
        worst_rad = max(worst_rad, *map(abs, ring.newest_rpy()[:2]))
    assert ring.orientation.doubted == doubted
    assert worst_rad < math.radians(1.0 if doubted else 0.7)


def test_one_jolt_is_no_noise() -> None:
    sensor = Sensor(still)
    sensor.run(5.0)
    sensor.ring.add(sample(sensor.t_s + 0.01, 0.0, 0.0, (0.5, -0.5, 0.5)))
    sensor.t_s += 0.01
    sensor.run(2.0)
    assert sensor.ring.orientation.doubted == 0


@settings(max_examples=examples(10), deadline=None)
@given(
    askew=st.tuples(*[st.floats(-0.008, 0.008)] * 2),
    slope=st.tuples(*[st.floats(-0.1, 0.1)] * 2),
    seed=st.integers(0, 1000),
)
def test_by_what_the_sensor_is_askew_is_found_out_as_the_robot_turns(
    askew: tuple[float, float], slope: tuple[float, float], seed: int
) -> None:
    """On whatever plane: what is askew turns with the body, and a slope does not."""
    ring, chance, w_radps = AttitudeRing(0, 0, 0, levels=True), random.Random(seed), 0.5
    R_case, R_earth_plane = R_from_rpy(*askew, 0.0), R_from_rpy(*slope, 0.0)
    for k in range(2500):
        R_earth_body = R_earth_plane @ R_from_rpy(0.0, 0.0, w_radps * 0.01 * max(0, k - 300))
        w, x, y, z = q_from_R(R_earth_body @ R_case).tolist()
        rate = (0.0, 0.0, w_radps if k > 300 else 0.0)
        told = (rate[0], rate[1], rate[2] + chance.gauss(0.0, 0.005))
        ring.add(Attitude(0.01 * k, (w, x, y, z), told))
    case = ring.orientation.state.value[CASE : CASE + 2]
    assert tuple(case) == pytest.approx(askew, abs=math.radians(0.05))
    up = R_from_rpy(*ring.newest_rpy())[2]
    np.testing.assert_allclose(up, R_earth_body[2], atol=math.radians(0.1))


@pytest.mark.slow
def test_the_covariance_of_the_tilt_tells_the_errors_that_there_are() -> None:
    """Squared errors over their variances: about 2 for two numbers, in the mean of many runs."""
    squares = []
    for seed in range(12):
        chance = np.random.default_rng(3000 + seed)
        askew = np.clip(chance.normal(0.0, CASE_RAD, 2), -2 * CASE_RAD, 2 * CASE_RAD)
        bias, wander = chance.normal(0.0, math.radians(0.1), 3), chance.normal(0.0, WANDER_RAD, 2)
        ring, kept = AttitudeRing(0, 0, 0, levels=True), math.exp(-0.01 / WANDER_S)
        for k in range(3000):
            w_radps = 0.6 * math.sin(0.004 * k)
            yaw_rad = 1.5 * (1.0 - math.cos(0.004 * k))
            fresh = WANDER_RAD * math.sqrt(1 - kept * kept)
            wander = kept * wander + fresh * chance.standard_normal(2)
            R = R_from_rpy(wander[0], wander[1], 0.0) @ R_from_rpy(0.0, 0.0, yaw_rad)
            R = R @ R_from_rpy(askew[0], askew[1], 0.0)
            rates = np.array([0.0, 0.0, w_radps]) + bias + chance.normal(0.0, math.radians(0.4), 3)
            w, x, y, z = q_from_R(R).tolist()
            ring.add(Attitude(0.01 * k, (w, x, y, z), tuple(rates.tolist())))
            if k % 500 == 499:
                roll, pitch, yaw = ring.newest_rpy()
                c, s = math.cos(yaw), math.sin(yaw)
                error = np.array([-c * roll + s * pitch, -s * roll - c * pitch])
                P = ring.orientation.state.P[TILT : TILT + 2, TILT : TILT + 2]
                squares.append(error @ np.linalg.solve(P, error))
    assert 0.8 < np.mean(squares) < 4.0
    assert max(squares) < 30.0
