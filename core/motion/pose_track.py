"""Pose at a time, or none, of a body without wheels: all places are told by a positioning system.

The first pose that has a yaw says how that system's frame lies in the map. Later ones go into a
filter of position and velocity. Between two of them, and for a short, bounded time behind the
newest, the place goes on at that velocity, which turns with the body: for as long as the filter is
sure of the place, which it is not where the velocity is not known. Heading and tilt are the
orientation filter's, of which the poses correct the heading. A pose that does not fit is left out.
Where poses have stayed away for too long, or several in a row say that the body is elsewhere,
`breaks` grows.
Source: Kalman filter with white acceleration; Bar-Shalom, Li, Kirubarajan, 2001, section 6.2.2;
planner link, section 3 (EXTERNAL_POSE).
"""

import math
from collections import deque

import numpy as np

from core.geometry import wrapped
from core.motion.attitude import AttitudeRing
from core.motion.error_state import H_YAW, YAW
from core.motion.external_pose import (
    GATE,
    GATE_YAW,
    JUMP_M,
    JUMP_RAD,
    LEAST_VAR_M2,
    LEAST_VAR_RAD2,
    Doubt,
    Doubts,
    is_sound,
    rotation,
)
from core.motion.path import Path, Place
from core.motion.shift import Shift
from core.motion.track import Pose
from core.pose_fix import PoseFix
from core.records import F64, ExternalPose, WheelCounts

EXTRAPOLATED_S = 0.4  # longest going on behind the newest pose: as for wheels; at 5 Hz, 0.2 s late
LOST_S = 2.0  # so long without a pose that fits, and the map begins anew
WAITING = 16  # poses that wait for their attitude
REACH_M = 1e6  # a pose farther than that from the first can't be told in the planner's frames
LEAST_S = 1e-3  # nearer neighbours in time are one and the same
ACCEL_VAR = 0.1  # m2/s3: 0.3 m/s2 for a second, beside what a turn makes
ACCEL_VAR_Z = 0.002  # likewise up and down, beside what the tilt says: 0.05 m/s in a second
BOB_M = 0.05  # 1 sigma, by which a walking body goes up and down at each step
SPEED_MPS, SPEED_Z_MPS = 1.0, 0.1  # 1 sigma, where the velocity is not known yet
SURE_M, SURE_RAD = 0.15, math.radians(3.0)  # 1 sigma: a place less sure than that is not known
STEP_S = 0.02  # in which it is found out for how long it is
TILT_RAD = math.radians(5.0)  # roll and pitch of a pose may differ from ours by so much,
TILT_SIGMAS = 4.0  # beside so many standard deviations


class MotionFilter:
    """Position and velocity of a body, map frame: x, y, z; vx, vy, and how it rises beside that.

    It goes along its own plane, so that a ramp is known by the tilt before a height tells of it.
    """

    def __init__(self, place_m: F64, noise: F64) -> None:
        """At rest as far as is known; noise: covariance (3, 3) of the place."""
        self.state = np.concatenate([place_m, np.zeros(3)])  # (6,)
        speed_var = np.array([SPEED_MPS, SPEED_MPS, SPEED_Z_MPS]) ** 2
        self.P = np.zeros((6, 6))
        self.P[:3, :3], self.P[3:, 3:] = noise, np.diag(speed_var)

    def go_on(self, dt_s: float, turn_rad: float, slopes: tuple[float, float]) -> tuple[F64, F64]:
        """State and covariance a while later, in which the body has turned, and its way with it.

        slopes: of the body's x-y plane along map x and y, meanwhile.
        """
        F = np.eye(6)
        F[:2, 3:5], F[2, 5] = dt_s * rotation(0.5 * turn_rad), dt_s
        F[2, 3], F[2, 4] = dt_s * slopes[0], dt_s * slopes[1]
        F[3:5, 3:5] = rotation(turn_rad)
        q = np.diag([ACCEL_VAR, ACCEL_VAR, ACCEL_VAR_Z])
        P = F @ self.P @ F.T
        P[:3, :3] += dt_s**3 / 3 * q
        P[:3, 3:] += dt_s**2 / 2 * q
        P[3:, :3] += dt_s**2 / 2 * q
        P[3:, 3:] += dt_s * q
        return F @ self.state, P

    def sure_for_s(self, longest_s: float) -> float:
        """For how long it is sure of a place on the ground that goes on; -inf: not even now."""
        sure_s = -math.inf
        for k in range(round(longest_s / STEP_S) + 1):
            dt_s = k * STEP_S
            for x, v in ((0, 3), (1, 4)):
                var = self.P[x, x] + 2.0 * dt_s * self.P[x, v] + dt_s**2 * self.P[v, v]
                if not var + dt_s**3 / 3.0 * ACCEL_VAR <= SURE_M**2:
                    return sure_s
            sure_s = dt_s
        return longest_s

    def correct(self, expected: tuple[F64, F64], place_m: F64, noise: F64) -> None:
        """A place (n,): x, y, and z or not; noise (n, n); `expected`: what `go_on` says."""
        state, P = expected
        n = len(place_m)
        gain = np.linalg.solve(P[:n, :n] + noise, P[:n, :]).T
        self.state = state + gain @ (place_m - state[:n])
        left = np.eye(6)
        left[:, :n] -= gain
        self.P = left @ P @ left.T + gain @ noise @ gain.T


class PoseTrack:
    """The path of the body in the map frame, by the poses that somebody else tells."""

    def __init__(self, attitudes: AttitudeRing) -> None:
        self._attitudes, self._state = attitudes, attitudes.orientation.state
        self._path = Path()
        self._poses: deque[ExternalPose] = deque()
        self._pose_s = -math.inf  # of the newest pose that came
        self._doubts = Doubts()
        self._filter = MotionFilter(np.zeros(3), np.zeros((3, 3)))
        self._sure_for_s = -math.inf  # behind the newest place
        self._anchor_m, self._turn, self._turn_rad = np.zeros(3), np.eye(2), 0.0  # of its frame
        self._has_z = False  # the first pose told a height
        self._yaw_last_rad = 0.0
        self._start_m, self._start_yaw_rad, self._start_travel_m = np.zeros(3), 0.0, 0.0
        self.yaw_start_rad = 0.0
        self.v_mps = 0.0
        self.w_radps = 0.0
        self.breaks = 0
        self.broken_by = ""
        self.maybe_shift: Shift | None = None
        self.outliers = 0
        self.corrected_m: F64 = np.zeros(2)  # none: every place is measured

    @property
    def started(self) -> bool:
        return len(self._path) > 0

    @property
    def newest_s(self) -> float:
        """Time of the newest pose that was used; -inf when there is none."""
        return self._path.newest_s

    @property
    def covariance(self) -> F64:
        """Of the newest x (m), y (m), yaw (rad) in the map frame: (3, 3)."""
        spread = np.zeros((3, 3))
        spread[:2, :2] = self._filter.P[:2, :2]
        spread[2, 2] = self._state.P[YAW, YAW]
        return spread

    @property
    def travel_m(self) -> float:
        return self._path.travel_m

    @property
    def waits(self) -> bool:
        return bool(self._poses)

    def start_at(self, xyz_m: F64, yaw_rad: float, travel_m: float) -> None:
        """Before anything has come: where (3,) the body stands in a map frame that goes on."""
        self._start_m, self._start_yaw_rad, self._start_travel_m = xyz_m.copy(), yaw_rad, travel_m

    def add(self, counts: WheelCounts) -> None:
        """Counts tell nothing of a body that rolls on no wheels."""

    def correct_slip(self, along: tuple[float, float], slipped_m: float) -> None:
        """Nothing slips: the places are measured."""

    @property
    def owed(self) -> F64:
        """Of the yaw (3,): the places are as they were measured."""
        return np.array([0.0, 0.0, float(self._state.value[YAW])])

    def correct_by(self, fix: PoseFix, at_s: float) -> bool:
        """No: the places are measured, by something that knows more than a map made by them."""
        return False

    def break_off(self, why: str) -> None:
        """What was mapped up to now is not believed any more: go on from the same place."""
        if self.started:
            newest_s, newest_m = self._path.newest_s, self._path.newest_m
            self._path.forget()
            self._path.append(newest_s, *newest_m)
            self.breaks, self.broken_by = self.breaks + 1, why

    def add_external(self, pose: ExternalPose) -> bool:
        """Take a pose; False, and counted, if it can't be true, or is no newer one."""
        if not is_sound(pose) or pose.t_s < self._pose_s + LEAST_S:
            self.outliers += 1
            return False
        self._pose_s = pose.t_s
        self._poses.append(pose)
        if len(self._poses) > WAITING:
            self._poses.popleft()
        return True

    def settle(self) -> None:
        """Use the poses whose attitudes have arrived by now."""
        while self._poses and self._attitudes.newest_s >= self._poses[0].t_s:
            pose = self._poses.popleft()
            if self._attitudes.spans(pose.t_s, pose.t_s):
                self._use(pose)

    # From a positioning system

    def _use(self, pose: ExternalPose) -> None:
        """A pose whose instant the attitudes span."""
        roll_rad, pitch_rad, yaw_rad = self._attitudes.rpy_at(pose.t_s)
        if not _leans_alike(pose, roll_rad, pitch_rad):
            self.outliers += 1
        elif not self.started:
            self._begin(pose, yaw_rad)
        elif (self._has_z and math.isnan(pose.z_m)) or not self._is_in_reach(pose):
            self.outliers += 1
        else:
            self._compare(pose, (roll_rad, pitch_rad, wrapped(yaw_rad - self.yaw_start_rad)))

    def _begin(self, pose: ExternalPose, yaw_rad: float) -> None:
        """Here and now is the map's frame, or where `start_at` said."""
        if math.isnan(pose.yaw_rad):
            self.outliers += 1
            return
        self._has_z = not math.isnan(pose.z_m)
        self._anchor_m = np.array([pose.x_m, pose.y_m, pose.z_m if self._has_z else 0.0])
        self._turn_rad = self._start_yaw_rad - pose.yaw_rad
        self._turn = rotation(self._turn_rad)
        self.yaw_start_rad = wrapped(yaw_rad - self._start_yaw_rad)
        self._state.begin_map()
        self._state.turn_map(pose.var_yaw_rad2 + LEAST_VAR_RAD2)
        self._state.value[YAW], self._yaw_last_rad = 0.0, self._start_yaw_rad
        self._restart(pose.t_s, *self._measured(pose), self._start_travel_m)

    def _is_in_reach(self, pose: ExternalPose) -> bool:
        off_m = np.array([pose.x_m, pose.y_m, pose.z_m]) - self._anchor_m
        return bool(np.abs(off_m[: 3 if self._has_z else 2]).max() <= REACH_M)

    def _measured(self, pose: ExternalPose) -> tuple[F64, F64]:
        """Its place (3,) in the map frame with its covariance (3, 3); z is 0 without a height."""
        z_m = pose.z_m - self._anchor_m[2] if self._has_z else 0.0
        xy_m = self._turn @ (np.array([pose.x_m, pose.y_m]) - self._anchor_m[:2])
        cov = np.array([[pose.var_xx_m2, pose.var_xy_m2], [pose.var_xy_m2, pose.var_yy_m2]])
        noise = LEAST_VAR_M2 * np.eye(3)
        noise[:2, :2] += self._turn @ cov @ self._turn.T
        noise[2, 2] += pose.var_z_m2 if self._has_z else 0.0
        return np.array([*xy_m, z_m]) + self._start_m, noise

    def _restart(self, t_s: float, place_m: F64, noise: F64, travel_m: float) -> None:
        """From this place on: nothing is known of the way to it."""
        self._filter = MotionFilter(place_m, noise)
        self._sure_for_s = self._filter.sure_for_s(EXTRAPOLATED_S)
        self._doubts.clear()
        self._path.forget()
        x_m, y_m, z_m = place_m.tolist()
        self._path.append(t_s, x_m, y_m, z_m, travel_m)
        self.v_mps = self.w_radps = 0.0

    def _compare(self, pose: ExternalPose, rpy_rad: tuple[float, float, float]) -> None:
        """Take it if it fits; if it is the last of several that say the same, begin anew there."""
        dt_s = pose.t_s - self.newest_s
        place_m, noise = self._measured(pose)
        off_rad = 0.0
        if not math.isnan(pose.yaw_rad):
            told_rad = rpy_rad[2] + float(self._state.value[YAW])
            off_rad = wrapped(pose.yaw_rad + self._turn_rad - told_rad)
        turn_rad = wrapped(rpy_rad[2] - self._yaw_last_rad)
        expected = self._filter.go_on(dt_s, turn_rad, _slopes(rpy_rad))
        off_m = place_m - expected[0][:3]
        if dt_s > LOST_S:
            self._break(pose, off_rad, "the positioning system did not tell the place for too long")
        elif not self._fits(off_m, expected[1][:3, :3] + noise, off_rad, pose.var_yaw_rad2):
            doubt = Doubt(pose.t_s, float(off_m[0]), float(off_m[1]), off_rad)
            if not self._doubts.persist(doubt):
                self.outliers += 1
                return
            self._break(pose, off_rad, "the positioning system says that the robot is elsewhere")
        else:
            self._doubts.clear()
            self._lay(pose.t_s, expected, place_m, noise, rpy_rad)
            self._correct_yaw(pose, off_rad)
        yaw_rad = self._attitudes.rpy_at(pose.t_s)[2]  # which a break has turned
        self._yaw_last_rad = wrapped(yaw_rad - self.yaw_start_rad)

    def _fits(self, off_m: F64, spread: F64, off_rad: float, yaw_var: float) -> bool:
        dx_m, dy_m, dz_m = off_m.tolist()
        near = math.hypot(dx_m, dy_m) <= JUMP_M and abs(off_rad) <= JUMP_RAD
        xy = float(off_m[:2] @ np.linalg.solve(spread[:2, :2], off_m[:2])) <= GATE
        yaw_spread = self._state.P[YAW, YAW] + yaw_var + LEAST_VAR_RAD2
        alike = near and xy and off_rad**2 <= GATE_YAW * yaw_spread
        if not self._has_z:
            return bool(alike)
        return bool(
            alike and abs(dz_m) <= JUMP_M and dz_m**2 <= GATE_YAW * (spread[2, 2] + BOB_M**2)
        )

    def _correct_yaw(self, pose: ExternalPose, off_rad: float) -> None:
        if not math.isnan(pose.yaw_rad):
            self._state.correct(H_YAW, off_rad, pose.var_yaw_rad2 + LEAST_VAR_RAD2)

    def _with_height(self, place_m: F64, noise: F64) -> tuple[F64, F64]:
        """The place as measured, at the height of before where none was."""
        if not self._has_z:
            place_m[2] = self._path.newest_m[2]
        return place_m, noise

    def _lay(
        self,
        t_s: float,
        expected: tuple[F64, F64],
        place_m: F64,
        noise: F64,
        rpy_rad: tuple[float, float, float],
    ) -> None:
        """A pose that fits into filter and path."""
        n, dt_s = 3 if self._has_z else 2, t_s - self.newest_s
        self._filter.correct(expected, place_m[:n], noise[:n, :n])
        self._sure_for_s = self._filter.sure_for_s(EXTRAPOLATED_S)
        state, yaw_rad = self._filter.state, rpy_rad[2]
        x_m, y_m, _, travel_m = self._path.newest_m
        dx_m, dy_m = float(state[0]) - x_m, float(state[1]) - y_m
        cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
        travel_m += cos * dx_m + sin * dy_m
        if dt_s > EXTRAPOLATED_S:  # where it was meanwhile, nobody knows
            self._path.forget()
        self._path.append(t_s, float(state[0]), float(state[1]), float(state[2]), travel_m)
        self.v_mps = cos * float(state[3]) + sin * float(state[4])
        self.w_radps = wrapped(yaw_rad - self._yaw_last_rad) / dt_s

    def _break(self, pose: ExternalPose, off_rad: float, why: str) -> None:
        """Begin anew at a pose: what was mapped before has its place elsewhere, or nobody knows."""
        travel_m = self.travel_m
        self._restart(pose.t_s, *self._with_height(*self._measured(pose)), travel_m)
        self._state.P[YAW, YAW] += off_rad**2
        self._correct_yaw(pose, off_rad)
        self._attitudes.turn_all(self._attitudes.orientation.pay_all())
        self.breaks, self.broken_by = self.breaks + 1, why

    # What is known of an instant

    def covers(self, from_s: float, to_s: float) -> bool:
        """True if the position is known, or well continued, from..to."""
        is_told = self._path.oldest_s <= from_s and to_s <= self._path.newest_s + self._sure_for_s
        return bool(is_told and self._state.P[YAW, YAW] <= SURE_RAD**2)

    def xy_at(self, at_s: float) -> F64:
        """Position (2,) in the map frame at a covered instant."""
        return np.array(self.place_at(at_s)[:2])

    def place_at(self, at_s: float) -> Place:
        """Position (map frame) and travel at a covered instant."""
        ahead_s = at_s - self._path.newest_s
        if ahead_s <= 0:
            return self._path.at(at_s)
        x_m, y_m, z_m, travel_m = self._path.newest_m
        vx_mps, vy_mps, vz_mps = self._filter.state[3:].tolist()
        middle_s = min(self._path.newest_s + ahead_s / 2, self._attitudes.newest_s)
        roll_rad, pitch_rad, yaw_rad = self._attitudes.rpy_at(middle_s)
        yaw_rad -= self.yaw_start_rad
        turn_rad = yaw_rad - self._yaw_last_rad
        cos, sin = math.cos(turn_rad), math.sin(turn_rad)
        vx_mps, vy_mps = cos * vx_mps - sin * vy_mps, sin * vx_mps + cos * vy_mps
        slope_x, slope_y = _slopes((roll_rad, pitch_rad, yaw_rad))
        return (
            x_m + vx_mps * ahead_s,
            y_m + vy_mps * ahead_s,
            z_m + (vz_mps + slope_x * vx_mps + slope_y * vy_mps) * ahead_s,
            travel_m + self.v_mps * ahead_s,
        )

    def maybe_pose(self, at_s: float) -> Pose | None:
        """Position at `at_s`, attitude the newest there is before it; None where not known."""
        if not self._attitudes.count or not self.covers(at_s, at_s):
            return None
        x_m, y_m, _, _ = self.place_at(at_s)
        roll_rad, pitch_rad, yaw_rad = self._attitudes.newest_rpy()
        return Pose(at_s, x_m, y_m, wrapped(yaw_rad - self.yaw_start_rad), pitch_rad, roll_rad)


def _leans_alike(pose: ExternalPose, roll_rad: float, pitch_rad: float) -> bool:
    """Whether a pose that tells roll and pitch has those of the attitude sensor."""
    if math.isnan(pose.roll_rad):
        return True
    off_rad = math.hypot(wrapped(pose.roll_rad - roll_rad), wrapped(pose.pitch_rad - pitch_rad))
    return off_rad <= TILT_RAD + TILT_SIGMAS * pose.sigma_tilt_rad


def _slopes(rpy_rad: tuple[float, float, float]) -> tuple[float, float]:
    """Of the body's x-y plane along map x and y; none where it stands on its side."""
    roll, pitch, yaw = rpy_rad
    cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    if cp * cr < 0.5:
        return 0.0, 0.0
    return -(cy * sp * cr + sy * sr) / (cp * cr), -(sy * sp * cr - cy * sr) / (cp * cr)
