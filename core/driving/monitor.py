"""The monitor: a second look at the inputs, behind all that works out the robot's motion.

It can only turn wheel power into zero. It takes the records themselves, the request, the pose and
the obstacle window, and shares nothing with the pilot but these: no state, no health word, no stop
zone. Its limits are a little wider than the pilot's, so that a pilot in order never meets them.
Once it has halted the robot, it does so until the commander lets go.

What it leaves to others: clocks, the emergency stop, what the scanner says of its sight, and cells
that lie under the footprint already.
Source: design, section 8; docs/safety.md, "Who watches whom".
"""

import math
from typing import NamedTuple

from core.config import Config
from core.driving.stall import STALLED, StallWatch
from core.geometry import R_from_rpy
from core.grid.window import ObstacleWindow
from core.motion.track import Pose
from core.records import FREE, I8, OBSTACLE, UNKNOWN, Attitude, DriveRequest, WheelCounts
from jit import kernel

Powers = tuple[float, float]  # left and right wheel, -1..1 of full
Motion = tuple[float, float]  # forward m/s, counter-clockwise rad/s
Place = tuple[float, float, float]  # x, y, yaw in the map frame
Rect = tuple[float, float, float]  # ahead of the axle, behind it, to either side; metres

SCANS_STALE_S, STALE_PERIODS = 0.2, 4  # age of scans: the longer of both
ATTITUDE_STALE_S = 0.2
COUNTS_STALE_S = 0.45
SPEED_STALE_S = 0.6  # age of the speed by counts: after their zero was lost it takes two more
EARLY_S = 0.1  # a record from so far ahead of now has a wrong time
LATE_S = 0.15  # longer than this nobody asked it: something else may have moved the robot
LONGEST_S = 1.0  # no request holds longer
MOST_TILT_RAD = 0.5  # of the body's z axis: roll and pitch of 0.35 each
FASTEST_SHARE = 1.5  # of max_speed_mps, as measured
STOPPING_S = 0.3  # until wheels have no power: a late tick, an exchange with the controller
MET_M = 0.03  # a cell counts that is so deep in the footprint: the pilot lets none get 0.02 deep
SPAN_S = 0.04  # between the counts of which it takes a speed
STEP_S = 0.05  # that a late tick counts for at most, as in the ramps
UNIT = 0.01  # how far the square of an attitude's length may be from 1
SAME = 1e-6  # m/s, rad/s, s: rounding

NO_SCANS = "no new scan has come"
NOT_MAPPED = "no new scan is in the map"
NO_ATTITUDE = "no new attitude has come"
NO_COUNTS = "no new counts have come"
NO_SPEED = "how fast the wheels turn is not known"
NO_POSE = "the pose is not known"
NO_POWER = "that is no power of a wheel"
NOT_ASKED = "nobody asks for it"
TOO_LONG = "the request holds longer than any may"
UNLIKE = "that is faster than anybody asks for"
TOO_FAST = "the robot is faster than it may be told"
LEANS = "the robot leans too far"
WAS_AWAY = "it was not asked for too long"
IN_WAY = {
    OBSTACLE: "an obstacle is within the way to a stop",
    UNKNOWN: "unseen ground is within the way to a stop",
}


class Seen(NamedTuple):
    """What there is at one instant, beside the records."""

    request: DriveRequest | None
    pose: Pose | None
    window: ObstacleWindow
    mapped_s: float  # last beam of the newest scan in the window
    # the map may be so far off from where the run began, for whose ground the settings vouch
    off_start_m: float


@kernel
def _overlaps(cx: float, cy: float, half: float, place: Place, rect: Rect) -> bool:
    """Whether the footprint at a place has part of a square cell about (cx, cy) in it."""
    c, s = math.cos(place[2]), math.sin(place[2])
    middle, length = (rect[0] - rect[1]) / 2, (rect[0] + rect[1]) / 2
    dx, dy = cx - place[0] - c * middle, cy - place[1] - s * middle
    reach, side = half * (abs(c) + abs(s)), rect[2]
    return (
        abs(c * dx + s * dy) < length + reach
        and abs(c * dy - s * dx) < side + reach
        and abs(dx) < half + length * abs(c) + side * abs(s)
        and abs(dy) < half + length * abs(s) + side * abs(c)
    )


@kernel
def _moved(place: Place, motion: Motion, t_s: float) -> Place:
    """Where a motion has led after t_s, by the chord of its arc."""
    turn = motion[1] * t_s
    half = turn / 2
    chord = motion[0] * t_s * (math.sin(half) / half if abs(half) > SAME else 1.0)
    x, y, yaw = place
    return x + chord * math.cos(yaw + half), y + chord * math.sin(yaw + half), yaw + turn


@kernel
def _meets(
    cells: I8,
    corner: tuple[int, int],
    cell_m: float,
    place: Place,
    rect: Rect,
    motion: Motion,
    seconds: float,
    vouched_m: float,
) -> int:
    """State of a cell that is not free and comes under the footprint within so long; or FREE.

    UNKNOWN ones count from a way vouched_m on from where the map began, and if no part of them is
    under the footprint now: for the pilot such a one bars no way.
    """
    size, half = cells.shape[0], cell_m / 2
    reach = math.hypot(max(rect[0], rect[1]), rect[2])
    inner = rect[0] - MET_M, rect[1] - MET_M, rect[2] - MET_M
    way = seconds * (abs(motion[0]) + abs(motion[1]) * reach)
    steps = math.ceil(way / half)
    for n in range(steps):
        at = _moved(place, motion, seconds * (n + 1) / steps)
        low_i, high_i = math.floor((at[0] - reach) / cell_m), math.floor((at[0] + reach) / cell_m)
        low_j, high_j = math.floor((at[1] - reach) / cell_m), math.floor((at[1] + reach) / cell_m)
        for j in range(low_j, high_j + 1):
            for i in range(low_i, high_i + 1):
                cx, cy, state = (i + 0.5) * cell_m, (j + 0.5) * cell_m, UNKNOWN
                if 0 <= i - corner[0] < size and 0 <= j - corner[1] < size:
                    state = int(cells[j % size, i % size])
                if state == FREE or not _overlaps(cx, cy, half, at, inner):
                    continue
                if state == UNKNOWN and math.hypot(cx, cy) <= vouched_m:
                    continue
                begun = inner if state == OBSTACLE else rect
                if not _overlaps(cx, cy, half, place, begun):
                    return state
    return FREE


class _Wheels:
    """How fast the robot goes, by the wheels' counters alone."""

    def __init__(self, config: Config) -> None:
        robot = config.robot
        counts_per_turn = 4 * robot.encoder_ppr * robot.gear_ratio
        self._m_per_count = 2 * math.pi * robot.wheel_radius_m / counts_per_turn
        self._track_m = robot.track_width_m
        self._base: WheelCounts | None = None
        self.newest_s = self.measured_s = -math.inf
        self.motion: Motion = (0.0, 0.0)  # as of `measured_s`

    def counted(self, counts: WheelCounts) -> None:
        self.newest_s = max(self.newest_s, counts.t_s)
        base = self._base
        if base is None or counts.restarts != base.restarts:
            self._base = counts
            return
        passed_s = counts.t_s - base.t_s
        if passed_s >= SPAN_S:
            left = (counts.left - base.left) * self._m_per_count / passed_s
            right = (counts.right - base.right) * self._m_per_count / passed_s
            self.motion = (left + right) / 2, (right - left) / self._track_m
            self._base, self.measured_s = counts, counts.t_s


class _Asked:
    """The fastest, either way, that requests allow for now: what slows down may take its time."""

    def __init__(self, slower_per_s2: float) -> None:
        self._slower = slower_per_s2
        self.low = self.high = 0.0

    def step(self, asked: float, passed_s: float) -> None:
        slower = self._slower * passed_s
        self.high = max(0.0, asked, self.high - slower)
        self.low = min(0.0, asked, self.low + slower)

    def allows(self, value: float, most: float) -> bool:
        """Whether a speed is within that, and within a limit of either sense."""
        low, high = max(self.low, -most) - SAME, min(self.high, most) + SAME
        return low <= value <= high


class Monitor:
    """Halts one robot where its inputs, as they came, do not allow the power that is to go out."""

    def __init__(self, config: Config) -> None:
        robot = config.robot
        self._robot, self._full_mps = robot, config.drive.full_power_mps
        self._rect: Rect = (robot.front_m, robot.rear_m, robot.width_m / 2)
        self._reach_m = math.hypot(max(robot.front_m, robot.rear_m), robot.width_m / 2)
        period_s = config.scanner.options.spec.period_s
        self._scans_stale_s = max(SCANS_STALE_S, STALE_PERIODS * period_s)
        mount = config.ahrs.mount_roll_deg, config.ahrs.mount_pitch_deg, config.ahrs.mount_yaw_deg
        self._up_sensor = R_from_rpy(*map(math.radians, mount))[2].tolist()  # body's z axis
        self._wheels, self._stall = _Wheels(config), StallWatch(config)
        self._v, self._w = _Asked(robot.brake_mps2), _Asked(robot.max_turn_accel_radps2)
        self._now_s = self._scan_s = self._attitude_s = -math.inf
        self._upright = 0.0  # cosine of the tilt
        self.why = ""  # it halts the robot, in words; "": it does not
        self.halts = 0  # so often it began to

    def scanned(self, last_s: float) -> None:
        """A sweep has come: host time of its last beam."""
        self._scan_s = max(self._scan_s, last_s)

    def turned(self, attitude: Attitude) -> None:
        w, x, y, z = attitude.q_earth_sensor
        if not abs(w * w + x * x + y * y + z * z - 1.0) <= UNIT:
            return
        a, b, c = self._up_sensor
        self._upright = (
            a * 2 * (x * z - w * y) + b * 2 * (y * z + w * x) + c * (1 - 2 * (x * x + y * y))
        )
        self._attitude_s = max(self._attitude_s, attitude.t_s)

    def counted(self, counts: WheelCounts) -> None:
        self._wheels.counted(counts)
        self._stall.counted(counts)

    def passed(self, now_s: float, powers: Powers, seen: Seen) -> Powers:
        """The power that may go out: the same, or zero; `why` says why."""
        passed_s, self._now_s = now_s - self._now_s, now_s
        has_halted = bool(self.why)
        request = seen.request
        is_live = request is not None and now_s <= request.valid_until_s
        asked = (request.v_mps, request.w_radps) if request is not None and is_live else (0.0, 0.0)
        self._v.step(asked[0], min(STEP_S, passed_s))
        self._w.step(asked[1], min(STEP_S, passed_s))
        if not any(asked):
            self.why = ""
        if any(powers) and not self.why:
            self.why = "" if passed_s <= LATE_S else WAS_AWAY
            self.why = self.why or self._maybe_why(now_s, powers, seen)
            self.halts += bool(self.why) and not has_halted
        let_out = (0.0, 0.0) if self.why else powers
        self._stall.told(now_s, *let_out)
        return let_out

    def warm(self, seen: Seen) -> None:
        """Compile what it needs."""
        self._met((0.0, 0.0, 0.0), (0.0, 0.0), 0.0, seen)

    def _maybe_why(self, now_s: float, powers: Powers, seen: Seen) -> str:
        """Why this power may not go out; "" where it may."""
        left, right = powers
        if not (abs(left) <= 1.0 and abs(right) <= 1.0):
            return NO_POWER
        told = (left + right) / 2 * self._full_mps, (right - left) * self._turn_full_radps
        return (
            self._stale(now_s, seen.mapped_s)
            or self._unlike(now_s, seen.request, told)
            or (self._in_way(told, seen))
        )

    @property
    def _turn_full_radps(self) -> float:
        """Of a wheel at full power, the other one standing."""
        return self._full_mps / self._robot.track_width_m

    def _stale(self, now_s: float, mapped_s: float) -> str:
        for newest_s, most_s, why in (
            (self._scan_s, self._scans_stale_s, NO_SCANS),
            (mapped_s, self._scans_stale_s, NOT_MAPPED),
            (self._attitude_s, ATTITUDE_STALE_S, NO_ATTITUDE),
            (self._wheels.newest_s, COUNTS_STALE_S, NO_COUNTS),
            (self._wheels.measured_s, SPEED_STALE_S, NO_SPEED),
        ):
            if not -EARLY_S <= now_s - newest_s <= most_s:
                return why
        if self._stall.stalled:
            return STALLED
        return "" if self._upright >= math.cos(MOST_TILT_RAD) else LEANS

    def _unlike(self, now_s: float, request: DriveRequest | None, told: Motion) -> str:
        """Why nobody can have asked for this motion."""
        if request is None or not now_s <= request.valid_until_s:
            return NOT_ASKED
        if request.valid_until_s - now_s > LONGEST_S + SAME:
            return TOO_LONG
        robot = self._robot
        is_like = self._v.allows(told[0], robot.max_speed_mps)
        if not (is_like and self._w.allows(told[1], robot.max_turn_radps)):
            return UNLIKE
        return ""

    def _in_way(self, told: Motion, seen: Seen) -> str:
        """What comes under the footprint before the robot stands: as it is told, as it goes now."""
        pose, goes = seen.pose, self._wheels.motion
        if pose is None:
            return NO_POSE
        if abs(goes[0]) > FASTEST_SHARE * self._robot.max_speed_mps:
            return TOO_FAST
        place = pose.x_m, pose.y_m, pose.yaw_rad
        state = self._met(place, told, STOPPING_S, seen)
        if state == FREE:
            state = self._met(place, goes, 0.0, seen)
        return IN_WAY.get(state, "")

    def _met(self, place: Place, motion: Motion, waits_s: float, seen: Seen) -> int:
        """State of what a motion meets that goes on for so long and is then braked; or FREE."""
        robot, grid = self._robot, seen.window.grid
        radius_m = max(0.0, robot.start_clear_m - seen.off_start_m)
        rate_mps = abs(motion[0]) + abs(motion[1]) * self._reach_m
        return _meets(
            seen.window.cells,
            (grid.corner_i, grid.corner_j),
            grid.cell_m,
            place,
            self._rect,
            motion,
            waits_s + rate_mps / (2 * robot.brake_mps2),
            radius_m if robot.unknown_stops else math.inf,
        )
