"""What any rays meet, whatever their directions: for cameras and for light that is no scanner's.

All leave at one instant. A ray is tried against every target. Soft things are in nobody's way here.
"""

import math
from typing import NamedTuple

import numpy as np

from fakes.rays.crossing_kernels import meet_passers, meet_targets
from fakes.rays.kernels import (
    BOX,
    CYLINDER,
    F64,
    I64,
    PLAIN,
    TINY,
    Passers,
    Pencil,
    Targets,
    invert,
)
from jit import allocating_kernel, kernel

NOBODY = -1  # as what is met, where that moves or nothing is met


class Met(NamedTuple):
    """What n rays meet first; map frame."""

    ways: F64  # (n, 3) of the rays, unit length
    ranges_m: F64  # (n,); inf: nothing
    points: F64  # (n, 3); of no worth where nothing is met
    normals: F64  # (n, 3) of unit length, towards the outside; against the ray where it moves
    solids: I64  # (n,) which of the scene's, or NOBODY
    materials: I64  # (n,) PLAIN, BLACK, GLASS


@kernel
def _normal_of_hull(
    targets: Targets, j: int, x: float, y: float, z: float
) -> tuple[float, float, float]:
    best, least = targets.first_planes[j], math.inf
    for k in range(targets.first_planes[j], targets.first_planes[j + 1]):
        plane = targets.planes[k]
        away = abs(plane[0] * x + plane[1] * y + plane[2] * z - plane[3])
        if away < least:
            best, least = k, away
    return targets.planes[best, 0], targets.planes[best, 1], targets.planes[best, 2]


@kernel
def _normal_at(
    targets: Targets, j: int, x: float, y: float, z: float
) -> tuple[float, float, float]:
    """Of the side of a target on which a point lies."""
    low, high = targets.lows[j], targets.highs[j]
    below, above = abs(z - low[2]), abs(z - high[2])
    up = 1.0 if above < below else -1.0
    off_z = min(below, above)
    if targets.kinds[j] == CYLINDER:
        out_x, out_y = x - (low[0] + high[0]) / 2, y - (low[1] + high[1]) / 2
        away = max(TINY, math.hypot(out_x, out_y))
        if abs(away - (high[0] - low[0]) / 2) < off_z:
            return out_x / away, out_y / away, 0.0
        return 0.0, 0.0, up
    if targets.kinds[j] == BOX:
        off_x, off_y = (
            min(abs(x - low[0]), abs(x - high[0])),
            min(abs(y - low[1]), abs(y - high[1])),
        )
        if off_x < off_y and off_x < off_z:
            return (1.0 if abs(x - high[0]) < abs(x - low[0]) else -1.0), 0.0, 0.0
        if off_y < off_z:
            return 0.0, (1.0 if abs(y - high[1]) < abs(y - low[1]) else -1.0), 0.0
        return 0.0, 0.0, up
    return _normal_of_hull(targets, j, x, y, z)


@allocating_kernel
def meet_along(
    begins: F64, ways: F64, since_begin_s: float, targets: Targets, passers: Passers,
    glass_cos: float, far_m: float,
) -> tuple[F64, I64, F64]:  # fmt: skip
    """Ranges (n,), what is met (n,), and the normals there (n, 3).

    Args:
        begins, ways: (3, n), contiguous.
    """
    n = ways.shape[1]
    pencil = Pencil(begins, ways, np.empty((3, n)))
    invert(pencil)
    found, met, normals = np.full(n, np.inf), np.full(n, NOBODY), np.empty((n, 3))
    spans = np.zeros((len(targets.kinds), 3, 2), dtype=np.int64)
    spans[:, 0, 1] = n
    meet_targets(pencil, spans, targets, glass_cos, far_m, found, met)
    spans = np.zeros((len(passers.radii_m), 3, 2), dtype=np.int64)
    spans[:, 0, 1] = n
    meet_passers(pencil, spans, np.full(n, since_begin_s), passers, found, met)
    for i in range(n):
        way_x, way_y, way_z, far = ways[0, i], ways[1, i], ways[2, i], found[i]
        normal = (-way_x, -way_y, -way_z)
        if met[i] >= 0:
            x, y, z = begins[0, i] + far * way_x, begins[1, i] + far * way_y, begins[2, i]
            normal = _normal_at(targets, met[i], x, y, z + far * way_z)
        normals[i, 0], normals[i, 1], normals[i, 2] = normal
    return found, met, normals


def met_from(
    begins: F64, ways: F64, since_begin_s: float, targets: Targets, passers: Passers,
    glass_cos: float, far_m: float,
) -> Met:  # fmt: skip
    """What rays (n, 3), map frame, meet within far_m at an instant of the passers' clock."""
    given = np.ascontiguousarray(begins.T), np.ascontiguousarray(ways.T)
    ranges_m, solids, normals = meet_along(
        *given, since_begin_s, targets, passers, glass_cos, far_m
    )
    seen = np.where(np.isfinite(ranges_m), ranges_m, 0.0)
    materials = np.full(len(solids), PLAIN, dtype=np.int64)
    materials[solids >= 0] = targets.materials[solids[solids >= 0]]
    return Met(ways, ranges_m, begins + seen[:, None] * ways, normals, solids, materials)
