"""The world: its heights, its robot and its rays, held against plain geometry."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fakes.scenes.scene import Scene, Solid, load_scene
from fakes.world.error_models import ErrorModels, as_the_sheets_say
from fakes.world.rig import Rig
from fakes.world.robot import SMALL, Mount
from fakes.world.rotations import R_from_angles
from fakes.world.world import STEP_S, World
from tests.support.robot.flat_floor import F64, FLAT, FLOOR, TILT, driven, rims_m

EDGE = Scene("edge", (FLOOR, Solid("edge", (1.0, 15.0), (-15.0, 15.0), (0.0, 0.03))))
SWEEP_RAD = np.radians(np.linspace(-135.0, 135.0, 1081))
END_S = 53.0
SWEEP_S = 0.03  # from the first beam to the last


def sweep(world: World, end_s: float) -> F64:
    """Ranges of a whole sweep whose last beam leaves at end_s."""
    return world.ranges_m(end_s - np.linspace(SWEEP_S, 0.0, SWEEP_RAD.size), SWEEP_RAD)


def test_the_corridor_is_as_high_as_its_file_says() -> None:
    ramp, side = math.tan(math.radians(6.0)), math.tan(math.radians(1.0))
    x = [12.0, 12.1, 2.1, 5.0, 0.0, 6.0, 11.0, 0.0]
    y = [0.3, 0.3, 0.0, -1.5, 2.1, 10.07, 12.0, 9.0]
    heights = [0.0, -0.5, 0.006, 0.6, 2.5, 2.0 * ramp, 3.93 * side, math.nan]
    np.testing.assert_allclose(load_scene("corridor").height_at(x, y), heights, atol=1e-9)


def test_a_scene_can_be_any_file(tmp_path: Path) -> None:
    file = tmp_path / "slab.toml"
    file.write_text(
        "x_axis_east_of_north_deg = 90.0\n"
        '[[solid]]\nname = "floor"\nx = [-5, 5]\ny = [-5.0, 5.0]\nz = [-1.0, 0.0]\n'
    )
    world = World(file, 1)
    world.step_to(0.0)
    R_earth_sensor = world.motion_at(0.0)[0]
    np.testing.assert_allclose(R_earth_sensor[:, 0], [0.0, -1.0, 0.0], atol=1e-3)  # x is east


def test_on_a_flat_floor_each_beam_is_as_long_as_geometry_says() -> None:
    world = driven(FLAT, 1.0, 0.0, 0.0)
    pitch = world.pose()[3]
    used = np.abs(SWEEP_RAD) < math.radians(50.0)
    expected_m = 1.08 / (np.cos(SWEEP_RAD[used]) * math.sin(TILT + pitch))
    np.testing.assert_allclose(sweep(world, 51.0)[used], expected_m, atol=2e-3)
    assert abs(float(expected_m.min()) - 8.274) < 0.02


@pytest.mark.parametrize("walks", [False, True])
def test_the_lens_sits_where_it_is_told_to(walks: bool) -> None:
    scene = replace(FLAT, walks=walks, waypoints=((1.0, 0.0),))
    world = Rig(scene, 1, drives=False, scanner="urg04lx", mount=Mount(0.2, 0.0, 0.35, 55.0)).world
    world.step_to(50.0)
    down = math.radians(55.0) + world.pose()[3]
    [ahead_m] = world.ranges_m(np.full(1, 50.0), np.zeros(1))
    assert ahead_m == pytest.approx(0.35 / math.sin(down), abs=2e-3)


def test_every_beam_ends_where_the_ground_truth_begins() -> None:
    """Just before its end a beam is above the surface, just behind it is below."""
    world = World("corridor", 1)
    world.step_to(0.0)
    seen: list[F64] = []
    for k, (one, two) in enumerate([(0.8, 0.8)] * 9 + [(-0.2, 0.2)] * 3):
        world.wheels.set_power(one, two)
        world.step_to(k + 1.0)
        ranges = sweep(world, k + 1.0)
        for share in (-5e-3, 5e-3):
            points = points_map(world, k + 1.0, ranges + share)
            gap_m = points[2] - world.height_at(points[0], points[1])
            inside = np.isfinite(gap_m)
            assert inside.mean() > 0.9
            wrong = gap_m[inside] * share > 1e-5 * abs(share)
            assert wrong.mean() < 0.015  # corners, and walls that a beam grazes
        seen.append(points)
    x, y, z = np.concatenate(seen, axis=1)
    ramp = (x > 5.2) & (x < 7.6) & (y > 8.2) & (y < 11.0) & (z > 0.02)
    assert ramp.sum() > 100


def points_map(world: World, end_s: float, ranges: F64) -> F64:
    """Ends of a sweep's beams (3, n), each from the pose at its own instant."""
    instants_s = end_s - np.linspace(SWEEP_S, 0.0, SWEEP_RAD.size)
    x, y, *angles = np.array([world.pose(t_s) for t_s in instants_s.tolist()]).T
    ahead, left = ranges * np.cos(SWEEP_RAD), ranges * np.sin(SWEEP_RAD)
    body = np.stack([0.25 + ahead * math.cos(TILT), left, 1.08 - ahead * math.sin(TILT)], -1)
    z = [world.height_m(t_s) for t_s in instants_s.tolist()]
    return np.asarray((R_from_angles(*angles) @ body[:, :, None])[:, :, 0].T + np.array([x, y, z]))


def test_the_encoders_tell_the_way_channel_one_is_left_and_more_than_full_power_is_full() -> None:
    ahead = driven(FLAT, 12.0, 0.5, 0.5)
    way_m = math.hypot(*ahead.pose()[:2])  # nearly straight, whatever the motors' strength
    assert way_m > 5.0
    assert abs(sum(rims_m(ahead)) / 2 / way_m - 1) < 0.01
    left, right = rims_m(driven(FLAT, 3.0, 9.0, -9.0))
    assert 2.5 < left < 3.1
    assert -3.1 < right < -2.5
    assert driven(FLAT, 1.0, 0.4, 0.0).pose()[2] < -0.3  # to the right


def test_the_body_nods_when_it_rolls_over_an_edge() -> None:
    world = World(EDGE, 1)
    pitches = []
    for k in range(400):
        world.wheels.set_power(0.4, 0.4)
        world.step_to(k * 0.01)
        pitches.append(world.pose()[3])
    world.step_to(8.0)
    assert world.pose()[0] > 2.0
    assert abs(world.height_m() - 0.03) < 1e-3  # it has climbed it
    assert math.degrees(min(pitches)) < -3.0  # the casters are up, the wheels not yet
    assert abs(math.degrees(pitches[0])) < 0.05


def test_two_worlds_of_one_seed_are_the_same_to_the_bit_however_they_are_stepped() -> None:
    errors = as_the_sheets_say(
        ErrorModels(sunlight_rate=0.1, dust_per_m=0.01, slip_bursts_per_min=60.0)
    )
    worlds = [World("corridor", 7, errors), World("corridor", 7, errors)]
    results = []
    for world, steps in zip(worlds, (500, 1900), strict=True):
        world.step_to(10.0)
        world.wheels.set_power(0.6, 0.5)
        for t_s in np.linspace(10.0, 14.0, steps):
            world.step_to(float(t_s))
        results.append((*world.pose(), *world.wheels.counts(), sweep(world, 14.0).tolist()))
    assert str(results[0]) == str(results[1])
    assert driven(FLAT, 1.0, 0.5, 0.5, seed=1).pose() != driven(FLAT, 1.0, 0.5, 0.5, seed=2).pose()


def test_the_past_does_not_change_when_it_is_asked_later() -> None:
    world = driven("corridor", 2.0, -0.2, 0.3)
    first = sweep(world, 52.0), world.pose(51.95)
    world.step_to(52.3)
    later = sweep(world, 52.0), world.pose(51.95)
    np.testing.assert_allclose(later[0], first[0], atol=1e-9)
    np.testing.assert_allclose(later[1], first[1], atol=1e-9)


def test_the_robot_rests_level_at_the_origin_and_its_attitude_sensor_knows_north() -> None:
    world = driven("corridor", 1.0, 0.0, 0.0)
    assert np.abs([*world.pose()[:3], world.height_m()]).max() < 1e-4
    assert np.abs(world.pose()[3:]).max() < math.radians(0.05)
    R_earth_sensor, rate_radps, force_mps2 = world.motion_at(51.0)
    east_of_north = math.atan2(-R_earth_sensor[1, 0], R_earth_sensor[0, 0])
    assert abs(math.degrees(east_of_north) - 20.0) < 0.1
    np.testing.assert_allclose(R_earth_sensor @ R_earth_sensor.T, np.eye(3), atol=1e-9)
    np.testing.assert_allclose(rate_radps, 0.0, atol=1e-3)
    np.testing.assert_allclose(force_mps2, [0.0, 0.0, 9.81], atol=0.02)


def test_instants_are_where_the_robot_was_then_and_the_rate_of_turn_is_the_yaws_slope() -> None:
    moving = driven(FLAT, END_S - 50.0, 0.4, 0.4)
    ahead = moving.pose(END_S)[0] - moving.pose(END_S - 0.1)[0]
    assert abs(ahead - 0.04) < 0.002
    between = moving.pose(END_S - 0.1 + STEP_S / 2)[0] - moving.pose(END_S - 0.1)[0]
    assert abs(between - 0.4 * STEP_S / 2) < 2e-5
    for offset_s in (-5.0, -1.0, 5.0):
        assert np.isfinite(moving.pose(END_S + offset_s)).all()
        assert np.isfinite(moving.motion_at(END_S + offset_s)[0]).all()
    turning = driven(FLAT, END_S - 50.0, -0.1, 0.1)
    slope = (turning.pose(52.9)[2] - turning.pose(52.7)[2]) / 0.2
    rates = [turning.motion_at(t)[1][2] for t in np.linspace(52.7, 52.9, 50)]
    assert float(np.mean(rates)) == pytest.approx(slope, rel=0.01)
    assert slope > 0.3


def test_the_small_robot_rests_level_and_drives_as_its_wheels_are() -> None:
    world = World("corridor", 1, body=SMALL)
    world.step_to(1000.0)
    world.step_to(1001.0)
    world.wheels.set_power(0.3, 0.3)
    world.step_to(1003.0)
    x_m, y_m, *angles = world.pose()
    assert 0.4 < x_m < 0.62  # 2 s at 0.3 m/s, less the time to get there
    assert world.wheels.counts()[0] / 2000 * math.tau * SMALL.wheel_radius_m == pytest.approx(
        x_m, rel=0.05
    )
    assert abs(y_m) < 0.02
    assert max(map(abs, angles)) < 0.02
    assert abs(world.height_m()) < 0.002
