"""What was planned, as it enters the app at a tick; and how far along it the machine is.

Nothing here needs the library of polygons: a replay has only this of a plan.
"""

import math

import numpy as np
from msgspec import Struct

from core.records import F64, PathSegment

PASSED_M = 0.05  # so near before the end of an edge it counts as passed,
ASIDE_M = 0.30  # if the machine is no farther to the side of it
TURN_M = 0.35  # of way that a radian of turning is worth
STUBBY_M = 1e-4  # edges that are shorter are passed at once
Place = tuple[float, float, float]  # x, y, yaw; map frame


class Planned(Struct, frozen=True, eq=False):
    """One task, all that the app gets of it. Without segments there is nothing to drive."""

    t_s: float  # host monotonic clock: when it was asked for
    epoch: int  # of the map, as in `core.objects.seen.Seen`
    goal: str  # "look", "sweep", "home", "wait" or "stuck"
    why: str  # of what waits, looks at what parts it off, or is stuck; "" else
    segments: tuple[PathSegment, ...]
    seen_m2: float  # floor that was seen by then, and clean floor
    clean_m2: float


class Progress:
    """How far a machine has come along a path of straight edges; it never goes back on it."""

    def __init__(self, segments: tuple[PathSegment, ...]) -> None:
        self._points: F64 = np.vstack([np.zeros((0, 2)), *(one.points_m for one in segments)])
        self._sweeps = [one.sweeps for one in segments for _ in one.points_m]  # on the way to each
        self.ahead = min(1, len(self._points))  # the point that it drives to; all: it has passed it
        self.is_on_path = False  # beside the edge that it drives

    @property
    def is_done(self) -> bool:
        return self.ahead >= len(self._points)

    @property
    def sweeps(self) -> bool:
        """Whether the tool works where the machine is now."""
        return not self.is_done and self.is_on_path and self._sweeps[self.ahead]

    @property
    def rest(self) -> F64:
        """(n, 2) what is ahead of the path."""
        return self._points[self.ahead :]

    def left_m(self, place: Place) -> float:
        """To the point that it drives to, and what it has to turn towards it, as metres."""
        if self.is_done:
            return 0.0
        x, y, yaw = place
        dx, dy = (self._points[self.ahead] - (x, y)).tolist()
        off_rad = math.remainder(math.atan2(dy, dx) - yaw, math.tau)
        return math.hypot(dx, dy) + TURN_M * abs(off_rad)

    def step(self, x_m: float, y_m: float) -> None:
        """The machine is there now."""
        while not self.is_done:
            begin, end = self._points[self.ahead - 1], self._points[self.ahead]
            (ax, ay), length_m = (end - begin).tolist(), float(np.hypot(*(end - begin)))
            if length_m > STUBBY_M:
                dx, dy = float(end[0]) - x_m, float(end[1]) - y_m
                left_m, aside_m = (dx * ax + dy * ay) / length_m, abs(dx * ay - dy * ax) / length_m
                self.is_on_path = aside_m <= ASIDE_M
                if left_m > PASSED_M or not self.is_on_path:
                    return
            self.ahead += 1
