"""Whether and when a map bars the robot's way where something lies across it."""

import numpy as np

from core.records import FREE, OBSTACLE
from tools.experiments.trial import Trial
from tools.experiments.views import MapView

LANE_M = 0.3  # to either side: half the robot's width
FRONT_M = 0.52  # of the robot, ahead of its axle
BEFORE_M, BEHIND_M = 0.4, 0.4  # around the span in which an obstacle cell may lie


def barred(view: MapView, span_m: tuple[float, float]) -> bool:
    """Whether each line of cells of the robot's lane has an obstacle cell around a span of x."""
    near = view.part((span_m[0] - BEFORE_M, span_m[1] + BEHIND_M), (-LANE_M, LANE_M))
    lines = np.nonzero(near.any(axis=1))[0]
    stops = ((view.states == OBSTACLE) & near).any(axis=1)
    return bool(lines.size) and bool(stops[lines].all())


def free_within(view: MapView, span_m: tuple[float, float], edge_m: float = 0.0) -> int:
    """Free cells of the lane whose centres lie in a span of x, an edge left out at both ends."""
    inside = view.part((span_m[0] + edge_m, span_m[1] - edge_m), (-LANE_M, LANE_M))
    return int(((view.states == FREE) & inside).sum())


class BarWatch:
    """Notes during a drive along x from which place on each app's map bars the way for good."""

    def __init__(self, test: Trial, span_m: tuple[float, float]) -> None:
        self._test, self._span_m = test, span_m
        self._since_m: dict[str, float] = {}
        self.most_free = dict.fromkeys(test.apps, 0.0)

    def look(self) -> None:
        front_m = self._test.rig.world.pose()[0] + FRONT_M
        for view in self._test.views():
            if barred(view, self._span_m):
                self._since_m.setdefault(view.name, front_m)
            else:
                self._since_m.pop(view.name, None)
            free = float(free_within(view, self._span_m, view.cell_m / 2))
            self.most_free[view.name] = max(self.most_free[view.name], free)

    def ahead_m(self) -> dict[str, float]:
        """How far ahead of the robot's front the way was barred, and stayed so; 0: it is not."""
        begin_m = self._span_m[0]
        return {
            name: begin_m - self._since_m[name] if name in self._since_m else 0.0
            for name in self._test.apps
        }
