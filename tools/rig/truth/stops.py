"""When, why and how the robot stopped; and whether there was anything in its way.

A stop begins at the instant from which nobody wants the robot to move any more: the planner asks
for nothing, or the app gives the wheels nothing; and it counts when the robot then stands for half
a second short of its goal. It is a *false stop* when in truth the robot's way to a standstill and
0.5 m more, in the direction in which it was driving, was clear: nothing of 0.10 m or more above or
below the ground, and nobody, was in what the footprint sweeps there, with the margin (0.15 m) and
the cell (0.2 m) around it by which the robot must judge, when the order came and where people were
when the robot stood. So are stops for doubts about inputs,
in a run in which nothing was made to fail.
"""

import math
from dataclasses import dataclass

from msgspec import Struct

from tools.rig.truth.contact import REACH_M, Place
from tools.rig.truth.judge import STOOD_S, Judge, Truth

REACTION_S, BRAKE_MPS2 = 0.45, 0.8  # of the way to a standstill
BEYOND_M = 0.5
BESIDE_M = 0.15 + 0.2
FROM_M = 0.10
STEP_M = 0.05
MOVING_MPS = 0.08  # slower is no driving: a robot that was slowed down comes to its stop so
LATELY_S = 3.0  # whoever drove so short a time ago stops, else he just stands


class Orders(Struct, frozen=True):
    """Who wants what at an instant."""

    asked: bool  # the planner asks for a motion
    driven: bool  # the app gives the wheels one
    why: str  # why either does not, in words
    wanted: bool  # there is a goal that is not reached


@dataclass(frozen=True, slots=True)
class Stop:
    """One stop short of a goal."""

    at_s: float
    x_m: float
    y_m: float
    why: str
    way_m: float  # from the order to the standstill
    in_way: str  # what truly was there; "": nothing, a false stop

    @property
    def is_false(self) -> bool:
        return not self.in_way


@dataclass(slots=True)
class _Begun:
    """A stop on its way to a standstill."""

    truth: Truth  # where it began, and how the robot moved there
    motion: tuple[float, float]
    driven_m: float
    in_way: str
    why: str
    way_m: float = math.nan  # NaN: it still moves
    told: bool = False


def rate_mps(v_mps: float, w_radps: float) -> float:
    """Speed that no point of the footprint exceeds."""
    return abs(v_mps) + REACH_M * abs(w_radps)


def way_m(v_mps: float, w_radps: float) -> float:
    """How far a motion's way to a standstill, and what is looked at beyond it, reaches."""
    fastest_mps = rate_mps(v_mps, w_radps)
    return fastest_mps * REACTION_S + fastest_mps**2 / (2 * BRAKE_MPS2) + BEYOND_M


def places_on(start: Place, v_mps: float, w_radps: float) -> list[Place]:
    """Places on the arc of a motion, from where it is to the end of what is looked at."""
    if not (v_mps or w_radps):
        return [start]
    count = math.ceil(way_m(v_mps, w_radps) / STEP_M)
    passed_s = STEP_M / rate_mps(v_mps, w_radps)
    (x, y, yaw), places = start, [start]
    for _ in range(count):
        middle = yaw + w_radps * passed_s / 2
        x += v_mps * passed_s * math.cos(middle)
        y += v_mps * passed_s * math.sin(middle)
        yaw += w_radps * passed_s
        places.append((x, y, yaw))
    return places


def in_way(judge: Judge, start: Truth, v_mps: float, w_radps: float) -> str:
    """What stands, gapes or walks now in the way of a motion from a place; "": nothing."""
    height_m, ground = start.height_m, judge.ground
    for place in places_on(start.place, v_mps, w_radps):
        plane = ground.level_at(place, height_m)
        height_m, from_m = plane.z, FROM_M + ground.slack_m(place, BESIDE_M)
        for near in (
            ground.nearest(place, plane, FROM_M, BESIDE_M),
            judge.nearest_mover(FROM_M, place),
            judge.nearest_person(place),
        ):
            if near.gap_m < BESIDE_M:
                return near.what
        found = ground.at_outline(place, plane, from_m, BESIDE_M)
        if found:
            return found
    return ""


class StopWatch:
    """`step` it after the judge; faulty: only stops for something in the way can be false."""

    def __init__(self, judge: Judge, faulty: bool = False) -> None:
        self._judge, self._faulty = judge, faulty
        self._begun: _Begun | None = None
        self._motion, self._moved_s = (0.0, 0.0), -math.inf  # as it drove last, and when
        self.stops: list[Stop] = []
        self.worst_way_m = 0.0  # from the order to stop to standing

    def step(self, orders: Orders) -> None:
        judge = self._judge
        wants, now_s = orders.asked and orders.driven, judge.truth.since_s
        if rate_mps(judge.v_mps, judge.w_radps) > MOVING_MPS:
            self._motion, self._moved_s = (judge.v_mps, judge.w_radps), now_s
        if wants:
            self._begun = None
        elif self._begun is None and now_s - self._moved_s <= LATELY_S:
            motion = self._motion_now
            blocked = in_way(judge, judge.truth, *motion)
            self._begun = _Begun(judge.truth, motion, judge.driven_m, blocked, orders.why)
        if self._begun is not None:
            self._follow(self._begun, orders)

    @property
    def _motion_now(self) -> tuple[float, float]:
        """As fast as it is, at least as if it just still drove, in the direction of its drive."""
        v_mps, w_radps = self._motion
        now_mps = max(MOVING_MPS, rate_mps(self._judge.v_mps, self._judge.w_radps))
        share = now_mps / rate_mps(v_mps, w_radps)
        return share * v_mps, share * w_radps

    def _follow(self, begun: _Begun, orders: Orders) -> None:
        judge, begun.why = self._judge, begun.why or orders.why
        if judge.stands_s > 0.0 and math.isnan(begun.way_m):
            begun.way_m = judge.driven_m - begun.driven_m
            self.worst_way_m = max(self.worst_way_m, begun.way_m)
            begun.in_way = begun.in_way or in_way(judge, begun.truth, *begun.motion)
        if judge.stands_s < STOOD_S or begun.told or not orders.wanted:
            return
        begun.told, self._moved_s = True, -math.inf
        if self._faulty and not is_in_way(begun.why):
            begun.in_way = begun.in_way or "a fault"
        x, y, _ = judge.truth.place
        at_s = judge.truth.since_s - judge.stands_s
        self.stops.append(Stop(at_s, x, y, begun.why, begun.way_m, begun.in_way))


def is_in_way(why: str) -> bool:
    """Whether a reason is something in the way, not a doubt about what is known."""
    return any(word in why for word in ("in the way", "drop", "ground", "obstacle"))
