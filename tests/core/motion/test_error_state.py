"""The error state against plain matrices, and what wheels and gyro say of each other."""

import math

import numpy as np
import pytest

from core.geometry import R_from_rpy
from core.motion.error_state import (
    ALIGN_X,
    ASYMMETRY,
    BIAS,
    BIAS_VAR,
    BIAS_Z,
    OFFSET,
    OFFSET_RAD,
    OFFSET_S,
    SCALE,
    SIZE,
    START_BIAS_RADPS,
    TILT,
    WANDER,
    WANDER_RAD,
    WANDER_S,
    YAW,
    ErrorState,
    X,
    Y,
    pass_time,
    travel,
)
from core.motion.kalman import spread
from core.motion.wheel_check import GONE_S, Turn, WheelCheck
from core.records import F64

TRACK_M, M_PER_COUNT = 0.5, 0.00047
RAD = math.radians


def full_state(seed: int) -> ErrorState:
    state, random = ErrorState(), np.random.default_rng(seed)
    A = random.standard_normal((SIZE, SIZE))
    state.P[:] = A @ A.T
    state.value[:] = random.standard_normal(SIZE)
    return state


def test_a_measurement_is_taken_as_in_the_textbook() -> None:
    state, h = full_state(1), np.random.default_rng(2).standard_normal(SIZE)
    P, value = state.P.copy(), state.value.copy()
    gain = P @ h / (h @ P @ h + 0.5)
    state.correct(h, 0.7, 0.5)
    np.testing.assert_allclose(state.value, value + gain * 0.7)
    np.testing.assert_allclose(state.P, (np.eye(SIZE) - np.outer(gain, h)) @ P, atol=1e-12)
    np.testing.assert_array_equal(state.P, state.P.T)
    assert state.spread(h) == pytest.approx(float(h @ state.P @ h))
    assert spread(h, state.P) == pytest.approx(state.spread(h))


@pytest.mark.parametrize("yaw_stands", [False, True])
def test_time_makes_the_biases_errors_of_the_angles_they_turn(yaw_stands: bool) -> None:
    state, F, Q = full_state(3), np.eye(SIZE), np.zeros((SIZE, SIZE))
    P, value, R = state.P.copy(), state.value.copy(), R_from_rpy(0.2, -0.3, 1.0)
    turns = (TILT, TILT + 1) if yaw_stands else (TILT, TILT + 1, YAW)
    for i, row in enumerate(turns):
        F[row, BIAS : BIAS + 3], Q[row, row] = -0.1 * R[i], 0.7
        Q[BIAS + i, BIAS + i] = BIAS_VAR * 0.1
    Q[BIAS_Z, BIAS_Z] = BIAS_VAR * 0.1
    wandering = ((WANDER, WANDER_RAD, WANDER_S), (WANDER + 1, WANDER_RAD, WANDER_S))
    for row, sigma, lasts_s in (*wandering, (OFFSET, OFFSET_RAD, OFFSET_S)):
        F[row, row] = math.exp(-0.1 / lasts_s)
        Q[row, row] = sigma**2 * (1 - F[row, row] ** 2)
    one, two, three = R.tolist()
    pass_time(state.P, state.value, (tuple(one), tuple(two), tuple(three)), 0.1, 0.7, yaw_stands)
    np.testing.assert_allclose(state.P, F @ P @ F.T + Q, atol=1e-12)
    for row in (WANDER, WANDER + 1, OFFSET):
        value[row] *= F[row, row]
    np.testing.assert_allclose(state.value, value)


def test_a_step_makes_yaw_and_scale_errors_of_position() -> None:
    state, F, dx, dy = full_state(4), np.eye(SIZE), 0.3, -0.4
    P = state.P.copy()
    F[X, YAW], F[Y, YAW], F[X, SCALE], F[Y, SCALE] = -dy, dx, dx, dy
    along, across = np.array([0.6, -0.8]), np.array([0.8, 0.6])
    expected = F @ P @ F.T
    expected[:2, :2] += 0.04 * np.outer(along, along) + 0.01 * np.outer(across, across)
    travel(state.P, dx, dy, 0.04, 0.01)
    np.testing.assert_allclose(state.P, expected, atol=1e-12)
    still = ErrorState()
    travel(still.P, 0.0, 0.0, 0.04, 0.01)
    assert (still.P[X, X], still.P[Y, Y], still.P[X, Y]) == (0.04, 0.04, 0.0)


def test_a_state_that_is_defined_by_another_shares_its_error() -> None:
    state = full_state(5)
    P = state.P.copy()
    state.define(ALIGN_X, X, 1.0, 0.5)
    h = np.zeros(SIZE)
    h[X], h[ALIGN_X] = 1.0, -1.0
    assert state.spread(h) == pytest.approx(0.5)  # the difference is the noise alone
    assert state.P[ALIGN_X, Y] == P[X, Y]


def test_where_the_map_begins_the_pose_is_sure_and_the_offset_is_not() -> None:
    state = full_state(6)
    h = np.zeros(SIZE)
    h[YAW] = h[OFFSET] = 1.0
    before = state.spread(h)
    state.begin_map()
    assert not state.P[[X, Y, YAW]].any()
    assert state.spread(h) == pytest.approx(before)


def turns(check: WheelCheck, seconds: float, *, v: float, wheels: float, gyro: float) -> F64:
    """Intervals of 50 ms at a speed and rates of turn; the state's value at their end."""
    for _ in range(round(20 * seconds)):
        check.take(Turn(0.05, 0.05 * v, 0.05 * wheels, 0.05 * gyro))
    return check._state.value


def test_straight_wheels_tell_the_gyros_bias() -> None:
    state = ErrorState()
    value = turns(WheelCheck(state, TRACK_M, M_PER_COUNT), 20, v=0.02, wheels=0.0, gyro=RAD(0.4))
    assert value[BIAS_Z] == pytest.approx(RAD(0.4), abs=RAD(0.1))
    assert state.P[BIAS_Z, BIAS_Z] < START_BIAS_RADPS**2 / 9


def test_a_bias_that_is_known_tells_of_unequal_wheels() -> None:
    state = ErrorState()
    state.P[BIAS_Z, BIAS_Z] = RAD(0.01) ** 2
    check = WheelCheck(state, TRACK_M, M_PER_COUNT)
    value = turns(check, 60, v=0.5, wheels=0.0, gyro=0.005 * 0.5 / TRACK_M)
    assert value[ASYMMETRY] == pytest.approx(0.005, abs=0.0015)
    assert check.slips == 0


def test_a_slip_begins_once_ends_a_while_after_and_teaches_nothing() -> None:
    state = ErrorState()
    check = WheelCheck(state, TRACK_M, M_PER_COUNT)
    turns(check, 0.9, v=0.5, wheels=0.0, gyro=0.0)
    turns(check, 0.5, v=0.5, wheels=0.6, gyro=0.0)
    assert (check.slipping, check.slips) == (True, 1)
    value = turns(check, GONE_S + 0.3, v=0.5, wheels=0.0, gyro=0.0)
    assert (check.slipping, check.slips) == (False, 1)
    assert value[BIAS_Z] == 0.0
    turns(check, 3, v=0.5, wheels=1.0, gyro=math.nan)  # nobody knows
    assert (check.slipping, check.slips) == (False, 1)


def test_wheels_that_turn_unseen_by_the_gyro_are_told_until_the_gyro_turns() -> None:
    check = WheelCheck(ErrorState(), TRACK_M, M_PER_COUNT)

    def turn(wheels_rad: float, gyro_rad: float, times: int) -> None:
        for _ in range(times):
            check.take(Turn(0.05, 0.0, wheels_rad, gyro_rad))

    turn(0.05, 0.05, 40)  # as it should be
    turn(0.05, 0.0125, 40)  # a slip, of which a part is seen
    assert not check.ignored
    turn(0.05, 0.0, 14)
    turn(0.0, 0.0, 100)  # letting go is not enough
    assert not check.ignored
    turn(0.05, 0.0, 14)
    assert check.ignored
    turn(0.0, 0.0, 100)
    check.restart()
    turn(-0.05, 0.0, 4)
    assert check.ignored
    turn(0.0, 0.05, 8)  # somebody turns the robot
    assert not check.ignored
