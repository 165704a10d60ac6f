"""Shortest ways from A to B on a floor, and why there is none.

The way is the shortest of all that keep the machine off the walls, not of those along a grid.
"""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from core.paths.geometry.rings import length_of
from core.paths.geometry.space import SMOOTH_M, FloorError, kept_m, narrowed, polygons_in, repaired
from core.paths.geometry.visibility import VisibilityGraph
from core.records import F64

STEPS = 20  # halvings in the search for the widest gap
MOST_DIGITS = 9  # behind the point, of metres in words
Point = tuple[float, float]
Why = Literal["start", "goal", "gap", "wall"]


@dataclass(frozen=True, slots=True, eq=False)
class Way:
    """From start to goal."""

    points: F64  # (n, 2) m, both ends with it
    turns_rad: F64  # (n - 2,) on the spot at each corner, to the left

    @property
    def length_m(self) -> float:
        return length_of(self.points)


@dataclass(frozen=True, slots=True)
class NoWay:
    """Why there is none."""

    why: Why  # start, goal: too near to a wall, or off the floor; gap: too narrow; wall: no gap
    needed_m: float  # that is enough: of a gap, or from a start or goal to the wall
    there_m: float  # that there is; negative: so far off the floor
    place: Point  # where: the start or goal, or the gap's narrowest place

    def describe(self) -> str:
        """In one line."""
        x, y = self.place
        if self.why == "wall":
            return "start and goal: walls part them, there is no gap at all"
        if self.there_m == -math.inf:
            return "there is no floor at all"
        if self.there_m <= -(0.1**MOST_DIGITS):
            digits = _digits(-self.there_m)
            return f"{self.why}: {x:g},{y:g} lies {-self.there_m:.{digits}f} m off the floor"
        short_m = self.needed_m - self.there_m
        digits = _digits(short_m)
        there, short = f"{abs(self.there_m):.{digits}f}", f"{short_m:.{digits}f}"
        needed = f"{math.ceil(self.needed_m * 10**digits) / 10**digits:.{digits}f}"
        if self.why == "gap":
            return (
                f"the widest gap between start and goal is {there} m wide, at {x:.2f},{y:.2f}: "
                f"{short} m too narrow, must be {needed} m"
            )
        return f"{self.why}: {x:g},{y:g} is {there} m from a wall or obstacle, must be {needed} m"


def _digits(least_m: float) -> int:
    """How many behind the point show that it is not nothing; 3 or more."""
    return next((n for n in range(3, MOST_DIGITS) if least_m >= 0.1**n), MOST_DIGITS)


def find_way(floor: BaseGeometry, margin_m: float, start: Point, goal: Point) -> Way | NoWay:
    """The shortest way that keeps `margin_m` from everything that is no floor.

    Raises FloorError: coordinates that are no numbers.
    """
    ends: dict[Why, Point] = {"start": start, "goal": goal}
    for name, (x, y) in ends.items():
        if not (math.isfinite(x) and math.isfinite(y)):
            raise FloorError(f"{name}: must be two finite numbers, is {x:g},{y:g}")
    free = repaired(floor)
    space = polygons_in(narrowed(free, margin_m))
    homes = []
    for name, end in ends.items():
        point = shapely.Point(end)
        home = next((part for part in space if part.covers(point)), None)
        if home is None:
            return NoWay(name, _enough_m(margin_m), _from_walls(free, point), end)
        homes.append(home)
    if homes[0] is not homes[1]:
        return _gap(free, margin_m, start, goal)
    points = VisibilityGraph(homes[0]).way(np.array(start), np.array(goal))
    assert points is not None  # one connected polygon
    return Way(points, turns_along(points))


def turns_along(points: F64) -> F64:
    """(n - 2,) rad to the left at the corners of a line (n, 2), the shorter way round."""
    looks = np.arctan2(*np.diff(points, axis=0).T[::-1])
    return np.asarray((np.diff(looks) + math.pi) % (2 * math.pi) - math.pi)


def _enough_m(margin_m: float) -> float:
    """To a wall, whatever the corners of the space are."""
    return kept_m(margin_m) + SMOOTH_M


def _from_walls(free: BaseGeometry, point: shapely.Point) -> float:
    """Metres to the nearest wall; negative outside."""
    if free.is_empty:
        return -math.inf
    return float(free.boundary.distance(point)) * (1.0 if free.covers(point) else -1.0)


def _gap(free: BaseGeometry, margin_m: float, start: Point, goal: Point) -> NoWay:
    """The gap that lets most through, by halving."""
    ends = shapely.points([start, goal])
    needed_m = 2 * _enough_m(margin_m)
    low, high, home = 0.0, margin_m, None
    for _ in range(STEPS):
        middle = (low + high) / 2
        found = [p for p in polygons_in(narrowed(free, middle)) if p.covers(ends).all()]
        if found:
            low, home = middle, found[0]
        else:
            high = middle
    if home is None:
        return NoWay("wall", needed_m, 0.0, start)
    points = VisibilityGraph(home).way(np.array(start), np.array(goal))
    assert points is not None
    line = shapely.get_coordinates(shapely.segmentize(shapely.LineString(points), margin_m / 4))
    narrow = int(np.argmin(free.boundary.distance(shapely.points(line))))
    place = float(line[narrow, 0]), float(line[narrow, 1])
    return NoWay("gap", needed_m, 2 * kept_m(low), place)
