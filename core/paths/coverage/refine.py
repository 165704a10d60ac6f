"""Makes a path better by small changes: each must be worth its metres in swept area.

The price says how much: a change is kept if it wins more area than `price` x the metres that it
costs x the width of the band, or loses less than that for the metres that it saves. A lane in the
open wins 1.
"""

import math

import numpy as np

from core.paths.coverage.patches import stations
from core.paths.coverage.raster import NONE, Raster, edges_along
from core.paths.coverage.refine_kernels import cheapest_detour, relocate, shift, shorten, uncross
from core.paths.geometry.rings import joined, length_of
from core.paths.geometry.visibility import VisibilityGraph
from core.records import F64

ROUNDS, DEAR = 2, 0.1  # of all changes at each price, and at the end; at higher prices one
MORE = 1.2  # a detour may win a little more than what it is made for


class Refiner:
    """The corners of a path, (n, 2), and the raster that counts its edges."""

    def __init__(self, points: F64, raster: Raster, graph: VisibilityGraph, width_m: float) -> None:
        self.points, self._raster, self._graph, self._width_m = points, raster, graph, width_m
        raster.gain(NONE, edges_along(points), keep=True)

    def on(self, raster: Raster) -> "Refiner":
        """The same path on another raster."""
        return Refiner(self.points, raster, self._graph, self._width_m)

    def tighten(self, price: float, is_last: bool = False) -> None:
        """Leave out corners, move them, turn stretches round."""
        path, n = self.points.copy(), len(self.points)
        raster, walls = self._raster, self._graph.walls
        given = raster.count, raster.is_target, raster.grid, walls, path
        for _ in range(ROUNDS if is_last or price <= DEAR else 1):
            n = shorten(*given, n, price * self._width_m)
            shift(*given, n, price * self._width_m)
            uncross(*given, n, price * self._width_m)
            relocate(*given, n, price * self._width_m, np.zeros(2, dtype=np.int64))
        n = shorten(*given, n, price * self._width_m)
        self.points = path[:n].copy()
        raster.swept = int((raster.is_target & (raster.count > 0)).sum())

    def trim(self, price: float, is_first: bool) -> None:
        """Leave out edges at the first or the last end, where the path may end anywhere."""
        while len(self.points) > 2:
            edge = edges_along(self.points[:2] if is_first else self.points[-2:])
            lost = self._raster.gain(edge, NONE)
            if self._raster.area(lost) + price * self._width_m * length_of(edge.reshape(2, 2)) <= 0:
                return
            self._raster.gain(edge, NONE, keep=True)
            self.points = self.points[1:] if is_first else self.points[:-1]

    def distance(self, point: F64) -> float:
        """Metres from the nearest corner."""
        return float(np.hypot(*(self.points - point).T).min())

    def patch(self, area: F64, price: float) -> None:
        """A detour to a missed area, (n, 2) centres of its cells, if it is worth it."""
        most_m = MORE * self._raster.area(len(area)) / (price * self._width_m)
        stops = stations(area, self._graph.polygon, self._width_m)
        new, k, cost_m = self._detour(stops, most_m)
        if k < 0:
            return
        got = self._raster.gain(edges_along(self.points[k : k + 2]), edges_along(new))
        if self._raster.area(got) > price * self._width_m * cost_m:
            self._put(k, new)

    def _detour(self, stops: F64, most_m: float) -> tuple[F64, int, float]:
        """Corners instead of an edge, the edge (-1: none), metres more."""
        row = self._route(stops)
        inner_m = length_of(row)
        best = np.array([most_m - inner_m, -1.0, 0.0, 0.0, 0.0, self._width_m / 2])
        if inner_m < most_m:
            cheapest_detour(self._graph.walls, self.points, len(self.points), row, best)
        if best[1] < 0:
            return self._round_corners(row, most_m)
        k = int(best[1])
        a, b = self.points[k : k + 2]
        unit = (b - a) / max(math.dist(a, b), 1e-12)
        row = row[::-1] if best[4] else row
        new = np.vstack([a, a + best[2] * unit, row, a + best[3] * unit, b])
        return new, k, float(best[0]) + inner_m

    def _route(self, stops: F64) -> F64:
        """Over all stops by shortest ways; what cannot be got to is left out."""
        row = [stops[:1]]
        for stop in stops[1:]:
            way = self._graph.way(row[-1][-1], stop)
            if way is not None:
                row.append(way[1:])
        return np.vstack(row)

    def _round_corners(self, row: F64, most_m: float) -> tuple[F64, int, float]:
        """From the edge that is nearest to the row, and back to it, by shortest ways."""
        a, step = self.points[:-1], np.diff(self.points, axis=0)
        squared = np.maximum((step**2).sum(axis=1), 1e-18)
        share = np.clip(((row[0] - a) * step).sum(axis=1) / squared, 0.0, 1.0)
        near = a + share[:, None] * step
        far = np.hypot(*(near - row[0]).T)
        k = int(np.argmin(far))
        if 2 * far[k] > most_m:
            return row, -1, math.inf
        there, back = self._graph.way(near[k], row[0]), self._graph.way(row[-1], near[k])
        if there is None or back is None:
            return row, -1, math.inf
        new = joined([there, row, back])
        return np.vstack([self.points[k], new, self.points[k + 1]]), k, length_of(new)

    def _put(self, k: int, new: F64) -> None:
        """Instead of the edge behind corner k these (n, 2), which begin and end as it does."""
        self._raster.gain(edges_along(self.points[k : k + 2]), edges_along(new), keep=True)
        self.points = np.vstack([self.points[:k], new, self.points[k + 2 :]])


def modes_of(points: F64, raster: Raster, width_m: float) -> list[bool]:
    """Of each edge of a path whether it must sweep: not where everything is swept besides.

    The longest edges come first; what is shorter than the tool's width is not worth switching it.
    """
    edges = edges_along(points)
    lengths = np.hypot(*np.diff(points, axis=0).T)
    sweeps = [True] * len(edges)
    for k in np.argsort(-lengths, kind="stable"):
        if raster.gain(edges[k : k + 1], NONE) == 0:
            raster.gain(edges[k : k + 1], NONE, keep=True)
            sweeps[k] = False
    begin = 0
    for k in range(1, len(edges) + 1):
        if k == len(edges) or sweeps[k] != sweeps[begin]:
            if not sweeps[begin] and lengths[begin:k].sum() < width_m:
                sweeps[begin:k] = [True] * (k - begin)
                raster.gain(NONE, edges[begin:k], keep=True)
            begin = k
    return sweeps
