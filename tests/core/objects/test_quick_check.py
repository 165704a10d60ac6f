"""The quick look: it agrees with what the map has, and asks for a whole frame at any change."""

import math

import numpy as np
import pytest

from core.objects.records import Floats
from core.objects.vector_map.object_map import ObjectMap
from core.objects.vector_map.quick_check import expected_ranges, quick_check
from core.objects.vector_map.settings import QuickCheckSettings
from tools.experiments.object_world import SETTINGS, World, box

LOOK = QuickCheckSettings(
    rays=100, max_range_m=4.5, tolerance_m=0.08, most_unknown=0.5, every_frames=10
)
BEARINGS = np.linspace(-0.55, 0.55, LOOK.rays)
WALL = np.array([[4.0, -4.0, 4.0, 4.0]])


def known(world: World) -> ObjectMap:
    objects = ObjectMap(SETTINGS)
    for _ in range(20):
        objects.update(world.frame(0.0, 0.0, 0.0))
        world.walk()
    return objects


def measured(world: World) -> Floats:
    return world.cast(np.zeros(2), BEARINGS)[0]


def test_rays_meet_what_the_map_has() -> None:
    world = World([box(2.0, 0.5, 0.4, 0.4, 0.3), box(1.5, -0.5, 0.2, 0.2)], WALL)
    expected = expected_ranges(known(world), (0.0, 0.0), BEARINGS, 5.0)
    off = np.abs(expected - measured(world))
    assert np.median(off) < 0.005
    assert np.mean(off < 0.05) > 0.95


def test_an_empty_map_expects_nothing() -> None:
    assert (expected_ranges(ObjectMap(SETTINGS), (0.0, 0.0), BEARINGS, 5.0) == 5.0).all()


def test_it_agrees_as_long_as_nothing_changes_and_sees_each_change() -> None:
    things = [box(2.0, 0.5, 0.4, 0.4, 0.3), box(1.5, -0.5, 0.2, 0.2)]
    world = World(list(things), WALL)
    objects = known(world)
    look = quick_check(objects, (0.0, 0.0), BEARINGS, measured(world), LOOK)
    assert (look.agrees, look.reason, look.compared) == (True, "", LOOK.rays)
    rough = measured(world) + np.random.default_rng(1).normal(0.0, 0.02, LOOK.rays)
    assert quick_check(objects, (0.0, 0.0), BEARINGS, rough, LOOK).agrees
    world.things = [*things, box(1.0, 0.0, 0.1, 0.1)]
    assert quick_check(objects, (0.0, 0.0), BEARINGS, measured(world), LOOK).nearer > 0
    world.things = things[1:]
    assert quick_check(objects, (0.0, 0.0), BEARINGS, measured(world), LOOK).further > 0
    world.things = [box(2.25, 0.5, 0.4, 0.4, 0.3), things[1]]
    assert not quick_check(objects, (0.0, 0.0), BEARINGS, measured(world), LOOK).agrees


def test_it_does_not_agree_when_it_sees_too_little() -> None:
    nothing = np.where(np.arange(LOOK.rays) % 3 == 0, 4.0 / np.cos(BEARINGS), math.nan)
    look = quick_check(known(World([], WALL)), (0.0, 0.0), BEARINGS, nothing, LOOK)
    assert look.reason == "66% of the rays have no measurement"


def test_bearings_and_ranges_have_to_be_as_many() -> None:
    with pytest.raises(ValueError, match="are 100 and 1"):
        quick_check(ObjectMap(SETTINGS), (0.0, 0.0), BEARINGS, np.ones(1), LOOK)
