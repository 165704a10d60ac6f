"""Rotations against their definitions."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.geometry import R_from_rpy, check_rotation, q_from_R, rpy_from_q, wrapped

ANGLES = st.floats(-math.pi, math.pi)
PITCHES = st.floats(-1.5, 1.5)


def test_positive_pitch_is_nose_down_and_positive_roll_is_right_side_down() -> None:
    nose = R_from_rpy(0.0, math.radians(10), 0.0) @ [1.0, 0.0, 0.0]
    right_side = R_from_rpy(math.radians(10), 0.0, 0.0) @ [0.0, -1.0, 0.0]
    left_turn = R_from_rpy(0.0, 0.0, math.radians(90)) @ [1.0, 0.0, 0.0]
    assert nose[2] < 0
    assert right_side[2] < 0
    np.testing.assert_allclose(left_turn, [0, 1, 0], atol=1e-12)


@given(roll=ANGLES, pitch=PITCHES, yaw=ANGLES)
def test_angles_survive_the_way_through_matrix_and_quaternion(
    roll: float, pitch: float, yaw: float
) -> None:
    R = R_from_rpy(roll, pitch, yaw)
    check_rotation(R)
    back = rpy_from_q(q_from_R(R))
    np.testing.assert_allclose(R_from_rpy(*back), R, atol=1e-7)


def test_what_is_no_rotation_is_refused() -> None:
    for wrong in (np.diag([1.0, 1.0, -1.0]), 2 * np.eye(3), np.ones((3, 3))):
        with pytest.raises(ValueError, match="not a rotation"):
            check_rotation(wrong)


@given(angle=st.floats(-50, 50))
def test_a_wrapped_angle_points_the_same_way(angle: float) -> None:
    assert -math.pi <= wrapped(angle) < math.pi
    assert math.isclose(math.cos(wrapped(angle)), math.cos(angle), abs_tol=1e-9)
    assert math.isclose(math.sin(wrapped(angle)), math.sin(angle), abs_tol=1e-9)
