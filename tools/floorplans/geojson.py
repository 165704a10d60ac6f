"""GeoJSON in metres to floor plans, and paths to GeoJSON.

Polygons are floor, unless their property `kind` says `obstacle`, `wall` or `room` (with a `name`);
lines are walls; points say `start` or `dock`. Source: RFC 7946, but for its degrees.
"""

import math
from collections.abc import Iterator, Sequence

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from core.paths.geometry.space import repaired
from core.paths.geometry.ways import Way
from core.paths.records import CoveragePlan
from core.records import F64
from tools.floorplans.records import FloorPlan, Json, PlanFileError, list_at, number, shown

WALL_M = 0.01  # half the width of a wall that is drawn as a line
POINTS = ("start", "dock")  # kinds of these alone
KINDS = ("floor", "obstacle", "room", "wall", *POINTS)
LEAST_M = 0.001001  # between points of a wall: a map of objects refuses less than 1 mm
DEPTH = {"Point": 0, "LineString": 1, "MultiLineString": 2, "Polygon": 2, "MultiPolygon": 3}


def plan_from_geojson(content: Json) -> FloorPlan:
    """Raises PlanFileError: what is wrong."""
    floors: list[BaseGeometry] = []
    taken: list[BaseGeometry] = []
    plan = FloorPlan(shapely.MultiPolygon())
    for kind, name, shape in _shapes(content, "", "", ""):
        if isinstance(shape, shapely.Point):
            if kind not in POINTS:
                raise PlanFileError(f"a point: its kind must be start or dock, is {shown(kind)}")
            setattr(plan, kind, (shape.x, shape.y))
        elif shape.geom_type.endswith("LineString"):
            taken.append(shape.buffer(WALL_M))
        elif kind == "room":
            plan.rooms.append((name or str(len(plan.rooms) + 1), repaired(shape)))
        elif kind in ("obstacle", "wall"):
            taken.append(repaired(shape))
        else:
            floors.append(repaired(shape))
    plan.free = repaired(shapely.union_all(floors).difference(shapely.union_all(taken)))
    return plan


def _shapes(
    part: object, where: str, kind: str, name: str
) -> Iterator[tuple[str, str, BaseGeometry]]:
    """Each geometry with the kind and name that its feature gives it."""
    if not isinstance(part, dict):
        raise PlanFileError(f"{where or 'top'}: must be an object, is {shown(part)}")
    type_ = part.get("type")
    if type_ == "FeatureCollection":
        for k, each in enumerate(list_at(part, "features", where)):
            yield from _shapes(each, f"{where}features[{k}].", kind, name)
    elif type_ == "GeometryCollection":
        for k, each in enumerate(list_at(part, "geometries", where)):
            yield from _shapes(each, f"{where}geometries[{k}].", kind, name)
    elif type_ == "Feature":
        known = part.get("properties") or {}
        if not isinstance(known, dict):
            raise PlanFileError(f"{where}properties: must be an object, is {shown(known)}")
        kind = kind if known.get("kind") is None else str(known["kind"])
        if kind and kind not in KINDS:
            allowed = ", ".join(KINDS)
            raise PlanFileError(f"{where}properties.kind: must be of {allowed}, is {shown(kind)}")
        if part.get("geometry") is not None:
            named = "" if known.get("name") is None else str(known["name"])
            yield from _shapes(part["geometry"], f"{where}geometry.", kind, named)
    elif isinstance(type_, str) and type_ in DEPTH:
        if kind in POINTS and type_ != "Point":
            raise PlanFileError(f"{where}type: must be Point for a {kind}, is {shown(type_)}")
        yield kind, name, _geometry(type_, list_at(part, "coordinates", where), where)
    else:
        allowed = ", ".join(["FeatureCollection", "Feature", "GeometryCollection", *DEPTH])
        raise PlanFileError(f"{where}type: must be of {allowed}, is {shown(type_)}")


def _geometry(type_: str, coordinates: list[object], where: str) -> BaseGeometry:
    at = f"{where}coordinates"
    if type_ == "Point":
        return shapely.Point(_pair(coordinates, at))
    if type_ == "LineString":
        return shapely.LineString(_line(coordinates, at, 2))
    if type_ == "MultiLineString":
        return shapely.MultiLineString([_line(each, at, 2) for each in coordinates])
    if type_ == "Polygon":
        return _polygon(coordinates, at)
    return shapely.MultiPolygon([_polygon(each, at) for each in coordinates])


def _polygon(rings: object, where: str) -> shapely.Polygon:
    if not isinstance(rings, list) or not rings:
        raise PlanFileError(f"{where}: must be a list of rings, is {shown(rings)}")
    shell, *holes = [_line(ring, where, 3) for ring in rings]
    return shapely.Polygon(shell, holes)


def _line(points: object, where: str, least: int) -> F64:
    if not isinstance(points, list) or len(points) < least:
        raise PlanFileError(f"{where}: must be {least} or more points, is {shown(points)}")
    return np.array([_pair(point, where) for point in points])


def _pair(point: object, where: str) -> tuple[float, float]:
    if not isinstance(point, list) or len(point) < 2:
        raise PlanFileError(f"{where}: must be points [x, y], is {shown(point)}")
    return number(point[0], where), number(point[1], where)


def plan_as_geojson(plan: CoveragePlan) -> Json:
    """Segments as lines with their kind, in the order in which they are driven; what is missed."""
    features = [
        _feature(shapely.LineString(segment.points), kind=segment.kind, number=k)
        for k, segment in enumerate(plan.segments)
    ]
    for kind in ("uncovered", "unreachable"):
        area = getattr(plan, kind)
        if not area.is_empty:
            features.append(_feature(area, kind=kind))
    return {"type": "FeatureCollection", "features": features}


def way_as_geojson(way: Way) -> Json:
    """A way from A to B, with its turns on the spot: degrees to the left, at each inner point."""
    turns = np.degrees(way.turns_rad).round(1).tolist()
    line = shapely.LineString(way.points)
    feature = _feature(line, kind="travel", number=0, turns_deg=turns)
    return {"type": "FeatureCollection", "features": [feature]}


def walls_as_geojson(walls: Sequence[shapely.LineString]) -> Json:
    """Lines of walls, as a map of objects takes them: without points and lines of under 1 mm."""
    lines = [_thinned(shapely.get_coordinates(wall).round(4)) for wall in walls]
    features = [_feature(shapely.LineString(line), kind="wall") for line in lines if len(line) > 1]
    return {"type": "FeatureCollection", "features": features}


def _thinned(points: F64) -> list[F64]:
    """Without points that are hardly off the one before; the ends stay, if there are two."""

    def is_near(one: F64, other: F64) -> bool:
        return math.dist(one, other) < LEAST_M

    kept = [points[0]]
    for point in points[1:]:
        if not is_near(kept[-1], point):
            kept.append(point)
    while len(kept) > 1 and is_near(kept[-1], points[-1]):
        kept.pop()
    return kept if is_near(kept[-1], points[-1]) else [*kept, points[-1]]


def _feature(shape: BaseGeometry, **properties: object) -> Json:
    return {"type": "Feature", "properties": properties, "geometry": _millimetres(shape)}


def _millimetres(shape: BaseGeometry) -> Json:
    """As GeoJSON, to a tenth of a millimetre."""
    return {
        "type": shape.geom_type,
        "coordinates": _rounded(shapely.geometry.mapping(shape)["coordinates"]),
    }


def _rounded(part: float | Sequence[object]) -> object:
    return round(part, 4) if isinstance(part, float) else [_rounded(each) for each in part]  # type: ignore[arg-type]
