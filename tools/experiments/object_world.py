"""A flat world with truth and a depth camera in it: frames as the map of objects gets them.

Rays meet boxes, walls and people; a hull has what rays met. The pose of a frame is wrong by a rigid
motion of its own, hulls by noise at each corner. Nothing of the map's code is in it.
"""

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import shapely

from core.objects.records import Detection, Floats, FrameObjects
from core.objects.vector_map.settings import ObjectMapSettings

FRAME_S = 0.1
CORNER_M = 0.03  # a ray that ends so near a corner has seen it
SETTINGS = ObjectMapSettings(
    cell_m=0.02,
    band_m=0.08,
    confirm_frames=5,
    gone_frames=20,
    memory_frames=30,
    pose_sigma_m=0.03,
    pose_sigma_deg=1.0,
    hull_sigma_m=0.01,
    view_gap_m=0.05,
    least_size_m=0.06,
    through_share=0.25,
    person_height_m=0.9,
    person_width_m=0.9,
    person_wait_s=30.0,
    coast_s=1.0,
    track_sigma_m=0.05,
    acceleration_mps2=2.0,
    speed_sigma_mps=0.3,
    wall_cell_m=0.05,
    wall_angle_deg=5.0,
    publish_m=0.01,
    active_objects=256,
)


@dataclass
class Thing:
    """A convex body: its outline (n, 2) m, counter-clockwise, and its height."""

    outline: Floats
    top_m: float = 0.5
    velocity: tuple[float, float] = (0.0, 0.0)
    is_person: bool = False


def box(
    x: float, y: float, length: float, width: float, yaw: float = 0.0, top_m: float = 0.5
) -> Thing:
    c, s = math.cos(yaw), math.sin(yaw)
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * [length / 2, width / 2]
    return Thing(corners @ np.array([[c, s], [-s, c]]) + [x, y], top_m)


def person(x: float, y: float, vx: float = 0.0, vy: float = 0.0) -> Thing:
    a = np.linspace(0.0, 2.0 * math.pi, 16, endpoint=False)
    return Thing(np.column_stack([x + 0.22 * np.cos(a), y + 0.17 * np.sin(a)]), 1.7, (vx, vy), True)


class Noise(NamedTuple):
    """1 sigma of a frame's place and yaw, and of a hull's corners; how often a hull is missing."""

    pose_m: float = 0.0
    pose_rad: float = 0.0
    hull_m: float = 0.0
    missing: float = 0.0


EXACT = Noise()


@dataclass
class World:
    """Things and walls as they are now, and the camera that looks at them."""

    things: list[Thing]
    walls: Floats = field(default_factory=lambda: np.zeros((0, 4)))
    noise: Noise = EXACT
    seed: int = 1
    fov_rad: float = math.radians(66.0)
    range_m: float = 5.0
    rays: int = 512
    view_gap_m: float = 0.03
    at_s: float = 100.0

    def __post_init__(self) -> None:
        self.random = np.random.default_rng(self.seed)
        self.hits = np.zeros(0, dtype=np.int64)
        self.corner_frames = [np.zeros(len(thing.outline), np.int64) for thing in self.things]

    def walk(self, dt_s: float = FRAME_S) -> None:
        """Let time pass, and all that moves go on."""
        self.at_s += dt_s
        for thing in self.things:
            thing.outline = thing.outline + dt_s * np.array(thing.velocity)

    def frame(self, x: float, y: float, yaw: float) -> FrameObjects:
        """What a camera there sees, as a robot has it that does not know its place better."""
        eye = np.array([x, y])
        bearings = yaw + self.fov_rad * (np.arange(self.rays) / (self.rays - 1) - 0.5)
        ranges, whose = self.cast(eye, bearings)
        ends = eye + ranges[:, None] * np.column_stack([np.cos(bearings), np.sin(bearings)])
        self.hits = whose
        self._note_corners(ends, whose)
        found = [
            Detection(self._rough(hull), 0.0, self.things[k].top_m, count)
            for k, hull, count in self._hulls(ends, whose)
            if self.random.random() >= self.noise.missing
        ]
        return self._misplaced(
            FrameObjects(
                self.at_s, (x, y), self._view(eye, bearings, ranges), tuple(found),
                self._segments(ends, whose),
            )
        )  # fmt: skip

    def cast(self, eye: Floats, bearings: Floats) -> tuple[Floats, np.ndarray]:
        """Ranges (n,) m and what they met: a thing's number, -1 nothing, -2 - k wall k."""
        edges, whose = [], []
        for k, thing in enumerate(self.things):
            edges.append(np.hstack([thing.outline, np.roll(thing.outline, -1, axis=0)]))
            whose += [k] * len(thing.outline)
        edges.append(self.walls)
        if not whose and len(self.walls) == 0:
            return np.full(len(bearings), self.range_m), np.full(len(bearings), -1)
        whose += [-2 - k for k in range(len(self.walls))]
        a, b = np.vstack(edges)[:, :2] - eye, np.vstack(edges)[:, 2:] - eye
        d = np.column_stack([np.cos(bearings), np.sin(bearings)])[:, None]
        e = (b - a)[None]
        cross = d[..., 0] * e[..., 1] - d[..., 1] * e[..., 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (a[:, 0] * e[..., 1] - a[:, 1] * e[..., 0]) / cross
            u = (a[:, 0] * d[..., 1] - a[:, 1] * d[..., 0]) / cross
        t = np.where((t > 1e-9) & (u >= 0.0) & (u <= 1.0), t, np.inf)
        nearest = t.argmin(axis=1)
        ranges = t[np.arange(len(t)), nearest]
        met = np.where(ranges <= self.range_m, np.array(whose)[nearest], -1)
        return np.minimum(ranges, self.range_m), met

    def _note_corners(self, ends: Floats, whose: np.ndarray) -> None:
        """Count the frames in which a ray ended near each corner of each thing."""
        for k, counts in enumerate(self.corner_frames):
            mine = ends[whose == k]
            if len(mine) and k < len(self.things):
                off = mine[:, None] - self.things[k].outline
                counts += np.hypot(off[..., 0], off[..., 1]).min(axis=0) < CORNER_M

    def _hulls(self, ends: Floats, whose: np.ndarray) -> list[tuple[int, Floats, int]]:
        found = []
        for k in sorted({int(n) for n in whose if n >= 0}):
            at = np.flatnonzero(whose == k)
            gaps = np.hypot(*np.diff(ends[at], axis=0).T) > 0.15
            for part in np.split(at, np.flatnonzero(gaps) + 1):
                hull = shapely.MultiPoint(ends[part]).convex_hull
                if len(part) >= 3 and hull.length > 0.03:
                    corners = hull.exterior.coords if hull.area > 0.0 else hull.coords
                    points = np.asarray(corners)
                    points = points[:-1] if hull.area > 0.0 else points
                    ring = shapely.LinearRing(points) if len(points) > 2 else None
                    if ring is not None and not ring.is_ccw:
                        points = points[::-1]
                    found.append((k, points, len(part)))
        return found

    def _rough(self, hull: Floats) -> Floats:
        return hull + self.random.normal(0.0, 1.0, hull.shape) * self.noise.hull_m

    def _view(self, eye: Floats, bearings: Floats, ranges: Floats) -> Floats:
        groups = ranges.reshape(-1, 4).min(axis=1) - self.view_gap_m
        first, last = bearings[::4], np.append(bearings[4::4], bearings[-1])
        at = np.column_stack([first, last]).ravel()
        r = np.repeat(np.maximum(groups, 0.05), 2)
        return np.vstack([eye, eye + r[:, None] * np.column_stack([np.cos(at), np.sin(at)])])

    def _segments(self, ends: Floats, whose: np.ndarray) -> Floats:
        found = []
        for k in range(len(self.walls)):
            at = np.flatnonzero(whose == -2 - k)
            for part in np.split(at, np.flatnonzero(np.diff(at) > 1) + 1):
                if len(part) > 1 and math.dist(ends[part[0]], ends[part[-1]]) > 0.4:
                    found.append(self._rough(ends[[part[0], part[-1]]]).ravel())
        return np.array(found).reshape(-1, 4)

    def _misplaced(self, frame: FrameObjects) -> FrameObjects:
        turn = self.random.normal(0.0, 1.0) * self.noise.pose_rad
        by = self.random.normal(0.0, 1.0, 2) * self.noise.pose_m
        c, s = math.cos(turn), math.sin(turn)
        eye = np.array(frame.origin)

        def moved(points: Floats) -> Floats:
            return np.asarray((points - eye) @ np.array([[c, s], [-s, c]]) + eye + by)

        found = tuple(one._replace(polygon=moved(one.polygon)) for one in frame.detections)
        walls = moved(frame.walls.reshape(-1, 2)).reshape(-1, 4)
        place = (float(eye[0] + by[0]), float(eye[1] + by[1]))
        return frame._replace(origin=place, view=moved(frame.view), detections=found, walls=walls)


def overlap(a: Floats, b: Floats) -> float:
    """Intersection over union of two polygons."""
    one, other = shapely.Polygon(a), shapely.Polygon(b)
    return float(one.intersection(other).area / one.union(other).area)


def apart_m(a: Floats, b: Floats) -> float:
    """Least distance between two polygons; 0 where they touch."""
    return float(shapely.Polygon(a).distance(shapely.Polygon(b)))


def corner_errors(truth: Floats, found: Floats) -> Floats:
    """From each true corner to the nearest of the found polygon's corners, m."""
    return np.array([np.hypot(*(found - corner).T).min() for corner in truth])


ROOM_M = 8.0, 6.0  # of `furnished_room`
WAY_M = 5.0, 3.0  # the camera's way in it, a rectangle with the same middle


def furnished_room(seed: int, noise: Noise) -> World:
    """A closed room with boxes of 0.1 to 1.2 m, free on all sides, none on the camera's way."""
    random = np.random.default_rng(seed)
    (w, h), (a, b) = ROOM_M, WAY_M
    way = shapely.box(-a / 2, -b / 2, a / 2, b / 2).exterior
    things: list[Thing] = []
    taken = [way.buffer(0.35)]
    while len(things) < 12:
        length, width = random.uniform(0.1, 1.2), random.uniform(0.1, 0.6)
        x, y = random.uniform(-w / 2, w / 2), random.uniform(-h / 2, h / 2)
        thing = box(x, y, length, width, random.uniform(0, math.pi), random.uniform(0.1, 0.8))
        shape = shapely.Polygon(thing.outline)
        inside = shapely.box(-w / 2 + 0.45, -h / 2 + 0.45, w / 2 - 0.45, h / 2 - 0.45)
        if inside.contains(shape) and not any(shape.intersects(other) for other in taken):
            things.append(thing)
            taken.append(shape.buffer(0.45))
    corners = np.array([[-w, -h], [w, -h], [w, h], [-w, h]]) / 2
    walls = np.hstack([corners, np.roll(corners, -1, axis=0)])
    return World(things, walls, noise, seed)


def way_around(frames: int, turns: float) -> list[tuple[float, float, float]]:
    """Poses along the rectangle, while the camera turns round so many times."""
    ring = shapely.box(-WAY_M[0] / 2, -WAY_M[1] / 2, WAY_M[0] / 2, WAY_M[1] / 2).exterior
    poses = []
    for k in range(frames):
        at = ring.interpolate(k / frames * ring.length)
        poses.append((float(at.x), float(at.y), 2.0 * math.pi * turns * k / frames))
    return poses
