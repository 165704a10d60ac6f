"""Odometry against exact paths, and where its chain must break."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.motion.attitude import AttitudeRing
from core.motion.error_state import OFFSET_RAD
from core.motion.odometry import EXTRAPOLATED_S, Odometry
from core.records import Attitude, ExternalPose, WheelCounts
from tests.core.motion.test_attitude import attitude
from tests.support.cases import examples
from tests.support.robot.shipped import shipped
from tests.support.robot.turning_robot import Errors, Robot

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


@settings(max_examples=examples(20))
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
    assert odometry.travel_m == pytest.approx(2.0 * v)


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
    assert (odometry.breaks, odometry.broken_by) == (1, "the wheels' counters began anew")
    assert odometry.xy_at(1.05)[0] == pytest.approx(0.5)
    assert odometry.v_mps == 0.0
    assert odometry.travel_m == pytest.approx(0.5)
    np.testing.assert_array_equal(odometry.covariance[:2], np.zeros((2, 3)))
    odometry.add(WheelCounts(0.5, 1e6, 1e6, 1))  # old
    odometry.settle()
    assert odometry.xy_at(1.05)[0] == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("unpowered_s", "is_known"),
    [
        (0.4, True),
        (math.inf, False),  # a jump: they may have been stuck, or have told less than the way
        (0.1, False),  # it has counted since: no controller that started
    ],
)
def test_where_a_robot_is_behind_counters_that_began_anew_is_known_in_part(
    unpowered_s: float, is_known: bool
) -> None:
    ring = AttitudeRing(0, 0, 0)
    odometry = Odometry(ring, 0.15, 500, 1.0, TRACK_M, robot=shipped().robot)
    for k in range(201):
        ring.add(attitude(0.01 * k))
    for k in range(3):
        odometry.add(WheelCounts(0.1 * k, 0.05 * k * COUNTS_PER_M, 0.05 * k * COUNTS_PER_M, 0))
    odometry.add(WheelCounts(0.9, 1e5, 1e5, 1, unpowered_s))
    odometry.settle()
    assert odometry.breaks == 1
    assert (odometry.maybe_shift is not None) == is_known


@pytest.mark.parametrize(
    ("left_m", "right_m", "yaw_rad", "breaks"),
    [(1.0, 1.0, 0.0, 0), (-0.15, 0.15, 0.6, 0), (1.0, 1.3, 0.6, 1)],
)
def test_counters_away_while_the_robot_turned_and_moved_break_the_chain(
    left_m: float, right_m: float, yaw_rad: float, breaks: int
) -> None:
    """A straight, or a turn on the spot, loses nothing."""
    ring, odometry = drive(0.5, 0.0, 1.0)
    for k in range(1, 201):
        ring.add(attitude(1.0 + 0.01 * k, yaw=yaw_rad * k / 200))
    left, right = (0.5 + left_m) * COUNTS_PER_M, (0.5 + right_m) * COUNTS_PER_M
    odometry.add(WheelCounts(3.0, left, right, 0))
    odometry.settle()
    assert odometry.breaks == breaks
    away = "the robot moved while the wheels' counters stayed away"
    assert odometry.broken_by == (away if breaks else "")
    if yaw_rad == 0.0:
        assert odometry.xy_at(3.0)[0] == pytest.approx(1.5)


def without_attitude(moved_m: float, wheels_rad: float, yaw_rad: float) -> Odometry:
    """Straight on for a second; then two in which the attitude is away, and a half after it."""
    ring, odometry = drive(0.5, 0.0, 1.0)
    for k in range(1, 51):
        share, t_s = min(k / 40, 1.0), 1.0 + 0.05 * k
        way_m, turn_m = 0.5 + moved_m * share, 0.5 * TRACK_M * wheels_rad * share
        left, right = (way_m - turn_m) * COUNTS_PER_M, (way_m + turn_m) * COUNTS_PER_M
        odometry.add(WheelCounts(t_s, left, right, 0))
        if t_s > 3.0:
            for n in range(5):
                ring.add(attitude(t_s - 0.04 + 0.01 * n, yaw=yaw_rad))
            odometry.settle()
    return odometry


@pytest.mark.parametrize(
    ("moved_m", "wheels_rad", "yaw_rad", "known"),
    [
        (0.0, 0.0, 0.0, True),
        (0.0, 0.0, 1.0, True),  # somebody turned it
        (0.4, 0.0, 0.0, True),
        (0.3, 0.2, 0.21, True),
        (0.4, 0.0, 0.06, False),  # one of both is wrong
        (0.4, 0.2, 0.0, False),
        (3.0, 0.0, 0.0, False),  # a little askew would lead far off
        (0.6, 0.3, 0.3, True),
    ],
)
def test_a_short_way_without_attitude_is_known_where_wheels_and_attitude_tell_the_same_turn(
    moved_m: float, wheels_rad: float, yaw_rad: float, known: bool
) -> None:
    odometry = without_attitude(moved_m, wheels_rad, yaw_rad)
    assert (odometry.breaks == 0) == known
    away = "the robot moved while the attitude stayed away"
    assert odometry.broken_by == ("" if known else away)
    if known:
        end_m = odometry.xy_at(3.5)
        np.testing.assert_allclose(end_m, [0.5 + moved_m, 0.5 * moved_m * yaw_rad], atol=0.03)


@pytest.mark.parametrize(("back_rad", "known"), [(0.0, True), (0.4, False)])
def test_without_attitude_the_way_goes_where_the_wheels_turned_it_and_not_along_a_mean(
    back_rad: float, known: bool
) -> None:
    """A turn at once, and then 0.6 m straight; what is turned back on the way could be slip."""
    ring, odometry = drive(0.5, 0.0, 1.0)
    yaw_rad = way_m = 0.0
    wheels_m = np.array([0.5, 0.5])
    for k in range(1, 41):
        step_rad = 0.06 if k <= 5 else (-back_rad if k in (20, 28) else back_rad) * (k % 8 == 4)
        step_m = 0.0 if k <= 5 else 0.6 / 35
        yaw_rad, way_m = yaw_rad + step_rad, way_m + step_m
        wheels_m += step_m + 0.5 * TRACK_M * np.array([-step_rad, step_rad])
        left, right = (wheels_m * COUNTS_PER_M).tolist()
        odometry.add(WheelCounts(1.0 + 0.05 * k, left, right, 0))
    for n in range(5):
        ring.add(attitude(2.96 + 0.01 * n, yaw=yaw_rad))
    for n in range(10):
        ring.add(attitude(3.01 + 0.01 * n, yaw=yaw_rad))
    odometry.add(WheelCounts(3.05, left, right, 0))
    odometry.settle()
    assert (odometry.breaks == 0) == known
    if known:
        true_m = [0.5 + way_m * math.cos(0.3), way_m * math.sin(0.3)]
        np.testing.assert_allclose(odometry.xy_at(3.05), true_m, atol=0.02)


def test_no_place_is_known_before_a_way_without_attitude_is_judged() -> None:
    ring, odometry = drive(0.5, 0.0, 1.0)
    for k in range(1, 11):
        counts = (0.5 + 0.04 * min(k, 5)) * COUNTS_PER_M
        odometry.add(WheelCounts(1.0 + 0.1 * k, counts, counts, 0))
    ring.add(attitude(1.95))
    odometry.settle()
    assert odometry.maybe_pose(1.95) is None
    assert not odometry.covers(1.95, 1.95)
    for k in range(1, 11):
        ring.add(attitude(1.95 + 0.01 * k))
    odometry.add(WheelCounts(2.05, counts, counts, 0))
    odometry.settle()
    assert odometry.maybe_pose(2.05) is not None
    assert odometry.covariance[0, 0] > 1e-5


def test_height_and_travel_come_from_wheels_and_pitch_and_go_on_alike() -> None:
    ring, odometry = drive(0.5, 0.0, 2.0, pitch=math.radians(-6))
    ring.add(attitude(2.01, pitch=math.radians(-6)))
    assert odometry.travel_m == pytest.approx(1.0)
    assert odometry.place_at(1.0)[3] == pytest.approx(0.5)
    assert odometry.place_at(2.2)[3] == pytest.approx(1.1)
    climb = math.sin(math.radians(6))
    for at_s, driven_m in ((1.0, 0.5), (2.0, 1.0), (2.2, 1.1)):
        xyz_m = odometry.place_at(at_s)
        assert xyz_m[2] == pytest.approx(driven_m * climb, abs=1e-6)
        assert xyz_m[0] == pytest.approx(driven_m * math.cos(math.radians(6)), abs=1e-6)
        np.testing.assert_array_equal(xyz_m[:2], odometry.xy_at(at_s))


def test_the_covariance_tells_the_errors_that_there_are() -> None:
    """Squared errors over their variances: about 3 for three numbers, in the mean of many runs."""
    squares = []
    for seed in range(8):
        random = np.random.default_rng(1000 + seed)
        errors = Errors(
            gyro_bias=math.radians(0.3) * random.standard_normal(),
            yaw_noise=math.radians(0.2),
            wander=OFFSET_RAD,
            scale=0.04 * random.standard_normal(),
            asymmetry=0.005 * random.standard_normal(),
            roughness=0.01,
        )
        robot = Robot(ramp, winding, errors, seed=seed).drive(20)
        error = robot.error
        squares.append(error @ np.linalg.solve(robot.odometry.covariance, error))
    assert 1.2 < np.mean(squares) < 6.0
    assert max(squares) < 20.0


def ramp(t_s: float) -> float:
    return 0.5 * max(0.0, min(1.0, t_s - 2.0))


def winding(t_s: float) -> float:
    return 0.4 * math.sin(0.7 * (t_s - 2.0)) + 0.1 if t_s > 2.0 else 0.0


def test_a_wheel_that_slips_is_noticed_and_the_position_is_less_sure() -> None:
    errors = Errors(slip_left_mps=lambda t: 0.3 if 6 < t < 7 else 0.0)
    spin = Errors(slip_left_mps=spinning, slip_right_mps=spinning)
    assert (
        Robot(ramp, lambda t: 0.0, spin).drive(8).odometry.wheels.slips > 0
    )  # both wheels at once
    robot = Robot(ramp, lambda t: 0.0, errors).drive(5.9)
    before = robot.odometry.covariance
    assert (robot.odometry.wheels.slipping, robot.odometry.wheels.slips) == (False, 0)
    robot.drive(0.8)
    assert robot.odometry.wheels.slipping
    robot.drive(3)
    assert (robot.odometry.wheels.slipping, robot.odometry.wheels.slips) == (False, 1)
    assert abs(robot.yaw_error_rad) < math.radians(0.3)  # the gyro alone tells the heading
    off_m, sure_m = abs(float(robot.error[0])), math.sqrt(robot.odometry.covariance[0, 0])
    assert off_m == pytest.approx(0.15, abs=0.02)
    assert off_m < 2 * sure_m
    assert sure_m > math.sqrt(before[0, 0]) + 0.1


def spinning(t_s: float) -> float:
    return 1.0 if 6 < t_s < 7 else 0.0


def test_a_brisk_slalom_is_no_slip() -> None:
    for seed in range(2):
        errors = Errors(gyro_bias=math.radians(0.3), asymmetry=0.005)
        robot = Robot(lambda t: 2 * ramp(t), lambda t: 4 * winding(t) - 0.4, errors, seed=seed)
        assert robot.drive(12).odometry.wheels.slips == 0


WRONG = st.sampled_from([math.nan, math.inf, -math.inf, 1e300])
TIME = st.floats(0, 3) | WRONG
NUMBER = st.floats(-50, 50) | WRONG
TRIPLE = st.tuples(NUMBER, NUMBER, NUMBER)
RECORD = (
    st.builds(WheelCounts, TIME, NUMBER, NUMBER, st.integers(0, 1))
    | st.builds(
        lambda t_s, yaw, rates, magnetic: Attitude(
            t_s, (math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)), rates, magnetic
        ),
        TIME,
        st.floats(-3, 3),
        TRIPLE,
        st.none() | TRIPLE,
    )
    | st.builds(ExternalPose, *[TIME, NUMBER, NUMBER, NUMBER, NUMBER, NUMBER, NUMBER, NUMBER])
)


@settings(max_examples=examples(60), deadline=None)
@given(st.lists(RECORD, max_size=40), st.integers(0, 20))
def test_no_records_in_any_order_raise_or_give_a_pose_that_is_no_number(
    records: list[WheelCounts | Attitude | ExternalPose], every: int
) -> None:
    ring = AttitudeRing(0, 0, 0)
    odometry = Odometry(ring, 0.15, 500, 1.0, TRACK_M)
    for k, record in enumerate(records):
        match record:
            case WheelCounts():
                odometry.add(record)
            case Attitude():
                ring.add(record)
            case ExternalPose():
                odometry.add_external(record)
        if every == 0 or k % every == 0:
            odometry.settle()
        for at_s in (0.05 * k, odometry.newest_s):
            if pose := odometry.maybe_pose(at_s):
                told = (pose.x_m, pose.y_m, pose.yaw_rad, odometry.v_mps, odometry.w_radps)
                assert all(map(math.isfinite, told))
        assert np.isfinite(odometry.covariance).all()


def on_rail(robot: Robot) -> Robot:
    """It has one encoder alone: nothing turns the other one."""
    robot.odometry = Odometry(robot.ring, 0.15, 500, 1.0, TRACK_M, on_rail=True)
    before = robot.odometry.add
    robot.odometry.add = lambda counts: before(  # type: ignore[method-assign]
        WheelCounts(counts.t_s, counts.left, 0.0, counts.restarts)
    )
    return robot


def test_on_a_rail_one_counter_tells_the_way_and_the_body_keeps_its_course() -> None:
    errors = Errors(
        gyro_bias=math.radians(0.3), yaw_noise=math.radians(0.3), wander=math.radians(2)
    )
    robot = on_rail(Robot(ramp, lambda t_s: 0.0, errors))
    robot.drive(60)
    x_m, y_m = robot.odometry.xy_at(robot.t_s)
    assert robot.x_m > 20
    assert x_m == pytest.approx(robot.x_m, abs=0.02)
    assert abs(y_m) < 0.05
    assert abs(robot.yaw_error_rad) < math.radians(0.5)
    assert robot.odometry.breaks == 0


def test_a_cart_that_turns_has_left_its_rail_and_begins_a_map_on_another_course() -> None:
    robot = on_rail(Robot(ramp, lambda t_s: 0.5 * (10.0 < t_s <= 11.0), Errors()))
    robot.drive(10)
    assert robot.odometry.breaks == 0
    robot.drive(20)
    assert robot.odometry.breaks > 0
    assert "rail" in robot.odometry.broken_by
    breaks = robot.odometry.breaks
    robot.drive(20)
    assert robot.odometry.breaks == breaks
    assert abs(robot.yaw_error_rad) < math.radians(2.0)
