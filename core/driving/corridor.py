"""How far it is free straight ahead, and where the nearest obstacles are, from a map of states.

The corridor is the strip that the footprint sweeps going straight: what stands in it stops the
robot by the rules of the stop zone (`core.driving.stop_zone`), at its margin. All outside the
window is unknown. Each look goes over the cells of the strip, or of the window, once.
Source: design, section 8; planner link, section 3 (STOP_ZONE).
"""

import math

import numpy as np

from core.driving.stop_zone import (
    TOUCH_M,
    Heading,
    Place,
    Rect,
    Window,
    clearance,
    gap_along,
    heading_of,
    is_in_way,
    leaves,
    read_row,
)
from core.grid.ring import cells_about
from core.records import F64, I8, OBSTACLE, UNKNOWN
from jit import allocating_kernel, kernel

SECTORS = 8
NEAR_M = 3.0  # beside the robot, obstacles are looked for first


@kernel
def _path_to(
    i: int,
    j: int,
    cell_m: float,
    place: Place,
    heading: Heading,
    rect: Rect,
    keeps: tuple[float, float],
    is_unknown: bool,
    enough: float,
) -> float:
    """Metres straight ahead until a cell that is not free is too near; inf: it never is.

    keeps: the margin, and what is to be kept free of cells that are farther than it now. enough:
    also inf if it leaves so much.
    """
    cx, cy, half = (i + 0.5) * cell_m, (j + 0.5) * cell_m, cell_m / 2
    c, s = heading
    dx, dy = cx - place[0], cy - place[1]
    reach = half * (abs(c) + abs(s))
    front = c * dx + s * dy - reach - rect[0]
    if front - keeps[0] >= enough:
        return math.inf
    side = abs(c * dy - s * dx) - reach - rect[2]
    gap = gap_along(cx, cy, half, place, heading, rect)
    if gap < -TOUCH_M:  # under the footprint
        return math.inf if is_unknown or leaves(cx, cy, place, rect, 1.0, 0.0) else 0.0
    if gap < keeps[0] - TOUCH_M:  # within the margin: only what comes straight at it counts
        return 0.0 if side < -TOUCH_M and front >= -TOUCH_M else math.inf
    if side >= keeps[1] - TOUCH_M or front < 0.0:
        return math.inf
    return max(0.0, front - keeps[0])


@kernel
def _where(low: float, high: float, slope: float, span: tuple[float, float]) -> tuple[float, float]:
    """The part of a span of x where `low <= slope * x <= high`; all of it where nothing slopes."""
    if slope == 0.0:
        return span
    one, other = low / slope, high / slope
    return max(span[0], min(one, other)), min(span[1], max(one, other))


@allocating_kernel
def free_path(
    cells: I8,
    window: Window,
    cell_m: float,
    place: Place,
    rect: Rect,
    margin: float,
    longest: float,
    clear: Place,
) -> tuple[float, int, int, int, float]:
    """(free metres, i, j, state) of what ends the way ahead, and metres to an obstacle (inf).

    clear: x, y and radius of the ground where unknown counts as free. The free way is `longest` at
    most.
    """
    keeps = margin, clearance(cells, window, cell_m, place, rect, margin, clear)
    reach = math.hypot(max(rect[0], rect[1]) + margin, rect[2] + margin)
    (x, y, _), (c, s) = place, heading_of(place)
    _, here_j, count = cells_about(x, y, reach, cell_m)
    _, then_j, _ = cells_about(x, y + s * longest, reach, cell_m)
    grow = margin + cell_m  # of the strip, for the middles of cells that reach into it
    best, best_i, best_j, best_state, hard = longest, 0, 0, UNKNOWN, math.inf
    for j in range(min(here_j, then_j), max(here_j, then_j) + count):
        dy = (j + 0.5) * cell_m - y
        span = (-math.inf, math.inf)
        span = _where(-rect[1] - grow - s * dy, rect[0] + longest + grow - s * dy, c, span)
        span = _where(-rect[2] - grow - c * dy, rect[2] + grow - c * dy, -s, span)
        if span[0] > span[1]:  # none of the row; its ends may be beyond all integers
            continue
        first_i = math.floor((span[0] + x) / cell_m)
        row = np.empty(max(0, math.ceil((span[1] + x) / cell_m) - first_i), np.int8)
        read_row(first_i, j, cells, window, row)
        for k in range(row.size):
            i, state = first_i + k, int(row[k])
            if not is_in_way(state, i, j, cell_m, clear):
                continue
            is_unknown, enough = state == UNKNOWN, hard if state == OBSTACLE else best
            way = _path_to(i, j, cell_m, place, (c, s), rect, keeps, is_unknown, enough)
            if way < best:
                best, best_i, best_j, best_state = way, i, j, state
            if state == OBSTACLE and way <= longest:
                hard = way
    return best, best_i, best_j, best_state, hard


@kernel
def _nearest_beside(
    reach: float, cells: I8, window: Window, cell_m: float, place: Place, rect: Rect
) -> tuple[float, float]:
    """The nearest obstacle as `nearest_obstacle` has it, of those in rows within reach alone."""
    best, bearing = math.inf, 0.0
    c, s = math.cos(place[2]), math.sin(place[2])
    half, size = cell_m / 2 * (abs(c) + abs(s)), window[2]
    middle, length = (rect[0] - rect[1]) / 2, (rect[0] + rect[1]) / 2
    for row in range(size):
        dy = (window[1] + (row - window[1]) % size + 0.5) * cell_m - place[1]
        if abs(dy) > reach:
            continue
        for column in range(size):
            if cells[row, column] != OBSTACLE:
                continue
            dx = (window[0] + (column - window[0]) % size + 0.5) * cell_m - place[0]
            ahead, aside = c * dx + s * dy, c * dy - s * dx
            beyond = max(0.0, abs(ahead - middle) - length), max(0.0, abs(aside) - rect[2])
            if max(beyond) - half >= best:
                continue
            gap = max(0.0, math.hypot(beyond[0], beyond[1]) - half)
            if gap < best:
                best, bearing = gap, math.atan2(aside, ahead)
    return best, bearing


@kernel
def nearest_obstacle(
    cells: I8, window: Window, cell_m: float, place: Place, rect: Rect
) -> tuple[float, float]:
    """Metres from the robot's edge to the nearest obstacle cell (inf: none), and its bearing."""
    corner = math.hypot(max(rect[0], rect[1]), rect[2])
    found = _nearest_beside(NEAR_M, cells, window, cell_m, place, rect)
    if found[0] < NEAR_M - corner - cell_m:  # no cell of another row is nearer
        return found
    return _nearest_beside(math.inf, cells, window, cell_m, place, rect)


@kernel
def nearest_in_sectors(
    cells: I8, window: Window, cell_m: float, place: Place, sectors: F64
) -> None:
    """Fill sectors (8,) with metres from the axle's middle to the nearest obstacle of 45 degrees.

    The first is centred ahead, then counter-clockwise; inf: there is none.
    """
    sectors[:] = math.inf
    c, s = math.cos(place[2]), math.sin(place[2])
    half, size = cell_m / 2, window[2]
    for row in range(size):
        dy = (window[1] + (row - window[1]) % size + 0.5) * cell_m - place[1]
        for column in range(size):
            if cells[row, column] != OBSTACLE:
                continue
            dx = (window[0] + (column - window[0]) % size + 0.5) * cell_m - place[0]
            angle = math.atan2(c * dy - s * dx, c * dx + s * dy)
            k = math.floor(angle / (math.tau / SECTORS) + 0.5) % SECTORS
            sectors[k] = min(sectors[k], max(0.0, math.hypot(dx, dy) - half))
