"""The distance field of one object: what many frames together say of where its sides are.

Each cell has the mean of the signed distances to the sides that frames saw, cut off at a band, and
for how many frames it stands. The surface is where the mean is zero. With noise of a frame's place
that is as often to one side as to the other, that is the mean surface, and it does not grow.
What contradicts the mean by more than two sigma of the pose drains the frames that stand for it,
until the cell begins anew: noise does that now and then, a change in every frame.

Source: Curless and Levoy, A volumetric method for building complex models from range images, 1996.
"""

import math

import numpy as np
import shapely
from numpy.typing import NDArray

from core.objects.records import Floats
from core.objects.vector_map.seen import pieces_of, sees
from core.objects.vector_map.settings import ObjectMapSettings
from jit import kernel, releasing_kernel

Cells = NDArray[np.float32]
Winding = NDArray[np.int8]
Flags = NDArray[np.bool_]
FAR = 1e9
NONE = np.zeros((0, 5))


@releasing_kernel
def _nearest(pieces: Floats, x0: float, y0: float, cell: float, band: float, near: Cells) -> None:
    """Distances (3, ny, nx) to the nearest piece: [0] of all of them, [1] of those seen.

    [2] of those seen before which the cell lies: behind a seen side's end, a hidden one may go on.
    """
    ny, nx = near.shape[1], near.shape[2]
    for k in range(pieces.shape[0]):
        ax, ay, bx, by = pieces[k, 0] - x0, pieces[k, 1] - y0, pieces[k, 2] - x0, pieces[k, 3] - y0
        dx, dy = bx - ax, by - ay
        square = dx * dx + dy * dy
        i_first = max(0, math.floor((min(ax, bx) - band) / cell))
        i_last = min(nx - 1, math.ceil((max(ax, bx) + band) / cell))
        j_first = max(0, math.floor((min(ay, by) - band) / cell))
        j_last = min(ny - 1, math.ceil((max(ay, by) + band) / cell))
        for j in range(j_first, j_last + 1):
            for i in range(i_first, i_last + 1):
                x, y = i * cell - ax, j * cell - ay
                share = (x * dx + y * dy) / square if square > 0.0 else 0.0
                is_before = 0.0 <= share <= 1.0 and dx * y - dy * x <= 0.0
                share = min(1.0, max(0.0, share))
                distance = math.hypot(x - share * dx, y - share * dy)
                if distance < near[0, j, i]:
                    near[0, j, i] = distance
                if pieces[k, 4] > 0.0 and distance < near[1, j, i]:
                    near[1, j, i] = distance
                if pieces[k, 4] > 0.0 and is_before and distance < near[2, j, i]:
                    near[2, j, i] = distance


@releasing_kernel
def _wind(pieces: Floats, x0: float, y0: float, cell: float, around: Winding) -> None:
    """Fills (ny, nx): how often the closed lines of the pieces run around each cell."""
    ny, nx = around.shape
    for j in range(ny):
        for i in range(nx):
            around[j, i] = 0
    for k in range(pieces.shape[0]):
        ax, ay, bx, by = pieces[k, 0] - x0, pieces[k, 1] - y0, pieces[k, 2] - x0, pieces[k, 3] - y0
        turn = 1 if by > ay else -1
        low, high = min(ay, by), max(ay, by)
        j_first, j_last = max(0, math.ceil(low / cell)), math.ceil(high / cell)
        for j in range(j_first, min(ny, j_last)):
            x = ax + (j * cell - ay) / (by - ay) * (bx - ax)
            i = max(0, math.ceil(x / cell))
            if i < nx:
                around[j, i] -= turn
    for j in range(ny):
        total = 0
        for i in range(nx):
            total += around[j, i]
            around[j, i] = total


@releasing_kernel
def _vote(
    mean: Cells,
    weight: Cells,
    near: Cells,
    around: Winding,
    other: Winding,
    sectors: Floats,
    lens: tuple[float, float],
    cell: float,
    band: float,
    confirm: float,
    most: float,
    drain: float,
    gate: float,
) -> int:
    """One frame's say on each cell; how many went in or out by it. `lens` is from cell (0, 0)."""
    turned = 0
    for j in range(mean.shape[0]):
        for i in range(mean.shape[1]):
            if other[j, i] > 0:
                continue  # another thing's place
            if around[j, i] > 0:
                value = -min(near[1, j, i], band)
            elif near[2, j, i] <= near[0, j, i] and near[2, j, i] < band:
                value = near[2, j, i]
            elif sees(sectors, i * cell - lens[0], j * cell - lens[1]):
                value = min(near[0, j, i], band)
            else:
                if near[0, j, i] < band and weight[j, i] < 0.5 * most:
                    weight[j, i] *= 1.0 - 1.0 / confirm  # at a hidden side: rarely in a hull
                continue
            was = mean[j, i] < 0.0 and weight[j, i] >= confirm
            if weight[j, i] >= 1.0 and abs(value - mean[j, i]) > gate:
                weight[j, i] -= drain  # it was another thing's say, or things have changed
                if weight[j, i] < 1.0:
                    weight[j, i], mean[j, i] = 1.0, value
            else:
                weight[j, i] = min(most, weight[j, i] + 1.0)
                mean[j, i] += (value - mean[j, i]) / max(1.0, weight[j, i])
            if was != (mean[j, i] < 0.0 and weight[j, i] >= confirm):
                turned += 1
    return turned


@kernel
def _take(
    mean: Cells, weight: Cells, other_mean: Cells, other_weight: Cells, right: int, up: int
) -> None:
    """Takes over the cells of another field that it knows better; they lie that far from here."""
    for j in range(other_mean.shape[0]):
        for i in range(other_mean.shape[1]):
            if other_weight[j, i] > weight[j + up, i + right]:
                weight[j + up, i + right] = other_weight[j, i]
                mean[j + up, i + right] = other_mean[j, i]


@kernel
def _is_free_before(
    ax: float, ay: float, bx: float, by: float, mean: Cells, weight: Cells, confirm: float
) -> bool:
    """Whether all cells before a side are known to be free, but for those at its ends.

    Its corners are in cells. A sharp one may lie beyond all cells.
    """
    length = math.hypot(bx - ax, by - ay)
    if length <= 2.0:
        return True  # as good as a corner
    ux, uy = (bx - ax) / length, (by - ay) / length
    for k in range(1, math.ceil(length - 0.5)):
        i, j = round(ax + k * ux + uy), round(ay + k * uy - ux)
        if not (0 <= i < mean.shape[1] and 0 <= j < mean.shape[0]):
            return False
        if weight[j, i] < confirm or mean[j, i] <= 0.0:
            return False
    return True


@releasing_kernel
def _find_finished(
    corners: Floats, mean: Cells, weight: Cells, confirm: float, finished: Flags
) -> None:
    """Which sides of an outline (n, 2), in cells, have free space before them: (n,)."""
    n = corners.shape[0]
    for k in range(n):
        (ax, ay), (bx, by) = corners[k], corners[(k + 1) % n]
        finished[k] = _is_free_before(ax, ay, bx, by, mean, weight, confirm)


class DistanceField:
    """Cells around one object; `place` is where cell (0, 0) lies in the map, m."""

    def __init__(self, settings: ObjectMapSettings) -> None:
        self._s = settings
        self.place = np.zeros(2)
        self.mean = np.zeros((0, 0), dtype=np.float32)
        self.weight = np.zeros((0, 0), dtype=np.float32)

    def reach(self, low: Floats, high: Floats) -> None:
        """Grow so that the box between two points (2,) m, and a band around it, has cells."""
        cell, pad = self._s.cell_m, self._s.band_m + 2 * self._s.cell_m
        if self.mean.size == 0:
            self.place = np.floor((low - pad) / cell) * cell
        first = np.minimum(0, np.floor((low - pad - self.place) / cell)).astype(np.int64)
        size = np.array(self.mean.shape[::-1])
        last = np.maximum(size, np.ceil((high + pad - self.place) / cell).astype(np.int64) + 1)
        if (first == 0).all() and (last == size).all():
            return
        left, below = -first
        shape = (int(last[1] - first[1]), int(last[0] - first[0]))
        mean = np.full(shape, self._s.band_m, dtype=np.float32)
        weight = np.zeros(shape, dtype=np.float32)
        rows, columns = slice(below, below + size[1]), slice(left, left + size[0])
        mean[rows, columns], weight[rows, columns] = self.mean, self.weight
        self.mean, self.weight, self.place = mean, weight, self.place + first * cell

    def vote(
        self, pieces: Floats, others: Floats, sectors: Floats, lens: tuple[float, float]
    ) -> int:
        """Add one frame; how many cells went in or out of the object by it.

        Args:
            pieces: (k, 5) of closed hulls that are this object, marked where they were seen.
            others: (k, 5) of closed lines around places of which this frame says nothing.
            sectors: what was seen through, from the lens.
        """
        s, (x0, y0) = self._s, self.place
        near = np.full((3, *self.mean.shape), FAR, dtype=np.float32)
        around = np.zeros(self.mean.shape, dtype=np.int8)
        other = np.zeros_like(around)
        _nearest(pieces, x0, y0, s.cell_m, s.band_m, near)
        _wind(pieces, x0, y0, s.cell_m, around)
        if len(others):
            _wind(others, x0, y0, s.cell_m, other)
        return _vote(
            *(self.mean, self.weight, near, around, other, sectors),
            (lens[0] - x0, lens[1] - y0),
            *(s.cell_m, s.band_m, float(s.confirm_frames), float(s.memory_frames)),
            *(s.drain, s.contradiction_m),
        )

    def believe(self, pieces: Floats) -> None:
        """Start from a polygon that is known: as if pieces (k, 5) had been seen all along."""
        self.vote(pieces, NONE, NONE, (0.0, 0.0))
        self.weight[self.weight > 0.0] = self._s.memory_frames

    def give_away(self, pieces: Floats) -> None:
        """What lies within a closed line of pieces (k, 5) is another object's from now on.

        It is known not to be of this one: what is unknown between its parts would be filled.
        """
        around = np.zeros(self.mean.shape, dtype=np.int8)
        _wind(pieces, self.place[0], self.place[1], self._s.cell_m, around)
        self.weight[around > 0] = self._s.confirm_frames
        self.mean[around > 0] = self._s.band_m

    def take(self, other: "DistanceField") -> None:
        """Take over what another field knows better; places are rounded to cells."""
        cell = self._s.cell_m
        self.reach(other.place, other.place + cell * np.array(other.mean.shape[::-1]))
        right, up = np.rint((other.place - self.place) / cell).astype(np.int64)
        _take(self.mean, self.weight, other.mean, other.weight, int(right), int(up))

    def finished(self, outline: Floats) -> Flags:
        """Which sides of an outline (n, 2) m were seen along their whole length: (n,)."""
        found = np.zeros(len(outline), dtype=bool)
        corners = np.ascontiguousarray((outline - self.place) / self._s.cell_m)
        _find_finished(corners, self.mean, self.weight, float(self._s.confirm_frames), found)
        return found

    def values(self) -> Floats:
        """What is drawn around (ny, nx): below 0 inside.

        What nobody has seen is inside where it lies between parts that are: things are solid until
        somebody sees through a gap.
        """
        cell = self._s.cell_m
        known = self.weight >= self._s.confirm_frames
        values = np.where(known, np.clip(self.mean, -cell, cell), cell).astype(np.float64)
        inside = np.argwhere(values < 0.0)[:, ::-1]
        if len(inside) > 2:
            hull = shapely.MultiPoint(inside).convex_hull
            if hull.geom_type == "Polygon":
                around = np.zeros(values.shape, dtype=np.int8)
                corners = shapely.get_coordinates(shapely.orient_polygons(hull))[:-1]
                _wind(pieces_of(corners, FAR), 0.0, 0.0, 1.0, around)
                values[(around > 0) & ~known] = -cell
        return values
