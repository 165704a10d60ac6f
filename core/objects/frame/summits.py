"""Upright things that touch, parted: two people shoulder to shoulder are two.

A cluster's cells, seen from above, are flooded from the highest down. Where two summits meet, and
each rises far enough over the place where they do, they stay apart; else the lower joins the
higher. Only summits of at least UPRIGHT_M count: a table or a box has none.

Source: docs/objects.md, section 6; watershed by flooding, Vincent and Soille 1991.
"""

from core.objects.frame.outlines import BESIDE, Columns
from core.objects.frame.pixels import I32
from core.objects.frame.voxels import LOW, NONE, Clusters, Voxels, find, root_of, table_size
from jit import kernel, releasing_kernel

UPRIGHT_M = 1.0
LEVEL_M, LEVELS = 0.02, 512  # heights that count as one


@kernel
def _cells(voxels: Voxels, count: int, labels: I32, clusters: Clusters, to: Columns) -> int:
    """Cells of the cluster grid seen from above, with their tops in `to.x`: how many."""
    n, table = 0, to.table[: table_size(count, to.table.size)]
    table[:] = NONE
    for v in range(count):
        to.of[v] = NONE
        label, cell = labels[v], clusters.cell[v]
        if label == NONE:
            continue
        key = clusters.key[cell] & ~LOW | label
        at = find(key, table, to.key)
        c = table[at]
        if c == NONE:
            c = table[at] = n
            to.key[n] = key
            to.x[n], to.rim[n], to.point_label[n] = 0.0, n, 0
            n += 1
        to.x[c] = max(to.x[c], voxels.high[v])
        to.of[v] = c
    return n


@kernel
def _sort(n: int, bins: I32, to: Columns) -> None:
    """Cells from the highest down, in `to.kept`."""
    bins[: LEVELS + 1] = 0
    for c in range(n):
        bins[LEVELS - min(LEVELS - 1, int(to.x[c] / LEVEL_M))] += 1
    for k in range(LEVELS):
        bins[k + 1] += bins[k]
    for c in range(n - 1, -1, -1):
        level = LEVELS - min(LEVELS - 1, int(to.x[c] / LEVEL_M))
        bins[level] -= 1
        to.kept[bins[level]] = c


@kernel
def _flood(c: int, valley_m: float, table: I32, to: Columns) -> None:
    """Join a cell to the highest summit beside it, and lower ones that hardly rise over it."""
    parent, best = to.rim, NONE
    for turn in range(2):
        for k in range(len(BESIDE)):
            other = table[find(to.key[c] + BESIDE[k], table, to.key)]
            if other == NONE or to.point_label[other] == 0:
                continue
            root = root_of(parent, other)
            if turn == 0:
                if best == NONE or to.y[root] > to.y[best]:
                    best = root
            elif root != best and (to.y[root] - to.x[c] < valley_m or to.y[root] < UPRIGHT_M):
                parent[root] = best
    to.point_label[c] = 1
    if best == NONE:
        to.y[c] = to.x[c]
    else:
        parent[c] = best


@releasing_kernel
def part(
    voxels: Voxels, count: int, labels: I32, valley_m: float, clusters: Clusters, to: Columns,
    bins: I32,
) -> int:  # fmt: skip
    """Label each voxel anew, from 0 in order of first sight: how many labels.

    Args:
        labels: (count,) of its cluster, NONE: of none. Written.
        bins: room for LEVELS + 1.
    """
    n = _cells(voxels, count, labels, clusters, to)
    _sort(n, bins, to)
    table = to.table[: table_size(count, to.table.size)]
    for k in range(n):
        _flood(to.kept[k], valley_m, table, to)
    for c in range(n):
        to.kept[c] = NONE
    found = 0
    for v in range(count):
        if labels[v] == NONE:
            continue
        root = root_of(to.rim, to.of[v])
        if to.kept[root] == NONE:
            to.kept[root] = found
            found += 1
        labels[v] = to.kept[root]
    return found
