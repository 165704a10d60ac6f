"""A path mended: what is left of it, a little aside where what it passes has moved.

A floor's edge moves by centimetres while a machine drives along it. A plan made anew for what is
left then begins with other contours, which overlap those that were swept; the old plan need not.
So its rest is kept: stretches that sweep floor that is not clean, in their order, moved into the
space where they are a little outside, each joined to the next by the shortest way.
Source: docs/coverage.md, "A floor that nobody knows".
"""

import math
from collections.abc import Callable

import numpy as np
import shapely

from core.paths.geometry.visibility import Bools, VisibilityGraph
from core.paths.records import Segment
from core.records import F64

STEP_M = 0.1  # between places on a path that are looked at
ASIDE_M = 0.1  # by which they may be moved
SAME_M = 1e-4  # by which corners may leave a straight line
MOST_TRAVEL = 0.1  # of what it sweeps: plans made anew have 0.02 to 0.07
SHORT_M = 0.3  # of a stretch that still sweeps: a shorter one is left for a later plan


def mended(
    rest: F64, here: F64, graph: VisibilityGraph, has_work: Callable[[float, float], bool]
) -> tuple[Segment, ...]:
    """What to drive of the rest (n, 2) of a path, from `here` in the graph's polygon on.

    Nothing, where ways from stretch to stretch are long: it is broken up then.

    Args:
        has_work: whether a tool at x, y sweeps floor that is not clean.
    """
    if len(rest) < 2:
        return ()
    points, is_near = _moved_in(sampled(rest), graph)
    kept = is_near[:-1] & is_near[1:]
    middles = (points[:-1] + points[1:]) / 2
    kept[kept] = [has_work(x, y) for x, y in middles[kept].tolist()]
    found, at = list[Segment](), here
    for run in _runs(points, kept):
        way, line = graph.way(at, run[0]), _joined(run, graph)
        if way is None or line is None:
            continue
        if math.dist(at, run[0]) > SAME_M:
            found.append(Segment("travel", way))
        found.append(Segment("sweep", line))
        at = run[-1]
    between_m = sum(_length_m(one) for one in found[1:] if one.kind == "travel")
    sweep_m = sum(_length_m(one) for one in found if one.kind == "sweep")
    return tuple(found) if between_m <= MOST_TRAVEL * sweep_m else ()


def _length_m(segment: Segment) -> float:
    return float(shapely.LineString(segment.points).length)


def sampled(line: F64) -> F64:
    """The corners of a line (n, 2) and places between them, no farther apart than a step."""
    return np.asarray(shapely.get_coordinates(shapely.segmentize(shapely.LineString(line), STEP_M)))


def _moved_in(points: F64, graph: VisibilityGraph) -> tuple[F64, Bools]:
    """Points (n, 2), each moved into the graph's polygon, and whether it was near that."""
    shapely.prepare(graph.polygon)
    lines = shapely.shortest_line(graph.polygon, shapely.points(points))
    nearest: F64 = shapely.get_coordinates(lines)[::2]
    return nearest, np.hypot(*(nearest - points).T) <= ASIDE_M


def _runs(points: F64, kept: Bools) -> list[F64]:
    """The points of edges in a row that are kept; short runs are none."""
    edges = np.diff(np.concatenate([[0], kept.astype(np.int8), [0]]))
    begins, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    runs = [points[a : b + 1] for a, b in zip(begins.tolist(), ends.tolist(), strict=True)]
    return [run for run in runs if shapely.LineString(run).length > SHORT_M]


def _joined(run: F64, graph: VisibilityGraph) -> F64 | None:
    """A line through all points (n, 2) of a run, within the polygon, without needless corners."""
    is_seen = graph.sees(run[:-1], run[1:])
    parts: list[F64] = [run[:1]]
    for k, straight in enumerate(is_seen.tolist()):
        way = run[k : k + 2] if straight else graph.way(run[k], run[k + 1])
        if way is None:
            return None
        parts.append(way[1:])
    line = shapely.LineString(np.vstack(parts))
    return np.asarray(shapely.get_coordinates(shapely.simplify(line, SAME_M)))
