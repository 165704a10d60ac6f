"""Pose at a time, or none: travel from the wheels' encoders, heading from the orientation's filter.

Each pair of counts closes an interval; its travel is laid along the heading in the middle of it,
made horizontal by the pitch there. Behind the newest pair the pose goes on at the last speed for a
short, bounded time. Where the chain breaks (counters restarted, an input away for too long while
the robot turned), `breaks` grows: positions from before have no relation to those after. Poses of
a positioning system correct the path, and replace the wheels while these do not tell.
Source: design, sections 4 and 5; the paper, section 4.5 (encoder displacement projected by yaw).
"""

import math
from collections import deque

import numpy as np
from msgspec.structs import replace as changed

from core.geometry import wrapped
from core.motion.attitude import AttitudeRing
from core.motion.blind import GAP_S, HIDDEN_M, BlindWay
from core.motion.error_state import H_YAW, SCALE, SIZE, YAW, X, Y, lay_step, travel
from core.motion.external_pose import JUMP_M, Positioning, is_sound
from core.motion.landmarks import Landmarks
from core.motion.path import Path, Place
from core.motion.shift import Gap, Shift, maybe_shift
from core.motion.slip import SIGMA_M
from core.motion.track import Pose
from core.motion.wheel_check import Turn, WheelCheck
from core.pose_fix import PoseFix
from core.records import F64, ExternalPose, WheelCounts
from core.run_settings import Robot

EXTRAPOLATED_S = 0.4  # longest going on at the last speed: one lost exchange at 9600 baud
WAITING = 256  # pairs that may wait for an attitude to cover them: 8 s at 30 pairs per second
POSES_WAITING = 16  # of a positioning system, likewise
COUNTS_LATE_S = 0.15  # a pose waits so long for counts around it
SILENT_S = 0.25  # a pose so long after the newest counts stands for itself
LEAST_S = 1e-3  # nearer neighbours in time are one and the same
STILL_COUNTS = 1.5  # less than this in an interval is no movement: a wheel may rest on an edge
MOST_COUNTS = 1e12  # beyond this no counter gets
ALONG_M, ACROSS_M = 0.01, 0.003  # error that a metre of travel adds, beside scale and heading
CORRECTION_MPS = 0.1  # position is corrected no faster, so that the map is not torn
RAIL_RAD, OFF_RAIL_RAD = math.radians(0.5), math.radians(5.0)  # 1 sigma in its guides; out of them
UNSEEN_MPS = 1.5  # how fast the body may move while only a positioning system tells


class Odometry:
    """The path of the body in the map frame, for as long as the attitudes last."""

    def __init__(
        self,
        attitudes: AttitudeRing,
        wheel_radius_m: float,
        encoder_ppr: int,
        gear_ratio: float,
        track_width_m: float,
        *,
        on_rail: bool = False,
        robot: Robot | None = None,
    ) -> None:
        """A new one.

        Args:
            on_rail: the left counter tells the way, along a straight line.
            robot: bounds how far it can have gone while nobody counted; None: no bound.
        """
        self._robot = robot
        self._on_rail, self._course_rad, self._is_off = on_rail, 0.0, False
        self._attitudes, self._state = attitudes, attitudes.orientation.state
        self._m_per_count = 2 * math.pi * wheel_radius_m / (4 * encoder_ppr * gear_ratio)
        self._track_width_m = track_width_m
        self._path = Path()
        self.wheels = WheelCheck(self._state, track_width_m, self._m_per_count)
        self.positioning, self._landmarks = Positioning(self._state), Landmarks(self._state)
        self._blind = BlindWay()
        self._waiting: deque[WheelCounts] = deque()
        self._poses: deque[ExternalPose] = deque()
        self._pose_s = -math.inf  # of the newest pose that came
        self._last: WheelCounts | None = None
        self._yaw_last_rad = 0.0
        self._replaced = False  # since the last counts, a positioning system told the place
        self._start_m, self._start_yaw_rad, self._start_travel_m = np.zeros(3), 0.0, 0.0
        self.yaw_start_rad = 0.0  # of the body in the earth frame where the map's x axis points
        self.v_mps = self.w_radps = 0.0  # both from the wheels
        self.breaks = 0
        self.broken_by = ""  # why it broke last, in words
        self.maybe_shift: Shift | None = None
        self.corrected_m: F64 = np.zeros(2)  # sum of the corrections that went into the place

    @property
    def started(self) -> bool:
        return len(self._path) > 0

    @property
    def newest_s(self) -> float:
        """Time of the newest position that is measured; -inf when there is none."""
        return self._path.newest_s

    @property
    def scale(self) -> float:
        """True travel over that of the wheels, as estimated; 1 without a positioning system."""
        return 1.0 + float(self._state.value[SCALE])

    @property
    def outliers(self) -> int:
        """External poses that did not fit."""
        return self.positioning.outliers

    @property
    def covariance(self) -> F64:
        """Of the newest x (m), y (m), yaw (rad) in the map frame: (3, 3), since the newest break.

        It is that of the estimate, which the told pose follows within its pace.
        """
        return self._state.P[:3, :3].copy()

    def start_at(self, xyz_m: F64, yaw_rad: float, travel_m: float) -> None:
        """Before anything has come: where (3,) the body stands in a map frame that goes on."""
        self._start_m, self._start_yaw_rad, self._start_travel_m = xyz_m.copy(), yaw_rad, travel_m

    def add(self, counts: WheelCounts) -> None:
        """Take one pair of counts; it counts once the attitude at its time is known."""
        if self._on_rail:
            counts = changed(counts, right=counts.left)
        newest = self._waiting[-1] if self._waiting else self._last
        if newest is not None and not counts.t_s >= newest.t_s + LEAST_S:
            return
        are_counts = abs(counts.left) <= MOST_COUNTS and abs(counts.right) <= MOST_COUNTS
        if not (math.isfinite(counts.t_s) and are_counts):
            return
        self._waiting.append(counts)
        if len(self._waiting) > WAITING:
            self._waiting.popleft()

    def add_external(self, pose: ExternalPose) -> bool:
        """Take a pose of a positioning system; False, and counted, if it can't be true or newer."""
        if not is_sound(pose) or pose.t_s < self._pose_s + LEAST_S:
            self.positioning.outliers += 1
            return False
        self._pose_s = pose.t_s
        self._poses.append(pose)
        if len(self._poses) > POSES_WAITING:
            self._poses.popleft()
        return True

    def correct_slip(self, along: tuple[float, float], slipped_m: float) -> None:
        """Take that the place has newly run slipped_m ahead along a direction (unit vector, map).

        That comes on top of all that was known to be wrong before. It goes into the place slowly,
        as all corrections do, and into the scale as far as the scale may be the cause.
        """
        h = np.zeros(SIZE)
        h[X], h[Y] = along
        travel(self._state.P, 0.0, 0.0, slipped_m**2, 0.0)  # the place is less sure by as much
        self._state.correct_some((X, Y, SCALE), h, -slipped_m, SIGMA_M**2)

    @property
    def owed(self) -> F64:
        """By what (3,) the told x, y (m) and yaw (rad) are still to be corrected, map frame."""
        return self._landmarks.owed

    def correct_by(self, fix: PoseFix, at_s: float) -> bool:
        """What stands says how far the told pose of an instant is off; whether it is believed."""
        return self._landmarks.take(fix, at_s)

    def break_off(self, why: str) -> None:
        """What was mapped up to now is not believed any more: go on from the same place."""
        if self.started:
            self._break(self.newest_s, why)

    @property
    def waits(self) -> bool:
        """Whether counts or poses wait for their attitudes."""
        return bool(self._waiting or self._poses)

    def settle(self) -> None:
        """Lay the intervals and use the poses whose attitudes have arrived by now."""
        attitudes = self._attitudes
        while self._waiting and attitudes.count > 1 and attitudes.newest_s >= self._waiting[0].t_s:
            counts = self._waiting.popleft()
            if attitudes.spans(counts.t_s, counts.t_s):
                self._lay(counts)
        while self._poses and attitudes.newest_s >= self._poses[0].t_s:
            pose = self._poses[0]
            late = self._replaced or attitudes.newest_s >= pose.t_s + COUNTS_LATE_S
            if self.newest_s < pose.t_s and not late:
                break
            self._poses.popleft()
            if attitudes.spans(pose.t_s, pose.t_s):
                self._use(pose)

    # From the wheels

    def _lay(self, counts: WheelCounts) -> None:
        _, _, yaw_rad = self._attitudes.rpy_at(counts.t_s)
        last = self._last
        if not self.started:
            self._begin(counts.t_s, yaw_rad)
        elif last is None or self._replaced:
            self._resume(counts.t_s)
        elif counts.restarts != last.restarts:
            shift = self._maybe_shift(last, counts)
            self._break(counts.t_s, "the wheels' counters began anew", shift)
        elif counts.t_s > self.newest_s:
            self._travel(last, counts, wrapped(yaw_rad - self._yaw_last_rad))
        self._last, self._yaw_last_rad, self._replaced = counts, yaw_rad, False

    def _begin(self, t_s: float, yaw_rad: float) -> None:
        """Here and now is the map's frame, or where `start_at` said."""
        self.yaw_start_rad, self._course_rad = wrapped(yaw_rad - self._start_yaw_rad), yaw_rad
        x_m, y_m, z_m = self._start_m.tolist()
        self._path.append(t_s, x_m, y_m, z_m, self._start_travel_m)
        self._state.begin_map()

    def _resume(self, t_s: float) -> None:
        """Counts again, after a positioning system told the place."""
        if t_s > self.newest_s + EXTRAPOLATED_S:
            self._break(t_s, "neither the wheels nor the positioning system told the place")
        elif t_s > self.newest_s:
            x_m, y_m, z_m, _ = self.place_at(t_s)
            self._path.append(t_s, x_m, y_m, z_m, self._path.travel_m)
        self.wheels.restart()

    def _travel(self, last: WheelCounts, counts: WheelCounts, turned_rad: float) -> None:
        dt_s = counts.t_s - last.t_s
        left_m = (counts.left - last.left) * self._m_per_count
        right_m = (counts.right - last.right) * self._m_per_count
        travel_m = 0.5 * (left_m + right_m)
        pitch_rad, middle_rad, gap_s, gyro_rad = self._attitudes.between(last.t_s, counts.t_s)
        wheels_rad = (right_m - left_m) / self._track_width_m
        hidden_m, sure = abs(travel_m * turned_rad), self._attitudes.orientation.trusted
        blind = self._blind.take(gap_s, travel_m, wheels_rad, turned_rad, sure=sure)
        if blind or (dt_s > GAP_S and hidden_m > HIDDEN_M):
            hidden = "the attitude" if blind else "the wheels' counters"
            self._break(counts.t_s, f"the robot moved while {hidden} stayed away")
            return
        moved = max(abs(counts.left - last.left), abs(counts.right - last.right)) > STILL_COUNTS
        self._attitudes.orientation.note_wheels(
            last.t_s, counts.t_s, wheels_rad, self.wheels.round_rad, moved=moved
        )
        if self.wheels.take(Turn(dt_s, travel_m, wheels_rad, gyro_rad)):
            self._break(counts.t_s, "the wheels turned and the gyro did not")
            return
        if self._on_rail and not self._holds_course(middle_rad, turned_rad):
            self._break(counts.t_s, "the robot has turned, which no straight rail lets it")
            return
        middle_rad += self._blind.off_rad
        dx_m, dy_m, dz_m = self._along(travel_m * self.scale, pitch_rad, middle_rad)
        unseen_m = max(hidden_m if dt_s > GAP_S else 0.0, self._blind.step_m)
        paid_x_m, paid_y_m = self._lay_down(dt_s, dx_m, dy_m, unseen_m)
        self.corrected_m += (paid_x_m, paid_y_m)
        x_m, y_m, z_m, driven_m = self._path.newest_m
        place_m = x_m + dx_m + paid_x_m, y_m + dy_m + paid_y_m, z_m + dz_m
        self._path.append(counts.t_s, *place_m, driven_m + travel_m)
        self.v_mps, self.w_radps = travel_m * self.scale / dt_s, wheels_rad / dt_s
        self._attitudes.orientation.note_speed(dt_s, self.v_mps, middle_rad)

    def _holds_course(self, yaw_rad: float, turned_rad: float) -> bool:
        """A rail is straight: the body points where it did as the map began, or turned last."""
        told_rad = yaw_rad + float(self._state.value[YAW])
        off_rad = wrapped(self._course_rad - told_rad)
        self._is_off = abs(off_rad) > OFF_RAIL_RAD or (self._is_off and abs(turned_rad) > RAIL_RAD)
        if self._is_off:
            self._course_rad = told_rad
            return False
        self._state.correct(H_YAW, off_rad, RAIL_RAD**2)
        return True

    def _lay_down(
        self, dt_s: float, dx_m: float, dy_m: float, unseen_m: float
    ) -> tuple[float, float]:
        """A step into the error state; how much of the pending correction is taken with it."""
        driven_m = math.hypot(dx_m, dy_m)
        slip_m = (
            0.5 * self._track_width_m * self.wheels.unexplained_rad if self.wheels.slipping else 0.0
        )
        return lay_step(
            self._state.P,
            self._state.value,
            (dx_m, dy_m),
            ALONG_M**2 * driven_m + slip_m**2 + unseen_m**2,
            ACROSS_M**2 * driven_m + unseen_m**2,
            CORRECTION_MPS * dt_s,
        )

    def _along(
        self, travel_m: float, pitch_rad: float, yaw_rad: float
    ) -> tuple[float, float, float]:
        """A travel along the body's x axis, which points there, as x, y, z of the map frame."""
        heading_rad = yaw_rad - self.yaw_start_rad
        level_m = travel_m * math.cos(pitch_rad)
        return (
            level_m * math.cos(heading_rad),
            level_m * math.sin(heading_rad),
            -travel_m * math.sin(pitch_rad),
        )

    def _maybe_shift(self, last: WheelCounts, counts: WheelCounts) -> Shift | None:
        """Where the body is, whose counters began anew between both; None: nobody knows."""
        # counters that jump, while no controller says why, may have been wrong before it, too
        if counts.restarts != last.restarts + 1 or self._robot is None:
            return None
        owed_m, slips = math.hypot(*self._state.value[[X, Y]].tolist()), self.wheels.slipping
        gap = Gap(last.t_s, counts.unpowered_s, counts.t_s, self.v_mps, slips, owed_m)
        return maybe_shift(gap, self._attitudes, self.yaw_start_rad, self._robot)

    def _break(self, t_s: float, why: str, shift: Shift | None = None) -> None:
        """Go on from the same place, or the middle of where it can be, as an island of its own."""
        (x_m, y_m, z_m, driven_m), (dx_m, dy_m) = self._path.newest_m, (0.0, 0.0)
        if shift is not None:
            dx_m, dy_m = shift.moved_m
        self._path.forget()
        self._path.append(t_s, x_m + dx_m, y_m + dy_m, z_m, driven_m)
        for row in (X, Y):
            self._state.forget(row, 0.0)
            self._state.value[row] = 0.0
        self.positioning.forget()
        self.wheels.restart()
        self._blind.restart()
        self.v_mps = self.w_radps = 0.0
        self.breaks, self.broken_by, self.maybe_shift = self.breaks + 1, why, shift

    # From a positioning system

    def _use(self, pose: ExternalPose) -> None:
        """A pose whose instant the attitudes span."""
        _, _, yaw_rad = self._attitudes.rpy_at(pose.t_s)
        if not self.started:
            self._begin(pose.t_s, yaw_rad)
        if pose.t_s < self._path.oldest_s:
            return
        yaw_rad += float(self._state.value[YAW]) - self.yaw_start_rad
        ahead_s = pose.t_s - self.newest_s
        silent = ahead_s > (LEAST_S if self._replaced else SILENT_S)
        if silent and self.positioning.aligned:
            self._replace(pose, yaw_rad)
        elif self.covers(pose.t_s, pose.t_s):
            here_m = self.xy_at(pose.t_s) + self._state.value[[X, Y]]
            if self.positioning.take(pose, here_m, yaw_rad):
                self._leap()

    def _replace(self, pose: ExternalPose, yaw_rad: float) -> None:
        """The wheels are silent: the place is where the positioning system says."""
        dt_s = pose.t_s - self.newest_s
        unseen_m, used = UNSEEN_MPS * dt_s, self.positioning.used
        before = np.array(self._path.newest_m[:3])
        travel(self._state.P, 0.0, 0.0, unseen_m**2, unseen_m**2)
        here_m = before[:2] + self._state.value[[X, Y]]
        leaps = self.positioning.take(pose, here_m, yaw_rad, JUMP_M + unseen_m)
        if self.positioning.used == used:
            return
        place = before + np.array([*self._state.value[[X, Y]], 0.0])
        self._state.value[[X, Y]] = 0.0
        ahead = np.array([math.cos(yaw_rad), math.sin(yaw_rad)])
        x_m, y_m, z_m = place.tolist()
        self._path.append(pose.t_s, x_m, y_m, z_m, self._path.travel_m)
        self.v_mps = float(ahead @ (place - before)[:2]) / dt_s
        self._replaced = True
        if leaps:
            self._leap()

    def _leap(self) -> None:
        """Take the whole correction at once: the map from before has its places elsewhere."""
        pending_m = self._state.value[[X, Y]]
        self._path.move(float(pending_m[0]), float(pending_m[1]))
        self._state.value[[X, Y]] = 0.0
        turn_rad = self._attitudes.orientation.pay_all()
        self._attitudes.turn_all(turn_rad)
        self._yaw_last_rad += turn_rad
        self.breaks, self.maybe_shift = self.breaks + 1, None
        self.broken_by = "the positioning system says that the robot is far from where it seemed"

    # What is known of an instant

    def covers(self, from_s: float, to_s: float) -> bool:
        """True if the position is known, or well continued, from..to."""
        known = self._path.oldest_s <= from_s and to_s <= self._path.newest_s + EXTRAPOLATED_S
        return known and not self._blind.is_open

    def xy_at(self, at_s: float) -> F64:
        """Position (2,) in the map frame at a covered instant."""
        return np.array(self.place_at(at_s)[:2])

    def place_at(self, at_s: float) -> Place:
        """Position (map frame; z from travel and pitch alone) and travel at a covered instant.

        Behind the newest place it goes on at the newest speed.
        """
        ahead_s = at_s - self._path.newest_s
        if ahead_s <= 0:
            return self._path.at(at_s)
        middle_s = min(self._path.newest_s + ahead_s / 2, self._attitudes.newest_s)
        _, pitch_rad, yaw_rad = self._attitudes.rpy_at(middle_s)
        gone_m = self.v_mps * ahead_s
        dx_m, dy_m, dz_m = self._along(gone_m, pitch_rad, yaw_rad)
        x_m, y_m, z_m, travel_m = self._path.newest_m
        return x_m + dx_m, y_m + dy_m, z_m + dz_m, travel_m + gone_m / self.scale

    @property
    def travel_m(self) -> float:
        """Mean of both wheels' signed travel since the start, at the newest laid pair."""
        return self._path.travel_m

    def maybe_pose(self, at_s: float) -> Pose | None:
        """The newest knowable pose: position at `at_s`, attitude the newest there is before it."""
        if self.wheels.ignored or not (self._attitudes.count and self.covers(at_s, at_s)):
            return None
        x_m, y_m, _, _ = self.place_at(at_s)
        roll_rad, pitch_rad, yaw_rad = self._attitudes.newest_rpy()
        yaw_map_rad = wrapped(yaw_rad - self.yaw_start_rad)
        return Pose(at_s, x_m, y_m, yaw_map_rad, pitch_rad, roll_rad)
