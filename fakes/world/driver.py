"""A driver that takes the robot along a route through the motor controller, as a radio would.

It knows the true pose, turns on the spot towards the next waypoint, drives there, and begins again
after the last one. It looks at nothing: a route must be free.
"""

import math
from collections.abc import Callable, Sequence

from fakes.world.robot import MAX_SPEED_MPS, TRACK_WIDTH_M

PERIOD_S = 0.05
FULL = 127  # the controller's full power
ARRIVED_M = 0.10
AIMED_RAD = 0.05  # ends a turn on the spot
ASTRAY_RAD = 0.50  # begins one
ACCELERATION_MPS2 = 0.4
TURN_RADPS, TURN_RADPS2 = 0.6, 1.0

Pose = tuple[float, float, float, float, float]  # x, y, yaw, pitch, roll


class Driver:
    """Follows waypoints, 20 times a second.

    Args:
        pose: where the robot is now, map frame.
        command: power of channel 1 (left) and 2 (right), -127..127.
        waypoints: (x, y) metres, map frame, taken in order, over and over; none: stands still.
            A third number is the speed on the way there, m/s.
        speed_mps: where a waypoint does not say it.
        track_m: between the wheels.
        most_mps: never faster, whatever a waypoint says.
    """

    def __init__(
        self,
        pose: Callable[[], Pose],
        command: Callable[[int, int], None],
        waypoints: Sequence[tuple[float, ...]],
        speed_mps: float,
        start_delay_s: float,
        track_m: float = TRACK_WIDTH_M,
        most_mps: float = math.inf,
    ) -> None:
        self._pose, self._command = pose, command
        self._waypoints, self._speed_mps = list(waypoints), speed_mps
        self._most_mps = most_mps
        self._delay_s, self._track_m = start_delay_s, track_m
        self._due_s: float | None = None
        self._v_mps = self._w_radps = 0.0
        self._turning = False
        self.reached = 0  # waypoints so far, over all laps

    @property
    def laps(self) -> int:
        return self.reached // len(self._waypoints) if self._waypoints else 0

    def step(self, now_s: float) -> None:
        """Command the motors if it is time; the first call starts the delay."""
        if self._due_s is None:
            self._due_s = now_s + self._delay_s
        if now_s < self._due_s or not self._waypoints:
            return
        self._due_s += PERIOD_S * (1 + math.floor((now_s - self._due_s) / PERIOD_S))
        v_mps, w_radps = self._wanted()
        self._v_mps = _towards(self._v_mps, v_mps, ACCELERATION_MPS2 * PERIOD_S)
        self._w_radps = _towards(self._w_radps, w_radps, TURN_RADPS2 * PERIOD_S)
        rim_mps = self._w_radps * self._track_m / 2
        self._command(_power(self._v_mps - rim_mps), _power(self._v_mps + rim_mps))

    def _wanted(self) -> tuple[float, float]:
        """(forward, turning) speed that the way to the next waypoint calls for."""
        x, y, yaw = self._pose()[:3]
        goal = self._waypoints[self.reached % len(self._waypoints)]
        ahead_m = math.hypot(goal[0] - x, goal[1] - y)
        if ahead_m < ARRIVED_M:
            self.reached += 1
            goal = self._waypoints[self.reached % len(self._waypoints)]
            ahead_m = math.hypot(goal[0] - x, goal[1] - y)
        error_rad = math.remainder(math.atan2(goal[1] - y, goal[0] - x) - yaw, math.tau)
        self._turning = abs(error_rad) > (AIMED_RAD if self._turning else ASTRAY_RAD)
        # the angle it still takes to stop turning, and the way it still takes to stop
        w_radps = math.copysign(math.sqrt(1.2 * TURN_RADPS2 * abs(error_rad)), error_rad)
        w_radps = max(-TURN_RADPS, min(TURN_RADPS, w_radps if self._turning else 1.5 * error_rad))
        slow_mps = math.sqrt(1.6 * ACCELERATION_MPS2 * ahead_m)
        speed_mps = min(self._most_mps, goal[2] if len(goal) > 2 else self._speed_mps)
        return (0.0 if self._turning else min(speed_mps, slow_mps)), w_radps


def _towards(value: float, wanted: float, most: float) -> float:
    return value + max(-most, min(most, wanted - value))


def _power(rim_mps: float) -> int:
    return max(-FULL, min(FULL, round(FULL * rim_mps / MAX_SPEED_MPS)))
