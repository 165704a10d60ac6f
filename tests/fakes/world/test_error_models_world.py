"""What upsets the sensors of the simulated robot: slipping wheels, steel; and ways to drive it."""

import math
from dataclasses import replace

import numpy as np
import pytest

from fakes.mti.models import MODELS
from fakes.mti.sensor import Sensor
from fakes.scenes.scene import Scene, Solid
from fakes.world.driver import Driver
from fakes.world.kinematic import KinematicWorld
from fakes.world.magnetic import MagneticDisturbance, distortion
from fakes.world.rig import Rig
from fakes.world.slip import Slip
from fakes.world.trajectory import Trajectory, Way, held, stand, straight, turn
from fakes.world.world import World
from tests.support.flat_floor import F64, FLAT, FLOOR, driven, rims_m

DOOR = MagneticDisturbance("door", (5.0, 0.0), math.radians(40.0))
FIELD = np.array([0.4, 0.0, -0.9])


def quiet_sensor(world: KinematicWorld) -> Sensor:
    """The measuring part of an attitude sensor without noise, on a world with steel."""
    sensor = Sensor(world.motion_at, 1, MODELS["MTi-28"])
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
        R = sensor._sample(float(t_s), 0).R_earth_sensor
        errors.append(math.remainder(math.atan2(R[1, 0], R[0, 0]) - world.pose()[2], math.tau))
    return times_s, np.array(errors)


# -- wheel slip -------------------------------------------------------------------------------


def test_in_physics_slipping_wheels_count_more_and_the_robot_drives_as_before() -> None:
    slips = (Slip(0.05, 0.0), Slip(0.0, 0.10, 2.0, 4.0))
    dry, wet = (driven(scene, 6.0, 0.5, 0.5) for scene in (FLAT, replace(FLAT, slips=slips)))
    (left, right), (more_left, more_right) = rims_m(dry), rims_m(wet)
    assert wet.pose() == dry.pose()
    assert more_left / left == pytest.approx(1.05, abs=1e-9)
    assert more_right - right == pytest.approx(0.10 * 0.5 * 2.0, abs=2e-3)


# -- steel ------------------------------------------------------------------------------------


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


def test_steel_does_not_tilt_the_sensors_horizon() -> None:
    world = KinematicWorld(
        Scene("door", (FLOOR,), steels=(DOOR,)), held(0.1, -0.05, place=(5.0, 0.5, 1.0))
    )
    world.step_to(0.0)
    R = quiet_sensor(world)._sample(0.0, 0).R_earth_sensor
    np.testing.assert_allclose(R[2], world.motion_at(0.0)[0][2], atol=1e-9)


def test_the_magnetic_vector_is_the_bent_field_in_the_sensors_axes() -> None:
    place = (5.0, 1.0, math.radians(90.0))
    world = KinematicWorld(Scene("door", (FLOOR,), steels=(DOOR,)), held(place=place))
    world.step_to(0.0)
    bent = distortion((DOOR,), 5.0, 1.0) @ FIELD
    magnetic = quiet_sensor(world)._sample(0.0, 0).magnetic
    np.testing.assert_allclose(magnetic, [bent[1], -bent[0], bent[2]], atol=1e-9)


def test_the_pull_depends_on_the_way_and_not_on_how_often_the_sensor_is_read() -> None:
    way = Way(stand(2.0), turn(1.0, 0.5), straight(3.0, 0.5))
    ends = []
    for step_s in (0.01, 0.04):
        world = KinematicWorld(Scene("door", (FLOOR,), steels=(DOOR,)), way)
        world.step_to(0.0)
        sensor = quiet_sensor(world)
        for t_s in np.arange(0.0, 12.0001, step_s):
            world.step_to(float(t_s))
            R = sensor._sample(float(t_s), 0).R_earth_sensor
        ends.append(math.atan2(R[1, 0], R[0, 0]))
    assert ends[0] == pytest.approx(ends[1], abs=1e-3)


@pytest.mark.parametrize("steels", [(), (DOOR,)])
def test_the_rig_brings_the_steel_to_the_sensor(steels: tuple[MagneticDisturbance, ...]) -> None:
    world = KinematicWorld(Scene("door", (FLOOR,), steels=steels), held(place=(5.0, 0.0, 0.0)))
    rig = Rig(world, 1)
    rig.step(0.0)
    R = rig.ahrs._sample(0.0, 0).R_earth_sensor
    wrong_deg = math.degrees(math.atan2(R[1, 0], R[0, 0]))
    assert wrong_deg == pytest.approx(-40.0 if steels else 0.0, abs=0.5)


# -- ways to drive ----------------------------------------------------------------------------


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
