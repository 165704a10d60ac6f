"""What method `surface` keeps of a cell, and its model of terrain: ground by that around it.

Heights are of the map frame, as the sweep's fast error left them. What is always wrong with the
attitude, s = (pitch, roll), is taken out when they are read, so that a better s mends all the map:

    ground(cell) = ground_m - s_p arm_m - s_r aside_m

arm_m is how far ahead the cell was seen plus the way driven until then, aside_m how far aside.
Ground is a plane through measured ground nearby, the surer the nearer that is. Terrain departs
from its tangent plane as an integrated random walk does:

    q(d) = BEND^2 d min(1, d)          variance of the departure, d metres away

    z, a, b = argmin sum_k w_k (z_k - z - a u_k - b v_k)^2 + (a^2 + b^2) / STEEP^2
    w_k = 1 / (var_k + q(d_k) + rise_k^2 + FLAT^2)

Source: docs/method.md, section 2; Kalman elevation cells, Fankhauser et al. 2014.
"""

import math
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from core.mapping.surface.constants import BEND, CARRY_M, FLAT_M, REACH, REACH_M, STEEP, STEEPEST
from core.records import F64, I64
from jit import Record, Records, kernel, records

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
        ("parts", np.uint32),  # bits of its parts: where floor was seen, and a beam was under it
        ("looks", np.uint16),  # scans that saw its floor
        ("tied", np.uint8),  # LOOSE, TIED or APART
    ],
    align=True,
)
LOOSE, TIED, APART = 0, 1, 2  # ground: not known to be reached; reached without a step; beyond one
BLANK = np.zeros((), dtype=CELL)
for _name, _value in (
    ("var_m2", np.inf),
    ("floor_m", np.inf),
    ("low_m", np.inf),
    ("top_m", -np.inf),
    ("under_m", np.inf),
    ("floor_s", -np.inf),
):
    BLANK[_name] = _value

MOST_LOOKS = 0xFFFF  # more are not counted
PART_BITS, ALL_PARTS = 16, 0xFFFF  # of floor, below those of beams under it


PLANE = np.dtype(  # ground about a block of cells, as a scan has worked it out
    [
        ("block_i", np.int64),
        ("block_j", np.int64),
        ("i", np.int64),  # the cell of it that was asked for
        ("j", np.int64),
        ("scan", np.int64),
        ("seen_s", np.float64),
        ("z_m", np.float64),
        ("slope_x", np.float64),
        ("slope_y", np.float64),
        ("var_m2", np.float64),
        ("tied", np.int64),
        ("is_before", np.int64),
    ],
    align=True,
)
PLANES = 32  # blocks along an edge, whose planes are kept for the rest of a scan


class Surface(NamedTuple):
    """The map, as kernels are given it."""

    cells: Cells
    corner_i: int  # world cell with the lowest i and j,
    corner_j: int
    turn_i: int  # and its column and row
    turn_j: int
    size: int
    cell_m: float
    rises: float  # ground that rises more towards the robot is none
    block: int  # cells along the edge of a block, whose ground is worked out at once
    own: F64  # (5,) error of the newest sweep: height, pitch, roll; pitch and roll always
    planes: Records  # (PLANES * PLANES,)
    scan: I64  # (1,) counts scans


class Ground:
    """What of a surface does not change from scan to scan."""

    def __init__(self, cells: Cells, size: int, cell_m: float, rises: float, own: F64) -> None:
        self._cells, self._size, self._cell_m, self._own = cells, size, cell_m, own
        self._rises = rises
        self._block = max(1, round(REACH_M / cell_m))
        self._planes, self._scan = records(PLANE, PLANES * PLANES), np.zeros(1, np.int64)

    def surface(self, corner_i: int, corner_j: int) -> Surface:
        """As kernels are given it."""
        size = self._size
        return Surface(
            self._cells, corner_i, corner_j, corner_i % size, corner_j % size, size, self._cell_m,
            self._rises, self._block, self._own, self._planes, self._scan,
        )  # fmt: skip


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
def index_of(i: int, j: int, surface: Surface) -> int:
    """Flat index of a world cell; -1 outside of the window. Nothing is divided."""
    size, column, row = surface.size, i - surface.corner_i, j - surface.corner_j
    if not (0 <= column < size and 0 <= row < size):
        return -1
    column, row = column + surface.turn_i, row + surface.turn_j
    column = column - size if column >= size else column
    row = row - size if row >= size else row
    return row * size + column


@kernel
def world_cell(at: int, surface: Surface) -> tuple[int, int]:
    """The world cell of a flat index."""
    size = surface.size
    row = at // size
    i, j = at - row * size - surface.turn_i, row - surface.turn_j
    i, j = i + size if i < 0 else i, j + size if j < 0 else j
    return surface.corner_i + i, surface.corner_j + j


@kernel
def cell_at(x: float, y: float, surface: Surface) -> int:
    """Flat index of the cell of a point; -1 outside of the window."""
    return index_of(math.floor(x / surface.cell_m), math.floor(y / surface.cell_m), surface)


@kernel
def from_centre(x: float, cell_m: float) -> float:
    """How far a point lies from the middle of its cell along an axis."""
    return x - (math.floor(x / cell_m) + 0.5) * cell_m


@kernel
def row_of(parts: int) -> int:
    """Parts of a cell, parts along its edge, in which floor may be on one side of a ditch alone."""
    return min(parts, parts * parts - 1)


@kernel
def whole(number: int) -> int:
    """A whole number of a cell in 64 bits, which any kernel's argument has."""
    return number


@kernel
def real(number: float) -> float:
    """A number of a cell in 64 bits."""
    return number


@kernel
def floor_parts(cell: Record) -> int:
    """Bits of the parts of a cell in which floor was seen."""
    return whole(cell.parts) & ALL_PARTS


@kernel
def under_parts(cell: Record) -> int:
    """Bits of the parts of a cell in which a beam was under the ground."""
    return whole(cell.parts) >> PART_BITS


@kernel
def ground_of(cell: Record, own: F64) -> float:
    """Height of the ground at a cell's centre."""
    return float(cell.ground_m - own[3] * cell.arm_m - own[4] * cell.aside_m)


@kernel
def grown(var: float, far_m: float) -> float:
    """Variance of ground so far from where it is known."""
    return var + BEND * BEND * far_m * min(CARRY_M, far_m)


@kernel
def plane_at(i: int, j: int, x_m: float, y_m: float, surface: Surface) -> Plane:
    """The ground at the centre of a world cell.

    It is worked out once a scan for all cells of a block: about the one that is asked for first.
    """
    block, scan = surface.block, surface.scan[0]
    block_i, block_j = (i // block, j // block) if block > 1 else (i, j)
    one = surface.planes[block_j % PLANES * PLANES + block_i % PLANES]
    if one.scan != scan or one.block_i != block_i or one.block_j != block_j:
        one.scan, one.block_i, one.block_j = scan, block_i, block_j
        one.i, one.j = i, j
        plane = predict(i, j, x_m, y_m, surface)
        one.z_m, one.slope_x, one.slope_y = plane.z_m, plane.slope_x, plane.slope_y
        one.var_m2, one.seen_s, one.tied = plane.var_m2, plane.seen_s, plane.tied
        one.is_before = plane.is_before
    dx, dy = (i - one.i) * surface.cell_m, (j - one.j) * surface.cell_m
    z = one.z_m + one.slope_x * dx + one.slope_y * dy
    return Plane(z, one.slope_x, one.slope_y, one.var_m2, one.seen_s, one.tied, one.is_before > 0)


@kernel
def predict(i: int, j: int, x_m: float, y_m: float, surface: Surface) -> Plane:
    """The ground at the centre of a world cell by the measured ground around it, a block apart.

    x_m, y_m: where the robot stands.
    """
    cells, cell_m, own, block = surface.cells, surface.cell_m, surface.own, surface.block
    edge = cell_m * block
    w0 = wu = wv = wuu = wuv = wvv = wz = wzu = wzv = 0.0
    best, z0, most, tied, is_before, seen_s = math.inf, 0.0, math.inf, LOOSE, False, -math.inf
    dx, dy = (i + 0.5) * cell_m - x_m, (j + 0.5) * cell_m - y_m
    for dj in range(-REACH, REACH + 1):
        for di in range(-REACH, REACH + 1):
            at = index_of(i + di * block, j + dj * block, surface)
            if at < 0 or cells[at].looks == 0:
                continue
            cell = cells[at]
            u, v = di * edge, dj * edge
            away = math.sqrt(u * u + v * v)
            var, ground = grown(real(cell.var_m2), away), ground_of(cell, own)
            top = real(cell.top_m)
            if top > 0.0:  # where something rises, the ground is not better known than that
                var += top * top
            w = 1.0 / (var + FLAT_M * FLAT_M)
            if best == math.inf:
                z0 = ground
            is_nearer = u * dx + v * dy <= 0.0
            is_before = is_before or is_nearer
            # towards the robot, a wall looks like a ramp
            most = min(most, ground + (STEEPEST if is_nearer else surface.rises) * away)
            if var < best:
                best, tied, seen_s = var, whole(cell.tied), cell.floor_s
            z = ground - z0
            w0, wu, wv, wz = w0 + w, wu + w * u, wv + w * v, wz + w * z
            wuu, wuv, wvv = wuu + w * u * u, wuv + w * u * v, wvv + w * v * v
            wzu, wzv = wzu + w * z * u, wzv + w * z * v
    if best == math.inf:
        return NOWHERE
    u, v, z = wu / w0, wv / w0, wz / w0
    prior = 1.0 / (STEEP * STEEP)
    cuu, cvv, cuv = wuu - w0 * u * u + prior, wvv - w0 * v * v + prior, wuv - w0 * u * v
    czu, czv = wzu - w0 * z * u, wzv - w0 * z * v
    det = cuu * cvv - cuv * cuv
    a = max(-STEEPEST, min(STEEPEST, (czu * cvv - czv * cuv) / det))
    b = max(-STEEPEST, min(STEEPEST, (czv * cuu - czu * cuv) / det))
    return Plane(min(most, z0 + z - a * u - b * v), a, b, best, seen_s, tied, is_before)
