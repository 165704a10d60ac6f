"""One object of the map: its outline, and what is known of it besides."""

import math
from typing import Literal

import numpy as np
import shapely
from msgspec import Struct

from core.objects.records import Detection, Floats
from core.objects.vector_map.contour import area_of, polygons_of
from core.objects.vector_map.field import DistanceField
from core.objects.vector_map.index import Box
from core.objects.vector_map.seen import pieces_of
from core.objects.vector_map.settings import ObjectMapSettings

LOST_SHARE = 0.2  # so much of its settled sides lies outside of its outline now: it was moved
SEEN_ROUND = 0.5  # so much of an outline in finished sides: it was seen from more than one side
SUREST = 0.0004  # less than that away from 1 is 1, to three digits
NO_SIDES: Floats = np.zeros((0, 4))
VIEWS = 8  # directions from which an object can have been seen: bit 0 is from +x, counter-clockwise
Kind = Literal["static", "moved"]


class MapObject(Struct, frozen=True, eq=False):
    """An object as the map has it; metres, map frame, heights above the floor."""

    id: int
    polygon: Floats  # (n, 2) m, counter-clockwise, simple
    bottom_m: float
    top_m: float
    first_seen_s: float
    last_seen_s: float
    seen_from: int  # bits, one for each eighth of the directions from it to the lens
    finished: np.ndarray  # (n,) bool: side k, from corner k on, was seen along its whole length
    confidence: float  # 0..1: share of the frames that should have shown it and did
    kind: Kind


def box_of(points: Floats, margin_m: float = 0.0) -> Box:
    (x0, y0), (x1, y1) = points.min(axis=0).tolist(), points.max(axis=0).tolist()
    return x0 - margin_m, y0 - margin_m, x1 + margin_m, y1 + margin_m


class Mapped:
    """An object and, as long as it is looked at, its distance field."""

    def __init__(self, number: int, at_s: float, s: ObjectMapSettings, kind: Kind = "static"):
        self.id, self._s, self.kind = number, s, kind
        self.polygon = np.zeros((0, 2))
        self.finished = np.zeros(0, dtype=bool)
        self.bottom_m, self.top_m = math.inf, -math.inf
        self.first_s = self.seen_s = at_s
        self.views, self.rate = 0, 1.0
        self.frames = 0  # that placed it
        self.stands_out = False  # the walls about it were known when it was first seen
        self.field: DistanceField | None = None
        self.drawn_ago = 0  # frames since the outline was drawn
        # its finished sides (k, 4) when it had settled: those noted last, and those before them
        self.stood = NO_SIDES, NO_SIDES
        self.noted_ago = 0  # frames since the former were noted

    @classmethod
    def known(cls, one: MapObject, at_s: float, s: ObjectMapSettings) -> "Mapped":
        """An object that is known: as settled as if it had been seen, and as sure as it was."""
        mapped = cls(one.id, at_s, s, one.kind)
        mapped.polygon, mapped.finished = one.polygon, one.finished
        mapped.bottom_m, mapped.top_m, mapped.views = one.bottom_m, one.top_m, one.seen_from
        least = math.log(max(1.0 - one.confidence, SUREST)) / math.log(1.0 - 1.0 / s.memory_frames)
        mapped.frames = max(round(s.memory_frames), math.ceil(least))
        mapped.rate = min(1.0, one.confidence / mapped.trust())
        mapped.stands_out = True  # else it would not be in a map with these walls
        mapped.stood = mapped.lines(), mapped.lines()
        return mapped

    def awake(self) -> DistanceField:
        """Its field, made again from the outline where it has none."""
        if self.field is None:
            field = self.fresh(self.polygon.min(axis=0), self.polygon.max(axis=0))
            pieces = pieces_of(self.polygon, 2.0 * self._s.cell_m)
            counts = pieces_count(self.polygon, 2.0 * self._s.cell_m)
            pieces[:, 4] = np.repeat(self.finished, counts)
            field.believe(pieces)
            return field
        return self.field

    def fresh(self, low: Floats, high: Floats) -> DistanceField:
        """An empty field around the box between two points (2,) m."""
        self.field = DistanceField(self._s)
        self.field.reach(low, high)
        return self.field

    def sleep(self) -> None:
        """Keep the outline alone."""
        self.field = None

    def seen(self, detection: Detection, origin: tuple[float, float], at_s: float) -> None:
        """One frame shows it: heights rise at once and fall slowly, for that is the safe side."""
        memory = self._s.memory_frames
        fallen = self.top_m - (self.top_m - detection.top_m) / memory
        self.top_m = max(detection.top_m, fallen) if self.top_m > -math.inf else detection.top_m
        risen = self.bottom_m + (detection.bottom_m - self.bottom_m) / memory
        low = min(detection.bottom_m, risen) if self.bottom_m < math.inf else detection.bottom_m
        self.bottom_m = low
        off = np.array(origin) - (self.polygon if len(self.polygon) else detection.polygon).mean(0)
        part = math.atan2(off[1], off[0]) / (2.0 * math.pi) * VIEWS
        self.views |= 1 << (round(part) % VIEWS)
        self.seen_s = at_s

    def judge(self, is_hit: bool) -> None:
        """One frame that should have shown it."""
        self.frames += 1
        self.noted_ago += 1
        share = 1.0 / min(self.frames, self._s.memory_frames)
        self.rate += (float(is_hit) - self.rate) * share

    def draw(self) -> list[Floats]:
        """Its outline anew; and further outlines (n, 2) of its field: objects of their own.

        No outline: it is gone.
        """
        s, field = self._s, self.awake()
        self.drawn_ago = 0
        outlines = polygons_of(field.values(), field.place, s.cell_m, s.least_size_m)
        self.polygon = outlines[0] if outlines else np.zeros((0, 2))
        self.finished = field.finished(self.polygon)
        if len(self.polygon):
            if lost_share(self.stood[1], self.polygon, s.contradiction_m) > LOST_SHARE:
                self.kind = "moved"
            if self.noted_ago >= s.memory_frames:
                self.note()
        return [part for part in outlines[1:] if area_of(part) > s.least_size_m**2]

    def note(self) -> None:
        """Keep where it stands now, to tell by it later whether it was moved."""
        self.stood, self.noted_ago = (self.lines(), self.stood[0]), 0

    def is_another(self) -> None:
        """It is no longer the thing that stood there: it was parted, or joined with another."""
        self.stood, self.noted_ago = (NO_SIDES, NO_SIDES), 0

    def lines(self) -> Floats:
        """Its finished sides but for their ends, (k, 4) m: where they are is known."""
        ends = np.roll(self.polygon, -1, axis=0)
        along = ends - self.polygon
        lengths = np.hypot(*along.T)
        cell = self._s.cell_m
        good = self.finished & (lengths > 3.0 * cell)
        cut = cell * along[good] / lengths[good, None]
        return np.hstack([self.polygon[good] + cut, ends[good] - cut])

    def was_seen_round(self, depth_m: float) -> bool:
        """Whether most of its outline was seen, and it is so deep somewhere; a face is not."""
        outline = shapely.Polygon(self.polygon)
        lengths = np.hypot(*(np.roll(self.polygon, -1, axis=0) - self.polygon).T)
        is_seen = float(lengths[self.finished].sum()) > SEEN_ROUND * outline.length
        return is_seen and not outline.buffer(-0.5 * depth_m).is_empty

    def trust(self) -> float:
        """How much its rate is worth, 0 to 1, by the frames that placed it."""
        return 1.0 - float(1.0 - 1.0 / self._s.memory_frames) ** self.frames

    def record(self) -> MapObject:
        return MapObject(
            *(self.id, self.polygon, self.bottom_m, self.top_m, self.first_s, self.seen_s),
            *(self.views, self.finished, self.rate * self.trust(), self.kind),
        )

    def shift(self, by: Floats) -> None:
        """Move it (2,) m."""
        self.polygon = self.polygon + by
        twice = np.tile(by, 2)
        self.stood = self.stood[0] + twice, self.stood[1] + twice
        if self.field is not None:
            self.field.place = self.field.place + by


def pieces_count(polygon: Floats, longest_m: float) -> np.ndarray:
    """How many pieces `pieces_of` cuts each side into: (n,)."""
    lengths = np.hypot(*(np.roll(polygon, -1, axis=0) - polygon).T)
    return np.asarray(np.maximum(1, np.ceil(lengths / longest_m)).astype(np.int64))


def lost_share(sides: Floats, outline: Floats, by_m: float) -> float:
    """Share of sides (k, 4), by length, that lies outside of an outline (n, 2) by more than that.

    What was never seen of a thing does not count: it may become smaller without being moved.
    """
    if len(sides) == 0:
        return 0.0
    counts = np.maximum(1, np.ceil(np.hypot(*(sides[:, 2:] - sides[:, :2]).T) / by_m)).astype(int)
    side = np.repeat(np.arange(len(sides)), counts)
    number = np.arange(len(side)) - np.repeat(np.cumsum(counts) - counts, counts)
    share = ((number + 0.5) / counts[side])[:, None]
    points = sides[side, :2] + share * (sides[side, 2:] - sides[side, :2])
    away = shapely.distance(shapely.Polygon(outline), shapely.points(points))
    return float((away > by_m).mean())
