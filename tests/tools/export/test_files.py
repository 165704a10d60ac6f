"""Files for others' programs, read back by others' readers."""

import csv
import io
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from core.mapping.layers import LayerView
from core.records import FREE, OBSTACLE
from tools.export.pcd import points_from, write_pcd
from tools.export.raster import write_png, write_ros
from tools.export.tables import TABLES, Tables

CORNER, CELL_M = (-7, 12), 0.2
KINDS = np.random.default_rng(5).choice([FREE, OBSTACLE, math.nan], (4, 6))


def view(name: str, values: Any) -> LayerView:
    return LayerView(name, np.asarray(values, np.float32), *CORNER, CELL_M)


def place_of(row: int, column: int) -> tuple[float, float]:
    """The middle of a cell of the layer, metres."""
    return (CORNER[0] + column + 0.5) * CELL_M, (CORNER[1] + row + 0.5) * CELL_M


# Tables


def rows_of_health(count: int) -> dict[str, Any]:
    columns: dict[str, Any] = {name: np.arange(count) for name in TABLES["health"]}
    columns["t_s"] = np.arange(count) / 7.0
    columns["utc_ns"] = 1_700_000_000_123_456_789 + np.arange(count)
    columns["age_enc_s"] = np.where(np.arange(count) % 2, np.nan, 0.25)
    return columns


def test_csv_keeps_every_digit_and_leaves_out_what_is_not_known(tmp_path: Path) -> None:
    tables = Tables(tmp_path, "csv")
    tables.add("health", rows_of_health(3))
    tables.close()
    with (tmp_path / "health.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["t_s"]) for row in rows] == [0.0, 1 / 7.0, 2 / 7.0]
    assert rows[2]["utc_ns"] == "1700000000123456791"
    assert [row["age_enc_s"] for row in rows] == ["0.25", "", "0.25"]
    assert (tmp_path / "scans.csv").read_text().count("\n") == 1
    assert tables.rows["health"] == 3


def test_parquet_has_the_same_numbers(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    tables = Tables(tmp_path, "parquet")
    for _ in range(3):
        tables.add("health", rows_of_health(60_000))  # more than a row group
    tables.close()
    read = parquet.read_table(tmp_path / "health.parquet")
    for name, values in rows_of_health(60_000).items():
        np.testing.assert_array_equal(read[name].to_numpy(), np.tile(values, 3))
    assert parquet.read_table(tmp_path / "scans.parquet").num_rows == 0


# Points


def read_pcd(path: Path) -> dict[str, Any]:
    """Points by field, as the format's documentation describes a file."""
    head: dict[str, list[str]] = {}
    with path.open("rb") as file:
        while "DATA" not in head:
            line = file.readline().decode("ascii").split()
            if line[0] != "#":
                head[line[0]] = line[1:]
        rest = file.read()
    kinds = {"F": "f", "U": "u", "I": "i"}
    fields = list(zip(head["FIELDS"], head["TYPE"], head["SIZE"], strict=True))
    assert set(head["COUNT"]) == {"1"}
    count = int(head["WIDTH"][0]) * int(head["HEIGHT"][0])
    assert count == int(head["POINTS"][0])
    dtype = np.dtype([(name, f"<{kinds[kind]}{size}") for name, kind, size in fields])
    if head["DATA"] == ["binary"]:
        assert len(rest) == count * dtype.itemsize
        records = np.frombuffer(rest, dtype)
        return {name: records[name] for name in head["FIELDS"]}
    assert head["DATA"] == ["ascii"]
    columns = np.loadtxt(io.BytesIO(rest), ndmin=2).T
    assert columns.shape == (len(fields), count)
    return dict(zip(head["FIELDS"], columns, strict=True))


@pytest.mark.parametrize("is_ascii", [True, False])
@pytest.mark.parametrize("count", [1, 500])
def test_points_are_read_back(tmp_path: Path, count: int, is_ascii: bool) -> None:
    xyz = np.random.default_rng(count).normal(0, 20, (count, 3))
    path = tmp_path / "points.pcd"
    write_pcd(path, points_from(xyz, 12.5), is_ascii)
    read = read_pcd(path)
    for axis, name in enumerate("xyz"):
        np.testing.assert_allclose(read[name], xyz[:, axis], atol=1e-3)
    assert set(read["t"]) == {12.5}


# Pictures


def pixel_at(picture: Path, x_m: float, y_m: float) -> Any:
    """The pixel of a place, by the picture's world file."""
    image = pytest.importorskip("PIL.Image")
    a, d, b, e, c, f = (float(n) for n in picture.with_suffix(".pgw").read_text().split())
    assert (b, d) == (0.0, 0.0)
    with image.open(picture) as opened:
        opened.load()
        return opened.getpixel((round((x_m - c) / a), round((y_m - f) / e)))


def test_a_picture_of_states_lies_where_the_map_does(tmp_path: Path) -> None:
    picture, world, words = write_png(tmp_path, view("state", KINDS))
    assert world.name == "state.pgw"
    about = json.loads(words.read_text())
    for row, column in np.ndindex(KINDS.shape):
        red, green, blue, alpha = pixel_at(picture, *place_of(row, column))
        if np.isnan(KINDS[row, column]):
            assert alpha == 0
        else:
            kind = "free" if KINDS[row, column] == FREE else "obstacle"
            assert [red, green, blue, alpha] == about[kind]


@pytest.mark.parametrize("low", [0.0, -1.5])
def test_a_picture_of_values_gives_them_back(tmp_path: Path, low: float) -> None:
    heights_m = np.where(np.isnan(KINDS), np.nan, low + np.arange(24).reshape(4, 6) * 0.11)
    picture, _, words = write_png(tmp_path, view("height", heights_m))
    about = json.loads(words.read_text())
    assert about["unit"] == "m"
    step_m = 0.11 * 24 / 65_000
    for row, column in np.ndindex(heights_m.shape):
        pixel = pixel_at(picture, *place_of(row, column))
        if np.isnan(heights_m[row, column]):
            assert pixel == 0
        else:
            assert pixel > 0
            told_m = about["offset"] + about["scale"] * pixel
            assert told_m == pytest.approx(heights_m[row, column], abs=step_m)


@pytest.mark.parametrize("values", [np.full((2, 3), np.nan), np.full((2, 3), 0.5)])
def test_a_picture_of_nothing_or_of_one_value(tmp_path: Path, values: Any) -> None:
    picture, _, words = write_png(tmp_path, view("height", values))
    about = json.loads(words.read_text())
    pixel = pixel_at(picture, *place_of(1, 1))
    if np.isnan(values).all():
        assert pixel == 0
    else:
        assert about["offset"] + about["scale"] * pixel == pytest.approx(0.5)


def occupancy(folder: Path, x_m: float, y_m: float) -> str:
    """What ROS's map_server makes of a place, by its documentation."""
    said = dict(line.split(": ", 1) for line in (folder / "map.yaml").read_text().splitlines())
    assert (said["mode"], said["negate"]) == ("trinary", "0")
    x0_m, y0_m, yaw_rad = json.loads(said["origin"])
    assert yaw_rad == 0.0
    resolution_m = float(said["resolution"])
    magic, size, most, pixels = (folder / said["image"]).read_bytes().split(b"\n", 3)
    columns, rows = map(int, size.split())
    assert (magic, most, len(pixels)) == (b"P5", b"255", rows * columns)
    column = math.floor((x_m - x0_m) / resolution_m)
    row = rows - 1 - math.floor((y_m - y0_m) / resolution_m)
    share = (255 - pixels[row * columns + column]) / 255.0
    if share > float(said["occupied_thresh"]):
        return "occupied"
    return "free" if share < float(said["free_thresh"]) else "unknown"


def test_ros_reads_the_map_and_unknown_stays_unknown(tmp_path: Path) -> None:
    write_ros(tmp_path, view("state", KINDS))
    words = {FREE: "free", OBSTACLE: "occupied"}
    for row, column in np.ndindex(KINDS.shape):
        told = occupancy(tmp_path, *place_of(row, column))
        assert told == words.get(int(np.nan_to_num(KINDS[row, column])), "unknown")
