"""What a frame has seen through, and which parts of a hull it has seen: for kernels to ask.

A view is star-shaped around the lens: a point lies in it when it lies before the view's edge at
its own bearing. So one look-up is a bisection over bearings.
"""

import math

import numpy as np

from core.objects.records import Floats
from jit import kernel

NEAR = 1e-6  # m: a corner of the view so near the lens is the lens itself


def sectors_of(view: Floats, origin: tuple[float, float]) -> Floats:
    """The view's sides as sectors (m, 5), by bearing: start, then both ends from the lens, m.

    Args:
        view: (n, 2) m, counter-clockwise, star-shaped around `origin`, which may be a corner.

    Sides that lead to the lens, and those that run backwards, see nothing.
    """
    corners = np.asarray(view, dtype=np.float64).reshape(-1, 2) - np.asarray(origin)
    ends = np.roll(corners, -1, axis=0)
    cross = corners[:, 0] * ends[:, 1] - corners[:, 1] * ends[:, 0]
    far = (np.hypot(*corners.T) > NEAR) & (np.hypot(*ends.T) > NEAR) & (cross > 0.0)
    first = np.arctan2(corners[far, 1], corners[far, 0])
    rows = np.column_stack([first, corners[far], ends[far]])
    return np.ascontiguousarray(rows[np.argsort(first, kind="stable")])


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
