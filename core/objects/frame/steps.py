"""From a depth image to objects: all steps of one frame.

It knows no map: known walls come in with the predicted pose of the camera. Where it does not know
the floor it says so, and tells nothing: no object, no wall, no space seen through.

Source: docs/objects.md.
"""

import math
from typing import Literal, NamedTuple

import msgspec
import numpy as np
import numpy.typing as npt

from core.geometry import R_from_rpy
from core.objects.frame import (
    floor,
    hulls,
    outlines,
    pixels,
    summits,
    view,
    voxels,
    wall_ends,
    wall_lines,
)
from core.objects.frame.floor import SHARED, Floor, Nine
from core.objects.frame.pixels import GATE, Leveled, Limits
from core.objects.frame.room import Room
from core.objects.frame.settings import FrameSettings
from core.objects.frame.wall_lines import Correction
from core.objects.records import Detection, Floats, FrameObjects
from core.records import F64, DepthCamera, DepthImage

Doubt = Literal["", "pose", "image", "no floor"]
DENSE = 0.75  # of a voxel: so far apart pixels of things are kept where they are nearer
LEAST_PIXELS = 3
LEAST_SHARE = 0.3  # of the pixels that the smallest object would fill


class CameraPose(NamedTuple):
    """Where the camera is predicted to be: the floor is z = 0 of the map there."""

    T_map_sensor: F64  # (4, 4)
    sigma_height_m: float
    sigma_pitch_rad: float
    sigma_roll_rad: float
    sigma_xy_m: float
    sigma_yaw_rad: float


class FrameResult(NamedTuple):
    """What a frame tells of objects, and what it tells of the pose."""

    objects: FrameObjects
    doubt: Doubt  # "": none; else nothing is told, and why
    floor: Floor | None
    correction: Correction | None  # None: no known wall was seen


class Level(NamedTuple):
    """The level frame below a lens, in the map."""

    R: F64  # (3, 3) from sensor
    yaw_rad: float  # of its x axis, in the map
    lens: F64  # (3,) in the map


class FrameSteps:
    """Depth images of a camera to what they tell of objects."""

    def __init__(self, settings: FrameSettings) -> None:
        plain = {name: float(value) for name, value in msgspec.structs.asdict(settings).items()}
        self._settings = settings = FrameSettings(**plain)  # kernels are told apart by types
        self._room: Room | None = None
        self._noise = settings.noise_m, settings.noise_per_m2

    def find(self, image: DepthImage, pose: CameraPose, known_walls: Floats) -> FrameResult:
        """All that an image tells.

        Args:
            known_walls: (n, 4) m, map frame: segments x1, y1, x2, y2; none: (0, 4).
        """
        level = level_of(pose, image.camera)
        if level is None:
            return _nothing(image, (0.0, 0.0), "pose")
        origin = float(level.lens[0]), float(level.lens[1])
        rows_columns = image.numbers.shape
        if image.camera.rays.shape != (*rows_columns, 3) or min(rows_columns) < 2:
            return _nothing(image, origin, "image")
        found = self.floor_of(image, level, pose)
        if found is None:
            return _nothing(image, origin, "no floor")
        seen, plane, C = found
        lens_m = self.classify(level, plane, C)
        told = self._told(self.room, image, level, lens_m, pose, known_walls)
        return told._replace(floor=seen)

    def warm(self) -> None:
        """Run every kernel once on a made-up frame, so that none is compiled later."""
        steps = FrameSteps(self._settings)
        row, column = np.mgrid[:60, :80]
        ahead = np.ones(row.shape)
        rays = 0.001 * np.stack([ahead, (39.5 - column) / 60.0, (29.5 - row) / 60.0], axis=-1)
        T = np.eye(4)
        T[:3, :3] = R_from_rpy(0.0, 0.5, 0.0)
        T[2, 3] = 1.0
        with np.errstate(divide="ignore"):
            floor_at = np.clip(-1.0 / (rays @ T[2, :3]), 0.0, 4000.0)
        floor_at[:, 20:40] *= 0.6  # something stands there, floor lacks there
        floor_at[:, 60:70] *= 1.4
        camera = DepthCamera(rays.astype(np.float32), (0.0, 0.0, 0.0))
        image = DepthImage(0.0, floor_at.astype(np.uint16), camera, 0, 0.0)
        pose = CameraPose(T, 0.03, 0.02, 0.02, 0.03, 0.02)
        steps.find(image, pose, np.array([[0.5, 5.0, 1.0, 5.0]]))
        room = steps.room
        wall_lines.best_line(
            room.columns.x, room.columns.y, room.columns.rim, 1, 0.05, 1.0, room.bins, room.line
        )
        wall_lines.take(room.columns.x, room.columns.y, 0, room.line, 0.05, room.columns.rim, 1)

    @property
    def room(self) -> Room:
        """The arrays of the newest image: `room.kinds` (rows, columns) has what each pixel is."""
        assert self._room is not None, "no image yet"
        return self._room

    def _room_of(self, camera: DepthCamera) -> Room:
        if self._room is None or self._room.camera is not camera:
            self._room = Room(camera, self._settings)
        return self._room

    def floor_of(
        self, image: DepthImage, level: Level, pose: CameraPose
    ) -> tuple[Floor, F64, F64] | None:
        """The floor that an image shows; then that of image and pose, with its covariance.

        The latter is (3,) of z = a + b x + c y in the level frame. None: the floor is not known.
        """
        room = self._room_of(image.camera)
        np.copyto(room.numbers, image.numbers)  # whoever made them, for kernels they are alike
        most_m = 2.0 * self._settings.max_range_m
        pixels.measure(room.numbers, room.per_unit, most_m, room.padded)
        sigmas = float(pose.sigma_height_m), float(pose.sigma_pitch_rad), float(pose.sigma_roll_rad)
        limits = self._settings.min_range_m, self._settings.max_range_m, *self._noise
        gated, lens_m = room.gated, float(level.lens[2])
        floor.gather(
            room.units, room.ranges, room.stride, _row(level.R), lens_m, sigmas, limits, gated,
        )  # fmt: skip
        used, chi2, a, b, c = floor.fit(gated, sigmas, room.levels, room.N, room.C)
        share = used / max(1, int(gated.found[0]))
        is_poor = used < floor.LEAST_POINTS or share < floor.LEAST_SHARE
        if is_poor or gated.found[1] > used or floor.width_of(room.N) < floor.LEAST_WIDTH:
            return None
        C = room.C * max(1.0, chi2) * (1.0 + used * SHARED * SHARED)
        plane, prior = np.array([a, b, c]), np.diag(np.square(sigmas))
        if (np.abs(plane) > GATE * np.sqrt(np.diag(C + prior))).any():
            return None
        gain = prior @ np.linalg.inv(prior + C)
        n = np.array([-b, -c, 1.0]) / math.sqrt(1.0 + b * b + c * c)
        signs = np.array([-1.0, 1.0, -1.0])
        seen = Floor(
            (lens_m - a) * float(n[2]), math.atan(b), -math.atan(c),
            C * np.outer(signs, signs), share, used, level.R.T @ n,
        )  # fmt: skip
        return seen, gain @ plane, prior - gain @ prior

    def classify(self, level: Level, plane: F64, C: F64) -> float:
        """Sort all pixels of the newest image by a floor; gives the lens's height over it."""
        room = self.room
        settings, (a, b, c) = self._settings, plane.tolist()
        lens_m: float = (float(level.lens[2]) - a) / math.sqrt(1.0 + b * b + c * c)
        angle = math.tan(math.radians(settings.flying_deg))
        steep = [pitch / max(1e-6, angle) for pitch in (room.across_rad, room.down_rad)]
        limits = (
            settings.min_range_m, settings.max_range_m, *self._noise, settings.top_m,
            settings.floor_m, settings.pit_m, steep[0], steep[1], lens_m,
            DENSE * settings.voxel_m / max(room.across_rad, room.down_rad, 1e-6),
            settings.cluster_m, pixels.SLANT * max(room.across_rad, room.down_rad),
        )  # fmt: skip
        once, twice = np.diag(C), 2.0 * C
        gate2 = GATE**2 * np.array(
            [once[0], twice[0, 1], twice[0, 2], once[1], twice[1, 2], once[2]]
        )
        R = floor.level_rotation(b, c) @ level.R
        view.clear(room.fan)
        view.rise_to_rim(room.units, _row(R), room.fan, room.rim)
        pixels.classify(
            room.units, room.padded, Leveled(_singles(R), _singles(gate2)),
            Limits(*_singles(limits)), room.kinds, room.points, room.fan, room.row,
        )  # fmt: skip
        return lens_m

    def _told(
        self, room: Room, image: DepthImage, level: Level, lens_m: float, pose: CameraPose,
        known_walls: Floats,
    ) -> FrameResult:  # fmt: skip
        """Walls, objects and view of sorted pixels."""
        settings = self._settings
        noise, things = (*self._noise, lens_m), int(room.points.found[0])
        count = voxels.thin(room.points, 0, 1, things, settings.voxel_m, room.voxels)
        view.add_things(room.voxels, count, room.fan)
        room.used[:count] = 0
        correction, known = self._known(room, count, level, pose, known_walls, noise)
        segments = np.vstack([known, self._new_walls(room, count, noise)])
        wall_ends.take_end_faces(room.voxels, count, segments, settings.wall_m, room.used)
        found = self._clusters(room, (0, 1, things), count, noise)
        pits, last = int(room.points.found[1]), room.points.x.size - 1
        room.points.pixels[last - pits + 1 :] = 1
        room.used[: max(count, pits)] = 0
        count = voxels.thin(room.points, last, -1, pits, settings.voxel_m, room.voxels)
        deep_m = -settings.pit_m  # at least
        for pit in self._clusters(room, (last, -1, pits), count, noise):
            found.append(pit._replace(bottom_m=deep_m, top_m=0.0, is_cut=False))
        found += [one._replace(is_cut=False) for one in self._low(room, noise)]
        pitches_rad = room.across_rad, room.down_rad
        view.reaches(room.fan, pitches_rad, lens_m, settings.low_m, room.near, room.far)
        turn = _turn(level.yaw_rad)
        middle = level.lens[:2]
        objects = FrameObjects(
            image.t_s,
            (float(middle[0]), float(middle[1])),
            view.view_of(room.near, room.far, room.fan) @ turn.T + middle,
            tuple(one._replace(polygon=one.polygon @ turn.T + middle) for one in found),
            (segments.reshape(-1, 2) @ turn.T + middle).reshape(-1, 4),
        )
        return FrameResult(objects, "", None, correction)

    def _known(
        self, room: Room, count: int, level: Level, pose: CameraPose, known_walls: Floats,
        noise: tuple[float, float, float],
    ) -> tuple[Correction | None, Floats]:  # fmt: skip
        """Take the voxels of known walls away; what they tell of the pose, and where they are.

        The latter is (n, 4), level frame.
        """
        turn, segments = _turn(level.yaw_rad), np.asarray(known_walls, np.float64).reshape(-1, 4)
        segments = segments[(segments[:, :2] != segments[:, 2:]).any(axis=1)]
        if len(segments) == 0:
            return None, segments
        ends = (segments.reshape(-1, 2) - level.lens[:2]) @ turn
        sigmas = float(pose.sigma_xy_m), float(pose.sigma_yaw_rad)
        walls, gaps_m = ends.reshape(-1, 4), self._gaps_at(room, ends, noise[2]).reshape(-1, 2)
        within_m, height_m = self._settings.wall_m, self._settings.wall_height_m
        offset, C, points = wall_lines.refound(
            room.voxels, count, walls, sigmas, within_m, noise, gaps_m, room.used, room.bins
        )  # fmt: skip
        if points == 0:
            return None, np.zeros((0, 4))
        wall_ends.take_further(
            room.voxels, count, walls, offset, within_m, height_m, noise, gaps_m, room.used,
            room.bins, room.measures.low, room.measures.high,
        )  # fmt: skip
        flat_m = self._settings.voxel_m  # a wall is as uneven as its points are thinned
        wall_lines.release_fronts(room.voxels, count, walls, 1, offset, flat_m, noise, room.used)
        segments = wall_lines.stretches(room.voxels, count, walls, offset, room.used)
        whole = np.eye(3)
        whole[:2, :2] = turn
        x_m, y_m, yaw_rad = (whole @ offset).tolist()
        return Correction(x_m, y_m, yaw_rad, whole @ C @ whole.T, points), segments

    def _gaps_at(self, room: Room, places: F64, lens_m: float) -> F64:
        """How far apart two points of one surface may lie at places (n, 2), level frame: (n,) m."""
        ranges_m = np.sqrt(np.square(places).sum(axis=1) + lens_m * lens_m)
        return voxels.apart_m(ranges_m, self._settings, max(room.across_rad, room.down_rad))

    def _new_walls(self, room: Room, count: int, noise: tuple[float, float, float]) -> Floats:
        """Long upright planes among the voxels that are left: segments (n, 4), level frame."""
        settings, found = self._settings, list[Floats]()
        room.labels[:count] = np.where(room.used[:count] != 0, voxels.NONE, 0)
        columns = outlines.columns_of(room.voxels, count, room.labels, room.columns)
        x, y = room.columns.x, room.columns.y
        n = wall_lines.upright(
            room.voxels, count, room.columns.of, columns, settings.wall_height_m,
            room.measures.low, room.measures.high, room.mean, x, y,
        )  # fmt: skip
        taken = room.columns.rim
        taken[:n] = 0
        while (
            len(found) < wall_lines.MOST_WALLS and n * settings.voxel_m > settings.wall_length_m / 2
        ):
            wall_lines.best_line(
                x, y, taken, n, settings.wall_m, settings.wall_length_m, room.bins, room.line
            )
            if room.line[5] - room.line[4] < settings.wall_length_m:
                break
            found.append(wall_lines.segment(room.line))
            wall_lines.take(
                room.voxels.x, room.voxels.y, count, room.line, settings.wall_m, room.used, 1
            )
            wall_lines.take(x, y, n, room.line, settings.wall_m, taken, 1)
        return self._grown(room, count, np.array(found).reshape(-1, 4), noise)

    def _grown(
        self, room: Room, count: int, walls: Floats, noise: tuple[float, float, float]
    ) -> Floats:
        """New walls as far as they go on, also where too little of their height is seen."""
        gaps_m = self._gaps_at(room, walls.reshape(-1, 2), noise[2]).reshape(-1, 2)
        wall_ends.grow(
            room.voxels, count, walls, np.zeros(3), self._settings.wall_m, noise, gaps_m,
            room.used, room.bins,
        )  # fmt: skip
        first, still = 1 + int(room.used[:count].max(initial=0)), np.zeros(3)
        x, y, within_m = room.voxels.x, room.voxels.y, self._settings.wall_m
        for number, wall in enumerate(walls, first):
            room.line[:] = wall_lines.line_of(wall)
            wall_lines.take(x, y, count, room.line, within_m, room.used, number)
        flat_m = self._settings.voxel_m
        wall_lines.release_fronts(room.voxels, count, walls, first, still, flat_m, noise, room.used)
        return walls

    def _clusters(
        self, room: Room, where: tuple[int, int, int], count: int,
        noise: tuple[float, float, float],
    ) -> list[Detection]:  # fmt: skip
        """The objects among voxels that no wall used, large enough for their distance."""
        settings, measures = self._settings, room.measures
        labels, edge_m = room.labels, settings.voxel_m
        found = voxels.cluster(
            room.voxels, count, room.used, settings.cluster_m, noise[2], room.warp, labels,
            room.clusters,
        )  # fmt: skip
        found = summits.part(
            room.voxels, count, labels, settings.summit_m, room.clusters, room.columns, room.bins
        )
        outlines.measure(
            room.voxels, count, labels, noise[2], room.fan, room.rim, room.down_rad, measures, found
        )
        pitch2 = room.across_rad * room.down_rad * measures.near2[:found]
        least = np.maximum(LEAST_PIXELS, LEAST_SHARE * settings.least_m**2 / pitch2)
        kept = np.flatnonzero(measures.pixels[:found] >= least)
        if len(kept) == 0:
            return []
        number = np.full(found + 1, voxels.NONE, np.int32)  # the last is that of NONE
        number[kept] = np.arange(len(kept), dtype=np.int32)
        labels[:count] = number[labels[:count]]
        low, high = measures.low[kept].tolist(), measures.high[kept].tolist()
        used, cut = measures.voxels[kept].tolist(), (measures.cut[kept] != 0).tolist()
        outlines.outline(
            room.points, *where, edge_m, room.voxels, count, labels, room.columns, measures,
            len(kept),
        )  # fmt: skip
        n, ranges_m = len(kept), np.sqrt(measures.far2[kept]).astype(np.float64)
        gap_m = voxels.apart_m(ranges_m, settings, max(room.across_rad, room.down_rad))
        hulls.rings(
            room.columns.x, room.columns.y, measures.begin, edge_m, measures.columns,
            gap_m, n, room.rings,
        )  # fmt: skip
        polygons = hulls.polygons_of(room.rings, n, edge_m, settings.hull_m)
        return [Detection(polygons[k], low[k], high[k], used[k], cut[k]) for k in range(n)]

    def _low(self, room: Room, noise: tuple[float, float, float]) -> list[Detection]:
        """Carpets, sills and the like: patches of floor that are higher than the floor."""
        fan = room.fan
        n = view.low_patches(fan, self._settings.low_m, noise, room.patches)
        count = view.corners_of(room.patches, n, fan, room.points)
        room.used[:count] = 0
        found = voxels.thin(room.points, 0, 1, count, self._settings.voxel_m, room.voxels)
        return self._clusters(room, (0, 1, count), found, noise)


def level_of(pose: CameraPose, camera: DepthCamera) -> Level | None:
    """The level frame below the lens; None: the pose is none."""
    T = pose.T_map_sensor
    if T.shape != (4, 4) or not np.isfinite(T).all() or not np.isfinite(pose[1:]).all():
        return None
    R, lens = T[:3, :3], T[:3, :3] @ np.array(camera.offset_m) + T[:3, 3]
    if np.abs(R @ R.T - np.eye(3)).max() > 1e-6 or np.linalg.det(R) < 0.0 or not lens[2] > 0.0:
        return None
    if min(pose[1:]) <= 0.0:
        return None
    ahead = R[:2, 0] if math.hypot(R[0, 0], R[1, 0]) > 0.1 else R[:2, 2]  # straight down: up
    yaw_rad = math.atan2(ahead[1], ahead[0])
    flat = np.eye(3)
    flat[:2, :2] = _turn(-yaw_rad)
    return Level(flat @ R, yaw_rad, lens)


def _turn(yaw_rad: float) -> F64:
    """(2, 2) from level to map."""
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    return np.array([[c, -s], [s, c]])


def _singles(numbers: npt.ArrayLike) -> tuple[np.float32, ...]:
    return tuple(np.ravel(np.asarray(numbers, np.float32)))


def _row(R: F64) -> Nine:
    a, b, c, d, e, f, g, h, i = R.ravel().tolist()
    return a, b, c, d, e, f, g, h, i


def _nothing(image: DepthImage, origin: tuple[float, float], doubt: Doubt) -> FrameResult:
    """A frame that tells nothing, and why."""
    objects = FrameObjects(image.t_s, origin, np.zeros((0, 2)), (), np.zeros((0, 4)))
    return FrameResult(objects, doubt, None, None)
