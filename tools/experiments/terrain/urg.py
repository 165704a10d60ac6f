"""A URG-04LX that is carried, as a sensor of a ride: its noise, mixed pixels and codes."""

import math
from dataclasses import dataclass

import numpy as np

from core.records import F64, Scan
from fakes.rays.rays import Poses, Rays
from fakes.scenes.scene import Scene
from fakes.urg04lx.models import MODELS
from fakes.urg04lx.optics import Optics
from fakes.world import robot

URG_NAME = "URG-04LX"
MODEL = MODELS[URG_NAME]
SIDE_DEG = 60.0  # of its beams used, to either side


@dataclass(frozen=True, slots=True)
class Mount:
    """What is carried, over the body's origin: how high over the ground, how much it looks down."""

    height_m: float
    tilt_deg: float
    is_stripe: bool = False


def still(place_m: F64, R: F64) -> Poses:
    """A body that stands at (3,), turned by R (3, 3): map frame."""

    def poses_at(times_s: F64) -> tuple[F64, F64]:
        n = len(times_s)
        return np.tile(place_m, (n, 1)), np.tile(R, (n, 1, 1))

    return poses_at


class Urg:
    """Scans of a URG-04LX, of beams up to `side_deg` to either side."""

    def __init__(self, scene: Scene, mount: Mount, seed: int, side_deg: float = SIDE_DEG) -> None:
        self._rays = Rays(scene, seed, mount=robot.Mount(0.0, 0.0, mount.height_m, mount.tilt_deg))
        self._optics, self._random = Optics(MODEL, seed), np.random.default_rng([seed, 8])
        self._step_rad = 2.0 * math.pi / MODEL.ares
        most = math.floor(math.radians(side_deg) / self._step_rad)
        steps: F64 = np.arange(-most, most + 1, dtype=np.float64)
        self._bearings_rad = np.asarray(steps * self._step_rad, np.float64)

    def sweep(self, t_s: float, counter: int, xyz_m: F64, R: F64) -> Scan:
        bearings_rad = self._bearings_rad
        poses_at = still(xyz_m, R)
        times_s = np.full(len(bearings_rad), t_s)
        true_m = np.atleast_2d(self._rays.ranges_m(poses_at, times_s, bearings_rad, 0.0))[0]
        values = self._optics.measured(true_m, self._random).values
        ranges_m = np.where(values >= MODEL.dmin, values / 1000.0, np.nan)[None]
        first_rad = float(bearings_rad[0])
        return Scan(t_s, 0.0, first_rad, self._step_rad, ranges_m, counter, t_s)
