"""The shipped scenes of campaigns: each seed's start is honest, each goal can be reached."""

import functools
import math

import numpy as np
import pytest

from fakes.scenes.scene import Scene, campaign_scenes, load_scene
from tests.support.cases import few

NAMES = ("aisle", "crowd", "dock", "hall", "kerbs", "office", "passage", "ramp", "rooms", "turn")
SEEDS = range(5)
MOST_SOLIDS = 120


@functools.cache
def loaded(name: str, seed: int) -> Scene:
    return load_scene(name, seed)


def test_the_campaign_has_ten_scenes() -> None:
    assert campaign_scenes() == NAMES


def is_free(scene: Scene, x: float, y: float, radius_m: float) -> bool:
    """Whether a disc of ground is even and nothing stands on it up to 1.3 m."""
    dx, dy = (part.ravel() for part in np.mgrid[-1:1:41j, -1:1:41j] * radius_m)
    inside = np.hypot(dx, dy) <= radius_m
    xs, ys = x + dx[inside], y + dy[inside]
    ground = scene.height_at([x], [y])[0]
    heights = scene.height_at(xs, ys)
    even = bool((np.abs(heights - ground) < 0.10).all())
    return even and not scene.blocks(xs, ys, ground + 0.10, ground + 1.30).any()


@pytest.mark.parametrize("name", few(NAMES, 3))
def test_every_seed_gives_a_start_and_goals_that_are_free(name: str) -> None:
    scenes = [loaded(name, seed) for seed in SEEDS]
    assert len({scene.goals for scene in scenes}) == len(SEEDS)
    for scene in scenes:
        assert scene.campaign
        assert scene.description
        assert 1 <= len(scene.goals) <= 3
        assert len(scene.solids) <= MOST_SOLIDS
        assert is_free(scene, 0.0, 0.0, 1.2)
        for x, y in scene.goals:
            assert is_free(scene, x, y, 0.95)
            assert 10.0 < math.hypot(x, y) < 32.0


def test_the_ramp_rises_and_the_dock_falls_away() -> None:
    for seed in (1, 2, 3):
        ramp = loaded("ramp", seed)
        assert 0.25 < ramp.height_at([30.0], [0.0])[0] < 0.5
        dock = loaded("dock", seed)
        sides = dock.height_at([30.0, 12.0, 12.0], [0.0, 4.5, -4.5])
        assert sides[0] == -1.2
        assert -1.2 in sides[1:]
