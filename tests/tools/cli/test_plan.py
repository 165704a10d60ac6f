"""`mapod plan`: figures, files and pictures of a plan; ways from A to B; what wrong use is told."""

import json
import os
from pathlib import Path

import pytest
import shapely
from PIL import Image

from tests import VECTORS, Capsys
from tools.cli.plan import main

HALL = {
    "type": "Polygon",
    "coordinates": [
        [[0, 0], [4, 0], [4, 3], [0, 3], [0, 0]],
        [[2, 0.5], [2.2, 0.5], [2.2, 2.8], [2, 2.8], [2, 0.5]],
    ],
}


@pytest.fixture
def hall(tmp_path: Path) -> str:
    path = tmp_path / "hall.geojson"
    path.write_text(json.dumps(HALL))
    return str(path)


def test_a_plan_is_told_drawn_and_written(hall: str, tmp_path: Path, capsys: Capsys) -> None:
    out, picture = (tmp_path / name for name in ("path.geojson", "a.png"))
    ends, files = ["--start", "0.3,0.3", "--dock", "3.5,2.5"], ["--out", str(out)]
    assert main([hall, *ends]) == 0
    assert "covered" in capsys.readouterr().out
    assert main([hall, *ends, *files, "--picture", str(picture), "--report"]) == 0
    figures = json.loads(capsys.readouterr().out)
    missed_m2 = sum(shapely.Polygon(rings[0], rings[1:]).area for rings in figures["uncovered"])
    assert missed_m2 == pytest.approx((1 - figures["covered_of_reachable"]) * 12, abs=0.3)
    assert figures["covered_of_reachable"] > 0.98
    assert figures["outside_m2"] < 1e-9
    features = json.loads(out.read_text())["features"]
    lines = [f for f in features if f["geometry"]["type"] == "LineString"]
    assert {f["properties"]["kind"] for f in lines} <= {"sweep", "travel"}
    assert lines[0]["geometry"]["coordinates"][0] == [0.3, 0.3]
    assert lines[-1]["geometry"]["coordinates"][-1] == [3.5, 2.5]
    with Image.open(picture) as image:
        assert max(image.size) == pytest.approx(900, abs=30)


def test_a_file_is_written_whole_or_not_at_all(hall: str, tmp_path: Path) -> None:
    out, other = tmp_path / "way.json", tmp_path / "other.json"
    words = [hall, "--from", "1,2.5", "--to", "1,1", "--radius", "0.2", "--out"]
    other.write_text("kept")
    out.hardlink_to(other)
    assert main([*words, str(out)]) == 0
    assert json.loads(out.read_text())["type"] == "FeatureCollection"
    assert other.read_text() == "kept"  # the file that was there was not written into
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(
        ["hall.geojson", "way.json", "other.json"]
    )
    link = tmp_path / "link.json"
    link.symlink_to(other)
    assert main([*words, str(link)]) == 0
    assert link.is_symlink()
    assert other.read_text() == out.read_text()


def test_a_path_goes_into_a_pipe_too(hall: str, tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    words = ["--from", "1,2.5", "--to", "1,1", "--radius", "0.2", "--out", str(pipe)]
    assert main([hall, *words]) == 0
    assert json.loads(os.read(reader, 100_000))["type"] == "FeatureCollection"
    os.close(reader)


def test_a_real_map_is_planned_from_its_dock_room_by_room(capsys: Capsys) -> None:
    path = str(VECTORS / "floorplans" / "s5_two_rooms_path.json")
    assert main([path, "--rooms", "--exact-lanes", "--footprint", "0.1,0.1 -0.1,0.1 0,-0.12"]) == 0
    told = capsys.readouterr().out
    assert "off the floor       0.000000 m2" in told


def test_a_way_from_a_to_b_and_why_there_is_none(hall: str, tmp_path: Path, capsys: Capsys) -> None:
    out = tmp_path / "way.geojson"
    ends = ["--from", "1,2.5", "--to", "3,2.5"]
    assert main([hall, *ends, "--radius", "0.2", "--out", str(out)]) == 0
    assert "corners" in capsys.readouterr().out
    assert json.loads(out.read_text())["features"][0]["geometry"]["coordinates"][0] == [1, 2.5]
    assert main([hall, *ends, "--radius", "0.4"]) == 1
    assert "too narrow" in capsys.readouterr().err


def test_a_way_of_a_long_machine_through_a_passage_that_its_circle_does_not_pass(
    hall: str, capsys: Capsys
) -> None:
    shape = ["--footprint", "0.35,0.2 -0.35,0.2 -0.35,-0.2 0.35,-0.2"]
    assert main([hall, "--from", "1,2.5", "--to", "3,2.5", "--radius", "0.403"]) == 1
    capsys.readouterr()
    assert main([hall, "--from", "1,2.5,-90", "--to", "3,2.5,90", *shape]) == 0
    assert "corners" in capsys.readouterr().out
    assert main([hall, "--from", "0.25,2.5,0", "--to", "3,2.5", *shape]) == 1
    assert "start: at 0.25,2.5 the machine does not fit at 0 deg" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--start", "1"], "must be two numbers X,Y in m, is '1'"),
        (["--start", "1,nan"], "must be two numbers X,Y in m, is '1,nan'"),
        (["--from", "1,1"], "--from and --to: say both or none"),
        (
            ["--from", "1,1,2,3", "--to", "1,1"],
            "must be two or three numbers X,Y[,DEG] in m and deg",
        ),
        (["--from", "1,1,90", "--to", "1,1"], "--from, --to: DEG only with --footprint"),
        (["--footprint", "1,1 2,2"], "must be three or more corners"),
        (["--free-ends", "--dock", "1,1"], "--free-ends: not with --start or --dock"),
        (["--width", "0"], "must be from 0.01 to 100, is '0'"),
        (["--radius", "1", "--footprint", "0,1 1,0 1,1"], "not allowed with argument"),
    ],
)
def test_wrong_use_is_one_line(words: list[str], said: str, hall: str, capsys: Capsys) -> None:
    with pytest.raises(SystemExit, match="2"):
        main([hall, *words])
    told = capsys.readouterr().err
    assert said in told
    assert told.count("\n") == 1


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--overlap", "0.3"], "overlap_m: must be at most 0.8 of width_m 0.3, is 0.3"),
        (["--radius", "3"], "the machine has no room: needs 3 m around its centre"),
        (["--start", "9,9"], "start: 9,9 is"),
        (["--dock", "9,9"], "dock: 9,9 is"),
        (["--out", "/no/such/folder/x.json"], "--out /no/such/folder/x.json: must be a file in"),
        (["--picture", "x.jpg"], "--picture x.jpg: must end with .png"),
    ],
)
def test_what_cannot_be_planned_ends_with_status_2_and_why(
    words: list[str], said: str, hall: str, capsys: Capsys
) -> None:
    assert main([hall, *words]) == 2
    assert said in capsys.readouterr().err


def test_a_file_that_is_no_plan_is_told_by_its_name(tmp_path: Path, capsys: Capsys) -> None:
    assert main([str(tmp_path / "none.json")]) == 2
    assert "none.json: No such file or directory" in capsys.readouterr().err
