"""The map of objects as text: what is written is read back; what is wrong is refused, and named."""

import json
import math
from contextlib import suppress
from functools import partial
from typing import Any

import msgspec
import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from core.objects.vector_map.geojson import (
    MOST_BYTES,
    GeoJsonError,
    SavedMap,
    geojson_from_map,
    map_from_floor_plan,
    map_from_geojson,
)
from core.objects.vector_map.mapped import MapObject
from core.objects.vector_map.object_map import ObjectMap
from tools.experiments.object_world import SETTINGS, Noise, World, box, overlap

WALL = np.array([[3.0, -2.0, 3.0, 2.0]])
RING: list[list[float]] = [[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]]


def seen_map() -> ObjectMap:
    return seen_world()[1]


def seen_world() -> tuple[World, ObjectMap]:
    things = [box(2.0, -0.6, 0.4, 0.4), box(2.2, 0.7, 0.3, 0.3)]
    world, objects = World(things, WALL, Noise(0.01, 0.005, 0.005)), ObjectMap(SETTINGS)
    for _ in range(20):
        objects.update(world.frame(0.0, 0.0, 0.0))
        world.walk()
    return world, objects


def text_of(objects: ObjectMap) -> str:
    records = objects.objects(), objects.walls.records()
    return geojson_from_map(*records, SETTINGS, objects.next_id)


def started(saved: SavedMap, at_s: float = 0.0) -> ObjectMap:
    objects = ObjectMap(SETTINGS)
    objects.start_from(saved.objects, saved.walls, at_s, saved.next_id)
    return objects


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


def test_what_was_saved_and_loaded_is_the_same_map() -> None:
    things, doors = [box(2.0, -0.6, 0.41, 0.33, yaw=0.4)], np.array([[3.0, -2.0, 2.6, -0.3]])
    doors = np.vstack([doors, [2.43, 0.4, 2.05, 2.0]])
    world, objects = World(things, doors, Noise(0.01, 0.005, 0.005)), ObjectMap(SETTINGS)
    for frame in range(40):
        objects.update(world.frame(0.0, 0.0, 0.0))
        world.walk()
        world.walls = doors if frame > 20 else np.array([[3.0, -2.0, 2.05, 2.0]])
    text = text_of(objects)
    again = started(map_from_geojson(text, SETTINGS), at_s=70.0)
    assert text_of(again) == text
    assert "_seen_s" not in text  # a clock of another run means nothing
    [one], [other] = objects.objects(), again.objects()
    assert other.confidence == pytest.approx(one.confidence, abs=6e-4)


@pytest.mark.parametrize("confidence", [0.0, 0.07, 0.64, 0.93, 0.999, 1.0])
def test_an_object_is_as_sure_as_when_it_was_saved(confidence: float) -> None:
    value = changed(confidence=confidence)
    [one] = started(map_from_geojson(json.dumps(value), SETTINGS)).objects()
    assert round(one.confidence, 3) == confidence


def test_an_id_is_not_used_again_after_a_restart() -> None:
    world, objects = seen_world()
    used, world.things = objects.next_id - 1, []
    for _ in range(30):  # all boxes go: the highest ids are in no file
        objects.update(world.frame(0.0, 0.0, 0.0))
        world.walk()
    assert objects.objects() == []
    text = text_of(objects)
    world = World([box(-2.0, 0.0, 0.5, 0.5)])
    again = started(map_from_geojson(text, SETTINGS))
    for _ in range(10):
        again.update(world.frame(0.0, 0.0, math.pi))
        world.walk()
    assert [one.id > used for one in again.objects()] == [True]
    value = json.loads(text)
    del value["mapod"]["next_id"]  # written by an older version
    for feature in value["features"]:
        feature["properties"] |= {"first_seen_s": 1.5, "last_seen_s": 2.5}
    older = map_from_geojson(json.dumps(value), SETTINGS)
    assert started(older).next_id == max(wall.id for wall in older.walls) + 1


def test_a_map_of_a_hundred_thousand_objects_is_accepted_by_its_own_reader() -> None:
    angle = np.arange(24) * (2.0 * np.pi / 24)
    ring = -5000.0 / 3.0 + np.column_stack([np.cos(angle), np.sin(angle)]) / 3.0
    seen = 1e5 / 3.0, 2e5 / 3.0, 255, np.ones(24, dtype=bool), 2.0 / 3.0
    one = MapObject(100_000, ring, 1.0 / 3.0, 2.0 / 3.0, *seen, "static")
    assert 1e5 * len(geojson_from_map([one], [], SETTINGS, 2)) < MOST_BYTES


def test_an_outline_that_is_thinner_than_a_millimetre_is_read_back() -> None:
    ring = np.array([[0, 0], [1, 0], [1, 1], [0.50004, 1], [0.5, 0.0002], [0.49996, 1], [0, 1]])
    one = MapObject(1, ring, 0.0, 1.0, 0.0, 0.0, 255, np.ones(7, dtype=bool), 1.0, "static")
    text = geojson_from_map([one], [], SETTINGS, 2)
    np.testing.assert_allclose(map_from_geojson(text, SETTINGS).objects[0].polygon, ring)


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


BENT = [[[3, -2], [3, 0]], [[3, 1], [4, 2]]]
BESIDE = [3.5, 0.5, 3.5, 1.0]


@pytest.mark.parametrize(
    ("lines", "opening", "message"),
    [
        (BENT, None, r"geometry: a wall is one line; a point lies [\d.]+ m off it"),
        (None, BESIDE, r"openings: a wall is one line; a point lies 0\.[45]\d* m off it"),
        (None, [], "openings: must lie between the wall's ends"),
    ],
)
def test_a_wall_that_is_no_line_is_refused(lines: Any, opening: Any, message: str) -> None:
    """The map could not go on from it: it raised, or had a wall of 10^5 pieces."""
    value = json.loads(text_of(seen_map()))
    [wall] = [one for one in value["features"] if one["properties"]["kind"] == "wall"]
    if lines is not None:
        wall["geometry"]["coordinates"] = lines
    if opening is not None:
        a, *_, b = np.vstack(wall["geometry"]["coordinates"])
        beyond = np.concatenate([2.0 * b - a, 3.0 * b - 2.0 * a]).tolist()
        wall["properties"]["openings"] = [opening or beyond]
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
    objects = started(map_from_floor_plan(json.dumps(plan), 1.2), at_s=5.0)
    [one] = objects.objects()
    assert overlap(one.polygon, np.array(RING[:-1], dtype=float)) == 1.0
    assert (one.top_m, bool(one.finished.all())) == (1.2, True)
    assert sorted(wall.segments.shape[0] for wall in objects.walls.records()) == [1, 1]


def planned(*shapes: tuple[str, str, Any]) -> ObjectMap:
    """A map that starts from a plan of such features: kind, type and coordinates."""
    features = [
        {
            "type": "Feature",
            "properties": {"kind": kind} if kind else None,
            "geometry": {"type": type_, "coordinates": coordinates},
        }
        for kind, type_, coordinates in shapes
    ]
    text = json.dumps({"type": "FeatureCollection", "features": features})
    objects = started(map_from_floor_plan(text, 1.2))
    saved = text_of(objects)
    assert text_of(started(map_from_geojson(saved, SETTINGS))) == saved
    return objects


def drawn(objects: ObjectMap) -> shapely.Geometry:
    """All walls of a map as lines."""
    lines = [wall.segments.reshape(-1, 2, 2) for wall in objects.walls.records()]
    return shapely.union_all([shapely.LineString(line) for line in np.vstack(lines)])


def circle(radius_m: float, count: int, turn_rad: float = 2.0 * math.pi) -> list[list[float]]:
    angle = np.linspace(0.0, turn_rad, count + 1)
    points = radius_m * np.column_stack([np.cos(angle), np.sin(angle)])
    points[-1] = points[0] if turn_rad > 6.0 else points[-1]
    return [[x, y] for x, y in (5.0 + points).tolist()]


@pytest.mark.parametrize(("radius_m", "count"), [(0.05, 16), (0.2, 32), (0.45, 44)])
def test_a_pillar_that_is_drawn_as_a_circle_is_an_object(radius_m: float, count: int) -> None:
    objects = planned(("", "LineString", circle(radius_m, count)))
    [one] = objects.objects()
    assert shapely.Polygon(one.polygon).area == pytest.approx(math.pi * radius_m**2, rel=0.06)
    assert (one.bottom_m, one.top_m, objects.walls.records()) == (0.0, 1.2, [])


@pytest.mark.parametrize(
    "line",
    [
        [[3.0, 1.0], [3.04, 1.0]],
        [[3.0, 1.0], [3.001, 1.0]],
        [[0, 0], [0.03, 0], [0.03, 0.02], [0.9, 0.02]],
        [[x, 0.3 * x] for x in np.arange(0.0, 4.0, 0.013).tolist()],  # straight: one wall
        circle(0.15, 20, turn_rad=2.0),
        circle(0.7, 60),
        [*RING[:2], [1, 1.5], [0, 1.5], [0, 0]],  # of a small room
    ],
)
def test_no_line_of_a_plan_is_dropped(line: list[list[float]]) -> None:
    objects = planned(("wall", "LineString", line))
    assert drawn(objects).hausdorff_distance(shapely.LineString(line)) < 0.0021
    assert objects.objects() == []
    world = World([], np.zeros((0, 4)))
    for _ in range(3):  # elsewhere
        objects.update(world.frame(0.0, -20.0, -1.5))
    assert drawn(objects).hausdorff_distance(shapely.LineString(line)) < 0.0021


def test_a_straight_line_is_one_wall_and_a_seen_one_keeps_its_place() -> None:
    line = [[2.0, y] for y in np.arange(-2.0, 2.01, 0.04).tolist()]
    objects = planned(("", "LineString", line))
    world = World([], np.array([[2.0, -2.0, 2.0, 2.0]]))
    for _ in range(10):
        objects.update(world.frame(0.0, 0.0, 0.0))
    [wall] = objects.walls.records()
    np.testing.assert_allclose(wall.segments, [[2.0, -2.0, 2.0, 2.0]], atol=0.05)


HALL: list[list[float]] = [[0, 0], [8, 0], [8, 6], [0, 6], [0, 0]]


def moved(ring: list[list[float]], x: float, y: float) -> list[list[float]]:
    return [[a + x, b + y] for a, b in ring]


@pytest.mark.parametrize("kind", ["floor", ""])
def test_a_plan_is_read_by_its_kinds_as_the_planner_of_paths_reads_it(kind: str) -> None:
    objects = planned(
        (kind, "MultiPolygon", [[HALL, moved(RING, 3, 3)], [moved(HALL, 8, 0)]]),
        ("room", "Polygon", [HALL]),
        ("start", "Point", [1, 1]),
        ("dock", "Point", [1, 1, 0]),
        ("obstacle", "Polygon", [moved(RING, 5, 1)]),
        ("wall", "MultiPolygon", [[moved(RING, 7, 1)], [moved(RING, 7, 4)]]),
        ("", "LineString", [[2, 0], [2, 1]]),
    )
    hole = shapely.box(3, 3, 4, 4)
    things = shapely.union_all([shapely.Polygon(one.polygon) for one in objects.objects()])
    boxes = [shapely.box(5, 1, 6, 2), shapely.box(7, 1, 8, 2), shapely.box(7, 4, 8, 5), hole]
    assert things.equals(shapely.union_all(boxes))
    outer = shapely.box(0, 0, 16, 6).exterior  # where both parts meet there is no wall
    walls = shapely.union_all([outer, shapely.LineString([[2, 0], [2, 1]])])
    assert drawn(objects).hausdorff_distance(walls) < 1e-6


@pytest.mark.parametrize(
    ("shape", "message"),
    [
        (("", "Point", [1, 1]), "a point must be of kind start or dock"),
        (("floor", "Polygon", [[[0, 0], [1, 1], [2, 2], [0, 0]]]), "a floor must have an area"),
        (("", "LineString", [[0, 0], [0, 0.0001]]), "less than 1 mm apart"),
    ],
)
def test_what_cannot_be_drawn_is_refused(shape: tuple[str, str, Any], message: str) -> None:
    with pytest.raises(GeoJsonError, match=rf"features\[0\]\.geometry: .*{message}"):
        planned(shape)
