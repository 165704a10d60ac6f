"""The world whose robot moves as it is told: motions, what sensors feel, wheels, terrain."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fakes.scenes.scene import Scene, Solid
from fakes.scenes.solids import Shape, bump
from fakes.world import robot
from fakes.world.kinematic import KinematicWorld
from fakes.world.rotations import R_from_angles
from fakes.world.slip import Slip
from fakes.world.trajectory import (
    Gait,
    Leg,
    Trajectory,
    Way,
    arc,
    held,
    knots,
    laps,
    nodding,
    stand,
    straight,
    turn,
    walking,
)
from tests.support.cases import examples
from tests.support.robot.flat_floor import F64, FLAT, FLOOR, TILT, rims_m

LEGS = st.one_of(
    st.builds(straight, st.floats(-3.0, 3.0), st.floats(0.1, 1.0)),
    st.builds(turn, st.floats(-4.0, 4.0), st.floats(0.1, 1.0)),
    st.builds(arc, st.floats(2.0, 3.0), st.floats(-3.0, 3.0), st.floats(0.1, 0.6)),
    st.builds(stand, st.floats(0.0, 2.0)),
)


def moved(
    trajectory: Trajectory, end_s: float, scene: Scene = FLAT, follows: bool = False
) -> KinematicWorld:
    """A world that began at 100 s and has come so far."""
    world = KinematicWorld(scene, trajectory, follows)
    world.step_to(100.0)
    world.step_to(100.0 + end_s)
    return world


def ramp(slope_deg: float, begin_m: float = 2.0) -> tuple[Shape, ...]:
    """A floor, a ramp along x, and a floor at its other end, 10 m on."""
    rise_m = 10.0 * math.tan(math.radians(slope_deg))
    low, end_m = min(rise_m, 0.0) - 1.0, begin_m + 10.0
    return (
        Solid("before", (-9.0, begin_m), (-5.0, 5.0), (low, 0.0)),
        Solid("ramp", (begin_m, end_m), (-5, 5), (low, 0.0), rise_x_rad=math.radians(slope_deg)),
        Solid("beyond", (end_m, 40.0), (-5.0, 5.0), (low, rise_m)),
    )


@settings(max_examples=examples(40))
@given(legs=st.lists(LEGS, min_size=1, max_size=4))
def test_a_way_ends_where_its_legs_lead_and_never_jumps(legs: list[Leg]) -> None:
    way = Way(*legs)
    t_s = np.linspace(-1.0, way.duration_s + 1.0, 4000)
    poses = way(t_s)
    turned = sum(leg.turned_rad for leg in legs)
    assert poses[-1, 2] == pytest.approx(turned, abs=1e-9)
    speeds = np.abs(np.diff(poses, axis=0)) / (t_s[1] - t_s[0])
    assert speeds.max() < 1.3
    np.testing.assert_array_equal(poses[0], 0.0)
    gone = np.hypot(*np.diff(poses[:, :2], axis=0).T).sum()
    assert gone == pytest.approx(sum(abs(leg.length_m) for leg in legs), abs=2e-3)


def test_a_walking_body_sways_about_its_way_and_comes_round_again_and_again() -> None:
    way = laps(((1.0, 0.0), (1.0, 1.0)), 0.2, 0.5, stands_s=2.0)
    t_s = np.arange(0.0, 120.0, 0.01)
    plain, swaying = way(t_s), walking(way, Gait(), 2.0)(t_s)
    largest = np.abs(swaying - plain).max(axis=0)
    one, three = math.radians(1.0), math.radians(3.0)
    assert largest == pytest.approx([0.0, 0.0, three, one, one, 0.005], rel=0.01)
    np.testing.assert_array_equal(swaying[t_s <= 2.0], 0.0)
    assert np.abs(np.diff(swaying, axis=0)).max() < 0.01  # never jumps
    at_origin = np.flatnonzero(np.hypot(*plain[:, :2].T) < 1e-3)
    assert plain[at_origin[0], 2] == 0.0
    laps_gone = plain[at_origin[-1], 2] / math.tau
    assert laps_gone > 2.0
    with pytest.raises(ValueError, match="a corner away from the origin"):
        laps((), 0.2, 0.5, 2.0)


def test_a_turn_stays_on_the_spot_and_an_arc_on_its_circle() -> None:
    left = Way(turn(math.radians(92.0), 0.4))
    poses = left(np.linspace(0.0, 10.0, 500))
    np.testing.assert_array_equal(poses[:, :2], 0.0)
    assert math.degrees(poses[-1, 2]) == pytest.approx(92.0)
    quarter = Way(arc(math.pi, math.pi / 2, 0.5), start=(1.0, 2.0, 0.0))
    points = quarter(np.linspace(0.0, 20.0, 500))[:, :2]
    np.testing.assert_allclose(np.hypot(*(points - [1.0, 4.0]).T), 2.0, atol=1e-9)
    np.testing.assert_allclose(points[-1], [3.0, 4.0], atol=1e-9)


def test_knots_are_met_from_rest_to_rest() -> None:
    rows = [(1.0, 0, 0, 0, 0, 0, 0), (2.0, 1, 2, 0.3, 0.1, -0.1, 0.2), (4.0, 1, 2, 0, 0, 0, 0)]
    through = knots(rows)
    np.testing.assert_allclose(through(np.array([r[0] for r in rows])), [r[1:] for r in rows])
    around = through(np.array([0.0, 1.0005, 1.9995, 2.0005, 9.0]))
    np.testing.assert_allclose(around[[0, 1]], 0.0, atol=1e-8)
    np.testing.assert_allclose(around[[2, 3]], [rows[1][1:]] * 2, atol=1e-8)
    np.testing.assert_allclose(around[4], rows[2][1:])
    with pytest.raises(ValueError, match="rows of"):
        knots([(1.0, 0, 0)])
    with pytest.raises(ValueError, match="is a turn"):
        arc(0.0, 1.0, 0.5)
    with pytest.raises(ValueError, match="order of time"):
        knots([(1.0, 0, 0, 0, 0, 0, 0), (1.0, 0, 0, 0, 0, 0, 0)])


MOTIONS: dict[str, Trajectory] = {
    "slalom": Way(stand(0.5), arc(2.0, 1.0, 0.6), arc(2.0, -1.5, 0.6)),
    "nodding drive": nodding(Way(straight(5.0, 0.5)), math.radians(3.0), 1.0, 1.0),
    "all at once": knots(
        [(0, 0, 0, 0, 0, 0, 0), (3, 1, -1, 2.0, 0.2, -0.3, 0.1), (6, 2, 1, 4.0, -0.2, 0.2, 0)]
    ),
}


@pytest.mark.parametrize("name", MOTIONS)
def test_the_sensor_feels_the_bodys_rate_of_turn_and_its_sites_acceleration(name: str) -> None:
    """R(t + h) is R(t - h) turned by 2 h times the rate, along the body's axes."""
    world, h, largest = moved(MOTIONS[name], 7.0), 0.02, 0.0

    def site(t_s: float) -> F64:
        x, y, yaw, pitch, roll = (np.array([part]) for part in world.pose(t_s))
        offset = R_from_angles(yaw, pitch, roll)[0] @ [0.0, 0.0, 0.30]
        return np.asarray(np.array([x[0], y[0], world.height_m(t_s)]) + offset)

    for t_s in np.arange(100.6, 105.5, 0.173).tolist():
        R_earth_sensor, rate, force = world.motion_at(t_s)
        turned = world.motion_at(t_s - h / 2)[0].T @ world.motion_at(t_s + h / 2)[0]
        odd = turned - turned.T
        np.testing.assert_allclose(
            np.array([odd[2, 1], odd[0, 2], odd[1, 0]]) / (2 * h), rate, atol=2e-3
        )
        pulled = (site(t_s - h) - 2 * site(t_s) + site(t_s + h)) / h**2 + [0.0, 0.0, 9.81]
        np.testing.assert_allclose(R_earth_sensor @ force, pulled, atol=0.03)
        largest = max(largest, float(np.abs(rate).max()))
    assert largest > 0.2


@pytest.mark.parametrize(("pitch_deg", "roll_deg"), [(-4.5, 0.0), (2.5, 0.0), (0.0, -5.2)])
def test_a_robot_can_stand_tilted(pitch_deg: float, roll_deg: float) -> None:
    pitch, roll = math.radians(pitch_deg), math.radians(roll_deg)
    world = moved(held(pitch, roll, 0.02), 2.0)
    assert world.pose() == pytest.approx((0.0, 0.0, 0.0, pitch, roll))
    assert world.height_m() == 0.02
    assert rims_m(world) == (0.0, 0.0)
    R_earth_sensor, rate, force = world.motion_at(101.0)
    np.testing.assert_allclose(rate, 0.0, atol=1e-12)
    np.testing.assert_allclose(R_earth_sensor @ force, [0.0, 0.0, 9.81], atol=1e-9)
    [straight_m] = world.ranges_m(np.array([101.0]), np.zeros(1))
    down = R_from_angles(np.zeros(1), np.array([pitch]), np.array([roll]))[0]
    lens_z = 0.02 + (down @ robot.LENS_BODY_M)[2]
    fall = -(down @ [math.cos(TILT), 0.0, -math.sin(TILT)])[2]
    assert straight_m == pytest.approx(lens_z / fall, abs=1e-6)


def test_the_encoders_count_the_way_and_the_turn_and_more_where_wheels_slip() -> None:
    """A way gets to its speed softly: 4.2 m at 0.2 m/s take 0.8 s more than at once."""
    way = Way(stand(1.0), straight(4.2, 0.2), straight(-2.0, 0.5), turn(math.radians(92.0), 0.4))
    assert way.begins_s[2] == pytest.approx(1.0 + 4.2 / 0.2 + math.pi / 2 * 0.2 / 0.4)
    world = moved(way, way.duration_s + 1.0)
    rim_m = math.radians(92.0) * 0.25
    assert rims_m(world) == pytest.approx((2.2 - rim_m, 2.2 + rim_m), abs=1e-6)
    assert world.pose()[0] == pytest.approx(2.2)
    way = Way(straight(4.2, 0.2))
    slips = (Slip(4.4 / 4.2 - 1.0, 4.4 / 4.2 - 1.0), Slip(0.0, 0.2, 10.0, 12.0))
    world = moved(way, way.duration_s, Scene("slippery", (FLOOR,), slips=slips))
    assert rims_m(world) == pytest.approx((4.4, 4.4 + 0.2 * 0.2 * 2.0), abs=1e-3)
    assert world.pose()[0] == pytest.approx(4.2)


@pytest.mark.parametrize("slope_deg", [-8.0, 5.0])
def test_on_a_ramp_the_body_is_pitched_by_its_slope(slope_deg: float) -> None:
    way = Way(straight(16.0, 1.0))
    world = moved(way, way.duration_s, Scene("ramp", ramp(slope_deg)), follows=True)
    heights, on_it = [], 0
    for t_s in np.arange(100.0, 100.0 + way.duration_s, 0.1):
        x, y, _, pitch, roll = world.pose(float(t_s))
        assert roll == pytest.approx(0.0, abs=1e-9)
        if 2.3 < x < 11.3:  # all wheels are on it, with what the smoothing takes
            on_it += 1
            assert math.degrees(pitch) == pytest.approx(-slope_deg, abs=2e-3)
            ground = world.height_at([x], [y])[0]
            assert world.height_m(float(t_s)) == pytest.approx(ground, abs=1e-4)
        if x < 1.3 or x > 12.5:
            assert math.degrees(pitch) == pytest.approx(0.0, abs=1e-6)
        heights.append(world.height_m(float(t_s)))
    assert on_it > 40
    assert heights[-1] == pytest.approx(10.0 * math.tan(math.radians(slope_deg)), abs=1e-9)
    # along the slope, not along its ground plan
    along_m = 6.0 + 10.0 / math.cos(math.radians(slope_deg))
    assert rims_m(world) == pytest.approx((along_m, along_m), abs=0.05)


def test_on_a_bump_the_body_nods_and_rises_and_on_a_slope_across_the_way_it_rolls() -> None:
    over = bump("bump", (3.0, 3.4), (-2.0, 2.0))
    way = Way(straight(5.0, 1.0))
    world = moved(way, way.duration_s, Scene("bump", (FLOOR, over)), follows=True)
    times_s = np.arange(100.0, 100.0 + way.duration_s, 0.01)
    pitches = np.degrees([world.pose(t)[3] for t in times_s])
    heights = np.array([world.height_m(t) for t in times_s])
    assert pitches.min() == pytest.approx(-7.1, abs=0.3)  # asin(0.05 / 0.40)
    assert pitches.max() == pytest.approx(7.1, abs=0.3)
    assert heights.max() == pytest.approx(0.05, abs=0.002)
    assert abs(pitches[-1]) < 1e-6
    forces = np.array([world.motion_at(t)[2] for t in times_s])
    assert 12.0 < forces[:, 2].max() < 45.0  # a jolt, within what the sensor can measure
    side = Solid("side", (-9.0, 20.0), (-5.0, 5.0), (-2.0, -0.5), rise_rad=math.radians(6.0))
    world = moved(Way(straight(3.0, 0.5)), 5.0, Scene("side", (side,)), follows=True)
    assert np.degrees(world.pose()[3:]) == pytest.approx([0.0, 6.0], abs=0.01)  # left is higher


def test_it_is_the_same_to_the_bit_however_it_is_stepped_and_asked() -> None:
    bearings = np.linspace(-1.0, 1.0, 100)
    results = []
    for steps in (1, 7, 100):
        world = KinematicWorld("corridor", MOTIONS["slalom"], follows=True)
        for t_s in np.linspace(50.0, 55.0, steps + 1):
            world.step_to(float(t_s))
            world.pose()
        times_s = 52.0 + np.linspace(0.0, 0.02, 100)
        results.append((*world.pose(), *world.wheels.counts(), *world.ranges_m(times_s, bearings)))
    assert len({str(result) for result in results}) == 1


def test_any_instant_has_an_answer_and_the_future_is_not_told() -> None:
    world = moved(MOTIONS["slalom"], 3.0)
    for t_s in (-10.0, 99.9, 100.0, 101.2345, 103.0, 103.001, 200.0):
        assert np.isfinite(world.pose(t_s)).all()
        assert world.pose(t_s) == world.pose(min(max(t_s, 100.0), 103.0))


@pytest.mark.slow
def test_ten_minutes_are_kept_and_what_was_before_is_no_burden() -> None:
    way = laps(((2.0, 0.0), (2.0, 1.0)), 0.4, 0.5, stands_s=1.0)
    kept, young = KinematicWorld(FLAT, way), KinematicWorld(FLAT, way)
    for world in (kept, young):
        world.step_to(100.0)
    young.step_to(100.0 + 1300.0)
    sizes = []
    for minute in range(1, 41):
        kept.step_to(100.0 + 60.0 * minute)
        kept.pose()
        sizes.append(kept._rows.nbytes)
        if minute == 21:  # it has forgotten some by now
            assert kept.pose(100.0 + 1200.0) == young.pose(100.0 + 1200.0)
            assert kept.wheel_angles_rad() != (0.0, 0.0)
    assert max(sizes) == sizes[25] < 160e6
    now_s = 100.0 + 60.0 * 40
    x, y = way(np.array([now_s - 599.0 - 100.0]))[0, :2]  # by the trajectory itself
    assert kept.pose(now_s - 599.0)[:2] == pytest.approx((x, y), abs=1e-5)
    with pytest.raises(ValueError, match=r"known from \d+\.\d+ s on, not at 110\.000"):
        kept.pose(110.0)
