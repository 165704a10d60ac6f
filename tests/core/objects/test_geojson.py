"""The map of objects as text: what is written is read back; what is wrong is refused, and named."""

import json
import math
from contextlib import suppress
from functools import partial
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.objects.vector_map.geojson import (
    GeoJsonError,
    SavedMap,
    geojson_from_map,
    map_from_floor_plan,
    map_from_geojson,
)
from core.objects.vector_map.object_map import ObjectMap
from tools.experiments.object_world import SETTINGS, Noise, World, box, overlap

WALL = np.array([[3.0, -2.0, 3.0, 2.0]])
RING: list[list[float]] = [[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]]


def seen_map() -> ObjectMap:
    things = [box(2.0, -0.6, 0.4, 0.4), box(2.2, 0.7, 0.3, 0.3)]
    world, objects = World(things, WALL, Noise(0.01, 0.005, 0.005)), ObjectMap(SETTINGS)
    for _ in range(20):
        objects.update(world.frame(0.0, 0.0, 0.0))
        world.walk()
    return objects


def text_of(objects: ObjectMap) -> str:
    return geojson_from_map(objects.objects(), objects.walls.records(), SETTINGS)


def test_a_saved_map_is_read_back_and_goes_on() -> None:
    objects = seen_map()
    text = text_of(objects)
    saved = map_from_geojson(text, SETTINGS)
    again = ObjectMap(SETTINGS)
    again.start_from(saved.objects, saved.walls, 0.0)
    assert [one.id for one in again.objects()] == [one.id for one in objects.objects()]
    for one, other in zip(objects.objects(), again.objects(), strict=True):
        np.testing.assert_allclose(one.polygon, other.polygon, atol=6e-4)
        assert one.finished.tolist() == other.finished.tolist()
    [wall], [before] = again.walls.records(), objects.walls.records()
    np.testing.assert_allclose(wall.segments, before.segments, atol=0.06)
    assert text_of(seen_map()) == text
    world = World([], WALL)  # both have been taken away meanwhile
    for _ in range(30):
        again.update(world.frame(0.0, 0.0, 0.0))
        world.walk()
    assert again.objects() == []


def test_new_ids_follow_those_of_a_saved_map() -> None:
    saved = map_from_geojson(text_of(seen_map()), SETTINGS)
    again, world = ObjectMap(SETTINGS), World([box(-2.0, 0.0, 0.5, 0.5)])
    again.start_from(saved.objects, saved.walls, 0.0)
    known = [one.id for one in saved.objects] + [one.id for one in saved.walls]
    for _ in range(10):
        again.update(world.frame(0.0, 0.0, math.pi))
        world.walk()
    assert min(one.id for one in again.objects() if one.id not in known) > max(known)
    with pytest.raises(ValueError, match="still empty"):
        again.start_from(saved.objects, saved.walls, 0.0)


def test_a_map_of_other_settings_is_refused() -> None:
    other = msgspec.structs.replace(SETTINGS, cell_m=0.03)
    with pytest.raises(GeoJsonError, match=r"mapod\.settings: the map was made with others"):
        map_from_geojson(text_of(seen_map()), other)


def changed(**properties: Any) -> dict[str, Any]:
    """A whole map of one object, some of its properties changed."""
    value: dict[str, Any] = json.loads(text_of(seen_map()))
    value["features"] = value["features"][:1]
    value["features"][0]["properties"] |= properties
    return value


def with_ring(ring: list[list[float]]) -> dict[str, Any]:
    value = changed()
    value["features"][0]["geometry"]["coordinates"] = [ring]
    return value


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ({}, "missing required field `type`"),
        ({"type": "FeatureCollection", "features": []}, "mapod: is missing"),
        (changed(id=0), r"features\[0\]\.properties: Expected `int` >= 1"),
        (changed(confidence=2), "confidence"),
        (changed(unheard_of=1), "unknown field `unheard_of`"),
        (changed(finished=[True]), r"properties\.finished: must have \d entries"),
        (changed(top_m=-1), r"top_m: must be at least bottom_m, 0\.0; is -1"),
        (changed(kind="wall"), r"features\[0\]\.properties"),
        (with_ring([*RING[:-1], [5, 5]]), "not closed"),
        (with_ring([[0, 0], [1, 1], [1, 0], [0, 1], [0, 0]]), "crosses or touches itself"),
        (with_ring([[0, 0], [1, 1], [2, 2], [0, 0]]), "it has no area"),
        (with_ring([[0, 0], [1e5, 0], [1, 1], [0, 0]]), r"Expected `float` <= 10000"),
        (with_ring([[0, 0], [0, 0]]), "length >= 4"),
    ],
)
def test_what_is_no_map_is_refused_with_the_place_of_the_fault(value: Any, message: str) -> None:
    with pytest.raises(GeoJsonError, match=message):
        map_from_geojson(json.dumps(value), SETTINGS)


def test_an_id_that_comes_twice_is_refused() -> None:
    value = changed()
    value["features"] *= 2
    with pytest.raises(GeoJsonError, match="comes twice"):
        map_from_geojson(json.dumps(value), SETTINGS)


WHOLE = text_of(seen_map())


@given(st.text() | st.tuples(st.integers(0, len(WHOLE)), st.text(max_size=5)))
def test_no_text_makes_the_reader_do_anything_but_refuse(damage: str | tuple[int, str]) -> None:
    text = damage if isinstance(damage, str) else WHOLE[: damage[0]] + damage[1]
    readers = (partial(map_from_geojson, text, SETTINGS), partial(map_from_floor_plan, text, 1.0))
    for read in readers:
        with suppress(GeoJsonError):
            assert isinstance(read(), SavedMap)


def test_text_that_is_nested_too_deeply_is_refused() -> None:
    with pytest.raises(GeoJsonError, match="text"):
        map_from_floor_plan('{"features":' + "[" * 100_000, 1.0)


def test_a_floor_plan_starts_the_map() -> None:
    plan = {
        "type": "FeatureCollection",
        "features": [
            {"type": "Feature", "geometry": {"type": "Polygon", "coordinates": [RING]}},
            {
                "type": "Feature",
                "geometry": {"type": "LineString", "coordinates": [[-1, -1], [4, -1], [4, 4]]},
                "properties": {"name": "outer wall"},
            },
        ],
    }
    saved, objects = map_from_floor_plan(json.dumps(plan), 1.2), ObjectMap(SETTINGS)
    objects.start_from(saved.objects, saved.walls, 5.0)
    [one] = objects.objects()
    assert overlap(one.polygon, np.array(RING[:-1], dtype=float)) == 1.0
    assert (one.top_m, bool(one.finished.all())) == (1.2, True)
    assert sorted(wall.segments.shape[0] for wall in objects.walls.records()) == [1, 1]
