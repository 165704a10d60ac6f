"""How far a robot can have rolled while nobody counted, as a bound: a strip along its heading.

A controller that starts again counts from zero, and what the wheels did meanwhile is lost. But the
attitude has told all the time where the body pointed, a wheeled body goes where it points, and how
fast it may go follows from the speed before and from what changes speeds: motors and a slope.
"""

import math
from typing import NamedTuple

import numpy as np

from core.motion.attitude import AttitudeRing
from core.motion.lean import GRAVITY_MPS2
from core.records import I64
from core.run_settings import Robot

LAG = 2.0  # a motor that lags behind what it was told changes its speed so much faster
GRIP_MPS2 = 9.0  # no wheel brakes harder: dry rubber, friction of 0.9
TILT_RAD = math.radians(0.5)  # by so much may the told tilt be off: sheet, static accuracy
LIFTED_RAD = 0.06  # roll or pitch that changes more: something else than wheels moves the body
ASIDE_RAD = 0.05  # a body that brakes goes aside of where it points
SLACK_M = 0.05  # the speed before is a mean over an interval of the counts; rounding
LOOK_S = 0.02  # the attitude is looked at so often
MOST_M = 2.0  # a strip longer than this leaves nothing of use


class Gap(NamedTuple):
    """A controller was away, and has started again, by its own word."""

    from_s: float  # newest counts before it,
    unpowered_s: float  # from then on the motors had no power; inf: nobody knows,
    to_s: float  # and first ones behind
    v_mps: float  # by the wheels, before it
    slips: bool  # one of these did: they tell the sense of it alone
    owed_m: float  # by which the told place was to be corrected still


class Shift(NamedTuple):
    """Where a body can be, in the map frame: a strip, in whose middle it is told to be."""

    moved_m: tuple[float, float]  # x, y: from where it was told to be before, to that middle
    heading: tuple[float, float]  # unit vector along the strip
    half_m: float  # along that, to either end
    aside_m: float  # to either side

    @property
    def reach_m(self) -> float:
        """How far from the middle it can be at most."""
        return math.hypot(self.half_m, self.aside_m)

    def cells(self, cell_m: float) -> I64:
        """All (k, 2) steps from a cell to one that a point of it can be in: i, j."""
        (c, s), n = self.heading, math.ceil(self.reach_m / cell_m) + 1
        i, j = np.mgrid[-n : n + 1, -n : n + 1].reshape(2, -1)
        # the strip and the square of all steps between points of two such cells: apart along an
        # edge of either, if they are
        x, y, wide = i * cell_m, j * cell_m, cell_m * (abs(c) + abs(s))
        meets = abs(c * x + s * y) < self.half_m + wide
        meets &= abs(c * y - s * x) < self.aside_m + wide
        meets &= abs(x) < cell_m + self.half_m * abs(c) + self.aside_m * abs(s)
        meets &= abs(y) < cell_m + self.half_m * abs(s) + self.aside_m * abs(c)
        return np.stack([i[meets], j[meets]], axis=1)


def rolled_m(
    v_mps: float, powered_s: float, passed_s: float, robot: Robot, slope_mps2: float
) -> float:
    """The farthest way with a speed of v_mps, or against one below 0; metres.

    While its motors may have power it speeds up, to its fastest; then it slows down. Below 0: so
    far at least it has gone the other way: its wheels may have locked.

    Args:
        slope_mps2: what it rolls faster by downhill, none uphill: how it brakes there is not known.
    """
    accel, brake, back_m = LAG * robot.max_accel_mps2, robot.brake_mps2, 0.0
    if v_mps < 0.0:  # it may turn round
        stops = GRIP_MPS2 + slope_mps2
        stopped_s = min(passed_s, -v_mps / stops)
        back_m = v_mps * stopped_s + stops * stopped_s**2 / 2
        powered_s, passed_s, v_mps = max(0.0, powered_s - stopped_s), passed_s - stopped_s, 0.0
    top_mps = max(v_mps, robot.max_speed_mps)
    speeds_s = min(powered_s, (top_mps - v_mps) / accel)
    end_mps = v_mps + accel * speeds_s
    way_m = (v_mps + end_mps) / 2 * speeds_s + end_mps * (powered_s - speeds_s)
    left_s, slows = passed_s - powered_s, brake - slope_mps2
    rolls_s = min(left_s, end_mps / slows) if slows > 0.0 else left_s
    way_m += end_mps * rolls_s - slows * rolls_s**2 / 2
    return back_m + way_m + slope_mps2 * powered_s**2 / 2 + slope_mps2 * powered_s * left_s


def maybe_shift(
    gap: Gap, attitudes: AttitudeRing, yaw_start_rad: float, robot: Robot
) -> Shift | None:
    """The strip of a gap; None where nobody knows, or where it is too long to be of use.

    Args:
        yaw_start_rad: of the body in the earth frame where the map's x axis points.
    """
    passed_s = gap.to_s - gap.from_s
    powered_s = gap.unpowered_s - gap.from_s
    if not (0.0 <= powered_s <= passed_s and attitudes.covers(gap.from_s, gap.to_s)):
        return None
    count = math.ceil(passed_s / LOOK_S) + 1
    looks = np.array([attitudes.rpy_at(t) for t in np.linspace(gap.from_s, gap.to_s, count)])
    tilts_rad, yaws_rad = looks[:, :2], np.unwrap(looks[:, 2]) - yaw_start_rad
    turn_rad = float(np.ptp(yaws_rad)) / 2 + ASIDE_RAD
    if np.ptp(tilts_rad, axis=0).max() > LIFTED_RAD or turn_rad >= math.pi / 2:
        return None
    down_rad, up_rad = float(tilts_rad[:, 1].max()), float(tilts_rad[:, 1].min())  # pitch: its nose
    ahead_mps2 = GRAVITY_MPS2 * math.sin(max(0.0, down_rad + TILT_RAD))
    back_mps2 = GRAVITY_MPS2 * math.sin(max(0.0, TILT_RAD - up_rad))
    spare_m = SLACK_M + gap.owed_m
    slow_mps = fast_mps = gap.v_mps
    if gap.slips:
        fastest_mps = robot.max_speed_mps
        slow_mps, fast_mps = (0.0, fastest_mps) if gap.v_mps >= 0.0 else (-fastest_mps, 0.0)
    most_m = rolled_m(fast_mps, powered_s, passed_s, robot, ahead_mps2)
    least_m = -rolled_m(-slow_mps, powered_s, passed_s, robot, back_mps2)
    # what it goes at least, it goes at an angle to the strip
    most_m = max(most_m, most_m * math.cos(turn_rad)) + spare_m
    least_m = min(least_m, least_m * math.cos(turn_rad)) - spare_m
    if most_m - least_m > MOST_M:
        return None
    aside_m = (max(most_m, 0.0) - min(least_m, 0.0)) * math.sin(turn_rad) + spare_m
    yaw_rad, middle_m = (float(yaws_rad.min()) + float(yaws_rad.max())) / 2, (least_m + most_m) / 2
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    return Shift((middle_m * c, middle_m * s), (c, s), (most_m - least_m) / 2, aside_m)
