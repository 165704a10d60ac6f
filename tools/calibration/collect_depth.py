"""Depth images for a calibration: all of a folder at once, or of a live camera for some seconds.

Opens the camera's port and no other, so that nothing can move.
"""

import contextlib
import math
import time
from collections.abc import Callable
from pathlib import Path

from core.config import Config
from core.records import DepthImage
from hw.depth_images.folder import CAMERA_KIND, FolderFrames
from hw.depth_images.parts import Part
from hw.device import BadFrame
from hw.ports.folder import CAMERA, images_of, maybe_camera_of
from hw.ports.url import parse_url
from hw.ports.wires import open_port, ports_beside
from hw.registry import DEPTH_CAMERAS, DepthSensor, Surroundings
from tools.calibration.collect_floor import PROGRESS_S, READY_S, STEP_S, RefusedError

MOST_IMAGES = 200  # evenly left out beyond


def images_in(folder: Path) -> tuple[list[DepthImage], list[str]]:
    """The images of a folder, and why others are of no use.

    Raises:
        OSError: something is not there.
        ValueError: the folder can't be played, or its camera.toml is of no use; says why.
    """
    frames, lens = FolderFrames(), maybe_camera_of(folder)
    if not lens:
        raise ValueError(f"{folder} has no {CAMERA}, which tells the lens")
    refused = frames.take(Part(lens, CAMERA_KIND, None, -1, 0.0, 0.0))
    if isinstance(refused, BadFrame):
        raise ValueError(refused.reason)
    files = images_of(folder)
    images, faults = list[DepthImage](), list[str]()
    for number, (t_s, data) in enumerate(files[:: math.ceil(len(files) / MOST_IMAGES)]):
        made = frames.take(Part(data, "", t_s, number, t_s, t_s))
        if isinstance(made, BadFrame):
            faults.append(f"image {number + 1}: {made.reason}")
        elif made is not None:
            images.append(made)
    return images, faults


def camera_of(config: Config, stack: contextlib.ExitStack) -> DepthSensor:
    """The camera of [depth], on its port. Raises RefusedError, PortUrlError: there is none."""
    depth = config.depth
    if depth is None or not config.has_camera:
        raise RefusedError("depth.driver: no camera is set; set one, or give --folder")
    port = stack.enter_context(contextlib.closing(open_port(depth.port)))
    is_tcp = parse_url(depth.port).kind == "tcp"
    around = Surroundings(depth.port, 0.0, False, ports_beside(depth.port) if is_tcp else None)
    camera = DEPTH_CAMERAS[depth.driver].make(port, depth.options, around)
    stack.callback(camera.stop)
    return camera


class Watch:
    """A camera's images for so long, once it runs well."""

    def __init__(self, camera: DepthSensor, seconds: float) -> None:
        self.images: list[DepthImage] = []
        self._camera, self._seconds = camera, seconds
        self._begun_s = self._ready_s = math.inf

    def step(self, now_s: float) -> bool:
        """Never waits; True: done. Raises RefusedError: it does not run, or not well."""
        self._begun_s = min(self._begun_s, now_s)
        found = self._camera.step(now_s)
        if found and self._ready_s == math.inf:
            self._ready_s = now_s
        if self._ready_s == math.inf:
            if now_s - self._begun_s > READY_S:
                raise RefusedError(f"no image within {READY_S:g} s: {self.words()}")
            return False
        every_s = self._seconds / MOST_IMAGES
        if not self.images or (found and found[-1].t_s - self.images[-1].t_s >= every_s):
            self.images += found[-1:]
        return now_s - self._ready_s >= self._seconds

    def gone_s(self, now_s: float) -> float:
        return max(0.0, min(now_s - self._ready_s, self._seconds))

    def words(self) -> str:
        status = self._camera.status
        told = self._camera.doubt or status.cause
        return f"{len(self.images)} images; the camera is {status.state}{told and ': ' + told}"


def watched(
    config: Config, seconds: float, advance: Callable[[float, str], None]
) -> list[DepthImage]:
    """`advance` gets the seconds that count, and words. Raises RefusedError, PortUrlError."""
    with contextlib.ExitStack() as stack:
        watch = Watch(camera_of(config, stack), seconds)
        told_s = now_s = time.monotonic()
        while not watch.step(now_s):
            if now_s - told_s >= PROGRESS_S:
                told_s = now_s
                advance(watch.gone_s(now_s), watch.words())
            time.sleep(STEP_S)
            now_s = time.monotonic()
    return watch.images
