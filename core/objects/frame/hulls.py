"""Rims of points to polygons: convex where that is the shape, else concave, with few corners.

The concave ring begins as the convex one. An edge (a, b) longer than the gap is opened to the point
p inside that sees it under the largest angle, unless p is on the ring already: (a, p, b) is the
Delaunay triangle at that edge, so the ring stays simple. Then each ring is simplified (Douglas and
Peucker), from a corner that it surely has: the point farthest from its middle.

Source: docs/objects.md, section 7; Duckham et al. 2008, "characteristic shapes"; Jarvis 1973.
"""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import shapely

from core.objects.frame.pixels import I32
from core.objects.records import Floats
from core.records import F32, F64
from jit import kernel, releasing_kernel

FULL = 0.8  # of a convex hull's area is covered: it is the shape
POLYGON = 3  # GEOS's number of that type
SAME_M2 = 1e-8  # twice the area of a triangle whose corners are on one line


Shapes = npt.NDArray[np.object_]


class Rings(NamedTuple):
    """Room for the rings of a frame, point by point."""

    after: I32  # (points,) the next one on the ring; -1: not on it
    x: F32  # (points,) m, the rings one behind another
    y: F32
    begin: I32  # (clusters + 1,)
    area_m2: F32  # (clusters,) of the convex hull,
    length_m: F32  # and how far it reaches from its middle


@kernel
def _wrap(x: F32, y: F32, begin: int, end: int, to: Rings) -> int:
    """Link the convex hull of points counter-clockwise; gives its first: the lowest, then left."""
    first = begin
    for k in range(begin, end):
        to.after[k] = -1
        if y[k] < y[first] or (y[k] == y[first] and x[k] < x[first]):
            first = k
    here = first
    for _ in range(end - begin):
        best, hx, hy = -1, x[here], y[here]
        ux, uy = np.float32(0.0), np.float32(0.0)  # to the best one
        for k in range(begin, end):
            vx, vy = x[k] - hx, y[k] - hy
            turn = ux * vy - uy * vx
            if turn > SAME_M2 or (vx == 0.0 and vy == 0.0):
                continue  # nearly all
            is_farther = vx * vx + vy * vy > ux * ux + uy * uy
            if best < 0 or turn < -SAME_M2 or (is_farther and ux * vx + uy * vy > 0.0):
                best, ux, uy = k, vx, vy
        if best < 0 or to.after[best] >= 0:  # round, or the first again by a neighbour of it
            to.after[here] = first
            return first
        to.after[here] = best
        if best == first:
            return first
        here = best
    to.after[here] = first
    return first


@kernel
def _inner(x: F32, y: F32, a: int, b: int, begin: int, end: int) -> int:
    """The point that sees an edge under the largest angle, to the left of it; -1: none does."""
    best, least_dot, least_cross = -1, 1.0, 0.0  # cotangent of the angle: infinite
    ax, ay, bx, by = x[a], y[a], x[b], y[b]
    for p in range(begin, end):
        dx, dy, ex, ey = ax - x[p], ay - y[p], bx - x[p], by - y[p]
        cross, dot = dx * ey - dy * ex, dx * ex + dy * ey
        if dot * least_cross < least_dot * cross and cross > SAME_M2:
            best, least_dot, least_cross = p, dot, cross
        elif abs(cross) <= SAME_M2 and dot < 0.0 and p != a and p != b:
            return p  # on the edge itself
    return best


@kernel
def _open(x: F32, y: F32, first: int, begin: int, end: int, gap2: float, to: Rings) -> None:
    """Open all edges of a ring that are longer than the gap."""
    a = first
    for _ in range(2 * (end - begin)):
        b = to.after[a]
        dx, dy = x[b] - x[a], y[b] - y[a]
        if dx * dx + dy * dy > gap2:
            p = _inner(x, y, a, b, begin, end)
            if p >= 0 and to.after[p] < 0:
                to.after[a], to.after[p] = p, b
                continue
        a = b
        if a == first:
            return


@kernel
def _measure(x: F32, y: F32, first: int, to: Rings) -> tuple[float, float, int]:
    """Area of a ring, its reach from its middle, and the point farthest from there."""
    area2, mx, my, n, k = 0.0, 0.0, 0.0, 0, first
    while True:
        b = to.after[k]
        area2 += (x[k] - x[first]) * (y[b] - y[first]) - (x[b] - x[first]) * (y[k] - y[first])
        mx, my, n, k = mx + x[k], my + y[k], n + 1, b
        if k == first:
            break
    mx, my, far, most, k = mx / n, my / n, first, -1.0, first
    for _ in range(n):
        away = (x[k] - mx) ** 2 + (y[k] - my) ** 2
        if away > most:
            most, far = away, k
        k = to.after[k]
    return 0.5 * area2, math.sqrt(most), far


@releasing_kernel
def rings(
    x: F32, y: F32, begin: I32, edge_m: float, columns: I32, gap_m: F64, clusters: int,
    to: Rings,
) -> None:  # fmt: skip
    """A ring for each rim of points.

    Args:
        begin: (clusters + 1,) where each rim begins.
        edge_m: of a column. It stands for half a gap along the rays, where that is longer.
        columns: (clusters,) that each covers.
        gap_m: (clusters,) wider gaps in a rim are open.
    """
    n = 0
    for c in range(clusters):
        here, end = begin[c], begin[c + 1]
        to.begin[c] = n
        first = _wrap(x, y, here, end, to)
        area, length, _ = _measure(x, y, first, to)
        to.area_m2[c], to.length_m[c] = area, length
        if columns[c] * edge_m * max(edge_m, 0.5 * gap_m[c]) < FULL * area:
            _open(x, y, first, here, end, gap_m[c] * gap_m[c], to)
        _, _, first = _measure(x, y, first, to)
        k = first
        while True:
            to.x[n], to.y[n] = x[k], y[k]
            n, k = n + 1, to.after[k]
            if k == first:
                break
    to.begin[clusters] = n


def polygons_of(to: Rings, clusters: int, thin_m: float, within_m: float) -> list[Floats]:
    """Simple polygons (n, 2), counter-clockwise, with as few corners as stay within a tolerance.

    Args:
        thin_m: what is thinner is made that wide: a sheet seen from its edge is a thing, too.
        within_m: so far outside of its polygon a point may lie.
    """
    total = int(to.begin[clusters])
    points = np.column_stack([to.x[:total], to.y[:total]]).astype(np.float64)
    sizes = np.diff(to.begin[: clusters + 1])
    number = np.repeat(np.arange(clusters), sizes)
    is_thin = (sizes < 3) | (to.area_m2[:clusters] < thin_m * to.length_m[:clusters])
    shapes = np.empty(clusters, dtype=object)
    if not is_thin.all():
        place, kept = np.cumsum(~is_thin) - 1, ~is_thin[number]
        closed = shapely.linearrings(points[kept], indices=place[number[kept]])
        shapes[~is_thin] = _simplified(shapely.polygons(closed), within_m)
    if is_thin.any():  # with so few corners that none could go
        place, kept = np.cumsum(is_thin) - 1, is_thin[number]
        rims = shapely.multipoints(points[kept], indices=place[number[kept]])
        wide = shapely.buffer(
            shapely.convex_hull(rims), 0.5 * thin_m, cap_style="square", join_style="mitre"
        )
        shapes[is_thin] = shapely.convex_hull(wide)
    corners, of = shapely.get_coordinates(shapely.orient_polygons(shapes), return_index=True)
    ends = np.searchsorted(of, np.arange(clusters + 1))
    return [corners[ends[c] : ends[c + 1] - 1] for c in range(clusters)]


def _simplified(shapes: Shapes, within_m: float) -> Shapes:
    """Polygons with fewer corners; where that leaves none, by slower ways."""
    fewer = shapely.simplify(shapes, within_m, preserve_topology=False)
    is_good = shapely.is_valid(fewer) & (shapely.get_type_id(fewer) == POLYGON)
    is_good &= shapely.get_num_coordinates(fewer) >= 4
    if not is_good.all():
        again = shapely.simplify(shapes[~is_good], within_m, preserve_topology=True)
        is_bad = ~shapely.is_valid(again) | (shapely.area(again) <= 0.0)
        again[is_bad] = shapely.convex_hull(shapes[~is_good][is_bad])
        fewer[~is_good] = again
    return np.asarray(fewer)
