"""Walls of the map as objects of the planner link: one for each piece between two doors.

A wall is known as a line, by the faces that were seen: neither how thick it is nor how high. So a
piece is told as the band in which what is seen is the wall's, and as higher than can be told.
Source: docs/object-map.md, "Walls and doors"; planner link, section 3 (OBJECTS).
"""

import math
from collections.abc import Callable

import numpy as np

from core.objects.records import Floats
from core.objects.vector_map.walls import WallRecord
from core.records import OBJECT_WALL, ObjectReport

TOP_M = 32.767  # link: that or more
LONGEST_M = 60.0  # link: an outline over 65 m is told as its box
SIGMAS = 3.0  # of a hull, to either side of the line: as the map takes it


class WallReports:
    """Which pieces were told of each wall, and under which ids."""

    def __init__(self, hull_sigma_m: float, new_id: Callable[[], int]) -> None:
        self._aside_m, self._new_id = SIGMAS * hull_sigma_m, new_id
        self._ids: dict[int, list[int]] = {}  # of the pieces along a wall, by the wall's id

    def changed(self, wall: WallRecord) -> tuple[list[ObjectReport], list[int]]:
        """All its pieces anew, and ids of those that are no more.

        A door that opens leaves the piece before it its id, that behind it gets a new one.
        """
        pieces = [piece for segment in wall.segments for piece in _cut(segment)]
        count, ids = len(pieces), self._ids.setdefault(wall.id, [])
        gone = ids[count:]
        ids[count:] = [self._new_id() for _ in range(count - len(ids))]
        numbered = zip(ids, pieces, strict=True)
        return [self._report(number, piece, wall) for number, piece in numbered], gone

    def gone(self, wall: int) -> list[int]:
        """Ids of all its pieces; of what was no wall, none."""
        return self._ids.pop(wall, [])

    def _report(self, number: int, piece: Floats, wall: WallRecord) -> ObjectReport:
        a, b = piece
        x, y = (b - a) * (self._aside_m / math.dist(a, b))
        left = np.array([-y, x])
        band = np.array([a - left, b - left, b + left, a + left])
        return ObjectReport(
            number, OBJECT_WALL, band, 0.0, TOP_M, (0.0, 0.0), wall.confidence, wall.last_seen_s
        )


def _cut(segment: Floats) -> Floats:
    """(n, 2, 2) ends of its pieces."""
    a, b = segment.reshape(2, 2)
    count = math.ceil(math.dist(a, b) / LONGEST_M)
    ends = a + np.linspace(0.0, 1.0, count + 1)[:, None] * (b - a)
    return np.stack([ends[:-1], ends[1:]], axis=1)
