"""Lines of sight within a polygon, and shortest lengths through a graph."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from core.records import F64
from jit import kernel, releasing_kernel

Bools = npt.NDArray[np.bool_]
I64 = npt.NDArray[np.int64]


class WallEdges(NamedTuple):
    """Edges of walls by strips along x, so that a line looks at those of its strips only."""

    edges: F64  # (n, 4) x, y, x, y; in each strip that it reaches into
    first: npt.NDArray[np.int64]  # (strips + 1,) where the edges of each strip begin
    low_m: float  # y where the first strip begins
    strip_m: float  # height of one


@kernel
def meets_wall(walls: WallEdges, ax: float, ay: float, bx: float, by: float) -> bool:
    """Whether the line from a to b touches an edge."""
    strips = len(walls.first) - 1
    s = int((min(ay, by) - walls.low_m) / walls.strip_m)
    t = int((max(ay, by) - walls.low_m) / walls.strip_m)
    begin = walls.first[min(max(s, 0), strips - 1)]
    end = walls.first[min(max(t, 0), strips - 1) + 1]
    left, right, low, high = min(ax, bx), max(ax, bx), min(ay, by), max(ay, by)
    dx, dy = bx - ax, by - ay
    for k in range(begin, end):
        cx, cy, ex, ey = (
            walls.edges[k, 0],
            walls.edges[k, 1],
            walls.edges[k, 2],
            walls.edges[k, 3],
        )
        if (cx < left and ex < left) or (cx > right and ex > right):
            continue
        if (cy < low and ey < low) or (cy > high and ey > high):
            continue
        c_side = dx * (cy - ay) - dy * (cx - ax)
        e_side = dx * (ey - ay) - dy * (ex - ax)
        if (c_side > 0.0 and e_side > 0.0) or (c_side < 0.0 and e_side < 0.0):
            continue
        wx, wy = ex - cx, ey - cy
        a_side = wx * (ay - cy) - wy * (ax - cx)
        b_side = wx * (by - cy) - wy * (bx - cx)
        if (a_side > 0.0 and b_side > 0.0) or (a_side < 0.0 and b_side < 0.0):
            continue
        return True
    return False


@releasing_kernel
def lines_of_sight(walls: WallEdges, lines: F64, seen: Bools) -> None:
    """Of each line, (m, 4), whether it meets no wall, into seen (m,)."""
    for k in range(len(lines)):
        seen[k] = not meets_wall(walls, lines[k, 0], lines[k, 1], lines[k, 2], lines[k, 3])


@releasing_kernel
def shorten_all(first: I64, others: I64, far: F64, lengths: F64, queue: I64, waits: Bools) -> None:
    """Lengths to nodes, (n,), to the shortest ones by way of others, in place.

    Edges of node k are those from first[k] on, to nodes `others`, of lengths `far`. A node that has
    become nearer waits in the queue (n,), a ring, until its edges are looked at again.
    Source: Moore, The shortest path through a maze, 1959.
    """
    n, begin, end = len(lengths), 0, 0
    for k in range(n):
        waits[k] = lengths[k] < np.inf
        if waits[k]:
            queue[end] = k
            end += 1
    while begin < end:
        node = queue[begin % n]
        begin += 1
        waits[node] = False
        for k in range(first[node], first[node + 1]):
            other = others[k]
            if lengths[node] + far[k] < lengths[other]:
                lengths[other] = lengths[node] + far[k]
                if not waits[other]:
                    waits[other] = True
                    queue[end % n] = other
                    end += 1
