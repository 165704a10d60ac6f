"""Floor that was seen, and that the machine cannot get to: what parts it off, somebody in a door.

He may be gone long since: a map keeps what nobody looks at. Map frame, metres.
"""

from collections.abc import Iterable

import shapely
from shapely import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from core.paths.cleaning.things import Thing
from core.paths.geometry.space import narrowed, polygons_in
from core.paths.records import Machine


def parted_off(free: BaseGeometry, machine: Machine, space: Polygon) -> MultiPolygon:
    """Places of the machine's centre that have no way to those where it is."""
    parts = polygons_in(narrowed(free, machine.margin_m))
    return MultiPolygon([part for part in parts if not part.intersects(space)])


def between(
    things: Iterable[Thing], space: Polygon, beyond: MultiPolygon, near_m: float
) -> list[tuple[float, float]]:
    """Where the space comes nearest to each thing that is near to it and to what is beyond.

    Walls, which were seen all around, are none of them.
    """
    return [
        shapely.shortest_line(space, one.outline).coords[0]
        for one in things
        if one.seen is not None
        and one.outline.dwithin(space, near_m)
        and one.outline.dwithin(beyond, near_m)
    ]
