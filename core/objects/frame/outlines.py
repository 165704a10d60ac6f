"""What each cluster is seen from above: its measures, and the points along its rim.

A cluster's columns are the squares of voxel width that it covers. A column that lacks one of its
eight neighbours is rim; of the points there, one for each sixteenth of the column is kept.

Source: docs/objects.md, section 7.
"""

from typing import NamedTuple

from core.objects.frame.pixels import I32, Fan, Points, fan_cell
from core.objects.frame.view import NOWHERE
from core.objects.frame.voxels import (
    BESIDE_X,
    BESIDE_Y,
    LOW,
    NONE,
    Voxels,
    find,
    part_of,
    table_size,
)
from core.records import F32, F64, I64
from jit import kernel, releasing_kernel

PARTS = 4  # of a column along each edge
AT_RIM = 2.5  # pixels: a point has the first row or the second one, and is the mean of a voxel
BESIDE = tuple(x * BESIDE_X + y * BESIDE_Y for y in (-1, 0, 1) for x in (-1, 0, 1) if x or y)


class Measures(NamedTuple):
    """Of each cluster."""

    pixels: I32  # (clusters,)
    voxels: I32
    columns: I32
    low: F32  # m, lowest and highest point
    high: F32
    near2: F32  # m2, of the voxels nearest to the lens and farthest from it
    far2: F32
    cut: I32  # 1: it goes on where the image ends, above
    begin: I32  # (clusters + 1,) where its rim begins among all, and the last one's ends


class Columns(NamedTuple):
    """Room for the columns of a frame, and for the points of all rims."""

    key: I64  # of its place, and its cluster's label
    label: I32
    kept: I32  # bits of the parts that have their point
    rim: I32  # 1: a rim
    of: I32  # (voxels,)
    table: I32
    point: I32  # (points,) those kept, by their number,
    point_label: I32
    x: F32  # (points,) and then by cluster
    y: F32


@kernel
def _is_at_rim(
    x: float, y: float, z: float, fan: Fan, rim: F64, lowest: float, pixel_rad: float
) -> bool:
    """Whether the image ends right above a point; z from the lens, `lowest` of the rim."""
    if x <= 0.0:
        return False
    rise = z / x
    above = rise + AT_RIM * pixel_rad * (1.0 + rise * rise)
    if above < lowest:
        return False  # nearly all
    at = fan_cell(x, y, fan)
    if at < 0:
        return False
    row = at // fan.steps
    most = max(rim[max(0, row - 1)], rim[row], rim[min(row + 1, rim.size - 1)])
    return bool(most > -NOWHERE and above >= most)


@releasing_kernel
def measure(
    voxels: Voxels, count: int, labels: I32, lens_m: float, fan: Fan, rim: F64, pixel_rad: float,
    to: Measures, clusters: int,
) -> None:  # fmt: skip
    """Fill all but the rims and the columns.

    Args:
        rim: (bearings,) of `view.rise_to_rim`.
        pixel_rad: from one row of the image to the next.
    """
    for c in range(clusters):
        to.pixels[c], to.voxels[c], to.columns[c] = 0, 0, 0
        to.low[c], to.high[c], to.near2[c], to.far2[c] = 1e9, -1e9, 1e9, 0.0
        to.cut[c] = 0
    lowest = NOWHERE
    for row in range(rim.size):
        if rim[row] > -NOWHERE:
            lowest = min(lowest, rim[row])
    for v in range(count):
        c = labels[v]
        if c == NONE:
            continue
        to.pixels[c] += voxels.pixels[v]
        to.voxels[c] += 1
        to.low[c] = min(to.low[c], voxels.low[v])
        to.high[c] = max(to.high[c], voxels.high[v])
        x, y, z = voxels.x[v], voxels.y[v], voxels.z[v] - lens_m
        range2 = x * x + y * y + z * z
        to.near2[c], to.far2[c] = min(to.near2[c], range2), max(to.far2[c], range2)
        if to.cut[c] == 0 and _is_at_rim(
            x, y, voxels.high[v] - lens_m, fan, rim, lowest, pixel_rad
        ):
            to.cut[c] = 1


@releasing_kernel
def columns_of(voxels: Voxels, count: int, labels: I32, to: Columns) -> int:
    """Sort the voxels of all clusters into columns: how many. A label of NONE is left out."""
    n, table = 0, to.table[: table_size(count, to.table.size)]
    table[:] = NONE
    for v in range(count):
        to.of[v] = NONE
        if labels[v] == NONE:
            continue
        key = voxels.key[v] & ~LOW | labels[v]
        at = find(key, table, to.key)
        c = table[at]
        if c == NONE:
            c = table[at] = n
            to.key[n], to.label[n], to.kept[n] = key, labels[v], 0
            n += 1
        to.of[v] = c
    return n


@kernel
def _find_rims(n: int, count: int, to: Columns, measures: Measures) -> None:
    """Which columns lack a neighbour of their own cluster; count those of each cluster."""
    table = to.table[: table_size(count, to.table.size)]
    for c in range(n):
        measures.columns[to.label[c]] += 1
        to.rim[c] = 0
        for k in range(len(BESIDE)):
            if table[find(to.key[c] + BESIDE[k], table, to.key)] == NONE:
                to.rim[c] = 1
                break


@releasing_kernel
def outline(
    points: Points, begin: int, step: int, count: int, edge_m: float, voxels: Voxels, found: int,
    labels: I32, to: Columns, measures: Measures, clusters: int,
) -> int:  # fmt: skip
    """The points of all rims, cluster by cluster, in `to.x` and `to.y`: how many.

    Args:
        labels: (found,) of the voxels; NONE: of no cluster that is wanted.
    """
    _find_rims(columns_of(voxels, found, labels, to), found, to, measures)
    kept, per_m = 0, 1.0 / edge_m
    for c in range(clusters + 1):
        measures.begin[c] = 0
    for k in range(count):
        column = to.of[voxels.of[k]]
        if column == NONE or to.rim[column] == 0:
            continue
        p = begin + k * step
        part = part_of(points.x[p], per_m * PARTS) % PARTS * PARTS
        bit = 1 << (part + part_of(points.y[p], per_m * PARTS) % PARTS)
        if to.kept[column] & bit:
            continue
        to.kept[column] |= bit
        to.point[kept], to.point_label[kept] = p, to.label[column]
        measures.begin[to.label[column] + 1] += 1
        kept += 1
    for c in range(clusters):
        measures.begin[c + 1] += measures.begin[c]
    for k in range(kept - 1, -1, -1):  # from the back, so that begin[c + 1] becomes begin[c]
        c = to.point_label[k]
        measures.begin[c + 1] -= 1
        at, p = measures.begin[c + 1], to.point[k]
        to.x[at], to.y[at] = points.x[p], points.y[p]
    for c in range(clusters):
        measures.begin[c] = measures.begin[c + 1]
    measures.begin[clusters] = kept
    return kept
