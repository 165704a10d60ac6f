"""Where to look next: places from which a machine sees floor that it has not seen yet.

A frontier is unseen floor beside seen floor, where no thing and no wall is known. Source: Yamauchi,
A frontier-based approach for autonomous exploration, 1997.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from core.paths.cleaning.floor_cells import Mask
from core.paths.cleaning.seen_floor import SeenFloor
from core.records import F64
from jit import allocating_kernel

I64 = npt.NDArray[np.int64]
BLOCK = 40  # cells of a frontier that are taken together
LEAST_CELLS, FEW_CELLS = 12, 8  # of one block: fewer are no frontier; and where much was swept
STEP_M = 0.1  # of the raster of places
NEAR_M, FAR_M = 1.1, 1.8  # from a place to the frontier that is looked at
IN_REACH_M = 1.0  # a frontier that is farther from all places is not needed
SIGHTS = 60  # places that are tried for one block
BLOCKS = 12  # the nearest ones
GRAZING_M = 0.1  # from things to the line along which it looks past them
# A frontier right beside a thing is looked at, too: the line may end so far before it, where it
# comes out of what is kept from the thing, up to 48 degrees aslant.
SHORT_M = 1.5 * GRAZING_M
TURN_M = 0.7  # of way that a radian of turning is worth

Point = tuple[float, float]
Place = tuple[float, float, float]  # x, y, yaw
Block = tuple[int, int]


@dataclass(frozen=True, slots=True)
class Viewpoint:
    """Where to stand, and what to look at from there; metres."""

    place: Point
    frontier: Point
    block: Block  # its name


@allocating_kernel
def _ways(is_place: Mask, i0: int, j0: int) -> F64:
    """Least steps from one place to each other one, diagonals too; inf where there is no way."""
    far = np.full(is_place.shape, np.inf)
    n, (rows, columns) = is_place.size, is_place.shape
    queue, waiting = np.empty((n + 1, 2), np.int64), np.zeros(is_place.shape, np.bool_)
    head, tail = 0, 1
    queue[0, 0], queue[0, 1] = i0, j0
    far[i0, j0] = 0.0
    while head != tail:
        i, j = queue[head, 0], queue[head, 1]
        head = (head + 1) % (n + 1)
        waiting[i, j] = False
        for di in range(-1, 2):
            for dj in range(-1, 2):
                a, b = i + di, j + dj
                if a < 0 or b < 0 or a >= rows or b >= columns or not is_place[a, b]:
                    continue
                step = far[i, j] + math.sqrt(di * di + dj * dj)
                if step < far[a, b] - 1e-9:
                    far[a, b] = step
                    if not waiting[a, b]:
                        waiting[a, b] = True
                        queue[tail, 0], queue[tail, 1] = a, b
                        tail = (tail + 1) % (n + 1)
    return far


def block_square(floor: SeenFloor, block: Block) -> Polygon:
    """Of all its cells."""
    size_m = BLOCK * floor.cell_m
    x, y = (floor.low + size_m * np.array(block)).tolist()
    return shapely.box(x, y, x + size_m, y + size_m)


def frontier_blocks(floor: SeenFloor, known: Mask, things: Mask, least: int) -> dict[Block, Point]:
    """Middles of the frontier's blocks, by their names.

    Args:
        known: of `SeenFloor.mask_of`, what things and walls explain.
        things: the same, where they stand. Floor outside of that which was seen, and lost to
            something that is told no more, is a frontier even where things explain it.
        least: cells of a block; fewer are no frontier.
    """
    seen = floor.is_seen()
    unknown = ~(seen | known) | (floor.is_lost() & ~things)
    beside = np.zeros_like(seen)
    beside[1:] |= seen[:-1]
    beside[:-1] |= seen[1:]
    beside[:, 1:] |= seen[:, :-1]
    beside[:, :-1] |= seen[:, 1:]
    cells = np.argwhere(unknown & beside)
    first = [part.start for part in floor.window]  # the window grows: names are of all the floor
    names, which, counts = np.unique(
        (cells + first) // BLOCK, axis=0, return_inverse=True, return_counts=True
    )
    centres, found = floor.centres(cells), dict[Block, Point]()
    for k in np.flatnonzero(counts >= least):
        x, y = centres[which.ravel() == k].mean(axis=0).tolist()
        found[int(names[k, 0]), int(names[k, 1])] = x, y
    return found


def next_viewpoint(
    blocks: dict[Block, Point], space: Polygon, bars: BaseGeometry, place: Place
) -> Viewpoint | None:
    """The place from which a frontier can be seen that is the least way away; None: none.

    Args:
        space: where the machine's centre may be.
        bars: what hides the floor behind it.
    """
    if not blocks:
        return None
    x0, y0, x1, y1 = space.bounds
    xs, ys = (np.arange(a, b, STEP_M) + STEP_M / 2 for a, b in ((x0, x1), (y0, y1)))
    if not len(xs) or not len(ys):
        return None
    shapely.prepare(space)
    grid_x, grid_y = np.meshgrid(xs, ys, indexing="ij")
    is_place = shapely.contains_xy(space, grid_x.ravel(), grid_y.ravel()).reshape(grid_x.shape)
    if not is_place.any():
        return None
    away = np.where(is_place, np.hypot(grid_x - place[0], grid_y - place[1]), np.inf)
    i, j = np.unravel_index(int(np.argmin(away)), away.shape)
    ways = _ways(is_place, int(i), int(j))
    there = np.argwhere(np.isfinite(ways))
    points, steps = np.column_stack([xs[there[:, 0]], ys[there[:, 1]]]), ways[tuple(there.T)]
    return _best(blocks, points, steps * STEP_M, bars, place[2])


def _best(
    blocks: dict[Block, Point], points: F64, ways_m: F64, bars: BaseGeometry, yaw: float
) -> Viewpoint | None:
    """Of places (n, 2) and the ways to them."""
    shapely.prepare(bars)
    found: list[tuple[float, Viewpoint]] = []
    offers: list[tuple[float, Block, I64]] = []
    for name, at in blocks.items():
        far = np.hypot(*(points - at).T)
        if far.min() > IN_REACH_M:
            continue
        ring = np.flatnonzero((far > NEAR_M) & (far < FAR_M))
        if len(ring):
            order = ring[np.argsort(ways_m[ring], kind="stable")][:: max(1, len(ring) // SIGHTS)]
            x, y = (np.array(at) - points[order[0]]).tolist()
            turn_rad = abs(math.remainder(math.atan2(y, x) - yaw, math.tau))
            offers.append((float(ways_m[order[0]]) + TURN_M * turn_rad, name, order))
    for least_m, name, order in sorted(offers, key=lambda offer: offer[:2]):
        if len(found) >= BLOCKS or (found and least_m > min(found, key=_way_of)[0]):
            break
        at = blocks[name]
        lines = shapely.linestrings(_before(points[order], at))
        clear = np.flatnonzero(~shapely.intersects(bars, lines))
        if len(clear):
            k = int(order[clear[0]])
            x, y = points[k].tolist()
            cost_m = least_m + float(ways_m[k] - ways_m[order[0]])
            found.append((cost_m, Viewpoint((x, y), at, name)))
    return min(found, key=_way_of)[1] if found else None


def _way_of(one: tuple[float, Viewpoint]) -> float:
    return one[0]


def _before(points: F64, at: Sequence[float]) -> F64:
    """Lines (n, 2, 2) from points (n, 2) to a little before a place."""
    far = np.array(at) - points
    share = 1.0 - SHORT_M / np.maximum(np.hypot(*far.T), 2.0 * SHORT_M)
    return np.stack([points, points + share[:, None] * far], axis=1)
