"""What the settings say of these cameras: the keys that their drivers alone know.

Source: kinect sheet, sections 1 and 2.
"""

from typing import Annotated

from msgspec import Meta, Struct

from hw.depth_images.rays import Pinhole, fault_of

KINECT_PX, KINECT_HZ = (640, 480), 30.0
Pair = Annotated[list[float], Meta(min_length=2, max_length=2)]


class KinectOptions(Struct, frozen=True):
    """A Kinect's lens and its way from raw values to millimetres."""

    focal_px: Pair
    centre_px: Pair
    mirrored: bool  # left and right are exchanged
    latency_s: Annotated[float, Meta(ge=0, le=0.5)]  # from the middle of exposure to a whole frame
    emitter_m: Annotated[float, Meta(ge=0.01, le=0.2)]  # from the projector to the camera
    reference_m: Annotated[float, Meta(ge=0.3, le=3)]  # where its pattern was stored
    pixel_m: Annotated[float, Meta(ge=0.0002, le=0.01)]  # of the image, on that plane
    shift: Annotated[int, Meta(ge=0, le=500)]  # of the raw values

    def __post_init__(self) -> None:
        if why := fault_of(self.lens):
            raise ValueError(f"focal_px, centre_px: {why}")

    @property
    def lens(self) -> Pinhole:
        (fx, fy), (cx, cy) = self.focal_px, self.centre_px
        return Pinhole(KINECT_PX, (fx, fy), (cx, cy), 0.001, False, self.mirrored)

    @property
    def period_s(self) -> float:
        return 1.0 / KINECT_HZ

    def describe(self) -> str:
        return f"Kinect, {KINECT_PX[0]} x {KINECT_PX[1]} px at {KINECT_HZ:g} frames/s"


class FolderOptions(Struct, frozen=True):
    """A folder of depth images; its camera.toml tells the lens."""

    period_s: Annotated[float, Meta(ge=0.005, le=5)]  # between its images

    def describe(self) -> str:
        return f"a folder of depth images, one each {1000 * self.period_s:.0f} ms"
