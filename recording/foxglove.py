"""States and scans of a recording as messages that Foxglove and Lichtblick draw as they are.

A message is what `recording.schemas` describes, in plain values. What is not known is left out, or
drawn as such: a cell that is not known never looks like a free one.
Frames: `map`, `body` (on the ground under the axle) and `laser`, as in docs/architecture.md.
"""

import binascii
import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np
import numpy.typing as npt

from core.config import Config
from core.records import PoseReport, StopZoneReport
from mapod_link.bodies import POSE_VALID, ZONE_CAUSES, ZONE_STATES
from recording.schemas import HEALTH_BITS, POSE_NUMBERS, TOPICS, ZONE_NUMBERS
from recording.states import F32, CellWindow, ScanRecord, StateRecord

Message = dict[str, Any]
Topical = tuple[str, str, Message]  # topic, name of the schema, message
Xyz = tuple[float, float, float]

U1, F4 = np.dtype("u1"), np.dtype("<f4")
NUMERIC_TYPES = {U1: 1, F4: 7}  # of a PackedElementField
RGBA = [("red", U1), ("green", U1), ("blue", U1), ("alpha", U1)]
MAP_CELL = np.dtype([("state", U1), *RGBA])
ELEVATION_CELL = np.dtype([("height", F4), ("variance", F4), *RGBA])
POINT = np.dtype([("x", F4), ("y", F4), ("z", F4)])
# Unknown is a grey film, free bluish green, an obstacle orange: told apart by the colour-blind too
STATE_RGBA = np.array([[128, 128, 128, 64], [0, 158, 115, 140], [213, 94, 0, 255]], np.uint8)
HEIGHTS_M = (-0.5, -0.1, 0.0, 0.1, 1.0)  # and their colours: blue, light blue, grey, yellow, orange
HEIGHT_RGB = ((0, 60, 140), (86, 180, 233), (200, 200, 200), (240, 228, 66), (213, 94, 0))
ZONE_COLOURS = ((0.5, 0.5, 0.5), (0.0, 0.62, 0.45), (0.94, 0.89, 0.26), (0.84, 0.37, 0.0))
MODES = ("booting", "running", "degraded", "fault", "replayed")
LEVELS = {"debug": 1, "info": 2, "warning": 3, "error": 4}
NO_RANGE = 0.0  # JSON has no NaN: a range of zero is none
BELOW_M = -0.01  # the elevation lies under the map, so that they do not flicker
TRAIL_STEP_M, TRAIL_POINTS = 0.2, 500  # of the path
LINE_M, LETTERS_M, TEXT_Z_M = 0.03, 0.25, 1.5
LINE_STRIP, LINE_LOOP, ALL = 0, 1, 1
NO_TIME = {"sec": 0, "nsec": 0}


@dataclass(frozen=True, slots=True)
class RobotShape:
    """What the pictures need to know of the robot."""

    front_m: float
    rear_m: float
    width_m: float
    laser_xyz_m: Xyz  # on the body
    laser_rpy_rad: Xyz  # right side down, looking down, turned left


def shape_of(config: Config) -> RobotShape:
    robot, scanner = config.robot, config.scanner
    return RobotShape(
        robot.front_m,
        robot.rear_m,
        robot.width_m,
        scanner.mount_xyz_m,
        scanner.mount_rpy_rad,
    )


def encoded(message: Message) -> bytes:
    return msgspec.json.encode(message)


class Messages:
    """Makes the messages of one run, in its order; keeps the trail of the path."""

    def __init__(self, shape: RobotShape | None, utc_offset_s: float) -> None:
        """`shape`: None where it is not known; then there is no footprint and no laser frame.

        `utc_offset_s`: UTC less the host's monotonic clock.
        """
        self._shape, self._utc_offset_s = shape, utc_offset_s
        self._trail: deque[tuple[float, float]] = deque(maxlen=TRAIL_POINTS)

    def t_ns(self, t_s: float) -> int:
        """UTC of an instant of the monotonic clock."""
        return round((t_s + self._utc_offset_s) * 1e9)

    def of_state(self, state: StateRecord) -> Iterator[Topical]:
        at, pose, window = self._time(state.t_s), state.pose, state.window
        if window is not None:
            yield _topical("/map", map_grid(at, window))
            if state.height_m is not None and state.variance_m2 is not None:
                yield self.of_heights(state.t_s, window, state.height_m, state.variance_m2)
        if pose.health & POSE_VALID:
            self._follow(pose.x_m, pose.y_m)
            yield _topical("/tf", {"transforms": list(self._transforms(at, pose))})
            here = _pose((pose.x_m, pose.y_m, 0.0), _rpy(pose))
            yield _topical("/pose", {"timestamp": at, "frame_id": "map", "pose": here})
        entities = self._scene(at, state)
        yield _topical("/scene", {"deletions": [_delete_all(at)], "entities": entities})
        yield _topical("/health", health(state, at))

    def of_heights(
        self, t_s: float, window: CellWindow, height_m: F32, variance_m2: F32
    ) -> Topical:
        """Heights and variances (rows, columns) where the window lies; NaN: not known."""
        return _topical(
            "/elevation", elevation_grid(self._time(t_s), window, height_m, variance_m2)
        )

    def of_scan(self, scan: ScanRecord) -> Iterator[Topical]:
        at = self._time(scan.t_s)
        last_rad = scan.first_rad + scan.step_rad * max(len(scan.ranges_m) - 1, 0)
        ranges_m = np.where(np.isfinite(scan.ranges_m), scan.ranges_m, NO_RANGE)
        sweep = {
            "timestamp": at,
            "frame_id": "laser",
            "pose": _pose((0.0, 0.0, 0.0)),
            "start_angle": scan.first_rad,
            "end_angle": last_rad,
            "ranges": np.round(ranges_m.astype(np.float64), 4).tolist(),
            "intensities": [],
        }
        yield _topical("/scan", sweep)
        if scan.points_map is not None:
            yield self.of_points(scan.t_s, scan.points_map)

    def of_points(self, t_s: float, points_map: F32) -> Topical:
        """Returns (n, 3) of a sweep, map frame."""
        return _topical("/points", point_cloud(self._time(t_s), points_map))

    def of_log(self, t_s: float, level: str, text: str) -> Topical:
        """A line of the log; a level that has no word here is told as unknown."""
        line = {
            "timestamp": self._time(t_s),
            "level": LEVELS.get(level, 0),
            "message": text,
            "name": "mapod",
            "file": "",
            "line": 0,
        }
        return _topical("/log", line)

    def _time(self, t_s: float) -> Message:
        sec, nsec = divmod(self.t_ns(t_s), 10**9)
        return {"sec": sec, "nsec": nsec}

    def _follow(self, x_m: float, y_m: float) -> None:
        if not self._trail or math.dist(self._trail[-1], (x_m, y_m)) >= TRAIL_STEP_M:
            self._trail.append((x_m, y_m))

    def _transforms(self, at: Message, pose: PoseReport) -> Iterator[Message]:
        yield _transform(at, "map", "body", (pose.x_m, pose.y_m, 0.0), _rpy(pose))
        if self._shape is not None:
            mount = self._shape.laser_xyz_m, self._shape.laser_rpy_rad
            yield _transform(at, "body", "laser", *mount)

    def _scene(self, at: Message, state: StateRecord) -> list[Message]:
        """Path, and where the pose is known the robot and what it may do."""
        path = [(x_m, y_m, 0.0) for x_m, y_m in self._trail]
        line = _line(LINE_STRIP, path, (0.34, 0.71, 0.91))
        entities = [_entity(at, "map", "path", lines=[line])] if len(path) > 1 else []
        if state.pose.health & POSE_VALID:
            words = MODES[state.pose.mode] if state.pose.mode < len(MODES) else "unknown mode"
            words += f"\n{describe(state.zone)}" if state.zone is not None else ""
            entities.append(_entity(at, "body", "words", texts=[_text(words)]))
            if (shape := self._shape) is not None:
                entities.append(_entity(at, "body", "footprint", lines=[_footprint(shape)]))
                if state.zone is not None:
                    ways = list(_free_ways(shape, state.zone))
                    entities.append(_entity(at, "body", "way", cubes=ways))
        return entities


# Grids and points


def map_grid(at: Message, window: CellWindow) -> Message:
    """The obstacle map: `state` (0 unknown, 1 free, 2 obstacle), and its colour."""
    cells = np.zeros(window.states.shape, MAP_CELL)
    known = np.where(window.states < len(STATE_RGBA), window.states, 0)
    cells["state"] = known
    _paint(cells, STATE_RGBA[known])
    return _grid(at, window, cells, 0.0)


def elevation_grid(at: Message, window: CellWindow, height_m: F32, variance_m2: F32) -> Message:
    """Heights and their variance; cells of no height are not drawn."""
    cells = np.zeros(height_m.shape, ELEVATION_CELL)
    cells["height"], cells["variance"] = height_m, variance_m2
    known = np.isfinite(height_m)
    shown = np.where(known, height_m, 0.0)
    colours = [np.interp(shown, HEIGHTS_M, channel) for channel in zip(*HEIGHT_RGB, strict=True)]
    _paint(cells, np.stack([*colours, np.where(known, 255.0, 0.0)], axis=-1).astype(np.uint8))
    return _grid(at, window, cells, BELOW_M)


def _paint(cells: npt.NDArray[Any], rgba: npt.NDArray[np.uint8]) -> None:
    for k, (name, _) in enumerate(RGBA):
        cells[name] = rgba[..., k]


def _grid(at: Message, window: CellWindow, cells: npt.NDArray[Any], z_m: float) -> Message:
    """Row 0 has the lowest y, column 0 the lowest x; the pose is that cell's outer corner."""
    corner = window.corner_i * window.cell_m, window.corner_j * window.cell_m, z_m
    return {
        "timestamp": at,
        "frame_id": "map",
        "pose": _pose(corner),
        "column_count": cells.shape[1],
        "cell_size": {"x": window.cell_m, "y": window.cell_m},
        "row_stride": cells.shape[1] * cells.dtype.itemsize,
        "cell_stride": cells.dtype.itemsize,
        **_packed(cells),
    }


def point_cloud(at: Message, points_map: F32) -> Message:
    points = np.zeros(len(points_map), POINT)
    points["x"], points["y"], points["z"] = points_map.T
    return {
        "timestamp": at,
        "frame_id": "map",
        "pose": _pose((0.0, 0.0, 0.0)),
        "point_stride": points.dtype.itemsize,
        **_packed(points),
    }


def _packed(elements: npt.NDArray[Any]) -> Message:
    """The fields of each element, and all of them as text of base64."""
    assert elements.dtype.fields is not None
    fields = [
        {"name": name, "offset": offset, "type": NUMERIC_TYPES[dtype]}
        for name, (dtype, offset, *_) in elements.dtype.fields.items()
    ]
    data = binascii.b2a_base64(elements.tobytes(), newline=False)
    return {"fields": fields, "data": data.decode()}


# Health


def health(state: StateRecord, at: Message) -> Message:
    """Flat numbers; without those that are not finite, and without a pose that is not known."""
    pose, zone = state.pose, state.zone
    numbers: dict[str, float] = {"t_s": state.t_s, "mode": pose.mode, "health": pose.health}
    numbers |= {name: pose.health >> bit & 1 for name, bit in HEALTH_BITS.items()}
    places = {} if pose.health & POSE_VALID else {"x_m", "y_m", "yaw_rad", "v_mps"}
    numbers |= {name: getattr(pose, name) for name in POSE_NUMBERS if name not in places}
    if zone is not None:
        numbers |= {"zone_state": zone.state, "zone_causes": zone.causes}
        numbers |= {name: getattr(zone, name) for name in ZONE_NUMBERS}
    return {"timestamp": at} | {name: n for name, n in numbers.items() if math.isfinite(n)}


def describe(zone: StopZoneReport) -> str:
    """As a receiver of the link reads it: `stop: an obstacle`."""
    state = ZONE_STATES[zone.state] if zone.state < len(ZONE_STATES) else "unknown"
    causes = [name for bit, name in enumerate(ZONE_CAUSES) if zone.causes >> bit & 1]
    return f"{state}: {', '.join(causes)}" if causes else state


# Shapes


def _footprint(shape: RobotShape) -> Message:
    front, rear, side = shape.front_m, -shape.rear_m, shape.width_m / 2
    corners = [(front, side, 0.0), (rear, side, 0.0), (rear, -side, 0.0), (front, -side, 0.0)]
    return _line(LINE_LOOP, corners, (0.0, 0.45, 0.7))


def _free_ways(shape: RobotShape, zone: StopZoneReport) -> Iterator[Message]:
    """How far the way is free ahead and behind; none where nothing is known."""
    colour = ZONE_COLOURS[zone.state if zone.state < len(ZONE_COLOURS) else 0]
    ways = (shape.front_m, zone.free_ahead_m, 1.0), (shape.rear_m, zone.free_behind_m, -1.0)
    for edge_m, free_m, sign in ways:
        if zone.state and 0.0 < free_m < math.inf:
            yield {
                "pose": _pose((sign * (edge_m + free_m / 2), 0.0, 0.0)),
                "size": {"x": free_m, "y": shape.width_m, "z": 0.01},
                "color": _colour(colour, 0.3),
            }


def _line(kind: int, points: list[Xyz], rgb: Xyz) -> Message:
    return {
        "type": kind,
        "pose": _pose((0.0, 0.0, 0.02)),
        "thickness": LINE_M,
        "scale_invariant": False,
        "points": [{"x": x, "y": y, "z": z} for x, y, z in points],
        "color": _colour(rgb, 1.0),
        "colors": [],
        "indices": [],
    }


def _text(words: str) -> Message:
    return {
        "pose": _pose((0.0, 0.0, TEXT_Z_M)),
        "billboard": True,
        "font_size": LETTERS_M,
        "scale_invariant": False,
        "color": _colour((1.0, 1.0, 1.0), 1.0),
        "text": words,
    }


def _entity(at: Message, frame: str, name: str, **shapes: list[Message]) -> Message:
    kinds = ["arrows", "cubes", "spheres", "cylinders", "lines", "triangles", "texts", "models"]
    return {
        "timestamp": at,
        "frame_id": frame,
        "id": name,
        "lifetime": NO_TIME,
        "frame_locked": True,
        "metadata": [],
        **{kind: shapes.get(kind, []) for kind in kinds},
    }


def _delete_all(at: Message) -> Message:
    return {"timestamp": at, "type": ALL, "id": ""}


def _transform(at: Message, parent: str, child: str, xyz: Xyz, rpy_rad: Xyz) -> Message:
    pose = _pose(xyz, rpy_rad)
    return {
        "timestamp": at,
        "parent_frame_id": parent,
        "child_frame_id": child,
        "translation": pose["position"],
        "rotation": pose["orientation"],
    }


def _rpy(pose: PoseReport) -> Xyz:
    return pose.roll_rad, pose.pitch_rad, pose.yaw_rad


def _pose(xyz: Xyz, rpy_rad: Xyz = (0.0, 0.0, 0.0)) -> Message:
    return {"position": dict(zip("xyz", xyz, strict=True)), "orientation": quaternion(*rpy_rad)}


def quaternion(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Message:
    """Of roll about x, then pitch about y, then yaw about z."""
    cr, sr = math.cos(roll_rad / 2), math.sin(roll_rad / 2)
    cp, sp = math.cos(pitch_rad / 2), math.sin(pitch_rad / 2)
    cy, sy = math.cos(yaw_rad / 2), math.sin(yaw_rad / 2)
    return {
        "x": cy * cp * sr - sy * sp * cr,
        "y": cy * sp * cr + sy * cp * sr,
        "z": sy * cp * cr - cy * sp * sr,
        "w": cy * cp * cr + sy * sp * sr,
    }


def _colour(rgb: Xyz, alpha: float) -> Message:
    return {**dict(zip("rgb", rgb, strict=True)), "a": alpha}


def _topical(topic: str, message: Message) -> Topical:
    return topic, TOPICS[topic], message
