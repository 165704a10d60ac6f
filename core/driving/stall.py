"""Wheels that have power and do not turn, by their counters: these are stuck, or the robot is.

A counter that stands still looks like a robot that does, whatever the robot does. So each wheel may
be sent on by a short way that its counter does not follow; then the counters are not believed until
they move, or begin anew. It is not enough that the commander lets go: one who does so every second
would inch the robot ahead unseen. Counters that are not read are no matter of this: they are stale.
Nor is a controller that says that it gives the wheels no power: then they had none to follow.
Source: design, section 8.
"""

import math

from core.config import Config
from core.records import WheelCounts

STALLED = "the wheels' counters stand still although the motors have power"
UNFOLLOWED_M = 0.15  # sent on without the counter following, and it is not believed any more
LEAST_MPS = 0.1  # what is sent more slowly may well stand: friction
LEAST_SHARE = 0.2  # of the way sent that a counter follows at least, slip and sag and all
LONGEST_STEP_S = 0.05  # what a late tick counts for at most


class StallWatch:
    """Compares what both wheels are told with what their counters say."""

    def __init__(self, config: Config) -> None:
        robot, self._full_mps = config.robot, config.drive.full_power_mps
        counts_per_turn = 4 * robot.encoder_ppr * robot.gear_ratio
        self._m_per_count = 2 * math.pi * robot.wheel_radius_m / counts_per_turn
        self._sent_m = [0.0, 0.0]  # left, right: since the newest counts
        self._unfollowed_m = [0.0, 0.0]  # sent before them, and not followed
        self.stalled = False  # from when on a counter has not followed until it moves again
        self._last: WheelCounts | None = None
        self._now_s, self._speeds_mps = math.inf, (0.0, 0.0)  # of the newest call

    def told(self, now_s: float, left: float, right: float) -> None:
        """The power of both wheels, -1..1 of full, from now on until the next call."""
        passed_s = max(0.0, min(LONGEST_STEP_S, now_s - self._now_s))
        for k, speed_mps in enumerate(self._speeds_mps):
            if speed_mps >= LEAST_MPS:
                self._sent_m[k] += speed_mps * passed_s
        self._now_s = now_s
        self._speeds_mps = abs(left) * self._full_mps, abs(right) * self._full_mps

    def counted(self, counts: WheelCounts) -> None:
        last, self._last = self._last, counts
        sent_m, self._sent_m = self._sent_m, [0.0, 0.0]
        if last is None or counts.restarts != last.restarts or counts.cut_off:
            self._unfollowed_m = [0.0, 0.0]
        else:
            for k, moved in enumerate((counts.left - last.left, counts.right - last.right)):
                followed_m = abs(moved) * self._m_per_count / LEAST_SHARE
                self._unfollowed_m[k] = max(0.0, self._unfollowed_m[k] + sent_m[k] - followed_m)
        self.stalled = max(self._unfollowed_m) >= UNFOLLOWED_M
