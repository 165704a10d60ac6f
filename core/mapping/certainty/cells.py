"""Elevation and certainty of each cell, by the readings of one scan after the other.

The readings of a scan in one cell are one pass: z is the highest of them, L its plausibility limit,
k how many lie within L below it. With h_ref and c of the cell as they were before the scan:

    (9)   c' = min(c + a k, most)    where c = 0 or |z - h_ref| <= L
          c' = 0                     else: what was there and what was read disagree
    (10)  h' = z                     where c = 0, or 0 < z - h_ref <= L
          h' = h_ref                 where -L <= z - h_ref <= 0
          none                       where c' = 0

So a cell that was reset is unknown, until another scan reads it. The paper's own wording was not to
be had; that a scan counts at once, by its highest reading, and that a reset forgets the height, are
our reading. The lowest reading since then is ours: the highest alone would hide a drop at whose
edge a cell lies. Refuses to know of obstacles.
Source: docs/certainty.md.
"""

import math
from typing import NamedTuple

from core.grid.places import Ring, cell_at, index_of, world_cell
from core.grid.touched import Touched, touch
from core.mapping.body import BodyPose
from core.records import F64, I32, U8
from jit import kernel

RESET, CORRUPT = 1, 2  # marks of a cell: reset by the last scan that met it; by the filter


class Rules(NamedTuple):
    """From the settings."""

    gain: int  # a of (9)
    most: int  # certainty never grows beyond
    free_from: int  # flat ground of this certainty is free
    cas: bool
    cas_certainty: int  # C and
    cas_height_m: float  # H of the filter
    h_pos_m: float
    h_neg_m: float
    height_m: float  # of the robot


class Cells(NamedTuple):
    """The map, flat, as kernels are given it."""

    height_m: F64  # map frame; NaN exactly where certainty is 0
    low_m: F64  # the lowest reading since it was that; NaN likewise
    certainty: I32
    marks: U8
    seen_s: F64  # when each was met or stood on
    ring: Ring


class Pass(NamedTuple):
    """What one scan says of the cells it met."""

    met: Touched  # its `said` is the highest reading
    low_m: F64  # the lowest, by slot of `met`
    limit_m: F64  # of the highest, by slot
    agree: I32  # how many readings are near that one, by slot


@kernel
def over_ground_m(x: float, y: float, z: float, body: BodyPose) -> tuple[float, float]:
    """How high a place of the map lies over the ground, least and most.

    It goes on level from where the robot stands, or along the plane on which its body stands, which
    is another one where the body leans.
    """
    level = z - body.z_m
    along = level - body.slopes[0] * (x - body.x_m) - body.slopes[1] * (y - body.y_m)
    return min(level, along), max(level, along)


@kernel
def gather(
    points: F64, limits_m: F64, kept: U8, body: BodyPose, rules: Rules, ring: Ring, one: Pass
) -> int:
    """Sort readings (n, 3), map frame, into cells; how many of those kept fell into the map.

    What hangs higher than the robot is none.
    """
    met, used = one.met, 0
    met.used[0] = 0
    for turn in range(2):  # the highest first, then who agrees with it
        for k in range(kept.size):
            if kept[k] == 0:
                continue
            x, y, z = points[k]
            at = cell_at(x, y, ring)
            if at < 0 or over_ground_m(x, y, z, body)[0] > rules.height_m:
                continue
            before = met.used[0]
            slot = touch(at, met)
            if turn == 0:
                used += 1
                is_first = met.used[0] > before
                one.low_m[slot] = z if is_first else min(z, one.low_m[slot])
                if is_first or z > met.said[slot]:
                    met.said[slot], one.limit_m[slot], one.agree[slot] = z, limits_m[k], 0
            elif z >= met.said[slot] - one.limit_m[slot]:
                one.agree[slot] += 1
    return used


@kernel
def update(one: Pass, t_s: float, cells: Cells, rules: Rules) -> None:
    """(9) and (10), for each cell that a scan met."""
    met = one.met
    for slot in range(met.used[0]):
        at = met.at[slot]
        off_m = met.said[slot] - cells.height_m[at]
        is_new = cells.certainty[at] == 0
        cells.seen_s[at] = max(cells.seen_s[at], t_s)
        cells.marks[at] = 0
        if is_new or abs(off_m) <= one.limit_m[slot]:
            more = min(rules.gain * one.agree[slot], rules.most)
            cells.certainty[at] = min(cells.certainty[at] + more, rules.most)
            if is_new or off_m > 0.0:
                cells.height_m[at] = met.said[slot]
            low_m = one.low_m[slot]
            cells.low_m[at] = low_m if is_new else min(low_m, cells.low_m[at])
        else:
            cells.certainty[at], cells.marks[at] = 0, RESET
            cells.height_m[at] = cells.low_m[at] = math.nan


@kernel
def widen(inner: Touched, ring: Ring, outer: Touched) -> None:
    """Fill `outer` with cells and their neighbours."""
    outer.used[0] = 0
    for k in range(inner.used[0]):
        i, j = world_cell(inner.at[k], ring)
        for n in range(9):
            near = index_of(i + n % 3 - 1, j + n // 3 - 1, ring)
            if near >= 0:
                touch(near, outer)
