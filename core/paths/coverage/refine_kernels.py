"""Small changes of a path, each kept if it is worth its metres: see refine.py.

A path is (capacity, 2) corners in metres of which the first `n` count; `grid` is x and y of the
raster's lower left corner, its cell and the tool's reach, in metres.
"""

import math

import numpy as np
import numpy.typing as npt

from core.paths.coverage.raster_kernels import I32, Bools, count_edge
from core.paths.geometry.sight_kernels import WallEdges, meets_wall
from core.records import F64
from jit import kernel, releasing_kernel

I64 = npt.NDArray[np.int64]
LEAST_M = 1e-3
LEAST_WORTH_M2 = 1e-9
SIDES, STEPS = 8, (0.5, 0.15, 0.05)  # a corner is moved: to all sides; so far, of the reach
LONGEST = 8  # corners taken out at once


@kernel
def count_line(count: I32, target: Bools, grid: F64, path: F64, i: int, j: int, sign: int) -> int:
    """Count the straight line from corner i to corner j in or out; by how many more are swept."""
    return count_edge(count, target, grid, path[i, 0], path[i, 1], path[j, 0], path[j, 1], sign)


@kernel
def count_path(count: I32, target: Bools, grid: F64, path: F64, i: int, j: int, sign: int) -> int:
    """Count the edges from corner i to corner j in or out; by how many cells more are swept."""
    change = 0
    for k in range(i, j):
        change += count_line(count, target, grid, path, k, k + 1, sign)
    return change


@kernel
def far(path: F64, i: int, j: int) -> float:
    """The straight distance of two corners, in metres."""
    return math.sqrt((path[i, 0] - path[j, 0]) ** 2 + (path[i, 1] - path[j, 1]) ** 2)


@kernel
def clear(walls: WallEdges, path: F64, i: int, j: int) -> bool:
    return not meets_wall(walls, path[i, 0], path[i, 1], path[j, 0], path[j, 1])


@releasing_kernel
def shorten(
    count: I32, target: Bools, grid: F64, walls: WallEdges, path: F64, n: int, price: float
) -> int:
    """Leave out corners; `price` in m2 for each metre saved. How many corners are left."""
    i = 0
    area = grid[2] * grid[2]
    while i < n - 2:
        best, at, along = LEAST_WORTH_M2, 0, far(path, i, i + 1)
        gone = count_path(count, target, grid, path, i, i + 1, -1)
        end = min(i + LONGEST + 1, n)
        for j in range(i + 2, end):
            gone += count_path(count, target, grid, path, j - 1, j, -1)
            along += far(path, j - 1, j)
            saved = along - far(path, i, j)
            if saved < LEAST_M or price * saved <= best or not clear(walls, path, i, j):
                continue
            gained = gone + count_line(count, target, grid, path, i, j, 1)
            count_line(count, target, grid, path, i, j, -1)
            worth = price * saved + area * gained
            if worth > best:
                best, at = worth, j
        count_path(count, target, grid, path, i, end - 1, 1)
        if at:
            count_line(count, target, grid, path, i, at, 1)
            count_path(count, target, grid, path, i, at, -1)
            gone = at - i - 1
            for k in range(at, n):
                path[k - gone, 0], path[k - gone, 1] = path[k, 0], path[k, 1]
            n -= gone
        else:
            i += 1
    return n


@releasing_kernel
def shift(
    count: I32, target: Bools, grid: F64, walls: WallEdges, path: F64, n: int, price: float
) -> None:
    """Move corners: towards the line between their neighbours, and a little to all sides."""
    area = grid[2] * grid[2]
    for i in range(1, n - 1):
        x, y = path[i, 0], path[i, 1]
        best_x, best_y, best = x, y, LEAST_WORTH_M2
        now = far(path, i - 1, i) + far(path, i, i + 1)
        gone = count_path(count, target, grid, path, i - 1, i + 1, -1)
        for k in range(2 + len(STEPS) * SIDES):
            if k < 2:
                share = 0.5 if k == 0 else 0.2
                path[i, 0] = x + share * ((path[i - 1, 0] + path[i + 1, 0]) / 2 - x)
                path[i, 1] = y + share * ((path[i - 1, 1] + path[i + 1, 1]) / 2 - y)
            else:
                step = grid[3] * STEPS[(k - 2) // SIDES]
                path[i, 0] = x + step * math.cos(2 * math.pi * k / SIDES)
                path[i, 1] = y + step * math.sin(2 * math.pi * k / SIDES)
            if not (clear(walls, path, i - 1, i) and clear(walls, path, i, i + 1)):
                continue
            saved = now - far(path, i - 1, i) - far(path, i, i + 1)
            gained = gone + count_path(count, target, grid, path, i - 1, i + 1, 1)
            count_path(count, target, grid, path, i - 1, i + 1, -1)
            worth = price * saved + area * gained
            if worth > best:
                best, best_x, best_y = worth, path[i, 0], path[i, 1]
        path[i, 0], path[i, 1] = best_x, best_y
        count_path(count, target, grid, path, i - 1, i + 1, 1)


@kernel
def turn_round(path: F64, i: int, j: int) -> None:
    """Corners from i to j in the other order."""
    while i < j:
        x, y = path[i, 0], path[i, 1]
        path[i, 0], path[i, 1] = path[j, 0], path[j, 1]
        path[j, 0], path[j, 1] = x, y
        i, j = i + 1, j - 1


@releasing_kernel
def uncross(
    count: I32, target: Bools, grid: F64, walls: WallEdges, path: F64, n: int, price: float
) -> None:
    """2-opt: drive a stretch the other way round where that saves more than it loses."""
    area = grid[2] * grid[2]
    for i in range(n - 3):
        j = i + 2
        while j < n - 1:
            saved = (
                far(path, i, i + 1)
                + far(path, j, j + 1)
                - far(path, i, j)
                - far(path, i + 1, j + 1)
            )
            if (
                saved > 0.3 * grid[3]
                and clear(walls, path, i, j)
                and clear(walls, path, i + 1, j + 1)
            ):
                a, b, c, d = i, i + 1, j, j + 1
                gained = count_line(count, target, grid, path, a, c, 1)
                gained += count_line(count, target, grid, path, b, d, 1)
                gained += count_line(count, target, grid, path, a, b, -1)
                gained += count_line(count, target, grid, path, c, d, -1)
                if price * saved + area * gained > LEAST_WORTH_M2:
                    turn_round(path, b, c)
                else:
                    count_line(count, target, grid, path, a, b, 1)
                    count_line(count, target, grid, path, c, d, 1)
                    count_line(count, target, grid, path, a, c, -1)
                    count_line(count, target, grid, path, b, d, -1)
            j += 1


@releasing_kernel
def cheapest_detour(walls: WallEdges, path: F64, n: int, stops: F64, best: F64) -> None:
    """Where a path may leave for a row of stops (m, 2) and come back, for the fewest metres.

    Into best: metres, corner, where it leaves and where it comes back as metres behind that corner,
    1 if the stops are driven from the last to the first. Metres stay as given if none is better.
    """
    m = len(stops)
    for i in range(n - 1):
        ax, ay = path[i, 0], path[i, 1]
        length = far(path, i, i + 1)
        ux, uy = 0.0, 0.0
        if length > 0.0:
            ux, uy = (path[i + 1, 0] - ax) / length, (path[i + 1, 1] - ay) / length
        for flip in range(2):
            f, t = (0, m - 1) if flip == 0 else (m - 1, 0)
            at = min(max((stops[f, 0] - ax) * ux + (stops[f, 1] - ay) * uy, 0.0), length)
            for shift in range(3):
                leave = max(at - best[5], 0.0) if shift == 1 else at
                back = min(at + best[5], length) if shift == 2 else at
                px, py, qx, qy = ax + leave * ux, ay + leave * uy, ax + back * ux, ay + back * uy
                cost = math.sqrt((stops[f, 0] - px) ** 2 + (stops[f, 1] - py) ** 2) - (back - leave)
                cost += math.sqrt((stops[t, 0] - qx) ** 2 + (stops[t, 1] - qy) ** 2)
                if cost >= best[0] or meets_wall(walls, px, py, stops[f, 0], stops[f, 1]):
                    continue
                if not meets_wall(walls, stops[t, 0], stops[t, 1], qx, qy):
                    best[0], best[1], best[2], best[3], best[4] = cost, i, leave, back, flip


@kernel
def best_place(
    walls: WallEdges, path: F64, n: int, i: int, j: int, least_m: float, best: I64
) -> float:
    """Where else corners from i to j may be driven, for the fewest metres; how many that saves.

    Into best: the corner behind which, and 1 if in the other order. 0 metres: nowhere.
    """
    free = far(path, i - 1, i) + far(path, j, j + 1) - far(path, i - 1, j + 1)
    found = least_m
    best[0] = -1
    if free <= least_m or not clear(walls, path, i - 1, j + 1):
        return 0.0
    for k in range(n - 1):
        if i - 1 <= k <= j:
            continue
        most = free - found
        base = far(path, k, k + 1)
        for flip in range(2):
            a, b = (i, j) if flip == 0 else (j, i)
            more = far(path, k, a) + far(path, b, k + 1) - base
            if more < most and clear(walls, path, k, a) and clear(walls, path, b, k + 1):
                most, found = more, free - more
                best[0], best[1] = k, flip
    return found if best[0] >= 0 else 0.0


@kernel
def move(path: F64, i: int, j: int, k: int, flip: int) -> None:
    """Corners from i to j behind corner k, in the other order if flip."""
    if flip == 0:
        turn_round(path, i, j)
    if k > j:
        turn_round(path, j + 1, k)
        turn_round(path, i, k)
    else:
        turn_round(path, k + 1, i - 1)
        turn_round(path, k + 1, j)


@releasing_kernel
def relocate(
    count: I32,
    target: Bools,
    grid: F64,
    walls: WallEdges,
    path: F64,
    n: int,
    price: float,
    best: I64,
) -> None:
    """Or-opt: drive a stretch at another place of the path."""
    area = grid[2] * grid[2]
    for size in (1, 2, 3, 4, 6, 8, 12, 16, 24):
        for i in range(1, n - 1 - size):
            j = i + size - 1
            saved = best_place(walls, path, n, i, j, 0.3 * grid[3], best)
            if saved <= 0.0:
                continue
            k, a, b = best[0], i, j
            if best[1]:
                a, b = j, i
            gained = count_line(count, target, grid, path, i - 1, j + 1, 1)
            gained += count_line(count, target, grid, path, k, a, 1)
            gained += count_line(count, target, grid, path, b, k + 1, 1)
            gained += count_line(count, target, grid, path, i - 1, i, -1)
            gained += count_line(count, target, grid, path, j, j + 1, -1)
            gained += count_line(count, target, grid, path, k, k + 1, -1)
            if price * saved + area * gained > LEAST_WORTH_M2:
                move(path, i, j, k, best[1])
            else:
                count_line(count, target, grid, path, i - 1, i, 1)
                count_line(count, target, grid, path, j, j + 1, 1)
                count_line(count, target, grid, path, k, k + 1, 1)
                count_line(count, target, grid, path, i - 1, j + 1, -1)
                count_line(count, target, grid, path, k, a, -1)
                count_line(count, target, grid, path, b, k + 1, -1)
