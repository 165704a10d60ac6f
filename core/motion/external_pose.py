"""A positioning system's poses: where its frame lies in the map, and what they correct.

The first pose, if it has a yaw, says how that system's frame lies in the map; without a yaw it
takes two, some way apart. Later ones correct position, heading and the wheels' scale. A pose that
does not fit is left out and counted; where several in a row say the same, they are believed.
Source: core.motion.error_state; each pose is anchored at the first, so its frame may lie far away.
"""

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from core.geometry import wrapped
from core.motion.error_state import ALIGN_X, ALIGN_Y, ALIGN_YAW, SIZE, YAW, ErrorState, X, Y
from core.records import F64, ExternalPose

APART_M = 1.0  # between two poses without a yaw that fix the alignment
GATE = 13.8  # squared Mahalanobis distance of two coordinates: 1 in 1000 is beyond
GATE_YAW = 10.8  # and of one
JUMP_M, JUMP_RAD = 0.5, math.radians(5.0)  # more needs several poses that say so
PERSIST, PERSIST_S = 5, 0.5  # so many in a row, over so long
KEPT = 256  # doubts: half a second, however fast they come
LEAST_VAR_M2, LEAST_VAR_RAD2 = 1e-6, 1e-6  # nothing is surer than a millimetre, or than 0.06 deg
ROUNDING = 1e-9  # of a covariance that is on its bound
MOST_M, MOST_VAR_M2, MOST_VAR_RAD2 = 1e8, 1e6, math.pi**2


def is_sound(pose: ExternalPose) -> bool:
    """Whether its numbers can be true: finite, within bounds, a covariance that is one."""
    numbers = (pose.t_s, pose.x_m, pose.y_m, pose.var_xx_m2, pose.var_xy_m2, pose.var_yy_m2)
    if not all(map(math.isfinite, numbers)) or max(abs(pose.x_m), abs(pose.y_m)) > MOST_M:
        return False
    least, most = min(pose.var_xx_m2, pose.var_yy_m2), max(pose.var_xx_m2, pose.var_yy_m2)
    if not (least >= 0.0 and most <= MOST_VAR_M2 and abs(pose.var_xy_m2) <= MOST_VAR_M2):
        return False
    if pose.var_xy_m2**2 > pose.var_xx_m2 * pose.var_yy_m2 * (1 + ROUNDING):
        return False
    if not (math.isnan(pose.z_m) or _is_height(pose)):
        return False
    if not (math.isnan(pose.roll_rad) or _is_tilt(pose)):
        return False
    if math.isnan(pose.yaw_rad):
        return True
    return math.isfinite(pose.yaw_rad) and 0.0 <= pose.var_yaw_rad2 <= MOST_VAR_RAD2


def _is_height(pose: ExternalPose) -> bool:
    return abs(pose.z_m) <= MOST_M and 0.0 <= pose.var_z_m2 <= MOST_VAR_M2


def _is_tilt(pose: ExternalPose) -> bool:
    tilts = abs(pose.roll_rad) <= math.pi and abs(pose.pitch_rad) <= math.pi
    return tilts and 0.0 <= pose.sigma_tilt_rad <= math.pi


@dataclass(frozen=True, slots=True)
class Doubt:
    """A pose that does not fit: by how much, in the map frame."""

    t_s: float
    dx_m: float
    dy_m: float
    dyaw_rad: float  # 0 without a yaw


class Doubts:
    """Poses that do not fit, one after the other, for as long as they say the same."""

    def __init__(self) -> None:
        self._known: deque[Doubt] = deque(maxlen=KEPT)

    def clear(self) -> None:
        self._known.clear()

    def persist(self, doubt: Doubt) -> bool:
        """Keep one more; whether enough in a row have said the same."""
        for known in self._known:
            apart_m = math.hypot(doubt.dx_m - known.dx_m, doubt.dy_m - known.dy_m)
            if apart_m > JUMP_M or abs(wrapped(doubt.dyaw_rad - known.dyaw_rad)) > JUMP_RAD:
                self._known.clear()
                break
        self._known.append(doubt)
        return len(self._known) >= PERSIST and doubt.t_s - self._known[0].t_s >= PERSIST_S


def rotation(yaw_rad: float) -> F64:
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    return np.array([[c, -s], [s, c]])


class Positioning:
    """The alignment of a positioning system's frame, and the corrections by its poses."""

    def __init__(self, state: ErrorState) -> None:
        self._state = state
        self.aligned = False
        self.used = self.outliers = 0
        self._anchor_m = np.zeros(2)  # in its frame: where the alignment was made
        self._first: tuple[F64, F64, F64] | None = None  # its place, ours, its covariance
        self._doubts = Doubts()

    def forget(self) -> None:
        """Our own chain broke: its frame lies anywhere in the map that begins now."""
        self.aligned, self._first = False, None
        self._doubts.clear()
        for row in (ALIGN_X, ALIGN_Y, ALIGN_YAW):
            self._state.forget(row, 0.0)

    def take(
        self, pose: ExternalPose, xy_m: F64, yaw_map_rad: float, jump_m: float = JUMP_M
    ) -> bool:
        """Use a sound pose; True if it leapt: what came before has no place in the map any more.

        Args:
            xy_m: (2,) our estimate for its instant, map frame, with `yaw_map_rad`.
            jump_m: a correction beyond this is doubted at first.
        """
        z_m = np.array([pose.x_m, pose.y_m])
        cov = np.array([[pose.var_xx_m2, pose.var_xy_m2], [pose.var_xy_m2, pose.var_yy_m2]])
        cov += LEAST_VAR_M2 * np.eye(2)
        if not self.aligned:
            self._align(pose, z_m, cov, xy_m, yaw_map_rad)
            return False
        return self._compare(pose, z_m, cov, xy_m, yaw_map_rad, jump_m)

    def _align(self, pose: ExternalPose, z_m: F64, cov: F64, xy_m: F64, yaw_map_rad: float) -> None:
        if not math.isnan(pose.yaw_rad):
            yaw_rad, yaw_var = yaw_map_rad - pose.yaw_rad, pose.var_yaw_rad2 + LEAST_VAR_RAD2
        elif self._first is None:
            self._first = z_m, xy_m.copy(), cov
            return
        else:
            first_z_m, first_xy_m, first_cov = self._first
            theirs, ours = z_m - first_z_m, xy_m - first_xy_m
            apart_m = min(float(np.hypot(*theirs)), float(np.hypot(*ours)))
            noise_var = float(np.trace(cov + first_cov))
            if apart_m < max(APART_M, 5 * math.sqrt(noise_var)):
                return
            yaw_rad = math.atan2(ours[1], ours[0]) - math.atan2(theirs[1], theirs[0])
            yaw_var = noise_var / apart_m**2
        state, turn = self._state, rotation(yaw_rad)
        state.value[[ALIGN_X, ALIGN_Y, ALIGN_YAW]] = xy_m[0], xy_m[1], wrapped(yaw_rad)
        self._anchor_m = z_m
        noise = turn @ cov @ turn.T
        state.define(ALIGN_X, X, 1.0, float(noise[0, 0]))
        state.define(ALIGN_Y, Y, 1.0, float(noise[1, 1]))
        state.P[ALIGN_X, ALIGN_Y] += noise[0, 1]
        state.P[ALIGN_Y, ALIGN_X] += noise[0, 1]
        state.define(ALIGN_YAW, YAW, 1.0, yaw_var)
        self.aligned, self._first = True, None

    def _compare(
        self,
        pose: ExternalPose,
        z_m: F64,
        cov: F64,
        xy_m: F64,
        yaw_map_rad: float,
        jump_m: float,
    ) -> bool:
        value = self._state.value
        turn = rotation(float(value[ALIGN_YAW]))
        reach_m = turn @ (z_m - self._anchor_m)
        off_m = reach_m + value[[ALIGN_X, ALIGN_Y]] - xy_m
        H = np.zeros((2, SIZE))
        H[0, X], H[0, ALIGN_X], H[0, ALIGN_YAW] = 1.0, -1.0, reach_m[1]
        H[1, Y], H[1, ALIGN_Y], H[1, ALIGN_YAW] = 1.0, -1.0, -reach_m[0]
        h_yaw = np.zeros(SIZE)
        h_yaw[YAW], h_yaw[ALIGN_YAW] = 1.0, -1.0
        has_yaw, off_rad = not math.isnan(pose.yaw_rad), 0.0
        if has_yaw:
            off_rad = wrapped(pose.yaw_rad + float(value[ALIGN_YAW]) - yaw_map_rad)
        noise, yaw_var = turn @ cov @ turn.T, pose.var_yaw_rad2 + LEAST_VAR_RAD2
        fits = self._fits(H, noise, off_m, jump_m) and (
            not has_yaw or self._fits_yaw(h_yaw, yaw_var, off_rad)
        )
        leaps = False
        if not fits:
            doubt = Doubt(pose.t_s, float(off_m[0]), float(off_m[1]), off_rad)
            if not self._doubts.persist(doubt):
                self.outliers += 1
                return False
            leaps = self._make_room(doubt)
        self._doubts.clear()
        before = value.copy()
        self._correct(H, noise, off_m)
        if has_yaw:
            self._state.correct(h_yaw, off_rad - float(h_yaw @ (value - before)), yaw_var)
        self.used += 1
        return leaps

    def _fits(self, H: F64, noise: F64, off_m: F64, jump_m: float) -> bool:
        spread = H @ self._state.P @ H.T + noise
        near = float(np.hypot(*off_m)) <= jump_m
        return near and float(off_m @ np.linalg.solve(spread, off_m)) <= GATE

    def _fits_yaw(self, h: F64, variance: float, off_rad: float) -> bool:
        spread = self._state.spread(h) + variance
        return abs(off_rad) <= JUMP_RAD and off_rad**2 <= GATE_YAW * spread

    def _make_room(self, doubt: Doubt) -> bool:
        """Let the state be as unsure as it was wrong; True if the map can't stand that."""
        P = self._state.P
        P[X, X] += doubt.dx_m**2
        P[Y, Y] += doubt.dy_m**2
        P[YAW, YAW] += doubt.dyaw_rad**2
        return math.hypot(doubt.dx_m, doubt.dy_m) > JUMP_M or abs(doubt.dyaw_rad) > JUMP_RAD

    def _correct(self, H: F64, noise: F64, off_m: F64) -> None:
        """Both coordinates, one after the other, along axes on which their noises are apart."""
        variances, axes = np.linalg.eigh(noise)
        value = self._state.value
        for k in range(2):
            h, before = axes[:, k] @ H, value.copy()
            self._state.correct(
                h, float(axes[:, k] @ off_m), max(LEAST_VAR_M2, float(variances[k]))
            )
            off_m = off_m - H @ (value - before)
