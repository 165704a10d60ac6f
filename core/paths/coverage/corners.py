"""Fewer corners where an outline goes round what bulges into it, so that a path has fewer, too."""

import numpy as np
import shapely
from shapely import LinearRing, Polygon

from core.records import F64

LEAST = 4  # corners of a ring
FLAT = 1e-12  # of the sine's size: edges that run as near to parallel do not meet
INSIDE_M = 1e-6  # by which rounding may move a corner outwards


def with_few_corners(polygon: Polygon, off_m: float) -> Polygon:
    """The polygon without short edges of its reflex arcs; it lies within what was given.

    An edge between two reflex corners goes, and its neighbours are prolonged until they meet, if
    that is at most `off_m` away from the edge; the same again as long as there are any.
    """
    turned = shapely.orient_polygons(polygon)
    rings = [_thinned(ring, off_m) for ring in (turned.exterior, *turned.interiors)]
    thin = Polygon(rings[0], rings[1:])
    is_inside = thin.is_valid and polygon.buffer(INSIDE_M).covers(thin)
    return thin if is_inside else polygon


def _thinned(ring: LinearRing, off_m: float) -> F64:
    """(n, 2) closed; the area lies left of the ring."""
    points = shapely.get_coordinates(ring)[:-1]
    while len(points) > LEAST:
        meets = _meetings(points, off_m)
        if not meets:
            break
        for k, meeting in meets.items():
            points[k] = meeting
        points = np.delete(points, [(k + 1) % len(points) for k in meets], axis=0)
    return np.vstack([points, points[:1]])


def _meetings(points: F64, off_m: float) -> dict[int, F64]:
    """Of edges that may go at once, by their first corner: where their neighbours meet."""
    a, b, c, d = (np.roll(points, 1 - k, axis=0) for k in range(4))
    before, own, behind = b - a, c - b, d - c
    sine = _cross(before, behind)
    is_reflex = (_cross(before, own) < 0) & (_cross(own, behind) < 0) & (sine < -FLAT)
    share = _cross(d - a, behind) / np.where(is_reflex, sine, -1.0)
    meeting = a + share[:, None] * before
    away_m = np.abs(_cross(meeting - b, own)) / np.maximum(np.hypot(*own.T), FLAT)
    found: dict[int, F64] = {}
    used: set[int] = set()
    for k in np.flatnonzero(is_reflex & (away_m <= off_m)).tolist():
        around = {(k + step) % len(points) for step in (-1, 0, 1, 2)}
        if not around & used and len(points) - len(found) > LEAST:
            used |= around
            found[k] = meeting[k]
    return found


def _cross(a: F64, b: F64) -> F64:
    return np.asarray(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
