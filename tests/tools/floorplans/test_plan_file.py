"""Floor plans from files: real robots' maps as their README counts them, GeoJSON, and bad files."""

import json
from pathlib import Path

import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from core.objects.vector_map.geojson import OF_A_PLAN
from core.paths.geometry.rings import length_of
from tests import VECTORS
from tools.floorplans.geojson import KINDS
from tools.floorplans.plan_file import load_plan
from tools.floorplans.records import PlanFileError

PLANS = VECTORS / "floorplans"
SQUARE = [[0, 0], [4, 0], [4, 3], [0, 3], [0, 0]]


def polygon(ring: object, **properties: object) -> dict[str, object]:
    geometry = {"type": "Polygon", "coordinates": [ring]}
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def written(folder: Path, content: object) -> Path:
    path = folder / "plan.json"
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


@pytest.mark.parametrize(
    ("name", "area_m2", "rooms", "driven_m"),
    [
        ("s5_two_rooms_path", 7.32, 2, 105.3),
        ("z10_six_rooms_restrictions", 44.03, 6, None),  # 44.97 without its no-go area and wall
        ("d9_clutter", 38.44, 2, 23.3),
        ("viomi_small", 10.22, 2, None),  # 10.79 without
    ],
)
def test_real_maps_have_the_floor_that_was_counted(
    name: str, area_m2: float, rooms: int, driven_m: float | None
) -> None:
    plan = load_plan(PLANS / f"{name}.json")
    assert plan.free.is_valid
    assert plan.free.area == pytest.approx(area_m2, abs=0.01)
    assert len(plan.rooms) == rooms
    assert sum(room.area for _, room in plan.rooms) <= plan.free.area + 1.0
    assert plan.dock is not None
    if driven_m is None:
        assert plan.driven is None
    else:
        assert plan.driven is not None
        assert length_of(plan.driven) == pytest.approx(driven_m, abs=0.1)
        assert shapely.convex_hull(plan.free).contains(shapely.MultiPoint(plan.driven[::50]))


def test_a_map_of_version_1_lists_each_cell_and_y_points_down(tmp_path: Path) -> None:
    layer = {"type": "floor", "pixels": [0, 0, 1, 0, 1, 1]}
    content = {"metaData": {"version": 1}, "pixelSize": 5, "layers": [layer]}
    plan = load_plan(written(tmp_path, content))
    assert plan.free.area == pytest.approx(3 * 0.05**2)
    assert plan.free.bounds == pytest.approx((0.0, -0.1, 0.1, 0.0))


@pytest.mark.parametrize("kind", ["obstacle", "wall"])
def test_geojson_knows_floor_obstacles_rooms_walls_start_and_dock(
    kind: str, tmp_path: Path
) -> None:
    wall = {"type": "LineString", "coordinates": [[2, 0], [2, 1]]}
    dock = {"type": "Point", "coordinates": [3.5, 0.5]}
    content = {
        "type": "FeatureCollection",
        "features": [
            polygon(SQUARE),
            polygon([[1, 1], [1.5, 1], [1.5, 2], [1, 1]], kind=kind),
            polygon([[0, 0], [2, 0], [2, 3], [0, 3], [0, 0]], kind="room", name="hall"),
            {"type": "Feature", "properties": None, "geometry": wall},
            {"type": "Feature", "properties": {"kind": "dock"}, "geometry": dock},
        ],
    }
    plan = load_plan(written(tmp_path, content))
    assert plan.free.area == pytest.approx(12 - 0.25 - 0.02, abs=0.001)
    assert [name for name, _ in plan.rooms] == ["hall"]
    assert (plan.start, plan.dock) == (None, (3.5, 0.5))


def test_a_polygon_that_is_a_wall_is_no_floor_and_null_is_no_kind_and_no_name(
    tmp_path: Path,
) -> None:
    wall = [[1, 1], [2, 1], [2, 2], [1, 2], [1, 1]]
    features = [
        polygon(SQUARE, kind=None, name=None),
        polygon(wall, kind="wall"),
        polygon(wall, kind="room", name=None),
    ]
    plan = load_plan(written(tmp_path, {"type": "FeatureCollection", "features": features}))
    assert plan.free.area == pytest.approx(11.0)
    assert [name for name, _ in plan.rooms] == ["1"]


MAP = {"metaData": {"version": 2}, "pixelSize": 5, "layers": []}


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("", "must be JSON: line 1"),
        ("[1]", r"must be a JSON object, is \[1\]"),
        ("{}", "must be GeoJSON .* or a Valetudo map"),
        ('{"type": "Point", "coordinates": [NaN, 1]}', "JSON, which has no NaN"),
        ("[" * 100_000, "must be JSON"),
        ({"type": "Topology"}, 'type: must be of FeatureCollection.*is "Topology"'),
        ({"type": "FeatureCollection", "features": [{"type": []}]}, r"type: must be of .*is \[\]"),
        ({"type": "FeatureCollection", "features": 3}, "features: must be a list, is 3"),
        ({"type": "FeatureCollection", "features": []}, "has no floor"),
        ({"type": "Polygon", "coordinates": [[[0, 0], [1, 1]]]}, "must be 3 or more points"),
        ({"type": "Polygon", "coordinates": [[[0, 0], [1, "x"], [2, 2]]]}, 'a number, is "x"'),
        ({"type": "Polygon", "coordinates": [[0, 1, 2]]}, r"must be points \[x, y\], is 0"),
        ({"type": "Point", "coordinates": [1, 2]}, "kind must be start or dock"),
        (polygon(SQUARE, kind="lawn"), 'properties.kind: must be of floor, .* is "lawn"'),
        (polygon(SQUARE, kind="start"), 'geometry.type: must be Point for a start, is "Polygon"'),
        (
            {
                "type": "Feature",
                "properties": {"kind": "dock"},
                "geometry": {"type": "LineString", "coordinates": [[0, 0], [1, 1]]},
            },
            'geometry.type: must be Point for a dock, is "LineString"',
        ),
        ('{"type": "Point", "coordinates": [' + "9" * 5000 + ", 1]}", "at most 4300 digits"),
        (polygon(SQUARE, kind="\x1b[31m"), r"kind: must be of floor, .* is .\\u001b\[31m.$"),
        (polygon([[0, 0], [9e6, 0], [0, 9e6], [0, 0]]), "at most 5000 m long, is 9e"),
        ({**MAP, "metaData": {"version": 3}}, "metaData.version: must be 1 or 2, is 3"),
        ({**MAP, "pixelSize": 0}, "pixelSize: must be from 0.5 to 100 cm, is 0"),
        ({**MAP, "layers": {}}, r"layers: must be a list, is \{\}"),
        (MAP, "has no floor"),
        (
            {**MAP, "layers": [{"type": "floor", "compressedPixels": [1, 2]}]},
            r"layers\[0\].compressedPixels: must be 3 numbers a run, is 2",
        ),
        (
            {**MAP, "layers": [{"type": "floor", "compressedPixels": [1, -2, 3]}]},
            "whole numbers from 0 to",
        ),
        (
            {**MAP, "entities": [{"type": "virtual_wall", "points": [1, 2]}]},
            r"entities\[0\].points: must be 2 or more pairs",
        ),
    ],
)
def test_a_bad_file_is_told_by_its_name_and_what_is_wrong(
    content: object, said: str, tmp_path: Path
) -> None:
    path = written(tmp_path, content)
    with pytest.raises(PlanFileError, match=said) as told:
        load_plan(path)
    assert str(told.value).startswith(str(path))


def test_no_file_is_told_too(tmp_path: Path) -> None:
    with pytest.raises(PlanFileError, match="No such file"):
        load_plan(tmp_path / "none.json")
    with pytest.raises(PlanFileError, match="Is a directory"):
        load_plan(tmp_path)
    (tmp_path / "b").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(PlanFileError, match="must be JSON"):
        load_plan(tmp_path / "b")


@given(st.data())
def test_no_damage_of_a_file_does_worse_than_an_error(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    content = json.loads((PLANS / "s5_two_rooms_path.json").read_text())
    where = content
    for _ in range(data.draw(st.integers(1, 5))):
        if not isinstance(where, dict | list) or not where:
            break
        key = data.draw(
            st.sampled_from(sorted(where) if isinstance(where, dict) else range(len(where)))
        )
        if data.draw(st.booleans()) or not isinstance(where[key], dict | list):
            where[key] = data.draw(st.sampled_from([None, -1, 1e300, "x", [], {}, [[]], True]))
            break
        where = where[key]
    path = written(tmp_path_factory.getbasetemp(), content)
    try:
        assert load_plan(path).free.area > 0
    except PlanFileError as error:
        assert str(error).startswith(str(path))  # noqa: PT017


def test_a_map_of_objects_knows_the_same_kinds() -> None:
    assert {*OF_A_PLAN, "wall"} == {*KINDS}
