"""Whether a convex shape meets walls: where it stands, turns a little, or drives straight ahead.

The shape lies within half planes: points x ahead and y to the left of the point that it turns
about, with a x + b y <= c for each row (a, b, c).
Source: Cyrus and Beck, Generalized two- and three-dimensional clipping, 1978.
"""

import math

import numpy as np
import numpy.typing as npt

from core.paths.geometry.sight_kernels import WallEdges
from core.records import F64
from jit import kernel, releasing_kernel

Bools = npt.NDArray[np.bool_]


@kernel
def _meets(
    walls: WallEdges, planes: F64, far_m: float, x: float, y: float, cos: float, sin: float,
    ahead_m: float,
) -> bool:  # fmt: skip
    """Whether the shape, no larger than far_m, at x, y meets an edge on its way `ahead_m`.

    What it sweeps is the sum of the shape and a line: planes that look ahead lie farther out.
    """
    ex, ey = x + cos * ahead_m, y + sin * ahead_m
    left, right = min(x, ex) - far_m, max(x, ex) + far_m
    low, high = min(y, ey) - far_m, max(y, ey) + far_m
    strips = len(walls.first) - 1
    s, t = int((low - walls.low_m) / walls.strip_m), int((high - walls.low_m) / walls.strip_m)
    begin = walls.first[min(max(s, 0), strips - 1)]
    end = walls.first[min(max(t, 0), strips - 1) + 1]
    for k in range(begin, end):
        ax, ay, bx, by = (
            walls.edges[k, 0] - x,
            walls.edges[k, 1] - y,
            walls.edges[k, 2] - x,
            walls.edges[k, 3] - y,
        )
        if max(ax, bx) < left - x or min(ax, bx) > right - x:
            continue
        if max(ay, by) < low - y or min(ay, by) > high - y:
            continue
        ax, ay = cos * ax + sin * ay, cos * ay - sin * ax
        bx, by = cos * bx + sin * by, cos * by - sin * bx
        first, last = 0.0, 1.0  # the part of the edge that is in all planes so far
        for p in range(len(planes)):
            room = planes[p, 2] + max(0.0, planes[p, 0] * ahead_m)
            at_a = planes[p, 0] * ax + planes[p, 1] * ay - room
            at_b = planes[p, 0] * bx + planes[p, 1] * by - room
            if at_a > 0.0 and at_b > 0.0:
                first = 2.0
                break
            if at_a > 0.0:
                first = max(first, at_a / (at_a - at_b))
            elif at_b > 0.0:
                last = min(last, at_a / (at_a - at_b))
        if first <= last:
            return True
    return False


@releasing_kernel
def free_headings(walls: WallEdges, planes: F64, far_m: float, points: F64, free: Bools) -> None:
    """Into free (n, k): whether the shape fits at points (n, 2) in each of k headings of a turn."""
    count = free.shape[1]
    for i in range(len(points)):
        for k in range(count):
            angle, x, y = k * 2.0 * math.pi / count, points[i, 0], points[i, 1]
            cos, sin = math.cos(angle), math.sin(angle)
            free[i, k] = not _meets(walls, planes, far_m, x, y, cos, sin, 0.0)


@releasing_kernel
def free_legs(
    walls: WallEdges, planes: F64, far_m: float, x: float, y: float, ends: F64, free: Bools
) -> None:
    """Into free (n,): whether the shape can drive straight from x, y to each of ends (n, 2)."""
    for i in range(len(ends)):
        dx, dy = ends[i, 0] - x, ends[i, 1] - y
        ahead_m = math.hypot(dx, dy)
        if ahead_m == 0.0:
            free[i] = False
            continue
        free[i] = not _meets(walls, planes, far_m, x, y, dx / ahead_m, dy / ahead_m, ahead_m)
