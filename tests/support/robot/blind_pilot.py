"""A planner that turns to its goal and drives there, whatever the map says, for judges to catch."""

import math

from fakes.planner_mcu.receiver import FakePlanner
from tools.rig.planner.host import PlannerState

VALID_S, PERIOD_S = 0.4, 0.1
AIMED_RAD = 0.1


class BlindPilot(FakePlanner):
    """Drives by the pose alone.

    Args:
        v_mps: its speed; below 0 it drives there in reverse.
    """

    def __init__(self, v_mps: float = 0.6, radius_m: float = 0.3) -> None:
        super().__init__()
        self._speed_mps, self._radius_m = v_mps, radius_m
        self._goal: tuple[float, float] | None = None
        self._state, self._asked_s = PlannerState(), -math.inf
        self.gives_up = ""  # why it is "stopped" for ever

    def goal(self, x_m: float, y_m: float) -> None:
        self._goal, self._state = (x_m, y_m), PlannerState("driving")

    def state(self, now_s: float) -> PlannerState:
        return self._state

    def poll(self, now_s: float) -> list[bytes]:
        """Frames to send; a request ten times a second among them."""
        if now_s - self._asked_s >= PERIOD_S - 1e-6 and self._goal and self.pose is not None:
            self._asked_s = now_s
            self._state = self._decide(*self._goal)
            self.drive(now_s, self._state.v_mps, self._state.w_radps, VALID_S)
        return super().poll(now_s)

    def _decide(self, x_m: float, y_m: float) -> PlannerState:
        pose = self.pose
        assert pose is not None
        if self.gives_up:
            return PlannerState("stopped", self.gives_up)
        away_m = math.dist((pose.x_m, pose.y_m), (x_m, y_m))
        if self._state.state == "arrived" or away_m < self._radius_m:
            return PlannerState("arrived")
        bearing_rad = math.atan2(y_m - pose.y_m, x_m - pose.x_m)
        if self._speed_mps < 0.0:
            bearing_rad += math.pi
        off_rad = (bearing_rad - pose.yaw_rad + math.pi) % (2 * math.pi) - math.pi
        turn_radps = max(-0.5, min(0.5, 1.5 * off_rad))
        if abs(off_rad) > AIMED_RAD:
            return PlannerState("driving", "", 0.0, turn_radps)
        return PlannerState("driving", "", self._speed_mps, turn_radps)
