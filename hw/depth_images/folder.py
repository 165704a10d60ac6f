"""Parts of a folder to depth images: its camera.toml first, then PNG by PNG.

size_px = [640, 480]          # width, height
focal_px = [525.0, 525.0]     # fx, fy
centre_px = [319.5, 239.5]    # cx, cy
units_per_m = 1000.0          # of the images' numbers
along = "axis"                # or "ray"
mirrored = false
"""

from typing import Annotated, Literal

import msgspec
from msgspec import Meta, Struct

from core.records import DepthCamera, DepthImage
from hw.depth_images import png
from hw.depth_images.parts import Part
from hw.depth_images.rays import Pinhole, camera_of, fault_of
from hw.device import BadFrame

CAMERA_KIND = "application/toml"
NO_CAMERA = "an image, and no camera.toml before it that is as it should be"
MOST_SIDE = 2048  # pixels
Side = Annotated[int, Meta(ge=2, le=MOST_SIDE)]


class CameraFile(Struct, frozen=True, forbid_unknown_fields=True):
    """What camera.toml says."""

    size_px: tuple[Side, Side]
    focal_px: tuple[float, float]
    centre_px: tuple[float, float]
    units_per_m: Annotated[float, Meta(ge=50, le=100_000)]
    along: Literal["axis", "ray"]
    mirrored: bool

    @property
    def lens(self) -> Pinhole:
        return Pinhole(
            self.size_px, self.focal_px, self.centre_px, 1.0 / self.units_per_m,
            self.along == "ray", self.mirrored,
        )  # fmt: skip


def lens_of(data: bytes) -> Pinhole | str:
    """The lens that a camera.toml tells; or why it is of no use, in words."""
    try:
        lens = msgspec.toml.decode(data, type=CameraFile).lens
    except (msgspec.MsgspecError, ValueError, RecursionError, ArithmeticError) as error:
        return f"a camera.toml that can't be: {str(error)[:200]}"
    why = fault_of(lens)
    return f"camera.toml has {why}" if why else lens


class FolderFrames:
    """Makes images of the parts that a folder's port gives."""

    def __init__(self) -> None:
        png.warm()
        self._why = NO_CAMERA
        self._maybe_lens: Pinhole | None = None
        self._maybe_camera: DepthCamera | None = None

    def take(self, part: Part) -> DepthImage | BadFrame | None:
        """The image, its time that of the part; or why it is of no use. None: a camera.toml."""
        if part.kind == CAMERA_KIND:
            return self._learn(part.data)
        lens, camera = self._maybe_lens, self._maybe_camera
        if lens is None or camera is None:
            return BadFrame(self._why, b"")
        try:
            numbers = png.numbers_of(part.data, lens.size_px)
        except png.PngError as error:
            return BadFrame(str(error), b"")
        assert part.stamp_s is not None, "the device looks at it first"
        return DepthImage(part.stamp_s, numbers, camera, part.number, part.arrived_s)

    def _learn(self, data: bytes) -> BadFrame | None:
        lens = lens_of(data)
        if isinstance(lens, str):
            self._maybe_lens, self._maybe_camera, self._why = None, None, lens
            return BadFrame(lens, b"")
        if lens != self._maybe_lens:
            self._maybe_lens, self._maybe_camera = lens, camera_of(lens)
        return None
