"""How far it is free straight ahead, and where the nearest obstacles are, from a map of states.

The corridor is the strip that the footprint sweeps going straight: what stands in it stops the
robot by the rules of the stop zone (`core.driving.stop_zone`), at its margin. All outside the
window is unknown. Each look goes over the cells of the strip, or of the window, once.
Source: design, section 8; planner link, section 3 (STOP_ZONE).
"""

import math

from core.driving.stop_zone import (
    TOUCH_M,
    Place,
    Rect,
    Window,
    cell_state,
    clearance,
    first_of,
    gap_to,
    leaves,
)
from core.grid.ring import cells_about
from core.records import F64, FREE, I8, OBSTACLE, UNKNOWN
from jit import kernel

SECTORS = 8


@kernel
def _path_to(
    i: int,
    j: int,
    cell_m: float,
    place: Place,
    rect: Rect,
    keeps: tuple[float, float],
    is_unknown: bool,
) -> float:
    """Metres straight ahead until a cell that is not free is too near; inf: it never is.

    keeps: the margin, and what is to be kept free of cells that are farther than it now.
    """
    cx, cy, half = (i + 0.5) * cell_m, (j + 0.5) * cell_m, cell_m / 2
    c, s = math.cos(place[2]), math.sin(place[2])
    dx, dy = cx - place[0], cy - place[1]
    reach = half * (abs(c) + abs(s))
    front = c * dx + s * dy - reach - rect[0]
    side = abs(c * dy - s * dx) - reach - rect[2]
    gap = gap_to(cx, cy, half, place, rect)
    if gap < -TOUCH_M:  # under the footprint
        return math.inf if is_unknown or leaves(cx, cy, place, rect, 1.0, 0.0) else 0.0
    if gap < keeps[0] - TOUCH_M:  # within the margin: only what comes straight at it counts
        return 0.0 if side < -TOUCH_M and front >= -TOUCH_M else math.inf
    if side >= keeps[1] - TOUCH_M or front < 0.0:
        return math.inf
    return max(0.0, front - keeps[0])


@kernel
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
    kept = clearance(cells, window, cell_m, place, rect, margin, clear)
    reach = math.hypot(max(rect[0], rect[1]) + margin, rect[2] + margin)
    end_x = place[0] + math.cos(place[2]) * longest
    end_y = place[1] + math.sin(place[2]) * longest
    here_i, here_j, count = cells_about(place[0], place[1], reach, cell_m)
    then_i, then_j, _ = cells_about(end_x, end_y, reach, cell_m)
    best, best_i, best_j, best_state = longest, 0, 0, UNKNOWN
    hard, first = math.inf, first_of(window)
    for j in range(min(here_j, then_j), max(here_j, then_j) + count):
        for i in range(min(here_i, then_i), max(here_i, then_i) + count):
            state = cell_state(i, j, cells, window, first, cell_m, clear)
            if state == FREE:
                continue
            way = _path_to(i, j, cell_m, place, rect, (margin, kept), state == UNKNOWN)
            if way < best:
                best, best_i, best_j, best_state = way, i, j, state
            if state == OBSTACLE and way <= longest:
                hard = min(hard, way)
    return best, best_i, best_j, best_state, hard


@kernel
def nearest_obstacles(
    cells: I8,
    window: Window,
    cell_m: float,
    place: Place,
    rect: Rect,
    sectors: F64,
) -> tuple[float, float]:
    """Metres from the robot's edge to the nearest obstacle cell (inf: none), and its bearing.

    Fills sectors (8,): metres from the axle's middle to the nearest one of each 45 degrees, the
    first centred ahead, counter-clockwise; inf: none.
    """
    sectors[:] = math.inf
    best, bearing = math.inf, 0.0
    c, s = math.cos(place[2]), math.sin(place[2])
    half, size = cell_m / 2, window[2]
    middle, length = (rect[0] - rect[1]) / 2, (rect[0] + rect[1]) / 2
    for row in range(size):
        j = window[1] + (row - window[1]) % size
        for column in range(size):
            if cells[row, column] != OBSTACLE:
                continue
            i = window[0] + (column - window[0]) % size
            dx, dy = (i + 0.5) * cell_m - place[0], (j + 0.5) * cell_m - place[1]
            ahead, aside = c * dx + s * dy, c * dy - s * dx
            angle = math.atan2(aside, ahead)
            k = math.floor(angle / (math.tau / SECTORS) + 0.5) % SECTORS
            sectors[k] = min(sectors[k], max(0.0, math.hypot(dx, dy) - half))
            beyond = max(0.0, abs(ahead - middle) - length), max(0.0, abs(aside) - rect[2])
            gap = max(0.0, math.hypot(beyond[0], beyond[1]) - half * (abs(c) + abs(s)))
            if gap < best:
                best, bearing = gap, angle
    return best, bearing
