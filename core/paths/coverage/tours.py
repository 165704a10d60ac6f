"""Pieces of a sweep to one path: their order, and the shortest ways from each to the next."""

import math
from collections.abc import Sequence

import numpy as np
from shapely import Polygon

from core.paths.coverage.contours import entries_of
from core.paths.coverage.loops import joined_loops
from core.paths.coverage.order import Tour
from core.paths.coverage.patches import nearest_in
from core.paths.coverage.sweep import Piece
from core.paths.geometry.rings import joined, length_of
from core.paths.geometry.visibility import VisibilityGraph
from core.records import F64

JOINED, NEAREST = 12, 40  # nodes and other ends that an end of a piece is joined to
SHUT_M = 1e-5  # ends of a piece that are nearer are one place
DETOUR = 1.3  # of a way whose length is not known


def lengths_between(graph: VisibilityGraph, points: F64) -> F64:
    """(n, n) metres: of straight lines in sight, else of ways that may be a little too long."""
    total = graph.distances(points, JOINED)
    far = np.hypot(*np.moveaxis(points[:, None] - points, 2, 0))
    near = np.argsort(far, axis=1, kind="stable")[:, 1 : NEAREST + 1]
    i, j = np.repeat(np.arange(len(points)), near.shape[1]), near.ravel()
    shorter = far[i, j] < total[i, j] - 1e-9
    i, j = i[shorter], j[shorter]
    seen = graph.sees(points[i], points[j])
    i, j = i[seen], j[seen]
    total[i, j] = total[j, i] = far[i, j]
    np.fill_diagonal(total, 0.0)
    return np.where(np.isfinite(total), total, DETOUR * far + 1.0)


def snapped(pieces: Sequence[Piece], space: Polygon) -> list[Piece]:
    """The same, with every corner where the machine's centre may be."""
    return [Piece(tuple(nearest_in(space, way) for way in piece.variants)) for piece in pieces]


def looped(pieces: Sequence[Piece], graph: VisibilityGraph, spacing_m: float) -> list[Piece]:
    """Closed lines that lie side by side as one piece each; then the other pieces as they are."""
    is_closed = [_is_closed(piece.variants[0]) for piece in pieces]
    lines = [p.variants[0] for p, closed in zip(pieces, is_closed, strict=True) if closed]
    loops = [Piece(entries_of(one, spacing_m)) for one in joined_loops(lines, graph, spacing_m)]
    return loops + [p for p, closed in zip(pieces, is_closed, strict=True) if not closed]


def _is_closed(line: F64) -> bool:
    return math.dist(line[0], line[-1]) < SHUT_M


def ordered(
    groups: Sequence[Sequence[Piece]], graph: VisibilityGraph, start: F64 | None, end: F64 | None
) -> list[list[F64]]:
    """The pieces of each group as lines (n, 2), in the order in which they are driven.

    Groups are driven one after the other, the nearest first.
    """
    points: list[F64] = [p for p in (start, end) if p is not None]
    stops: list[list[list[tuple[int, int, float]]]] = []
    for group in groups:
        stops.append([])
        for piece in group:
            variants = []
            for way in piece.variants:
                is_closed = _is_closed(way)
                a, metres = len(points), length_of(way)
                b = a if is_closed else a + 1
                variants += [(a, b, metres), (b, a, metres)]
                points += [way[0]] if is_closed else [way[0], way[-1]]
            stops[-1].append(variants)
    between = lengths_between(graph, np.array(points))
    here = None if start is None else 0
    last = None if end is None else int(start is not None)
    left = [k for k, group in enumerate(groups) if group]
    done: list[list[F64]] = []
    while left:
        entries = {k: [v[0] for piece in stops[k] for v in piece] for k in left}
        place = here if here is not None else entries[left[0]][0]
        k = min(left, key=lambda g: float(between[place, entries[g]].min()))
        left.remove(k)
        tour = Tour(stops[k], between, here, None if left else last).best()
        lines = [groups[k][p].variants[v // 2][:: 1 - 2 * (v % 2)] for p, v in tour]
        done.append(lines)
        here = stops[k][tour[-1][0]][tour[-1][1]][1]
    return done


def linked(lines: Sequence[F64], graph: VisibilityGraph, start: F64 | None) -> F64:
    """(n, 2) one path along all lines, each edge within the space.

    What cannot be got to is left out; so the path begins with the first line if `start` is None.
    """
    path = [start[None]] if start is not None else []
    for line in lines:
        here = path[-1][-1:] if path else line[:0]
        corners = np.vstack([here, line])
        clear = graph.sees(corners[:-1], corners[1:])
        path.append(corners[:1])
        for a, b, is_clear in zip(corners[:-1], corners[1:], clear, strict=True):
            way = np.vstack([a, b]) if is_clear else graph.way(path[-1][-1], b)
            if way is not None:
                path.append(way[1:])
    return joined(path)
