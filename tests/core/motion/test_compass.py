"""The magnetic field: what steel does to it is seen without a heading."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.geometry import R_from_rpy, q_from_rpy, rpy_of
from core.motion.compass import (
    COMPASS,
    GATE,
    HOLD_S,
    begin_compass,
    is_plain,
    note_field,
    strength_and_dip,
)
from core.motion.error_state import OFFSET_RAD
from jit import Record, records

LEVEL, EARTH = (1.0, 0.0, 0.0, 0.0), np.array([0.4, 0.0, -0.9])


def learnt() -> Record:
    """A compass that has seen the earth's field for a while."""
    compass = records(COMPASS)
    begin_compass(compass)
    for _ in range(150):
        note_field(compass[0], 0.01, LEVEL, (0.4, 0.0, -0.9))
    return compass[0]


def shown(compass: Record, field: tuple[float, float, float], seconds: float) -> float:
    """By how much the yaw is taken to be off, 1 sigma, after so long in a field."""
    for _ in range(round(100 * seconds)):
        note_field(compass, 0.01, LEVEL, field)
    return math.sqrt(float(compass["bent_var"]))


def test_strength_and_dip_need_no_heading() -> None:
    half = math.sqrt(0.5)
    for q, field in ((LEVEL, (0.6, 0.0, -0.8)), ((half, 0.0, 0.0, half), (0.0, -0.6, -0.8))):
        assert strength_and_dip(q, field) == pytest.approx((1.0, math.asin(0.8)))
    assert strength_and_dip(LEVEL, (0.0, 0.0, 0.0)) == (0.0, 0.0)


def test_a_field_is_plain_while_strength_and_dip_are_as_at_first() -> None:
    assert shown(learnt(), (0.4, 0.0, -0.9), 1.0) < 1e-6
    assert shown(learnt(), (0.0, 0.4, -0.9), 1.0) < 1e-6  # turned: that is for the gyro to tell
    for field in ((0.6, 0.0, -0.9), (0.9, 0.0, -0.4), (0.0, 0.0, 0.0), (math.nan, 0.0, 1.0)):
        compass = learnt()
        assert shown(compass, field, 1.0) >= GATE * OFFSET_RAD - 1e-9
        assert not is_plain(compass)


def test_what_was_bent_is_believed_again_only_as_the_sensor_finds_back() -> None:
    compass = learnt()
    bent_rad = shown(compass, (0.42, 0.0, -0.88), 2.0)
    assert math.radians(0.5) < bent_rad < GATE * OFFSET_RAD
    assert is_plain(compass)
    after_rad = shown(compass, (0.4, 0.0, -0.9), 2.0 * HOLD_S)
    assert after_rad == pytest.approx(bent_rad * math.exp(-1.0), rel=0.3)


@given(axis=st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: np.linalg.norm(v) > 0.3))
def test_steel_that_adds_to_two_parts_is_taken_to_add_as_much_to_the_third(
    axis: tuple[float, float, float],
) -> None:
    """The law of the module, whose mean over all directions is right."""
    added = 0.02 * np.array(axis) / np.linalg.norm(axis)
    x, y, z = (EARTH + added).tolist()
    ahead, down = EARTH / np.linalg.norm(EARTH), np.array([-0.9, 0.0, -0.4])
    seen = (added @ ahead) ** 2 + (added @ down / np.linalg.norm(down)) ** 2
    expected_rad = math.sqrt(0.5 * seen) / 0.4
    assert shown(learnt(), (x, y, z), 4.0) == pytest.approx(expected_rad, abs=0.004)


@given(rpy=st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(-3, 3)))
def test_a_body_that_leans_sees_the_same_field(rpy: tuple[float, float, float]) -> None:
    w, x, y, z = q_from_rpy(*rpy).tolist()
    one, two, three = (R_from_rpy(*rpy).T @ EARTH).tolist()
    strength, dip_rad = strength_and_dip((w, x, y, z), (one, two, three))
    assert rpy_of(w, x, y, z) == pytest.approx(rpy, abs=1e-9)
    assert (strength, dip_rad) == pytest.approx(
        (float(np.linalg.norm(EARTH)), math.atan2(0.9, 0.4)), abs=1e-9
    )
