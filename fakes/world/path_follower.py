"""Follows a path of straight edges with two wheels: turns on the spot, then drives the edge.

A corner that is slight is driven through. The path is the map's, the pose is as the machine
believes it. It looks at nothing: who gives the path says when to stand.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fakes.world.robot import MAX_SPEED_MPS, TRACK_WIDTH_M

F64 = npt.NDArray[np.float64]
PERIOD_S = 0.05
FULL = 127  # the controller's full power
SLIGHT_RAD = math.radians(25.0)  # corners up to that are driven through,
SLIGHT_MPS = 0.30  # so fast
AIMED_RAD, ASTRAY_RAD = 0.03, 0.6  # ends a turn on the spot; begins one: the more off, the slower
ARRIVED_M = 0.02
HEADING_PER_S = 4.0  # turn of a radian off
LEAST_AHEAD_M = 0.12  # of the point that it heads for
STUBBY_M = 1e-4  # edges that are shorter are none


@dataclass(frozen=True, slots=True)
class Limits:
    """How fast the machine goes and turns, and how it speeds up."""

    speed_mps: float
    accel_mps2: float
    turn_radps: float
    turn_accel_radps2: float


class PathFollower:
    """Drives paths, one after the other, 20 times a second."""

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self._points: F64 = np.zeros((0, 2))
        self._edges: list[int] = []  # of each edge, which one of the path that was given
        self._edge, self._turning = 0, True
        self._v_mps = self._w_radps = 0.0
        self._yaw: float | None = None

    def follow(self, points: F64, yaw: float | None = None) -> None:
        """A new path (n, 2), from where the machine is; at its end it turns to `yaw`, if any."""
        steps = np.hypot(*np.diff(points, axis=0).T) if len(points) > 1 else np.zeros(0)
        kept = [0, *(k + 1 for k in range(len(steps)) if steps[k] > STUBBY_M)]
        self._points, self._edges = points[kept], [k - 1 for k in kept[1:]]
        self._edge, self._turning, self._yaw = 0, True, yaw

    @property
    def is_done(self) -> bool:
        return self._edge >= len(self._edges) and self._yaw is None

    @property
    def edge(self) -> int:
        """Which edge of the path that was given is driven now; -1: none."""
        return self._edges[self._edge] if self._edge < len(self._edges) else -1

    def rest(self, place: Sequence[float]) -> F64:
        """What is ahead of the path (n, 2), from the place on."""
        if self._edge >= len(self._edges):
            return np.array([place[:2]])
        return np.vstack([[place[:2]], self._points[self._edge + 1 :]])

    def power(self, place: tuple[float, float, float], may_mps: float) -> tuple[int, int]:
        """Power of the left motor and the right one, -127..127, for the next period."""
        v_mps, w_radps = self.motion(place, may_mps)
        rim_mps = w_radps * TRACK_WIDTH_M / 2
        return _power(v_mps - rim_mps), _power(v_mps + rim_mps)

    def motion(self, place: tuple[float, float, float], may_mps: float) -> tuple[float, float]:
        """Ahead, m/s, and turning, rad/s, for the next period.

        Args:
            place: x, y, yaw.
            may_mps: 0: stand, or turn on the spot.
        """
        limits = self._limits
        v, w = self._wanted(place)
        v = min(v, may_mps)
        w = w if may_mps > 0.0 or self._turning else 0.0
        self._v_mps = _towards(self._v_mps, v, limits.accel_mps2 * PERIOD_S)
        if may_mps <= 0.0 or (self._turning and v <= 0.0):
            self._v_mps = 0.0
        self._w_radps = _towards(self._w_radps, w, limits.turn_accel_radps2 * PERIOD_S)
        return self._v_mps, self._w_radps

    def _wanted(self, place: tuple[float, float, float]) -> tuple[float, float]:
        x, y, yaw = place
        while self._edge < len(self._edges):
            a, b = self._points[self._edge], self._points[self._edge + 1]
            along, length_m = b - a, math.dist(a, b)
            left_m = float((b - [x, y]) @ along) / length_m
            slight = self._is_slight(self._edge)
            if left_m > (0.0 if slight else ARRIVED_M):
                return self._on_edge(place, left_m)
            self._edge += 1
            self._turning = not slight
        if self._yaw is None:
            return 0.0, 0.0
        off = math.remainder(self._yaw - yaw, math.tau)
        if abs(off) < 2 * AIMED_RAD:
            self._yaw = None
        return 0.0, self._turn(off)

    def _on_edge(self, place: tuple[float, float, float], left_m: float) -> tuple[float, float]:
        x, y, yaw = place
        aim = self._aim(left_m)
        off = math.remainder(math.atan2(aim[1] - y, aim[0] - x) - yaw, math.tau)
        if self._turning:  # towards the same point as on the way: else it may turn for ever
            self._turning = abs(off) > AIMED_RAD
            return 0.0, self._turn(off)
        if abs(off) > ASTRAY_RAD:
            self._turning = True
        slow_mps = self._slow_mps(left_m)
        most = self._limits.turn_radps
        turn = max(-most, min(most, HEADING_PER_S * off))
        aimed_mps = self._limits.speed_mps * max(0.0, 1.0 - abs(off) / ASTRAY_RAD)
        return min(aimed_mps, max(0.05, slow_mps)), turn

    def _slow_mps(self, left_m: float) -> float:
        """So fast that it stands at the next sharp corner, and is slow at slight ones."""
        edge, slow_mps = self._edge, self._limits.speed_mps
        gain_mps2 = 0.8 * self._limits.accel_mps2  # of the squared speed, by metre
        while gain_mps2 * left_m < slow_mps**2:
            slight = self._is_slight(edge)
            end_mps = SLIGHT_MPS if slight else 0.0
            slow_mps = min(slow_mps, math.sqrt(end_mps**2 + gain_mps2 * max(0.0, left_m)))
            if not slight:
                break
            edge += 1
            left_m += math.dist(self._points[edge], self._points[edge + 1])
        return slow_mps

    def _aim(self, left_m: float) -> F64:
        """The point of the path to head for: so far ahead that round ways are kept to.

        Behind the last edge before a sharp corner it lies on that edge, drawn out.
        """
        edge, reach_m = self._edge, max(LEAST_AHEAD_M, self._v_mps * 2.0 / HEADING_PER_S)
        while left_m < reach_m and self._is_slight(edge):
            reach_m -= left_m
            edge += 1
            left_m = math.dist(self._points[edge], self._points[edge + 1])
        a, b = self._points[edge], self._points[edge + 1]
        return np.asarray(b - (b - a) / math.dist(a, b) * (left_m - reach_m))

    def _turn(self, off: float) -> float:
        limits = self._limits
        w = math.sqrt(1.0 * limits.turn_accel_radps2 * abs(off))
        return math.copysign(min(limits.turn_radps, w, 4.0 * abs(off)), off)

    def _is_slight(self, edge: int) -> bool:
        """Whether the corner at the end of an edge is driven through."""
        if edge + 2 >= len(self._points):
            return False
        a, b, c = self._points[edge : edge + 3]
        turn = math.atan2(c[1] - b[1], c[0] - b[0]) - math.atan2(b[1] - a[1], b[0] - a[0])
        return abs(math.remainder(turn, math.tau)) <= SLIGHT_RAD


def _towards(value: float, wanted: float, most: float) -> float:
    return value + max(-most, min(most, wanted - value))


def _power(rim_mps: float) -> int:
    return max(-FULL, min(FULL, round(FULL * rim_mps / MAX_SPEED_MPS)))
