"""Lines for areas that a path leaves out. Areas are (n, 2) centres of raster cells."""

import numpy as np
import shapely
from shapely import Polygon

from core.paths.geometry.rings import Walls
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
