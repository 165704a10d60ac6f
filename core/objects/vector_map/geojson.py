"""The map of objects as GeoJSON text, and back: a saved map, or a floor plan to start from.

What is read may come from anybody: its size is bounded, each number is checked, and one fault
refuses all of it, in a sentence that names the place and what is allowed. It opens no file.

Source: RFC 7946 (GeoJSON), sections 3.1 and 3.3. Coordinates are metres of the map frame, not
degrees; a member `mapod` of the collection says so, and which settings made the map.
"""

import hashlib
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
import shapely
from msgspec import Meta, Struct

from core.objects.records import Floats
from core.objects.vector_map.contour import area_of
from core.objects.vector_map.journal import MM
from core.objects.vector_map.mapped import VIEWS, MapObject
from core.objects.vector_map.settings import ObjectMapSettings
from core.objects.vector_map.walls import WallRecord

FORMAT, VERSION = "mapod objects", 1
MOST_BYTES = 64 * 2**20
MOST_FEATURES = 200_000
MOST_CORNERS = 10_000  # of one feature
REACH_M = 10_000.0  # from the middle of the map frame, in x and in y

Coordinate = Annotated[float, Meta(ge=-REACH_M, le=REACH_M)]
Point = Annotated[list[Coordinate], Meta(min_length=2, max_length=3)]
Line = Annotated[list[Point], Meta(min_length=2, max_length=MOST_CORNERS)]
Ring = Annotated[list[Point], Meta(min_length=4, max_length=MOST_CORNERS)]
Height = Annotated[float, Meta(ge=-100, le=100)]


class GeoJsonError(Exception):
    """A text that is no map, or not one of ours; the text says where and why."""


class _Polygon(Struct, tag_field="type", tag="Polygon"):
    coordinates: Annotated[list[Ring], Meta(min_length=1, max_length=1000)]


class _LineString(Struct, tag_field="type", tag="LineString"):
    coordinates: Line


class _Lines(Struct, tag_field="type", tag="MultiLineString"):
    coordinates: Annotated[list[Line], Meta(min_length=1, max_length=MOST_CORNERS)]


class _Feature(Struct):
    type: Literal["Feature"]
    geometry: _Polygon | _LineString | _Lines
    properties: dict[str, Any] | None = None


class _About(Struct, forbid_unknown_fields=True):
    format: Literal["mapod objects"]
    version: Literal[1]
    settings: Annotated[str, Meta(pattern="^[0-9a-f]{16}$")]


class _Collection(Struct):
    type: Literal["FeatureCollection"]
    features: Annotated[list[_Feature], Meta(max_length=MOST_FEATURES)]
    mapod: _About | None = None


class _ObjectProperties(Struct, forbid_unknown_fields=True):
    kind: Literal["static", "moved"]
    id: Annotated[int, Meta(ge=1, le=2**53)]
    bottom_m: Height
    top_m: Height
    first_seen_s: float
    last_seen_s: float
    seen_from: Annotated[int, Meta(ge=0, lt=2**VIEWS)]
    finished: list[bool]
    confidence: Annotated[float, Meta(ge=0, le=1)]


class _WallProperties(Struct, forbid_unknown_fields=True):
    kind: Literal["wall"]
    id: Annotated[int, Meta(ge=1, le=2**53)]
    openings: list[Annotated[list[Coordinate], Meta(min_length=4, max_length=4)]]
    first_seen_s: float
    last_seen_s: float


class SavedMap(Struct, frozen=True, eq=False):
    """What a text holds."""

    objects: tuple[MapObject, ...]
    walls: tuple[WallRecord, ...]


def settings_digest(settings: ObjectMapSettings) -> str:
    """16 hex digits of the settings that a map was made with."""
    return hashlib.sha256(msgspec.json.encode(settings)).hexdigest()[:16]


def geojson_from_map(
    objects: list[MapObject], walls: list[WallRecord], settings: ObjectMapSettings
) -> str:
    """A map as text, corners to the millimetre; the same map gives the same text."""
    about = {"format": FORMAT, "version": VERSION, "settings": settings_digest(settings)}
    features = [_object_feature(one) for one in objects] + [_wall_feature(one) for one in walls]
    return msgspec.json.encode(
        {"type": "FeatureCollection", "mapod": about, "features": features}
    ).decode()


def map_from_geojson(text: str, settings: ObjectMapSettings) -> SavedMap:
    """A map that `geojson_from_map` has written.

    Raises:
        GeoJsonError: it is none, is damaged, or other settings made it.
    """
    collection = _collection(text)
    if collection.mapod is None:
        raise GeoJsonError("mapod: is missing; this is no saved map (a floor plan?)")
    mine = settings_digest(settings)
    if collection.mapod.settings != mine:
        raise GeoJsonError(
            f"mapod.settings: the map was made with others, {collection.mapod.settings};"
            f" these have {mine}"
        )
    objects, walls, ids = [], [], set[int]()
    for number, feature in enumerate(collection.features):
        where, properties = f"features[{number}]", feature.properties or {}
        one: MapObject | WallRecord
        if properties.get("kind") == "wall":
            one = _wall(feature, properties, where)
            walls.append(one)
        else:
            one = _object(feature, properties, where)
            objects.append(one)
        if one.id in ids:
            raise GeoJsonError(f"{where}.properties.id: {one.id} comes twice")
        ids.add(one.id)
    return SavedMap(tuple(objects), tuple(walls))


def map_from_text(text: str, settings: ObjectMapSettings, top_m: float) -> SavedMap:
    """What either of the two below it reads: a saved map says that it is one.

    Raises:
        GeoJsonError: it is neither, is damaged, or other settings made it.
    """
    if _collection(text).mapod is None:
        return map_from_floor_plan(text, top_m)
    return map_from_geojson(text, settings)


def map_from_floor_plan(text: str, top_m: float) -> SavedMap:
    """A floor plan of anybody's: polygons are objects, lines are walls; metres of the map frame.

    Args:
        top_m: how high objects are, above the floor.

    Raises:
        GeoJsonError: it is no such plan.
    """
    objects, walls = list[MapObject](), list[WallRecord]()
    for number, feature in enumerate(_collection(text).features):
        where, here = f"features[{number}].geometry", len(objects) + len(walls) + 1
        geometry = feature.geometry
        if isinstance(geometry, _Polygon):
            polygon = _polygon(geometry, where)
            all_seen = np.ones(len(polygon), dtype=bool)
            seen = 0.0, 0.0, 2**VIEWS - 1, all_seen
            objects.append(MapObject(here, polygon, 0.0, top_m, *seen, 1.0, "static"))
            continue
        lines = geometry.coordinates if isinstance(geometry, _Lines) else [geometry.coordinates]
        for line in lines:
            for segment in _segments(line, where):  # each its own: a wall is straight
                here = len(objects) + len(walls) + 1
                walls.append(WallRecord(here, segment[None], np.zeros((0, 4)), 0.0, 0.0))
    return SavedMap(tuple(objects), tuple(walls))


def _collection(text: str) -> _Collection:
    if len(text) > MOST_BYTES:
        raise GeoJsonError(f"text: has {len(text)} characters; at most {MOST_BYTES} are allowed")
    try:
        return msgspec.json.decode(text, type=_Collection)
    except (msgspec.DecodeError, RecursionError, UnicodeEncodeError) as error:
        raise GeoJsonError(f"text: {error}") from error


def _properties(properties: dict[str, Any], of: type[Any], where: str) -> Any:
    try:
        return msgspec.convert(properties, of)
    except msgspec.ValidationError as error:
        raise GeoJsonError(f"{where}.properties: {error}") from error


def _object(feature: _Feature, properties: dict[str, Any], where: str) -> MapObject:
    about = _properties(properties, _ObjectProperties, where)
    if not isinstance(feature.geometry, _Polygon):
        raise GeoJsonError(f"{where}.geometry: must be a Polygon, for it is an object")
    polygon = _polygon(feature.geometry, f"{where}.geometry")
    if len(about.finished) != len(polygon):
        raise GeoJsonError(
            f"{where}.properties.finished: must have {len(polygon)} entries, one for each side;"
            f" has {len(about.finished)}"
        )
    if about.top_m < about.bottom_m:
        raise GeoJsonError(
            f"{where}.properties.top_m: must be at least bottom_m, {about.bottom_m};"
            f" is {about.top_m}"
        )
    finished = np.array(about.finished, dtype=bool)
    return MapObject(
        *(about.id, polygon, about.bottom_m, about.top_m, about.first_seen_s, about.last_seen_s),
        *(about.seen_from, finished, about.confidence, about.kind),
    )


def _wall(feature: _Feature, properties: dict[str, Any], where: str) -> WallRecord:
    about = _properties(properties, _WallProperties, where)
    if not isinstance(feature.geometry, _Lines):
        raise GeoJsonError(f"{where}.geometry: must be a MultiLineString, for it is a wall")
    rows = [_segments(line, f"{where}.geometry") for line in feature.geometry.coordinates]
    openings = np.array(about.openings, dtype=np.float64).reshape(-1, 4)
    seen = about.first_seen_s, about.last_seen_s
    return WallRecord(about.id, np.vstack(rows), openings, *seen)


def _polygon(geometry: _Polygon, where: str) -> Floats:
    """The outer ring, counter-clockwise, first corner not repeated; holes are filled."""
    ring = np.array([point[:2] for point in geometry.coordinates[0]], dtype=np.float64)
    if not np.array_equal(ring[0], ring[-1]):
        raise GeoJsonError(f"{where}: its ring is not closed: the last corner must be the first")
    shape = shapely.Polygon(ring)
    if not shape.is_valid or shape.area <= 0.0:
        raise GeoJsonError(f"{where}: its ring crosses or touches itself: {_reason(shape)}")
    corners = ring[:-1]
    return corners if area_of(corners) > 0.0 else corners[::-1]


def _reason(shape: shapely.Polygon) -> str:
    return str(shapely.is_valid_reason(shape)) if shape.area > 0.0 else "it has no area"


def _segments(line: list[list[float]], where: str) -> Floats:
    points = np.array([point[:2] for point in line], dtype=np.float64)
    lengths = np.hypot(*np.diff(points, axis=0).T)
    if lengths.min() < 1.0 / MM:
        raise GeoJsonError(f"{where}: a line has two points less than 1 mm apart")
    return np.hstack([points[:-1], points[1:]])


def _rounded(points: Floats) -> list[list[float]]:
    return [[round(x, 3) + 0.0, round(y, 3) + 0.0] for x, y in points.tolist()]


def _object_feature(one: MapObject) -> dict[str, Any]:
    ring = _rounded(np.vstack([one.polygon, one.polygon[:1]]))
    properties = {
        name: getattr(one, name)
        for name in ("kind", "id", "bottom_m", "top_m", "seen_from", "confidence")
    }
    times = {"first_seen_s": one.first_seen_s, "last_seen_s": one.last_seen_s}
    properties |= times | {"finished": one.finished.tolist()}
    geometry = {"type": "Polygon", "coordinates": [ring]}
    return {"type": "Feature", "geometry": geometry, "properties": properties}


def _wall_feature(wall: WallRecord) -> dict[str, Any]:
    lines = [_rounded(segment.reshape(2, 2)) for segment in wall.segments]
    properties = {
        "kind": "wall",
        "id": wall.id,
        "openings": [[round(value, 3) for value in row] for row in wall.openings.tolist()],
        "first_seen_s": wall.first_seen_s,
        "last_seen_s": wall.last_seen_s,
    }
    geometry = {"type": "MultiLineString", "coordinates": lines}
    return {"type": "Feature", "geometry": geometry, "properties": properties}
