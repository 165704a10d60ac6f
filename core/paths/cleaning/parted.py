"""Floor that was seen, and that the machine cannot get to: what parts it off, somebody in a door.

He may be gone long since: a map keeps what nobody looks at. Map frame, metres.
"""

from collections.abc import Iterable

import shapely
from shapely import LineString, MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from core.paths.cleaning.frontiers import Point
from core.paths.cleaning.things import Thing
from core.paths.geometry.space import narrowed, polygons_in
from core.paths.records import Machine
from core.records import F64, Flags


def parted_off(free: BaseGeometry, machine: Machine, space: Polygon) -> MultiPolygon:
    """Places of the machine's centre that have no way to those where it is."""
    parts = polygons_in(narrowed(free, machine.margin_m))
    return MultiPolygon([part for part in parts if not part.intersects(space)])


def nearer(points: F64, to: BaseGeometry, than_to: BaseGeometry) -> Flags:
    """Of points (n, 2), which are nearer to one geometry than to another; to an empty one none."""
    corners = shapely.points(points)
    are: Flags = shapely.distance(corners, to) < shapely.distance(corners, than_to)
    return are


def between(
    things: Iterable[Thing], space: Polygon, beyond: MultiPolygon, near_m: float
) -> list[tuple[Point, bool]]:
    """Where the space comes nearest to each thing that is near to it and to what is beyond.

    And whether it is new: no map holds it, and no side of it counts as seen. Walls, which were seen
    all around, are none of them.
    """
    return [
        (_begin_of(shapely.shortest_line(space, one.outline)), not len(one.seen))
        for one in things
        if one.seen is not None
        and one.outline.dwithin(space, near_m)
        and one.outline.dwithin(beyond, near_m)
    ]


def _begin_of(line: LineString) -> Point:
    """Where it begins."""
    x, y = line.coords[0]
    return x, y
