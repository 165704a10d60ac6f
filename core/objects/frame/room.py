"""The arrays of a frame's steps, made once for a camera, and what is worked out from its rays.

Source: design, section 3: what is large is allocated once.
"""

import math
from collections.abc import Callable
from typing import Any, TypeVar, get_type_hints

import numpy as np
import numpy.typing as npt

from core.objects.frame.floor import LEVEL_BINS, Gated
from core.objects.frame.hulls import Rings
from core.objects.frame.outlines import Columns, Measures
from core.objects.frame.pixels import BEYOND_M, FAN_COLUMNS, I32, RIM, Fan, Points, Row
from core.objects.frame.settings import FrameSettings
from core.objects.frame.summits import LEVELS
from core.objects.frame.voxels import NONE, Clusters, Voxels, warp_of
from core.objects.frame.wall_ends import BINS
from core.records import F32, F64, I64, U8, U16, DepthCamera

T = TypeVar("T")
KINDS = {F32: np.float32, I32: np.int32, I64: np.int64, U8: np.uint8}

FAN_STEP_M = 0.03  # of the fan's cells, along x
FAN_WIDTH = 0.01  # and across, in y / x: at least so much, and two pixels that are counted
FAN_HALF = 2.0  # 63 degrees to each side
GATED = 20_000  # pixels among which the floor is sought, about


class Room:
    """What the steps write into, and a camera's pitch: radians from a pixel to the next."""

    def __init__(self, camera: DepthCamera, settings: FrameSettings) -> None:
        rows, columns, _ = camera.rays.shape
        n = rows * columns
        ints, floats = _ints, _floats
        table = _ints(1 << (n + n // 3).bit_length(), NONE)  # never full
        self.camera = camera
        with np.errstate(all="ignore"):
            norms = np.linalg.norm(camera.rays.astype(np.float64), axis=2)
        norms = np.where(np.isfinite(norms), norms, 0.0)
        self.per_unit: F32 = norms.astype(np.float32)
        units = np.nan_to_num(camera.rays, nan=0.0, posinf=0.0, neginf=0.0)
        planar = np.moveaxis(units / np.where(norms > 0.0, norms, 1.0)[:, :, None], 2, 0)
        self.units: F32 = np.ascontiguousarray(planar, np.float32)  # (3, rows, columns)
        self.row = _made(Row, columns)
        self.across_rad, self.down_rad = _pitch(camera.rays, 1), _pitch(camera.rays, 0)
        self.warp = warp_of(settings, max(self.across_rad, self.down_rad))
        self.stride = max(1, round(math.sqrt(n / GATED)))
        self.numbers: U16 = np.zeros((rows, columns), np.uint16)
        self.padded: F32 = np.full((rows + 2 * RIM, columns + 2 * RIM), BEYOND_M, np.float32)
        self.ranges: F32 = self.padded[RIM:-RIM, RIM:-RIM]
        self.kinds = np.zeros((rows, columns), np.uint8)
        self.points = Points(floats(n), floats(n), floats(n), np.ones(n, np.uint8), ints(2))
        self.voxels = _made(Voxels, n, table=table, sums=np.zeros((n, 8), np.float32))
        self.clusters = _made(Clusters, n, table=table)
        self.columns = _made(Columns, n, table=table)
        self.measures = _made(Measures, n, begin=ints(n + 1))
        self.rings = _made(Rings, n, begin=ints(n + 1))
        self.labels, self.used = ints(n), ints(n)
        self.line: F64 = np.zeros(6)
        self.bins = ints(max(BINS, LEVELS + 1))
        self.mean: F32 = np.zeros((n, 3), np.float32)
        self.patches: F32 = np.zeros((n // 4, 3), np.float32)
        self.gated = Gated(np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n), ints(2))
        self.levels = ints(LEVEL_BINS)
        self.N, self.C = np.zeros((3, 3)), np.zeros((3, 3))
        width = max(FAN_WIDTH, 2.0 * FAN_COLUMNS * self.across_rad)
        bearings = math.ceil(2.0 * FAN_HALF / width)
        steps = math.ceil(settings.max_range_m / FAN_STEP_M)
        cells = bearings * steps
        self.fan = Fan(
            ints(cells), ints(cells), floats(cells), ints(cells), bearings, steps, FAN_STEP_M,
            width, FAN_HALF, 1.0 / FAN_STEP_M, 1.0 / width,
        )  # fmt: skip
        self.rim: F64 = np.zeros(bearings)
        self.near, self.far = np.zeros(bearings), np.zeros(bearings)


def _made(of: Callable[..., T], n: int, **given: npt.NDArray[Any]) -> T:
    """A named tuple of arrays (n,), each of the type that its field has; but those given."""
    hints = get_type_hints(of)
    made = {name: np.zeros(n, KINDS[hint]) for name, hint in hints.items() if name not in given}
    return of(**made, **given)


def _ints(count: int, value: int = 0) -> I32:
    return np.full(count, value, np.int32)


def _floats(count: int) -> F32:
    return np.zeros(count, np.float32)


def _pitch(rays: npt.NDArray[np.float32], axis: int) -> float:
    """The median angle between rays that are neighbours along an axis; 0: there is none."""
    a = np.moveaxis(rays.astype(np.float64), axis, 0)
    before, after = a[:-1].reshape(-1, 3), a[1:].reshape(-1, 3)
    with np.errstate(all="ignore"):
        lengths = np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1)
        sines = np.linalg.norm(np.cross(before, after), axis=1) / lengths
    known = sines[np.isfinite(sines)]
    return float(np.arcsin(min(1.0, np.median(known)))) if len(known) > 0 else 0.0
