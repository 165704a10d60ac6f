"""A planner that drives the path which the link tells it (PATH), and nothing else.

It asks for motions as any planner does, and obeys the link's advice; what stands in the way is for
the sender to judge. Where the path is not surely the newest, or its sender drives to none of its
points, it stands.
"""

import math

from fakes.world.path_follower import PERIOD_S, Limits, PathFollower
from mapod_link.receiver import Receiver

LIMITS = Limits(speed_mps=0.35, accel_mps2=0.25, turn_radps=0.7, turn_accel_radps2=1.2)
SLOW_MPS = 0.15  # where the link advises to go slowly
VALID_S = 0.3  # of a request
STUCK_S = 1.0  # so long it stands though it asks; then
LETS_GO_S = 0.3  # it lets go, as one must whom a monitor has halted,
BACK_S, BACK_MPS = 1.2, 0.12  # and goes back a little: what bars a turn is often beside it;
AGAIN_S = 10.0  # stuck again within that time, it goes ahead a little, then back, and so on
STANDS_MPS, STANDS_RADPS = 0.01, 0.02


class PathDriving:
    """Drives the path of one link."""

    def __init__(self, planner: Receiver, limits: Limits = LIMITS) -> None:
        self._planner, self._limits = planner, limits
        self._follower = PathFollower(limits)
        self._number = 0  # of the path that is driven
        self._stepped_s = self._moved_s = self._let_go_s = -math.inf
        self._asks, self._goes = False, -1  # ahead or back, where it is stuck

    def step(self, now_s: float) -> None:
        """Ask for the next motion, if one is due."""
        if now_s - self._stepped_s < PERIOD_S - 1e-6:
            return
        self._stepped_s = now_s
        planner, pose = self._planner, self._planner.pose
        why = self.why_not(now_s)
        if why or pose is None:
            if self._asks:
                planner.drive(now_s, 0.0, 0.0, 0.0)
            self._asks, self._moved_s = False, now_s
            self._follower.motion((0.0, 0.0, 0.0), 0.0)
            return
        path = planner.vectors.path
        if path.number != self._number:
            self._number = path.number
            self._follower.follow(path.points_m)
        may_mps = SLOW_MPS if planner.advice(now_s)[0] == "slow" else self._limits.speed_mps
        v_mps, w_radps = self._follower.motion((pose.x_m, pose.y_m, pose.yaw_rad), may_mps)
        if abs(pose.v_mps) > STANDS_MPS or abs(pose.w_radps) > STANDS_RADPS:
            self._moved_s = now_s
        if now_s - self._moved_s > STUCK_S:
            self._goes = -self._goes if now_s - self._let_go_s < AGAIN_S else -1
            self._let_go_s = self._moved_s = now_s
        if now_s - self._let_go_s < LETS_GO_S + BACK_S:
            is_off = now_s - self._let_go_s >= LETS_GO_S
            v_mps, w_radps = self._goes * BACK_MPS if is_off else 0.0, 0.0
        self._asks = bool(v_mps or w_radps)
        planner.drive(now_s, v_mps, w_radps, VALID_S)

    def why_not(self, now_s: float) -> str:
        """Why it stands, in words; "" while there is something to drive."""
        planner, path = self._planner, self._planner.vectors.path
        state, why = planner.vectors.path_state(now_s)
        if state != "known":
            return why
        advice, why = planner.advice(now_s)
        if advice == "stop":
            return why
        if not len(path.points_m):
            return "there is no path"
        if path.ahead is None:
            return "the sender drives to no point of its path"
        return ""
