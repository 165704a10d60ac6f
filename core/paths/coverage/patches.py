"""Lines and detours for areas that a path leaves out. Areas are (n, 2) centres of raster cells."""

import numpy as np
import shapely
from shapely import Polygon

from core.paths.geometry.rings import Walls
from core.paths.geometry.visibility import VisibilityGraph
from core.records import F64


def nearest_in(space: Polygon, points: F64) -> F64:
    """(n, 2): for each point the nearest one at which the machine's centre may be."""
    lines = shapely.shortest_line(shapely.points(points), space)
    return np.asarray(shapely.get_coordinates(lines).reshape(-1, 2, 2)[:, 1])


def wall_strokes(area: F64, walls: Walls, space: Polygon, width_m: float) -> list[F64]:
    """Lines along walls, (n, 2) each, from which the tool gets at an area beside walls."""
    some = area[:: max(1, len(area) // 200)]
    near = nearest_in(space, some)
    is_outside = np.hypot(*(near - some).T) > 1e-6
    places: dict[int, list[float]] = {}
    for point in near[is_outside]:
        ring, at_m = walls.on(point)
        if ring >= 0:
            places.setdefault(ring, []).append(at_m)
    strokes = []
    for number, found in places.items():
        ring_m = walls.rings[number].length_m
        for start_m, end_m in _stretches(np.sort(found), ring_m, width_m):
            if end_m - start_m > 1e-3:
                strokes.append(walls.rings[number].ahead(start_m, end_m - start_m))
    return strokes


def _stretches(places: F64, around_m: float, gap_m: float) -> list[tuple[float, float]]:
    """Places on a ring, in order, as stretches without longer gaps."""
    gaps = np.diff(np.append(places, places[0] + around_m))
    breaks = np.flatnonzero(gaps > gap_m)
    if len(breaks) == 0:
        return [(float(places[0]), float(places[0] + around_m))]
    starts = places[(breaks + 1) % len(places)]
    ends = np.roll(places[breaks], -1)
    pairs = zip(starts.tolist(), ends.tolist(), strict=True)
    return [(a, b if b >= a else b + around_m) for a, b in pairs]


def stations(area: F64, space: Polygon, width_m: float) -> F64:
    """(n, 2) points in a row, of the machine's centre, from which the tool gets at an area."""
    middle = area.mean(axis=0)
    off = area - middle
    if np.ptp(off, axis=0).max() < width_m:
        return nearest_in(space, middle[None])
    _, axes = np.linalg.eigh(off.T @ off)
    along = off @ axes[:, -1]
    low, high = along.min() + width_m / 4, along.max() - width_m / 4
    count = max(2, int(np.ceil((high - low) / (0.7 * width_m))) + 1)
    wanted = np.linspace(low, high, count)
    slices = [area[np.abs(along - at) <= max(width_m / 4, 1e-9)] for at in wanted]
    return nearest_in(space, np.array([s.mean(axis=0) for s in slices if len(s)]))


def detours(
    path: F64, stops: F64, graph: VisibilityGraph, reach_m: float, tries: int
) -> tuple[float, int, F64] | None:
    """The cheapest way from a path (n, 2) over stops (m, 2) and back to it, of the likely ones.

    Returns: metres more, the corner behind which it leaves, its points with those of leaving and
    coming back; None: none of those tried lies inside.
    """
    a, way = path[:-1], np.diff(path, axis=0)
    length = np.hypot(*way.T)
    unit = way / np.maximum(length, 1e-12)[:, None]
    found: list[tuple[float, int, F64]] = []
    inner = float(np.hypot(*np.diff(stops, axis=0).T).sum())
    for row in (stops, stops[::-1]):
        at_m = np.clip(((row[0] - a) * unit).sum(axis=1), 0.0, length)
        for shift_from, shift_to in ((0.0, 0.0), (0.0, reach_m), (-reach_m, 0.0)):
            leave = np.clip(at_m + shift_from, 0.0, length)
            back = np.clip(at_m + shift_to, 0.0, length)
            p, q = a + leave[:, None] * unit, a + back[:, None] * unit
            cost = np.hypot(*(row[0] - p).T) + np.hypot(*(q - row[-1]).T) - (back - leave)
            for k in np.argsort(cost)[:tries]:
                found.append((float(cost[k]) + inner, int(k), np.vstack([p[k], row, q[k]])))
    found.sort(key=lambda each: each[0])
    for cost_m, edge, points in found:
        if graph.sees(points[:-1], points[1:]).all():
            return cost_m, edge, points
    return _round_corners(path, stops, graph)


def _round_corners(path: F64, stops: F64, graph: VisibilityGraph) -> tuple[float, int, F64] | None:
    """From the nearest corner of the path and back to it, by shortest ways."""
    k = int(np.argmin(np.hypot(*(path[:-1] - stops[0]).T)))
    legs = [graph.way(a, b) for a, b in zip([path[k], *stops], [*stops, path[k]], strict=True)]
    found = [leg for leg in legs if leg is not None]
    if len(found) < len(legs):
        return None
    points = np.vstack([found[0], *(leg[1:] for leg in found[1:])])
    return float(np.hypot(*np.diff(points, axis=0).T).sum()), k, points
