"""The real frames of tests/vectors/kinect, each with its camera and the pose that predicts it."""

import gzip
import math
from typing import NamedTuple

import msgspec
import numpy as np

from core.geometry import R_from_rpy
from core.objects.frame.settings import FrameSettings
from core.objects.frame.steps import CameraPose
from core.records import F32, DepthCamera, DepthImage
from tools.docs.pictures import ROOT

FOLDER = ROOT / "tests" / "vectors" / "kinect"
SIZE = 480, 640  # rows, columns
FOCAL_PX, METRES = 525.0, 0.001  # its README; one of its numbers

# sigmas: Khoshelham and Elberink 2012, 1.4 mm at 1 m, by the square of the range
KINECT = FrameSettings(
    min_range_m=0.4, max_range_m=5.0, noise_m=0.001, noise_per_m2=0.0015, top_m=2.0, floor_m=0.03,
    low_m=0.012, pit_m=0.05, flying_deg=3.0, voxel_m=0.02, cluster_m=0.05, least_m=0.05,
    hull_m=0.02, wall_m=0.05, wall_length_m=1.0, wall_height_m=0.5,
    summit_m=0.2,
)  # fmt: skip
NEAR = msgspec.structs.replace(KINECT, floor_m=0.02, voxel_m=0.01, cluster_m=0.02, hull_m=0.01)


class Frame(NamedTuple):
    """A real frame, what is known of its pose beforehand, and settings that suit it."""

    file: str
    centre_px: tuple[float, float]  # of the optical axis: column, row
    height_m: float
    pitch_deg: float
    roll_deg: float
    settings: FrameSettings


FRAMES = (
    Frame("boxes_1", (320.0, 240.0), 0.71, 46.0, -6.0, NEAR),
    Frame("boxes_2", (320.0, 240.0), 0.71, 46.0, -6.0, NEAR),
    Frame("five_people", (319.5, 239.5), 1.29, 4.9, 0.0, KINECT),
)


def rays_of(size: tuple[int, int], focal_px: float, centre_px: tuple[float, float]) -> F32:
    """Rays (rows, columns, 3) of a pinhole, for millimetres along the axis; no distortion."""
    row, column = np.mgrid[: size[0], : size[1]]
    ahead = np.ones(size)
    left, up = -(column - centre_px[0]) / focal_px, -(row - centre_px[1]) / focal_px
    return (METRES * np.stack([ahead, left, up], axis=-1)).astype(np.float32)


def image_of(frame: Frame) -> DepthImage:
    packed = (FOLDER / f"{frame.file}.u16.gz").read_bytes()
    numbers = np.frombuffer(gzip.decompress(packed), "<u2").reshape(SIZE).astype(np.uint16)
    camera = DepthCamera(rays_of(SIZE, FOCAL_PX, frame.centre_px), (0.0, 0.0, 0.0))
    return DepthImage(0.0, numbers, camera, 0, 0.0)


def pose_of(frame: Frame, sigma_height_m: float = 0.03, sigma_angle_deg: float = 1.0) -> CameraPose:
    """What is known of a frame's camera before it is looked at."""
    T = np.eye(4)
    T[:3, :3] = R_from_rpy(math.radians(frame.roll_deg), math.radians(frame.pitch_deg), 0.0)
    T[2, 3] = frame.height_m
    angle = math.radians(sigma_angle_deg)
    return CameraPose(T, sigma_height_m, angle, angle, 0.05, math.radians(1.0))
