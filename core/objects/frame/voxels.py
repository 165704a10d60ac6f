"""Points to voxels, voxels to clusters: hashed grids, so that each point is touched once.

A voxel is the mean of its points. Two voxels are one cluster when they lie in one cell of the
cluster grid, or in two that touch and nearer than the cluster distance d: what is nearer than that
is always joined, what is farther than sqrt(3) d never is by itself.

Far away, two points of one surface may lie farther apart in range than d: by noise, 3 sqrt(2)
sigma(r), or because it is met at a small angle, SLANT r pitch. So ranges are first drawn together,
that this is d everywhere; bearings stay:

    s(r) = integral of d / max(d, 3 sqrt(2) sigma(r), SLANT r pitch) dr,    p' = p s(r) / r

Source: docs/objects.md, sections 4 and 6; union-find with path halving, Tarjan and van
Leeuwen 1984.
"""

import math
from typing import NamedTuple

import numpy as np

from core.objects.frame.pixels import APART, I32, SLANT, Points
from core.objects.frame.settings import FrameSettings
from core.records import F32, F64
from jit import kernel, releasing_kernel

HALF = 1 << 19  # cells on each side of 0 that a key tells apart
NONE = -1
WARP_STEP_M = 0.05  # of the table of s(r) / r


class Voxels(NamedTuple):
    """Room for the voxels of a frame, in the order in which the image met them."""

    x: F32  # (n,) m, sum of its points, then their mean
    y: F32
    z: F32
    low: F32  # lowest and highest of its points
    high: F32
    pixels: I32  # how many they are
    slot: I32  # where it stands in the table
    of: I32  # (points,) voxel of each point
    table: I32  # (power of two,) NONE but while a kernel runs
    ix: I32  # (n,) cell
    iy: I32
    iz: I32
    sums: F32  # (n, 8) while they are filled: x, y, z, low, high, pixels, points of a voxel


class Clusters(NamedTuple):
    """Room for the cells of the cluster grid, and what is joined."""

    first: I32  # (n,) first voxel of a cell
    last: I32
    ix: I32
    iy: I32
    iz: I32
    parent: I32  # (n,) of a cell: another one of its cluster, or itself
    label: I32  # (n,) of a cell, then of its cluster
    slot: I32
    after: I32  # (voxels,) the next one in its cell
    cell: I32  # (voxels,) its cell
    table: I32
    x: F32  # (voxels,) m, drawn together
    y: F32
    z: F32


def apart_m(ranges_m: F64, settings: FrameSettings, pitch_rad: float) -> F64:
    """How far apart two neighbouring points of one surface may lie at these ranges, at most."""
    noise_m = APART * (settings.noise_m + settings.noise_per_m2 * ranges_m * ranges_m)
    spread_m = np.maximum(noise_m, SLANT * pitch_rad * ranges_m)
    return np.asarray(np.maximum(spread_m, settings.cluster_m))


def warp_of(settings: FrameSettings, pitch_rad: float) -> F64:
    """s(r) / r at each WARP_STEP_M of range."""
    r = np.arange(0.0, settings.max_range_m + 2.0 * WARP_STEP_M, WARP_STEP_M)
    slope = settings.cluster_m / apart_m(r, settings, pitch_rad)
    s = np.concatenate([[0.0], np.cumsum(0.5 * (slope[1:] + slope[:-1]) * WARP_STEP_M)])
    return np.concatenate([slope[:1], s[1:] / r[1:]])


@kernel
def table_size(count: int, most: int) -> int:
    """A power of two that holds so many well: a small table stays in the cache."""
    size = 64
    while size < 2 * count and size < most:
        size *= 2
    return size


@kernel
def _hash(ix: int, iy: int, iz: int, mask: int) -> int:
    """Where a cell is looked for first."""
    h = (ix * 73856093) ^ (iy * 19349663) ^ (iz * 83492791)
    return (h ^ (h >> 15)) & mask


@kernel
def find(ix: int, iy: int, iz: int, table: I32, x: I32, y: I32, z: I32) -> int:
    """The table's slot of a cell, or the empty one where it belongs."""
    mask = table.size - 1
    at = _hash(ix, iy, iz, mask)
    while True:
        n = table[at]
        if n == NONE or (x[n] == ix and y[n] == iy and z[n] == iz):
            return at
        at = (at + 1) & mask


@kernel
def cell_of(value: float, per_m: float) -> int:
    """Cell of a coordinate: `floor` without a call."""
    return int(value * per_m + HALF) - HALF


@releasing_kernel
def thin(points: Points, begin: int, step: int, count: int, edge_m: float, to: Voxels) -> int:
    """Means of the points in each voxel: how many voxels. Points at begin, begin + step, ..."""
    table = to.table[: table_size(count, to.table.size)]
    n, per_m, last, sums = 0, 1.0 / edge_m, NONE, to.sums
    for k in range(count):
        p = begin + k * step
        x, y, z = points.x[p], points.y[p], points.z[p]
        ix, iy, iz = cell_of(x, per_m), cell_of(y, per_m), cell_of(z, per_m)
        v = last
        if v == NONE or to.ix[v] != ix or to.iy[v] != iy or to.iz[v] != iz:
            at = find(ix, iy, iz, table, to.ix, to.iy, to.iz)
            v = table[at]
            if v == NONE:
                v, table[at], to.slot[n] = n, n, at
                to.ix[n], to.iy[n], to.iz[n] = ix, iy, iz
                sums[n, 0], sums[n, 1], sums[n, 2] = 0.0, 0.0, 0.0
                sums[n, 5], sums[n, 6] = 0.0, 0.0
                sums[n, 3], sums[n, 4] = z, z
                n += 1
            last = v
        to.of[k] = v
        sums[v, 0] += x
        sums[v, 1] += y
        sums[v, 2] += z
        sums[v, 3], sums[v, 4] = min(sums[v, 3], z), max(sums[v, 4], z)
        sums[v, 6] += 1.0
        sums[v, 5] += points.pixels[p]
    for v in range(n):
        share = 1.0 / sums[v, 6]
        to.x[v], to.y[v], to.z[v] = sums[v, 0] * share, sums[v, 1] * share, sums[v, 2] * share
        to.low[v], to.high[v], to.pixels[v] = sums[v, 3], sums[v, 4], int(sums[v, 5])
        table[to.slot[v]] = NONE
    return n


@kernel
def root_of(parent: I32, n: int) -> int:
    """The one that stands for all that a thing is joined with."""
    while parent[n] != n:
        parent[n] = parent[parent[n]]
        n = parent[n]
    return n


@kernel
def _are_near(a: int, b: int, clusters: Clusters, far2: float) -> bool:
    """Whether two cells have two voxels nearer than that."""
    p = clusters.first[a]
    while p != NONE:
        q = clusters.first[b]
        while q != NONE:
            dx, dy = clusters.x[p] - clusters.x[q], clusters.y[p] - clusters.y[q]
            dz = clusters.z[p] - clusters.z[q]
            if dx * dx + dy * dy + dz * dz <= far2:
                return True
            q = clusters.after[q]
        p = clusters.after[p]
    return False


@kernel
def _fill(
    voxels: Voxels, count: int, used: I32, edge_m: float, lens_m: float, warp: F64, to: Clusters
) -> int:
    """Sort the voxels that are left into cells: how many cells."""
    cells, per_m, table = 0, 1.0 / edge_m, to.table[: table_size(count, to.table.size)]
    for v in range(count):
        to.cell[v], to.after[v] = NONE, NONE
        if used[v] != 0:
            continue
        x, y, z = voxels.x[v], voxels.y[v], voxels.z[v] - lens_m
        at_step = math.sqrt(x * x + y * y + z * z) / WARP_STEP_M
        k = min(int(at_step), warp.size - 2)
        scale = warp[k] + (at_step - k) * (warp[k + 1] - warp[k])
        to.x[v], to.y[v], to.z[v] = x * scale, y * scale, z * scale
        ix, iy, iz = cell_of(to.x[v], per_m), cell_of(to.y[v], per_m), cell_of(to.z[v], per_m)
        at = find(ix, iy, iz, table, to.ix, to.iy, to.iz)
        c = table[at]
        if c == NONE:
            c, table[at], to.slot[cells] = cells, cells, at
            to.ix[c], to.iy[c], to.iz[c], to.parent[c] = ix, iy, iz, c
            to.first[c] = v
            cells += 1
        else:
            to.after[to.last[c]] = v
        to.last[c], to.cell[v] = v, c
    return cells


@kernel
def _join_around(c: int, far2: float, table: I32, to: Clusters) -> None:
    """Join a cell with those around it that have a voxel near enough; each pair once."""
    for n in range(13):
        dx, dy, dz = n % 3 - 1, n // 3 % 3 - 1, n // 9 - 1
        at = find(to.ix[c] + dx, to.iy[c] + dy, to.iz[c] + dz, table, to.ix, to.iy, to.iz)
        other = table[at]
        if other == NONE:
            continue
        a, b = root_of(to.parent, c), root_of(to.parent, other)
        if a != b and _are_near(c, other, to, far2):
            to.parent[max(a, b)] = min(a, b)


@releasing_kernel
def cluster(
    voxels: Voxels, count: int, used: I32, edge_m: float, lens_m: float, warp: F64, labels: I32,
    to: Clusters,
) -> int:  # fmt: skip
    """Label (count,) of each voxel, from 0 in order of first sight: how many clusters.

    Args:
        used: (count,) not 0: of a wall, and left out; its label is NONE.
        edge_m: the cluster distance.
        warp: by `warp_of`.
    """
    cells = _fill(voxels, count, used, edge_m, lens_m, warp, to)
    table = to.table[: table_size(count, to.table.size)]
    for c in range(cells):
        _join_around(c, edge_m * edge_m, table, to)
    found = 0
    for c in range(cells):  # a root stands before all that it holds
        root = root_of(to.parent, c)
        if root == c:
            to.label[c] = found
            found += 1
        else:
            to.label[c] = to.label[root]
        table[to.slot[c]] = NONE
    for v in range(count):
        labels[v] = NONE if to.cell[v] == NONE else to.label[to.cell[v]]
    return found
