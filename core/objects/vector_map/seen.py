"""What a frame has seen through, and which parts of a hull it has seen: for kernels to ask.

A view has one stretch of each bearing from the lens: a point lies in it when it lies behind the
view's near edge and before its far edge. So one look-up is a bisection over bearings. Between the
lens and the near edge nobody has seen anything: what stands there is not judged.
"""

import math

import numpy as np

from core.objects.records import Floats
from jit import kernel

NEAR = 1e-6  # m: a corner of the view so near the lens is the lens itself
ALONG = 1e-9  # rad: a side that spans no more than that leads along a ray and bounds no bearing


def sectors_of(view: Floats, origin: tuple[float, float]) -> Floats:
    """The view as sectors (m, 9), by bearing: start, then far and near edge: both ends of each.

    Ends are in m from the lens, in the order in which the view has them. Where the view begins at
    the lens, the near edge is all 0.

    Args:
        view: (n, 2) m, counter-clockwise, one stretch of each bearing from `origin`, which lies
            outside of it or is a corner.
    """
    corners = np.asarray(view, dtype=np.float64).reshape(-1, 2) - np.asarray(origin)
    sides = np.hstack([corners, np.roll(corners, -1, axis=0)])
    lengths = np.hypot(sides[:, 0], sides[:, 1]), np.hypot(sides[:, 2], sides[:, 3])
    cross = sides[:, 0] * sides[:, 3] - sides[:, 1] * sides[:, 2]
    is_edge = (np.minimum(*lengths) > NEAR) & (np.abs(cross) > ALONG * lengths[0] * lengths[1])
    far, near = sides[is_edge & (cross > 0.0)], sides[is_edge & (cross < 0.0)]
    if len(far) == 0:
        return np.zeros((0, 9))
    bearings = [np.arctan2(edge[:, k + 1], edge[:, k]) for edge in (far, near) for k in (0, 2)]
    starts = np.unique(np.concatenate(bearings))
    ends = np.append(starts[1:], starts[0] + 2.0 * math.pi)
    middles = 0.5 * (starts + ends)
    far, _ = _edge_at(middles, far)
    near, is_there = _edge_at(middles, near[:, [2, 3, 0, 1]])
    near = np.where(is_there[:, None], near[:, [2, 3, 0, 1]], 0.0)
    return np.ascontiguousarray(np.column_stack([starts, far, near]))


def _edge_at(bearings: Floats, sides: Floats) -> tuple[Floats, np.ndarray]:
    """Of sides (k, 4) from lesser to larger bearing, the one at each bearing (n, 4); is there any?

    Where there is none, another one.
    """
    if len(sides) == 0:
        return np.zeros((len(bearings), 4)), np.zeros(len(bearings), dtype=bool)
    first = np.arctan2(sides[:, 1], sides[:, 0])
    order = np.argsort(first, kind="stable")
    wrapped = np.remainder(bearings + math.pi, 2.0 * math.pi) - math.pi
    at = sides[order[np.searchsorted(first[order], wrapped, side="right") - 1]]
    x, y = np.cos(wrapped), np.sin(wrapped)
    is_there = (at[:, 0] * y - at[:, 1] * x >= 0.0) & (x * at[:, 3] - y * at[:, 2] >= 0.0)
    return at, is_there


@kernel
def sees(sectors: Floats, x: float, y: float) -> bool:
    """Whether the view covers a point, m from the lens."""
    if sectors.shape[0] == 0:
        return False
    bearing = math.atan2(y, x)
    low, high = 0, sectors.shape[0]
    while low < high:
        middle = (low + high) // 2
        if sectors[middle, 0] <= bearing:
            low = middle + 1
        else:
            high = middle
    k = low - 1 if low > 0 else sectors.shape[0] - 1
    ax, ay, bx, by = sectors[k, 1], sectors[k, 2], sectors[k, 3], sectors[k, 4]
    if ax * y - ay * x < 0.0 or x * by - y * bx < 0.0:
        return False
    if (bx - ax) * (y - ay) - (by - ay) * (x - ax) < 0.0:
        return False
    ax, ay, bx, by = sectors[k, 5], sectors[k, 6], sectors[k, 7], sectors[k, 8]
    return bool((bx - ax) * (y - ay) - (by - ay) * (x - ax) >= 0.0)


@kernel
def count_seen(sectors: Floats, points: Floats, aside_m: float, ox: float, oy: float) -> int:
    """How many of the points (n, 2) m a view covers, with what lies so far to both sides of each.

    To the sides as the lens at (ox, oy) sees it.
    """
    count = 0
    for k in range(points.shape[0]):
        x, y = points[k, 0] - ox, points[k, 1] - oy
        scale = aside_m / max(math.hypot(x, y), NEAR)
        if (
            sees(sectors, x, y)
            and sees(sectors, x - scale * y, y + scale * x)
            and sees(sectors, x + scale * y, y - scale * x)
        ):
            count += 1
    return count


@kernel
def mark_seen(pieces: Floats, sectors: Floats, ox: float, oy: float, step: float) -> None:
    """Sets [4] of pieces (k, 5) to 1 where a piece faces the lens and the space before it was seen
    through, else 0."""
    for k in range(pieces.shape[0]):
        dx, dy = pieces[k, 2] - pieces[k, 0], pieces[k, 3] - pieces[k, 1]
        length = math.hypot(dx, dy)
        scale = step / length if length > 0.0 else 0.0
        x = 0.5 * (pieces[k, 0] + pieces[k, 2]) + dy * scale
        y = 0.5 * (pieces[k, 1] + pieces[k, 3]) - dx * scale
        faces = dy * (ox - pieces[k, 0]) - dx * (oy - pieces[k, 1]) > 0.0
        pieces[k, 4] = 1.0 if faces and sees(sectors, x - ox, y - oy) else 0.0


def pieces_of(polygon: Floats, longest_m: float) -> Floats:
    """The sides of a polygon, cut into pieces (k, 5) of at most that length: x1, y1, x2, y2, 0."""
    ends = np.roll(polygon, -1, axis=0)
    counts = np.maximum(1, np.ceil(np.hypot(*(ends - polygon).T) / longest_m)).astype(np.int64)
    side = np.repeat(np.arange(len(polygon)), counts)
    number = np.arange(len(side)) - np.repeat(np.cumsum(counts) - counts, counts)
    step = (ends - polygon)[side] / counts[side, None]
    start = polygon[side] + number[:, None] * step
    return np.column_stack([start, start + step, np.zeros(len(side))])
