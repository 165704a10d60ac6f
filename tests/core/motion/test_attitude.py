"""The attitude ring: interpolation, gaps, what it refuses."""

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from core.geometry import R_from_rpy, q_from_R, q_from_rpy
from core.motion.attitude import AHEAD_S, KEPT, MAX_GAP_S, AttitudeRing
from core.records import Attitude

NO_RATE = (float("nan"),) * 3


def attitude(t_s: float, roll: float = 0.0, pitch: float = 0.0, yaw: float = 0.0) -> Attitude:
    w, x, y, z = q_from_rpy(roll, pitch, yaw).tolist()
    return Attitude(t_s, (w, x, y, z), NO_RATE)


def ring_of(*samples: Attitude, mount: tuple[float, float, float] = (0, 0, 0)) -> AttitudeRing:
    ring = AttitudeRing(*mount)
    for sample in samples:
        ring.add(sample)
    return ring


@given(rate=st.floats(-3, 3), at=st.floats(0.0, 0.09), start=st.floats(-math.pi, math.pi))
def test_a_steady_turn_is_interpolated_even_across_plus_minus_180_deg(
    rate: float, at: float, start: float
) -> None:
    ring = ring_of(*(attitude(0.01 * k, yaw=start + rate * 0.01 * k) for k in range(11)))
    _, _, yaw = ring.rpy_at(at)
    assert math.isclose(math.cos(yaw - start - rate * at), 1.0, abs_tol=1e-9)


def test_an_instant_is_covered_only_between_close_samples() -> None:
    ring = ring_of(attitude(1.00), attitude(1.01), attitude(1.02 + MAX_GAP_S), attitude(1.10))
    assert ring.covers(1.0, 1.01)
    assert not ring.covers(0.999, 1.01)
    assert not ring.covers(1.005, 1.03)
    assert ring.covers(1.085, 1.10)
    assert not ring.covers(1.085, 1.1001)
    assert ring.spans(1.0, 1.1)
    assert math.isclose(ring.between(1.04, 1.06)[2], 0.01 + MAX_GAP_S)
    assert ring.between(0.5, 1.0)[2] == math.inf
    assert not ring_of().covers(0.0, 0.0)
    assert not ring_of(attitude(1.0)).covers(1.0, 1.0)


def test_samples_out_of_order_or_without_orientation_are_counted_and_left() -> None:
    ring = ring_of(attitude(1.0))
    for t_s in (1.0, 0.5, math.nan, math.inf):
        assert not ring.add(attitude(t_s))
    for w in (0.0, math.nan):
        assert not ring.add(Attitude(2.0, (w, 0.0, 0.0, 0.0), NO_RATE))
    assert (ring.rejected, ring.newest_s) == (6, 1.0)
    assert ring.add(attitude(1.01))


def test_the_ring_forgets_the_oldest_and_keeps_the_order() -> None:
    ring = ring_of(*(attitude(0.01 * k, pitch=0.0001 * k) for k in range(KEPT + 100)))
    assert not ring.covers(0.98, 1.2)
    assert ring.covers(1.01, 0.01 * (KEPT + 99))
    _, pitch, _ = ring.rpy_at(2.345)
    assert math.isclose(pitch, 0.02345, abs_tol=1e-9)


@given(
    mount=st.tuples(*[st.floats(-1.0, 1.0)] * 3),
    body=st.tuples(*[st.floats(-1.0, 1.0)] * 3),
)
def test_the_mount_is_taken_off_orientation_and_rate(
    mount: tuple[float, float, float], body: tuple[float, float, float]
) -> None:
    R_body_sensor = R_from_rpy(*mount)
    q = q_from_R(R_from_rpy(*body) @ R_body_sensor)
    rate_body = np.array([0.1, -0.2, 0.3])
    rate_sensor = R_body_sensor.T @ rate_body
    sample = Attitude(0.0, tuple(map(float, q)), tuple(map(float, rate_sensor)))  # type: ignore[arg-type]
    ring = ring_of(sample, mount=mount)
    np.testing.assert_allclose(R_from_rpy(*ring.newest_rpy()), R_from_rpy(*body), atol=1e-6)
    np.testing.assert_allclose(ring.rate_body_radps, rate_body, atol=1e-9)


def ring_that_turns(
    rate_radps: tuple[float, float, float], mount_roll_rad: float = 0.0, bias_radps: float = 0.0
) -> AttitudeRing:
    """Ten samples at 100 Hz of a sensor that turns about its own axes, from level."""
    ring = AttitudeRing(mount_roll_rad, 0.0, 0.0)
    axis, (x_radps, y_radps, z_radps) = np.array(rate_radps), rate_radps
    rate = float(np.linalg.norm(axis))
    for k in range(10):
        half_rad = 0.5 * rate * 0.01 * k
        w, (x, y, z) = math.cos(half_rad), math.sin(half_rad) * axis / rate
        told = (x_radps, y_radps, z_radps + bias_radps)
        ring.add(Attitude(0.01 * k, (w, float(x), float(y), float(z)), told))
    return ring


def test_the_gyros_turn_is_kept_for_each_instant_and_orientations_turn_at_once() -> None:
    ring = ring_that_turns((0.0, 0.0, 0.5), bias_radps=0.01)
    _, yaw_rad, _, turned_rad = ring.between(0.03, 0.085)
    assert math.isclose(turned_rad, 0.055 * 0.51)
    assert math.isclose(yaw_rad, ring.rpy_at(0.0575)[2])
    assert math.isnan(ring.between(-0.01, 0.085)[3])  # it told later than that
    before = [ring.rpy_at(0.01 * k) for k in range(1, 9)]
    ring.turn_all(0.25)
    for k, (roll, pitch, yaw) in enumerate(before, start=1):
        np.testing.assert_allclose(ring.rpy_at(0.01 * k), (roll, pitch, yaw + 0.25), atol=1e-9)


def test_a_rate_that_no_body_has_is_as_none() -> None:
    for wrong in (math.nan, math.inf, 1e300, 101.0):
        ring = ring_of(Attitude(0.0, (1.0, 0.0, 0.0, 0.0), (0.0, wrong, 0.1)))
        assert np.isnan(ring.rate_body_radps).all()


def test_roll_and_pitch_are_the_sensors_whatever_the_filter_makes_of_yaw() -> None:
    ring = AttitudeRing(0, 0, 0)
    for k in range(200):
        pulled = attitude(0.0, 0.1, -0.2, 0.5 if k > 100 else 0.0).q_earth_sensor
        ring.add(Attitude(0.01 * k, pulled, (0.0, 0.0, 0.0)))
    np.testing.assert_allclose(ring.newest_rpy(), (0.1, -0.2, 0.0), atol=1e-6)


@given(
    rate=st.tuples(*[st.floats(-2, 2)] * 3).filter(lambda rate: np.linalg.norm(rate) > 0.1),
    ahead_s=st.floats(1e-6, AHEAD_S),
    mount_roll_rad=st.sampled_from([0.0, math.pi / 2]),
)
def test_the_newest_sample_is_carried_on_by_its_rate_of_turn(
    rate: tuple[float, float, float], ahead_s: float, mount_roll_rad: float
) -> None:
    ring, later = ring_that_turns(rate, mount_roll_rad), ring_that_turns(rate, mount_roll_rad)
    half_rad = 0.5 * float(np.linalg.norm(rate)) * (0.09 + ahead_s)
    x, y, z = math.sin(half_rad) * np.array(rate) / np.linalg.norm(rate)
    q = (math.cos(half_rad), float(x), float(y), float(z))
    later.add(Attitude(0.09 + ahead_s + 1e-9, q, rate))
    assert ring.reaches(0.0, 0.09 + ahead_s)
    assert not ring.covers(0.0, 0.09 + ahead_s)
    roll, pitch, _ = later.rpy_at(0.09 + ahead_s)  # yaw is the heading filter's
    np.testing.assert_allclose(ring.rpy_at(0.09 + ahead_s)[:2], (roll, pitch), atol=5e-4)


def test_no_farther_than_a_sample_not_without_a_rate_and_over_no_gap() -> None:
    ring = ring_that_turns((0.0, 0.0, 0.5))
    assert not ring.reaches(0.0, 0.09 + AHEAD_S + 1e-6)
    assert not ring.reaches(-0.01, 0.09)
    for t_s in (0.2, 0.21):
        ring.add(Attitude(t_s, (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.5)))
    assert not ring.reaches(0.05, 0.205)
    assert ring.reaches(0.201, 0.215)
    still = ring_of(*(attitude(0.01 * k) for k in range(10)))
    assert still.reaches(0.0, 0.09)
    assert not still.reaches(0.0, 0.0901)
