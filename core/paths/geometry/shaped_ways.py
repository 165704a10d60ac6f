"""Ways from A to B of a machine that is no disc: through passages in which it cannot turn round.

It drives straight ahead and turns on the spot. Its way is searched over

    state   a place, and an arc of headings, all of them free there: within it, it can turn
    leg     from state to state, where the machine meets nothing on it, and its heading is in both

Places are corners of the space in which the circle round the machine is free, and for passages that
are narrower than this circle points of their middle lines and of a grid. The shortest way over
these legs is found, which is not always the shortest of all.
"""

import heapq
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
import shapely
from shapely import LineString, Polygon, affinity
from shapely.geometry.base import BaseGeometry

from core.paths.geometry.shape_kernels import free_headings, free_legs
from core.paths.geometry.space import FloorError, grown, narrowed, polygons_in, repaired
from core.paths.geometry.visibility import graph_of, wall_edges
from core.paths.geometry.ways import NoWay, Point, Way, find_way, turns_along
from core.records import F64

HEADINGS = 360  # of a turn: turns are looked at by degrees
GRID, FINE = 0.5, 0.25  # of the widest disc in the machine: from place to place in passages
REACH = 2.0  # circles' radii: longest leg from a place in a passage
LEAST_M = 0.1  # of that disc's radius, as grids go: a thinner machine gets none that is finer
WALL_POINTS = 4  # in that disc's radius along walls: middle lines are off by 1/128 of it
WIDE = 0.98  # of that radius is free along the middle of a passage, but for that
MOUTH = 1.5  # circles' radii from walls: so far passages are followed out of them
CORNER_M = 0.05  # way that a corner is worth: the machine stands there
AS_SHORT_M = 1e-3  # a way that is no more longer than the shortest is it
Bools = npt.NDArray[np.bool_]
Geometries = npt.NDArray[np.object_]
Ints = npt.NDArray[np.integer[Any]]
Legs = tuple[Ints, F64, Ints]  # (n,) each: to places, metres, numbers of their headings
State = tuple[int, int]  # a place, and one of its arcs


class Shape:
    """What a machine covers, about the point that it turns about: the hull of that and its corners.

    Attributes:
        hull: what it covers, clearance too, where it looks along x.
        far_m: radius of the circle round it, about the same point.
        near_m: of the circle within it, about the same point.
        wide_m: of the largest circle within it.
        thick_m: the same, `LEAST_M` at least.
        left_m: its middle, from left to right, lies so far to the left.
        ahead, turning: (n, 3) half planes, a x + b y <= c: of what it covers, x ahead and y to the
            left, and of what it covers while it turns by one heading of `HEADINGS`.
    """

    def __init__(self, corners: Sequence[Point], clearance_m: float) -> None:
        """Raises FloorError: it has no area."""
        points = shapely.points(np.vstack([np.array(corners, float), np.zeros((1, 2))]))
        hull = shapely.convex_hull(shapely.MultiPoint(points))
        if not isinstance(hull, Polygon):
            raise FloorError("footprint: must have an area, its corners lie on a line")
        hull = shapely.convex_hull(grown(hull, clearance_m)) if clearance_m > 0 else hull
        self.hull = hull
        self.near_m = float(hull.exterior.distance(shapely.Point(0, 0)))
        self.wide_m = float(shapely.maximum_inscribed_circle(hull).length)
        self.thick_m = max(self.wide_m, LEAST_M)
        right_m, left_m = hull.bounds[1], hull.bounds[3]
        self.left_m = (left_m + right_m) / 2
        sides = [[0.0, 1.0, left_m], [0.0, -1.0, -right_m]]  # of what it sweeps straight ahead
        self.ahead = np.vstack([_planes(hull), sides])
        half_rad = math.pi / HEADINGS
        both = [affinity.rotate(hull, a, (0, 0), use_radians=True) for a in (-half_rad, half_rad)]
        swept = shapely.convex_hull(shapely.union_all(both))
        out = 1.0 / math.cos(half_rad)  # corners swing out between both
        swept = affinity.scale(swept, out, out, origin=(0, 0))
        self.turning = _planes(swept)
        self.far_m = float(np.hypot(*shapely.get_coordinates(swept).T).max())


def _planes(convex: Polygon) -> F64:
    """(n, 3) of the half planes that it lies in."""
    points = shapely.get_coordinates(shapely.normalize(convex).exterior)
    edges = np.diff(points, axis=0) * (1.0 if convex.normalize().exterior.is_ccw else -1.0)
    normals = np.column_stack([edges[:, 1], -edges[:, 0]]) / np.hypot(*edges.T)[:, None]
    return np.column_stack([normals, (normals * points[:-1]).sum(axis=1)])


@dataclass(frozen=True, slots=True)
class NoFit:
    """A disc would get through; for this machine no way was found, and why."""

    why: Literal["start", "goal", "way"]
    place: Point  # the start, the goal, or how far along the disc's way it was brought
    heading_rad: float | None = None  # that was asked for

    def describe(self) -> str:
        """In one line."""
        x, y = self.place
        if self.why == "way":
            there = f"{x:.2f},{y:.2f}"
            return f"the machine can be brought to {there}: it cannot turn or drive on there"
        look = "in any direction"
        if self.heading_rad is not None:
            look = f"at {math.degrees(self.heading_rad):g} deg"
        return f"{self.why}: at {x:g},{y:g} the machine does not fit {look}"


def find_shaped_way(
    floor: BaseGeometry,
    shape: Shape,
    start: Point,
    goal: Point,
    start_rad: float | None = None,
    goal_rad: float | None = None,
) -> Way | NoWay | NoFit:
    """A way on which the machine looks along each leg, and turns on the spot between two.

    Args:
        floor: free floor as polygons, metres.
        start_rad, goal_rad: where it looks first, and last; None: as it likes.

    Raises:
        FloorError: coordinates that are no numbers.
    """
    least = find_way(floor, shape.near_m, start, goal)
    if isinstance(least, NoWay):
        return least
    whole = find_way(floor, shape.far_m, start, goal)
    if isinstance(whole, Way) and whole.length_m <= least.length_m + AS_SHORT_M:
        return whole
    free = part_at(floor, start)
    first, last = (
        None if angle is None else int(_headings(np.array(angle)))
        for angle in (start_rad, goal_rad)
    )
    for along in (None, LineString(least.points)):
        roadmap = Roadmap(free, shape, np.array([start, goal], float), along)
        if not roadmap.fits(0, first):
            return NoFit("start", start, start_rad)
        if not roadmap.fits(1, last):
            return NoFit("goal", goal, goal_rad)
        search = roadmap.search(0, 1, first, last)
        nodes = search.nodes_to(1)
        ways = [] if nodes is None else [roadmap.straightened(nodes, first, last)]
        ways += [whole] if isinstance(whole, Way) else []
        if ways:
            return min(ways, key=lambda way: way.length_m)
    reached = roadmap.points[search.reached()]
    return NoFit("way", _farthest(least.points, reached, shape.wide_m))


def off_floor_m2(floor: BaseGeometry, shape: Shape, way: Way) -> float:
    """Area beside the floor that it is over on a way; turns are looked at by degrees."""
    steps = np.diff(way.points, axis=0)
    looks = np.degrees(np.arctan2(steps[:, 1], steps[:, 0]))

    def over(place: F64, look: float) -> BaseGeometry:
        return affinity.translate(affinity.rotate(shape.hull, look, (0, 0)), *place)

    parts = [
        shapely.convex_hull(shapely.union(over(a, look), over(b, look)))
        for look, a, b in zip(looks, way.points[:-1], way.points[1:], strict=True)
    ]
    shapely.prepare(floor)
    for place, look, turn_rad in zip(way.points[1:-1], looks[:-1], way.turns_rad, strict=True):
        if not floor.covers(shapely.Point(place).buffer(shape.far_m)):
            turn = math.degrees(turn_rad)
            parts += [over(place, look + d) for d in np.arange(0.0, turn, math.copysign(1, turn))]
    return float(shapely.union_all(parts).difference(floor).area)


def part_at(floor: BaseGeometry, place: Point) -> Polygon:
    """The part of a floor that a place on it is in."""
    return next(p for p in polygons_in(repaired(floor)) if p.covers(shapely.Point(place)))


def _headings(angles_rad: F64) -> Ints:
    """Numbers of the nearest ones."""
    return np.rint(angles_rad / (2 * math.pi) * HEADINGS).astype(np.int64) % HEADINGS


def _farthest(way: F64, reached: F64, within_m: float) -> Point:
    """The last place of a way (n, 2) to which one of `reached` (n, 2) is near."""
    line = shapely.get_coordinates(shapely.segmentize(LineString(way), within_m / 2))
    near = shapely.STRtree(shapely.points(reached)).query(
        shapely.points(line), predicate="dwithin", distance=within_m
    )
    last = line[near[0].max(initial=0)]
    return float(last[0]), float(last[1])


class Roadmap:
    """Places and the legs between them; those of a place are looked for when asked.

    Attributes:
        points: (n, 2) the places; those that were asked for come first.
        is_in: (k, n) whether each lies in a part of the circle's space.
    """

    def __init__(
        self, free: Polygon, shape: Shape, ends: F64, along: LineString | None = None
    ) -> None:
        """`ends`: (m, 2) places to come from or go to, on the floor; `along`: a way that gets a
        finer grid around it."""
        self._shape, self._walls, self._ends = shape, wall_edges(free), len(ends)
        space = polygons_in(narrowed(free, shape.far_m))
        self._graphs = [graph_of(part) for part in space]
        corners = [graph.nodes for graph in self._graphs]
        self._first = np.cumsum([len(ends), *map(len, corners)])
        points = np.vstack([ends, *corners, places_in_passages(free, shape, ends, along)])
        places = shapely.points(points)
        is_in = np.zeros((len(space), len(points)), np.bool_)
        is_narrow = np.ones(len(points), np.bool_)
        for number, part in enumerate(space):
            is_in[number] = shapely.covers(part, places)
            is_narrow &= ~is_in[number]
        arcs = self._arcs_of(points, is_narrow)
        is_kept = arcs.max(axis=1) >= 0
        is_kept[: self._first[-1]] = True
        self.points, self.arcs, self.is_in = points[is_kept], arcs[is_kept], is_in[:, is_kept]
        self._tree = shapely.STRtree(places[is_kept])
        self._legs: dict[int, Legs] = {}

    def _arcs_of(self, points: F64, is_narrow: Bools) -> Ints:
        """(places, headings) number of the arc that a heading is in; -1: it is not free."""
        free = np.ones((len(points), HEADINGS), np.bool_)
        narrow = np.empty((np.count_nonzero(is_narrow), HEADINGS), np.bool_)
        shape = self._shape
        free_headings(self._walls, shape.turning, shape.far_m, points[is_narrow], narrow)
        free[is_narrow] = narrow
        arcs = np.cumsum(free & ~np.roll(free, 1, axis=1), axis=1, dtype=np.int16)
        arcs = np.where(arcs == 0, arcs[:, -1:], arcs)  # the last one goes on past 360 degrees
        return np.where(free, arcs, -1)

    def fits(self, place: int, heading: int | None) -> bool:
        """Whether the machine can stand there; None: in any direction."""
        arcs = self.arcs[place]
        return bool((arcs if heading is None else arcs[heading : heading + 1]).max() >= 0)

    def search(
        self, start: int, goal: int | None, first: int | None = None, last: int | None = None
    ) -> "_Search":
        """From a place to another one, or to all; first, last: headings there, None: any."""
        return _Search(self, self.legs_from, start, goal, first, last)

    def straightened(
        self, nodes: Sequence[int], first: int | None = None, last: int | None = None
    ) -> Way:
        """The shortest way over some of these places, however long its legs."""
        among = {node: self._free_legs(node, np.array(nodes)) for node in nodes}
        search = _Search(self, among.__getitem__, nodes[0], nodes[-1], first, last)
        over = search.nodes_to(nodes[-1])
        assert over is not None
        points = self.points[over]
        turns = turns_along(points)
        looks = np.arctan2(*np.diff(points, axis=0).T[::-1])
        for k, (node, turn) in enumerate(zip(over[1:-1], turns, strict=True)):
            between = looks[k] + np.linspace(0.0, turn, HEADINGS)
            if self.arcs[node, _headings(between)].min() < 0:  # so it is free the longer way round
                turns[k] -= math.copysign(2 * math.pi, turn)
        return Way(points, turns)

    def legs_from(self, node: int) -> Legs:
        """To places within reach, and to those that see it in a space of the circle."""
        if node not in self._legs:
            point = self.points[node]
            reach_m = REACH * self._shape.far_m
            others = [self._tree.query(shapely.Point(point), "dwithin", reach_m)]
            for part in np.flatnonzero(self.is_in[:, node]):
                seen = [at for at, _ in self._graphs[part].seen_from(point)]
                others.append(self._first[part] + np.array(seen, np.int64))
                others.append(np.flatnonzero(self.is_in[part, : self._ends]))
            self._legs[node] = self._free_legs(node, np.concatenate(others))
        return self._legs[node]

    def _free_legs(self, node: int, others: Ints) -> Legs:
        """Those on which nothing is met."""
        x, y = self.points[node]
        ends = self.points[others]
        free = np.empty(len(others), np.bool_)
        shape = self._shape
        free_legs(self._walls, shape.ahead, shape.far_m, x, y, ends, free)
        way = ends[free] - self.points[node]
        headings = _headings(np.arctan2(way[:, 1], way[:, 0]))
        return others[free], np.hypot(*way.T), headings


class _Search:
    """Shortest ways over states from one place: A* to another one, or Dijkstra's to all."""

    ANY = -2  # number of an arc: any heading may be had; it stands last in rows of arcs

    def __init__(
        self, roadmap: Roadmap, legs_from: Callable[[int], Legs], start: int, goal: int | None,
        first: int | None, last: int | None,
    ) -> None:  # fmt: skip
        points, of = roadmap.points, roadmap.arcs
        to_go = np.zeros(len(points)) if goal is None else np.hypot(*(points - points[goal]).T)
        begin = start, self.ANY if first is None else int(of[start, first])
        end = self._end = goal, self.ANY if None in (goal, last) else int(of[goal, last])
        self._cost = np.full((len(points), int(of.max()) + 1 - self.ANY), math.inf)
        self._cost[begin] = 0.0
        self._came_from, self._done = dict[State, State](), set[State]()
        heap = [(float(to_go[start]), begin)]
        while heap:
            _, state = heapq.heappop(heap)
            if state in self._done:
                continue
            self._done.add(state)
            if state == end:
                break
            node, arc = state
            others, far, headings = legs_from(node)
            arcs = of[others, headings]
            if last is None:
                arcs[others == goal] = self.ANY
            costs = self._cost[state] + far + CORNER_M
            may_go = (arc == self.ANY) | (of[node, headings] == arc)
            is_better = may_go & (arcs != -1) & (costs < self._cost[others, arcs])
            for k in np.flatnonzero(is_better):
                there = int(others[k]), int(arcs[k])
                self._cost[there], self._came_from[there] = costs[k], state
                heapq.heappush(heap, (float(costs[k] + to_go[there[0]]), there))

    def reached(self) -> list[int]:
        """All places to which there is a way."""
        return sorted({node for node, _ in self._done})

    def nodes_to(self, goal: int) -> list[int] | None:
        """The places of the shortest way there, if there is one."""
        state = self._end
        if goal != state[0]:  # of a search for all
            arc = int(np.argmin(self._cost[goal]))
            state = goal, arc if arc < self._cost.shape[1] + self.ANY else self.ANY
        if state not in self._done:
            return None
        states = [state]
        while states[-1] in self._came_from:
            states.append(self._came_from[states[-1]])
        return [node for node, _ in states[::-1]]


def places_in_passages(
    free: Polygon, shape: Shape, ends: F64, along: LineString | None = None
) -> F64:
    """(n, 2) where the machine may drive, and turn a little, though the circle is not free there.

    Of passages that lead on, or to an end, (k, 2): points of their middle lines, a little way out
    of them too, and a grid around. Around `along` it is finer.
    """
    middles = _middles(free, shape, ends)
    grids = [_grid(free, shapely.points(np.vstack([middles, ends])), GRID, shape)]
    grids += [] if along is None else [_grid(free, shapely.get_parts(along), FINE, shape)]
    return np.vstack([middles, *grids])


def _grid(free: Polygon, things: Geometries, share: float, shape: Shape) -> F64:
    """(n, 2) on the floor and near to things."""
    low, high = np.split(shapely.total_bounds(things), 2)
    step_m, m = share * shape.thick_m, shape.far_m
    x, y = np.meshgrid(*(np.arange(a - m, b + m, step_m) for a, b in zip(low, high, strict=True)))
    is_floor = shapely.contains_xy(free, x, y)
    places = shapely.points(x[is_floor], y[is_floor])
    near, _ = shapely.STRtree(things).query(places, predicate="dwithin", distance=shape.far_m)
    return np.asarray(shapely.get_coordinates(places[np.unique(near)]))


def _middles(free: Polygon, shape: Shape, ends: F64) -> F64:
    """(n, 2) places for the machine that put its middle on those of passages.

    Source: edges of the Voronoi diagram, as O'Dunlaing and Yap, A retraction method for planning
    the motion of a disc, 1985; here of points along the walls.
    """
    walls = shapely.get_coordinates(shapely.segmentize(free.boundary, shape.thick_m / WALL_POINTS))
    cells = shapely.voronoi_polygons(shapely.MultiPoint(walls), only_edges=True)
    lines = shapely.get_coordinates(shapely.get_parts(cells)).reshape(-1, 2, 2)
    corners, number = np.unique(lines.reshape(-1, 2).round(6), axis=0, return_inverse=True)
    places = shapely.points(corners)
    clear_m = shapely.distance(free.boundary, places) * shapely.covers(free, places)
    number = number.reshape(-1, 2)
    is_free = (clear_m[number] > WIDE * shape.wide_m).all(axis=1)
    number = number[is_free & (number[:, 0] != number[:, 1])]
    far = np.hypot(*np.moveaxis(corners[:, None] - ends, 2, 0)).min(axis=1)
    leads_on = (clear_m >= shape.far_m) | (far < shape.far_m)
    while True:  # what ends leads nowhere
        is_end = (np.bincount(number.ravel(), minlength=len(corners)) == 1) & ~leads_on
        if not is_end[number].any():
            break
        number = number[~is_end[number].any(axis=1)]
    number = number[(clear_m[number] < MOUTH * shape.far_m).any(axis=1)]
    step_m = GRID * shape.thick_m
    lines = shapely.segmentize(shapely.linestrings(corners[number]), step_m)
    middle, of = shapely.get_coordinates(lines, return_index=True)
    way = np.diff(corners[number], axis=1)[of, 0]
    aside = np.column_stack([-way[:, 1], way[:, 0]]) / np.hypot(*way.T)[:, None] * shape.left_m
    found = np.vstack([middle - aside, middle + aside])
    cell = np.floor(found / step_m).astype(np.int64)
    return found[np.unique(cell, axis=0, return_index=True)[1]]
