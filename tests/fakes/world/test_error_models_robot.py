"""Errors of the robot: its attitude sensor, steel, slip, slippery ground; people in its way."""

import math
from dataclasses import replace

import numpy as np
import pytest

from fakes.mti.device import FakeMti
from fakes.mti.errors import HEADING_RAD, STATIC_RAD, SheetErrors
from fakes.mti.messages import EULER, orientation
from fakes.scenes.scene import Scene, Solid
from fakes.world.crowd import Walker
from fakes.world.driver import Driver
from fakes.world.error_models import ErrorModels, Patch
from fakes.world.kinematic import KinematicWorld
from fakes.world.magnetic import MagneticDisturbance, distortion
from fakes.world.rig import Rig
from fakes.world.slip import BURST_S, BURST_SHARE, BURSTS_UNTIL_S, Slip, bursts
from fakes.world.trajectory import Trajectory, Way, held, stand, straight, turn
from fakes.world.world import World
from tests.support.robot.flat_floor import F64, FLAT, FLOOR, driven, rims_m

DOOR = MagneticDisturbance("door", (5.0, 0.0), math.radians(40.0))
FIELD = np.array([0.4, 0.0, -0.9])


def errors_deg(trajectory: Trajectory, seconds: float, seed: int) -> F64:
    """Errors (n, 3) of yaw, pitch, roll of a sensor on a robot that drives, 50 a second."""
    world = KinematicWorld(FLAT, trajectory)
    world.step_to(0.0)
    sensor, rows = FakeMti(world.motion_at, seed), []
    sensor.sheet_errors, sensor.angle_noise_rad = True, 0.0
    for t_s in np.arange(0.0, seconds, 0.02).tolist():
        world.step_to(t_s)
        told = np.radians(orientation(sensor.sensor.sample(t_s).R_earth_sensor, EULER)[::-1])
        true = world.pose()[2:]
        rows.append([math.remainder(a - b, math.tau) for a, b in zip(told, true, strict=True)])
    return np.degrees(rows)


def test_at_rest_the_sensor_is_off_by_no_more_than_its_sheet_says() -> None:
    off = np.array([errors_deg(held(), 0.02, seed)[-1] for seed in range(40)])
    assert np.percentile(np.abs(off[:, 1:]), 90) < 0.5
    assert 0.15 < off[:, 1:].std() < 0.35
    assert np.percentile(np.abs(off[:, 0]), 90) < 1.0
    assert (np.abs(off).max(axis=0) > 0.2).all()
    assert math.degrees(STATIC_RAD) == 0.5
    assert math.degrees(HEADING_RAD) == 1.0


def test_a_brake_makes_it_take_the_robot_for_leaning_and_it_forgets_that_again() -> None:
    ends_s = 4.25  # 1.25 s of speeding up, on at 1 m/s, 1.25 s of braking

    def brake(t_s: F64) -> F64:
        up, down = np.clip(t_s, 0.0, 1.25), np.clip(t_s - 3.0, 0.0, 1.25)
        x = 0.4 * up**2 + np.maximum(0.0, t_s - 1.25) - 0.4 * down**2
        x -= np.maximum(0.0, t_s - ends_s)
        zero = np.zeros_like(x)
        return np.column_stack([x, zero, zero, zero, zero, zero])

    pitch = np.mean([errors_deg(brake, 12.0, seed)[:, 1] for seed in range(3)], axis=0)
    pitch = pitch - pitch[0]
    assert 0.7 < pitch[round(50 * ends_s)] - pitch[149] < 1.6  # nose down, by a degree
    assert abs(pitch[-1] - pitch[0]) < 0.4


def test_rates_have_a_bias_that_stays_for_seconds_and_wanders_in_minutes() -> None:
    biases, late = [], []
    up, level = np.array([0.0, 0.0, 9.81]), np.eye(3)
    for seed in range(40):
        errors = SheetErrors(seed)
        errors.goes_on(0.0, level, up)
        first = errors.rate_bias_radps
        errors.goes_on(0.01, level, up)
        assert np.abs(errors.rate_bias_radps - first).max() < math.radians(0.005)
        for t_s in np.arange(1.0, 400.0).tolist():
            errors.goes_on(t_s, level, up)
        biases.append(first)
        late.append(errors.rate_bias_radps - first)
    assert math.degrees(float(np.std(biases))) == pytest.approx(0.104, rel=0.2)
    assert math.degrees(float(np.std(late))) == pytest.approx(0.03 * math.sqrt(2), rel=0.25)


def test_an_instant_that_is_asked_twice_changes_nothing() -> None:
    up, level, told = np.array([1.0, 0.0, 9.81]), np.eye(3), []
    for times_s in ((0.0, 0.5, 0.5, 0.3), (0.0, 0.5)):
        errors = SheetErrors(1)
        for t_s in times_s:
            errors.goes_on(t_s, level, up)
        told.append(errors.orientation(level))
    np.testing.assert_array_equal(told[0], told[1])


def test_bursts_of_slip_come_as_often_as_told_and_are_those_of_the_seed() -> None:
    slips = bursts(2.0, 5)
    assert len(slips) == pytest.approx(2.0 * BURSTS_UNTIL_S / 60, rel=0.35)
    assert slips == bursts(2.0, 5) != bursts(2.0, 6)
    assert bursts(0.0, 5) == ()
    for slip in slips:
        assert BURST_S[0] <= slip.until_s - slip.from_s <= BURST_S[1]
        assert BURST_SHARE[0] <= max(slip.left, slip.right) <= BURST_SHARE[1]


def test_on_slippery_ground_wheels_spin_and_the_robot_gets_less_far() -> None:
    dry, ice = (driven(replace(FLAT, friction=share), 2.0, 1.0, 1.0) for share in (1.0, 0.05))
    (dry_m, dry_turned_m), (ice_m, ice_turned_m) = (
        (world.pose()[0], sum(rims_m(world)) / 2) for world in (dry, ice)
    )
    assert dry_turned_m == pytest.approx(dry_m, rel=0.02)
    assert ice_m < 0.7 * dry_m
    assert ice_turned_m > 1.2 * ice_m


def test_a_patch_of_ice_lets_the_robot_slide_on_where_it_brakes_and_nowhere_else() -> None:
    stops = []
    for x in ((2.0, 9.0), (20.0, 25.0)):
        scene = replace(FLAT, patches=(Patch("ice", x, (-2.0, 2.0), 0.03),))
        world = driven(scene, 3.2, 1.0, 1.0)
        world.wheels.set_power(0.0, 0.0)
        world.step_to(56.0)
        stops.append(world.pose()[0])
    assert stops[0] > stops[1] + 0.3


@pytest.mark.parametrize("x", [4.0, 7.0])
def test_people_who_give_way_are_in_the_beams_where_the_world_says_that_they_are(x: float) -> None:
    walkers = (Walker("one", ((x, -2.0), (x, 2.0)), start_s=0.5),)
    world = World(replace(FLAT, walkers=walkers), 1)
    for k in range(1, 120):
        world.step_to(10.0 + 0.05 * k)
        [[x, y, radius]] = world.people()
        away_m, fan = math.hypot(x - 0.25, y), np.linspace(-0.35, 0.35, 41)
        bearings = math.atan2(y, x - 0.25) + fan / away_m
        ranges_m = world.ranges_m(np.full(41, 10.0 + 0.05 * k), bearings)
        near_m = ranges_m.min() * math.cos(math.radians(7.5))
        assert away_m - radius - 0.25 < near_m < away_m + 0.1  # legs swing about the torso
    assert len(World(FLAT, 1).people()) == 0


def quiet_sensor(world: KinematicWorld) -> FakeMti:
    """The measuring part of an attitude sensor without noise, on a world with steel."""
    sensor = FakeMti(world.motion_at, 1)
    sensor.angle_noise_rad = sensor.magnetic_noise = 0.0
    sensor.distortion_at = world.distortion_at
    return sensor


def yaw_errors(trajectory: Trajectory, seconds: float) -> tuple[F64, F64]:
    """Instants (n,), and by how much (n,) rad the yaw is off then, beside the door."""
    world = KinematicWorld(Scene("door", (FLOOR,), steels=(DOOR,)), trajectory)
    world.step_to(0.0)
    sensor, times_s, errors = quiet_sensor(world), np.arange(0.0, seconds, 0.02), []
    for t_s in times_s:
        world.step_to(float(t_s))
        R = sensor.sensor.sample(float(t_s)).R_earth_sensor
        errors.append(math.remainder(math.atan2(R[1, 0], R[0, 0]) - world.pose()[2], math.tau))
    return times_s, np.array(errors)


def test_in_physics_slipping_wheels_count_more_and_the_robot_drives_as_before() -> None:
    errors = ErrorModels(slip_bursts_per_min=60.0)
    slips = (Slip(0.05, 0.0), Slip(0.0, 0.10, 2.0, 4.0))
    scenes = FLAT, replace(FLAT, slips=slips), replace(FLAT, errors=errors)
    dry, wet, burst = (driven(scene, 6.0, 0.5, 0.5) for scene in scenes)
    (left, right), (more_left, more_right) = rims_m(dry), rims_m(wet)
    assert burst.pose() == wet.pose() == dry.pose()
    assert more_left / left == pytest.approx(1.05, abs=1e-9)
    assert more_right - right == pytest.approx(0.10 * 0.5 * 2.0, abs=2e-3)
    assert 1.005 < sum(rims_m(burst)) / (left + right) < 1.2


def test_steel_turns_the_field_and_changes_strength_and_dip_most_where_it_is() -> None:
    bent = distortion((DOOR,), 5.0, 0.0) @ FIELD
    assert math.degrees(math.atan2(bent[1], bent[0])) == pytest.approx(40.0)
    assert math.hypot(bent[0], bent[1]) == pytest.approx(0.4 * 1.3)
    assert bent[2] == pytest.approx(-0.9 * 0.7)
    turned = []
    for x in (5.0, 6.5, 8.0, 20.0):
        bent = distortion((DOOR,), x, 0.0) @ FIELD
        turned.append(math.degrees(math.atan2(bent[1], bent[0])))
    assert turned == pytest.approx([40.0, 40.0 / math.e, 40.0 / math.e**4, 0.0], abs=1e-3)


def test_beside_steel_the_yaw_is_pulled_slowly_and_comes_back_slowly() -> None:
    """A drive to the door, ten seconds beside it, and on; with a time constant of 3 s."""
    way = Way(stand(2.0), straight(5.0, 1.0), stand(10.0), straight(8.0, 1.0), stand(7.0))
    times_s, errors = yaw_errors(way, way.duration_s)
    degrees = np.degrees(errors)
    assert np.abs(degrees[times_s < 2.0]).max() < 0.1
    there_s, leaves_s, gone_s = way.begins_s[2:5]
    arrived, leaving = (float(np.interp(t, times_s, degrees)) for t in (there_s, leaves_s))
    assert -32.0 < arrived < -12.0  # north seems to lie to the left, so the robot to the right
    assert leaving == pytest.approx(-40.0 + (40.0 + arrived) * math.exp(-10.0 / 3.0), abs=0.2)
    gone = float(np.interp(gone_s, times_s, degrees))
    later = float(np.interp(gone_s + 6.0, times_s, degrees))
    assert -12.0 < gone < -2.0
    assert later == pytest.approx(gone * math.exp(-2.0), abs=0.05)
    assert np.abs(np.diff(degrees)).max() < 40.0 * 0.02 / 3.0 * 1.01  # never a jump


def test_the_magnetic_vector_is_the_bent_field_in_the_sensors_axes_and_the_horizon_stays() -> None:
    place = (5.0, 1.0, math.radians(90.0))
    for pitch, roll in ((0.0, 0.0), (0.1, -0.05)):
        world = KinematicWorld(
            Scene("door", (FLOOR,), steels=(DOOR,)), held(pitch, roll, place=place)
        )
        world.step_to(0.0)
        sample, R_true = quiet_sensor(world).sensor.sample(0.0), world.motion_at(0.0)[0]
        bent = distortion((DOOR,), 5.0, 1.0) @ FIELD
        np.testing.assert_allclose(sample.magnetic, R_true.T @ bent, atol=1e-9)
        np.testing.assert_allclose(sample.R_earth_sensor[2], R_true[2], atol=1e-9)


def test_the_pull_depends_on_the_way_and_not_on_how_often_the_sensor_is_read() -> None:
    way = Way(stand(2.0), turn(1.0, 0.5), straight(3.0, 0.5))
    ends = []
    for step_s in (0.01, 0.04):
        world = KinematicWorld(Scene("door", (FLOOR,), steels=(DOOR,)), way)
        world.step_to(0.0)
        sensor = quiet_sensor(world)
        for t_s in np.arange(0.0, 12.0001, step_s):
            world.step_to(float(t_s))
            R = sensor.sensor.sample(float(t_s)).R_earth_sensor
        ends.append(math.atan2(R[1, 0], R[0, 0]))
    assert ends[0] == pytest.approx(ends[1], abs=1e-3)


@pytest.mark.parametrize("steels", [(), (DOOR,)])
def test_the_rig_brings_the_steel_to_the_sensor(steels: tuple[MagneticDisturbance, ...]) -> None:
    world = KinematicWorld(Scene("door", (FLOOR,), steels=steels), held(place=(5.0, 0.0, 0.0)))
    rig = Rig(world, 1)
    rig.step(0.0)
    R = rig.ahrs.sensor.sample(0.0).R_earth_sensor
    wrong_deg = math.degrees(math.atan2(R[1, 0], R[0, 0]))
    assert wrong_deg == pytest.approx(-40.0 if steels else 0.0, abs=0.5)


def test_a_waypoint_can_have_its_own_speed() -> None:
    """On wheels that do at once what they are told."""
    x, speeds = 0.0, []

    def command(one: int, two: int) -> None:
        speeds.append((x, one / 127))

    driver = Driver(lambda: (x, 0.0, 0.0, 0.0, 0.0), command, [(3, 0, 0.2), (9, 0)], 0.6, 0.0)
    for k in range(3000):
        driver.step(k * 0.01)
        x += speeds[-1][1] * 0.01
    slow = [speed for place, speed in speeds if 1.0 < place < 2.0]
    fast = [speed for place, speed in speeds if 5.0 < place < 7.0]
    assert slow == pytest.approx([0.2] * len(slow), abs=0.005)
    assert fast == pytest.approx([0.6] * len(fast), abs=0.005)


@pytest.mark.parametrize("slope_deg", [-8.0, 8.0])
def test_in_physics_the_robot_drives_up_and_down_ramps_along_x(slope_deg: float) -> None:
    rise_m = 6.0 * math.tan(math.radians(slope_deg))
    low, rise_x_rad = min(rise_m, 0.0) - 1.0, math.radians(slope_deg)
    solids = (
        Solid("before", (-5.0, 1.0), (-3.0, 3.0), (low, 0.0)),
        Solid("ramp", (1.0, 7.0), (-3.0, 3.0), (low, 0.0), rise_x_rad=rise_x_rad),
        Solid("beyond", (7.0, 20.0), (-3.0, 3.0), (low, rise_m)),
    )
    world = World(Scene("ramp", solids), 1)
    world.step_to(0.0)
    world.wheels.set_power(0.8, 0.8)
    pitches = []
    for k in range(140):
        world.step_to(k * 0.1)
        if 2.0 < world.pose()[0] < 6.0:
            pitches.append(math.degrees(world.pose()[3]))
    # the slope shifts weight between casters and axle, and their springs give way
    assert np.mean(pitches) == pytest.approx(-slope_deg, rel=0.07)
    assert world.pose()[0] > 8.0
    assert world.height_m() == pytest.approx(rise_m, abs=2e-3)


@pytest.mark.slow
def test_the_yards_route_can_be_driven() -> None:
    """In physics: over the bump and both ramps, and back home."""
    world = World("yard", 3)

    def command(one: int, two: int) -> None:
        world.wheels.set_power(one / 127, two / 127)

    yard = world.scene
    driver = Driver(world.pose, command, yard.waypoints, yard.speed_mps, 3.0)
    now_s, heights, pitches = 0.0, [], []
    while driver.laps < 1 and now_s < 150.0:
        now_s += 0.02
        world.step_to(now_s)
        driver.step(now_s)
        heights.append(world.height_m())
        pitches.append(math.degrees(world.pose()[3]))
    assert driver.laps == 1
    assert 6.0 < max(pitches) < 9.0
    assert max(heights) == pytest.approx(3.0 * math.tan(math.radians(3.0)), abs=0.01)
