"""What is true of each cell: floor or something that must not be met; and where beams truly ended.

Floor is what can be reached from the robot's place, or from another that the scene calls floor,
without a step of the bound or more between neighbouring samples 5 cm apart; all else, the edges of
such steps too, is an obstacle. So a ramp is floor, and so is a slab of 5 cm; a box, a wall and a
ditch are obstacles, whatever their place. Where beams ended is taken from the world, without noise:
the part of it that a map can know about at all.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from fakes.world.robot import LENS_BODY_M, LENS_TILT_DEG
from tools.floor import BOUND_M, DANGER_M, SAMPLE_M, edges_of, floor_of

F64 = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]
Span = tuple[float, float]  # of the map frame
REACH_M = 20.0  # of the scanner
HALF_M = 45.0  # of the square around the origin in which ends of beams are noted
POSES = 9  # along one sweep, interpolated between


@dataclass(frozen=True, slots=True)
class CellTruth:
    """Truth per cell of a window, all (size, size), [j, i] from its corner on."""

    obstacle: Bools  # something of 0.10 m or more in it
    danger: F64  # share of it that is 0.15 m or more above or below the floor, 0..1
    wall_m: F64  # distance of its centre from the nearest obstacle sample, 0: in one; at most 1 m
    low_m: F64  # lowest and highest surface in it
    high_m: F64
    floor_m: F64  # mean height of the floor in it, NaN where there is none


class Truth:
    """The world's heights at one instant, sampled over the part that a run comes to see."""

    def __init__(
        self, world: Any, x_m: Span, y_m: Span, floors_m: Sequence[Span] = ((0.0, 0.0),)
    ) -> None:
        """floors_m: places on floor (x, y), by which floor is known."""
        self._x0, self._y0 = x_m[0], y_m[0]
        self._x = np.arange(x_m[0] + SAMPLE_M / 2, x_m[1], SAMPLE_M)
        self._y = np.arange(y_m[0] + SAMPLE_M / 2, y_m[1], SAMPLE_M)
        x, y = np.meshgrid(self._x, self._y)
        self.heights = world.height_at(x.ravel(), y.ravel()).reshape(x.shape)
        begins = [(int((y - y_m[0]) / SAMPLE_M), int((x - x_m[0]) / SAMPLE_M)) for x, y in floors_m]
        self.floor = floor_of(self.heights, begins, BOUND_M)
        self.danger = ~floor_of(self.heights, begins, DANGER_M)
        self.obstacle = ~self.floor | edges_of(self.heights, BOUND_M)

    def cells(self, corner_i: int, corner_j: int, size: int, cell_m: float) -> CellTruth:
        """Truth of the cells of a window; beyond what was sampled all is obstacle and no danger."""
        per = max(1, round(cell_m / SAMPLE_M))
        columns = self._indices(self._x, self._x0, corner_i, size, cell_m, per)
        rows = self._indices(self._y, self._y0, corner_j, size, cell_m, per)
        beyond = (rows < 0)[:, None] | (columns < 0)[None, :]
        at = np.ix_(rows, columns)

        def tiles(layer: npt.NDArray[Any], blank: float) -> F64:
            values = np.where(beyond, blank, layer[at].astype(np.float64))
            return values.reshape(size, per, size, per).swapaxes(1, 2).reshape(size, size, -1)

        heights, floor = tiles(self.heights, np.nan), tiles(self.floor, 0.0) > 0
        known = np.where(np.isnan(heights), -9.0, heights)
        count = floor.sum(-1)
        total = np.where(floor, known, 0.0).sum(-1)
        mean = np.divide(total, count, out=np.full(total.shape, np.nan), where=count > 0)
        obstacle = np.asarray(tiles(self.obstacle, 1.0).max(axis=-1) > 0)
        return CellTruth(
            obstacle,
            tiles(self.danger, 0.0).mean(-1),
            _distance_m(obstacle, cell_m),
            known.min(-1),
            known.max(-1),
            mean,
        )

    def _indices(
        self, places: F64, begin: float, corner: int, size: int, cell_m: float, per: int
    ) -> npt.NDArray[np.int64]:
        """Nearest samples of `per` places in each cell; -1 beyond."""
        wanted = (corner + (np.arange(size * per) + 0.5) / per) * cell_m
        index = np.floor((wanted - begin) / SAMPLE_M + 1e-9).astype(np.int64)
        return np.where((index >= 0) & (index < len(places)), index, -1)


def grown(mask: Bools, cells: int) -> Bools:
    """The mask and all within so many cells of it, diagonally too."""
    wide = np.pad(mask, cells)
    out = np.zeros_like(mask)
    rows, columns = mask.shape
    for dj in range(2 * cells + 1):
        for di in range(2 * cells + 1):
            out |= wide[dj : dj + rows, di : di + columns]
    return out


def _distance_m(mask: Bools, cell_m: float) -> F64:
    """From the centre of each cell to the centre of the nearest one in the mask, at most 1 m."""
    reach = round(1.0 / cell_m)
    wide = np.pad(mask, reach)
    out = np.full(mask.shape, 1.0)
    rows, columns = mask.shape
    for dj in range(-reach, reach + 1):
        for di in range(-reach, reach + 1):
            away_m = cell_m * float(np.hypot(di, dj))
            if away_m < 1.0:
                part = wide[reach + dj : reach + dj + rows, reach + di : reach + di + columns]
                np.minimum(out, np.where(part, away_m, 1.0), out=out)
    return out


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
