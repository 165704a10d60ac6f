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

from core.grid.places import index_in
from core.records import F64
from jit import Record, kernel

Cells = npt.NDArray[Any]  # flat, of CELL

CELL = np.dtype(
    [
        ("ground_m", np.float64),  # at the centre: measured, or expected while looks is 0
        ("var_m2", np.float64),  # its variance; inf: nothing known
        ("arm_m", np.float64),  # how far ahead it was seen, and how far had been driven
        ("aside_m", np.float64),
        ("slope_x", np.float64),  # of the ground through it
        ("slope_y", np.float64),
        ("floor_s", np.float64),  # when floor was seen last
        # over the ground, so that they move with it:
        ("least_m", np.float64),  # lowest floor seen in it: a face that rises in it is no floor
        ("low_m", np.float64),  # lowest and highest return of what is no floor
        ("top_m", np.float64),
        ("under_m", np.float64),  # a beam was so low here: the ground can't be higher; inf: none
        ("far_m", np.float64),  # ground on which such beams landed; inf: none did
        ("stands", np.float64),  # log-odds that something stands here,
        ("soft", np.float64),  # and that it lets beams in
        ("looks", np.int32),  # scans that saw its floor
        ("slot", np.int32),  # where the newest scan that touched it keeps what it said of it
        ("floor_parts", np.int32),  # bits of the 5 cm parts where floor was seen,
        ("under_parts", np.int32),  # or where a beam was under the ground
        ("tied", np.int64),  # LOOSE, TIED or APART
    ],
    align=True,
)
LOOSE, TIED, APART = 0, 1, 2  # ground: not known to be reached; reached without a step; beyond one
BLANK = np.zeros((), dtype=CELL)
for _name, _value in (
    ("var_m2", np.inf),
    ("least_m", np.inf),
    ("low_m", np.inf),
    ("top_m", -np.inf),
    ("under_m", np.inf),
    ("far_m", np.inf),
    ("floor_s", -np.inf),
):
    BLANK[_name] = _value

BEND = 0.02  # 1 sigma: terrain departs so much from its tangent in a metre; beyond, by the root
FLAT_M = 0.004  # roughness of floor within a cell
STEEP = 0.07  # 1 sigma of slopes: 4 deg
STEEPEST = 0.2  # most of them that a wheel climbs
RISES = 0.06  # half the tilt of the scan plane: ground that rises more towards the robot is none
REACH, REACH_M = 3, 0.2  # neighbours looked at: 7 x 7 places, 0.2 m apart or a cell


class Surface(NamedTuple):
    """The map, as kernels are given it."""

    cells: Cells
    corner_i: int  # world cell with the lowest i and j
    corner_j: int
    size: int
    cell_m: float
    own: F64  # (5,) error of the newest sweep: height, pitch, roll; pitch and roll always


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
    """Flat index of a world cell; -1 outside of the window."""
    return index_in(i, j, (surface.corner_i, surface.corner_j), surface.size)


@kernel
def world_cell(at: int, surface: Surface) -> tuple[int, int]:
    """The world cell of a flat index."""
    size = surface.size
    i = surface.corner_i + (at % size - surface.corner_i) % size
    j = surface.corner_j + (at // size - surface.corner_j) % size
    return i, j


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
def ground_of(cell: Record, own: F64) -> float:
    """Height of the ground at a cell's centre."""
    return float(cell.ground_m - own[3] * cell.arm_m - own[4] * cell.aside_m)


@kernel
def grown(var: float, far_m: float) -> float:
    """Variance of ground so far from where it is known."""
    return var + BEND * BEND * far_m * min(1.0, far_m)


@kernel
def predict(i: int, j: int, x_m: float, y_m: float, surface: Surface) -> Plane:
    """The ground at the centre of a world cell by the measured ground around it.

    x_m, y_m: where the robot stands.
    """
    cells, cell_m, own = surface.cells, surface.cell_m, surface.own
    stride = max(1, round(REACH_M / cell_m))
    edge = cell_m * stride
    w0 = wu = wv = wuu = wuv = wvv = wz = wzu = wzv = 0.0
    best, z0, most, tied, is_before, seen_s = math.inf, 0.0, math.inf, LOOSE, False, -math.inf
    dx, dy = (i + 0.5) * cell_m - x_m, (j + 0.5) * cell_m - y_m
    for dj in range(-REACH, REACH + 1):
        for di in range(-REACH, REACH + 1):
            at = index_of(i + di * stride, j + dj * stride, surface)
            if at < 0 or cells[at].looks == 0:
                continue
            cell = cells[at]
            u, v = di * edge, dj * edge
            away = math.sqrt(u * u + v * v)
            var, ground, top = grown(cell.var_m2, away), ground_of(cell, own), cell.top_m
            if top > 0.0:  # where something rises, the ground is not better known than that
                var += top * top
            w = 1.0 / (var + FLAT_M * FLAT_M)
            if best == math.inf:
                z0 = ground
            is_nearer = u * dx + v * dy <= 0.0
            is_before = is_before or is_nearer
            # towards the robot, a wall looks like a ramp
            most = min(most, ground + (STEEPEST if is_nearer else RISES) * away)
            if var < best:
                best, tied, seen_s = var, cell.tied, cell.floor_s
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
