"""People who see the robot and each other: they walk about, give way, and wait.

Each goes to and fro between waypoints. Five times a second everyone looks how the robot and all
others go on, and takes, of a few ways to go on for two seconds, the best one. They never walk into
a robot that stands, keep away from its sides and its rear, and cross in front of one that drives
only with room to spare: more, the faster it is. A robot that comes at them they leave the way for,
if they can. What they do follows from the seed and from the robot's path alone. Map frame, metres;
instants are seconds since the world's begin.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from fakes.rays.kernels import F64
from fakes.scenes.movers import STRIDE_M, Part, person
from fakes.world.crowd_kernels import FRONT_M, HALF_WIDTH_M, REAR_M, parts_at, walk
from fakes.world.kernels import rows_at

Place = tuple[float, float, float]  # of the robot: x, y, yaw
KEPT = 64  # steps that can be asked about: 1.28 s of steps of 20 ms
PLANNED_M = 0.55  # what they plan to keep
OTHERS_M = 0.25  # between two bodies
AHEAD_S = 1.3  # way of a driving robot that nobody crosses right before it
DECIDE_S = 0.2  # between two looks around
HORIZON_S = np.arange(1, 9) * 0.25
TURNS_RAD = np.radians([0.0, -25.0, 25.0, -50.0, 50.0, -80.0, 80.0, -120.0, 120.0, 180.0])
PACES = (1.0, 0.5)
PATIENCE_S = 4.0  # without getting on, until somebody turns round
THERE_M = 0.3


@dataclass(frozen=True, slots=True)
class Walker:
    """Somebody who walks to and fro between waypoints and gives way.

    Args:
        pause_s: how long he stays at a waypoint, at most; drawn each time.
        aside_m: how far he leaves the straight line between two waypoints to let somebody by.
    """

    name: str
    waypoints: tuple[tuple[float, float], ...]
    speed_mps: float = 1.2
    start_s: float = 0.0
    pause_s: float = 3.0
    radius_m: float = 0.22
    aside_m: float = 1.2

    def __post_init__(self) -> None:
        if len(self.waypoints) < 2 or not 0.0 < self.speed_mps <= 2.0:
            raise ValueError(f"{self.name}: needs two waypoints, and 0..2 m/s")
        if any(math.dist(*leg) < 1.0 for leg in pairwise(self.waypoints)):
            raise ValueError(f"{self.name}: waypoints must be 1 m apart")


@dataclass(slots=True)
class Errand:
    """Where somebody goes now, and how he gets on."""

    walker: Walker
    rests_until_s: float
    goal: int = 1  # waypoint,
    way: int = 1  # and which way through them
    nearest_m: float = math.inf  # that he has come to it,
    nearest_s: float = 0.0  # and when

    def go_on(self, place: F64, now_s: float, random: np.random.Generator) -> None:
        """Turn to the next waypoint where this one is reached, or cannot be."""
        waypoints = self.walker.waypoints
        left_m = math.dist(place, waypoints[self.goal])
        if left_m < self.nearest_m - 0.1:
            self.nearest_m, self.nearest_s = left_m, now_s
        stuck = now_s - self.nearest_s > PATIENCE_S
        if left_m > THERE_M and not stuck:
            return
        self.way *= -1 if stuck else 1
        if not 0 <= self.goal + self.way < len(waypoints):
            self.way *= -1
        self.goal += self.way
        rest_s = 0.0 if stuck else float(random.uniform(0.0, self.walker.pause_s))
        self.rests_until_s = now_s + rest_s
        self.nearest_m, self.nearest_s = math.inf, now_s + rest_s


class SeenRobot:
    """The robot as people see it: where it is and how it goes on."""

    def __init__(self) -> None:
        self.place: Place | None = None
        self._v, self._w = 0.0, 0.0

    def follow(self, place: Place, span_s: float) -> None:
        if self.place is not None and span_s > 0.0:
            x, y, yaw = self.place
            v = ((place[0] - x) * math.cos(yaw) + (place[1] - y) * math.sin(yaw)) / span_s
            w = math.remainder(place[2] - yaw, math.tau) / span_s
            share = min(1.0, span_s / 0.1)
            self._v += share * (v - self._v)
            self._w += share * (w - self._w)
        self.place = place

    def gaps_m(self, spots: F64) -> F64:
        """Least gaps (walkers, ways) of spots at instants to it and the way right before it."""
        assert self.place is not None
        rx, ry, yaw = self.place
        yaws = yaw + self._w * HORIZON_S
        middle = yaw + self._w * HORIZON_S / 2
        xs = rx + self._v * HORIZON_S * np.cos(middle)
        ys = ry + self._v * HORIZON_S * np.sin(middle)
        dx, dy = spots[..., 0] - xs, spots[..., 1] - ys
        ahead = np.cos(yaws) * dx + np.sin(yaws) * dy
        aside = np.abs(np.cos(yaws) * dy - np.sin(yaws) * dx)
        front = FRONT_M + AHEAD_S * max(0.0, self._v)
        rear = REAR_M + AHEAD_S * max(0.0, -self._v)
        over = np.maximum(np.maximum(ahead - front, -rear - ahead), 0.0)
        beside = np.maximum(aside - HALF_WIDTH_M, 0.0)
        # within the keep-out: the nearer to its middle line, the worse, so that the way out shows
        inside = np.where((over == 0.0) & (beside == 0.0), HALF_WIDTH_M - aside, 0.0)
        return np.asarray((np.hypot(over, beside) - inside).min(axis=2))


class Past:
    """The last steps of all walkers: where each was, went, and how far he had come."""

    def __init__(self, walkers: int) -> None:
        self.steps = 0
        self._ring = np.zeros((KEPT, walkers, 6))  # x y, ahead x y, way gone, swing of legs 0..1
        self._times_s = np.full(KEPT, -math.inf)

    def put(self, now_s: float, at: F64, ahead: F64, gone_m: F64, v: F64) -> None:
        row = self._ring[self.steps % KEPT]
        row[:, :2], row[:, 2:4], row[:, 4] = at, ahead, gone_m
        row[:, 5] = np.minimum(1.0, np.hypot(v[:, 0], v[:, 1]) / 0.6)
        self._times_s[self.steps % KEPT] = now_s
        self.steps += 1

    def rows_at(self, times_s: F64) -> F64:
        """(n, walkers, 6), interpolated."""
        return rows_at(self._ring, self._times_s, self.steps, times_s)


class Crowd:
    """All walkers of a scene, one at least, stepped with the robot's place; asked after that.

    Args:
        seed: of their pauses.
    """

    def __init__(self, walkers: Sequence[Walker], seed: int) -> None:
        self.walkers, n = tuple(walkers), len(walkers)
        self.parts: tuple[Part, ...] = tuple(
            part
            for walker in self.walkers
            for part in person(walker.name, walker.waypoints[:1], radius_m=walker.radius_m).parts
        )
        one = self.parts[: len(self.parts) // n]  # torso, left leg, right leg
        self._gait = np.array([(part.aside_m, part.swing_m) for part in one]).T.copy()
        self._errands = [Errand(walker, walker.start_s) for walker in self.walkers]
        self._robot, self._random = SeenRobot(), np.random.default_rng([seed, n])
        self._at = np.array([w.waypoints[0] for w in self.walkers], dtype=float)
        self._v, self._wanted = np.zeros((n, 2)), np.zeros((n, 2))  # m/s
        self._ahead = np.array([_towards(*w.waypoints[:2]) for w in self.walkers])
        self._gone_m = np.zeros(n)
        self._radius_m = np.array([w.radius_m for w in self.walkers])
        self._past = Past(n)
        self._now_s, self._decided_s = 0.0, -math.inf

    def people(self, t_s: float | None = None) -> F64:
        """x, y, radius (n, 3) of everybody, now or at an instant of the last second."""
        at = self._at if t_s is None else self._past.rows_at(np.array([t_s]))[0, :, :2]
        return np.column_stack([at, self._radius_m])

    def parts_m(self, times_s: F64) -> F64:
        """x, y (n, parts, 2) of the middles of all `parts` at instants (n,) of the last second."""
        return parts_at(self._past.rows_at(times_s), self._gait[0], self._gait[1], STRIDE_M)

    def step(self, now_s: float, place: Place) -> None:
        span_s = now_s - self._now_s if self._past.steps else 0.0
        self._robot.follow(place, span_s)
        self._now_s = now_s
        if now_s - self._decided_s >= DECIDE_S - 1e-9:
            self._decided_s = now_s
            self._decide()
        if span_s > 0.0:
            walks = self._at, self._v, self._ahead, self._gone_m
            walk(span_s, place, self._wanted, self._radius_m, *walks)
        self._past.put(now_s, self._at, self._ahead, self._gone_m, self._v)

    def _decide(self) -> None:
        headings, paces = self._ahead.copy(), np.zeros(len(self.walkers))
        for k, errand in enumerate(self._errands):
            if self._now_s >= errand.rests_until_s:
                errand.go_on(self._at[k], self._now_s, self._random)
                headings[k] = _towards(self._at[k], errand.walker.waypoints[errand.goal])
                paces[k] = errand.walker.speed_mps
        ways = _ways(headings, np.array([w.speed_mps for w in self.walkers]))  # (walkers, ways, 2)
        spots = self._at[:, None, None] + ways[:, :, None] * HORIZON_S[:, None]  # and instants
        off = ways - (paces[:, None] * headings)[:, None]
        most_m = np.array([walker.aside_m for walker in self.walkers])[:, None]
        robot_gaps_m = self._robot.gaps_m(spots) - self._radius_m[:, None]
        loss = np.hypot(off[..., 0], off[..., 1]) + 0.02 * np.arange(ways.shape[1]) / ways.shape[1]
        loss += 30.0 * np.maximum(0.0, PLANNED_M - robot_gaps_m)
        loss += 10.0 * np.maximum(0.0, OTHERS_M - self._other_gaps_m(spots))
        loss += 4.0 * np.maximum(0.0, self._aside_m(spots) - most_m)
        self._wanted = ways[np.arange(len(ways)), loss.argmin(axis=1)]

    def _other_gaps_m(self, spots: F64) -> F64:
        """Least gaps (walkers, ways) to all other walkers, as they go on."""
        theirs = self._at[:, None] + self._v[:, None] * HORIZON_S[:, None]  # (others, instants, 2)
        apart = spots[:, :, None] - theirs  # (walkers, ways, others, instants, 2)
        gaps = np.hypot(apart[..., 0], apart[..., 1]).min(axis=3)
        gaps -= (self._radius_m[:, None] + self._radius_m)[:, None]
        own = np.arange(len(gaps))
        gaps[own, :, own] = math.inf
        return np.asarray(gaps.min(axis=2))

    def _aside_m(self, spots: F64) -> F64:
        """How far (walkers, ways) each comes from the line between his waypoints in a second."""
        begins = np.array([e.walker.waypoints[e.goal - e.way] for e in self._errands])
        ends = np.array([e.walker.waypoints[e.goal] for e in self._errands])
        along = ends - begins
        long_m = np.hypot(along[:, 0], along[:, 1])[:, None]
        along_x, along_y = (along / long_m).T[:, :, None]
        off = spots[:, :, 3] - begins[:, None]
        beside = off[..., 0] * along_y - off[..., 1] * along_x
        way_m = off[..., 0] * along_x + off[..., 1] * along_y
        return np.asarray(np.hypot(beside, np.maximum(np.maximum(-way_m, way_m - long_m), 0.0)))


def _towards(begin: Sequence[float] | F64, end: Sequence[float] | F64) -> tuple[float, float]:
    """The direction from a place to another; along x where they are one."""
    dx, dy = float(end[0] - begin[0]), float(end[1] - begin[1])
    away_m = math.hypot(dx, dy)
    return (dx / away_m, dy / away_m) if away_m > 1e-9 else (1.0, 0.0)


def _ways(headings: F64, speeds_mps: F64) -> F64:
    """Velocities (walkers, ways, 2) to choose from: standing, and two paces in all directions."""
    c, s = np.cos(TURNS_RAD), np.sin(TURNS_RAD)
    x, y = headings[:, :1], headings[:, 1:]
    turned = np.stack([c * x - s * y, s * x + c * y], -1) * speeds_mps[:, None, None]
    return np.concatenate(
        [np.zeros((len(headings), 1, 2)), *(pace * turned for pace in PACES)], axis=1
    )
