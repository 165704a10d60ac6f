"""The space seen through, and what is low: read from the fan of floor cells.

A bearing is followed outwards from its first floor. It ends before a thing, before two cells in a
row whose floor mostly failed to show, and where the rows of the image leave a gap longer than they
must: a row is x^2 pitch / h long. The near edge is where floor begins, for nobody saw what is low
and nearer. Bearings without any are closed to a thread, before the first thing.

Source: docs/objects.md, section 8.
"""

import math

import numpy as np

from core.objects.frame.floor import Nine
from core.objects.frame.pixels import FAN_COLUMNS, Fan, Points, fan_cell
from core.objects.frame.voxels import Voxels
from core.objects.records import Floats
from core.records import F32, F64
from jit import kernel, releasing_kernel

GAP_ROWS = 2.5  # rows of the image without a floor pixel that are no gap,
RAISED_ROWS = 1.25  # and behind floor that is raised, for that hides what is behind it
NOWHERE = 1e9  # m
THREAD_M = 0.001  # width of the view where nothing is seen, so that it stays one polygon
SHOWN = 0.5  # of the pixels that should meet a cell's floor must do so
THING_PIXELS = 2  # so many pixels of things end a bearing
LOW_PIXELS = 4  # so many pixels tell a patch's height
LOW_SIGMAS = 3.0
ALIKE = 0.6  # part of a sigma that a whole patch of floor may have in common


@kernel
def _sparse_m(row: int, fan: Fan, across_rad: float, lens_m: float) -> float:
    """Up to where along x counted pixels of a row lie farther apart than a bearing is wide.

    Right below a lens a bearing narrows to a point, pixels do not.
    """
    t, apart = (row + 0.5) * fan.width - fan.half, FAN_COLUMNS * across_rad
    left = fan.width * fan.width - (1.0 + t * t) ** 2 * apart * apart
    return apart * lens_m * math.sqrt((1.0 + t * t) / left) if left > 0.0 else 0.0


@kernel
def _reach(
    row: int, fan: Fan, pitch_over_h: float, low_m: float, sparse_m: float
) -> tuple[float, float]:
    """From where to where along x a bearing's floor is seen.

    Where it is not: from the first thing, or NOWHERE, to 0. A gap nearer than `sparse_m` may be
    one of pixels alone: the view begins behind it.
    """
    near, far, bad, empty, stop, rows = 0.0, 0.0, 0, 0.0, NOWHERE, GAP_ROWS
    for k in range(fan.steps):
        at = row * fan.steps + k
        if fan.things[at] >= THING_PIXELS:
            stop = k * fan.step_m
            if bad == 0 and far > 0.0:
                far = max(far, stop)  # the next row of the image meets the thing
            break
        floor, missing, x = fan.floor[at], fan.missing[at], k * fan.step_m
        if floor == 0 and missing == 0:
            empty += fan.step_m
            if far > 0.0 and empty > max(fan.step_m, rows * x * x * pitch_over_h):
                if x >= sparse_m:
                    break
                far = 0.0
        elif floor < SHOWN * (floor + missing):
            bad += 1
            if bad > 1 and far > 0.0:
                break
        else:
            if far == 0.0:
                near = x + fan.step_m
            bad, empty, far = 0, 0.0, x + fan.step_m
            rows = RAISED_ROWS if fan.height_m[at] >= low_m * floor else GAP_ROWS
    return (near, far) if far > near else (stop, 0.0)


@releasing_kernel
def add_things(voxels: Voxels, count: int, fan: Fan) -> None:
    """Count the pixels of things in the cells over which they stand."""
    for v in range(count):
        at = fan_cell(voxels.x[v], voxels.y[v], fan)
        if at >= 0:
            fan.things[at] += voxels.pixels[v]


@releasing_kernel
def rise_to_rim(units: F32, R: Nine, fan: Fan, rim: F64) -> None:
    """The highest that the image shows at each bearing: z / x above the lens, (bearings,).

    -NOWHERE where no pixel of the image's rim looks that way.

    Args:
        units: (3, rows, columns) of rays; 0: no ray.
        R: from sensor to level, row by row.
    """
    rim[:] = -NOWHERE
    _, rows, columns = units.shape
    for i in range(rows):
        for j in range(0, columns, 1 if i == 0 or i == rows - 1 else columns - 1):
            a, b, c = units[0, i, j], units[1, i, j], units[2, i, j]
            x = R[0] * a + R[1] * b + R[2] * c
            y = R[3] * a + R[4] * b + R[5] * c
            at = fan_cell(x, y, fan)
            if at >= 0:
                row = at // fan.steps
                rim[row] = max(rim[row], (R[6] * a + R[7] * b + R[8] * c) / x)


@releasing_kernel
def reaches(
    fan: Fan, pitches_rad: tuple[float, float], lens_m: float, low_m: float, near: F64, far: F64
) -> None:
    """Where each bearing is seen, along x: (bearings,) m each; 0 and 0 as in `_reach`.

    Args:
        pitches_rad: from a pixel to the next one, across and down.
    """
    across_rad, down_rad = pitches_rad
    for row in range(near.size):
        sparse_m = _sparse_m(row, fan, across_rad, lens_m)
        near[row], far[row] = _reach(row, fan, down_rad / lens_m, low_m, sparse_m)


@kernel
def _around(row: int, step: int, fan: Fan) -> tuple[int, float]:
    """Pixels of floor in a cell and those around it, and the sum of their heights.

    None where one of them has things: what rises there may be their foot.
    """
    count, height = 0, 0.0
    for r in range(max(0, row - 1), min(fan.bearings, row + 2)):
        for k in range(max(0, step - 1), min(fan.steps, step + 2)):
            at = r * fan.steps + k
            if fan.things[at] > 0:
                return 0, 0.0
            count, height = count + fan.floor[at], height + fan.height_m[at]
    return count, height


@releasing_kernel
def low_patches(fan: Fan, low_m: float, noise: tuple[float, float, float], out: F32) -> int:
    """Cells of the fan whose floor is higher than the floor: x, y, height in `out` (n, 3).

    Args:
        noise: noise_m, noise_per_m2 and the lens's height.
    """
    n = 0
    for row in range(fan.bearings):
        for k in range(fan.steps):
            at = row * fan.steps + k
            own = fan.floor[at]
            if own == 0 or fan.height_m[at] < low_m * own:
                continue
            count, total = _around(row, k, fan)
            if count < LOW_PIXELS:
                continue
            x = (k + 0.5) * fan.step_m
            y = x * ((row + 0.5) * fan.width - fan.half)
            r2 = x * x + y * y + noise[2] * noise[2]
            sigma = (noise[0] + noise[1] * r2) * noise[2] / math.sqrt(r2)
            height = max(0.5 * low_m, LOW_SIGMAS * sigma * math.sqrt(ALIKE * ALIKE + 1.0 / count))
            if total >= height * count and n < out.shape[0]:
                out[n, 0], out[n, 1], out[n, 2] = x, y, fan.height_m[at] / own
                n += 1
    return n


@releasing_kernel
def corners_of(patches: F32, count: int, fan: Fan, to: Points) -> int:
    """Corners of the cells of patches as points, from the front: how many."""
    n = 0
    for k in range(count):
        x, y, z = patches[k, 0], patches[k, 1], patches[k, 2]
        for corner in range(4):
            if n == to.x.size:
                return n
            at = x + (corner % 2 - 0.5) * fan.step_m
            to.x[n], to.z[n], to.pixels[n] = at, z, 1
            to.y[n] = at * (y / x + (corner // 2 - 0.5) * fan.width)
            n += 1
    return n


def view_of(near: F64, far: F64, fan: Fan) -> Floats:
    """The polygon (n, 2), level frame, of what bearings see; (0, 2) where none sees any.

    At an edge between two bearings the lesser of both counts, far and near.
    """
    seen = np.flatnonzero(far > near)
    if len(seen) == 0:
        return np.zeros((0, 2))
    first, last = int(seen[0]), int(seen[-1]) + 1
    rows = np.arange(first, last)
    between = np.minimum(np.interp(rows, seen, near[seen]), near[first:last])
    is_seen = far[first:last] > near[first:last]
    inner, outer = np.where(is_seen, near[first:last], between), far[first:last]
    at = np.arange(first, last + 1)
    t = at * fan.width - fan.half
    x_near = np.maximum(np.append(inner, inner[-1]), np.insert(inner, 0, inner[0]))
    x_far = np.minimum(np.append(outer, outer[-1]), np.insert(outer, 0, outer[0]))
    x_far = np.maximum(x_far, x_near + THREAD_M)
    x = np.concatenate([x_near, x_far[::-1]])
    t = np.concatenate([t, t[::-1]])
    # near edge from right to left, far edge back: clockwise seen from above, so turned round
    return np.column_stack([x, x * t])[::-1].copy()


def clear(fan: Fan) -> None:
    """Forget the last frame."""
    for part in (fan.floor, fan.missing, fan.height_m, fan.things):
        part.fill(0)
