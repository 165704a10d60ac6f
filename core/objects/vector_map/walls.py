"""Walls: long upright planes as lines, judged piece by piece, so that a door opens and closes.

A wall is a line with pieces along it. Each piece has a share of hits, a running mean over the
frames that could see it: above one half it is wall. Where a frame saw through a piece, that counts
against it: the piece becomes an opening. And each has its place, the mean of where all frames had
it. The line is fitted to the places of all pieces: what is seen of one end does not turn the other
away, and a place or a heading that wanders does not take the walls along, which correct them.
"""

import math
from itertools import pairwise

import msgspec
import numpy as np
from msgspec import Struct

from core.objects.records import Floats
from core.objects.vector_map.index import Box
from core.objects.vector_map.seen import sees
from core.objects.vector_map.settings import ObjectMapSettings

HALF = 0.5


class WallRecord(Struct, frozen=True, eq=False):
    """A wall as the map has it."""

    id: int
    segments: Floats  # (k, 4) m: x1, y1, x2, y2, along the wall
    openings: Floats  # (k, 4) m: pieces between them that were seen open: doors
    first_seen_s: float
    last_seen_s: float
    confidence: float = 1.0  # 0 to 1: share of the looks at its pieces that met them


class Wall:
    """One line: a point of it, its direction, and the pieces along it from `start` pieces on."""

    def __init__(self, number: int, segment: Floats, at_s: float, s: ObjectMapSettings) -> None:
        self.id, self._s = number, s
        self.point = 0.5 * (segment[:2] + segment[2:])
        self.along = (segment[2:] - segment[:2]) / math.hypot(*(segment[2:] - segment[:2]))
        self.start = 0
        self.share, self.weight = np.zeros(0), np.zeros(0)
        self.aside, self.placed = np.zeros(0), np.zeros(0)  # off the line, m, by so many segments
        self.first_s = self.seen_s = at_s
        self.frames = 0
        self._told: WallRecord | None = None  # as it was known or told, until a frame says more

    @classmethod
    def known(cls, record: WallRecord, at_s: float, s: ObjectMapSettings) -> "Wall":
        """A wall that is known: as settled as if it had been seen; its pieces begin where it does.

        Until a frame speaks of it, it is told as it was known, to the millimetre.
        """
        start, ends = record.segments[0, :2], record.segments.reshape(-1, 2)
        far = ends[np.hypot(*(ends - start).T).argmax()]
        wall = cls(record.id, np.concatenate([start, far]), at_s, s)
        wall.point = start
        for segment in record.segments:
            wall.hit(segment, segment, at_s)
        for opening in record.openings:
            wall.open(opening)
        wall.settle()
        wall._told = msgspec.structs.replace(
            record, first_seen_s=wall.first_s, last_seen_s=wall.seen_s
        )
        return wall

    @property
    def normal(self) -> Floats:
        """Unit vector (2,) to the left of the wall."""
        return np.array([-self.along[1], self.along[0]])

    def measured(self, points: Floats) -> tuple[Floats, Floats]:
        """Of points (n, 2): how far along the wall, and how far to its left, m."""
        off = points - self.point
        return off @ self.along, off @ self.normal

    def is_along(self, segment: Floats) -> bool:
        """Whether a segment (4,) is of this wall: its direction, its place, and near its pieces."""
        ends = segment.reshape(2, 2)
        along, aside = self.measured(ends)
        length = math.dist(*ends)
        near = 3.0 * math.hypot(self._s.pose_sigma_m, self._s.hull_sigma_m) + self._s.view_gap_m
        turn = math.atan2(abs(float(aside[1] - aside[0])), abs(float(along[1] - along[0])))
        first, last = self.extent()
        gap = max(first - float(along.max()), float(along.min()) - last)
        return (
            turn < math.radians(self._s.wall_angle_deg)
            and float(np.abs(aside).min()) < near
            and float(np.abs(aside).max()) < near + 0.1 * length
            and gap < 2.0 * near + 1.0
        )

    def hit(self, segment: Floats, told: Floats, at_s: float) -> None:
        """One frame's segment (4,) of it: its pieces are wall, and the line is fitted.

        Args:
            told: (4,) the same where the frame's pose alone had it.
        """
        along, _ = self.measured(segment.reshape(2, 2))
        _, aside = self.measured(told.reshape(2, 2))
        cell = self._s.wall_cell_m
        first = math.ceil(float(along.min()) / cell - HALF)
        last = math.floor(float(along.max()) / cell - HALF)
        if last < first:  # so short that it holds the middle of no piece: it is of one at least
            first = last = math.floor(float(along.mean()) / cell)
        self._told = None
        self._reach(first, last)
        mine = slice(first - self.start, last - self.start + 1)
        self._count(np.arange(len(self.share))[mine], 1.0)
        self._place(mine, along, aside)
        self._fit()
        self.seen_s, self.frames = at_s, self.frames + 1

    def is_one_with(self, other: "Wall") -> bool:
        """Whether both meet, and nowhere from end to end lie farther apart than poses err."""
        ends = np.array([other.point + at * other.along for at in other.extent()])
        along, aside = self.measured(ends)
        reach = float(along[1] - along[0])
        first, last = self.extent()
        low, high = float(along.min()), float(along.max())
        slope = float(aside[1] - aside[0]) / reach if reach else math.inf
        if min(last, high) <= max(first, low) or abs(slope) > math.tan(
            math.radians(self._s.wall_angle_deg)
        ):
            return False
        apart = aside[0] + slope * (np.array([min(first, low), max(last, high)]) - along[0])
        return float(np.abs(apart).max()) < self._s.contradiction_m

    def take(self, other: "Wall") -> None:
        """Go on with what another one has told of its pieces as well."""
        self._told = None
        places = other.point + other.middles()[:, None] * other.along
        along, aside = self.measured(places + other.aside[:, None] * other.normal)
        pieces = np.floor(along / self._s.wall_cell_m).astype(np.int64)
        self._reach(int(pieces.min()), int(pieces.max()))
        at = pieces - self.start
        for mean, count, values, counts in (
            (self.share, self.weight, other.share, other.weight),
            (self.aside, self.placed, aside, other.placed),
        ):
            total = mean * count
            np.add.at(total, at, values * counts)
            np.add.at(count, at, counts)
            mean[:] = total / np.maximum(count, 1.0)
        np.minimum(self.weight, self._s.memory_frames, out=self.weight)
        self.first_s, self.seen_s = min(self.first_s, other.first_s), max(self.seen_s, other.seen_s)
        self.frames += other.frames
        self._fit()

    def seen_through(self, hits: list[Floats], sectors: Floats, lens: Floats) -> None:
        """One frame's say against pieces that none of its segments covers."""
        middle = self.middles()
        covered = np.zeros(len(middle), dtype=bool)
        for segment in hits:
            along, _ = self.measured(segment.reshape(2, 2))
            covered |= (middle > along.min()) & (middle < along.max())
        points = self.point + middle[:, None] * self.along - lens
        away = points / np.maximum(np.hypot(*points.T), 1e-9)[:, None]
        behind = points + self._s.guard_m * away
        gone = [
            k
            for k in np.flatnonzero(~covered).tolist()
            if sees(sectors, behind[k, 0], behind[k, 1]) and sees(sectors, *points[k].tolist())
        ]
        self._told = None if gone else self._told
        self._count(np.array(gone, dtype=np.int64), 0.0)
        self.placed[self.share <= HALF] = 0.0  # what will stand there may stand elsewhere

    def open(self, opening: Floats) -> None:
        """A piece (4,) m of it is known to be open."""
        along, _ = self.measured(opening.reshape(2, 2))
        cell = self._s.wall_cell_m
        first, last = round(float(along.min()) / cell), round(float(along.max()) / cell) - 1
        self._reach(first, last)
        mine = slice(first - self.start, last - self.start + 1)
        self.share[mine], self.weight[mine] = 0.0, 1.0

    def settle(self) -> None:
        """Believe all that is known of it as if it had been seen all along."""
        self.weight[self.weight > 0.0] = self._s.memory_frames
        self.placed[self.placed > 0.0] = self._s.memory_frames
        self.frames = round(self._s.memory_frames)

    def record(self) -> WallRecord:
        if self._told is None:
            known = self.weight >= self._s.confirm_frames
            is_wall = known & (self.share > HALF)
            runs = self._runs(is_wall)
            doors = [(a[1], b[0]) for a, b in pairwise(runs) if self._is_open(a[1], b[0])]
            segments, openings = self._ends(runs), self._ends(doors)
            sure = float(self.share[is_wall].mean()) if len(runs) else 0.0
            times_s = self.first_s, self.seen_s
            self._told = WallRecord(self.id, segments, openings, *times_s, sure)
        return self._told

    def box(self) -> Box:
        first, last = self.extent()
        ends = np.array([self.point + first * self.along, self.point + last * self.along])
        (x0, y0), (x1, y1) = ends.min(axis=0).tolist(), ends.max(axis=0).tolist()
        return x0, y0, x1, y1

    def middles(self) -> Floats:
        """Of all pieces, along the wall, m."""
        middles = (self.start + np.arange(len(self.share)) + HALF) * self._s.wall_cell_m
        return np.asarray(middles, np.float64)

    def _place(self, mine: slice, along: Floats, aside: Floats) -> None:
        """Where a segment of such ends had some pieces."""
        slope = (aside[1] - aside[0]) / (along[1] - along[0])
        there = aside[0] + slope * (self.middles()[mine] - along[0])
        self.placed[mine] += 1.0
        self.aside[mine] += (there - self.aside[mine]) / self.placed[mine]

    def _fit(self) -> None:
        """The line that is nearest to all pieces, each as often as it was placed, to a bound: what
        frames after each other err by hangs together."""
        known = self.placed > 0.0
        if known.sum() < 2:
            return
        middles = self.middles()
        weight = np.minimum(self.placed[known], self._s.memory_frames)
        J = np.column_stack([np.ones(len(weight)), middles[known]])
        N, g = J.T @ (weight[:, None] * J), J.T @ (weight * self.aside[known])
        offset, slope = np.linalg.solve(N, g).tolist()
        self.aside[known] -= offset + slope * middles[known]
        self.point = self.point + offset * self.normal
        self.along = self.along + slope * self.normal
        self.along = self.along / math.hypot(*self.along)

    def extent(self) -> tuple[float, float]:
        """Along it, from its first piece to its last, m."""
        cell = self._s.wall_cell_m
        return self.start * cell, (self.start + len(self.share)) * cell

    def _reach(self, first: int, last: int) -> None:
        if len(self.share) == 0:
            self.start = first
        before = max(0, self.start - first)
        behind = max(0, last + 1 - self.start - len(self.share))
        self.share = np.pad(self.share, (before, behind))
        self.weight = np.pad(self.weight, (before, behind))
        self.aside = np.pad(self.aside, (before, behind))
        self.placed = np.pad(self.placed, (before, behind))
        self.start -= before

    def _count(self, pieces: np.ndarray, value: float) -> None:
        self.weight[pieces] = np.minimum(self._s.memory_frames, self.weight[pieces] + 1.0)
        self.share[pieces] += (value - self.share[pieces]) / self.weight[pieces]

    def _runs(self, flags: np.ndarray) -> list[tuple[int, int]]:
        """Where flags are set: from each first piece to behind each last."""
        edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(np.int8), [0]])))
        return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]

    def _is_open(self, first: int, behind: int) -> bool:
        seen = self.weight[first:behind] >= self._s.confirm_frames
        return bool(seen.mean() > HALF)

    def _ends(self, runs: list[tuple[int, int]]) -> Floats:
        at = (np.array(runs, dtype=np.float64).reshape(-1, 2) + self.start) * self._s.wall_cell_m
        first = self.point + at[:, :1] * self.along
        return np.hstack([first, self.point + at[:, 1:] * self.along])
