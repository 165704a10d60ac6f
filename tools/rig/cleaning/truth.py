"""What is true of a hall, as polygons, and what a run was worth by it. Metres."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from core.paths.coverage.measures import swept_by
from core.paths.coverage.plan import space_at
from core.paths.geometry.space import grown, polygons_in
from core.paths.records import Machine
from core.records import F64
from fakes.scenes.halls import Hall
from fakes.scenes.movers import Mover
from fakes.scenes.solids import Pillar, Shape
from fakes.scenes.things import Thing

HIGH_M = 1.0  # of the machine: what begins higher does not bar its way
SAME_M = 0.05  # by which an object may stick out of what it is
TRUE_PART = 0.8  # so much of an object must lie within that
LEAST_M = 0.1  # things of that size and more are asked for
NEAR_M, FAR_M, ASIDE_RAD = 1.2, 3.5, math.radians(25.0)  # somebody there is well in view
STRAIGHT_M = 0.002  # of the true path, which is made of many short steps


class MapWorth(NamedTuple):
    """Objects of a map against what stands there at the end."""

    things: int
    missed: int
    objects: int
    false: int  # neither on a thing nor on a wall
    fragments: int  # further objects on a thing that has one
    of_people: int  # where people are and nothing else stands


class Truth:
    """One hall."""

    def __init__(self, hall: Hall) -> None:
        self.hall = hall
        fixed = [s for s in (*hall.walls, hall.dock, *_low(hall.things)) if s.bottom_m < HIGH_M]
        self._fixed = np.array([_box(shape) for shape in fixed])
        self.moved = hall.moved  # who carries it may wait

    def boxes_at(self, t_s: float) -> F64:
        """(n, 5) x0, x1, y0, y1 of all that stands at an instant, and its radius if it is round."""
        there = [_mover_box(one) for one in self.moved if one.from_s <= t_s < one.until_s]
        return np.vstack([self._fixed, *there]) if there else self._fixed

    def bars_at(self, t_s: float) -> BaseGeometry:
        """The same as polygons."""
        return shapely.union_all([_polygon(row) for row in self.boxes_at(t_s)])

    def free_at(self, t_s: float) -> BaseGeometry:
        (x0, x1), (y0, y1) = self.hall.inside
        return shapely.box(x0, y0, x1, y1).difference(self.bars_at(t_s))

    def is_in_view(
        self, place: Sequence[float], eye: tuple[float, float], at: tuple[float, float], t_s: float
    ) -> bool:
        """Whether a machine at x, y, yaw sees well what is there, with its lens at `eye`."""
        x, y, yaw = place
        off_rad = math.atan2(at[1] - y, at[0] - x) - yaw
        if not NEAR_M < math.dist((x, y), at) < FAR_M:
            return False
        if abs(math.remainder(off_rad, math.tau)) > ASIDE_RAD:
            return False
        return not shapely.LineString([eye, at]).intersects(self.bars_at(t_s))

    def reachable_at(self, t_s: float, machine: Machine, clear_m: float) -> BaseGeometry:
        """Floor that the tool gets to if the machine keeps so far from all that stands there."""
        free = MultiPolygon(polygons_in(self.free_at(t_s)))
        wider = Machine(
            radius_m=machine.radius_m, clearance_m=clear_m, width_m=machine.width_m, overlap_m=0.0
        )
        return grown(space_at(free, wider, (0.0, 0.0)), machine.width_m / 2).intersection(free)

    def outlines(self, t_s: float) -> list[Polygon]:
        """Of each thing that stands there at an instant."""
        rows = [
            [_box(s) for s in thing.shapes if s.bottom_m < HIGH_M] for thing in self.hall.things
        ]
        rows += [[_mover_box(one)] for one in self.moved if one.from_s <= t_s < one.until_s]
        return [shapely.union_all([_polygon(r) for r in each]).convex_hull for each in rows]


def band_of(steps: Sequence[F64], width_m: float) -> BaseGeometry:
    """What the tool swept, of true steps x, y, x, y in their order."""
    lines, line = list[F64](), list[F64]()
    for step in steps:
        if line and not np.array_equal(line[-1], step[:2]):
            lines.append(np.array(line))
            line = []
        line += [step[2:]] if line else [step[:2], step[2:]]
    if line:
        lines.append(np.array(line))
    straight = [shapely.simplify(shapely.LineString(one), STRAIGHT_M) for one in lines]
    return swept_by([shapely.get_coordinates(one) for one in straight], width_m / 2)


def gap_of(place: Sequence[float], boxes: F64, people: F64) -> tuple[float, str]:
    """From a point to the nearest of boxes (n, 5) and people (m, 3: x, y, radius), and which.

    A box is called by where it stands: walls, pillars and things have no other name here.
    """
    x, y = place[0], place[1]
    x0, x1, y0, y1, radius = boxes.T
    dx = np.maximum(np.maximum(x0 - x, x - x1), 0.0)
    dy = np.maximum(np.maximum(y0 - y, y - y1), 0.0)
    round_m = np.hypot((x0 + x1) / 2 - x, (y0 + y1) / 2 - y) - radius
    gaps_m = np.where(radius > 0.0, round_m, np.hypot(dx, dy))
    to_people_m = np.hypot(people[:, 0] - x, people[:, 1] - y) - people[:, 2]
    nearest = int(np.argmin(np.concatenate([gaps_m, to_people_m])))
    if nearest >= len(boxes):
        person = nearest - len(boxes)
        return float(to_people_m[person]), f"person {person + 1}"
    (left, right, low, high), gap_m = boxes[nearest, :4].tolist(), float(gaps_m[nearest])
    return gap_m, f"what stands at x {left:.2f} to {right:.2f} m, y {low:.2f} to {high:.2f} m"


def map_worth(truth: Truth, found: Sequence[Polygon], people: F64, t_s: float = 0.0) -> MapWorth:
    """Of the map's objects at an instant; people (m, 3)."""
    outlines = truth.outlines(t_s)
    walls = [_polygon(_box(wall)) for wall in (*truth.hall.walls, truth.hall.dock)]
    near = [one.buffer(SAME_M) for one in [*outlines, *walls]]
    owners = list[int]()
    for one in found:
        share = [one.intersection(other).area / one.area for other in near]
        best = int(np.argmax(share))
        owners.append(best if share[best] >= TRUE_PART else -1)
    asked = [k for k, one in enumerate(outlines) if _size(one) >= LEAST_M]
    fragments = sum(max(0, owners.count(k) - 1) for k in range(len(outlines)))
    false = [one for one, owner in zip(found, owners, strict=True) if owner < 0]
    of_people = [
        one for one in false if any(one.dwithin(shapely.Point(x, y), r) for x, y, r in people)
    ]
    missed = sum(k not in owners for k in asked)
    return MapWorth(len(asked), missed, len(found), len(false), fragments, len(of_people))


def _low(things: Sequence[Thing]) -> list[Shape]:
    return [shape for thing in things for shape in thing.shapes]


def _box(shape: Shape) -> F64:
    radius_m = shape.radius_m if isinstance(shape, Pillar) else 0.0
    return np.array([*shape.x, *shape.y, radius_m])


def _mover_box(mover: Mover) -> F64:
    (x, y), half = mover.waypoints[0], mover.parts[0].half_m
    assert half is not None
    return np.array([x - half[0], x + half[0], y - half[1], y + half[1], 0.0])


def _polygon(row: F64) -> Polygon:
    x0, x1, y0, y1, radius_m = row.tolist()
    if radius_m > 0.0:
        return shapely.Point((x0 + x1) / 2, (y0 + y1) / 2).buffer(radius_m)
    return shapely.box(x0, y0, x1, y1)


def _size(one: Polygon) -> float:
    x0, y0, x1, y1 = one.bounds
    return float(max(x1 - x0, y1 - y0))
