"""Scenes with truth: floor, boxes and walls, met by the rays of a pinhole camera one by one.

Written with NumPy alone; it shares nothing with the steps that it tests.
"""

import math
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from core.objects.frame.steps import CameraPose
from core.records import DepthCamera, DepthImage

F64 = npt.NDArray[np.float64]
SIZE = 180, 240  # rows, columns
FOCAL_PX = 200.0  # 62 by 48 degrees
PER_M = 4000.0  # numbers of a metre


@dataclass(frozen=True)
class Box:
    """Upright on its yaw, from one height to another."""

    x_m: float
    y_m: float
    length_m: float
    width_m: float
    low_m: float
    high_m: float
    yaw_rad: float = 0.0

    @property
    def corners(self) -> F64:
        """(4, 2) m, counter-clockwise."""
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        half = 0.5 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
        local = half * [self.length_m, self.width_m]
        return np.asarray(local @ np.array([[c, s], [-s, c]]) + [self.x_m, self.y_m])


def column(x_m: float, y_m: float, radius_m: float, high_m: float) -> tuple[Box, ...]:
    """Upright and nearly round, of boxes."""
    long, wide = (2.0 * radius_m * of(math.pi / 16) for of in (math.cos, math.sin))
    yaws = [k * math.pi / 8 for k in range(8)]
    return tuple(Box(x_m, y_m, long, wide, 0.0, high_m, yaw) for yaw in yaws)


@dataclass(frozen=True)
class Scene:
    """Boxes over a floor, and places where floor is missing."""

    boxes: tuple[Box, ...] = ()
    floor_m: float = 0.0  # its height
    holes: tuple[Box, ...] = field(default=())  # floor lies at their low_m there


def rotation(roll: float, pitch: float, yaw: float) -> F64:
    cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    Rx = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    Ry = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    Rz = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    return np.asarray(Rz @ Ry @ Rx)


def camera(
    offset_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
    size: tuple[int, int] = SIZE,
    focal_px: float = FOCAL_PX,
) -> DepthCamera:
    row, column = np.mgrid[: size[0], : size[1]]
    left, up = (size[1] / 2 - 0.5 - column) / focal_px, (size[0] / 2 - 0.5 - row) / focal_px
    rays = np.stack([np.ones(size), left, up], axis=-1) / PER_M
    return DepthCamera(rays.astype(np.float32), offset_m)


def placed(
    height_m: float, pitch_deg: float, roll_deg: float = 0.0, yaw_deg: float = 0.0,
    x_m: float = 0.0, y_m: float = 0.0,
) -> F64:  # fmt: skip
    """T_map_sensor."""
    T = np.eye(4)
    T[:3, :3] = rotation(*np.radians([roll_deg, pitch_deg, yaw_deg]))
    T[:3, 3] = x_m, y_m, height_m
    return T


def pose(T: F64, height_m: float = 0.02, angle_deg: float = 0.7) -> CameraPose:
    return CameraPose(T, height_m, math.radians(angle_deg), math.radians(angle_deg), 0.03, 0.01)


def met(scene: Scene, start: F64, rays: F64) -> F64:
    """How many of each ray (n, 3) until it meets something; inf: never."""
    with np.errstate(all="ignore"):
        far: F64 = (scene.floor_m - start[2]) / rays[:, 2]
        far[~(far > 0.0)] = np.inf
        for hole in scene.holes:
            at = start + far[:, None] * rays
            inside = _inside(hole, at[:, :2])
            far[inside] = ((hole.low_m - start[2]) / rays[:, 2])[inside]
        for box in scene.boxes:
            far = np.minimum(far, _box(box, start, rays))
    return far


def _turned(box: Box, xy: F64) -> F64:
    c, s = math.cos(box.yaw_rad), math.sin(box.yaw_rad)
    return np.asarray((xy - [box.x_m, box.y_m]) @ np.array([[c, -s], [s, c]]))


def _inside(box: Box, xy: F64) -> npt.NDArray[np.bool_]:
    local = np.abs(_turned(box, xy))
    return np.asarray((local[:, 0] <= box.length_m / 2) & (local[:, 1] <= box.width_m / 2))


def _box(box: Box, start: F64, rays: F64) -> F64:
    c, s = math.cos(box.yaw_rad), math.sin(box.yaw_rad)
    turn = np.array([[c, -s], [s, c]])
    p = np.array([*_turned(box, start[None, :2])[0], start[2]])
    d = np.column_stack([rays[:, :2] @ turn, rays[:, 2]])
    low = np.array([-box.length_m / 2, -box.width_m / 2, box.low_m])
    high = np.array([box.length_m / 2, box.width_m / 2, box.high_m])
    a, b = (low - p) / d, (high - p) / d
    enter, leave = np.minimum(a, b).max(axis=1), np.maximum(a, b).min(axis=1)
    return np.asarray(np.where((enter <= leave) & (enter > 0.0), enter, np.inf))


def image(
    scene: Scene, T: F64, of: DepthCamera, noise_m: float = 0.002, seed: int = 1,
    lost: float = 0.0,
) -> DepthImage:  # fmt: skip
    """A frame: noise along the ray, a share of pixels lost, nothing beyond the largest number."""
    random = np.random.default_rng(seed)
    rays = of.rays.reshape(-1, 3).astype(np.float64) @ T[:3, :3].T
    start = T[:3, :3] @ np.array(of.offset_m) + T[:3, 3]
    numbers = met(scene, start, rays)
    numbers += random.normal(0.0, noise_m, len(rays)) / np.linalg.norm(rays, axis=1)
    numbers[~(numbers < 65535.0) | (random.random(len(rays)) < lost)] = 0.0
    whole = np.round(np.maximum(numbers, 0.0)).astype(np.uint16).reshape(of.rays.shape[:2])
    return DepthImage(1.5, whole, of, 7, 1.6)
