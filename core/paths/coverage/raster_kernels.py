"""Cells that a round tool sweeps along straight edges, counted. Edges: x, y, x, y in metres.

`grid` is x and y of the lower left corner, the size of a cell, and the tool's reach, in metres.
"""

import math

import numpy as np
import numpy.typing as npt

from core.records import F64
from jit import kernel

I32 = npt.NDArray[np.int32]
Bools = npt.NDArray[np.bool_]


@kernel
def fill(edges: F64, grid: F64, is_target: Bools, crossings: F64) -> None:
    """Set the cells whose centres lie inside of a polygon with such edges, the lower end first.

    crossings: room for one number an edge.
    """
    low_x, low_y, cell_m = grid[0], grid[1], grid[2]
    rows, columns = is_target.shape
    least, most = math.inf, -math.inf
    for k in range(len(edges)):
        least, most = min(least, edges[k, 1]), max(most, edges[k, 3])
    begin = max(0, math.floor((least - low_y) / cell_m - 0.5))
    for row in range(begin, min(rows, math.ceil((most - low_y) / cell_m + 0.5))):
        y, n = low_y + (row + 0.5) * cell_m, 0
        for k in range(len(edges)):
            x0, y0, x1, y1 = edges[k]
            if y0 <= y < y1:
                x, at = x0 + (x1 - x0) * (y - y0) / (y1 - y0), n
                while at > 0 and crossings[at - 1] > x:
                    crossings[at] = crossings[at - 1]
                    at -= 1
                crossings[at] = x
                n += 1
        for k in range(0, n - 1, 2):
            first = math.ceil((crossings[k] - low_x) / cell_m - 0.5)
            behind = math.ceil((crossings[k + 1] - low_x) / cell_m - 0.5)
            is_target[row, max(0, first) : min(columns, behind)] = True


@kernel
def run_at(
    y: float, ax: float, ay: float, bx: float, by: float, reach: float
) -> tuple[float, float]:
    """From x to x: where all within reach of an edge meets the height y; inf, -inf: nowhere.

    That area is convex. So it is one run, from the least to the greatest of where the height meets
    the two end circles and the two long sides.
    """
    dx, dy = bx - ax, by - ay
    length = math.sqrt(dx * dx + dy * dy)
    left, right = math.inf, -math.inf
    for end in range(2):
        cx, cy = (ax, ay) if end == 0 else (bx, by)
        squared = reach * reach - (y - cy) * (y - cy)
        if squared >= 0.0:
            half = math.sqrt(squared)
            left, right = min(left, cx - half), max(right, cx + half)
    if dy != 0.0:
        nx, ny = -dy / length * reach, dx / length * reach
        for side in (-1.0, 1.0):
            share = (y - ay - side * ny) / dy
            if 0.0 <= share <= 1.0:
                x = ax + side * nx + share * dx
                left, right = min(left, x), max(right, x)
    return left, right


@kernel
def count_edge(
    count: I32, target: Bools, grid: F64, ax: float, ay: float, bx: float, by: float, sign: int
) -> int:
    """Count an edge in (sign 1) or out (-1); by how many the swept cells of the target grow."""
    low_x, low_y, cell, reach = grid[0], grid[1], grid[2], grid[3]
    change = 0
    rows, columns = count.shape
    first = max(0, math.floor((min(ay, by) - reach - low_y) / cell))
    last = min(rows - 1, math.floor((max(ay, by) + reach - low_y) / cell))
    for row in range(first, last + 1):
        left, right = run_at(low_y + (row + 0.5) * cell, ax, ay, bx, by, reach)
        if left > right:
            continue
        begin = max(0, math.ceil((left - low_x) / cell - 0.5))
        end = min(columns - 1, math.floor((right - low_x) / cell - 0.5))
        for column in range(begin, end + 1):
            was = count[row, column]
            count[row, column] = was + sign
            if target[row, column]:
                if was == 0 and sign > 0:
                    change += 1
                elif was == 1 and sign < 0:
                    change -= 1
    return change


@kernel
def exchange(count: I32, target: Bools, grid: F64, old: F64, new: F64, keep: bool) -> int:
    """Edges (n, 4) out and edges (m, 4) in; by how many the swept cells of the target grow."""
    change = 0
    for k in range(len(new)):
        change += count_edge(count, target, grid, new[k, 0], new[k, 1], new[k, 2], new[k, 3], 1)
    for k in range(len(old)):
        change += count_edge(count, target, grid, old[k, 0], old[k, 1], old[k, 2], old[k, 3], -1)
    if not keep:
        for k in range(len(old)):
            count_edge(count, target, grid, old[k, 0], old[k, 1], old[k, 2], old[k, 3], 1)
        for k in range(len(new)):
            count_edge(count, target, grid, new[k, 0], new[k, 1], new[k, 2], new[k, 3], -1)
    return change
