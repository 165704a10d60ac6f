"""Beams as rays against a plain transcription with matrices, and against known geometry."""

import math

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.geometry import R_from_rpy
from core.mapping.rays import MIN_RANGE_M, BeamGeometry
from core.motion.attitude import AttitudeRing
from core.motion.odometry import Odometry
from core.records import Scan, WheelCounts
from tests.core.motion.test_attitude import attitude
from tests.support.cases import examples

F64 = npt.NDArray[np.float64]
PAPER = ((0.25, 0.0, 1.08), 0.0, math.radians(7.5), 0.0)
DT_S = 0.25 / 360 / 25


def scan_of(ranges_m: F64, t_s: float = 0.5) -> Scan:
    """A scan from 30 to 150 deg (device angles), 25 Hz."""
    return Scan(
        t_s=t_s,
        beam_dt_s=DT_S,
        first_rad=math.radians(-60),
        step_rad=math.radians(120) / max(1, ranges_m.shape[1] - 1),
        ranges_m=ranges_m,
        counter=0,
        arrived_s=t_s + 0.02,
    )


def moving(
    rpy0: tuple[float, float, float], rates: tuple[float, float, float], v: float
) -> tuple[AttitudeRing, Odometry]:
    """A second of linear angles, and of straight travel along the heading at the start."""
    ring = AttitudeRing(0, 0, 0)
    odometry = Odometry(ring, 0.15, 500, 1.0, 0.5)
    for k in range(101):
        t = 0.01 * k
        ring.add(attitude(t, *(a + b * t for a, b in zip(rpy0, rates, strict=True))))
        if k % 5 == 0:
            counts = v * t * 2000 / (2 * math.pi * 0.15)
            odometry.add(WheelCounts(t, counts, counts, 0))
        odometry.settle()
    return ring, odometry


ANGLE = st.floats(-0.2, 0.2)


@settings(max_examples=examples(25))
@given(
    rpy0=st.tuples(ANGLE, ANGLE, st.floats(-3, 3)),
    rates=st.tuples(ANGLE, ANGLE, st.floats(-1, 1)),
    mount=st.tuples(ANGLE, ANGLE, ANGLE),
    v=st.floats(-1, 1),
    seed=st.integers(0, 99),
)
def test_points_equal_a_plain_transcription_at_each_beams_own_instant(
    rpy0: tuple[float, float, float],
    rates: tuple[float, float, float],
    mount: tuple[float, float, float],
    v: float,
    seed: int,
) -> None:
    ring, odometry = moving(rpy0, rates, v)
    ranges_m = np.random.default_rng(seed).uniform(0.5, 20.0, (1, 40))
    scan = scan_of(ranges_m)
    sweep = BeamGeometry((0.3, -0.1, 1.0), *mount, 481).cast(scan, ring, odometry)
    points = sweep.points()
    R_body_sensor = R_from_rpy(*mount)
    for i in range(40):
        t = scan.t_s + i * DT_S
        roll, pitch, yaw = ring.rpy_at(t)
        R_map_body = R_from_rpy(roll, pitch, yaw - odometry.yaw_start_rad)
        bearing = scan.first_rad + i * scan.step_rad
        beam = ranges_m[0, i] * np.array([math.cos(bearing), math.sin(bearing), 0.0])
        lens = odometry.place_at(t)[:3] + R_map_body @ [0.3, -0.1, 1.0]
        np.testing.assert_allclose(sweep.origins[i], lens, atol=1e-6)
        np.testing.assert_allclose(points[i], lens + R_map_body @ R_body_sensor @ beam, atol=1e-5)
    assert sweep.t_s == pytest.approx(scan.t_s + 39 * DT_S)
    np.testing.assert_allclose(np.linalg.norm(sweep.rays, axis=1), 1.0, atol=1e-12)


def test_the_centre_beam_of_the_papers_robot_meets_the_ground_eight_metres_ahead() -> None:
    ring, odometry = moving((0, 0, 0.7), (0, 0, 0), 0.0)
    slant_m = 1.08 / math.sin(math.radians(7.5))
    geometry = BeamGeometry(*PAPER, 481)
    first = geometry.cast(scan_of(np.full((1, 3), slant_m)), ring, odometry)
    second = geometry.cast(scan_of(np.full((1, 3), slant_m)), ring, odometry)
    assert np.shares_memory(first.rays, second.rays)
    assert second.points()[1] == pytest.approx(
        [0.25 + 1.08 / math.tan(math.radians(7.5)), 0.0, 0.0]
    )


def test_no_measurement_and_the_housing_give_no_point_and_both_echoes_give_two() -> None:
    ring, odometry = moving((0, 0, 0), (0, 0, 0), 0.0)
    nan = float("nan")
    ranges_m = np.array([[2.0, nan, MIN_RANGE_M / 2, 3.0], [nan, nan, nan, 5.0]])
    sweep = BeamGeometry(*PAPER, 481).cast(scan_of(ranges_m), ring, odometry)
    distances = np.linalg.norm(sweep.points() - sweep.origins[[0, 3, 3]], axis=1)
    np.testing.assert_allclose(distances, [2.0, 3.0, 5.0])
