"""A camera with a plane of laser light that is carried, as a sensor of a ride.

Its ranges are what the driver finds in images of the fake camera, under a lamp.
"""

import numpy as np

from core.records import F64, PointSweep
from fakes.rays.rays import Rays
from fakes.rays.sight import Met
from fakes.scenes.scene import Scene
from fakes.stripe.device import FakeStripe
from fakes.stripe.jpeg import jpeg_from_image
from hw.device import BadFrame
from hw.stripe.images import Decoder
from hw.stripe.options import StripeOptions
from hw.stripe.sweep import SweepMaker
from tools.experiments.terrain.urg import Mount, still


class Stripe:
    """Sweeps of a camera that sees the line of a laser.

    Args:
        options: the driver's; the fake camera is as these describe it.
    """

    def __init__(self, scene: Scene, mount: Mount, options: StripeOptions, seed: int) -> None:
        self._rays, self._pose = Rays(scene, seed), still(np.zeros(3), np.eye(3))
        self._fake = FakeStripe(self._sight, seed)
        self._fake.mount_m, self._fake.tilt_deg = (0.0, 0.0, mount.height_m), mount.tilt_deg
        self._decoder = Decoder((options.image_px[0], options.image_px[1]))
        self._maker = SweepMaker(options)

    def _sight(self, t_s: float, begins: F64, ways: F64) -> Met:
        return self._rays.met(self._pose, t_s, (begins, ways), 0.0)

    def sweep(self, t_s: float, counter: int, xyz_m: F64, R: F64) -> PointSweep:
        self._pose = still(xyz_m, R)
        image = self._decoder.image(jpeg_from_image(self._fake.camera.image(t_s), self._fake))
        assert not isinstance(image, BadFrame), image.reason
        return self._maker.sweep(image, t_s, t_s)
