"""What of a frame's pixels the obstacle map gets: some rays, and the points that bar the way.

An image is parted into blocks, and each gives one ray at most: to the nearest pixel of a thing,
else to one of a pit, else to one of the floor. So no thing falls between the rays that are kept.
A pixel that is flying, too high or no measurement gives none. A block that lacks floor where it is
due tells that what lies beside it may end within a cell: so floor beside it gives no ray either.
Source: design, section 10; docs/objects.md, section 2.
"""

import math
from typing import NamedTuple

import numpy as np

from core.objects.frame.floor import Floor
from core.objects.frame.pixels import FLOOR, I32, NOTHING, PIT, THING
from core.objects.frame.room import Room
from core.records import F32, F64, U8
from jit import kernel, releasing_kernel

LACKS = 0.2  # share of a block's pixels that lack floor: a brink, or black
SEVERAL = 2  # pixels of a block that must agree, where it has more than one


class Evidence(NamedTuple):
    """Of one frame, sensor frame."""

    directions: F32  # (n, 3) unit vectors
    ranges_m: F32  # (n,)
    standing_m: F64  # (k, 3) from the lens: of things that bar the way, the nearest of each block


@kernel
def _rise(units: F32, i: int, j: int, up: tuple[float, float, float]) -> float:
    """By how much a pixel's ray rises in a metre."""
    return float(up[0] * units[0, i, j] + up[1] * units[1, i, j] + up[2] * units[2, i, j])


@kernel
def _find_due(
    units: F32, kinds: U8, i: int, up: tuple[float, float, float], least: float, due: U8
) -> None:
    """Which pixels of a row lack floor, and fall by so much in a metre that it is due: 1 in `due`.

    In single precision and without a branch, so that the compiler does several at once.
    """
    ux, uy, uz, most = np.float32(up[0]), np.float32(up[1]), np.float32(up[2]), np.float32(-least)
    x, y, z, kind = units[0, i], units[1, i], units[2, i], kinds[i]
    for j in range(due.size):
        lacks = (kind[j] == NOTHING) | (kind[j] == PIT)
        due[j] = lacks & (ux * x[j] + uy * y[j] + uz * z[j] < most)


@releasing_kernel
def _find_lacking(
    units: F32, kinds: U8, up: tuple[float, float, float], least: float, edge: int, due: U8,
    counts: I32, lacks: U8,
) -> None:  # fmt: skip
    """Which blocks lack floor that is due, and those beside them: 1 in `lacks`.

    Args:
        least: floor is due where a ray falls by more in a metre.
        due, counts: room, (columns,) and (blocks along a row,).
    """
    rows, columns = kinds.shape
    lacks[...] = 0
    for i in range(0, rows, edge):
        counts[:] = 0
        for a in range(i, min(i + edge, rows)):
            _find_due(units, kinds, a, up, least, due)
            for n in range(counts.size):
                for j in range(n * edge, min((n + 1) * edge, columns)):
                    counts[n] += due[j]
        for n in range(counts.size):
            whole = (min(i + edge, rows) - i) * (min((n + 1) * edge, columns) - n * edge)
            if counts[n] <= LACKS * whole:
                continue
            k = i // edge
            for a in range(max(0, k - 1), min(k + 2, lacks.shape[0])):
                for b in range(max(0, n - 1), min(n + 2, lacks.shape[1])):
                    lacks[a, b] = 1


@kernel
def _pick(
    units: F32, ranges: F32, kinds: U8, up: tuple[float, float, float], lens_m: float, edge: int,
    bars: tuple[float, float], i: int, j: int, is_lacking: bool,
) -> tuple[int, int]:  # fmt: skip
    """Of the block at row i, column j the pixel for a ray, and the nearest that bars the way.

    Flat indices, -1: none. Floor is not told where the block is lacking.
    """
    rows, columns = ranges.shape
    least = SEVERAL if edge > 1 else 1
    things = pits = tall = 0
    thing = pit = ground = high = -1  # flat: nearest, last, in the middle, nearest tall one
    near_m, tall_m, off = np.float32(math.inf), np.float32(math.inf), 4 * edge
    for a in range(i, min(i + edge, rows)):
        for b in range(j, min(j + edge, columns)):
            here, kind, r = a * columns + b, kinds[a, b], ranges[a, b]
            if kind == THING:
                things += 1
                if r < near_m:
                    near_m, thing = r, here
                if tall >= least and r >= tall_m:
                    continue  # most of them: there are enough, and nearer ones
                if bars[0] <= lens_m + r * _rise(units, a, b, up) <= bars[1]:
                    tall += 1
                    if r < tall_m:
                        tall_m, high = r, here
            elif kind == PIT:
                pits += 1
                pit = here
            elif kind == FLOOR and not is_lacking:
                away = abs(2 * (a - i) + 1 - edge) + abs(2 * (b - j) + 1 - edge)
                if away < off:
                    off, ground = away, here
    best = thing if things >= least else (pit if pits >= least else ground)
    return best, high if tall >= least else -1


@releasing_kernel
def _gather(
    units: F32, ranges: F32, kinds: U8, up: tuple[float, float, float], lens_m: float, edge: int,
    bars: tuple[float, float], lacks: U8, rays: F32, standing: F64,
) -> tuple[int, int]:  # fmt: skip
    """Fills rays (n, 4), direction and range, and standing (n, 3); returns how many of each.

    Args:
        up: unit vector, sensor frame, and `lens_m` over the floor.
        edge: of a block, pixels.
        bars: from one height above the floor to another a thing bars the way.
        lacks: by blocks, 1: floor of it is not told.
    """
    rows, columns = ranges.shape
    count = points = 0
    for i in range(0, rows, edge):
        for j in range(0, columns, edge):
            is_lacking = lacks[i // edge, j // edge] == 1
            best, high = _pick(
                units, ranges, kinds, up, lens_m, edge, bars, i, j, is_lacking
            )  # fmt: skip
            if best >= 0 and count < rays.shape[0]:
                a, b = best // columns, best % columns
                for n in range(3):
                    rays[count, n] = units[n, a, b]
                rays[count, 3] = ranges[a, b]
                count += 1
            if high >= 0 and points < standing.shape[0]:
                a, b = high // columns, high % columns
                for n in range(3):
                    standing[points, n] = ranges[a, b] * units[n, a, b]
                points += 1
    return count, points


def evidence_of(
    room: Room, seen: Floor, most_rays: int, bars_m: tuple[float, float], far_m: float
) -> Evidence:
    """Of the newest frame, whose pixels are sorted.

    Args:
        seen: its floor.
        bars_m: from one height above the floor to another a thing bars the way.
        far_m: ranges beyond it are not measured.
    """
    rows, columns = room.ranges.shape
    edge = max(1, math.ceil(math.sqrt(rows * columns / most_rays)))
    while math.ceil(rows / edge) * math.ceil(columns / edge) > most_rays:
        edge += 1
    rays, standing = np.empty((most_rays, 4), np.float32), np.empty((most_rays, 3))
    x, y, z = seen.normal_sensor.tolist()
    up, lens_m = (x, y, z), float(seen.height_m)
    lacks: U8 = np.zeros((math.ceil(rows / edge), math.ceil(columns / edge)), np.uint8)
    due, counts = np.zeros(columns, np.uint8), np.zeros(lacks.shape[1], np.int32)
    _find_lacking(room.units, room.kinds, up, lens_m / far_m, edge, due, counts, lacks)
    count, points = _gather(
        room.units, room.ranges, room.kinds, up, lens_m, edge, bars_m, lacks, rays, standing
    )  # fmt: skip
    return Evidence(rays[:count, :3].copy(), rays[:count, 3].copy(), standing[:points].copy())
