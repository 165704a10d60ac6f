"""Pixels of a depth image to points over the floor, each with what it is.

    p = c + k (R a)        k the pixel's number, a its ray, R and c from sensor to level

`level` frame: origin on the floor below the lens, x ahead along the optical axis, z up.
A pixel is flying when it lies between its neighbours on one line and the surface through each
makes less than an angle with the ray: r_0 < r < r_1 and |dr| > min(r) * pitch / tan(angle). So it
is when none of the eight around it can lie on one surface with it.

Source: docs/objects.md, sections 1 and 2; mixed pixels, Tuley et al. 2005, "shadow filter".
"""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from core.records import F32, U8
from jit import kernel, releasing_kernel

I32 = npt.NDArray[np.int32]

NOTHING, FLOOR, THING, PIT, FLYING, HIGH = 0, 1, 2, 3, 4, 5  # what a pixel is
PAIRS = ((1, 0), (0, 1), (1, 1), (1, -1), (2, 0), (0, 2))  # rows, columns: to both sides
APART = 3.0 * math.sqrt(2.0)  # sigmas between two ranges of one surface, at most
SLANT = 10.0  # a surface met at 6 degrees: so much farther apart are its points than pixels are
PAIR_SIGMAS = 3.0 * 1.5**0.5  # of the mean of two ranges against a third
FAN_COLUMNS = 2  # every second column of pixels is enough for the fan


class Limits(NamedTuple):
    """Numbers of a frame, for kernels."""

    min_range_m: float
    max_range_m: float
    noise_m: float
    noise_per_m2: float
    top_m: float
    floor_m: float
    pit_m: float
    steep_across: float  # |dr| / r beside a flying pixel, along a row
    steep_down: float  # and along a column
    lens_m: float  # over the floor
    dense_m: float  # range at which pixels are as far apart as they need be
    cluster_m: float  # nearer points are one surface,
    slant_rad: float  # and those of pixels beside each other, by range


Nine = tuple[float, float, float, float, float, float, float, float, float]
Six = tuple[float, float, float, float, float, float]


class Leveled(NamedTuple):
    """R (3, 3) from sensor to level, and the covariance of the floor, both row by row."""

    R: Nine
    floor: Six  # of height, slope along x, slope along y: 00 01 02 11 12 22


class Points(NamedTuple):
    """Room for the points of a frame; `found` says how many there are."""

    x: F32  # (rows * columns,) m, level
    y: F32
    z: F32
    pixels: U8  # (rows * columns,) for how many pixels a point of a thing stands
    found: I32  # (2,): things from the front, pits from the back


class Fan(NamedTuple):
    """Floor in cells of (y / x, x), so that a row of cells is a bearing."""

    floor: I32  # (bearings * steps,) pixels that met it,
    missing: I32  # that should have, but did not,
    height_m: F32  # sum of their heights
    things: I32  # pixels of things
    bearings: int
    steps: int
    step_m: float  # along x
    width: float  # of a bearing, in y / x
    half: float  # largest |y / x|
    per_step: float  # 1 / step_m, 1 / width
    per_width: float


@kernel
def sigma_m(range_m: float, noise_m: float, noise_per_m2: float) -> float:
    """One sigma of a range."""
    return noise_m + noise_per_m2 * range_m * range_m


@kernel
def _is_between(before: float, here: float, after: float, steep: float) -> bool:
    """Whether a range lies between its neighbours, by a steep step to each."""
    if before == 0.0 or after == 0.0:
        return False
    up, on = here - before, after - here
    least = steep * min(before, after)
    return (up > least and on > least) or (up < -least and on < -least)


@kernel
def fan_cell(x: float, y: float, fan: Fan) -> int:
    """Flat index of the cell of a place, -1 outside."""
    if x <= 0.0:
        return -1
    at = (y / x + fan.half) * fan.per_width
    step = int(x * fan.per_step)
    if at < 0.0 or at >= fan.bearings or step >= fan.steps:
        return -1
    return int(at) * fan.steps + step


@kernel
def _project(units: F32, ranges: F32, i: int, leveled: Leveled, limits: Limits, row: F32) -> None:
    """Directions, points, and the square of three sigmas of their heights, of a row of pixels.

    No branch in it, so that the compiler does several pixels at once.
    """
    r0, r1, r2, r3, r4, r5, r6, r7, r8 = leveled.R
    c00, c01, c02, c11, c12, c22 = leveled.floor
    c01, c02, c12 = 2.0 * c01, 2.0 * c02, 2.0 * c12
    for j in range(ranges.shape[1]):
        a, b, c, r = units[0, i, j], units[1, i, j], units[2, i, j], ranges[i, j]
        dx, dy = r0 * a + r1 * b + r2 * c, r3 * a + r4 * b + r5 * c
        dz = r6 * a + r7 * b + r8 * c
        x, y = r * dx, r * dy
        s = (limits.noise_m + limits.noise_per_m2 * r * r) * dz
        row[0, j], row[1, j], row[2, j], row[3, j] = dx, dy, dz, x
        row[4, j], row[5, j] = y, limits.lens_m + r * dz
        var = s * s + c00 + x * (c01 + c11 * x + c12 * y) + y * (c02 + c22 * y)
        row[6, j] = 9.0 * var


@kernel
def _kind(i: int, j: int, z: float, var: float, ranges: F32, limits: Limits) -> int:
    """What a pixel is, by its height and the square of three sigmas of it."""
    r = ranges[i, j]
    if not limits.min_range_m <= r < limits.max_range_m or r == 0.0:
        return NOTHING
    if z * z <= max(limits.floor_m * limits.floor_m, var):
        return FLOOR if var <= limits.pit_m * limits.pit_m else NOTHING
    if z > limits.top_m:
        return HIGH
    if z > 0.0:
        is_loose = _is_flying(ranges, i, j, limits) or _is_alone(ranges, i, j, limits)
        return FLYING if is_loose else THING
    return PIT if z < -limits.pit_m else NOTHING


@releasing_kernel
def classify(
    units: F32, ranges: F32, leveled: Leveled, limits: Limits, kinds: U8, points: Points,
    fan: Fan, row: F32,
) -> None:  # fmt: skip
    """What each pixel is, and the points of things (from the front) and pits (from the back).

    Args:
        units: (3, rows, columns) unit vectors, sensor frame.
        ranges: (rows, columns) m.
        kinds: (rows, columns), written.
        row: (7, columns), room.
    """
    rows, columns = ranges.shape
    things, pits, last = 0, 0, points.x.size - 1
    for i in range(rows):
        _project(units, ranges, i, leveled, limits, row)
        for j in range(columns):
            z = row[5, j]
            kind = _kind(i, j, z, row[6, j], ranges, limits)
            kinds[i, j] = kind
            if kind == FLOOR:
                if j % FAN_COLUMNS == 0:
                    _count(row[3, j], row[4, j], z, kind, fan)
                continue
            if kind == THING:
                share = _share(i, j, ranges[i, j], limits.dense_m)
                if share > 0:
                    r = _smoothed(ranges, i, j, limits)
                    points.x[things], points.y[things] = r * row[0, j], r * row[1, j]
                    points.z[things] = limits.lens_m + r * row[2, j]
                    points.pixels[things] = share
                    things += 1
            if row[2, j] < 0.0 and (kind == PIT or j % FAN_COLUMNS == 0):
                s = -limits.lens_m / row[2, j]  # where it should have met the floor
                x, y = s * row[0, j], s * row[1, j]
                if kind == PIT:
                    here = last - pits
                    points.x[here], points.y[here], points.z[here] = x, y, 0.0
                    pits += 1
                if j % FAN_COLUMNS == 0:
                    _count(x, y, z, kind, fan)
    points.found[0], points.found[1] = things, pits


@kernel
def _smoothed(ranges: F32, i: int, j: int, limits: Limits) -> float:
    """The mean of a range and of those around it that lie on one surface with it.

    Neighbours count in pairs, one on each side: the mean of a pair lies on any plane, however it
    is turned, and at the rim of a thing only pairs along the rim do. A pair whose mean is further
    off than noise explains is none of this surface.
    """
    rows, columns = ranges.shape
    r: float = ranges[i, j]
    most = PAIR_SIGMAS * sigma_m(r, limits.noise_m, limits.noise_per_m2)
    total, count = r, 1.0
    for k in range(len(PAIRS)):
        di, dj = PAIRS[k]
        if i < di or i + di >= rows or j < abs(dj) or j + abs(dj) >= columns:
            continue
        a, b = ranges[i - di, j - dj], ranges[i + di, j + dj]
        if a > 0.0 and b > 0.0 and abs(0.5 * (a + b) - r) <= most:
            total, count = total + a + b, count + 2.0
    return total / count


@kernel
def _share(i: int, j: int, range_m: float, dense_m: float) -> int:
    """For how many pixels this one stands; 0: another one near it does.

    Near ones are denser than voxels need. Of those kept, some lie on every row, every column and
    every diagonal, so that nothing thin falls between them.
    """
    if range_m * 2.236 < dense_m:  # a knight's move apart
        return 5 if (i + 2 * j) % 5 == 0 else 0
    if range_m * 1.414 < dense_m:  # a chessboard
        return 2 if (i + j) % 2 == 0 else 0
    return 1


@kernel
def _is_flying(ranges: F32, i: int, j: int, limits: Limits) -> bool:
    """Whether a pixel lies between those beside it, or between those over and under it."""
    rows, columns = ranges.shape
    r = ranges[i, j]
    if 0 < j < columns - 1 and _is_between(
        ranges[i, j - 1], r, ranges[i, j + 1], limits.steep_across
    ):
        return True
    return 0 < i < rows - 1 and _is_between(
        ranges[i - 1, j], r, ranges[i + 1, j], limits.steep_down
    )


@kernel
def _is_alone(ranges: F32, i: int, j: int, limits: Limits) -> bool:
    """Whether none of the pixels around one may lie on one surface with it.

    At the edge of a thing before what is out of reach, a mixed range may be any.
    """
    rows, columns = ranges.shape
    r: float = ranges[i, j]
    if j > 0 and abs(ranges[i, j - 1] - r) <= limits.cluster_m:
        return False  # nearly all
    noise = APART * sigma_m(r, limits.noise_m, limits.noise_per_m2)
    most = max(limits.cluster_m, noise, limits.slant_rad * r)
    for a in range(max(0, i - 1), min(rows, i + 2)):
        for b in range(max(0, j - 1), min(columns, j + 2)):
            if (a != i or b != j) and abs(ranges[a, b] - r) <= most:
                return False
    return True


@kernel
def _count(x: float, y: float, z: float, kind: int, fan: Fan) -> None:
    """Note a pixel of the floor, or one that should have been."""
    at = fan_cell(x, y, fan)
    if at < 0:
        return
    if kind == FLOOR:
        fan.floor[at] += 1
        fan.height_m[at] += z
    else:
        fan.missing[at] += 1
