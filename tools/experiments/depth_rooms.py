"""Depth images of rooms into the map of objects, against the truth.

`python -m tools.experiments.depth_rooms` prints the second table of docs/object-map.md. A robot
drives a rectangle and turns; its camera looks down. Rays meet the floor, boxes, a shelf, chairs,
walls with a door, and a person who walks; ranges have noise that grows with the distance. Images go
through `FrameSteps`, and what those tell through `ObjectMap`.
"""

import argparse
import math
import time
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import shapely

from core.objects.frame.settings import FrameSettings
from core.objects.frame.steps import CameraPose, FrameResult, FrameSteps
from core.objects.records import Floats
from core.objects.vector_map.mapped import MapObject
from core.objects.vector_map.object_map import MapUpdate, ObjectMap
from core.records import F64, DepthCamera, DepthImage
from jit import kernel
from tools.experiments.object_world import SETTINGS, corner_errors

FRAME_S = 0.1
SIZE, FOCAL_PX, PER_M = (180, 240), 200.0, 4000.0  # 62 by 48 degrees, a quarter of a millimetre
NOISE_M, NOISE_PER_M2 = 0.003, 0.0015  # of a range, one sigma
STEPS = FrameSettings(
    min_range_m=0.2, max_range_m=4.5, noise_m=NOISE_M, noise_per_m2=NOISE_PER_M2, top_m=1.8,
    floor_m=0.03, low_m=0.02, pit_m=0.06, flying_deg=3.0, voxel_m=0.02, cluster_m=0.06,
    least_m=0.05, hull_m=0.015, wall_m=0.06, wall_length_m=1.0, wall_height_m=0.5, summit_m=0.2,
)  # fmt: skip
SAME, TRUE_PART = 0.5, 0.8  # overlap of an object with its truth; share of a part that lies in it
ROUND = 0.8  # of an outline's length is finished sides: the thing was seen all around
SEEN_PX, SEEN_FRAMES = 60, 20  # a thing met by so many rays, in so many frames, was seen


class Solid(NamedTuple):
    """An upright box: its middle, its size, its yaw, from one height to another, in m and rad."""

    x: float
    y: float
    length: float
    width: float
    yaw: float
    low: float
    high: float

    def outline(self) -> Floats:
        """(4, 2) m, counter-clockwise."""
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        half = 0.5 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * [self.length, self.width]
        return np.asarray(half @ np.array([[c, s], [-s, c]]) + [self.x, self.y])


@dataclass
class Thing:
    """Solids that are one thing."""

    solids: list[Solid]
    velocity: tuple[float, float] = (0.0, 0.0)
    frames: int = field(default=0)  # in which enough of it was seen

    def outline(self) -> Floats:
        hull = shapely.MultiPoint(np.vstack([one.outline() for one in self.solids])).convex_hull
        return np.asarray(hull.exterior.coords)[:-1][::-1]

    def go(self, x: float, y: float) -> None:
        self.solids = [one._replace(x=one.x + x, y=one.y + y) for one in self.solids]


@kernel
def _cast(solids: Floats, start: F64, rays: F64, numbers: F64, whose: F64) -> None:
    """How many of each ray (n, 3) until it meets floor or a solid (m, 7), and which; -1: floor."""
    for k in range(rays.shape[0]):
        dx, dy, dz = rays[k, 0], rays[k, 1], rays[k, 2]
        nearest, met = (-start[2] / dz if dz < 0.0 else 1e18), -1.0
        for m in range(solids.shape[0]):
            c, s = math.cos(solids[m, 4]), math.sin(solids[m, 4])
            px, py = start[0] - solids[m, 0], start[1] - solids[m, 1]
            first, last = 0.0, nearest
            for axis in range(3):
                if axis == 0:
                    p, d = c * px + s * py, c * dx + s * dy
                    low, high = -0.5 * solids[m, 2], 0.5 * solids[m, 2]
                elif axis == 1:
                    p, d = -s * px + c * py, -s * dx + c * dy
                    low, high = -0.5 * solids[m, 3], 0.5 * solids[m, 3]
                else:
                    p, d, low, high = start[2], dz, solids[m, 5], solids[m, 6]
                a, b = (low - p) / d, (high - p) / d
                first, last = max(first, min(a, b)), min(last, max(a, b))
            if 0.0 < first <= last:
                nearest, met = first, float(m)
        numbers[k], whose[k] = nearest, met


class View(NamedTuple):
    """A frame and what is true of it."""

    image: DepthImage
    pose: CameraPose  # as the robot believes it
    pixels: np.ndarray  # (things,) rays that met each


class Room:
    """Things and walls, and a robot's camera in between; poses wrong by `pose_m`, 1 sigma."""

    def __init__(
        self, things: list[Thing], walls: list[Solid], pose_m: float, seed: int,
        height_m: float, pitch_deg: float,
    ) -> None:  # fmt: skip
        self.things, self.walls, self.pose_m = things, walls, pose_m
        self.height_m, self.pitch_rad = height_m, math.radians(pitch_deg)
        self.random, self.at_s = np.random.default_rng(seed), 100.0
        row, column = np.mgrid[: SIZE[0], : SIZE[1]]
        left, up = (SIZE[1] / 2 - 0.5 - column) / FOCAL_PX, (SIZE[0] / 2 - 0.5 - row) / FOCAL_PX
        rays = (np.stack([np.ones(SIZE), left, up], axis=-1) / PER_M).astype(np.float32)
        self.camera = DepthCamera(rays, (0.0, 0.0, 0.0))

    def view(self, x: float, y: float, yaw: float) -> View:
        """What the camera sees from there."""
        T = placed(x, y, self.height_m, self.pitch_rad, yaw)
        rays = self.camera.rays.reshape(-1, 3).astype(np.float64)
        solids = [one for thing in self.things for one in thing.solids] + self.walls
        of_things = [k for k, thing in enumerate(self.things) for _ in thing.solids]
        owner = np.array([*of_things, *[-1] * len(self.walls), -1])
        numbers, whose = np.empty(len(rays)), np.empty(len(rays))
        _cast(np.array(solids, np.float64), T[:3, 3].copy(), rays @ T[:3, :3].T, numbers, whose)
        pixels = np.bincount(owner[whose.astype(np.int64)] + 1, minlength=len(self.things) + 1)[1:]
        lengths = np.linalg.norm(rays, axis=1)
        ranges = numbers * lengths
        numbers += self.random.normal(0.0, 1.0, len(rays)) * (
            (NOISE_M + NOISE_PER_M2 * np.minimum(ranges, 20.0) ** 2) / lengths
        )
        numbers[~(numbers < 65535.0) | (self.random.random(len(rays)) < 0.01)] = 0.0
        whole = np.round(np.maximum(numbers, 0.0)).astype(np.uint16).reshape(SIZE)
        image = DepthImage(self.at_s, whole, self.camera, 0, self.at_s)
        off = self.random.normal(0.0, 1.0, 6)
        believed = placed(
            x + off[0] * self.pose_m, y + off[1] * self.pose_m, self.height_m + 0.005 * off[2],
            self.pitch_rad + 0.003 * off[3], yaw + 0.3 * self.pose_m * off[4],
        )  # fmt: skip
        return View(
            image, CameraPose(believed, 0.02, 0.012, 0.012, max(0.01, self.pose_m), 0.01), pixels
        )

    def walk(self) -> None:
        """Let a frame's time pass."""
        self.at_s += FRAME_S
        for thing in self.things:
            thing.go(FRAME_S * thing.velocity[0], FRAME_S * thing.velocity[1])


class Mapper:
    """Images to a map, and the time that both halves take."""

    def __init__(self) -> None:
        self.steps, self.objects = FrameSteps(STEPS), ObjectMap(SETTINGS)
        self.find_s, self.update_s = list[float](), list[float]()

    def take(self, seen: View) -> tuple[FrameResult, MapUpdate | None]:
        """One frame; a frame in doubt does not reach the map."""
        known = self.objects.walls.landmarks()
        before_s = time.process_time()
        told = self.steps.find(seen.image, seen.pose, known)
        between_s = time.process_time()
        update = None if told.doubt else self.objects.update(told.objects)
        self.find_s.append(between_s - before_s)
        self.update_s.append(time.process_time() - between_s)
        return told, update


def placed(x: float, y: float, z: float, pitch: float, yaw: float) -> F64:
    """T_map_sensor."""
    cp, sp, cy, sy = math.cos(pitch), math.sin(pitch), math.cos(yaw), math.sin(yaw)
    T = np.eye(4)
    T[:3, :3] = [[cy * cp, -sy, cy * sp], [sy * cp, cy, sy * sp], [-sp, 0.0, cp]]
    T[:3, 3] = x, y, z
    return T


def box(x: float, y: float, length: float, width: float, yaw: float, top: float) -> Thing:
    return Thing([Solid(x, y, length, width, yaw, 0.0, top)])


def chair(x: float, y: float) -> Thing:
    """A seat on four legs, with a back."""
    legs = [
        Solid(x + a, y + b, 0.05, 0.05, 0.0, 0.0, 0.42) for a in (-0.2, 0.2) for b in (-0.2, 0.2)
    ]
    seat, back = (
        Solid(x, y, 0.46, 0.46, 0.0, 0.42, 0.47),
        Solid(x, y + 0.21, 0.46, 0.04, 0.0, 0.47, 0.9),
    )
    return Thing([*legs, seat, back])


def person(x: float, y: float, vx: float, vy: float) -> Thing:
    """Legs, a trunk and a head."""
    legs = [Solid(x, y + side, 0.16, 0.14, 0.0, 0.0, 0.85) for side in (-0.1, 0.1)]
    trunk, head = (
        Solid(x, y, 0.24, 0.44, 0.0, 0.85, 1.45),
        Solid(x, y, 0.2, 0.18, 0.0, 1.45, 1.72),
    )
    return Thing([*legs, trunk, head], (vx, vy))


HALF_M = 3.5, 2.8  # of the room
WAY_M = 2.0, 1.2  # half of the robot's rectangle
FREE_M = 0.55  # around that, nothing stands


def walls() -> list[Solid]:
    """Of the room, 2.4 m high; a door of 0.9 m in the one at the right."""
    (w, h), high = HALF_M, 2.4
    return [
        Solid(-w - 0.05, 0.0, 0.1, 2 * h, 0.0, 0.0, high),
        Solid(0.0, h + 0.05, 2 * w, 0.1, 0.0, 0.0, high),
        Solid(0.0, -h - 0.05, 2 * w, 0.1, 0.0, 0.0, high),
        Solid(w + 0.05, -1.7, 0.1, 2.2, 0.0, 0.0, high),
        Solid(w + 0.05, 1.55, 0.1, 2.5, 0.0, 0.0, high),
    ]


def room(seed: int, pose_m: float, height_m: float, pitch_deg: float) -> Room:
    """A shelf, a chair, and eight boxes of 0.1 to 0.7 m, free on all sides."""
    random = np.random.default_rng(seed)
    (w, h), (a, b) = HALF_M, WAY_M
    taken = [shapely.box(-a, -b, a, b).exterior.buffer(FREE_M)]
    shelf, seat = box(-w + 0.45, -1.6, 0.35, 0.9, 0.0, 1.3), chair(0.0, 0.0)
    things = [shelf, seat]
    taken += [shapely.Polygon(one.outline()).buffer(0.3) for one in things]
    inside = shapely.box(-w + 0.3, -h + 0.3, w - 0.3, h - 0.3)
    while len(things) < 10:
        size = random.uniform(0.1, 0.7), random.uniform(0.1, 0.4)
        one = box(
            random.uniform(-w, w), random.uniform(-h, h), *size, random.uniform(0.0, math.pi),
            random.uniform(0.1, 0.6),
        )  # fmt: skip
        shape = shapely.Polygon(one.outline())
        if inside.contains(shape) and not any(shape.intersects(other) for other in taken):
            things.append(one)
            taken.append(shape.buffer(0.3))
    return Room(things, walls(), pose_m, seed, height_m, pitch_deg)


def way_around(frames: int, turns: float) -> list[tuple[float, float, float]]:
    """Poses along the rectangle, while the robot turns round so many times."""
    ring = shapely.box(-WAY_M[0], -WAY_M[1], *WAY_M).exterior
    places = [ring.interpolate(k / frames * ring.length) for k in range(frames)]
    return [(p.x, p.y, 2.0 * math.pi * turns * k / frames) for k, p in enumerate(places)]


class Judged(NamedTuple):
    """A map against its room."""

    things: int  # of which enough was seen
    missed: int
    objects: int
    fragments: int  # further objects of a thing that has one
    false: int  # of no thing
    corners_m: list[float]
    areas: list[float]  # errors, as shares,
    round_areas: list[float]  # and of those seen all around


def judge(room: Room, objects: ObjectMap, gone: tuple[Thing, ...] = ()) -> Judged:
    """Each thing that was seen has one object; what lies on none is false, as are fragments."""
    mapped = objects.objects()
    found = [shapely.Polygon(one.polygon) for one in mapped]
    things = [one for one in room.things if one not in gone and one.velocity == (0.0, 0.0)]
    truths = [shapely.Polygon(one.outline()) for one in things]
    owner = [
        max(range(len(truths)), key=lambda k: one.intersection(truths[k].buffer(0.03)).area)
        for one in found
    ]
    false = [
        one.intersection(truths[k].buffer(0.05)).area < TRUE_PART * one.area
        for one, k in zip(found, owner, strict=True)
    ]
    seen = [k for k, one in enumerate(things) if one.frames >= SEEN_FRAMES]
    missed, fragments, corners = 0, 0, list[float]()
    areas, round_areas = list[float](), list[float]()
    for k in seen:
        mine = [one for one, o, bad in zip(found, owner, false, strict=True) if o == k and not bad]
        missed, fragments = missed + (not mine), fragments + max(0, len(mine) - 1)
        if mine:
            best = max(mine, key=lambda one: one.area)
            outline = np.asarray(best.exterior.coords)[:-1]
            corners += corner_errors(things[k].outline(), outline).tolist()
            areas.append(best.area / truths[k].area - 1.0)
            if finished_share(mapped[found.index(best)]) >= ROUND:
                round_areas.append(areas[-1])
    return Judged(len(seen), missed, len(found), fragments, sum(false), corners, areas, round_areas)


def finished_share(one: MapObject) -> float:
    """Share of an outline's length that is finished sides."""
    lengths = np.hypot(*(np.roll(one.polygon, -1, axis=0) - one.polygon).T)
    return float(lengths[one.finished].sum() / lengths.sum())


def drive(room: Room, mapper: Mapper, frames: int, turns: float) -> None:
    """Once round."""
    for pose in way_around(frames, turns):
        seen = room.view(*pose)
        for thing, count in zip(room.things, seen.pixels, strict=True):
            thing.frames += count >= SEEN_PX
        mapper.take(seen)
        room.walk()


CAMERAS = ((0.7, 15.0), (0.9, 25.0), (1.2, 35.0))  # height in m, degrees down


HEAD = """| pose | camera | things | recall | precision | pieces + false | corner mm, 90 % |\
 area %, 90 %, mean | seen round | ms of CPU |
|---|---|---|---|---|---|---|---|---|---|"""


def row(pose_m: float, camera: tuple[float, float], seeds: range, frames: int) -> str:
    """A row of the table."""
    judged, mappers = list[Judged](), list[Mapper]()
    for seed in seeds:
        there, mapper = room(seed, pose_m, *camera), Mapper()
        drive(there, mapper, frames, frames / 85.0)
        judged.append(judge(there, mapper.objects))
        mappers.append(mapper)
    things, missed = sum(one.things for one in judged), sum(one.missed for one in judged)
    extra = sum(one.fragments + one.false for one in judged)
    corners = 1000.0 * np.array([error for one in judged for error in one.corners_m])
    areas = 100.0 * np.array([error for one in judged for error in one.areas])
    whole = 100.0 * np.abs([error for one in judged for error in one.round_areas])
    of_whole = f"{np.median(whole):.0f} ({len(whole)})" if len(whole) else "none"
    hits = things - missed
    find, update = (
        1000.0 * float(np.median([ms for one in mappers for ms in getattr(one, name)[10:]]))
        for name in ("find_s", "update_s")
    )
    return (
        f"| {100 * pose_m:.0f} cm | {camera[0]} m, {camera[1]:.0f} deg | {things} |"
        f" {hits / max(1, things):.2f} | {hits / max(1, hits + extra):.2f} |"
        f" {sum(one.fragments for one in judged)} + {sum(one.false for one in judged)} |"
        f" {np.median(corners):.0f}, {np.percentile(corners, 90):.0f} |"
        f" {np.median(np.abs(areas)):.0f}, {np.percentile(np.abs(areas), 90):.0f},"
        f" {areas.mean():+.0f} | {of_whole} | {find:.1f} + {update:.1f} |"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rooms", type=int, default=2)
    parser.add_argument("--frames", type=int, default=400, help="of each drive")
    given = parser.parse_args()
    print(HEAD)
    for pose_m in (0.01, 0.03):
        for camera in CAMERAS:
            print(row(pose_m, camera, range(11, 11 + given.rooms), given.frames), flush=True)


if __name__ == "__main__":
    main()
