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
from core.records import F32, F64, I64
from jit import kernel, releasing_kernel

# A cell's key: its place along x, y and z (or a label) in 21 bits each, so that one comparison
# tells cells apart, and what is added to a key leads to a cell beside it.
BITS, HALF = 21, 1 << 20  # so many cells on each side of 0
LOW = (1 << BITS) - 1
BESIDE_X, BESIDE_Y, BESIDE_Z = 1 << 2 * BITS, 1 << BITS, 1
BEFORE = tuple(  # to the half of the 26 cells around one: over faces, over edges, over corners
    x * BESIDE_X + y * BESIDE_Y + z * BESIDE_Z
    for over in (1, 2, 3)
    for z in (-1, 0)
    for y in (-1, 0, 1)
    for x in (-1, 0, 1)
    if abs(x) + abs(y) + abs(z) == over and (z, y, x) < (0, 0, 0)
)
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
    of: I32  # (points,) voxel of each point,
    of_key: I64  # and its key
    table: I32  # (power of two,) by hash, the number of what is there; NONE: nothing
    key: I64  # (n,) of its cell
    sums: F32  # (n, 8) while they are filled: x, y, z, low, high, pixels, points of a voxel


class Clusters(NamedTuple):
    """Room for the cells of the cluster grid, and what is joined."""

    first: I32  # (n,) first voxel of a cell
    last: I32
    key: I64
    parent: I32  # (n,) of a cell: another one of its cluster, or itself
    label: I32  # (n,) of a cell, then of its cluster
    after: I32  # (voxels,) the next one in its cell
    cell: I32  # (voxels,) its cell,
    cell_key: I64  # and its key
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
    """A power of two that holds so many well: a small table stays in the cache.

    Who fills it clears it first, which brings it there.
    """
    size = 64
    while size < 2 * count and size < most:
        size *= 2
    return size


@kernel
def _hash(key: int, mask: int) -> int:
    """Where a cell is looked for first."""
    ix, iy, iz = key >> 2 * BITS, key >> BITS & LOW, key & LOW
    h = (ix * 73856093) ^ (iy * 19349663) ^ (iz * 83492791)
    return (h ^ (h >> 15)) & mask


@kernel
def find(key: int, table: I32, keys: I64) -> int:
    """The table's slot of a cell, or the empty one where it belongs."""
    mask = table.size - 1
    at = _hash(key, mask)
    while table[at] != NONE and keys[table[at]] != key:
        at = (at + 1) & mask
    return at


@kernel
def part_of(value: float, per_m: float) -> int:
    """A coordinate's part of a key: `floor` without a call."""
    return int(value * per_m + HALF)


@kernel
def key_of(x: float, y: float, z: float, per_m: float) -> int:
    """Of the cell of a point."""
    parts = part_of(x, per_m) << 2 * BITS | part_of(y, per_m) << BITS
    return parts | part_of(z, per_m)


@kernel
def _place(points: Points, begin: int, step: int, count: int, edge_m: float, to: Voxels) -> int:
    """Find the voxel of each point: how many voxels.

    Keys first, for a processor looks only so far ahead, and what it should see are searches.
    """
    n, per_m, table = 0, 1.0 / edge_m, to.table[: table_size(count, to.table.size)]
    table[:] = NONE
    for k in range(count):
        p = begin + k * step
        to.of_key[k] = key_of(points.x[p], points.y[p], points.z[p], per_m)
    for k in range(count):
        at = find(to.of_key[k], table, to.key)
        v = table[at]
        if v == NONE:
            v = table[at] = n
            to.key[n] = to.of_key[k]
            n += 1
        to.of[k] = v
    return n


@releasing_kernel
def thin(points: Points, begin: int, step: int, count: int, edge_m: float, to: Voxels) -> int:
    """Means of the points in each voxel: how many voxels. Points at begin, begin + step, ..."""
    n, sums = _place(points, begin, step, count, edge_m, to), to.sums
    for v in range(n):
        sums[v, :] = np.float32(0.0)
        sums[v, 3], sums[v, 4] = np.float32(math.inf), np.float32(-math.inf)
    for k in range(count):
        p, v = begin + k * step, to.of[k]
        x, y, z = points.x[p], points.y[p], points.z[p]
        sums[v, 0] += x
        sums[v, 1] += y
        sums[v, 2] += z
        sums[v, 3], sums[v, 4] = min(sums[v, 3], z), max(sums[v, 4], z)
        sums[v, 5] += points.pixels[p]
        sums[v, 6] += 1.0
    for v in range(n):
        share = 1.0 / sums[v, 6]
        to.x[v], to.y[v], to.z[v] = sums[v, 0] * share, sums[v, 1] * share, sums[v, 2] * share
        to.low[v], to.high[v], to.pixels[v] = sums[v, 3], sums[v, 4], int(sums[v, 5])
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
    table[:] = NONE
    for v in range(count):
        x, y, z = voxels.x[v], voxels.y[v], voxels.z[v] - lens_m
        at_step = math.sqrt(x * x + y * y + z * z) / WARP_STEP_M
        k = min(int(at_step), warp.size - 2)
        scale = warp[k] + (at_step - k) * (warp[k + 1] - warp[k])
        to.x[v], to.y[v], to.z[v] = x * scale, y * scale, z * scale
        to.cell_key[v] = key_of(to.x[v], to.y[v], to.z[v], per_m)
    for v in range(count):
        to.cell[v], to.after[v] = NONE, NONE
        if used[v] != 0:
            continue
        at = find(to.cell_key[v], table, to.key)
        c = table[at]
        if c == NONE:
            c = table[at] = cells
            to.key[c], to.parent[c], to.first[c] = to.cell_key[v], c, v
            cells += 1
        else:
            to.after[to.last[c]] = v
        to.last[c], to.cell[v] = v, c
    return cells


@kernel
def _join(c: int, to_key: int, far2: float, table: I32, to: Clusters) -> None:
    """Join a cell with another one, if that has a voxel near enough."""
    other = table[find(to.key[c] + to_key, table, to.key)]
    if other == NONE:
        return
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
    for n in range(len(BEFORE)):  # what is one by the faces is not asked over edges and corners
        for c in range(cells):
            _join(c, BEFORE[n], edge_m * edge_m, table, to)
    found = 0
    for c in range(cells):  # a root stands before all that it holds
        root = root_of(to.parent, c)
        if root == c:
            to.label[c] = found
            found += 1
        else:
            to.label[c] = to.label[root]
    for v in range(count):
        labels[v] = NONE if to.cell[v] == NONE else to.label[to.cell[v]]
    return found
