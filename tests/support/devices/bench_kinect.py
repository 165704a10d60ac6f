"""A fake Kinect, or a data set of one, and its driver on a wire in memory, and a clock."""

from typing import Any

import numpy as np

from core.records import F64, DepthImage
from fakes.kinect.device import FakeKinect
from fakes.kinect.faults import Form
from fakes.kinect.sensing import Lens, Sight
from fakes.wires.wire import MemoryPort, Wire
from fakes.world.simple import Ground
from hw.depth_images.options import FolderOptions, KinectOptions
from hw.depth_images.session import DepthImages, folder_on, kinect_on

TICK_S = 0.004  # no part of a frame's period
SMALL = Lens((64, 48), (58.0, 58.0), (31.5, 23.5))  # of a data set: few pixels, much time saved
USUAL: dict[str, Any] = {
    "focal_px": [580.0, 580.0],
    "centre_px": [319.5, 239.5],
    "mirrored": False,
    "latency_s": 0.04,
    "emitter_m": 0.075,
    "reference_m": 1.2,
    "pixel_m": 0.001042,
    "shift": 200,
}


def options_of(**given: Any) -> KinectOptions:
    return KinectOptions(**(USUAL | given))


def camera_on(port: Any, form: Form) -> DepthImages:
    return (
        folder_on(port, FolderOptions(1 / 30)) if form == "png" else kinect_on(port, options_of())
    )


def points_of(image: DepthImage) -> F64:
    """(rows, columns, 3) metres, sensor frame; NaN where there is none."""
    points = image.numbers[..., None] * image.camera.rays
    return np.where(image.numbers[..., None] > 0, points, np.nan)


class Bench:
    """One camera before a wall, and the driver."""

    def __init__(self, form: Form = "png", sight: Sight | None = None) -> None:
        lens = SMALL if form == "png" else None
        self.fake = FakeKinect(sight or Ground("wall:1.6").met, 1, form, lens)
        self.port = MemoryPort()
        self.wire = Wire(self.fake, self.port, 1)
        self.camera = camera_on(self.port, form)
        self.now_s = 100.0

    def run(self, seconds: float) -> list[DepthImage]:
        images: list[DepthImage] = []
        for _ in range(round(seconds / TICK_S)):
            self.wire.step(self.now_s)
            images += self.camera.step(self.now_s)
            self.now_s += TICK_S
        return images

    @property
    def told(self) -> tuple[str, str]:
        return self.camera.status.state, self.camera.status.cause

    @property
    def reasons(self) -> set[str]:
        return {rejection.reason for rejection in self.camera.status.rejections}
