"""From a field of signed distances to polygons: level line, fewer corners, sharp corners."""

import math
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from core.objects.records import Floats
from jit import allocating_kernel

Ids = NDArray[np.int64]
ROUNDED = 2.5  # cells: how far noise and the field round a corner
ROUND_END = 0.7  # cells: so near its ends a side is not straight
LEAST_TURN = 0.3  # sine of the angle from which two sides have a corner
# For each square of four cells, by which are inside (1: lower left, 2: lower right, 4: upper right,
# 8: upper left): its sides (0 below, 1 right, 2 above, 3 left) where the line comes in and
# goes out with the inside on its left. Two pairs where opposite cells are inside: kept apart.
LINES = (
    *((-1, -1, -1, -1), (0, 3, -1, -1), (1, 0, -1, -1), (1, 3, -1, -1)),
    *((2, 1, -1, -1), (0, 3, 2, 1), (2, 0, -1, -1), (2, 3, -1, -1)),
    *((3, 2, -1, -1), (0, 2, -1, -1), (1, 0, 3, 2), (1, 2, -1, -1)),
    *((3, 1, -1, -1), (0, 1, -1, -1), (3, 0, -1, -1), (-1, -1, -1, -1)),
)


@allocating_kernel
def _steps(v: Floats) -> tuple[Ids, Floats, int]:
    """Steps of the zero line: (n, 2) from and to which side, and where (n, 2) the first is."""
    ny, nx = v.shape
    steps = np.empty((2 * ny * nx, 2), dtype=np.int64)
    places = np.empty((2 * ny * nx, 2))
    n = 0
    for j in range(ny - 1):
        for i in range(nx - 1):
            case = 1 if v[j, i] < 0 else 0
            case += 2 if v[j, i + 1] < 0 else 0
            case += 4 if v[j + 1, i + 1] < 0 else 0
            case += 8 if v[j + 1, i] < 0 else 0
            for line in range(2):
                if LINES[case][2 * line] < 0:
                    break
                for end in range(2):
                    side = LINES[case][2 * line + end]
                    a, b = i + (1 if side == 1 else 0), j + (1 if side == 2 else 0)
                    upright = side == 1 or side == 3
                    steps[n, end] = 2 * (b * nx + a) + (1 if upright else 0)
                    if end == 0:
                        far = v[b + 1, a] if upright else v[b, a + 1]
                        share = v[b, a] / (v[b, a] - far)
                        places[n, 0] = a + (0.0 if upright else share)
                        places[n, 1] = b + (share if upright else 0.0)
                n += 1
    return steps, places, n


def rings_of(values: Floats) -> list[Floats]:
    """Lines (n, 2) around what is below 0, in cells; counter-clockwise, those of holes are not."""
    padded = np.full((values.shape[0] + 2, values.shape[1] + 2), np.abs(values).max(initial=1e-9))
    padded[1:-1, 1:-1] = values
    steps, places, n = _steps(padded)
    after = {int(a): (int(b), k) for k, (a, b) in enumerate(steps[:n].tolist())}
    rings = []
    while after:
        start, (here, k) = after.popitem()
        ring = [k]
        while here != start:
            here, k = after.pop(here)
            ring.append(k)
        rings.append(places[ring] - 1.0)
    return rings


def area_of(ring: Floats) -> float:
    """Signed area: positive where a ring (n, 2) runs counter-clockwise."""
    x, y = ring.T
    return float(0.5 * (x * np.roll(y, -1) - np.roll(x, -1) * y).sum())


def polygons_of(values: Floats, place: Floats, cell_m: float, least_m: float) -> list[Floats]:
    """Outlines (n, 2) m of all that is inside, largest first; holes are filled, specks left out.

    Args:
        values: (ny, nx) signed distances, m; below 0 inside.
        place: (2,) m, of cell (0, 0).
        least_m: the longer side of a box around an outline, at least.
    """
    found = []
    for ring in rings_of(values):
        area_m2 = cell_m * cell_m * area_of(ring)
        if area_m2 <= least_m * cell_m or np.ptp(ring, axis=0).max() * cell_m < least_m:
            continue
        outline = straightened(ring)
        if not shapely.Polygon(outline).is_valid:
            outline = np.asarray(shapely.Polygon(ring).simplify(0.5).exterior.coords)[:-1]
        found.append(place + cell_m * outline)
    return sorted(found, key=area_of, reverse=True)


def straightened(ring: Floats) -> Floats:
    """A polygon (n, 2) of few corners for a ring in cells: where fitted straight sides meet.

    Corners are first those of Douglas and Peucker at half a cell. A corner that the field has
    rounded, a short side between two long ones, is where those two meet.
    """
    middle = ring.mean(axis=0)
    ring = np.roll(ring, -int(np.argmax(np.hypot(*(ring - middle).T))), axis=0)  # a corner first
    simple = np.asarray(shapely.Polygon(ring).simplify(0.5).exterior.coords)[:-1]
    if len(simple) < 3:
        return ring
    at = np.hypot(*(ring[:, None] - simple).transpose(2, 0, 1)).argmin(axis=0)
    sides = [
        _Side.of(ring, a, b) for a, b in zip(at.tolist(), np.roll(at, -1).tolist(), strict=True)
    ]
    long = [
        side
        for k, side in enumerate(sides)
        if side.length_m > ROUNDED
        or min(sides[k - 1].length_m, sides[(k + 1) % len(sides)].length_m) < 1.5 * side.length_m
    ]
    if len(long) < 3:
        return simple
    return np.vstack([_corner(a, b) for a, b in zip(long, long[1:] + long[:1], strict=True)])


class _Side(NamedTuple):
    """A side of a ring: its ends, a point of its fitted line, and the line's direction; cells."""

    first: Floats
    last: Floats
    middle: Floats
    along: Floats
    length_m: float

    @classmethod
    def of(cls, ring: Floats, start: int, stop: int) -> "_Side":
        points = ring[np.arange(start, stop + 1 + (len(ring) if stop <= start else 0)) % len(ring)]
        first, last = points[0], points[-1]
        length = math.dist(first, last)
        along = (last - first) / max(length, 1e-9)
        inner = points[np.abs((points - first) @ along - 0.5 * length) < 0.5 * length - ROUND_END]
        if len(inner) < 3:
            return cls(first, last, 0.5 * (first + last), along, length)
        middle = inner.mean(axis=0)
        xx, xy, yy = _moments(inner - middle)
        angle = 0.5 * math.atan2(2.0 * xy, xx - yy)
        return cls(first, last, middle, np.array([math.cos(angle), math.sin(angle)]), length)


def _moments(off: Floats) -> tuple[float, float, float]:
    x, y = off.T
    return float((x * x).sum()), float((x * y).sum()), float((y * y).sum())


def _corner(a: _Side, b: _Side) -> Floats:
    """Where two sides meet (1, 2); their own ends (1 or 2), in turn, where that is not near."""
    ends = np.array([a.last] if (a.last == b.first).all() else [a.last, b.first])
    cross = float(a.along[0] * b.along[1] - a.along[1] * b.along[0])
    if abs(cross) < LEAST_TURN:
        return ends
    off = b.middle - a.middle
    meeting = a.middle + a.along * float(off[0] * b.along[1] - off[1] * b.along[0]) / cross
    return meeting[None] if np.hypot(*(ends - meeting).T).max() < ROUNDED else ends
