"""Shortest ways within a polygon: a visibility graph over the corners that a way can bend at.

A shortest way bends only at corners where the polygon bulges inwards, and touches them there. So
only such corners are nodes, and only lines that touch at their ends are tried.
Source: Lozano-Perez and Wesley, Collision-free paths among polyhedral obstacles, 1979.
"""

import heapq
import math

import numpy as np
import numpy.typing as npt
import shapely
from shapely import MultiPolygon, Polygon

from core.paths.geometry.sight_kernels import I64, WallEdges, lines_of_sight, shorten_all
from core.paths.geometry.space import polygons_in
from core.records import F64

MOST_STRIPS = 200
NO_EDGES = (np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0))
COARSE_M = 0.004  # ways between pieces bend at corners that are so far off, which are fewer
TOUCH_M = 1e-6  # what a line along an edge may seem to lie outside, by rounding
Bools = npt.NDArray[np.bool_]


def bends_of(polygons: Polygon | MultiPolygon) -> tuple[F64, F64, F64]:
    """Corners that bulge inwards, those before them, and those behind them; (n, 2) each."""
    here, before, behind = [], [], []
    parts = polygons.geoms if isinstance(polygons, MultiPolygon) else [polygons]
    rings = [(part.exterior, True) for part in parts]
    rings += [(hole, False) for part in parts for hole in part.interiors]
    for ring, is_outer in rings:
        points = shapely.get_coordinates(ring)[:-1]
        if ring.is_ccw != is_outer:
            points = points[::-1]  # so that the polygon lies to the left
        prior, after = np.roll(points, 1, axis=0), np.roll(points, -1, axis=0)
        is_bend = cross(points - prior, after - points) < 0
        here.append(points[is_bend])
        before.append(prior[is_bend])
        behind.append(after[is_bend])
    return np.vstack(here), np.vstack(before), np.vstack(behind)


def cross(a: F64, b: F64) -> F64:
    """Of (..., 2) and (..., 2)."""
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def wall_edges(polygon: Polygon) -> WallEdges:
    """Edges a hair outside the polygon: what leaves it crosses one, what touches it none."""
    loose = polygon.buffer(TOUCH_M, quad_segs=1)
    rings = [shapely.get_coordinates(ring) for ring in [loose.exterior, *loose.interiors]]
    edges = np.vstack([np.hstack([ring[:-1], ring[1:]]) for ring in rings])
    y = np.sort(edges[:, [1, 3]], axis=1)
    low_m, strips = float(y[:, 0].min()), min(len(edges), MOST_STRIPS)
    strip_m = (float(y[:, 1].max()) - low_m) / strips
    at = np.clip(((y - low_m) / strip_m).astype(np.int64), 0, strips - 1)
    counts = at[:, 1] - at[:, 0] + 1
    number = np.repeat(np.arange(len(edges)), counts)
    strip = np.repeat(at[:, 0] - np.cumsum(counts) + counts, counts) + np.arange(counts.sum())
    order = np.argsort(strip, kind="stable")
    first = np.searchsorted(strip[order], np.arange(strips + 1)).astype(np.int64)
    return WallEdges(np.ascontiguousarray(edges[number[order]]), first, low_m, strip_m)


class VisibilityGraph:
    """Ways between any two points of a polygon. Rows of the graph are made when asked for."""

    def __init__(self, polygon: Polygon, bends: MultiPolygon | None = None) -> None:
        """`bends`: polygons inside, of fewer corners, at which ways may bend instead."""
        self.polygon = polygon
        self.walls = wall_edges(polygon)
        self._bends = bends
        self.nodes, before, behind = bends_of(polygon if bends is None else bends)
        self._before, self._behind = before - self.nodes, behind - self.nodes
        self._fine: VisibilityGraph | None = None
        self._rows: dict[int, list[tuple[int, float]]] = {}

    def sees(self, starts: F64, ends: F64) -> Bools:
        """(n,) whether the line between two points of the polygon, (n, 2) each, lies within it."""
        lines = np.concatenate([starts, ends], axis=1)
        seen = np.empty(len(lines), dtype=np.bool_)
        lines_of_sight(self.walls, lines, seen)
        return seen

    def touched_from(self, point: F64) -> npt.NDArray[np.intp]:
        """Nodes that a line from this point would touch, and not run into."""
        if self._bends is not None:
            line = shapely.shortest_line(shapely.Point(point), self._bends)
            point = shapely.get_coordinates(line)[1]
        way = self.nodes - point
        return np.flatnonzero(cross(way, self._before) * cross(way, self._behind) >= -1e-12)

    def seen_from(self, point: F64) -> list[tuple[int, float]]:
        """Nodes in sight of a point at which a way may go on, and how far they are."""
        maybe = self.touched_from(point)
        if len(maybe) == 0:
            return []
        ends = self.nodes[maybe]
        return self._those_seen(point, maybe, ends)

    def _those_seen(
        self, point: F64, maybe: npt.NDArray[np.intp], ends: F64
    ) -> list[tuple[int, float]]:
        seen = self.sees(np.broadcast_to(point, ends.shape), ends)
        far = np.hypot(*(ends - point).T)
        return list(zip(maybe[seen].tolist(), far[seen].tolist(), strict=True))

    def _row(self, node: int) -> list[tuple[int, float]]:
        if node not in self._rows:
            here = self.nodes[node]
            maybe = self.touched_from(here)
            way = self.nodes[maybe] - here
            touches = cross(way, self._before[node]) * cross(way, self._behind[node]) >= -1e-12
            maybe = maybe[touches & (maybe != node)]
            self._rows[node] = self._those_seen(here, maybe, self.nodes[maybe])
        return self._rows[node]

    def way(self, start: F64, goal: F64) -> F64 | None:
        """(n, 2) the shortest way, both ends with it; None where there is none.

        Ends must lie in the polygon. Where `bends` lets nothing through, all corners are tried.
        """
        if self.sees(start[None], goal[None])[0]:
            return np.vstack([start, goal])
        found = self._way_by_nodes(start, goal)
        if found is None and self._bends is not None:
            self._fine = self._fine or VisibilityGraph(self.polygon)
            return self._fine.way(start, goal)
        return found

    def _way_by_nodes(self, start: F64, goal: F64) -> F64 | None:
        """A* by the straight distance, which is never too long."""
        last = dict(self.seen_from(goal))
        to_go = np.hypot(*(self.nodes - goal).T)
        best = dict(self.seen_from(start))
        came_from: dict[int, int] = {}
        done: set[int] = set()
        heap = [(far + to_go[node], node) for node, far in best.items()]
        heapq.heapify(heap)
        shortest, via = math.inf, -1
        while heap:
            bound, node = heapq.heappop(heap)
            if bound >= shortest:
                break
            if node in done:
                continue
            done.add(node)
            if node in last and best[node] + last[node] < shortest:
                shortest, via = best[node] + last[node], node
            for other, far in self._row(node):
                if best[node] + far < best.get(other, math.inf):
                    best[other], came_from[other] = best[node] + far, node
                    heapq.heappush(heap, (best[other] + to_go[other], other))
        if via < 0:
            return None
        nodes = [via]
        while nodes[-1] in came_from:
            nodes.append(came_from[nodes[-1]])
        return np.vstack([start, self.nodes[nodes[::-1]], goal])

    def distances(self, points: F64, nearest: int) -> F64:
        """(n, n) lengths of ways between points; each is joined to its nearest nodes only.

        So a length may be a little too long, and is infinite where no node is in sight.
        """
        count = len(self.nodes)
        edges, room = self._edges(), (np.zeros(count, np.int64), np.zeros(count, np.bool_))
        joined = np.full((len(points), count), math.inf)
        for k, point in enumerate(points):
            maybe = self.touched_from(point)
            far = np.hypot(*(self.nodes[maybe] - point).T)
            maybe = maybe[np.argsort(far, kind="stable")[:nearest]]
            for node, length in self._those_seen(point, maybe, self.nodes[maybe]):
                joined[k, node] = length
        total = np.full((len(points), len(points)), math.inf)
        for k in range(len(points)):
            to_nodes = joined[k].copy()
            shorten_all(*edges, to_nodes, *room)
            total[k] = (to_nodes + joined).min(axis=1, initial=math.inf)
        return np.asarray(np.minimum(total, total.T))

    def _edges(self) -> tuple[I64, I64, F64]:
        """Between nodes, in both directions, as `shorten_all` takes them."""
        count = len(self.nodes)
        rows = [(a, b, far) for a in range(count) for b, far in self._row(a)]
        a, b, far = (np.array(column) for column in zip(*rows, strict=True)) if rows else NO_EDGES
        begin, end = np.concatenate([a, b]).astype(np.int64), np.concatenate([b, a])
        order = np.argsort(begin, kind="stable")
        first = np.searchsorted(begin[order], np.arange(count + 1)).astype(np.int64)
        return first, end[order].astype(np.int64), np.concatenate([far, far])[order]


def graph_of(space: Polygon) -> VisibilityGraph:
    """For ways between pieces: few corners. Where these join less than the space, all are tried."""
    inner = shapely.buffer(space, -COARSE_M, quad_segs=2, join_style="mitre")
    bends = MultiPolygon(polygons_in(shapely.simplify(inner, COARSE_M)))
    if not bends.is_empty and space.covers(bends):
        return VisibilityGraph(space, bends)
    return VisibilityGraph(space)
