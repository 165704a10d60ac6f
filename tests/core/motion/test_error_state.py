"""The error state against plain matrices, and what wheels and gyro say of each other."""

import math

import numpy as np
import pytest

from core.motion.error_state import (
    ALIGN_X,
    ASYMMETRY,
    BIAS,
    OFFSET,
    SCALE,
    SIZE,
    START_BIAS_RADPS,
    YAW,
    ErrorState,
    X,
    Y,
    travel,
    turn,
)
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


def test_time_makes_the_bias_an_error_of_yaw() -> None:
    state, F = full_state(3), np.eye(SIZE)
    P = state.P.copy()
    F[YAW, BIAS], F[OFFSET, OFFSET] = -0.01, 0.9
    Q = np.zeros((SIZE, SIZE))
    Q[YAW, YAW], Q[BIAS, BIAS], Q[OFFSET, OFFSET] = 0.1, 0.2, 0.3
    offset_rad = state.value[OFFSET]
    turn(state.P, state.value, 0.01, 0.1, 0.2, 0.9, 0.3)
    assert state.value[OFFSET] == 0.9 * offset_rad
    np.testing.assert_allclose(state.P, F @ P @ F.T + Q, atol=1e-12)


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
    assert value[BIAS] == pytest.approx(RAD(0.4), abs=RAD(0.1))
    assert state.P[BIAS, BIAS] < START_BIAS_RADPS**2 / 9


def test_a_bias_that_is_known_tells_of_unequal_wheels() -> None:
    state = ErrorState()
    state.P[BIAS, BIAS] = RAD(0.01) ** 2
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
    assert value[BIAS] == 0.0
    turns(check, 3, v=0.5, wheels=1.0, gyro=math.nan)  # nobody knows
    assert (check.slipping, check.slips) == (False, 1)
