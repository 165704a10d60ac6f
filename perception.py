"""The depth camera in the app: images go to work beside the loop, what they tell enters at a tick.

A frame that comes while another one is looked at waits, and the newest takes its place. What one
tells is used at the tick at which it enters, with the frame's own time, and nothing else of the
camera moves the app: so a recording keeps that alone, and its replay is the same to the bit.
Source: design, section 10.
"""

import math
from collections import Counter
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from msgspec.structs import replace

from beside import Work
from core.config import Config
from core.geometry import R_from_rpy
from core.mapping.combined import FRAME_RAYS, camera_stale_s
from core.mapping.mapper import Mapper
from core.objects.seen import Seen
from core.objects.told import ToldObjects
from core.records import F64, DepthCamera, DepthImage, PointSweep
from hw.registry import DepthSensor

if TYPE_CHECKING:
    from core.objects.look import FrameLook  # polygons: not for a replay

WAIT_S = 0.3  # for the attitude and the place of a frame: then it is given up


class Perception:
    """What the app knows by its depth camera.

    Args:
        device: None: there is none, for its frames are replayed.

    Attributes:
        objects: those that planners are told of.
        seen_s: host time of the newest frame that told something; -inf: none.
        note: is told of each message that enters; None: nobody is.
        look: who looks at frames; None: nobody, for they are replayed.
        counts: frames by what became of them, in words.
    """

    def __init__(
        self, config: Config, device: DepthSensor | None, mapper: Mapper, work: Work[Seen]
    ) -> None:
        depth, objects, object_map = config.depth, config.objects, config.object_map
        assert depth is not None
        assert objects is not None
        assert object_map is not None
        self.objects, self.seen_s = ToldObjects(), -math.inf
        self.note: Callable[[Seen], None] | None = None
        self.counts = Counter[str]()
        self._device, self._mapper, self._work = device, mapper, work
        self._stale_s = camera_stale_s(config)
        bars_m = config.obstacle.h_pos_m, config.robot.height_m
        self.look: FrameLook | None = None
        if device is not None:
            from core.objects import look

            ground = look.Ground(config.map.cell_m, bars_m, FRAME_RAYS)
            self.look = look.FrameLook(objects, object_map, ground)
        self._R_body_sensor = R_from_rpy(*depth.mount_rpy_rad)
        self._t_body_sensor = np.array(depth.mount_xyz_m)
        self._placed = np.zeros(2), np.zeros(3)  # of the frame that is looked at: lens, and owed
        self._maybe_waiting: DepthImage | None = None  # the newest image that nobody looked at
        self._epoch = mapper.counts.erased

    def step(self, now_s: float) -> bool:
        """Take images in, and what was seen on them; whether the map or the objects changed."""
        if self._device is not None:
            for image in self._device.step(now_s):
                if self._device.doubt:
                    self.counts["doubted by the camera"] += 1
                    continue
                self.counts["passed over"] += self._maybe_waiting is not None
                self._maybe_waiting = image
        if self._mapper.counts.erased != self._epoch:
            self._epoch = self._mapper.counts.erased
            self.objects.clear()
            self.seen_s = -math.inf
        entered = False
        if (seen := self._work.maybe_take()) is not None:
            if self.look is not None and seen.fix is not None:
                seen = replace(seen, fix=seen.fix.of_body(*self._placed))
            if self.note is not None:
                self.note(replace(seen, epoch=seen.epoch - self._epoch))
            entered = self._enter(seen, self._epoch if self.look is not None else 0)
        if self._maybe_waiting is not None:
            self._give(now_s, self._maybe_waiting)
        return entered

    def is_stale(self, now_s: float) -> bool:
        """Whether no frame has told anything lately."""
        return now_s - self.seen_s > self._stale_s

    def _give(self, now_s: float, image: DepthImage) -> None:
        """Have the waiting image looked at, once its place is known."""
        mapper, at_s = self._mapper, image.t_s
        if not (mapper.attitudes.reaches(at_s, at_s) and mapper.odometry.covers(at_s, at_s)):
            if now_s - image.arrived_s > WAIT_S:
                self._maybe_waiting = None
                self.counts["without a place"] += 1
            return
        look = self.look
        if self._work.is_idle and look is not None:
            self._maybe_waiting = None
            T, epoch = self._T_map_sensor(at_s), self._epoch
            lens_m = T[:2, :3] @ image.camera.offset_m + T[:2, 3]
            self._placed = lens_m - mapper.odometry.xy_at(at_s), mapper.odometry.owed
            sigmas = _sigmas(mapper.odometry.covariance)
            self._work.give(lambda: look.look(image, T, epoch, sigmas))

    def _T_map_sensor(self, at_s: float) -> F64:
        """(4, 4) at a covered instant."""
        roll, pitch, yaw = self._mapper.attitudes.rpy_at(at_s)
        x_m, y_m, z_m, _ = self._mapper.odometry.place_at(at_s)
        R = R_from_rpy(roll, pitch, yaw - self._mapper.odometry.yaw_start_rad)
        T = np.eye(4)
        T[:3, :3] = R @ self._R_body_sensor
        T[:3, 3] = R @ self._t_body_sensor + (x_m, y_m, z_m)
        return T

    def _enter(self, seen: Seen, epoch: int) -> bool:
        """Use what a frame told, if it is of this epoch; whether it told anything."""
        if seen.doubt or seen.epoch != epoch:
            self.counts[seen.doubt or "of an erased map"] += 1
            return False
        n = len(seen.ranges_m)
        sweep = PointSweep(
            np.tile(np.array(seen.lens_m), (n, 1)),
            seen.directions.astype(np.float64),
            seen.ranges_m.astype(np.float64)[None],
            np.full(n, seen.t_s),
            counter=0,
            arrived_s=seen.t_s,
        )
        if not self._mapper.add_frame(sweep, seen.standing):
            self.counts["without a place"] += 1
            return False
        if seen.fix is not None and not self._mapper.odometry.correct_by(seen.fix, seen.t_s):
            self.counts["with walls elsewhere"] += 1
        self.objects.take(seen)
        self.seen_s = seen.t_s
        self.counts["used"] += 1
        return True

    def warm(self) -> None:
        """Run every kernel once, so that none is compiled while a robot drives."""
        if self.look is None:
            return
        self.look.warm()
        T = np.eye(4)
        T[:3, :3], T[2, 3] = R_from_rpy(0.0, 0.5, 0.0), 0.5
        self._enter(self.look.look(made_up_image(0.03), T, self._epoch), self._epoch)


def _sigmas(P: F64) -> tuple[float, float]:
    """Of x as of y, m, whichever is larger, and of yaw, rad, by a covariance (3, 3)."""
    largest = float(np.linalg.eigvalsh(P[:2, :2])[-1])
    return math.sqrt(max(0.0, largest)), math.sqrt(max(0.0, float(P[2, 2])))


def made_up_image(t_s: float) -> DepthImage:
    """Floor and a box, of few pixels, as from a lens at 0.5 m that looks 0.5 rad down."""
    row, column = np.mgrid[:60, :80]
    rays = 0.001 * np.stack([np.ones(row.shape), (39.5 - column) / 60.0, (29.5 - row) / 60.0], -1)
    down = -(R_from_rpy(0.0, 0.5, 0.0) @ rays.reshape(-1, 3).T)[2].reshape(row.shape)
    with np.errstate(divide="ignore"):
        numbers = np.clip(np.where(down > 0.0, 0.5 / down, 0.0), 0.0, 4000.0)
    numbers[:, 20:40] *= 0.6
    camera = DepthCamera(rays.astype(np.float32), (0.0, 0.0, 0.0))
    return DepthImage(t_s, numbers.astype(np.uint16), camera, 0, t_s)
