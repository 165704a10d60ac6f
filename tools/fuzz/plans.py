"""Floor plans as a target: GeoJSON and Valetudo's maps are plans with an area, or are refused."""

import json
from pathlib import Path

from tools.floorplans.plan_file import load_plan
from tools.floorplans.records import MOST_M, PlanFileError
from tools.fuzz.program import refused
from tools.fuzz.recordings import place

SQUARE = [[0, 0], [4, 0], [4, 3], [0, 3], [0, 0]]


def run(data: bytes) -> int:
    """1 where it is a plan. Raises AssertionError."""
    path = place().with_name("plan.json")
    path.write_bytes(data)
    try:
        plan = load_plan(path)
    except PlanFileError as error:
        return refused(error)
    assert plan.free.is_valid
    assert plan.free.area > 0.0
    low_x, low_y, high_x, high_y = plan.free.bounds
    assert max(high_x - low_x, high_y - low_y) <= MOST_M
    return 1


def feature(type_: str, coordinates: object, **properties: object) -> dict[str, object]:
    geometry = {"type": type_, "coordinates": coordinates}
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def write_seeds(folder: Path) -> None:
    """Each kind of geometry by itself, all together, and a small map of a vacuum robot."""
    hole = [[1, 1], [2, 1], [2, 2], [1, 1]]
    features = [
        feature("Polygon", [SQUARE, hole]),
        feature("Polygon", [SQUARE], kind="room", name="hall"),
        feature("MultiPolygon", [[hole], [[[3, 1], [4, 1], [4, 2]]]], kind="obstacle"),
        feature("LineString", [[0, 1], [3, 1.5]], kind="wall"),
        feature("MultiLineString", [[[0, 1], [3, 1.5]], [[1, 0], [1, 1]]]),
        feature("Point", [0.5, 0.5], kind="start"),
        feature("Point", [3.5, 2.5], kind="dock"),
    ]
    whole = {"type": "FeatureCollection", "features": features}
    layers = [
        {"type": "floor", "pixels": [1, 1, 1, 2, 2, 1]},
        {"type": "segment", "metaData": {"name": "a"}, "compressedPixels": [0, 0, 9, 0, 1, 9]},
    ]
    entities = [
        {"type": "no_go_area", "points": [0, 0, 20, 0, 20, 20]},
        {"type": "virtual_wall", "points": [0, 0, 20, 20]},
        {"type": "robot_position", "points": [5, 5]},
        {"type": "path", "points": [5, 5, 6, 6]},
    ]
    vacuum = {
        "metaData": {"version": 2},
        "pixelSize": 5,
        "layers": layers,
        "entities": entities,
    }
    (folder / "whole").write_text(json.dumps(whole), encoding="utf-8")
    (folder / "vacuum").write_text(json.dumps(vacuum), encoding="utf-8")
    bare = {"type": "GeometryCollection", "geometries": [features[0]["geometry"]]}
    (folder / "bare").write_text(json.dumps(bare), encoding="utf-8")
    for number, one in enumerate(features):
        pair = {"type": "FeatureCollection", "features": [features[0], one]}
        (folder / f"feature-{number}").write_text(json.dumps(pair), encoding="utf-8")
    for number, value in enumerate(("1e308", "-1e308", "1e-320", "9" * 400, "null")):
        text = json.dumps(features[0]).replace("4", value)
        (folder / f"number-{number}").write_text(text, encoding="utf-8")
