"""A wall's line, from segments of frames."""

import numpy as np
import pytest

from core.objects.vector_map.object_map import ObjectMap
from core.objects.vector_map.walls import Wall
from core.records import F64
from tools.experiments.object_world import SETTINGS, Noise, World

SIGMA_M = 0.012  # of a segment's end


def seen(wall: Wall | None, from_m: float, to_m: float, noise: F64, at_s: float) -> Wall:
    """One segment of a wall along x."""
    segment = np.array([from_m, noise[0], to_m, noise[1]])
    wall = wall or Wall(1, segment, at_s, SETTINGS)
    wall.hit(segment, segment, at_s)
    return wall


@pytest.mark.parametrize("seed", range(4))
def test_what_is_seen_of_one_end_does_not_turn_the_other_away(seed: int) -> None:
    """Twenty metres, seen piece by piece, then two metres of its end for half a minute."""
    random, wall = np.random.default_rng(seed), None
    for k in range(180):
        at_m = 0.1 * k
        wall = seen(wall, at_m, at_m + 2.0, SIGMA_M * random.standard_normal(2), 0.1 * k)
    for k in range(120):
        wall = seen(wall, 18.0, 20.0, SIGMA_M * random.standard_normal(2), 18.0 + 0.25 * k)
    assert wall is not None
    [segment] = wall.record().segments
    assert segment[[0, 2]] == pytest.approx([0.4, 20.0], abs=0.06)  # before it too few saw it
    assert np.abs(segment[[1, 3]]).max() < 0.02


def test_a_wall_is_where_the_poses_had_it_in_the_mean_and_not_where_it_was_first() -> None:
    """A frame is fitted to the map before, and lies on its wall then, wherever that is."""
    first = np.array([0.0, 0.03, 3.0, 0.03])
    wall = Wall(1, first, 0.0, SETTINGS)
    wall.hit(first, first, 0.0)
    for k in range(1, 60):
        on_map = wall.record().segments[0] if len(wall.record().segments) else first
        told = on_map * [1.0, 0.0, 1.0, 0.0]  # in truth it is at 0
        wall.hit(on_map, told, 0.1 * k)
    assert np.abs(wall.record().segments[0][[1, 3]]).max() < 0.003


@pytest.mark.parametrize("half_m", [1.47, 1.5, 1.52])
def test_a_walls_ends_do_not_grow_with_the_noise_of_the_pose(half_m: float) -> None:
    noise = Noise(pose_m=0.03, pose_rad=0.005, hull_m=0.005, missing=0.02)
    world, objects = World([], noise=noise), ObjectMap(SETTINGS)
    world.walls = np.array([[3.0, -half_m, 3.0, half_m]])
    for _ in range(300):
        objects.update(world.frame(0.0, 0.0, 0.0))
    [wall] = objects.walls.records()
    [segment] = wall.segments
    assert np.abs(segment[[1, 3]]).max() < half_m + 0.5 * SETTINGS.wall_cell_m + 0.01
    assert segment[3] - segment[1] > 2.0 * half_m - SETTINGS.wall_cell_m
