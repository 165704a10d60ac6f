"""JSON schemas of the messages in a recording: Foxglove's, and mapod's own Health.

Foxglove, Lichtblick and others know a message by its schema's name and read the fields that stand
here. A test compares names, fields and kinds with those of foxglove-sdk.
Source: docs.foxglove.dev, SDK, schemas.
"""

import json
from typing import Any

Schema = dict[str, Any]
Kind = str | list[str]  # of a field: a kind's name, or [name] for a list of them

NUMERIC = ["UNKNOWN", "UINT8", "INT8", "UINT16", "INT16", "UINT32", "INT32", "FLOAT32", "FLOAT64"]
LEVELS = ["UNKNOWN", "DEBUG", "INFO", "WARNING", "ERROR", "FATAL"]
ENUMS = {  # values count from 0
    "NumericType": NUMERIC,
    "LogLevel": LEVELS,
    "LineType": ["LINE_STRIP", "LINE_LOOP", "LINE_LIST"],
    "SceneEntityDeletionType": ["MATCHING_ID", "ALL"],
}
PLAIN: dict[str, Schema] = {
    "number": {"type": "number"},
    "uint": {"type": "integer", "minimum": 0},
    "string": {"type": "string"},
    "bool": {"type": "boolean"},
    "bytes": {"type": "string", "contentEncoding": "base64"},
}
TYPES: dict[str, dict[str, Kind]] = {
    "Vector2": {"x": "number", "y": "number"},
    "Vector3": {"x": "number", "y": "number", "z": "number"},
    "Point3": {"x": "number", "y": "number", "z": "number"},
    "Quaternion": {"x": "number", "y": "number", "z": "number", "w": "number"},
    "Color": {"r": "number", "g": "number", "b": "number", "a": "number"},
    "Pose": {"position": "Vector3", "orientation": "Quaternion"},
    "KeyValuePair": {"key": "string", "value": "string"},
    "PackedElementField": {"name": "string", "offset": "uint", "type": "NumericType"},
    "Grid": {
        "timestamp": "time",
        "frame_id": "string",
        "pose": "Pose",
        "column_count": "uint",
        "cell_size": "Vector2",
        "row_stride": "uint",
        "cell_stride": "uint",
        "fields": ["PackedElementField"],
        "data": "bytes",
    },
    "LaserScan": {
        "timestamp": "time",
        "frame_id": "string",
        "pose": "Pose",
        "start_angle": "number",
        "end_angle": "number",
        "ranges": ["number"],
        "intensities": ["number"],
    },
    "PointCloud": {
        "timestamp": "time",
        "frame_id": "string",
        "pose": "Pose",
        "point_stride": "uint",
        "fields": ["PackedElementField"],
        "data": "bytes",
    },
    "FrameTransform": {
        "timestamp": "time",
        "parent_frame_id": "string",
        "child_frame_id": "string",
        "translation": "Vector3",
        "rotation": "Quaternion",
    },
    "FrameTransforms": {"transforms": ["FrameTransform"]},
    "PoseInFrame": {"timestamp": "time", "frame_id": "string", "pose": "Pose"},
    "Log": {
        "timestamp": "time",
        "level": "LogLevel",
        "message": "string",
        "name": "string",
        "file": "string",
        "line": "uint",
    },
    "ArrowPrimitive": {
        "pose": "Pose",
        "shaft_length": "number",
        "shaft_diameter": "number",
        "head_length": "number",
        "head_diameter": "number",
        "color": "Color",
    },
    "CubePrimitive": {"pose": "Pose", "size": "Vector3", "color": "Color"},
    "SpherePrimitive": {"pose": "Pose", "size": "Vector3", "color": "Color"},
    "CylinderPrimitive": {
        "pose": "Pose",
        "size": "Vector3",
        "bottom_scale": "number",
        "top_scale": "number",
        "color": "Color",
    },
    "LinePrimitive": {
        "type": "LineType",
        "pose": "Pose",
        "thickness": "number",
        "scale_invariant": "bool",
        "points": ["Point3"],
        "color": "Color",
        "colors": ["Color"],
        "indices": ["uint"],
    },
    "TriangleListPrimitive": {
        "pose": "Pose",
        "points": ["Point3"],
        "color": "Color",
        "colors": ["Color"],
        "indices": ["uint"],
    },
    "TextPrimitive": {
        "pose": "Pose",
        "billboard": "bool",
        "font_size": "number",
        "scale_invariant": "bool",
        "color": "Color",
        "text": "string",
    },
    "ModelPrimitive": {
        "pose": "Pose",
        "scale": "Vector3",
        "color": "Color",
        "override_color": "bool",
        "url": "string",
        "media_type": "string",
        "data": "bytes",
    },
    "SceneEntity": {
        "timestamp": "time",
        "frame_id": "string",
        "id": "string",
        "lifetime": "duration",
        "frame_locked": "bool",
        "metadata": ["KeyValuePair"],
        "arrows": ["ArrowPrimitive"],
        "cubes": ["CubePrimitive"],
        "spheres": ["SpherePrimitive"],
        "cylinders": ["CylinderPrimitive"],
        "lines": ["LinePrimitive"],
        "triangles": ["TriangleListPrimitive"],
        "texts": ["TextPrimitive"],
        "models": ["ModelPrimitive"],
    },
    "SceneEntityDeletion": {"timestamp": "time", "type": "SceneEntityDeletionType", "id": "string"},
    "SceneUpdate": {"deletions": ["SceneEntityDeletion"], "entities": ["SceneEntity"]},
}
HEALTH_BITS = {  # key of a health bit: its place in the word (planner link, section 3)
    "scanner_ok": 0,
    "ahrs_ok": 1,
    "wheels_ok": 2,
    "clocks_locked": 3,
    "pose_valid": 4,
    "map_valid": 5,
    "no_overrun": 6,
    "drop_ahead": 7,
    "sight_impaired": 8,
    "too_steep": 9,
    "stop_asked": 15,
}
ZONE_NUMBERS = (  # fields of a stop zone report
    "free_ahead_m",
    "obstacle_ahead_m",
    "free_behind_m",
    "obstacle_behind_m",
    "contact_s",
    "allowed_ahead_mps",
    "allowed_behind_mps",
    "nearest_m",
    "bearing_rad",
)
POSE_NUMBERS = (  # fields of a pose report
    "x_m",
    "y_m",
    "yaw_rad",
    "pitch_rad",
    "roll_rad",
    "v_mps",
    "w_radps",
    "age_scan_s",
    "age_ahrs_s",
    "age_enc_s",
)


def schema_of(kind: str) -> Schema:
    """Of one kind of field or message, whole: nothing in it refers elsewhere."""
    if kind in PLAIN:
        return PLAIN[kind]
    if kind in ENUMS:
        names = enumerate(ENUMS[kind])
        values = [{"title": name, "const": value} for value, name in names]
        return {"title": f"foxglove.{kind}", "oneOf": values}
    if kind in ("time", "duration"):
        seconds: Schema = {"type": "integer"} | ({"minimum": 0} if kind == "time" else {})
        nanoseconds = {"type": "integer", "minimum": 0, "maximum": 999_999_999}
        properties = {"sec": seconds, "nsec": nanoseconds}
        return {"type": "object", "title": kind, "properties": properties}
    properties = {name: _field(of) for name, of in TYPES[kind].items()}
    return _object(f"foxglove.{kind}", properties, list(properties))


def _field(kind: Kind) -> Schema:
    if isinstance(kind, list):
        return {"type": "array", "items": schema_of(kind[0])}
    return schema_of(kind)


def health_schema() -> Schema:
    """Flat numbers, for plots. What is not known, or endless, is left out of a message."""
    always = ["t_s", "mode", "health", *HEALTH_BITS]
    rest = [*POSE_NUMBERS, "zone_state", "zone_causes", *ZONE_NUMBERS]
    numbers = {name: schema_of("number") for name in always + rest}
    return _object("mapod.Health", {"timestamp": schema_of("time")} | numbers, always)


def _object(title: str, properties: Schema, required: list[str]) -> Schema:
    return {"type": "object", "title": title, "properties": properties, "required": required}


TOPICS = {  # every topic of decoded messages, and its schema
    "/map": "foxglove.Grid",
    "/elevation": "foxglove.Grid",
    "/scan": "foxglove.LaserScan",
    "/points": "foxglove.PointCloud",
    "/tf": "foxglove.FrameTransforms",
    "/pose": "foxglove.PoseInFrame",
    "/scene": "foxglove.SceneUpdate",
    "/log": "foxglove.Log",
    "/health": "mapod.Health",
}
SCHEMAS = {  # texts by name
    name: json.dumps(
        health_schema() if name == "mapod.Health" else schema_of(name.removeprefix("foxglove."))
    )
    for name in sorted(set(TOPICS.values()))
}
