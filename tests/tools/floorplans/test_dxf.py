"""Floor plans from DXF drawings, as ezdxf writes them: shapes, units, layers, blocks, bad files."""

import json
import math
from contextlib import suppress
from pathlib import Path
from typing import Any

import ezdxf.filemanagement
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from shapely import LineString

from core.objects.vector_map.geojson import map_from_floor_plan
from tests import Capsys, Patch
from tools.cli.plan import UNITS, main
from tools.floorplans import dxf
from tools.floorplans.dxf import Reading, drawn_in, plan_from_walls
from tools.floorplans.records import PlanFileError

HALL = [(0, 0), (6000, 0), (6000, 4000), (0, 4000)]  # mm


def new(unit: int = 4) -> Any:
    drawing = ezdxf.filemanagement.new("R2010")
    drawing.header["$INSUNITS"] = unit
    return drawing


def walls_from_dxf(path: Path, reading: Reading) -> list[LineString]:
    return drawn_in(path, reading).walls


def saved(drawing: Any, folder: Path) -> Path:
    path = folder / "hall.dxf"
    drawing.saveas(path)
    return path


@pytest.fixture
def hall(tmp_path: Path) -> Path:
    """Outline, a wall, a round pillar, a square one in a block, turned, and a text."""
    drawing = new()
    space = drawing.modelspace()
    space.add_lwpolyline(HALL, close=True, dxfattribs={"layer": "WALLS"})
    space.add_line((3000, 0), (3000, 2500), dxfattribs={"layer": "WALLS"})
    space.add_circle((1500, 2000), 200, dxfattribs={"layer": "PILLARS"})
    block = drawing.blocks.new("PILLAR")
    block.add_lwpolyline([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)], close=True)
    place = {"xscale": 400, "yscale": 400, "rotation": 45, "layer": "PILLARS"}
    space.add_blockref("PILLAR", (4500, 2000), dxfattribs=place)
    space.add_text("hall", dxfattribs={"layer": "WALLS"})
    return saved(drawing, tmp_path)


def test_lines_curves_and_blocks_are_walls_in_metres(hall: Path) -> None:
    walls = walls_from_dxf(hall, Reading())
    assert len(walls) == 4
    outline, wall, circle, pillar = walls
    assert outline.length == pytest.approx(20.0)
    np.testing.assert_allclose(wall.coords, [[3.0, 0.0], [3.0, 2.5]])
    assert circle.length == pytest.approx(2 * math.pi * 0.2, rel=0.01)
    assert pillar.centroid.distance(circle.centroid) == pytest.approx(3.0, abs=1e-6)
    assert pillar.bounds[2] - pillar.bounds[0] == pytest.approx(0.4 * math.sqrt(2))
    assert [len(walls_from_dxf(hall, Reading(layers=names))) for names in (("walls",), ())] == [
        2,
        4,
    ]


def test_the_floor_is_what_they_close_in(hall: Path) -> None:
    free = plan_from_walls(walls_from_dxf(hall, Reading())).free
    assert free.area == pytest.approx(24.0 - 0.02 * 12.5, abs=0.15)
    assert not free.intersects(walls_from_dxf(hall, Reading())[1])


def test_another_origin_and_unit(hall: Path) -> None:
    reading = Reading(unit="cm", layers=("WALLS",), origin=(30.0, 10.0, 90.0))
    _, wall = walls_from_dxf(hall, reading)
    np.testing.assert_allclose(wall.coords, [[-10.0, 0.0], [15.0, 0.0]], atol=1e-9)


def test_a_block_that_is_inserted_in_rows_is_there_as_often(tmp_path: Path) -> None:
    drawing = new(unit=6)
    drawing.blocks.new("POST").add_circle((0, 0), 0.1)
    rows = {"row_count": 3, "column_count": 2, "row_spacing": 2.0, "column_spacing": 5.0}
    drawing.modelspace().add_blockref("POST", (0, 0), dxfattribs=rows)
    walls = walls_from_dxf(saved(drawing, tmp_path), Reading())
    assert {tuple(np.round(wall.centroid.coords[0], 3)) for wall in walls} == {
        (x, y) for x in (0.0, 5.0) for y in (0.0, 2.0, 4.0)
    }


def test_what_is_on_layer_0_of_a_block_is_on_that_of_its_insert(tmp_path: Path) -> None:
    drawing = new(unit=6)
    for layer in ("0", "OWN"):
        drawing.blocks.new(f"IN_{layer}").add_line((0, 0), (1, 0), dxfattribs={"layer": layer})
    outer = drawing.blocks.new("OUTER")
    for k, layer in enumerate(("0", "DOORS")):
        outer.add_blockref("IN_0", (0, 1 + k), dxfattribs={"layer": layer})
    outer.add_blockref("IN_OWN", (0, 3))
    rows = {"layer": "WALLS", "row_count": 2, "row_spacing": 10.0}
    drawing.modelspace().add_blockref("OUTER", (0, 0), dxfattribs=rows)
    drawing.modelspace().add_line((0, 0), (1, 0))  # on layer 0
    path = saved(drawing, tmp_path)

    def heights(layer: str) -> list[float]:
        return sorted(w.coords[0][1] for w in walls_from_dxf(path, Reading(layers=(layer,))))

    told = {layer: heights(layer) for layer in ("WALLS", "DOORS", "OWN", "0")}
    assert told == {"WALLS": [1, 11], "DOORS": [2, 12], "OWN": [3, 13], "0": [0]}


def test_both_lines_of_a_double_wall_are_walls_in_a_turned_block_too(tmp_path: Path) -> None:
    drawing = new(unit=6)
    style = drawing.mline_styles.new("WALL")
    style.dxf.flags = style.FILL  # a hatch between both, which is no wall
    style.elements.append(0.1)
    style.elements.append(-0.1)
    block = drawing.blocks.new("WALL")
    for space in (drawing.modelspace(), block):
        kind = {"style_name": "WALL", "justification": 1}  # its points lie in the middle
        space.add_mline([(0, 0), (5, 0), (5, 5)], dxfattribs=kind)
    place = {"xscale": 2, "yscale": 2, "zscale": 2, "rotation": 90}
    drawing.modelspace().add_blockref("WALL", (20, 0), dxfattribs=place)
    walls = walls_from_dxf(saved(drawing, tmp_path), Reading())
    assert len(walls) == 8
    plain, turned = walls[:4], walls[4:]
    assert sorted(wall.length for wall in plain) == pytest.approx([4.9, 4.9, 5.1, 5.1])
    assert sorted(wall.length for wall in turned) == pytest.approx([9.8, 9.8, 10.2, 10.2])


def test_what_is_drawn_and_no_wall_is_counted(tmp_path: Path) -> None:
    drawing = new(unit=6)
    for space in (drawing.modelspace(), drawing.blocks.new("B")):
        space.add_line((0, 0), (5, 0), dxfattribs={"layer": "WALLS"})
        space.add_point((1, 1))
        space.add_text("hall")
        hatch = space.add_hatch()
        hatch.paths.add_polyline_path([(0, 0), (1, 0), (1, 1)], is_closed=True)
    drawing.modelspace().add_blockref("B", (0, 9))
    drawing.modelspace().add_xline((0, 0), (1, 0))
    path = saved(drawing, tmp_path)
    found = drawn_in(path, Reading())
    assert len(found.walls) == 2
    assert found.left_out == {"POINT": 2, "XLINE": 1}
    assert drawn_in(path, Reading(layers=("WALLS",))).left_out == {}
    with pytest.raises(PlanFileError, match=r"no line is drawn .left out: 2 POINT, 1 XLINE"):
        drawn_in(path, Reading(layers=("0",)))


def nested(deep: int, each: int) -> Any:
    """Blocks of so many blocks each, so deep in each other."""
    drawing = new()
    for k in range(deep):
        block = drawing.blocks.new(f"B{k}")
        for x in range(each):
            block.add_blockref(f"B{k + 1}", (x, 0))
    drawing.blocks.new(f"B{deep}").add_line((0, 0), (1, 0))
    drawing.modelspace().add_blockref("B0", (0, 0))
    return drawing


def one(way: Any, unit: int = 4) -> Any:
    drawing = new(unit)
    way(drawing.modelspace())
    return drawing


@pytest.mark.parametrize(
    ("drawing", "message"),
    [
        (one(lambda space: space.add_line((0, 0), (9, 0)), unit=0), "says no unit that is known"),
        (
            one(lambda space: space.add_text("hello")),
            "no line is drawn; its layers are 0, Defpoints",
        ),
        (
            one(lambda space: space.add_line((0, 0), (6e6, 0))),
            "within 5000 m of its origin, 6000 m",
        ),
        (nested(17, 1), "at most 16 deep in each other"),
        (nested(3, 11), "at most 1000 entities"),
    ],
)
def test_what_is_no_plan_is_refused(
    drawing: Any, message: str, tmp_path: Path, monkeypatch: Patch
) -> None:
    monkeypatch.setattr(dxf, "MOST_PARTS", 1000)
    with pytest.raises(PlanFileError, match=message):
        walls_from_dxf(saved(drawing, tmp_path), Reading())


@given(st.integers(0, 10_000), st.binary(max_size=12))
def test_a_damaged_file_is_read_or_refused(
    tmp_path_factory: pytest.TempPathFactory, where: int, bytes_: bytes
) -> None:
    path = tmp_path_factory.getbasetemp() / "damaged.dxf"
    whole = DAMAGED.encode()
    at = where % len(whole)
    path.write_bytes(whole[:at] + bytes_ + whole[at + len(bytes_) :])
    with suppress(PlanFileError):
        assert walls_from_dxf(path, Reading(unit="mm"))


@pytest.mark.parametrize("format_", ["asc", "bin"])
def test_a_file_that_is_cut_is_read_or_refused(hall: Path, tmp_path: Path, format_: str) -> None:
    whole, cut = tmp_path / "whole.dxf", tmp_path / "cut.dxf"
    ezdxf.filemanagement.readfile(hall).saveas(whole, fmt=format_)
    content = whole.read_bytes()
    for size in (3000, *range(0, len(content), 1 + len(content) // 20)):
        cut.write_bytes(content[:size])
        with suppress(PlanFileError):
            assert walls_from_dxf(cut, Reading())


def test_a_header_alone_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "s.dxf"
    path.write_text("  0\nSECTION\n  2\nHEADER\n")
    with pytest.raises(PlanFileError, match="must be a DXF drawing: it ends too early"):
        walls_from_dxf(path, Reading())


DAMAGED = "0\nSECTION\n2\nENTITIES\n0\nLINE\n8\nW\n10\n0\n20\n0\n11\n9\n21\n9\n0\nENDSEC\n0\nEOF\n"


def test_walls_are_written_as_a_map_of_objects_begins_with_them(
    tmp_path: Path, capsys: Capsys
) -> None:
    drawing = new()
    space = drawing.modelspace()
    doubled = [HALL[0], HALL[0], *HALL[1:], (0.4, 0.4)]  # and its end lies beside its beginning
    space.add_lwpolyline(doubled, close=True)
    space.add_lwpolyline([(0, 0), (1000.0, 0), (1000.96, 0)])
    space.add_line((0, 0), (0.5, 0.5))
    space.add_line((100, 100), (101, 100))  # 1 mm, as numbers are rounded perhaps less
    space.add_circle((500, 500), 0.4)
    kept = tmp_path / "walls.json"
    assert main([str(saved(drawing, tmp_path)), "--walls", str(kept)]) == 0
    assert capsys.readouterr().out.startswith("2 walls, 21.0 m")
    walls = map_from_floor_plan(kept.read_text(), 1.0).walls
    assert [np.ptp(wall.segments[0].reshape(2, 2), axis=0).max() for wall in walls] == (
        pytest.approx([6.0, 4.0, 6.0, 4.0, 1.001], abs=1e-9)
    )
    outline = json.loads(kept.read_text())["features"][0]["geometry"]["coordinates"]
    assert outline[0] == outline[-1] == [0.0, 0.0]


def test_a_drawing_on_the_command_line(hall: Path, tmp_path: Path, capsys: Capsys) -> None:
    assert main([str(hall), "--radius", "0.2", "--report"]) == 0
    assert json.loads(capsys.readouterr().out)["covered_of_reachable"] > 0.97
    kept = tmp_path / "walls.json"
    assert main([str(hall), "--layers", "WALLS", "--walls", str(kept)]) == 0
    assert capsys.readouterr().out == "2 walls, 22.5 m in all\n"
    assert len(map_from_floor_plan(kept.read_text(), 1.0).walls) == 5  # each side its own
    drawing = ezdxf.filemanagement.readfile(hall)
    drawing.modelspace().add_point((0, 0))
    drawing.saveas(hall)
    assert main([str(hall), "--walls", str(kept)]) == 0
    assert capsys.readouterr().err == f"mapod plan: {hall}: left out: 1 POINT\n"
    open_one = saved(one(lambda space: space.add_line((0, 0), (900, 0))), tmp_path)
    assert main([str(open_one)]) == 2
    assert f"{open_one}: no lines of it close in a floor" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["hall.json", "--origin", "1,2,90"])
    assert "--origin, --walls: only with a DXF drawing" in capsys.readouterr().err
    assert tuple(dxf.UNITS) == UNITS
    (tmp_path / "no.dxf").write_text("0\nhello\n")
    assert main([str(tmp_path / "no.dxf")]) == 2
    assert f"{tmp_path / 'no.dxf'}: must be a DXF drawing: " in capsys.readouterr().err
