"""Where a machine's outline may be: floor that was seen, gaps before things, away from all things.

A view of the floor ends a little before what stands there; before a side that was seen, that gap is
floor (`things.before`). Map frame, metres.
"""

import math
from collections.abc import Sequence

import shapely
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from core.paths.cleaning.seen_floor import SPECK_M2, SeenFloor
from core.paths.cleaning.things import GAP_M, Thing, before, outlines
from core.paths.geometry.space import polygons_in

NO_PLACE = Polygon()


class FreeFloor:
    """Of one moment.

    Args:
        things: all that is known to stand or to move there, walls too.
    """

    def __init__(self, floor: SeenFloor, things: Sequence[Thing]) -> None:
        self._seen, self._stood = floor.free(), floor.stood()
        self._things, self._before = outlines(things), before(things)
        self._known = shapely.union_all(self._things)

    def gaps(self) -> list[Polygon]:
        """Between seen floor and what was seen of things."""
        return self._beside(self._seen)

    def area(
        self, guard_m: float, radius_m: float, barred: BaseGeometry = NO_PLACE
    ) -> BaseGeometry:
        """All of it: farther than `guard_m` from the outlines of things.

        Args:
            radius_m: of the machine. Unseen holes in seen floor, smaller than that, are seen
                before it is there, and count as floor.
            barred: where the machine was barred; no such hole there does.
        """
        bars = [one.buffer(guard_m, join_style="mitre") for one in self._things]
        seen = self._without_holes(math.pi * radius_m**2, barred)
        return shapely.union_all([seen, *self._beside(seen)]).difference(shapely.union_all(bars))

    def _without_holes(self, most_m2: float, barred: BaseGeometry) -> BaseGeometry:
        """Seen floor with what is not seen in its midst, away from all that is known there."""
        tree = shapely.STRtree([*self._things, self._stood, barred])
        filled = list[BaseGeometry]([self._seen])
        for part in self._seen.geoms:
            for ring in part.interiors:
                hole = Polygon(ring)
                if hole.area < SPECK_M2 or (
                    hole.area < most_m2 and not len(tree.query(hole, "dwithin", GAP_M))
                ):
                    filled.append(hole)
        return shapely.union_all(filled)

    def _beside(self, seen: BaseGeometry) -> list[Polygon]:
        both = shapely.buffer(seen.union(self._known), GAP_M / 2, quad_segs=2)
        closed = shapely.buffer(both, -GAP_M / 2, quad_segs=2)
        gaps = closed.intersection(self._before).difference(seen)
        return polygons_in(gaps.difference(self._stood))
