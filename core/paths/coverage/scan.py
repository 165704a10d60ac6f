"""Boustrophedon cells of a polygon, and the lanes in them. Lanes run along x.

Between two neighbouring corner heights a polygon is a row of trapezoids. Trapezoids that follow
each other one to one are a cell; where they split or merge, cells end and begin.
Source: Choset, Coverage of known spaces: the boustrophedon cellular decomposition, 2000.
"""

import math
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import shapely
from shapely import Polygon

from core.records import F64

LEAST_M = 0.002  # height of a row of trapezoids: corners nearer than that are taken together
INSIDE_M = 1e-4  # from a flat edge to the lane along it


@dataclass(slots=True, eq=False)
class Cell:
    """A part of the polygon that each line along x cuts once."""

    low_m: float
    high_m: float
    rows: list[tuple[float, float, float]] = field(default_factory=list)  # y, from x, to x
    is_narrow_below: bool = False  # goes on there in a wider cell, which has a lane at the border
    is_narrow_above: bool = False
    below: list["Cell"] = field(default_factory=list)
    above: list["Cell"] = field(default_factory=list)


def edges_of(polygon: Polygon) -> F64:
    """(m, 4): x, y, x, y of all edges, the lower end first."""
    rings = [polygon.exterior, *polygon.interiors]
    points = [shapely.get_coordinates(ring) for ring in rings]
    edges = np.vstack([np.hstack([ring[:-1], ring[1:]]) for ring in points])
    swap = edges[:, 1] > edges[:, 3]
    edges[swap] = edges[swap][:, [2, 3, 0, 1]]
    return edges


def spans_at(edges: F64, y_m: float) -> F64:
    """(k, 2) from x to x: where the line at this height lies inside."""
    x0, y0, x1, y1 = edges[(edges[:, 1] <= y_m) & (edges[:, 3] > y_m)].T
    crossings = np.sort(x0 + (x1 - x0) * (y_m - y0) / (y1 - y0))
    return crossings.reshape(-1, 2)


def _heights(edges: F64) -> F64:
    """Corner heights from bottom to top, each at least LEAST_M above the one before."""
    kept = [-math.inf]
    for y in np.unique(edges[:, [1, 3]]):
        if y - kept[-1] >= LEAST_M:
            kept.append(float(y))
    return np.array(kept[1:])


Row = tuple[float, float, F64]  # low, high, spans


def _rows(polygon: Polygon) -> list[Row]:
    edges = edges_of(polygon)
    heights = _heights(edges)
    return [(float(a), float(b), spans_at(edges, (a + b) / 2)) for a, b in pairwise(heights)]


Interval = tuple[float, float]
LEDGE = 0.5  # a step of a wall, along x, of more than that share of the width ends a cell


def _lies_in(inner: Interval, outer: Interval) -> bool:
    slack_m = LEDGE * (inner[1] - inner[0])
    return outer[0] - slack_m < inner[0] and inner[1] < outer[1] + slack_m


def _goes_on(before: Interval, now: Interval) -> bool:
    """Whether a row is of the same cell as the one before: no long step of a wall in between."""
    widest_m = max(before[1] - before[0], now[1] - now[0])
    return max(abs(now[0] - before[0]), abs(now[1] - before[1])) < LEDGE * widest_m


def _join(lower: Cell, span_below: Interval, upper: Cell, span_above: Interval) -> None:
    """Two cells meet. Who lies within the other leaves the lane at the border to it."""
    upper.below.append(lower)
    lower.above.append(upper)
    if _lies_in(span_above, span_below):
        upper.is_narrow_below = True
    elif _lies_in(span_below, span_above):
        lower.is_narrow_above = True


def _linked(
    rows: list[Row], left_out: set[tuple[int, int]]
) -> tuple[list[Cell], dict[int, list[tuple[int, int]]]]:
    """Cells of rows; which spans (row, number) each consists of, by its id."""
    cells: list[Cell] = []
    parts: dict[int, list[tuple[int, int]]] = {}
    before: list[tuple[Interval, Cell]] = []
    for r, (low, high, spans) in enumerate(rows):
        now = [(k, (x0, x1)) for k, (x0, x1) in enumerate(spans.tolist()) if (r, k) not in left_out]
        over = [[b for b in before if b[0][0] < x1 and b[0][1] > x0] for _, (x0, x1) in now]
        uses = {
            id(cell): sum(any(b[1] is cell for b in found) for found in over) for _, cell in before
        }
        after = []
        for (k, span), found in zip(now, over, strict=True):
            if len(found) == 1 and uses[id(found[0][1])] == 1 and _goes_on(found[0][0], span):
                cell = found[0][1]
                cell.high_m = high
            else:
                cell = Cell(low, high)
                cells.append(cell)
                parts[id(cell)] = []
                for span_below, other in found:
                    _join(other, span_below, cell, span)
            cell.rows.append(((low + high) / 2, *span))
            parts[id(cell)].append((r, k))
            after.append((span, cell))
        before = after
    return cells, parts


def cells_of(polygon: Polygon, least_m: float) -> list[Cell]:
    """The cells; dead ends lower than `least_m` do not count, so that noise splits nothing."""
    rows = _rows(polygon)
    left_out: set[tuple[int, int]] = set()
    while True:
        cells, parts = _linked(rows, left_out)
        ends = [
            cell
            for cell in cells
            if cell.high_m - cell.low_m < least_m
            and (bool(cell.below) != bool(cell.above))
            and (cell.is_narrow_below or cell.is_narrow_above)
        ]
        if not ends:
            return cells
        for cell in ends:
            left_out.update(parts[id(cell)])


def lane_heights(cell: Cell, spacing_m: float) -> list[float]:
    """Heights of a cell's lanes, exactly `spacing_m` apart; only the last may lie nearer.

    Along a wall lies a lane; at the border to a wider cell the lane is that cell's.
    """
    end_m = cell.high_m - (spacing_m if cell.is_narrow_above else INSIDE_M)
    top_m = cell.high_m - INSIDE_M
    last_m = cell.low_m if cell.is_narrow_below else cell.low_m + INSIDE_M - spacing_m
    heights: list[float] = []
    while last_m < end_m - 1e-3:
        last_m = min(last_m + spacing_m, top_m)
        heights.append(last_m)
    return heights


def lane_at(edges: F64, cell: Cell, y_m: float) -> tuple[float, float]:
    """From x to x: the lane of a cell at this height, as long as the polygon lets it be."""
    rows = np.array(cell.rows)
    _, x0, x1 = rows[np.argmin(np.abs(rows[:, 0] - y_m))]
    spans = spans_at(edges, y_m)
    if len(spans) == 0:
        return float(x0), float(x1)
    shared = np.minimum(spans[:, 1], x1) - np.maximum(spans[:, 0], x0)
    best = int(np.argmax(shared))
    return float(spans[best, 0]), float(spans[best, 1])
