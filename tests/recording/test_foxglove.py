"""Messages for others' tools: their schemas are Foxglove's, and their numbers the map's."""

import base64
import json
import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from msgspec import structs

from core.geometry import R_from_rpy
from core.records import PoseReport, StopZoneReport
from recording.foxglove import Messages, RobotShape, encoded, quaternion
from recording.schemas import SCHEMAS, TOPICS
from recording.states import CellWindow, ScanRecord, StateRecord

UTC_OFFSET_S = 1_700_000_000.25
SHAPE = RobotShape(0.5, 0.2, 0.6, (0.25, 0.0, 1.08), (0.0, 0.13, 0.0))
POSE = PoseReport(1.3, -0.7, 0.4, 0.02, -0.01, 0.3, 0.1, 0x7F, 0.02, 0.01, math.inf, 1)
ZONE = StopZoneReport(1.5, math.inf, 0.0, 0.3, math.inf, 0.5, 0.0, 0.7, 0.2, (), 2, 0b11)
STATES = np.random.default_rng(5).integers(0, 3, (4, 6)).astype(np.uint8)
WINDOW = CellWindow(STATES, -7, 12, 0.2)
HEIGHT_M = np.where(STATES == 0, np.nan, STATES * 0.25).astype(np.float32)
STATE = StateRecord(10.5, POSE, ZONE, WINDOW, HEIGHT_M, HEIGHT_M**2)
SCAN = ScanRecord(
    10.4, -1.0, 0.5, np.array([2.0, np.nan, 3.5], np.float32), np.ones((2, 3), np.float32)
)
TYPES = {1: "u1", 7: "<f4"}


def decoded(messages: Iterator[tuple[str, str, dict[str, Any]]]) -> dict[str, Any]:
    """By topic, as a reader of their bytes has them."""
    return {topic: json.loads(encoded(message)) for topic, _, message in messages}


def cell_at(grid: dict[str, Any], field: str, x_m: float, y_m: float) -> float:
    """A field's value at a place of the frame, as Foxglove's documentation of Grid describes it."""
    position, size = grid["pose"]["position"], grid["cell_size"]
    column = math.floor((x_m - position["x"]) / size["x"])
    row = math.floor((y_m - position["y"]) / size["y"])
    [found] = [one for one in grid["fields"] if one["name"] == field]
    assert 0 <= column < grid["column_count"]
    start = row * grid["row_stride"] + column * grid["cell_stride"] + found["offset"]
    data = base64.b64decode(grid["data"], validate=True)
    return float(np.frombuffer(data, TYPES[found["type"]], 1, start)[0])


def test_a_grid_holds_the_cells_of_the_map_where_they_are() -> None:
    grids = decoded(Messages(SHAPE, UTC_OFFSET_S).of_state(STATE))
    for row, column in np.ndindex(STATES.shape):
        place = (-7 + column + 0.5) * 0.2, (12 + row + 0.5) * 0.2
        assert cell_at(grids["/map"], "state", *place) == STATES[row, column]
        height_m = cell_at(grids["/elevation"], "height", *place)
        np.testing.assert_equal(height_m, float(HEIGHT_M[row, column]))


def test_what_is_not_known_never_looks_free() -> None:
    strange = STATES.copy()
    strange[0, 0] = 77
    state = replace(STATE, window=replace(WINDOW, states=strange))
    grids = decoded(Messages(SHAPE, UTC_OFFSET_S).of_state(state))
    colours: dict[int, tuple[float, ...]] = {}
    for row, column in np.ndindex(STATES.shape):
        place = (-7 + column + 0.5) * 0.2, (12 + row + 0.5) * 0.2
        told = int(strange[row, column]) if strange[row, column] < 3 else 0
        rgba = tuple(
            cell_at(grids["/map"], name, *place) for name in ("red", "green", "blue", "alpha")
        )
        assert colours.setdefault(told, rgba) == rgba
        is_drawn = cell_at(grids["/elevation"], "alpha", *place) > 0
        assert is_drawn == bool(np.isfinite(HEIGHT_M[row, column]))
    assert len(set(colours.values())) == 3


def test_a_pose_that_is_not_known_is_not_told() -> None:
    messages = Messages(SHAPE, UTC_OFFSET_S)
    assert {"/pose", "/tf"} <= decoded(messages.of_state(STATE)).keys()
    blind = decoded(messages.of_state(replace(STATE, pose=structs.replace(POSE, health=0, mode=3))))
    assert not {"/pose", "/tf"} & blind.keys()
    assert blind["/scene"]["entities"] == []  # and what was drawn is deleted:
    assert blind["/scene"]["deletions"][0]["type"] == 1
    assert "x_m" not in blind["/health"]


def test_health_is_flat_numbers_without_endless_ones() -> None:
    health = decoded(Messages(SHAPE, UTC_OFFSET_S).of_state(STATE))["/health"]
    stamp = health.pop("timestamp")
    assert stamp["sec"] == 1_700_000_010
    assert abs(stamp["nsec"] - 750_000_000) < 1000
    assert all(type(number) in (int, float) for number in health.values())
    assert health["scanner_ok"] == 1
    assert health["drop_ahead"] == 0
    assert health["free_ahead_m"] == 1.5
    assert not {"age_enc_s", "contact_s"} & health.keys()


def test_a_range_that_is_none_is_zero_and_no_point() -> None:
    told = decoded(Messages(SHAPE, UTC_OFFSET_S).of_scan(SCAN))
    assert told["/scan"]["ranges"] == [2.0, 0.0, 3.5]
    assert told["/scan"]["end_angle"] == 0.0
    assert len(base64.b64decode(told["/points"]["data"])) == 2 * told["/points"]["point_stride"]


def test_the_trail_of_the_path_is_bounded_and_thinned() -> None:
    messages = Messages(SHAPE, UTC_OFFSET_S)
    scene: dict[str, Any] = {}
    for k in range(4000):
        pose = structs.replace(POSE, x_m=0.05 * k)
        told = {topic: m for topic, _, m in messages.of_state(replace(STATE, pose=pose))}
        scene = told["/scene"]
    [path] = [entity for entity in scene["entities"] if entity["id"] == "path"]
    xs_m = [point["x"] for point in path["lines"][0]["points"]]
    assert len(xs_m) == 500
    assert np.diff(xs_m).min() >= 0.2 - 1e-9


@pytest.mark.parametrize("rpy", [(0.1, -0.2, 2.5), (0.0, 0.13, 0.0), (-0.3, 0.2, -3.0)])
def test_a_quaternion_turns_as_the_matrix_does(rpy: tuple[float, float, float]) -> None:
    q = quaternion(*rpy)
    x, y, z, w = q["x"], q["y"], q["z"], q["w"]
    R = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    np.testing.assert_allclose(R, R_from_rpy(*rpy), atol=1e-12)


# Schemas


def lacks(value: Any, schema: dict[str, Any], where: str) -> Iterator[str]:
    """Where a value is not what a schema says: the little of JSON schema that ours use."""
    if "oneOf" in schema:
        if value not in [one["const"] for one in schema["oneOf"]]:
            yield f"{where}: {value}"
    elif schema["type"] == "object":
        if not isinstance(value, dict) or value.keys() - schema["properties"].keys():
            yield f"{where}: {value}"
            return
        yield from (f"{where}.{name}" for name in set(schema.get("required", [])) - value.keys())
        for name, one in value.items():
            yield from lacks(one, schema["properties"][name], f"{where}.{name}")
    elif schema["type"] == "array":
        for one in value:
            yield from lacks(one, schema["items"], f"{where}[]")
    else:
        kinds = {"number": (int, float), "integer": int, "string": str, "boolean": bool}
        is_kind = isinstance(value, kinds[schema["type"]])  # type: ignore[arg-type]
        if not is_kind or (schema["type"] != "boolean" and isinstance(value, bool)):
            yield f"{where}: {value!r}"
        elif schema.get("minimum", -math.inf) > (
            value if schema["type"] == "integer" else math.inf
        ):
            yield f"{where}: {value}"


def test_messages_are_what_their_schemas_say() -> None:
    messages = Messages(SHAPE, UTC_OFFSET_S)
    seen = set()
    moved = replace(STATE, pose=structs.replace(POSE, x_m=3.0))
    for topic, name, message in [
        *messages.of_state(STATE),
        *messages.of_state(moved),
        *messages.of_scan(SCAN),
        messages.of_log(10.0, "warning", "port_lost device=scanner"),
    ]:
        assert TOPICS[topic] == name
        assert list(lacks(json.loads(encoded(message)), json.loads(SCHEMAS[name]), topic)) == []
        seen.add(topic)
    assert seen == TOPICS.keys()


def numbers_and_bytes(data: bytes) -> Iterator[tuple[int, Any]]:
    """(field, value) of a protobuf message."""

    def varint(at: int) -> tuple[int, int]:
        number = shift = 0
        while True:
            number |= (data[at] & 127) << shift
            at, shift = at + 1, shift + 7
            if data[at - 1] < 128:
                return number, at

    at = 0
    while at < len(data):
        key, at = varint(at)
        value, at = varint(at)
        if key & 7 == 2:
            yield key >> 3, data[at : at + value]
            at += value
        else:
            assert key & 7 == 0
            yield key >> 3, value


KINDS = {1: "number", 3: "integer", 5: "integer", 7: "integer", 8: "boolean", 9: "string"}
KINDS |= {11: "object", 12: "string", 14: "oneOf"}


def fields_of_sdk(descriptors: bytes) -> dict[str, dict[str, tuple[str, bool]]]:
    """(kind, whether a list) by message and field, of a protobuf FileDescriptorSet."""
    found = {}
    for _, file in numbers_and_bytes(descriptors):
        parts = list(numbers_and_bytes(file))
        package = next(value for number, value in parts if number == 2).decode()
        for message in (value for number, value in parts if number == 4):
            name = next(v for n, v in numbers_and_bytes(message) if n == 1).decode()
            fields = [dict(numbers_and_bytes(v)) for n, v in numbers_and_bytes(message) if n == 2]
            found[f"{package}.{name}"] = {
                field[1].decode(): (KINDS[field[5]], field[4] == 3) for field in fields
            }
    return found


def fields_of_ours(schema: dict[str, Any]) -> Iterator[tuple[str, dict[str, tuple[str, bool]]]]:
    """The same of one of our schemas, and of all that it holds."""
    fields = {}
    for name, one in schema["properties"].items():
        inner = one["items"] if one.get("type") == "array" else one
        fields[name] = inner.get("type", "oneOf"), one.get("type") == "array"
        if inner.get("type") == "object" and inner["title"] not in ("time", "duration"):
            yield from fields_of_ours(inner)
    yield schema["title"], fields


def test_the_schemas_are_those_of_foxgloves_own_library() -> None:
    foxglove = pytest.importorskip("foxglove.messages")
    for name in sorted(SCHEMAS.keys() - {"mapod.Health"}):
        sdk = getattr(foxglove, name.removeprefix("foxglove.")).get_schema()
        assert sdk.name == name
        theirs = fields_of_sdk(sdk.data)
        for title, fields in fields_of_ours(json.loads(SCHEMAS[name])):
            assert fields == theirs[title], title
