"""Pose at a time, or none: travel from the wheels' encoders, heading from the attitude sensor.

Each pair of counts closes an interval; its travel is laid along the heading in the middle of it,
made horizontal by the pitch there. Behind the newest pair the pose goes on at the last speed for a
short, bounded time. Where the chain breaks (counters restarted, an input away for too long while
the robot turned), `breaks` grows: positions from before have no relation to those after.
Source: design, sections 4 and 5; the paper, section 4.5 (encoder displacement projected by yaw).
"""

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from core.attitude import AttitudeRing
from core.geometry import wrapped
from core.records import F64, WheelCounts

KEPT = 128  # poses: 4 s at 30 pairs per second
EXTRAPOLATED_S = 0.4  # longest going on at the last speed: one lost exchange at 9600 baud
WAITING = 64  # pairs that may wait for an attitude to cover them
GAP_S = 0.5  # an interval longer than this is checked for what it can hide
HIDDEN_M = 0.1  # position error that such an interval may hide
BLIND_M = 0.005  # travel without any heading that still counts as standing


@dataclass(frozen=True, slots=True)
class Pose:
    """The body in the map frame at one instant."""

    t_s: float
    x_m: float
    y_m: float
    yaw_rad: float
    pitch_rad: float
    roll_rad: float


class Odometry:
    """The path so far: positions (KEPT, 3) in the map frame at host times, oldest first."""

    def __init__(
        self,
        attitudes: AttitudeRing,
        wheel_radius_m: float,
        encoder_ppr: int,
        gear_ratio: float,
        track_width_m: float,
    ) -> None:
        self._attitudes = attitudes
        self._m_per_count = 2 * math.pi * wheel_radius_m / (4 * encoder_ppr * gear_ratio)
        self._track_width_m = track_width_m
        self._t_s = np.zeros(KEPT)
        self._xyz_m = np.zeros((KEPT, 3))
        self._travel_m = np.zeros(KEPT)
        self._used = 0
        self._waiting: deque[WheelCounts] = deque()
        self._last: WheelCounts | None = None
        self._yaw_last_rad = 0.0
        self.yaw_start_rad = 0.0  # of the body in the earth frame where the map's x axis points
        self.v_mps = 0.0
        self.w_radps = 0.0  # from the wheels
        self.breaks = 0

    @property
    def started(self) -> bool:
        """True once there is a position at all."""
        return self._used > 0

    @property
    def newest_s(self) -> float:
        """Time of the newest position that encoders vouch for; -inf when there is none."""
        return float(self._t_s[self._used - 1]) if self._used else float("-inf")

    def add(self, counts: WheelCounts) -> None:
        """Take one pair of counts; it counts once the attitude at its time is known."""
        newest = self._waiting[-1] if self._waiting else self._last
        if newest is not None and counts.t_s <= newest.t_s:
            return
        self._waiting.append(counts)
        if len(self._waiting) > WAITING:
            self._waiting.popleft()

    def settle(self) -> None:
        """Lay the intervals whose attitudes have arrived by now."""
        attitudes = self._attitudes
        while self._waiting and attitudes.count > 1 and attitudes.newest_s >= self._waiting[0].t_s:
            counts = self._waiting.popleft()
            if attitudes.spans(counts.t_s, counts.t_s):
                self._lay(counts)

    def _lay(self, counts: WheelCounts) -> None:
        _, _, yaw_rad = self._attitudes.rpy_at(counts.t_s)
        last = self._last
        if last is None:
            self.yaw_start_rad = yaw_rad
            self._append(counts.t_s, np.zeros(3), 0.0)
        elif counts.restarts != last.restarts:
            self._break(counts.t_s)
        else:
            self._travel(last, counts, wrapped(yaw_rad - self._yaw_last_rad))
        self._last, self._yaw_last_rad = counts, yaw_rad

    def _travel(self, last: WheelCounts, counts: WheelCounts, turned_rad: float) -> None:
        dt_s = counts.t_s - last.t_s
        left_m = (counts.left - last.left) * self._m_per_count
        right_m = (counts.right - last.right) * self._m_per_count
        travel_m = 0.5 * (left_m + right_m)
        middle_s = 0.5 * (last.t_s + counts.t_s)
        unseen_turn = dt_s > GAP_S and abs(travel_m * turned_rad) > HIDDEN_M
        blind = self._attitudes.gap_s_at(middle_s) > GAP_S and abs(travel_m) > BLIND_M
        if unseen_turn or blind:
            self._break(counts.t_s)
            return
        step_m = self._step(travel_m, middle_s)
        newest = self._used - 1
        self._append(
            counts.t_s, self._xyz_m[newest] + step_m, float(self._travel_m[newest]) + travel_m
        )
        self.v_mps = travel_m / dt_s
        self.w_radps = (right_m - left_m) / (self._track_width_m * dt_s)

    def _step(self, travel_m: float, at_s: float) -> F64:
        """A travel along the body's x axis at a spanned instant, as (3,) of the map frame."""
        _, pitch_rad, yaw_rad = self._attitudes.rpy_at(at_s)
        heading_rad = yaw_rad - self.yaw_start_rad
        level_m = travel_m * math.cos(pitch_rad)
        return np.array(
            [
                level_m * math.cos(heading_rad),
                level_m * math.sin(heading_rad),
                -travel_m * math.sin(pitch_rad),
            ]
        )

    def _break(self, t_s: float) -> None:
        """Go on from the same place, as an island of its own."""
        xyz_m, travel_m = self._xyz_m[self._used - 1].copy(), float(self._travel_m[self._used - 1])
        self._used = 0
        self._append(t_s, xyz_m, travel_m)
        self.v_mps = self.w_radps = 0.0
        self.breaks += 1

    def _append(self, t_s: float, xyz_m: F64, travel_m: float) -> None:
        if self._used == KEPT:
            for kept in (self._t_s, self._xyz_m, self._travel_m):
                kept[:-1] = kept[1:].copy()
            self._used -= 1
        self._t_s[self._used] = t_s
        self._xyz_m[self._used] = xyz_m
        self._travel_m[self._used] = travel_m
        self._used += 1

    def covers(self, from_s: float, to_s: float) -> bool:
        """True if the position is known, or well continued, from..to."""
        return (
            self._used > 0
            and bool(self._t_s[0] <= from_s)
            and to_s <= self.newest_s + EXTRAPOLATED_S
        )

    def xy_at(self, at_s: float) -> F64:
        """Position (2,) in the map frame at a covered instant."""
        return self.xyz_at(at_s)[:2]

    def xyz_at(self, at_s: float) -> F64:
        """Position (3,) in the map frame at a covered instant; z from travel and pitch alone."""
        times_s, xyz_m = self._t_s[: self._used], self._xyz_m[: self._used]
        ahead_s = at_s - float(times_s[-1])
        if ahead_s <= 0:
            return np.array([np.interp(at_s, times_s, xyz_m[:, n]) for n in range(3)])
        middle_s = min(float(times_s[-1]) + ahead_s / 2, self._attitudes.newest_s)
        return np.asarray(xyz_m[-1] + self._step(self.v_mps * ahead_s, middle_s))

    @property
    def travel_m(self) -> float:
        """Mean of both wheels' signed travel since the start, at the newest laid pair."""
        return float(self._travel_m[self._used - 1]) if self._used else 0.0

    def travel_at(self, at_s: float) -> float:
        """The same at a covered instant."""
        times_s = self._t_s[: self._used]
        ahead_s = at_s - float(times_s[-1])
        if ahead_s <= 0:
            return float(np.interp(at_s, times_s, self._travel_m[: self._used]))
        return self.travel_m + self.v_mps * ahead_s

    def maybe_pose(self, at_s: float) -> Pose | None:
        """The newest knowable pose: position at `at_s`, attitude the newest there is before it."""
        if not self._attitudes.count or not self.covers(at_s, at_s):
            return None
        x_m, y_m = (float(part) for part in self.xy_at(at_s))
        roll_rad, pitch_rad, yaw_rad = self._attitudes.newest_rpy()
        yaw_map_rad = wrapped(yaw_rad - self.yaw_start_rad)
        return Pose(at_s, x_m, y_m, yaw_map_rad, pitch_rad, roll_rad)
