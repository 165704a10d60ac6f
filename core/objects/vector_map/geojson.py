"""The map of objects as GeoJSON text, and back: a saved map, or a floor plan to start from.

What is read may come from anybody: its size is bounded, each number is checked, and one fault
refuses all of it, in a sentence that names the place and what is allowed. It opens no file.

Source: RFC 7946 (GeoJSON), sections 3.1 and 3.3. Coordinates are metres of the map frame, not
degrees; a member `mapod` of the collection says so, which settings made the map, and which id is
next. Kinds of a floor plan are those of docs/coverage.md.
"""

import hashlib
import math
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
MOST_BYTES = 256 * 2**20
MOST_FEATURES = 200_000
MOST_CORNERS = 10_000  # of one feature
MOST_ID = 2**53  # whole numbers of a JSON reader end there
REACH_M = 10_000.0  # from the middle of the map frame, in x and in y
OFF_LINE_M = 0.01  # from its line may lie what is of a wall: it is written to the millimetre
SMALL_M = 1.0  # a closed line of a plan that is nowhere longer is a thing: a pillar
PLANNED = 0.6  # confidence in what a plan shows and nobody has seen yet
OF_A_PLAN = "floor", "obstacle", "room", "start", "dock"  # kinds of who draws the floor, too

Coordinate = Annotated[float, Meta(ge=-REACH_M, le=REACH_M)]
Point = Annotated[list[Coordinate], Meta(min_length=2, max_length=3)]
Line = Annotated[list[Point], Meta(min_length=2, max_length=MOST_CORNERS)]
Ring = Annotated[list[Point], Meta(min_length=4, max_length=MOST_CORNERS)]
Rings = Annotated[list[Ring], Meta(min_length=1, max_length=1000)]
Height = Annotated[float, Meta(ge=-100, le=100)]


class GeoJsonError(Exception):
    """A text that is no map, or not one of ours; the text says where and why."""


class _Polygon(Struct, tag_field="type", tag="Polygon"):
    coordinates: Rings


class _Polygons(Struct, tag_field="type", tag="MultiPolygon"):
    coordinates: Annotated[list[Rings], Meta(min_length=1, max_length=MOST_CORNERS)]


class _Point(Struct, tag_field="type", tag="Point"):
    coordinates: Point


class _LineString(Struct, tag_field="type", tag="LineString"):
    coordinates: Line


class _Lines(Struct, tag_field="type", tag="MultiLineString"):
    coordinates: Annotated[list[Line], Meta(min_length=1, max_length=MOST_CORNERS)]


class _Feature(Struct):
    type: Literal["Feature"]
    geometry: _Polygon | _Polygons | _LineString | _Lines | _Point
    properties: dict[str, Any] | None = None


class _About(Struct, forbid_unknown_fields=True):
    format: Literal["mapod objects"]
    version: Literal[1]
    settings: Annotated[str, Meta(pattern="^[0-9a-f]{16}$")]
    next_id: Annotated[int, Meta(ge=1, le=MOST_ID + 1)] = 1  # files of older versions have none


class _Collection(Struct):
    type: Literal["FeatureCollection"]
    features: Annotated[list[_Feature], Meta(max_length=MOST_FEATURES)]
    mapod: _About | None = None


class _ObjectProperties(Struct, forbid_unknown_fields=True):
    kind: Literal["static", "moved"]
    id: Annotated[int, Meta(ge=1, le=MOST_ID)]
    bottom_m: Height
    top_m: Height
    seen_from: Annotated[int, Meta(ge=0, lt=2**VIEWS)]
    finished: list[bool]
    confidence: Annotated[float, Meta(ge=0, le=1)]
    first_seen_s: float = 0.0  # in files of older versions: a clock that is no more
    last_seen_s: float = 0.0


class _WallProperties(Struct, forbid_unknown_fields=True):
    kind: Literal["wall"]
    id: Annotated[int, Meta(ge=1, le=MOST_ID)]
    openings: list[Annotated[list[Coordinate], Meta(min_length=4, max_length=4)]]
    first_seen_s: float = 0.0
    last_seen_s: float = 0.0


class SavedMap(Struct, frozen=True, eq=False):
    """What a text holds."""

    objects: tuple[MapObject, ...]
    walls: tuple[WallRecord, ...]
    next_id: int = 1  # at least that have new things


def settings_digest(settings: ObjectMapSettings) -> str:
    """16 hex digits of the settings that a map was made with."""
    return hashlib.sha256(msgspec.json.encode(settings)).hexdigest()[:16]


def geojson_from_map(
    objects: list[MapObject], walls: list[WallRecord], settings: ObjectMapSettings, next_id: int
) -> str:
    """A map as text, to the millimetre; the same map gives the same text, and so does a loaded one.

    When things were seen is not written: the clock of the run ends with it.
    """
    digest = settings_digest(settings)
    about = {"format": FORMAT, "version": VERSION, "settings": digest, "next_id": next_id}
    features = [_object_feature(one) for one in objects] + [_wall_feature(one) for one in walls]
    return msgspec.json.encode(
        {"type": "FeatureCollection", "mapod": about, "features": features}
    ).decode()


def map_from_geojson(text: str, settings: ObjectMapSettings) -> SavedMap:
    """A map that `geojson_from_map` has written.

    Raises:
        GeoJsonError: it is none, is damaged, or other settings made it.
    """
    return _saved(_collection(text), settings)


def map_from_text(text: str, settings: ObjectMapSettings, top_m: float) -> SavedMap:
    """What either of the two below it reads: a saved map says that it is one.

    Raises:
        GeoJsonError: it is neither, is damaged, or other settings made it.
    """
    collection = _collection(text)
    return _saved(collection, settings) if collection.mapod else _planned(collection, top_m)


def map_from_floor_plan(text: str, top_m: float) -> SavedMap:
    """A floor plan of anybody's, by the kinds of its features; metres of the map frame.

    Lines and rings of the floor are walls, but for small closed ones: these are objects, as other
    polygons are. Rooms, the start and the dock are left out. Where a feature has a kind of a plan,
    polygons without one are floor.

    Args:
        top_m: how high objects are, above the floor.

    Raises:
        GeoJsonError: it is no such plan.
    """
    return _planned(_collection(text), top_m)


def _collection(text: str) -> _Collection:
    if len(text) > MOST_BYTES:
        raise GeoJsonError(f"text: has {len(text)} characters; at most {MOST_BYTES} are allowed")
    try:
        return msgspec.json.decode(text, type=_Collection)
    except (msgspec.DecodeError, RecursionError, UnicodeEncodeError) as error:
        raise GeoJsonError(f"text: {error}") from error


def _saved(collection: _Collection, settings: ObjectMapSettings) -> SavedMap:
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
    return SavedMap(tuple(objects), tuple(walls), collection.mapod.next_id)


class _Drawn:
    """What a plan holds so far, numbered in turn."""

    def __init__(self, top_m: float) -> None:
        self.objects, self.walls = list[MapObject](), list[WallRecord]()
        self._top_m = top_m

    def add_object(self, polygon: Floats) -> None:
        all_seen = np.ones(len(polygon), dtype=bool)
        seen = 0.0, 0.0, 2**VIEWS - 1, all_seen
        number, top_m = self._next(), self._top_m
        self.objects.append(MapObject(number, polygon, 0.0, top_m, *seen, PLANNED, "static"))

    def add_line(self, line: list[list[float]], where: str) -> None:
        """An object, if it is closed and small; else each straight piece of it is a wall."""
        points = np.round([point[:2] for point in line], 3)
        straight = shapely.LineString(points).simplify(1.0 / MM, preserve_topology=False)
        pieces = _segments(shapely.get_coordinates(straight).tolist(), where)
        ring = shapely.Polygon(pieces[:, :2]) if len(pieces) > 2 else shapely.Polygon()
        is_closed = bool((points[0] == points[-1]).all()) and ring.is_valid and ring.area > 0.0
        if is_closed and np.ptp(points, axis=0).max() <= SMALL_M:
            self.add_object(_outline(pieces[:, :2]))
            return
        for piece in pieces:
            self.walls.append(WallRecord(self._next(), piece[None], np.zeros((0, 4)), 0.0, 0.0))

    def _next(self) -> int:
        return len(self.objects) + len(self.walls) + 1


def _planned(collection: _Collection, top_m: float) -> SavedMap:
    kinds = [str((feature.properties or {}).get("kind")) for feature in collection.features]
    is_floor = {"floor": True, "obstacle": False, "wall": False}
    else_floor = any(kind in OF_A_PLAN for kind in kinds)
    drawn, floors = _Drawn(top_m), list[shapely.Geometry]()
    for number, (feature, kind) in enumerate(zip(collection.features, kinds, strict=True)):
        where, geometry = f"features[{number}].geometry", feature.geometry
        if isinstance(geometry, _Point):
            if kind not in ("start", "dock"):
                raise GeoJsonError(f"{where}: a point must be of kind start or dock")
        elif isinstance(geometry, _LineString):
            drawn.add_line(geometry.coordinates, where)
        elif isinstance(geometry, _Lines):
            for line in geometry.coordinates:
                drawn.add_line(line, where)
        elif kind not in ("room", "start", "dock"):
            for rings in _parts(geometry):
                if is_floor.get(kind, else_floor):
                    floors.append(_floor(rings, where))
                else:
                    drawn.add_object(_polygon(rings, where))
    for part in shapely.get_parts(shapely.union_all(floors, grid_size=1.0 / MM)):
        for ring in (part.exterior, *part.interiors):
            drawn.add_line(shapely.get_coordinates(ring).tolist(), "floor")
    return SavedMap(tuple(drawn.objects), tuple(drawn.walls))


def _parts(geometry: _Polygon | _Polygons) -> list[list[list[list[float]]]]:
    return [geometry.coordinates] if isinstance(geometry, _Polygon) else geometry.coordinates


def _floor(rings: list[list[list[float]]], where: str) -> shapely.Geometry:
    """An area of floor; where its rings cross, it is what they close in."""
    shell, *holes = [_ring(ring, where) for ring in rings]
    shape = shapely.Polygon(shell, holes)
    shape = shapely.make_valid(shape, method="structure", keep_collapsed=False)
    if shape.area <= 0.0:
        raise GeoJsonError(f"{where}: a floor must have an area")
    return shape


def _properties(properties: dict[str, Any], of: type[Any], where: str) -> Any:
    try:
        return msgspec.convert(properties, of)
    except msgspec.ValidationError as error:
        raise GeoJsonError(f"{where}.properties: {error}") from error


def _object(feature: _Feature, properties: dict[str, Any], where: str) -> MapObject:
    about = _properties(properties, _ObjectProperties, where)
    if not isinstance(feature.geometry, _Polygon):
        raise GeoJsonError(f"{where}.geometry: must be a Polygon, for it is an object")
    polygon = _polygon(feature.geometry.coordinates, f"{where}.geometry")
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
    segments, seen = np.vstack(rows), (about.first_seen_s, about.last_seen_s)
    _check_wall(segments, openings, where)
    return WallRecord(about.id, segments, openings, *seen)


def _check_wall(segments: Floats, openings: Floats, where: str) -> None:
    """Raises GeoJsonError where not all of a wall lies on one line, or it opens beyond its ends."""
    start, ends = segments[0, :2], segments.reshape(-1, 2)
    far = ends[np.hypot(*(ends - start).T).argmax()]
    along = (far - start) / math.dist(start, far)
    first, last = (ends - start).dot(along).min(), (ends - start).dot(along).max()
    for name, points in (("geometry", ends), ("properties.openings", openings.reshape(-1, 2))):
        off = points - start
        aside_m = np.abs(off @ np.array([-along[1], along[0]])).max(initial=0.0)
        if aside_m > OFF_LINE_M:
            raise GeoJsonError(
                f"{where}.{name}: a wall is one line; a point lies {aside_m:.3f} m off it,"
                f" at most {OFF_LINE_M} m are allowed"
            )
        at_m = off @ along
        if ((at_m < first - OFF_LINE_M) | (at_m > last + OFF_LINE_M)).any():
            raise GeoJsonError(f"{where}.{name}: must lie between the wall's ends")


def _polygon(rings: list[list[list[float]]], where: str) -> Floats:
    """The outer ring, counter-clockwise, first corner not repeated; holes are filled."""
    ring = _ring(rings[0], where)
    shape = shapely.Polygon(ring)
    if not shape.is_valid or shape.area <= 0.0:
        raise GeoJsonError(f"{where}: its ring crosses or touches itself: {_reason(shape)}")
    return _outline(ring[:-1])


def _ring(points: list[list[float]], where: str) -> Floats:
    ring = np.array([point[:2] for point in points], dtype=np.float64)
    if not np.array_equal(ring[0], ring[-1]):
        raise GeoJsonError(f"{where}: its ring is not closed: the last corner must be the first")
    return ring


def _outline(corners: Floats) -> Floats:
    """Counter-clockwise."""
    return corners if area_of(corners) > 0.0 else corners[::-1]


def _reason(shape: shapely.Polygon) -> str:
    return str(shapely.is_valid_reason(shape)) if shape.area > 0.0 else "it has no area"


def _segments(line: list[list[float]], where: str) -> Floats:
    points = np.array([point[:2] for point in line], dtype=np.float64)
    lengths = np.hypot(*np.diff(points, axis=0).T)
    if lengths.min() < 0.9 / MM:  # to the millimetre, that is less than 1
        raise GeoJsonError(f"{where}: a line has two points less than 1 mm apart")
    return np.hstack([points[:-1], points[1:]])


def _rounded(points: Floats) -> list[list[float]]:
    return [[round(x, 3) + 0.0, round(y, 3) + 0.0] for x, y in points.tolist()]


def _object_feature(one: MapObject) -> dict[str, Any]:
    corners = np.vstack([one.polygon, one.polygon[:1]])
    ring = _rounded(corners)
    if not shapely.Polygon(ring).is_valid:  # it would be refused: two sides are as near as that
        ring = corners.tolist()
    properties = {
        "kind": one.kind,
        "id": one.id,
        "bottom_m": round(one.bottom_m, 3),
        "top_m": round(one.top_m, 3),
        "seen_from": one.seen_from,
        "confidence": round(one.confidence, 3),
        "finished": one.finished.tolist(),
    }
    geometry = {"type": "Polygon", "coordinates": [ring]}
    return {"type": "Feature", "geometry": geometry, "properties": properties}


def _wall_feature(wall: WallRecord) -> dict[str, Any]:
    lines = [_rounded(segment.reshape(2, 2)) for segment in wall.segments]
    openings = [[round(value, 3) for value in row] for row in wall.openings.tolist()]
    properties = {"kind": "wall", "id": wall.id, "openings": openings}
    geometry = {"type": "MultiLineString", "coordinates": lines}
    return {"type": "Feature", "geometry": geometry, "properties": properties}
