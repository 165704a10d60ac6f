"""A frame of the camera, looked at: floor and things for the obstacle map, objects for the planner.

It is the work that is done beside the loop: it keeps the map of objects, and gives for each frame a
message that is the same whenever it is read. It reads no clock.
Source: design, section 10; docs/objects.md, docs/object-map.md.
"""

import math
from collections.abc import Callable
from itertools import count

import numpy as np
from msgspec import Struct

from core.object_settings import FrameSettings, ObjectMapSettings
from core.objects.evidence import evidence_of
from core.objects.frame.steps import CameraPose, FrameSteps
from core.objects.records import Floats, FrameObjects
from core.objects.seen import Seen
from core.objects.told_outlines import told_outline
from core.objects.vector_map.geojson import SavedMap, geojson_from_map
from core.objects.vector_map.mapped import MapObject, box_of
from core.objects.vector_map.newcomers import Obstacle
from core.objects.vector_map.object_map import MapUpdate, ObjectMap
from core.objects.vector_map.warm import warm_object_map
from core.objects.wall_reports import WallReports
from core.pose_fix import PoseFix
from core.records import (
    F64,
    I64,
    OBJECT_MOVED,
    OBJECT_MOVING,
    OBJECT_STATIC,
    DepthImage,
    FloorView,
    ObjectReport,
    PassingThing,
    StandingThing,
)

SIGMA_HEIGHT_M, SIGMA_TILT_RAD = 0.03, 0.02  # of the lens over the floor, as a pose predicts it
SURE = 0.0, 0.0  # of a pose that is as good as the settings say
LOST = 3.0  # times less sure than these: what is near may be another wall
NEW, MOVES = 0.5, 1.0  # confidence in what no map holds yet, and in what was followed as it moved
OF_OBJECT, OF_OBSTACLE, OF_WALL, KINDS_OF_ID = 0, 1, 2, 3  # what an id is of
KINDS = {"static": OBJECT_STATIC, "moved": OBJECT_MOVED}
NO_CELLS: I64 = np.zeros((0, 2), np.int64)
NOTHING = (0.0, 0.0, 0.0), np.zeros((0, 3), np.float32), np.zeros(0, np.float32), NO_CELLS


class Ground(Struct, frozen=True):
    """What the obstacle map asks of a frame."""

    cell_m: float
    bars_m: tuple[float, float]  # from one height above the floor to another a thing bars the way
    most_rays: int


class FrameLook:
    """Looks at frames, one after the other."""

    def __init__(self, settings: FrameSettings, of_map: ObjectMapSettings, ground: Ground) -> None:
        self._steps, self._of_map, self._ground = FrameSteps(settings), of_map, ground
        self._sigmas = of_map.pose_sigma_m, math.radians(of_map.pose_sigma_deg)
        self._far_m = float(settings.max_range_m)
        self._epoch, self._before_s = 0, -math.inf
        self._first = [0] * KINDS_OF_ID  # so many ids of each kind earlier maps have used
        self._highest = [0] * KINDS_OF_ID
        self.tell: Callable[[FloorView], None] | None = None  # who plans on the floor; None: nobody
        self._begin()

    def _begin(self) -> None:
        """A new map of objects: nothing of the old one can be placed any more."""
        self._objects, self._version = ObjectMap(self._of_map), 0
        self._newcomers: tuple[int, ...] = ()  # ids that were told of the frame before
        self._first = self._highest.copy()
        pieces = count(1)
        self._of_walls = WallReports(
            self._of_map.hull_sigma_m, lambda: self._id(OF_WALL, next(pieces))
        )

    def look(
        self, image: DepthImage, T_map_sensor: F64, epoch: int, sigmas: tuple[float, float] = SURE
    ) -> Seen:
        """What an image tells.

        Args:
            T_map_sensor: (4, 4) at its instant.
            epoch: of the map frame; with another one all objects begin anew.
            sigmas: of its x as of its y, m, and of its yaw, rad; those of the settings at least,
                and LOST times these at most.
        """
        if epoch != self._epoch:
            self._epoch = epoch
            self._begin()
        xy_m, yaw_rad = self._sigmas
        sigmas = (
            min(max(sigmas[0], xy_m), LOST * xy_m),
            min(max(sigmas[1], yaw_rad), LOST * yaw_rad),
        )
        pose = CameraPose(T_map_sensor, SIGMA_HEIGHT_M, SIGMA_TILT_RAD, SIGMA_TILT_RAD, *sigmas)
        result = self._steps.find(image, pose, self._objects.walls.landmarks())
        is_older = not image.t_s > self._before_s
        if result.doubt or result.floor is None or is_older:
            doubt = "an older frame" if is_older else result.doubt or "no floor"
            return Seen(image.t_s, epoch, doubt, *NOTHING, (), ())
        self._before_s = image.t_s
        found = evidence_of(
            self._steps.room, result.floor, self._ground.most_rays, self._ground.bars_m, self._far_m
        )
        if len(found.ranges_m) == 0:
            return Seen(image.t_s, epoch, "no floor", *NOTHING, (), ())
        R, t = T_map_sensor[:3, :3], T_map_sensor[:3, 3]
        places = (found.standing_m + np.array(image.camera.offset_m)) @ R.T + t
        cells = np.floor(places[:, :2] / self._ground.cell_m).astype(np.int64)
        standing = np.unique(cells, axis=0) if len(cells) else NO_CELLS
        update = self._objects.update(result.objects)
        if self.tell is not None:
            self.tell(self._floor_view(result.objects, update))
        changed, gone = self._changes(update.obstacles)
        rays, fix = (found.directions, found.ranges_m), None
        if (by := result.correction) is not None:
            fix = PoseFix.of(np.array([by.x_m, by.y_m, by.yaw_rad]), by.covariance, sigmas)
        lens_m = image.camera.offset_m
        return Seen(image.t_s, epoch, "", lens_m, *rays, standing, changed, gone, fix)

    def start_from(self, saved: SavedMap, at_s: float) -> None:
        """Before the first frame: a saved map or a floor plan, which is told with that frame.

        Raises:
            ValueError: a map has begun already.
        """
        self._objects.start_from(saved.objects, saved.walls, at_s, saved.next_id)

    def as_geojson(self) -> tuple[str, int]:
        """The map of objects as it is now; and how many there are."""
        objects, walls = self._objects.objects(), self._objects.walls.records()
        return geojson_from_map(objects, walls, self._of_map, self._objects.next_id), len(objects)

    def _walls(self) -> Floats:
        """(n, 4) m, those of the map."""
        known = [wall.segments for wall in self._objects.walls.records()]
        return np.vstack(known) if known else np.zeros((0, 4))

    def _floor_view(self, frame: FrameObjects, update: MapUpdate) -> FloorView:
        """Before the changes of the map are told: what is standing is told with each of them."""
        view = update.correction.frame(frame).view
        passing = tuple(
            PassingThing(one.id, one.polygon, one.is_moving, one.last_seen_s == frame.at_s)
            for one in update.obstacles
        )
        if update.version == self._version:
            return FloorView(view, passing, None, np.zeros((0, 4)))
        objects = self._objects.objects()
        standing = tuple(StandingThing(one.polygon, one.finished) for one in objects)
        return FloorView(view, passing, standing, self._walls())

    def _changes(
        self, obstacles: tuple[Obstacle, ...]
    ) -> tuple[tuple[ObjectReport, ...], tuple[int, ...]]:
        """Of objects since the frame before, and of all that is not in the map."""
        news = self._objects.changes_since(self._version)
        self._version = news.version
        changed, gone = list[ObjectReport](), list[int]()
        for shape in news.changed:
            if shape.kind == "wall":
                pieces, ended = self._of_walls.changed(self._objects.walls.record(shape.id))
                changed += pieces
                gone += ended
                continue
            near, _ = self._objects.near(box_of(shape.corners_mm / 1000.0))
            changed += [self._of_object(one) for one in near if one.id == shape.id]
        changed += [self._of_obstacle(one) for one in obstacles]
        now = tuple(self._id(OF_OBSTACLE, one.id) for one in obstacles)
        for number in news.deleted:
            gone += self._of_walls.gone(number) or [self._id(OF_OBJECT, number)]
        gone += [number for number in self._newcomers if number not in now]
        self._newcomers = now
        return tuple(changed), tuple(gone)

    def _id(self, which: int, number: int) -> int:
        """On the link: by what it is of, which never has that of another; nor has another map."""
        whole = self._first[which] + number
        self._highest[which] = max(self._highest[which], whole)
        return KINDS_OF_ID * whole + which

    def _of_object(self, one: MapObject) -> ObjectReport:
        outline, enlarged = told_outline(one.polygon)
        return ObjectReport(
            self._id(OF_OBJECT, one.id), KINDS[one.kind], outline, one.bottom_m, one.top_m,
            (0.0, 0.0), one.confidence, one.last_seen_s, enlarged,
        )  # fmt: skip

    def _of_obstacle(self, one: Obstacle) -> ObjectReport:
        velocity = one.velocity_mps if one.is_moving and one.velocity_mps else (0.0, 0.0)
        kind, sure = (OBJECT_MOVING, MOVES) if one.is_moving else (OBJECT_STATIC, NEW)
        outline, enlarged = told_outline(one.polygon)
        return ObjectReport(
            self._id(OF_OBSTACLE, one.id), kind, outline, one.bottom_m, one.top_m, velocity,
            sure, one.last_seen_s, enlarged,
        )  # fmt: skip

    def warm(self) -> None:
        """Run every kernel once, so that none is compiled while a robot drives."""
        self._steps.warm()
        warm_object_map(self._of_map)
