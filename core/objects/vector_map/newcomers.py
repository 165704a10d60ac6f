"""What the map does not explain: told as an obstacle at once, followed, and judged: does it stay?

A thing has moved when the place of its surface was seen through, before or since: where it stood
must be closed to rays, and where it stands must have been. That needs no shape and no speed.
A thing has one track: parts of a walker are made one, and a track that is not seen ends where
another one's hull covers its place. What stayed for the frames that confirm goes into the map. What
has ever moved, or is as tall and slender as a person, has to stay longer.
"""

import math
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import shapely
from msgspec import Struct

from core.objects.records import Detection, Floats
from core.objects.vector_map.seen import count_seen
from core.objects.vector_map.settings import ObjectMapSettings
from core.objects.vector_map.tracker import Measured, Track, Tracker

COVERED = 0.5  # so much of a hull within another place: it is of what is there


class Sight(NamedTuple):
    """One frame's hull of a thing, and what that frame saw through."""

    at_s: float
    detection: Detection
    pieces: Floats  # (k, 5) of its hull, marked where seen
    sectors: Floats
    origin: tuple[float, float]
    is_apart: bool  # it touches no object of the map
    is_flat: bool  # all of it lies so near to a wall that nobody has room there


class Obstacle(Struct, frozen=True, eq=False):
    """A thing that is not in the map: new, or moving. Metres, map frame."""

    id: int  # of its own kind, never used again
    polygon: Floats  # (n, 2) m, as last seen; while it is hidden, moved on with its velocity
    bottom_m: float
    top_m: float
    velocity_mps: tuple[float, float] | None  # None: not known yet
    speed_sigma_mps: float
    is_moving: bool  # it was seen to move; False: it is new, and may stay
    first_seen_s: float
    last_seen_s: float


class Newcomer:
    """What is known of one track besides its motion."""

    def __init__(self, sight: Sight, s: ObjectMapSettings) -> None:
        self.since = sight  # the first frame in which it stood where it stands
        self.last = deque([sight], maxlen=s.confirm_frames)
        self.frames, self.through_frames, self.has_moved = 1, 0, False

    def add(self, sight: Sight, s: ObjectMapSettings) -> None:
        moved = max(through_share(self.since, sight, s), through_share(sight, self.since, s))
        self.through_frames = 0
        if moved > s.through_share:
            self.has_moved, self.since, self.frames = True, sight, 0
            self.last.clear()
        self.frames += 1
        self.last.append(sight)

    def stays(self, s: ObjectMapSettings) -> bool:
        """Whether it has stood long enough to go into the map."""
        now = self.last[-1]
        if not now.is_apart or self.frames < s.confirm_frames:
            return False
        if is_person_like(now, s):
            return now.at_s - self.since.at_s >= s.person_wait_s
        return not self.has_moved or self.frames >= s.gone_frames


def is_person_like(sight: Sight, s: ObjectMapSettings) -> bool:
    """Tall and slender enough, and not flat on a wall: it may walk away at any time.

    Of what the image cuts off above nobody knows how tall it is.
    """
    size, seen = float(np.ptp(_hull(sight), axis=0).max()), sight.detection
    is_tall = seen.top_m >= s.person_height_m or seen.is_cut
    return is_tall and size <= s.person_width_m and not sight.is_flat


def through_share(place: Sight, by: Sight, s: ObjectMapSettings) -> float:
    """Share of a sight's surface that another frame saw through, whatever the pose of both was."""
    seen = place.pieces[place.pieces[:, 4] > 0.0]
    if len(seen) == 0:
        return 0.0
    middles = 0.5 * (seen[:, :2] + seen[:, 2:4])
    away = middles - np.array(place.origin)
    behind = middles + s.guard_m * away / np.maximum(np.hypot(*away.T), 1e-9)[:, None]
    return count_seen(by.sectors, behind, 3.0 * s.pose_sigma_m, *by.origin) / len(seen)


class Newcomers:
    """All of them."""

    def __init__(self, settings: ObjectMapSettings) -> None:
        self._s, self._tracker = settings, Tracker[Newcomer](settings)

    def add(self, at_s: float, sights: Sequence[Sight], sectors: Floats, lens: Floats) -> None:
        """One frame: what it shows that the map does not explain, and what it saw through."""
        self._tracker.predict(at_s)
        sights = self._joined(at_s, sights)
        boxes = [Measured(middle_of(hull), np.ptp(hull, axis=0)) for hull in map(_hull, sights)]
        tracks = self._tracker.assign(boxes)
        for sight, box, track in zip(sights, boxes, tracks, strict=True):
            if track is None:
                track = self._tracker.start(at_s, box, Newcomer(sight, self._s))
            else:
                self._tracker.follow(track, at_s, box)
                track.about.add(sight, self._s)
            track.is_fixed = sight.is_flat and not track.about.has_moved
        hulls = shapely.union_all([shapely.Polygon(_hull(sight)) for sight in sights])
        for track in list(self._tracker.unseen(at_s)):
            if self._is_covered(track, at_s, hulls):
                self._tracker.drop(track)
            else:
                self._maybe_drop(track, at_s, sectors, lens)

    def _joined(self, at_s: float, sights: Sequence[Sight]) -> list[Sight]:
        """Sights, those made one that are parts of one walker: legs, and what bears them.

        They lie where one that walks is, and all together they are no wider than a person.
        """
        left, s = list(sights), self._s
        for track in self._tracker.tracks:
            if not self._may_walk(track):
                continue
            place = shapely.Polygon(self._obstacle(track, at_s).polygon).buffer(
                3.0 * s.track_sigma_m
            )
            mine = [one for one in left if _share_in(_hull(one), place) > COVERED]
            corners = [_hull(one) for one in mine]
            if len(mine) < 2 or np.ptp(np.vstack(corners), axis=0).max() > s.person_width_m:
                continue
            left = [one for one in left if not any(one is part for part in mine)]
            left.append(_as_one(mine))
        return left

    def _is_covered(self, track: Track[Newcomer], at_s: float, hulls: shapely.Geometry) -> bool:
        """Whether what a frame told of others lies where a track is: it is a part of them."""
        return _share_in(self._obstacle(track, at_s).polygon, hulls) > COVERED

    def staying(self) -> list[Newcomer]:
        """Those that go into the map now; the owner takes them by `drop`."""
        return [track.about for track in self._tracker.tracks if track.about.stays(self._s)]

    def drop(self, newcomer: Newcomer) -> None:
        self._tracker.tracks = [one for one in self._tracker.tracks if one.about is not newcomer]

    def may_walk(self, at_s: float) -> list[Floats]:
        """Hulls (n, 2) in this frame of what has moved, or may be a person."""
        return [
            track.about.last[-1].detection.polygon
            for track in self._tracker.tracks
            if track.seen_s == at_s and self._may_walk(track)
        ]

    def _may_walk(self, track: Track[Newcomer]) -> bool:
        return track.about.has_moved or is_person_like(track.about.last[-1], self._s)

    def obstacles(self, at_s: float) -> tuple[Obstacle, ...]:
        """All of them as they are told."""
        return tuple(self._obstacle(track, at_s) for track in self._tracker.tracks)

    def _obstacle(self, track: Track[Newcomer], at_s: float) -> Obstacle:
        detection, kalman = track.about.last[-1].detection, track.filter
        is_known = kalman.speed_sigma_mps <= self._s.speed_sigma_mps
        velocity = (float(kalman.x[2]), float(kalman.x[3])) if is_known else None
        polygon = detection.polygon
        if velocity is not None and track.about.has_moved:
            polygon = polygon + (at_s - track.seen_s) * np.array(velocity)
        return Obstacle(
            *(track.id, polygon, detection.bottom_m, detection.top_m),
            *(velocity, kalman.speed_sigma_mps, track.about.has_moved),
            *(track.first_s, track.seen_s),
        )

    def _maybe_drop(
        self, track: Track[Newcomer], at_s: float, sectors: Floats, lens: Floats
    ) -> None:
        """Forget what was not seen for too long, or where its place was seen through."""
        polygon = self._obstacle(track, at_s).polygon
        points = np.vstack([polygon, polygon.mean(axis=0)])
        seen = count_seen(sectors, points, 0.0, float(lens[0]), float(lens[1]))
        track.about.through_frames += seen > self._s.through_share * len(points)
        coast_s = self._s.person_wait_s if track.is_fixed else self._s.coast_s
        is_late = at_s - track.seen_s > coast_s
        if is_late or track.about.through_frames >= self._s.confirm_frames:
            self._tracker.drop(track)


def _hull(sight: Sight) -> Floats:
    return sight.detection.polygon


def _share_in(hull: Floats, place: shapely.Geometry) -> float:
    """Share of a hull (n, 2) that lies in a place."""
    polygon = shapely.Polygon(hull)
    return float(polygon.intersection(place).area / max(polygon.area, 1e-9))


def _as_one(parts: Sequence[Sight]) -> Sight:
    """Sights of one frame as that of one thing: the hull around them, and all their sides."""
    around = shapely.MultiPoint(np.vstack([_hull(one) for one in parts])).convex_hull
    hull = shapely.get_coordinates(shapely.orient_polygons(around))[:-1]
    detections = [one.detection for one in parts]
    whole = Detection(
        hull,
        min(one.bottom_m for one in detections),
        max(one.top_m for one in detections),
        sum(one.points for one in detections),
        any(one.is_cut for one in detections),
    )
    sides, is_apart = np.vstack([one.pieces for one in parts]), all(one.is_apart for one in parts)
    return parts[0]._replace(detection=whole, pieces=sides, is_apart=is_apart)


def middle_of(polygon: Floats) -> Floats:
    """The middle (2,) of a hull's box, m."""
    return np.asarray(0.5 * (polygon.min(axis=0) + polygon.max(axis=0)))


def size_of(polygon: Floats) -> float:
    """The diagonal of a hull's box, m."""
    return math.hypot(*np.ptp(polygon, axis=0).tolist()) if len(polygon) else 0.0
