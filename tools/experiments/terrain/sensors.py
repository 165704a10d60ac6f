"""The sensors that are carried: a URG-04LX, and a camera with a plane of laser light.

The scanner's ranges are those of the fake's lens: noise, mixed pixels and codes. The camera's are
what the driver finds in images of the fake camera, under a lamp.
"""

import math
from dataclasses import dataclass

import numpy as np

from core.records import F64, PointSweep, Scan
from fakes.rays.rays import Poses, Rays
from fakes.rays.sight import Met
from fakes.scenes.scene import Scene
from fakes.stripe.device import FakeStripe
from fakes.stripe.jpeg import jpeg_from_image
from fakes.urg04lx.models import MODELS
from fakes.urg04lx.optics import Optics
from fakes.world import robot
from hw.device import BadFrame
from hw.stripe.images import Decoder
from hw.stripe.options import StripeOptions
from hw.stripe.sweep import SweepMaker

URG_NAME = "URG-04LX"
MODEL = MODELS[URG_NAME]
SIDE_DEG = 60.0  # of its beams used, to either side


@dataclass(frozen=True, slots=True)
class Mount:
    """What is carried, over the body's origin: how high over the ground, how much it looks down."""

    height_m: float
    tilt_deg: float
    is_stripe: bool = False


def _still(place_m: F64, R: F64) -> Poses:
    def poses_at(times_s: F64) -> tuple[F64, F64]:
        n = len(times_s)
        return np.tile(place_m, (n, 1)), np.tile(R, (n, 1, 1))

    return poses_at


class Urg:
    """Scans of a URG-04LX."""

    def __init__(self, scene: Scene, mount: Mount, seed: int) -> None:
        self._rays = Rays(scene, seed, mount=robot.Mount(0.0, 0.0, mount.height_m, mount.tilt_deg))
        self._optics, self._random = Optics(MODEL, seed), np.random.default_rng([seed, 8])
        self._step_rad = 2.0 * math.pi / MODEL.ares
        most = math.floor(math.radians(SIDE_DEG) / self._step_rad)
        steps: F64 = np.arange(-most, most + 1, dtype=np.float64)
        self._bearings_rad = np.asarray(steps * self._step_rad, np.float64)

    def sweep(self, t_s: float, counter: int, xyz_m: F64, R: F64) -> Scan:
        bearings_rad = self._bearings_rad
        poses_at = _still(xyz_m, R)
        times_s = np.full(len(bearings_rad), t_s)
        true_m = np.atleast_2d(self._rays.ranges_m(poses_at, times_s, bearings_rad, 0.0))[0]
        values = self._optics.measured(true_m, self._random).values
        ranges_m = np.where(values >= MODEL.dmin, values / 1000.0, np.nan)[None]
        first_rad = float(bearings_rad[0])
        return Scan(t_s, 0.0, first_rad, self._step_rad, ranges_m, counter, t_s)


class Stripe:
    """Sweeps of a camera that sees the line of a laser.

    Args:
        options: the driver's; the fake camera is as these describe it.
    """

    def __init__(self, scene: Scene, mount: Mount, options: StripeOptions, seed: int) -> None:
        self._rays, self._pose = Rays(scene, seed), _still(np.zeros(3), np.eye(3))
        self._fake = FakeStripe(self._sight, seed)
        self._fake.mount_m, self._fake.tilt_deg = (0.0, 0.0, mount.height_m), mount.tilt_deg
        self._decoder = Decoder((options.image_px[0], options.image_px[1]))
        self._maker = SweepMaker(options)

    def _sight(self, t_s: float, begins: F64, ways: F64) -> Met:
        return self._rays.met(self._pose, t_s, (begins, ways), 0.0)

    def sweep(self, t_s: float, counter: int, xyz_m: F64, R: F64) -> PointSweep:
        self._pose = _still(xyz_m, R)
        image = self._decoder.image(jpeg_from_image(self._fake.camera.image(t_s), self._fake))
        assert not isinstance(image, BadFrame), image.reason
        return self._maker.sweep(image, t_s, t_s)
