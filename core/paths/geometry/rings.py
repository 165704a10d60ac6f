"""Ways along the rings of a polygon: what a machine drives that follows a wall."""

from collections.abc import Sequence

import numpy as np
import shapely
from shapely import Polygon

from core.records import F64


class Ring:
    """A closed line, by the length along it."""

    def __init__(self, points: F64) -> None:
        """(n, 2), the first point again at the end."""
        self.points = points
        steps = np.hypot(*np.diff(points, axis=0).T)
        self.at_m = np.concatenate([[0.0], np.cumsum(steps)])
        self.length_m = float(self.at_m[-1])

    def place(self, point: F64) -> tuple[float, float]:
        """Where along the ring the nearest point is, and how far away, in metres."""
        starts, ways = self.points[:-1], np.diff(self.points, axis=0)
        squared = np.maximum((ways**2).sum(axis=1), 1e-300)
        share = np.clip(((point - starts) * ways).sum(axis=1) / squared, 0.0, 1.0)
        far = np.hypot(*(starts + share[:, None] * ways - point).T)
        k = int(np.argmin(far))
        return float(self.at_m[k] + share[k] * (self.at_m[k + 1] - self.at_m[k])), float(far[k])

    def between(self, start_m: float, end_m: float) -> F64:
        """(n, 2) the shorter way round from one place to another."""
        ahead = (end_m - start_m) % self.length_m
        if ahead > self.length_m / 2:
            return self.ahead(end_m, self.length_m - ahead)[::-1]
        return self.ahead(start_m, ahead)

    def gap(self, start_m: float, end_m: float) -> float:
        """The length of that way."""
        ahead = (end_m - start_m) % self.length_m
        return min(ahead, self.length_m - ahead)

    def ahead(self, start_m: float, way_m: float) -> F64:
        at_m = np.concatenate([self.at_m[:-1], self.at_m + self.length_m])
        corners = np.vstack([self.points[:-1], self.points])
        inner = (at_m > start_m + 1e-9) & (at_m < start_m + way_m - 1e-9)
        ends = [
            [np.interp(place, at_m, corners[:, axis]) for axis in (0, 1)]
            for place in (start_m, start_m + way_m)
        ]
        return np.vstack([ends[:1], corners[inner], ends[1:]])


class Walls:
    """All rings of a polygon."""

    NEAR_M = 1e-3  # a point that is nearer lies on a ring

    def __init__(self, polygon: Polygon) -> None:
        lines = [polygon.exterior, *polygon.interiors]
        self.rings = [Ring(shapely.get_coordinates(line)) for line in lines]
        self._tree = shapely.STRtree(lines)
        self._kept: dict[tuple[float, float], tuple[int, float]] = {}

    def on(self, point: F64) -> tuple[int, float]:
        """Which ring, and where on it; -1: none."""
        key = (float(point[0]), float(point[1]))
        if key not in self._kept:
            found = self._tree.query_nearest(shapely.Point(*key), max_distance=self.NEAR_M)
            self._kept[key] = (-1, 0.0)
            if len(found):
                number = int(found[0])
                self._kept[key] = (number, self.rings[number].place(point)[0])
        return self._kept[key]

    def between(self, start: F64, end: F64, most_m: float) -> F64 | None:
        """(n, 2) along the wall that both points lie on; None: none, or longer than that."""
        ring, start_m = self.on(start)
        other, end_m = self.on(end)
        if ring < 0 or ring != other or self.rings[ring].gap(start_m, end_m) > most_m:
            return None
        way = self.rings[ring].between(start_m, end_m)
        way[0], way[-1] = start, end
        return way


def joined(pieces: Sequence[F64]) -> F64:
    """(n, 2) one line of several; points that repeat are left out."""
    points = np.vstack(pieces)
    is_new = np.ones(len(points), dtype=bool)
    is_new[1:] = np.hypot(*np.diff(points, axis=0).T) > 1e-9
    return points[is_new]


def length_of(points: F64) -> float:
    return float(np.hypot(*np.diff(points, axis=0).T).sum())
