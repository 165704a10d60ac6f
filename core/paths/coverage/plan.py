"""Plans a path that sweeps a floor: contours or lanes, their order, then small improvements.

Method and its limits: docs/coverage.md. Nothing here is chance or time: the same floor gives the
same plan.
"""

import math
from collections.abc import Sequence
from typing import Literal

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from core.paths.coverage.contours import contour_pieces
from core.paths.coverage.measures import band_of
from core.paths.coverage.patches import nearest_in, wall_strokes
from core.paths.coverage.raster import FINER, NONE, Raster, edges_along
from core.paths.coverage.refine import Refiner, modes_of
from core.paths.coverage.sweep import QUARTER, Piece, Sweeper, rotated, turned
from core.paths.coverage.tours import linked, looped, ordered, snapped
from core.paths.geometry.rings import Walls, length_of
from core.paths.geometry.space import FloorError, grown, largest, narrowed, polygons_in, repaired
from core.paths.geometry.visibility import VisibilityGraph, graph_of
from core.paths.records import CoveragePlan, Kind, Machine, Segment
from core.records import F64

STROKE = (
    0.35  # a missed area of more than that share of a square of the width gets a line of its own
)
STROKE_ROUNDS = 2
PRICES = (  # what a change must win, of what a lane in the open does; rows are tried in turn
    (0.4, 0.2, 0.1),
    (0.3, 0.1),
)
FIRST = ((0.6, 0.4, 0.3, 0.2),)  # where later plans win the rest,
LAST = ((0.1, 0.04, 0.02),)  # with the tool up on the way to it
ENOUGH = 0.996  # of the raster; more is bought at no lower price
SMALL = 150  # squares of the width: up to that all rows are tried
SPECK = 0.003  # smaller missed areas, of a square of the width, get no detour
SPREAD_RAD = 0.03  # walls within that are taken to run one way
SMOOTH = 0.2  # of the width: steps of walls up to that do not count for the lanes' direction
Point = tuple[float, float]
Style = Literal["contours", "lanes"]
_Path = tuple[float, F64, list[bool], float]


def plan_coverage(
    floor: BaseGeometry,
    machine: Machine,
    start: Point | None = None,
    dock: Point | None = None,
    rooms: Sequence[BaseGeometry] = (),
    clean: BaseGeometry | None = None,
    angle_rad: float | None = None,
    is_refined: bool = True,
    old: F64 | None = None,
    prices: Sequence[Sequence[float]] = PRICES,
) -> CoveragePlan:
    """A path over all of the floor that the machine can get to.

    Args:
        floor: free floor as polygons, metres.
        start: where the path begins; the dock if there is one, else where it is best.
        dock: near which the path ends; the last segment travels there.
        rooms: polygons; one is done after the other, then what lies in none.
        clean: area that need not be swept.
        angle_rad: of the lanes; None: along the walls, whichever way is less work.
        is_refined: False: lanes stay exactly as far apart as the machine asks.
        old: what is left of a path (n, 2), for a floor that was a little otherwise. It is mended,
            and goes on if nothing new is worth more.
        prices: rows of them, as `PRICES`; all but the first are tried on small floors. They and
            `old` are for paths that are refined, at no given angle.

    Raises:
        FloorError: no room for the machine; coordinates that are no numbers; start or dock off the
            floor.
    """
    free = repaired(floor)
    begin = dock if start is None else start
    space = space_at(free, machine, begin, "dock" if start is None else "start")
    angle = main_angle(free, machine.width_m) if angle_rad is None else angle_rad
    target = grown(space, machine.width_m / 2).intersection(free)
    todo = target if clean is None else target.difference(repaired(clean))
    is_small = todo.area < SMALL * machine.width_m**2
    if angle_rad is None and is_refined:
        work = _Work(space, todo, rooms, machine, angle, "contours")
        paths = [work.path(begin, dock, row) for row in prices[: None if is_small else 1]]
        if old is not None and len(old) > 1 and not todo.is_empty:
            paths.append(work.path(begin, dock, prices[0], old))
    else:
        angles = [angle, angle + QUARTER] if angle_rad is None else [angle]
        works = [_Work(space, todo, rooms, machine, each, "lanes") for each in angles]
        least = min(works, key=lambda work: work.work_m)
        paths = [least.path(begin, dock, prices[0] if is_refined else ())]
    best = max(paths, key=lambda path: path[0])
    return _plan(free, space, target, todo, *best[1:], machine)


def main_angle(floor: BaseGeometry, width_m: float) -> float:
    """The direction of most walls, modulo a quarter turn."""
    smooth = shapely.simplify(floor, SMOOTH * width_m)
    rings = [ring for p in polygons_in(smooth) for ring in (p.exterior, *p.interiors)]
    edges = np.vstack([np.diff(shapely.get_coordinates(ring), axis=0) for ring in rings])
    lengths = np.hypot(*edges.T)
    angles = np.arctan2(edges[:, 1], edges[:, 0]) % QUARTER
    apart = np.abs((angles[:, None] - angles + QUARTER / 2) % QUARTER - QUARTER / 2)
    votes = (lengths * np.exp(-((apart / SPREAD_RAD) ** 2))).sum(axis=1)
    return float(angles[np.argmax(np.round(votes, 6))])


def space_at(
    free: MultiPolygon, machine: Machine, begin: Point | None, what: str = "start"
) -> Polygon:
    """The part of the space that the machine is in, or the largest.

    Args:
        what: begins there, in the words of an error.

    Raises:
        FloorError: it has no room, or that point is none of its.
    """
    parts = polygons_in(narrowed(free, machine.margin_m))
    if not parts:
        widest_m = max(
            (shapely.maximum_inscribed_circle(p).length for p in polygons_in(free)), default=0.0
        )
        raise FloorError(
            f"the machine has no room: needs {machine.margin_m:g} m around its centre, the widest "
            f"place has {widest_m:.3f} m"
        )
    if begin is None:
        return largest(parts)
    if not np.isfinite(begin).all():
        raise FloorError(f"{what}: must be two finite numbers, is {begin[0]:g},{begin[1]:g}")
    point = shapely.Point(begin)
    far_m = [part.distance(point) for part in parts]
    nearest = int(np.argmin(far_m))
    if far_m[nearest] > machine.margin_m + machine.width_m:
        raise FloorError(
            f"{what}: {begin[0]:g},{begin[1]:g} is {far_m[nearest]:.2f} m from where the machine "
            f"fits, must be at most {machine.margin_m + machine.width_m:g} m"
        )
    return parts[nearest]


class _Work:
    """One floor, turned so that lanes run along x."""

    def __init__(
        self,
        space: Polygon,
        todo: BaseGeometry,
        rooms: Sequence[BaseGeometry],
        machine: Machine,
        angle_rad: float,
        style: Style,
    ) -> None:
        self._angle_rad, self._style = angle_rad, style
        turn_rad = -angle_rad
        self._machine = machine
        self._space = turned(space, turn_rad)
        self._todo = polygons_in(shapely.transform(todo, lambda p: rotated(p, turn_rad)))
        regions = _regions(space, todo, rooms, machine.width_m)
        self._regions = [[turned(part, turn_rad) for part in region] for region in regions]
        self._groups, self._raster, self.work_m = self._pieces()
        self._toured: tuple[VisibilityGraph, list[list[F64]]] | None = None

    def _inside(self, point: Point) -> F64:
        """The nearest place for the machine's centre, (2,)."""
        near: F64 = nearest_in(self._space, rotated(np.array([point]), -self._angle_rad))[0]
        return near

    def _pieces(self) -> tuple[list[list[Piece]], Raster, float]:
        """Pieces by region, the raster with all of them on it, and the metres of work."""
        raster = Raster(self._todo or [self._space], self._machine.width_m)
        groups: list[list[Piece]] = []
        work_m = 0.0
        for region in self._regions:
            groups.append([])
            for part in region if self._todo else []:
                if self._style == "contours":
                    groups[-1] += contour_pieces(part, self._todo, self._machine, raster)
                    continue
                sweeper = Sweeper(part, self._machine.spacing_m)
                found, metres = sweeper.best_pieces(raster)
                groups[-1] += found
                work_m += metres
        return groups, raster, work_m

    def _strokes(self) -> None:
        """Lines along walls for large areas that the lanes leave out."""
        walls, width_m = Walls(self._space), self._machine.width_m
        for _ in range(STROKE_ROUNDS):
            for area in self._raster.missed(STROKE * width_m**2):
                for stroke in wall_strokes(area, walls, self._space, width_m):
                    if self._raster.gain(NONE, edges_along(stroke)) > 0:
                        self._raster.gain(NONE, edges_along(stroke), keep=True)
                        self._groups[self._region_at(stroke.mean(axis=0))].append(Piece((stroke,)))

    def _region_at(self, point: F64) -> int:
        here = shapely.Point(point)
        far = [min((p.distance(here) for p in r), default=math.inf) for r in self._regions]
        return int(np.argmin(far))

    def path(
        self, begin: Point | None, dock: Point | None, prices: Sequence[float],
        old: F64 | None = None,
    ) -> _Path:  # fmt: skip
        """What it is worth in m2; (n, 2) corners; whether each edge sweeps; the lanes' angle.

        Along an older path (n, 2), if there is one. Its length counts at the price at which the
        last of the floor was bought: else a path that sweeps more, dearly, is better than its like.
        """
        start, end = (None if p is None else self._inside(p) for p in (begin, dock))
        graph, lines = self._tour(start, end)
        if old is not None:
            lines = [[nearest_in(self._space, rotated(old, -self._angle_rad))]]
        self._raster.clear()
        refiners: list[Refiner] = []
        here = start
        for each in lines:
            path = linked(each, graph, here)
            if len(path) > 1:
                refiners.append(Refiner(path, self._raster, graph, self._machine.width_m))
                here = path[-1]
        if not refiners:  # nothing is left to sweep
            way = None if start is None or end is None else graph.way(start, end)
            points = np.empty((0, 2)) if way is None else way
            return 0.0, rotated(points, self._angle_rad), [False] * len(points[1:]), self._angle_rad
        raster = self._raster
        if prices:
            refiners, raster = self._refined(refiners, prices, start is None, end is None)
        points = np.vstack([refiners[0].points, *(r.points[1:] for r in refiners[1:])])
        sweeps = modes_of(points, raster, self._machine.width_m)
        home = None if end is None else graph.way(points[-1], end)
        if home is not None and math.dist(points[-1], home[-1]) > 1e-9:
            points, sweeps = np.vstack([points, home[1:]]), sweeps + [False] * (len(home) - 1)
        worth = raster.area(raster.swept)
        worth -= min(prices, default=0.0) * self._machine.width_m * length_of(points)
        return worth, rotated(points, self._angle_rad), sweeps, self._angle_rad

    def _tour(self, start: F64 | None, end: F64 | None) -> tuple[VisibilityGraph, list[list[F64]]]:
        """Lines in their order, by region; made once."""
        if self._toured is None:
            self._strokes()
            graph = graph_of(self._space)
            spacing_m = self._machine.spacing_m
            groups = [
                looped(snapped(group, self._space), graph, spacing_m) for group in self._groups
            ]
            lines = ordered(groups, graph, start, end) if any(groups) else []
            self._toured = graph, lines
        return self._toured

    def _refined(
        self, refiners: list[Refiner], prices: Sequence[float], free_begin: bool, free_end: bool
    ) -> tuple[list[Refiner], Raster]:
        """The path made better; at last on a finer raster, that no strips are left along walls.

        Args:
            free_begin, free_end: the path may begin, or end, anywhere.
        """
        for price in prices:
            for refiner in refiners:
                refiner.tighten(price)
            if free_begin:
                refiners[0].trim(price, is_first=True)
            if free_end:
                refiners[-1].trim(price, is_first=False)
            for area in self._raster.missed(SPECK * self._machine.width_m**2):
                middle = area.mean(axis=0)
                near = min(refiners, key=lambda r: r.distance(middle), default=None)
                if near is not None:
                    near.patch(area, price)
            if self._raster.share >= ENOUGH:
                break
        fine = Raster(self._todo or [self._space], self._machine.width_m, FINER)
        found = [refiner.on(fine) for refiner in refiners]
        for refiner in found:
            refiner.tighten(price, is_last=True)
        return found, fine


def _regions(
    space: Polygon, todo: BaseGeometry, rooms: Sequence[BaseGeometry], width_m: float
) -> list[list[Polygon]]:
    """What is swept room by room: parts of the space; what lies in no room comes last."""
    rest: BaseGeometry = space
    if not grown(space, 1e-6).difference(todo).is_empty:
        rest = space.intersection(grown(todo, width_m / 20))
    regions = []
    for room in rooms:
        regions.append(polygons_in(rest.intersection(repaired(room))))
        rest = rest.difference(repaired(room))
    return [*regions, polygons_in(rest)]


def _plan(
    free: MultiPolygon,
    space: Polygon,
    target: BaseGeometry,
    todo: BaseGeometry,
    track: F64,
    sweeps: list[bool],
    angle_rad: float,
    machine: Machine,
) -> CoveragePlan:
    """The path as segments, and what it covers, measured on polygons."""
    segments: list[Segment] = []
    begin = 0
    for k in range(1, len(sweeps) + 1):
        if k == len(sweeps) or sweeps[k] != sweeps[begin]:
            kind: Kind = "sweep" if sweeps[begin] else "travel"
            segments.append(Segment(kind, track[begin : k + 1]))
            begin = k
    left = todo.difference(band_of(segments, machine.width_m)) if segments else todo
    uncovered = MultiPolygon(polygons_in(left))
    return CoveragePlan(
        segments=tuple(segments),
        space=MultiPolygon([space]),
        reachable=MultiPolygon(polygons_in(target)),
        covered=MultiPolygon(polygons_in(target.difference(uncovered))),
        uncovered=uncovered,
        unreachable=MultiPolygon(polygons_in(free.difference(target))),
        angle_rad=angle_rad,
    )
