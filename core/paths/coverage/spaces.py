"""A sweep of all spaces that passages join in which a long machine cannot turn round.

In each space of the circle round it the machine sweeps as a disc does (`plan_coverage`). Through
passages it travels by ways of its shape, there and back: from a space to those that are reached by
way of it, the nearest first.
"""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from core.paths.coverage.measures import band_of
from core.paths.coverage.patches import nearest_in
from core.paths.coverage.plan import plan_coverage, space_at
from core.paths.geometry.rings import length_of
from core.paths.geometry.shaped_ways import Roadmap, Shape, part_at
from core.paths.geometry.space import narrowed, polygons_in, repaired
from core.paths.geometry.visibility import graph_of
from core.paths.geometry.ways import Point
from core.paths.records import CoveragePlan, Machine, Segment
from core.records import F64

LEAST = 1.0  # squares of the width: a smaller space of the machine's centre is not travelled to
TOUCH_M = 1e-9


@dataclass(slots=True, eq=False)
class _Space:
    """How it is come to from the one before, and what is come to from it."""

    there: F64  # (n, 2) a way into it
    back: F64  # (n, 2) one out of it
    next: list["_Space"] = field(default_factory=list)


def plan_all_spaces(
    floor: BaseGeometry,
    machine: Machine,
    shape: Shape,
    start: Point | None = None,
    dock: Point | None = None,
    **how: Any,
) -> CoveragePlan:
    """A path over all of the floor that the machine gets to by ways of its shape.

    Args:
        floor: free floor as polygons, metres.
        start, dock: as of `plan_coverage`.
        how: `rooms`, `angle_rad` and `is_refined` of `plan_coverage`.

    Raises:
        FloorError: as `plan_coverage`.
    """
    free = repaired(floor)
    begin = dock if start is None else start
    home = space_at(free, machine, begin, "dock" if start is None else "start")
    sweeps = _Sweeps(free, machine, how)
    sweeps.visit(_tree(free, machine, shape, home), begin, dock)
    return sweeps.plan(dock)


def _tree(free: MultiPolygon, machine: Machine, shape: Shape, home: Polygon) -> _Space:
    """All spaces that the machine gets to, and back from, by way of that where it begins.

    Not where it would have to turn the longer way round: no path tells its follower that.
    """
    inner = home.representative_point()
    whole = part_at(free, (inner.x, inner.y))
    least_m2, nowhere = LEAST * machine.width_m**2, np.empty((0, 2))
    parts = polygons_in(narrowed(whole, shape.far_m))
    own = max(parts, key=lambda part: part.intersection(home).area, default=None)
    others = [part for part in parts if part is not own and part.area > least_m2]
    first = _Space(nowhere, nowhere)
    if own is None or not others or not own.intersects(home):
        return first
    ends = [part.representative_point() for part in (own, *others)]
    roadmap = Roadmap(whole, shape, shapely.get_coordinates(ends))
    search = roadmap.search(0, None)
    ways = [nodes for end in range(1, len(ends)) if (nodes := search.nodes_to(end)) is not None]
    spaces = {int(np.argmax(roadmap.is_in[:, 0])): first}
    for nodes in sorted(ways, key=lambda nodes: length_of(roadmap.points[nodes])):
        here = int(np.argmax(roadmap.is_in[:, nodes[-1]]))
        into = 1 + max(k for k, node in enumerate(nodes) if not roadmap.is_in[here, node])
        come_by = [[p for p in spaces if roadmap.is_in[p, node]] for node in nodes[:into]]
        out = max(k for k, those in enumerate(come_by) if those)
        back = roadmap.search(nodes[into], nodes[out]).nodes_to(nodes[out])
        if back is None:
            continue
        both = [roadmap.straightened(those) for those in (nodes[out : into + 1], back)]
        if all(np.abs(way.turns_rad).max(initial=0.0) <= math.pi for way in both):
            spaces[here] = _Space(both[0].points, both[1].points)
            spaces[come_by[out][0]].next.append(spaces[here])
    return first


class _Sweeps:
    """The path so far, space after space."""

    def __init__(self, free: MultiPolygon, machine: Machine, how: dict[str, Any]) -> None:
        self._free, self._machine, self._how = free, machine, how
        self._plans: list[CoveragePlan] = []
        self._segments: list[Segment] = []

    def visit(self, space: _Space, here: Point | None, last: Point | None) -> None:
        """Sweep a space from a place, then those behind it; then to a place, None: stay."""
        goals = [*(_point(one.there[0]) for one in space.next), last]
        clean = band_of(self._segments, self._machine.width_m)
        made = plan_coverage(self._free, self._machine, here, goals[0], clean=clean, **self._how)
        self._plans.append(made)
        for segment in made.segments:
            self._go(segment)
        for one, then in zip(space.next, goals[1:], strict=True):
            self._go(Segment("travel", one.there))
            self.visit(one, _point(one.there[-1]), _point(one.back[0]))
            self._go(Segment("travel", one.back))
            if then is not None:
                inside = made.space.geoms[0]
                ends = nearest_in(inside, np.array([one.back[-1], then]))
                way = graph_of(inside).way(ends[0], ends[1])
                assert way is not None  # one connected space
                self._go(Segment("travel", way))

    def _go(self, segment: Segment) -> None:
        """On from the end of the path; a space's corners may be half a millimetre off."""
        if length_of(segment.points) < TOUCH_M:
            return
        points = segment.points
        last = self._segments[-1] if self._segments else segment
        if self._segments and math.dist(last.points[-1], points[0]) > TOUCH_M:
            points = np.vstack([last.points[-1], points])
        if self._segments and segment.kind == last.kind:
            points = np.vstack([self._segments.pop().points, points[1:]])
        self._segments.append(Segment(segment.kind, points))

    def plan(self, dock: Point | None) -> CoveragePlan:
        """All of it; without a dock it ends with the last sweep."""
        if dock is None and len(self._segments) > 1 and self._segments[-1].kind == "travel":
            self._segments.pop()
        reachable = shapely.union_all([one.reachable for one in self._plans])
        left = reachable.difference(band_of(self._segments, self._machine.width_m))
        uncovered = MultiPolygon(polygons_in(left))
        return CoveragePlan(
            segments=tuple(self._segments),
            space=MultiPolygon([part for one in self._plans for part in one.space.geoms]),
            reachable=MultiPolygon(polygons_in(reachable)),
            covered=MultiPolygon(polygons_in(reachable.difference(uncovered))),
            uncovered=uncovered,
            unreachable=MultiPolygon(polygons_in(self._free.difference(reachable))),
            angle_rad=self._plans[0].angle_rad,
        )


def _point(place: F64) -> Point:
    return float(place[0]), float(place[1])
