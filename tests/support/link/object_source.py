"""Objects and a path that change at random, as a vector map's do, for tests of the planner link."""

import math
import random

import numpy as np

from core.records import (
    F64,
    OBJECT_MOVED,
    OBJECT_MOVING,
    OBJECT_STATIC,
    ObjectChanges,
    ObjectReport,
    PathReport,
    PathSegment,
)


def round_outline(corners: int, x_m: float, y_m: float, radius_m: float) -> F64:
    """(corners, 2) of a regular polygon."""
    angles = 2 * math.pi * np.arange(corners) / corners
    return np.stack([x_m + radius_m * np.cos(angles), y_m + radius_m * np.sin(angles)], axis=1)


def object_of(
    number: int, outline_m: F64, kind: int = OBJECT_STATIC, seen_s: float = 100.0
) -> ObjectReport:
    velocity = (0.5, -0.25) if kind == OBJECT_MOVING else (0.0, 0.0)
    return ObjectReport(number, kind, outline_m, 0.0, 1.2, velocity, 0.8, seen_s)


class ObjectWorld:
    """A source of objects and of a path; every change has its version.

    Attributes:
        reports: what there is now, by id.
        path: None: nobody plans.
        looks: False: nothing looks for objects any more.
    """

    def __init__(self, seed: int = 0) -> None:
        self.reports: dict[int, ObjectReport] = {}
        self.path: PathReport | None = None
        self.version, self.looked_s = 0, -math.inf
        self._log: list[tuple[int, int]] = []  # version, id
        self._next, self.random = 0, random.Random(seed)

    @property
    def objects(self) -> "ObjectWorld":
        return self

    def changes(self, since: int) -> ObjectChanges:
        touched = {number for version, number in self._log if version > since}
        if since < 0:
            touched = set(self.reports)
        changed = tuple(self.reports[n] for n in sorted(touched) if n in self.reports)
        return ObjectChanges(changed, tuple(n for n in sorted(touched) if n not in self.reports))

    def put(self, report: ObjectReport) -> None:
        self.version += 1
        self.reports[report.id] = report
        self._log.append((self.version, report.id))

    def remove(self, number: int) -> None:
        self.version += 1
        del self.reports[number]
        self._log.append((self.version, number))

    def change(self, now_s: float, count: int) -> None:
        """Objects come, go, move and grow; a camera has looked."""
        chance, self.looked_s = self.random, now_s
        for _ in range(count):
            known = list(self.reports)
            what = chance.random()
            if known and what < 0.3:
                self.remove(chance.choice(known))
            elif known and what < 0.6:
                self.put(self._made(chance.choice(known), now_s))
            elif len(known) < 40:
                self._next += chance.choice([1, 1, 1000, 2**20])
                self.put(self._made(self._next, now_s))

    def _made(self, number: int, now_s: float) -> ObjectReport:
        chance = self.random
        kind = chance.choice([OBJECT_STATIC, OBJECT_MOVED, OBJECT_MOVING])
        place = chance.uniform(-20, 20), chance.uniform(-20, 20)
        outline_m = round_outline(chance.choice([3, 4, 8, 20]), *place, chance.uniform(0.1, 2))
        return object_of(number, outline_m, kind, now_s)

    def plan(self, version: int, *sizes: int) -> None:
        """A path of segments of so many points, sweeping and travelling in turn."""
        chance, segments = self.random, []
        for k, size in enumerate(sizes):
            points = np.array([(chance.uniform(-60, 60), chance.uniform(-60, 60))]) + np.cumsum(
                np.full((size, 2), 0.3), axis=0
            )
            segments.append(PathSegment(k % 2 == 0, points))
        self.path = PathReport(version, tuple(segments), 0)
