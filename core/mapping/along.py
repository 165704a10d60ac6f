"""Where a beam passes: places a step apart, others in each scan.

So the cost of following a beam grows with neither the window nor the fineness of the cells, and
some scans together leave nothing out. All places of a beam come first and what lies there second:
the compiler then works out eight places at once.
"""

import math

import numpy as np

from core.grid.places import Ring
from core.mapping.rays import MIN_RANGE_M
from core.records import F64, I32
from jit import kernel

STEP_M, REACH_M = 0.2, 15.0  # between the places of a beam; from the lens
GOLDEN = 0.6180339887498949  # spreads the places evenly over scans and beams
MOST_PLACES = 1 + round(REACH_M / STEP_M)
OUTSIDE = np.int32(-1)


@kernel
def share_of(b: int, serial: int) -> float:
    """Which part of a step a beam's first place lies off in a scan: 0..1, evenly spread."""
    turns = b * GOLDEN + serial * GOLDEN * GOLDEN
    return turns - math.floor(turns)


@kernel
def first_place_m(b: int, serial: int) -> float:
    """Range of a beam's first place in a scan."""
    return MIN_RANGE_M + share_of(b, serial) * STEP_M


@kernel
def places_along(lens: F64, ray: F64, first_m: float, end_m: float, ring: Ring, at: I32) -> int:
    """How many places a beam has before a range, one each STEP_M; fills `at` with their cells.

    at: (MOST_PLACES,) flat indices; OUTSIDE of the window.
    """
    cell_m = ring.cell_m
    count = max(0, math.ceil((min(end_m, REACH_M) - first_m) / STEP_M))
    # in cells, from the corner; whole ones in 32 bits, of which eight are worked out at once
    x, y = (lens[0] + first_m * ray[0]) / cell_m, (lens[1] + first_m * ray[1]) / cell_m
    x, y, dx, dy = (
        x - ring.corner_i,
        y - ring.corner_j,
        STEP_M * ray[0] / cell_m,
        STEP_M * ray[1] / cell_m,
    )
    edge, turn = np.float64(ring.size), np.int32(ring.size)
    first_i, first_j = np.int32(ring.turn_i), np.int32(ring.turn_j)
    for k in range(count):
        u, v = x + k * dx, y + k * dy
        is_inside = (u >= 0.0) & (v >= 0.0) & (u < edge) & (v < edge)
        i, j = np.int32(u) + first_i, np.int32(v) + first_j
        i, j = i - turn if i >= turn else i, j - turn if j >= turn else j
        at[k] = j * turn + i if is_inside else OUTSIDE
    return count
