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
from core.paths.geometry.space import narrowed, polygons_in, repaired
from core.paths.geometry.visibility import VisibilityGraph
from core.records import F64

STEPS = 20  # halvings in the search for the widest gap
Point = tuple[float, float]
Why = Literal["start", "goal", "gap", "wall"]


@dataclass(frozen=True, slots=True, eq=False)
class Way:
    """From start to goal."""

    points: F64  # (n, 2) m, both ends with it
    length_m: float


@dataclass(frozen=True, slots=True)
class NoWay:
    """Why there is none."""

    why: Why  # start, goal: too near to a wall, or off the floor; gap: too narrow; wall: no gap
    needed_m: float  # that the machine needs: of a gap, or from a start or goal to the wall
    there_m: float  # that there is; negative: so far off the floor
    place: Point  # where: the start or goal, or the gap's narrowest place

    def describe(self) -> str:
        """In one line."""
        x, y = self.place
        if self.why == "wall":
            return "start and goal: walls part them, there is no gap at all"
        if self.why == "gap":
            return (
                f"the widest gap between start and goal is {self.there_m:.3f} m wide, at "
                f"{x:.2f},{y:.2f}: {self.needed_m - self.there_m:.3f} m too narrow"
            )
        if self.there_m == -math.inf:
            return "there is no floor at all"
        if self.there_m < 0:
            return f"{self.why}: {x:g},{y:g} lies {-self.there_m:.3f} m off the floor"
        return (
            f"{self.why}: {x:g},{y:g} is {self.there_m:.3f} m from a wall or obstacle, "
            f"must be {self.needed_m:.3f} m"
        )


def find_way(floor: BaseGeometry, margin_m: float, start: Point, goal: Point) -> Way | NoWay:
    """The shortest way that keeps `margin_m` from everything that is no floor.

    Raises FloorError: coordinates that are no numbers.
    """
    free = repaired(floor)
    space = polygons_in(narrowed(free, margin_m))
    ends: dict[Why, Point] = {"start": start, "goal": goal}
    homes = []
    for name, end in ends.items():
        point = shapely.Point(end)
        home = next((part for part in space if part.covers(point)), None)
        if home is None:
            return NoWay(name, margin_m, _from_walls(free, point), end)
        homes.append(home)
    if homes[0] is not homes[1]:
        return _gap(free, margin_m, start, goal)
    points = VisibilityGraph(homes[0]).way(np.array(start), np.array(goal))
    assert points is not None  # one connected polygon
    return Way(points, length_of(points))


def _from_walls(free: BaseGeometry, point: shapely.Point) -> float:
    """Metres to the nearest wall; negative outside."""
    if free.is_empty:
        return -math.inf
    return float(free.boundary.distance(point)) * (1.0 if free.covers(point) else -1.0)


def _gap(free: BaseGeometry, margin_m: float, start: Point, goal: Point) -> NoWay:
    """The gap that lets most through, by halving."""
    ends = shapely.points([start, goal])
    low, high, home = 0.0, margin_m, None
    for _ in range(STEPS):
        middle = (low + high) / 2
        found = [p for p in polygons_in(narrowed(free, middle)) if p.covers(ends).all()]
        if found:
            low, home = middle, found[0]
        else:
            high = middle
    if home is None:
        return NoWay("wall", 2 * margin_m, 0.0, start)
    points = VisibilityGraph(home).way(np.array(start), np.array(goal))
    assert points is not None
    line = shapely.get_coordinates(shapely.segmentize(shapely.LineString(points), margin_m / 4))
    narrow = int(np.argmin(free.boundary.distance(shapely.points(line))))
    return NoWay("gap", 2 * margin_m, 2 * low, (float(line[narrow, 0]), float(line[narrow, 1])))
