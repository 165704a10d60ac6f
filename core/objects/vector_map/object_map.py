"""The map of objects: what frames of a depth camera tell, kept as polygons with ids.

It never says that a place is free: what has no polygon is not known by this map. It believes no
frame alone: n frames make an object, m frames that saw through it take it away, and what lies
outside a frame's view, or behind something, is not judged by it. What the map does not explain is
an obstacle from its first frame (`Newcomers`). It opens no file and reads no clock.

Source: docs/object-map.md.
"""

import math
from collections import Counter, OrderedDict
from collections.abc import Iterable, Sequence
from itertools import combinations

import numpy as np
import shapely
from msgspec import Struct

from core.objects.records import Detection, Floats, FrameObjects
from core.objects.vector_map.align import Correction, Sides, correction_of
from core.objects.vector_map.faces import parted
from core.objects.vector_map.field import NONE
from core.objects.vector_map.index import Box, BoxIndex
from core.objects.vector_map.journal import Changes, Journal, shape_of
from core.objects.vector_map.mapped import MapObject, Mapped, box_of
from core.objects.vector_map.newcomers import Newcomer, Newcomers, Obstacle, Sight, size_of
from core.objects.vector_map.prepared import (
    PreparedFrame,
    check_frame,
    prepared,
    seen_of,
    thickened,
)
from core.objects.vector_map.seen import pieces_of
from core.objects.vector_map.settings import ObjectMapSettings
from core.objects.vector_map.wall_map import WallMap
from core.objects.vector_map.walls import WallRecord

OF_WALL = 0.9  # so much of an object where a wall is taken to be: it is that wall
END_M = 0.25  # what was hardly seen and lies so near a wall's end is the wall's own end face
FLAT_M = 0.15  # nobody is so thin: what lies within that of a wall does not walk
OF_THINGS = 0.75  # so much of a new upright plane on things that are known: it is a face of them
COVERED = 0.5  # so much of the smaller of two objects within the other: they are one


class MapUpdate(Struct, frozen=True, eq=False):
    """What one frame did."""

    version: int  # of the map behind it
    correction: Correction  # where the frame really was
    obstacles: tuple[Obstacle, ...]  # all that is not in the map


class ObjectMap:
    """All objects and walls, and the obstacles that are not of the map."""

    def __init__(self, settings: ObjectMapSettings) -> None:
        self.settings = settings
        self.walls = WallMap(settings)
        self._objects: dict[int, Mapped] = {}
        self._index, self._journal = BoxIndex(), Journal()
        self._newcomers = Newcomers(settings)
        self._awake = OrderedDict[int, None]()  # ids with a field, the longest unseen first
        self._bridges = Counter[tuple[int, int]]()  # frames in which one hull covered both
        self.next_id = 1  # of the next thing; all that were used are lower
        self._last_s = -np.inf

    # what is asked of it

    def objects(self) -> list[MapObject]:
        """All objects, by id."""
        return [self._objects[number].record() for number in sorted(self._objects)]

    def near(self, box: Box) -> tuple[list[MapObject], list[WallRecord]]:
        """What may touch a box: x and y of its lowest corner, then of its highest, m."""
        found = [self._objects[n].record() for n in self._index.near(box) if n in self._objects]
        return found, self.walls.near(box)

    def changes_since(self, version: int) -> Changes:
        """What a copy of that version lacks; 0: all. ValueError: there has been no such version."""
        return self._journal.since(version)

    # what it is told

    def start_from(
        self,
        objects: Iterable[MapObject],
        walls: Iterable[WallRecord],
        at_s: float,
        next_id: int = 1,
    ) -> None:
        """Take a saved map or a floor plan: as settled as if it had been seen, until it is not.

        Args:
            next_id: no new thing gets a lower id, for such ids have been used.

        Raises:
            ValueError: the map is not empty, or an id comes twice.
        """
        if self._objects or self.walls.records():
            raise ValueError("a map can only be taken into one that is still empty")
        for one in objects:
            self._claim(one.id)
            mapped = self._objects[one.id] = Mapped.known(one, at_s, self.settings)
            self._told(mapped)
        for wall in walls:
            self._claim(wall.id)
            self.walls.take(wall, at_s)
            self._wall_told(self.walls.record(wall.id))
        self.next_id = max(self.next_id, next_id)

    def update(self, frame: FrameObjects) -> MapUpdate:
        """Take one frame.

        Raises:
            ValueError: a number of it is not finite, or it is older than the one before.
        """
        check_frame(frame, self._last_s)
        self._last_s = frame.at_s
        frame = thickened(self._with_faces(frame), self.settings)
        raw = prepared(frame, self.settings)
        near = self._near(raw)
        correction = correction_of(self._sides(raw, near), frame.origin, self.settings)
        now = prepared(correction.frame(frame), self.settings)
        mine = self._matches(now, near, self.settings.hull_sigma_m + self.settings.cell_m)
        lines = self.walls.lines(self._reach_of(now))
        sights = self._unexplained(now, mine, lines)
        self._newcomers.add(frame.at_s, sights, now.sectors, now.lens)
        anchor = max((self._objects[n].frames for n in mine), default=0)
        for number in near:
            self._vote(self._objects[number], now, mine)
        self._merge(now, mine)
        for newcomer in self._newcomers.staying():
            self._admit(newcomer, anchor)
        self._settle(near, mine, correction)
        self._update_walls(now, correction)
        self._absorb(near, lines)
        self._sleep(near)
        obstacles = self._newcomers.obstacles(frame.at_s)
        return MapUpdate(self._journal.version, correction, obstacles)

    # one frame, step by step

    def _with_faces(self, frame: FrameObjects) -> FrameObjects:
        """A frame in which a new upright plane is seen of things, if most of it lies on things.

        Of one that was seen from one side alone nobody knows whether it is a piece of a wall.
        """
        margin_m, is_wall = 3.0 * self.settings.pose_sigma_m, np.ones(len(frame.walls), dtype=bool)
        found = list(frame.detections)
        for k, segment in enumerate(frame.walls):
            length_m = math.dist(segment[:2], segment[2:])
            if length_m <= margin_m or self.walls.is_known(segment):
                continue
            near = self._index.near(box_of(segment.reshape(2, 2), margin_m))
            things = [one for n in near if (one := self._objects[n]).was_seen_round(FLAT_M)]
            faces, rest = parted(segment, [one.polygon for one in things], margin_m)
            if sum(math.dist(*ends) for ends in rest) >= (1.0 - OF_THINGS) * length_m:
                continue
            is_wall[k] = False
            for one, ends in zip(things, faces, strict=True):
                if len(ends):
                    found.append(Detection(ends, one.bottom_m, one.top_m, 0))
            top_m = max(one.top_m for one in things)
            found += [Detection(ends, 0.0, top_m, 0) for ends in rest]
        return frame._replace(detections=tuple(found), walls=frame.walls[is_wall])

    def _near(self, now: PreparedFrame) -> list[int]:
        """Ids of objects that this frame may speak of."""
        return self._index.near(self._reach_of(now))

    def _reach_of(self, now: PreparedFrame) -> Box:
        """The box around all that a frame shows."""
        found = now.frame.detections
        points = [now.lens[None], now.frame.view, *(one.polygon for one in found)]
        return box_of(np.vstack(points), self.settings.guard_m)

    def _matches(
        self, now: PreparedFrame, near: list[int], margin_m: float
    ) -> dict[int, list[int]]:
        """By object, the detections that touch it within a margin."""
        found: dict[int, list[int]] = {}
        if not now.polygons:
            return found
        tree = shapely.STRtree(now.polygons)
        for number in near:
            outline = shapely.Polygon(self._objects[number].polygon)
            hits = tree.query(outline, predicate="dwithin", distance=margin_m)
            if len(hits):
                found[number] = sorted(hits.tolist())
        return found

    def _sides(self, raw: PreparedFrame, near: list[int]) -> list[Sides]:
        s = self.settings
        sides = self.walls.sides(raw.frame.walls)
        for number, hits in self._matches(raw, near, 3.0 * s.pose_sigma_m).items():
            lines = self._objects[number].lines()
            sides += [Sides(seen_of(raw.pieces[k]), lines, s.hull_sigma_m) for k in hits]
        return sides

    def _unexplained(
        self, now: PreparedFrame, mine: dict[int, list[int]], lines: shapely.Geometry
    ) -> list[Sight]:
        """What of the detections no object and no wall of the map covers.

        Of a frame's walls the points are gone already: what is left stands out of them, but for
        what a hull errs by, the band about the walls of the map.
        """
        s, sights = self.settings, []
        band, flat = lines.buffer(s.hull_sigma_m), lines.buffer(FLAT_M)
        margin_m = 3.0 * s.hull_sigma_m + 2.0 * s.cell_m
        touched = {k for hits in mine.values() for k in hits}
        for k, detection in enumerate(now.frame.detections):
            rest = detection.polygon
            is_at_wall = bool(band.intersects(now.polygons[k]))
            if k in touched or is_at_wall:
                known = shapely.union_all(
                    [
                        shapely.Polygon(self._objects[n].polygon)
                        for n, hits in mine.items()
                        if k in hits
                    ]
                ).buffer(margin_m)
                rest = now.polygons[k].difference(known.union(band) if is_at_wall else known)
                thin = rest.buffer(-s.hull_sigma_m, join_style="mitre")
                rest = _largest(thin.buffer(s.hull_sigma_m, join_style="mitre"))
            if size_of(rest) < s.least_size_m:
                continue
            part = detection._replace(polygon=rest)
            is_flat = is_at_wall and flat.covers(shapely.Polygon(rest))
            at = now.frame.at_s, part, now.pieces[k], now.sectors, now.frame.origin
            sights.append(Sight(*at, k not in touched, is_flat))
        return sights

    def _vote(self, one: Mapped, now: PreparedFrame, mine: dict[int, list[int]]) -> None:
        """One frame's say on one object."""
        hits = mine.get(one.id, [])
        field = one.awake()
        pieces = np.vstack([now.pieces[k] for k in hits]) if hits else NONE
        if hits:
            field.reach(pieces[:, :2].min(axis=0), pieces[:, :2].max(axis=0))
        rivals = {
            n for n in mine if n != one.id and n in self._objects and set(mine[n]) & set(hits)
        }
        others = [now.pieces[k] for k in range(len(now.pieces)) if k not in hits]
        others += [pieces_of(self._objects[n].polygon, 1.0) for n in sorted(rivals)]
        others += [pieces_of(hull, 1.0) for hull in self._newcomers.may_walk(now.frame.at_s)]
        turned = field.vote(
            pieces, np.vstack(others) if others else NONE, now.sectors, now.frame.origin
        )
        for k in hits:
            one.seen(now.frame.detections[k], now.frame.origin, now.frame.at_s)
        one.drawn_ago += 1
        if hits or turned:
            one.judge(bool(hits))
        if turned or (hits and one.drawn_ago >= self.settings.confirm_frames):
            self._draw(one, [now.polygons[k] for k in hits])

    def _draw(self, one: Mapped, hulls: Sequence[shapely.Polygon] = ()) -> None:
        """Its outline anew. A part that hangs together with it no longer is an object of its own,

        but for what this frame's hulls still hold: that is told as an obstacle, and may grow back.
        """
        rest = one.draw()
        if len(one.polygon) == 0:
            self._remove(one)
            return
        self._told(one)
        for outline in rest:
            if not any(hull.intersects(shapely.Polygon(outline)) for hull in hulls):
                self._split(one, outline)

    def _split(self, one: Mapped, outline: Floats) -> None:
        """Make a part of an object one of its own."""
        part = Mapped(self._new_id(), one.first_s, self.settings, one.kind)
        part.polygon, part.finished = outline, np.ones(len(outline), dtype=bool)
        part.stands_out = one.stands_out
        part.bottom_m, part.top_m, part.views = one.bottom_m, one.top_m, one.views
        part.frames, part.seen_s, part.rate = one.frames, one.seen_s, one.rate
        one.is_another()
        self._objects[part.id] = part
        field = one.awake()
        field.give_away(pieces_of(outline, 1.0))
        self._told(part)

    def _merge(self, now: PreparedFrame, mine: dict[int, list[int]]) -> None:
        """Make one of two objects that cover each other, or that hulls cover time and again."""
        s = self.settings
        there = [n for n in mine if n in self._objects]
        for a, b in combinations(there, 2):
            both = set(mine[a]) & set(mine[b])
            if not both:
                self._bridges.pop((a, b), None)
                continue
            one, other = (shapely.Polygon(self._objects[n].polygon) for n in (a, b))
            if any(_covers(now.polygons[k], one, other, s.least_size_m) for k in both):
                self._bridges[a, b] += 1
            is_one = one.intersection(other).area > COVERED * min(one.area, other.area)
            if (is_one or self._bridges[a, b] >= s.confirm_frames) and b in self._objects:
                self._unite(self._objects[a], self._objects[b])
                return  # the others in the next frame

    def _unite(self, one: Mapped, other: Mapped) -> None:
        """The older of both goes on."""
        one.awake().take(other.awake())
        one.bottom_m, one.top_m = min(one.bottom_m, other.bottom_m), max(one.top_m, other.top_m)
        one.views |= other.views
        one.stands_out |= other.stands_out
        one.is_another()
        self._remove(other)
        self._draw(one)

    def _admit(self, newcomer: Newcomer, anchor: int) -> None:
        """A newcomer that stays becomes an object, from the frames that showed it."""
        one = Mapped(self._new_id(), newcomer.since.at_s, self.settings)
        one.kind = "moved" if newcomer.has_moved else "static"
        one.stands_out = newcomer.last[0].is_flat
        self._newcomers.drop(newcomer)
        one.field = None
        corners = np.vstack([sight.detection.polygon for sight in newcomer.last])
        field = one.fresh(corners.min(axis=0), corners.max(axis=0))
        shifts, first = [], seen_of(newcomer.last[0].pieces)[:, :4]
        for sight in newcomer.last:
            sides = Sides(seen_of(sight.pieces), first, self.settings.hull_sigma_m)
            by = correction_of([sides], sight.origin, self.settings)
            field.vote(by.pieces(sight.pieces), NONE, NONE, sight.origin)
            shifts.append(by.shift_at(sight.detection.polygon.mean(axis=0)))
            one.seen(sight.detection, sight.origin, sight.at_s)
            one.judge(True)
        one.shift(-np.mean(shifts, axis=0))  # the mean of its places
        one.frames = max(one.frames, anchor)  # it stands where the others say
        one.draw()
        if len(one.polygon):
            self._objects[one.id] = one
            self._awake[one.id] = None
            self._told(one)

    def _settle(self, near: list[int], mine: dict[int, list[int]], by: Correction) -> None:
        """Let what was seen come a little towards where the frame itself had it.

        Each is the mean of the places that the poses gave it, not the place of its first frame.
        """
        for number in near:
            one = self._objects.get(number)
            if one is not None and number in mine:
                gain = 1.0 / (1.0 + one.frames)
                one.shift(-gain * by.shift_at(one.polygon.mean(axis=0)))

    def _update_walls(self, now: PreparedFrame, by: Correction) -> None:
        for number in self.walls.update(now.frame, now.sectors, by, self._new_id):
            if self.walls.has(number):
                self._wall_told(self.walls.record(number))
            else:
                self._journal.delete(number)

    def _absorb(self, near: list[int], lines: shapely.Geometry) -> None:
        """Take away what was seen of a wall before the wall was known, and became an object.

        It lies where the wall is taken to be, or its middle lies on the wall. That of a thing which
        stands before a wall does not, unless it is as thin as that place. Or it is not settled yet,
        and lies all at a wall's end: the face there, seen before the wall was.
        """
        ends, on_m = lines.boundary.buffer(END_M), 3.0 * self.settings.hull_sigma_m
        band = lines.buffer(on_m)
        for number in near:
            one = self._objects.get(number)
            if one is None or one.stands_out:
                continue
            if not lines.dwithin(outline := shapely.Polygon(one.polygon), END_M):
                continue
            is_inside = outline.intersection(band).area > OF_WALL * outline.area
            is_inside |= one.frames < self.settings.memory_frames and ends.contains(outline)
            if is_inside or outline.centroid.dwithin(lines, on_m):
                self._remove(one)

    # bookkeeping

    def _new_id(self) -> int:
        self.next_id += 1
        return self.next_id - 1

    def _claim(self, number: int) -> None:
        if number in self._objects or self.walls.has(number):
            raise ValueError(f"id: {number} comes twice")
        self.next_id = max(self.next_id, number + 1)

    def _told(self, one: Mapped) -> None:
        """Publish an object whose shape has changed by more than the settings let pass."""
        self._index.put(one.id, box_of(one.polygon))
        shape = shape_of(one.id, "object", one.polygon, one.bottom_m, one.top_m)
        before = self._journal.maybe_told(one.id)
        if before is not None and before.differs_by_m(shape) <= self.settings.publish_m:
            return
        self._journal.tell(shape)

    def _wall_told(self, wall: WallRecord) -> None:
        if len(wall.segments) == 0:
            self._journal.delete(wall.id)
            return
        shape = shape_of(wall.id, "wall", wall.segments.reshape(-1, 2), 0.0, 0.0)
        before = self._journal.maybe_told(wall.id)
        if before is None or before.differs_by_m(shape) > self.settings.publish_m:
            self._journal.tell(shape)

    def _remove(self, one: Mapped) -> None:
        del self._objects[one.id]
        self._awake.pop(one.id, None)
        self._index.remove(one.id)
        self._journal.delete(one.id)
        for pair in [pair for pair in self._bridges if one.id in pair]:
            del self._bridges[pair]

    def _sleep(self, near: Sequence[int]) -> None:
        """Only so many objects keep a field: those seen last."""
        for number in near:
            if number in self._objects:
                self._awake[number] = None
                self._awake.move_to_end(number)
        while len(self._awake) > max(self.settings.active_objects, len(near)):
            number, _ = self._awake.popitem(last=False)
            self._objects[number].sleep()


def _largest(shape: shapely.Geometry) -> Floats:
    """The outline (n, 2) of the largest part; (0, 2) of nothing."""
    parts = [part for part in shapely.get_parts(shape) if part.geom_type == "Polygon"]
    if not parts:
        return np.zeros((0, 2))
    largest = shapely.normalize(max(parts, key=lambda part: part.area))
    return np.asarray(largest.exterior.coords)[:-1][::-1]


def _covers(
    hull: shapely.Polygon, one: shapely.Polygon, other: shapely.Polygon, least_m: float
) -> bool:
    """Whether a hull covers more than an edge of both."""
    return all(hull.intersection(each).area > least_m * least_m for each in (one, other))
