"""Odometry against exact paths, and where its chain must break."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.attitude import AttitudeRing
from core.odometry import EXTRAPOLATED_S, Odometry
from core.records import WheelCounts
from tests.test_core_attitude import attitude

TRACK_M, COUNTS_PER_M = 0.5, 2000 / (2 * math.pi * 0.15)


def drive(
    v: float, w: float, seconds: float, *, pitch: float = 0.0, yaw0: float = 0.0
) -> tuple[AttitudeRing, Odometry]:
    """A robot on a circle, its attitude sensor at 100 Hz and its counters at 20 Hz."""
    ring = AttitudeRing(0, 0, 0)
    odometry = Odometry(ring, 0.15, 500, 1.0, TRACK_M)
    for k in range(round(seconds * 100) + 1):
        t = 0.01 * k
        ring.add(attitude(t, pitch=pitch, yaw=yaw0 + w * t))
        if k % 5 == 0:
            left, right = (v - w * TRACK_M / 2) * t, (v + w * TRACK_M / 2) * t
            odometry.add(WheelCounts(t, left * COUNTS_PER_M, right * COUNTS_PER_M, 0))
        odometry.settle()
    return ring, odometry


@given(v=st.floats(-1, 1), w=st.floats(-1, 1), yaw0=st.floats(-3, 3))
def test_a_circle_is_followed_within_two_millimetres(v: float, w: float, yaw0: float) -> None:
    _, odometry = drive(v, w, 2.0, yaw0=yaw0)
    turned = w * 2.0
    if abs(w) < 1e-6:
        x, y = v * 2.0, 0.0
    else:
        x, y = v / w * math.sin(turned), v / w * (1 - math.cos(turned))
    np.testing.assert_allclose(odometry.xy_at(2.0), [x, y], atol=2e-3)
    assert math.isclose(odometry.w_radps, w, abs_tol=1e-6)


def test_travel_on_a_slope_is_made_horizontal() -> None:
    _, odometry = drive(0.5, 0.0, 2.0, pitch=math.radians(-6))
    assert odometry.xy_at(2.0)[0] == pytest.approx(1.0 * math.cos(math.radians(6)), abs=1e-6)


def test_the_pose_goes_on_at_the_last_speed_for_a_bounded_time_only() -> None:
    ring, odometry = drive(0.5, 0.0, 1.0)
    for k in range(1, 100):
        ring.add(attitude(1.0 + 0.01 * k))
    assert odometry.covers(0.9, 1.0 + EXTRAPOLATED_S)
    assert odometry.xy_at(1.2)[0] == pytest.approx(0.6)
    assert not odometry.covers(0.9, 1.01 + EXTRAPOLATED_S)
    assert odometry.maybe_pose(1.01 + EXTRAPOLATED_S) is None
    pose = odometry.maybe_pose(1.2)
    assert pose is not None
    assert pose.x_m == pytest.approx(0.6)


def test_counts_wait_for_the_attitude_of_their_instant() -> None:
    ring = AttitudeRing(0, 0, 0)
    odometry = Odometry(ring, 0.15, 500, 1.0, TRACK_M)
    odometry.add(WheelCounts(0.005, 0, 0, 0))
    odometry.settle()
    assert not odometry.started
    ring.add(attitude(0.0))
    ring.add(attitude(0.01))
    odometry.settle()
    assert odometry.started


def test_restarted_counters_break_the_chain_and_add_no_travel() -> None:
    ring, odometry = drive(0.5, 0.0, 1.0)
    ring.add(attitude(1.05))
    odometry.add(WheelCounts(1.05, 7.0, 7.0, 1))
    odometry.settle()
    assert odometry.breaks == 1
    assert odometry.xy_at(1.05)[0] == pytest.approx(0.5)
    assert odometry.v_mps == 0.0


def gone_for(seconds: float, left_m: float, right_m: float, yaw: float) -> Odometry:
    """A robot whose counters were not read for a while."""
    ring, odometry = drive(0.5, 0.0, 1.0)
    for k in range(1, round(100 * seconds) + 1):
        ring.add(attitude(1.0 + 0.01 * k, yaw=yaw * k / (100 * seconds)))
    odometry.add(
        WheelCounts(1.0 + seconds, (0.5 + left_m) * COUNTS_PER_M, (0.5 + right_m) * COUNTS_PER_M, 0)
    )
    odometry.settle()
    return odometry


def test_counters_away_on_a_straight_lose_nothing() -> None:
    odometry = gone_for(2.0, 1.0, 1.0, yaw=0.0)
    assert odometry.breaks == 0
    assert odometry.xy_at(3.0)[0] == pytest.approx(1.5)


def test_counters_away_while_the_robot_turned_and_moved_break_the_chain() -> None:
    assert gone_for(2.0, 1.0, 1.3, yaw=0.6).breaks == 1


def test_turning_on_the_spot_unread_keeps_the_chain() -> None:
    assert gone_for(2.0, -0.15, 0.15, yaw=0.6).breaks == 0


def test_driving_without_any_attitude_breaks_the_chain_but_standing_does_not() -> None:
    for moved_m, breaks in ((0.0, 0), (0.5, 1)):
        ring, odometry = drive(0.5, 0.0, 1.0)
        for k in range(1, 41):
            counts = (0.5 + moved_m * k / 40) * COUNTS_PER_M
            odometry.add(WheelCounts(1.0 + 0.05 * k, counts, counts, 0))
        ring.add(attitude(3.0))
        odometry.settle()
        assert (odometry.breaks > 0) == bool(breaks)


def test_an_old_or_repeated_pair_is_left_out() -> None:
    _, odometry = drive(0.5, 0.0, 1.0)
    odometry.add(WheelCounts(0.5, 1e6, 1e6, 0))
    odometry.settle()
    assert odometry.xy_at(1.0)[0] == pytest.approx(0.5)
