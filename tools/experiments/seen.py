"""Where the scanner's beams truly ended: the part of the world that a map can know about at all.

Taken from the world, without noise of range, attitude or position. Cells lie as those of the maps
do, in the world's frame, which is the map's as long as the odometry does not err.
"""

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from fakes.world.robot import LENS_BODY_M, LENS_TILT_DEG

F64 = npt.NDArray[np.float64]
REACH_M = 20.0  # of the scanner
HALF_M = 45.0  # of the square around the origin that is noted
POSES = 9  # along one sweep, interpolated between


class SeenCells:
    """Per cell how many beams ended in it, and the lowest and highest place where one did.

    Arrays are (size, size), [j, i] along map y and x, from world cell (corner, corner) on.

    Args:
        span_rad: (first, last) bearing that the apps use.
    """

    def __init__(self, cell_m: float, span_rad: tuple[float, ...]) -> None:
        self.cell_m, self._span_rad = cell_m, (span_rad[0] - 1e-6, span_rad[1] + 1e-6)
        self.size = 2 * math.ceil(HALF_M / cell_m)
        self.corner = -self.size // 2
        self.hits = np.zeros((self.size, self.size), dtype=np.int32)
        self.low_m = np.full((self.size, self.size), np.inf)
        self.high_m = np.full((self.size, self.size), -np.inf)
        self.newest_s = np.full((self.size, self.size), -np.inf)  # a floor return: below 5 cm

    def note(self, world: Any, times_s: F64, bearings_rad: F64, ranges_m: F64) -> None:
        """Take one sweep: instants, bearings and true ranges (n,)."""
        used = (bearings_rad >= self._span_rad[0]) & (bearings_rad <= self._span_rad[1])
        used &= ranges_m <= REACH_M  # NaN is not
        if not used.any():
            return
        points = _points(world, times_s[used], bearings_rad[used], ranges_m[used])
        i = np.floor(points[:, 0] / self.cell_m).astype(np.int64) - self.corner
        j = np.floor(points[:, 1] / self.cell_m).astype(np.int64) - self.corner
        inside = (i >= 0) & (i < self.size) & (j >= 0) & (j < self.size)
        at, z = (j[inside], i[inside]), points[inside, 2]
        np.add.at(self.hits, at, 1)
        np.minimum.at(self.low_m, at, z)
        np.maximum.at(self.high_m, at, z)
        floor = z < 0.05
        self.newest_s[at[0][floor], at[1][floor]] = float(times_s[-1])

    def part(self, layer: npt.NDArray[Any], corner_i: int, corner_j: int, size: int) -> Any:
        i, j = corner_i - self.corner, corner_j - self.corner
        return layer[j : j + size, i : i + size]


def _points(world: Any, times_s: F64, bearings_rad: F64, ranges_m: F64) -> F64:
    """Ends of the beams (n, 3), map frame."""
    knots_s = np.linspace(times_s[0], times_s[-1], POSES)
    poses = np.array([(*world.pose(t), world.height_m(t)) for t in knots_s.tolist()])
    poses[:, 2] = np.unwrap(poses[:, 2])
    columns = [np.interp(times_s, knots_s, poses[:, k]) for k in range(6)]
    x, y, yaw, pitch, roll, z = columns
    tilt = math.radians(LENS_TILT_DEG)
    ray_x, ray_y = np.cos(bearings_rad) * ranges_m, np.sin(bearings_rad) * ranges_m
    bx = LENS_BODY_M[0] + math.cos(tilt) * ray_x
    by = LENS_BODY_M[1] + ray_y
    bz = LENS_BODY_M[2] - math.sin(tilt) * ray_x
    by, bz = np.cos(roll) * by - np.sin(roll) * bz, np.sin(roll) * by + np.cos(roll) * bz
    bx, bz = np.cos(pitch) * bx + np.sin(pitch) * bz, -np.sin(pitch) * bx + np.cos(pitch) * bz
    wx, wy = np.cos(yaw) * bx - np.sin(yaw) * by, np.sin(yaw) * bx + np.cos(yaw) * by
    return np.column_stack([x + wx, y + wy, z + bz])
