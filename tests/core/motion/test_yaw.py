"""Yaw of the filter: a steel door, standing, turning by hand, and what it does without inputs."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.geometry import R_from_rpy, q_from_rpy, wrapped
from core.motion.attitude import AttitudeRing
from core.records import Attitude
from tests.support.cases import examples, few
from tests.support.robot.turning_robot import Errors, Robot

RAD = math.radians
STOOD_S, DROVE_S = 4.0, 5.0  # as a run of a campaign stands at first
DOOR_S = STOOD_S + DROVE_S
NO_RATE, STILL = (math.nan,) * 3, (0.0, 0.0, 0.0)


def nothing(t_s: float) -> float:
    return 0.0


def speed(t_s: float, stood_s: float = STOOD_S) -> float:
    """From standing to 0.4 m/s within half a second."""
    return 0.4 * max(0.0, min(1.0, (t_s - stood_s) / 0.5))


def slalom(t_s: float, stood_s: float = STOOD_S) -> float:
    return 0.5 * math.sin(1.3 * (t_s - stood_s)) if t_s > stood_s else 0.0


def jump(t_s: float) -> float:
    """40 deg at once, for six seconds."""
    return RAD(40) if DOOR_S <= t_s < DOOR_S + 6 else 0.0


def slow_pull(t_s: float) -> float:
    """40 deg within four seconds, and back."""
    return RAD(40) * max(0.0, min(1.0, (t_s - DOOR_S) / 4, (DOOR_S + 10 - t_s) / 4))


def lasting_pull(t_s: float) -> float:
    return RAD(40) * max(0.0, min(1.0, (t_s - DOOR_S) / 4))


def beside_a_door(
    pull: Callable[[float], float], seed: int, stood_s: float = STOOD_S, magnetic: bool = True
) -> Robot:
    """A slalom past steel, with a noisy, biased gyro."""
    errors = Errors(
        gyro_bias=RAD(0.2),
        pull=pull,
        bend=lambda t_s: 0.5 * pull(t_s) / RAD(40),
        magnetic=magnetic,
    )
    return Robot(lambda t: speed(t, stood_s), lambda t: slalom(t, stood_s), errors, seed=seed)


@pytest.mark.parametrize("seed", few(range(3), 1))
@pytest.mark.parametrize(
    ("pull", "stood_s", "magnetic"),
    few(
        [
            *[(jump, STOOD_S, True), (jump, STOOD_S, False), (slow_pull, 0.0, False)],
            *[(slow_pull, STOOD_S, True), (slow_pull, STOOD_S, False)],
        ],
        3,
    ),
)
def test_beside_a_steel_door_the_heading_stays_within_one_degree(
    pull: Callable[[float], float], stood_s: float, magnetic: bool, seed: int
) -> None:
    robot = beside_a_door(pull, seed, stood_s, magnetic).drive(DOOR_S + 10)
    heading = robot.ring.orientation
    assert robot.worst_yaw_rad < RAD(1.0)
    assert heading.disturbed == 1
    assert not heading.trusted  # the sensor takes seconds to find back
    robot.drive(6)
    assert heading.trusted
    assert robot.worst_yaw_rad < RAD(1.0)


def test_a_heading_that_stays_away_is_taken_anew_and_the_first_one_when_it_is_back() -> None:
    robot = beside_a_door(lasting_pull, seed=4).drive(DOOR_S + 40)
    heading = robot.ring.orientation
    assert (heading.trusted, heading.adopted) == (True, 1)
    away_rad = robot.yaw_error_rad
    assert abs(away_rad) < RAD(3.0)  # what the gyro lost meanwhile
    robot.errors.pull = robot.errors.bend = nothing
    robot.drive(8)
    assert heading.disturbed == 2
    assert abs(robot.yaw_error_rad - away_rad) < RAD(1.0)


def test_standing_beside_steel_teaches_nothing() -> None:
    errors = Errors(pull=lambda t: RAD(40) if t > 3 else 0.0, magnetic=False)
    robot = Robot(nothing, nothing, errors).drive(40)
    assert robot.ring.orientation.adopted == 0
    assert abs(robot.yaw_error_rad) < RAD(0.2)


def test_where_the_gyro_is_not_delivered_the_wheels_pass_the_door() -> None:
    errors = Errors(pull=slow_pull, bend=lambda t: 0.5 * slow_pull(t) / RAD(40), rates=False)
    robot = Robot(speed, slalom, errors).drive(DOOR_S + 10)
    assert robot.worst_yaw_rad < RAD(12.0)  # the field shows it late: not what a gyro does
    assert robot.ring.orientation.disturbed >= 1


def test_while_standing_the_yaw_stands_and_the_gyro_tells_its_bias() -> None:
    errors = Errors(gyro_bias=RAD(0.3), wander=RAD(1.5))
    robot = Robot(nothing, nothing, errors).drive(3)
    before_rad = robot.ring.newest_rpy()[2]
    robot.drive(15)
    assert robot.ring.orientation.standing
    assert abs(robot.ring.newest_rpy()[2] - before_rad) < RAD(0.02)
    assert robot.ring.orientation.bias_radps[2] == pytest.approx(RAD(0.3), abs=RAD(0.02))


def test_wheels_that_creep_turn_the_yaw_and_teach_no_bias() -> None:
    """Motors that are not quite off turn it by two counts a second, which is no standing."""
    errors, creeps = Errors(gyro_bias=RAD(0.3)), lambda t_s: RAD(0.2) if t_s > 5 else 0.0
    robot = Robot(nothing, creeps, errors).drive(65)
    assert robot.worst_yaw_rad < RAD(0.3)
    assert robot.ring.orientation.bias_radps[2] == pytest.approx(RAD(0.3), abs=RAD(0.03))


@pytest.mark.parametrize("w_degps", [2.0, 10.0, -40.0])
def test_a_robot_that_is_turned_by_hand_with_still_wheels_turns(w_degps: float) -> None:
    w = RAD(w_degps)
    errors = Errors(
        gyro_bias=RAD(0.3),
        slip_left_mps=lambda t: 0.25 * w if 5 < t < 10 else 0.0,
        slip_right_mps=lambda t: -0.25 * w if 5 < t < 10 else 0.0,
    )
    robot = Robot(nothing, lambda t: w if 5 < t < 10 else 0.0, errors).drive(12)
    assert robot.left == pytest.approx(0.0, abs=1e-6)
    assert abs(robot.yaw_error_rad) < RAD(0.6)


def test_a_turn_from_standing_loses_nothing_of_its_begin() -> None:
    errors = Errors(gyro_noise=0.0, yaw_noise=0.0)
    robot = Robot(nothing, lambda t: max(0.0, t - 5.0), errors).drive(5.5)
    assert abs(robot.yaw_error_rad) < RAD(0.05)


@pytest.mark.parametrize("lean", [(0.0, 0.3), (0.2, 0.0), (-0.15, 0.25)])
def test_roll_and_pitch_turn_the_rate_to_the_vertical(lean: tuple[float, float]) -> None:
    """A body that leans turns about the vertical, and its sensor's own yaw is stuck."""
    ring, w_radps = AttitudeRing(0, 0, 0, levels=True), 0.5
    R_body_earth = R_from_rpy(*lean, 0.0).T
    x, y, z = (R_body_earth @ np.array([0.0, 0.0, w_radps])).tolist()
    for k in range(201):
        told = q_from_rpy(*lean, w_radps * 0.01 * min(k, 100)).tolist()
        ring.add(Attitude(0.01 * k, tuple(told), (x, y, z)))
    np.testing.assert_allclose(ring.newest_rpy(), (*lean, 1.0), atol=RAD(0.4))


def turned(t_s: float, yaw_rad: float, rates: tuple[float, float, float]) -> Attitude:
    q = (math.cos(0.5 * yaw_rad), 0.0, 0.0, math.sin(0.5 * yaw_rad))
    return Attitude(t_s, q, rates)


def test_without_a_gyro_and_in_a_gap_of_it_the_sensors_own_turn_counts() -> None:
    ring = AttitudeRing(0, 0, 0)
    for k in range(200):
        ring.add(turned(0.01 * k, 0.02 * k, NO_RATE))
        assert wrapped(ring.newest_rpy()[2] - 0.02 * k) == pytest.approx(0.0, abs=1e-9)
    ring = AttitudeRing(0, 0, 0)
    for k in range(100):
        ring.add(turned(0.01 * k, 0.0, STILL))
    assert ring.orientation.record["gyro_since_s"][0] == 0.0
    ring.add(turned(1.6, 0.4, STILL))
    assert ring.newest_rpy()[2] == pytest.approx(0.4, abs=0.01)
    assert ring.orientation.record["gyro_since_s"][0] == math.inf


NUMBER = st.floats(-200, 200) | st.sampled_from([math.nan, math.inf, -math.inf])
VECTOR = st.tuples(NUMBER, NUMBER, NUMBER)
SAMPLE = st.tuples(
    st.sampled_from([1e-4, 0.01, 0.05, 0.3, 20.0]),
    st.tuples(*[st.floats(-math.pi, math.pi)] * 3),
    VECTOR,
    st.none() | VECTOR,
    st.booleans(),
)


@settings(max_examples=examples(30), deadline=None)
@given(st.lists(SAMPLE, max_size=25))
def test_no_samples_make_the_yaw_anything_but_a_number(samples: list[tuple]) -> None:  # type: ignore[type-arg]
    ring, t_s = AttitudeRing(0, 0, 0, levels=True), 0.0
    heading = ring.orientation
    for dt_s, rpy_rad, rates, magnetic, moved in samples:
        t_s += dt_s
        w, x, y, z = q_from_rpy(*rpy_rad).tolist()
        assert ring.add(Attitude(t_s, (w, x, y, z), rates, magnetic))
        heading.note_wheels(t_s - 0.5 * dt_s, t_s, 0.1, 1e-3, moved=moved)
        heading.note_speed(dt_s, 0.5, rpy_rad[2])
        assert math.isfinite(sum(ring.newest_rpy()))
        assert np.isfinite(heading.state.value).all()
        assert np.isfinite(heading.state.P).all()
        assert np.linalg.eigvalsh(heading.state.P)[0] > -1e-6
