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

from core.records import F32, U8, U16
from jit import kernel, releasing_kernel

I32 = npt.NDArray[np.int32]

NOTHING, FLOOR, THING, PIT, FLYING, HIGH = 0, 1, 2, 3, 4, 5  # what a pixel is
PAIRS = ((1, 0), (0, 1), (1, 1), (1, -1), (2, 0), (0, 2))  # rows, columns: to both sides
APART = 3.0 * math.sqrt(2.0)  # sigmas between two ranges of one surface, at most
SLANT = 10.0  # a surface met at 6 degrees: so much farther apart are its points than pixels are
PAIR_SIGMAS = 3.0 * 1.5**0.5  # of the mean of two ranges against a third
RIM, BEYOND_M = 2, -1e9  # pixels around an image, and their ranges: none, and near none
GATE = 3.0  # sigmas
LEAST = 1e-9  # of a ray's way ahead, or down, in a metre: so nothing is divided by 0
FAN_COLUMNS = 2  # every second column of pixels is enough for the fan


class Limits(NamedTuple):
    """Numbers of a frame, for kernels: in single precision, as ranges are, so that they stay it.

    A point is then right to a micrometre, and twice as many pixels go through a processor at once.
    """

    min_range_m: np.float32
    max_range_m: np.float32
    noise_m: np.float32
    noise_per_m2: np.float32
    top_m: np.float32
    floor_m: np.float32
    pit_m: np.float32
    steep_across: np.float32  # |dr| / r beside a flying pixel, along a row
    steep_down: np.float32  # and along a column
    lens_m: np.float32  # over the floor
    dense_m: np.float32  # range at which pixels are as far apart as they need be
    cluster_m: np.float32  # nearer points are one surface,
    slant_rad: np.float32  # and those of pixels beside each other, by range


class Leveled(NamedTuple):
    """From sensor to level, and how sure the floor is."""

    R: tuple[np.float32, ...]  # (3, 3), row by row
    # the square of three sigmas of the floor's height at (x, y):
    # g0 + g1 x + g2 y + g3 x^2 + g4 x y + g5 y^2
    gate2: tuple[np.float32, ...]


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


class Row(NamedTuple):
    """Room for one row of pixels, (columns,) each."""

    dx: F32  # of its rays, unit vectors, level
    dy: F32
    dz: F32
    x: F32  # m, level
    y: F32
    z: F32
    gate2: F32  # m2, of three sigmas of z
    loose: U8  # 1: flying, should it be of a thing
    cell: I32  # of the fan


@kernel
def sigma_m(range_m: float, noise_m: float, noise_per_m2: float) -> float:
    """One sigma of a range."""
    return noise_m + noise_per_m2 * range_m * range_m


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


@releasing_kernel
def measure(numbers: U16, per_unit: F32, most_m: float, padded: F32) -> None:
    """Ranges of an image's numbers (rows, columns), at most so far, into the middle of `padded`."""
    most = np.float32(most_m)
    for i in range(numbers.shape[0]):
        given, per, here = numbers[i], per_unit[i], padded[i + RIM, RIM:]
        for j in range(given.size):
            here[j] = min(np.float32(given[j]) * per[j], most)


@kernel
def _project(units: F32, padded: F32, i: int, leveled: Leveled, limits: Limits, row: Row) -> None:
    """Directions, points, and the square of three sigmas of their heights, of a row of pixels."""
    r0, r1, r2, r3, r4, r5, r6, r7, r8 = leveled.R
    g0, g1, g2, g3, g4, g5 = leveled.gate2
    noise, per_m2 = np.float32(GATE * limits.noise_m), np.float32(GATE * limits.noise_per_m2)
    ahead, left, up, here = units[0, i], units[1, i], units[2, i], padded[i + RIM, RIM:]
    for j in range(row.x.size):
        a, b, c, r = ahead[j], left[j], up[j], here[j]
        dx, dy = r0 * a + r1 * b + r2 * c, r3 * a + r4 * b + r5 * c
        dz = r6 * a + r7 * b + r8 * c
        x, y = r * dx, r * dy
        s = (noise + per_m2 * r * r) * dz
        row.dx[j], row.dy[j], row.dz[j], row.x[j], row.y[j] = dx, dy, dz, x, y
        row.z[j] = limits.lens_m + r * dz
        row.gate2[j] = s * s + g0 + x * (g1 + g3 * x + g4 * y) + y * (g2 + g5 * y)


@kernel
def _find_loose(padded: F32, i: int, limits: Limits, loose: U8) -> None:
    """Which pixels of a row (columns,) are flying: 1, else 0.

    Those between what is beside, or over and under them, by a steep step to each; and those alone,
    for none of the eight around may lie on one surface with them. At the edge of a thing before
    what is out of reach, a mixed range may be any.
    """
    across, down = limits.steep_across, limits.steep_down
    near, slant = limits.cluster_m, limits.slant_rad
    noise, per_m2 = np.float32(APART * limits.noise_m), np.float32(APART * limits.noise_per_m2)
    first = RIM - 1  # the column before that of pixel 0
    above, below = padded[i + RIM - 1, first:], padded[i + RIM + 1, first:]
    here = padded[i + RIM, first:]
    for j in range(loose.size):
        r, a, b, c, d = here[j + 1], here[j], here[j + 2], above[j + 1], below[j + 1]
        least = across * min(a, b)
        is_between = (min(r - a, b - r) > least) | (max(r - a, b - r) < -least)
        is_flying = is_between & (min(a, b) > 0.0)
        least = down * min(c, d)
        is_between = (min(r - c, d - r) > least) | (max(r - c, d - r) < -least)
        is_flying |= is_between & (min(c, d) > 0.0)
        beside = min(min(abs(a - r), abs(b - r)), min(abs(c - r), abs(d - r)))
        over = min(abs(above[j] - r), abs(above[j + 2] - r))
        under = min(abs(below[j] - r), abs(below[j + 2] - r))
        most = max(max(near, noise + per_m2 * r * r), slant * r)
        loose[j] = is_flying | (min(beside, min(over, under)) > most)


@kernel
def _sort(padded: F32, i: int, row: Row, limits: Limits, kinds: U8) -> None:
    """What each pixel of a row is, by its range, its height and the three sigmas of that.

    Args:
        kinds: (columns,), written.
    """
    floor2, pit2 = limits.floor_m * limits.floor_m, limits.pit_m * limits.pit_m
    here = padded[i + RIM, RIM:]
    for j in range(kinds.size):
        r, z, gate2 = here[j], row.z[j], row.gate2[j]
        thing = HIGH if z > limits.top_m else (FLYING if row.loose[j] else THING)
        lower = PIT if z < -limits.pit_m else NOTHING
        floor = FLOOR if gate2 <= pit2 else NOTHING
        kind = floor if z * z <= max(floor2, gate2) else (thing if z > 0.0 else lower)
        is_measured = (r >= limits.min_range_m) & (r < limits.max_range_m) & (r != 0.0)
        kinds[j] = kind if is_measured else NOTHING


@kernel
def _collect(padded: F32, i: int, row: Row, kinds: U8, limits: Limits, points: Points) -> None:
    """Points of a row's things, and where the floor should have been of its pits."""
    things, pits, last = points.found[0], points.found[1], points.x.size - 1
    for j in range(kinds.size):
        if kinds[j] == THING:
            share = _share(i, j, padded[i + RIM, j + RIM], float(limits.dense_m))
            if share > 0:
                r = _smoothed(padded, i, j, limits)
                points.x[things], points.y[things] = r * row.dx[j], r * row.dy[j]
                points.z[things] = limits.lens_m + r * row.dz[j]
                points.pixels[things] = share
                things += 1
        elif kinds[j] == PIT and row.dz[j] < 0.0:
            s, here = -limits.lens_m / row.dz[j], last - pits
            points.x[here], points.y[here], points.z[here] = s * row.dx[j], s * row.dy[j], 0.0
            pits += 1
    points.found[0], points.found[1] = things, pits


@kernel
def _find_cells(row: Row, kinds: U8, lens_m: np.float32, fan: Fan) -> None:
    """The fan's cell, in `row.cell`, of where each pixel of a row met the floor, or should have.

    -1: neither, or not in the fan.
    """
    half, least = np.float32(fan.half), np.float32(LEAST)
    per_width, per_step = np.float32(fan.per_width), np.float32(fan.per_step)
    bearings, steps, nowhere = np.float32(fan.bearings), np.int32(fan.steps), np.int32(-1)
    for j in range(kinds.size):
        is_floor, dx, dz = kinds[j] == FLOOR, row.dx[j], row.dz[j]
        x = row.x[j] if is_floor else lens_m * dx / max(-dz, least)
        at, step = (row.dy[j] / max(dx, least) + half) * per_width, x * per_step
        is_in = (is_floor | (dz < 0.0)) & (x > 0.0) & (at >= 0.0) & (at < bearings) & (step < steps)
        cell = np.int32(at if is_in else half) * steps + np.int32(step if is_in else half)
        row.cell[j] = cell if is_in else nowhere


@kernel
def _count(row: Row, kinds: U8, fan: Fan) -> None:
    """Note every n-th pixel of a row in its cell: as one of the floor, or one that it lacks."""
    for j in range(0, kinds.size, FAN_COLUMNS):
        at = row.cell[j]
        if at < 0:
            continue
        if kinds[j] == FLOOR:
            fan.floor[at] += 1
            fan.height_m[at] += row.z[j]
        else:
            fan.missing[at] += 1


@releasing_kernel
def classify(
    units: F32, padded: F32, leveled: Leveled, limits: Limits, kinds: U8, points: Points,
    fan: Fan, row: Row,
) -> None:  # fmt: skip
    """What each pixel is, and the points of things (from the front) and pits (from the back).

    Row by row, and where most pixels need it without a branch: so the compiler does several at
    once, and what a row needs stays in the cache.

    Args:
        units: (3, rows, columns) unit vectors, sensor frame.
        padded: (rows + 2 RIM, columns + 2 RIM) m, ranges within a rim of BEYOND_M.
        kinds: (rows, columns), written.
    """
    points.found[0], points.found[1] = 0, 0
    for i in range(kinds.shape[0]):
        _project(units, padded, i, leveled, limits, row)
        _find_loose(padded, i, limits, row.loose)
        _sort(padded, i, row, limits, kinds[i])
        _collect(padded, i, row, kinds[i], limits, points)
        _find_cells(row, kinds[i], limits.lens_m, fan)
        _count(row, kinds[i], fan)


@kernel
def _smoothed(padded: F32, i: int, j: int, limits: Limits) -> np.float32:
    """The mean of a range and of those around it that lie on one surface with it.

    Neighbours count in pairs, one on each side: the mean of a pair lies on any plane, however it
    is turned, and at the rim of a thing only pairs along the rim do. A pair whose mean is further
    off than noise explains is none of this surface. Which these are no processor foresees, so
    there is no branch.
    """
    zero, half, one, two = np.float32(0.0), np.float32(0.5), np.float32(1.0), np.float32(2.0)
    i, j = i + RIM, j + RIM
    r = padded[i, j]
    most = np.float32(PAIR_SIGMAS) * (limits.noise_m + limits.noise_per_m2 * r * r)
    total, count = r, one
    for k in range(len(PAIRS)):
        a, b = padded[i - PAIRS[k][0], j - PAIRS[k][1]], padded[i + PAIRS[k][0], j + PAIRS[k][1]]
        is_same = (min(a, b) > zero) & (abs(half * (a + b) - r) <= most)
        total += a + b if is_same else zero
        count += two if is_same else zero
    mean: np.float32 = total / count
    return mean


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
