"""Kernels on a raster of ground: where one can stand, ways to a goal, what the laser sees on them.

Arrays are (rows along y, columns along x); lengths are in cells unless their names say metres.
"""

import math

import numpy as np
import numpy.typing as npt

from jit import allocating_kernel, kernel

F64 = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

LENS_M, LENS_AHEAD_M = 1.08, 0.25
TILT_RAD = math.radians(7.5)
WIDEST_COS = math.cos(math.radians(58.0))  # of the beams that are used, with 2 degrees to spare
WINDOW_M = 9.9  # the map reaches so far from the robot, along both axes


@allocating_kernel
def flood(heights: F64, row: int, column: int, step_m: float) -> Flags:
    """Cells that are reached from one over height steps of at most `step_m` a cell."""
    rows, columns = heights.shape
    reached = np.zeros((rows, columns), dtype=np.bool_)
    queue = np.empty(rows * columns, dtype=np.int64)
    reached[row, column] = True
    queue[0] = row * columns + column
    head, tail = 0, 1
    while head < tail:
        j, i = divmod(queue[head], columns)
        head += 1
        for dj, di in ((0, 1), (0, -1), (1, 0), (-1, 0)):
            b, a = j + dj, i + di
            if not (0 <= b < rows and 0 <= a < columns) or reached[b, a]:
                continue
            if abs(heights[b, a] - heights[j, i]) <= step_m:
                reached[b, a] = True
                queue[tail] = b * columns + a
                tail += 1
    return reached


@allocating_kernel
def grown(flags: Flags, radius: float) -> Flags:
    """Cells whose middles lie within a radius of the middle of one that is set."""
    rows, columns = flags.shape
    result = flags.copy()
    reach = int(radius)
    for j in range(rows):
        for i in range(columns):
            if not flags[j, i]:
                continue
            inner = 0 < j < rows - 1 and 0 < i < columns - 1
            if inner and (
                flags[j - 1, i] and flags[j + 1, i] and flags[j, i - 1] and flags[j, i + 1]
            ):
                continue
            for b in range(max(0, j - reach), min(rows, j + reach + 1)):
                for a in range(max(0, i - reach), min(columns, i + reach + 1)):
                    if (b - j) ** 2 + (a - i) ** 2 <= radius * radius:
                        result[b, a] = True
    return result


@allocating_kernel
def ways_to(closed: Flags, row: int, column: int) -> F64:
    """Length of the shortest way to a cell from all others, in cells; inf where none leads."""
    rows, columns = closed.shape
    length = np.full((rows, columns), np.inf)
    length[row, column] = 0.0
    diagonal = math.sqrt(2.0)
    changed = True
    while changed:
        changed = False
        for back in (False, True):
            for n in range(rows):
                j = rows - 1 - n if back else n
                for m in range(columns):
                    i = columns - 1 - m if back else m
                    if closed[j, i]:
                        continue
                    best = length[j, i]
                    for dj in (-1, 0, 1):
                        for di in (-1, 0, 1):
                            b, a = j + dj, i + di
                            if 0 <= b < rows and 0 <= a < columns and not closed[b, a]:
                                step = diagonal if dj != 0 and di != 0 else 1.0
                                best = min(best, length[b, a] + step)
                    if best < length[j, i] - 1e-9:
                        length[j, i] = best
                        changed = True
    return length


@kernel
def is_clear(closed: Flags, x0: float, y0: float, x1: float, y1: float) -> bool:
    """Whether a straight line between two places, in cells, meets no closed cell."""
    steps = int(math.hypot(x1 - x0, y1 - y0) * 2) + 1
    for k in range(steps + 1):
        x, y = x0 + (x1 - x0) * k / steps, y0 + (y1 - y0) * k / steps
        if closed[int(y), int(x)]:
            return False
    return True


@kernel
def _sees(
    tops_m: F64, corner: tuple[float, float, float], eye: F64, target: F64, turn_rad: float
) -> bool:
    """Whether the laser at (x, y, heading, ground, slope) can have its line on (x, y, ground)."""
    low_x, low_y, cell_m = corner
    x = eye[0] + LENS_AHEAD_M * math.cos(eye[2])
    y = eye[1] + LENS_AHEAD_M * math.sin(eye[2])
    dx, dy, down_m = target[0] - x, target[1] - y, eye[3] + LENS_M - target[2]
    away_m = math.hypot(dx, dy)
    fall = math.tan(TILT_RAD - eye[4]) * away_m
    if max(abs(dx), abs(dy)) > WINDOW_M or fall <= 0.0 or not WIDEST_COS < down_m / fall <= 1.0:
        return False
    off_rad, beside_rad = math.atan2(dy, dx) - eye[2], math.acos(down_m / fall)
    least = math.inf
    for need in (off_rad - beside_rad, off_rad + beside_rad):
        least = min(least, abs(math.atan2(math.sin(need), math.cos(need))))
    if least > turn_rad:
        return False
    steps = int(away_m / cell_m)
    for k in range(4, steps - 1):
        share = k / steps
        i = int((x + share * dx - low_x) / cell_m)
        j = int((y + share * dy - low_y) / cell_m)
        if tops_m[j, i] > eye[3] + LENS_M - share * down_m:
            return False
    return True


@allocating_kernel
def seen(
    tops_m: F64,
    corner: tuple[float, float, float],
    eyes: F64,
    targets: F64,
    turns_rad: F64,
    untils: npt.NDArray[np.int64],
) -> Flags:
    """Whether each target can have been seen from any of the first places on the way.

    Args:
        tops_m: heights of what stands there; corner: x, y of its lowest corner, edge of a cell.
        eyes: (n, 5) x, y, heading, height of the ground, slope up ahead.
        targets: (m, 3) x, y, height of the ground.
        turns_rad: (n,) how far the robot may look aside at a place.
        untils: (m,) how many places come before the target.
    """
    result = np.zeros(len(targets), dtype=np.bool_)
    for m in range(len(targets)):
        for n in range(untils[m] - 1, -1, -1):
            if _sees(tops_m, corner, eyes[n], targets[m], turns_rad[n]):
                result[m] = True
                break
    return result
