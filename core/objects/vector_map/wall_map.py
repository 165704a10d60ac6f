"""All walls of the map: which segment is of which wall, and which walls are one."""

import math
from collections.abc import Callable

import numpy as np
import shapely

from core.objects.records import Floats, FrameObjects
from core.objects.vector_map.align import Correction, Sides
from core.objects.vector_map.index import Box, BoxIndex
from core.objects.vector_map.mapped import box_of
from core.objects.vector_map.settings import ObjectMapSettings
from core.objects.vector_map.walls import Wall, WallRecord

LANDMARK_M = 3.0  # of walls: two pallets in a row are shorter
APART_M = 0.2  # pieces of a segment that are compared with a wall are at most so long


class WallMap:
    """Walls by id; the ids are the owner's."""

    def __init__(self, settings: ObjectMapSettings) -> None:
        self._s = settings
        self._walls: dict[int, Wall] = {}
        self._index = BoxIndex()

    def has(self, number: int) -> bool:
        return number in self._walls

    def record(self, number: int) -> WallRecord:
        return self._walls[number].record()

    def records(self) -> list[WallRecord]:
        """All that have pieces which are wall, by id."""
        found = [self._walls[number].record() for number in sorted(self._walls)]
        return [wall for wall in found if len(wall.segments)]

    def landmarks(self) -> Floats:
        """Segments (n, 4) of the walls that tell a frame where it is.

        Short ones are off by centimetres: they may be faces of things in a row. Short is a third of
        the longest wall, and in a large room LANDMARK_M.
        """
        found = [wall.segments for wall in self.records()]
        lengths_m = [float(np.hypot(*(one[:, 2:] - one[:, :2]).T).sum()) for one in found]
        least_m = min(LANDMARK_M, max(lengths_m, default=0.0) / 3.0)
        long = [one for one, length_m in zip(found, lengths_m, strict=True) if length_m >= least_m]
        return np.vstack([np.zeros((0, 4)), *long])

    def is_known(self, segment: Floats) -> bool:
        """Whether a segment (4,) lies along a wall."""
        return self._of(segment) is not None

    def near(self, box: Box) -> list[WallRecord]:
        found = [self._walls[number].record() for number in self._index.near(box)]
        return [wall for wall in found if len(wall.segments)]

    def lines(self, box: Box) -> shapely.Geometry:
        """The settled walls near a box."""
        known = [self._walls[n] for n in self._index.near(box)]
        return shapely.MultiLineString(
            [
                segment.reshape(2, 2)
                for wall in known
                if wall.frames >= self._s.confirm_frames
                for segment in wall.record().segments
            ]
        )

    def take(self, record: WallRecord, at_s: float) -> None:
        """A wall that is known: as settled as if it had been seen."""
        wall = self._walls[record.id] = Wall.known(record, at_s, self._s)
        self._index.put(record.id, wall.box())

    def sides(self, segments: Floats) -> list[Sides]:
        """What of a frame's segments (n, 4) m can be compared with walls of the map."""
        found = []
        for segment in segments:
            wall = self._of(segment)
            if wall is None or wall.frames < self._s.confirm_frames:
                continue
            a, b = segment.reshape(2, 2)
            count = max(2, math.ceil(math.dist(a, b) / APART_M))
            ends = a + np.linspace(0.0, 1.0, count + 1)[:, None] * (b - a)
            pieces = np.hstack([ends[:-1], ends[1:]])
            lines = wall.record().segments
            if (b - a) @ wall.along < 0.0:
                lines = lines[:, [2, 3, 0, 1]]
            found.append(Sides(pieces, lines, self._s.hull_sigma_m))
        return found

    def update(
        self, frame: FrameObjects, sectors: Floats, by: Correction, new_id: Callable[[], int]
    ) -> list[int]:
        """One frame; ids of the walls that it spoke of, those that are no more as well."""
        hits: dict[int, list[Floats]] = {}
        for segment in frame.walls:
            if math.dist(*segment.reshape(2, 2)) < 2.0 * self._s.wall_cell_m:
                continue
            wall = self._of(segment)
            if wall is None:
                wall = Wall(new_id(), segment, frame.at_s, self._s)
                self._walls[wall.id] = wall
            told = segment.reshape(2, 2) - [by.shift_at(end) for end in segment.reshape(2, 2)]
            wall.hit(segment, told.ravel(), frame.at_s)
            hits.setdefault(wall.id, []).append(segment)
            self._index.put(wall.id, wall.box())
        gone = [lost for n in sorted(hits) if n in self._walls for lost in self._unite(n, hits)]
        near = self._index.near(box_of(np.vstack([frame.view, np.array([frame.origin])])))
        for number in near:
            wall = self._walls[number]
            wall.seen_through(hits.get(number, []), sectors, np.array(frame.origin))
            if frame.at_s - wall.seen_s > self._s.coast_s and len(wall.record().segments) == 0:
                del self._walls[number]  # never confirmed, or taken down
                self._index.remove(number)
        return sorted({*hits, *near, *gone})

    def _unite(self, number: int, hits: dict[int, list[Floats]]) -> list[int]:
        """Make a wall one with those that turn out to be it; the oldest goes on. Who is no more."""
        around = box_of(np.reshape(self._walls[number].box(), (2, 2)), self._s.contradiction_m)
        gone = list[int]()
        for other in [each for each in self._index.near(around) if each != number]:
            if not self._walls[number].is_one_with(self._walls[other]):
                continue
            number, younger = sorted((number, other))
            self._walls[number].take(self._walls.pop(younger))
            self._index.remove(younger)
            self._index.put(number, self._walls[number].box())
            hits.setdefault(number, []).extend(hits.pop(younger, []))
            gone.append(younger)
        return gone

    def _of(self, segment: Floats) -> Wall | None:
        """The wall along which a segment (4,) lies: the one nearest in offset."""
        ends = segment.reshape(2, 2)
        near = self._index.near(box_of(ends, 2.0))
        walls = [self._walls[n] for n in near if self._walls[n].is_along(segment)]
        middle = ends.mean(axis=0)[None]
        return min(walls, key=lambda wall: abs(float(wall.measured(middle)[1][0])), default=None)
