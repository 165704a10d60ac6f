"""What method `surface` keeps of a cell, and its model of terrain: ground by that around it.

    ground = ground_m - s_p arm_m - s_r aside_m     s: what the attitude is always off by
    var(d) = var + BEND^2 d min(CARRY_M, d)         of ground d metres from where it is known

Source: docs/method.md, section 2; Kalman elevation cells, Fankhauser et al. 2014.
"""

import math
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from core.grid.places import Ring, from_centre, index_of
from core.grid.touched import Touched
from core.mapping.along import MOST_PLACES
from core.mapping.body import BodyPose
from core.mapping.plane_fit import NO_POINTS, plane_of_sums, with_point
from core.mapping.surface.constants import *
from core.motion.kalman import Information
from core.records import F64, I32, U8
from jit import Record, Records, fields, kernel, records

Cells = npt.NDArray[Any]  # flat, of CELL

CELL = np.dtype(
    [
        ("floor_s", np.float64),  # when floor was seen last
        ("ground_m", np.float32),  # at the centre: measured, or expected while looks is 0
        ("var_m2", np.float32),  # its variance; inf: nothing known
        ("arm_m", np.float32),  # how far ahead it was seen, and how far had been driven
        ("aside_m", np.float32),
        ("slope_x", np.float32),  # of the ground through it
        ("slope_y", np.float32),
        # over the ground, so that they move with it:
        ("floor_m", np.float32),  # lowest floor seen in it; while looks is 0, floor seen beyond it
        ("low_m", np.float32),  # lowest and highest return of what is no floor
        ("top_m", np.float32),
        ("under_m", np.float32),  # a beam was so low here: the ground can't be higher; inf: none
        ("stands", np.float32),  # log-odds that something stands here,
        ("soft", np.float32),  # and that it lets beams in
        ("parts", np.uint32),  # a bit each where floor was seen; above, where a beam was under it
        ("looks", np.uint16),  # scans that saw its floor
        ("tied", np.uint8),  # LOOSE, TIED or APART
    ],
    align=True,
)
LOOSE, TIED, APART = 0, 1, 2  # ground: not known to be reached; reached without a step; beyond one
BLANK = np.zeros((), dtype=CELL)
BLANK[["var_m2", "floor_m", "low_m", "under_m"]] = math.inf
BLANK[["floor_s", "top_m"]] = -math.inf
MOST_LOOKS = 0xFFFF  # more are not counted
PART_BITS, ALL_PARTS = 16, 0xFFFF  # of floor, below those of beams under it; `ones` counts these

PLANES = 32  # blocks of cells along an edge, whose planes are kept for the rest of a scan
PLANE = np.dtype(
    [
        *fields(np.int64, "block_i block_j held"),  # whose, and when it was worked out
        *fields(np.int64, "i j"),  # about which cell of it
        *fields(np.float64, "z_m slope_x slope_y var_m2 seen_s"),  # as in `Plane`
        *fields(np.int64, "tied is_before"),
    ]
)
STATES = 5  # of a sweep's error: height, pitch, roll; pitch and roll always
# scans, and echoes of all, held against the ground; 1 once some of it is tied to that under the
# wheels; height on which the robot stands
NOW = np.dtype([*fields(np.int64, "scan held anchored"), ("wheels_m", np.float64)])


class Limits(NamedTuple):
    """From the settings."""

    h_pos_m: float
    h_neg_m: float
    height_m: float  # of the robot
    soft_m: float  # so high, soft things may be free; 0: never
    guess_m2: float  # variance of ground that is a guess
    sure_m2: float  # ground less sure is set by what most returns agree on
    wheels_m2: float  # most variance of the plane on which the robot stands
    floor_says: float  # vote of floor where nothing stands
    sigma_m: float  # of a range, near; far, a share of it
    sigma_share: float
    noise_m2: float  # of the height of a return from level ground
    far_m: float  # how far ahead level ground is met
    is_plane: bool  # the scanner's beams lie in one
    rises: float  # ground that rises more towards the robot is none
    parts: int  # of a cell, along its edge,
    row: int  # and in so many of all, floor may be on one side of a ditch alone
    block: int  # cells along the edge of a block, whose ground is worked out at once


class Room(NamedTuple):
    """What a scan is worked out in; nothing in it outlives the scan."""

    planes: Records  # (PLANES * PLANES,)
    told: Information  # of the sweep's error, by the witnesses
    P: F64  # (5, 5) its covariance with that
    gone: F64  # (5,) how far it has moved since the returns were held against the ground
    h: F64  # (5,) how a place seen again differs by each state
    bins: F64  # (BINS,) in which returns over a guess are counted
    places: I32  # (MOST_PLACES,) those of a beam

    @classmethod
    def none(cls) -> "Room":
        """With nothing in it."""
        planes, places = records(PLANE, PLANES * PLANES), np.zeros(MOST_PLACES, np.int32)
        told, (gone, h) = Information.of(STATES), np.zeros((2, STATES))
        return cls(planes, told, np.zeros((STATES, STATES)), gone, h, np.zeros(BINS), places)


class Surface(NamedTuple):
    """The map and all else that a scan works with, as kernels are given it."""

    cells: Cells
    tall: U8  # (cells,) whether something stands in a cell: few bytes for beams to look at
    seen_s: F64  # (cells,) when a beam met or passed one last,
    oldest_s: float  # and what is too old to be passed: floor must be met again
    ring: Ring
    limits: Limits
    stand: BodyPose  # where and how the robot stands
    own: F64  # (5,) error of the newest sweep, its STATES
    P: F64  # (5, 5) its covariance
    touched: Touched
    now: Records  # (1,) of NOW
    uppers: Records  # (cells,) of `core.mapping.heights.upper`, or none: see there
    room: Room


class Plane(NamedTuple):
    """Ground about a place, and how well it is known."""

    z_m: float
    slope_x: float
    slope_y: float
    var_m2: float  # inf: not at all
    seen_s: float
    tied: int
    is_before: bool  # some of what tells it lies nearer to the robot


NOWHERE = Plane(0.0, 0.0, 0.0, math.inf, -math.inf, LOOSE, False)


@kernel
def ground_of(cell: Record, own: F64) -> float:
    """Height of the ground at a cell's centre."""
    return float(cell.ground_m - own[3] * cell.arm_m - own[4] * cell.aside_m)


@kernel
def height_over(cell: Record, x: float, y: float, z: float, surface: Surface) -> float:
    """How high a point of a cell lies over its ground, which is as steep as that around it."""
    dx, dy = from_centre(x, surface.ring.cell_m), from_centre(y, surface.ring.cell_m)
    return float(z - ground_of(cell, surface.own) - (cell.slope_x * dx + cell.slope_y * dy))


@kernel
def grown(var: float, far_m: float) -> float:
    """Variance of ground so far from where it is known, by how terrain bends on the way."""
    return var + BEND * BEND * far_m * min(CARRY_M, far_m)


@kernel
def plane_of(cell: Record, z: float, var: float) -> Plane:
    """The ground of a measured cell, in all bits, at a height and as well known as is said."""
    slope_x, slope_y, tied = np.float64(cell.slope_x), np.float64(cell.slope_y), np.int64(cell.tied)
    return Plane(z, slope_x, slope_y, var, cell.floor_s, int(tied), True)


@kernel
def plane_at(i: int, j: int, surface: Surface) -> Plane:
    """The ground at the centre of a world cell, by the measured ground around it.

    It is worked out once a scan for all cells of a block: about the one that is asked for first.
    """
    block, held, cell_m = surface.limits.block, surface.now[0].held, surface.ring.cell_m
    block_i, block_j = (i // block, j // block) if block > 1 else (i, j)
    one = surface.room.planes[block_j % PLANES * PLANES + block_i % PLANES]
    if one.held != held or one.block_i != block_i or one.block_j != block_j:
        one.held, one.block_i, one.block_j = held, block_i, block_j
        _fit(one, i, j, surface)
    z = one.z_m + one.slope_x * ((i - one.i) * cell_m) + one.slope_y * ((j - one.j) * cell_m)
    is_before = one.is_before > 0
    return Plane(z, one.slope_x, one.slope_y, one.var_m2, one.seen_s, one.tied, is_before)


@kernel
def _fit(one: Record, i: int, j: int, surface: Surface) -> None:
    """Fit a plane to the measured ground around a world cell, a block apart, into its PLANE."""
    cells, ring, own, stand = surface.cells, surface.ring, surface.own, surface.stand
    block, edge = surface.limits.block, ring.cell_m * surface.limits.block
    sums, z0, most = NO_POINTS, 0.0, math.inf
    dx, dy = (i + 0.5) * ring.cell_m - stand.x_m, (j + 0.5) * ring.cell_m - stand.y_m
    one.i, one.j, one.var_m2, one.seen_s = i, j, math.inf, -math.inf
    one.z_m, one.slope_x, one.slope_y, one.tied, one.is_before = 0.0, 0.0, 0.0, LOOSE, 0
    for dj in range(-REACH, REACH + 1):
        for di in range(-REACH, REACH + 1):
            at = index_of(i + di * block, j + dj * block, ring)
            if at < 0 or cells[at].looks == 0:
                continue
            cell = cells[at]
            u, v = di * edge, dj * edge
            away, ground = math.sqrt(u * u + v * v), ground_of(cell, own)
            rise = max(0.0, cell.top_m)  # the ground is not better known than what rises there
            var = grown(cell.var_m2, away) + rise * rise
            w = 1.0 / (var + FLAT_M * FLAT_M)
            if one.var_m2 == math.inf:
                z0 = ground
            is_nearer = u * dx + v * dy <= 0.0
            one.is_before |= is_nearer
            # towards the robot, a wall looks like a ramp
            most = min(most, ground + (STEEPEST if is_nearer else surface.limits.rises) * away)
            if var < one.var_m2:
                one.var_m2, one.tied, one.seen_s = var, cell.tied, cell.floor_s
            sums = with_point(sums, u, v, ground - z0, w)
    if one.var_m2 < math.inf:
        z, one.slope_x, one.slope_y = plane_of_sums(sums, 1.0 / (STEEP * STEEP), STEEPEST)
        one.z_m = min(most, z0 + z)
