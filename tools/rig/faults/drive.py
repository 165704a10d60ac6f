"""One drive with faults: a robot that is driven on whatever happens, and what became of it.

The hall has walls, and a low box across it that the scanner first sees while the fault lasts; the
small robot drives slower, and to a nearer box, for it sees less far. The planner's end is the worst
there may be: it looks at nothing and asks on. So whatever stops the robot is mapod. Judged by the
world's truth.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from config_file import with_changes
from core.config import Config
from core.records import FREE
from fakes.planner_mcu.receiver import FakePlanner
from fakes.scenes.scene import Scene, Solid
from tools.rig.faults.catalogue import Fault
from tools.rig.runs.loop import Loop, rig_config, settings_of
from tools.rig.truth.contact import Footprint
from tools.rig.truth.judge import Judge, truth_of

F64 = npt.NDArray[np.float64]

ASK_S, VALID_S = 0.1, 0.3  # between two requests, and of each
PATIENCE_S, LET_GO_S = 1.5, 0.4  # standing in vain, and then without asking
STEER_YAW, STEER_Y = 1.0, 0.4  # rad/s for each rad, and for each metre beside the middle
LONGEST_S = 40.0
BOX_HIGH_M = 0.2
TAKE_EVERY = 4  # ticks: 50 times a second
MAP_EVERY = 20
SOLID_M = 0.15  # what is that high, or low, is not free
STANDS_MPS, MOVES_MPS = 0.02, 0.05
STOOD_S = 0.1  # a standstill lasts at least so long
WELL = ("scanner", "attitude", "wheels", "clocks", "pose", "map", "loop")  # health bits 0 to 6
ALL_WELL = (1 << len(WELL)) - 1
FRESH_S = 0.25
UNBIDDEN_S = 1.6  # the longest way to a zero: an exchange, silence, the controller's watchdog
SPARE_S = 3.0  # after the time in which it has to recover


class Course(NamedTuple):
    """What a robot is asked to do."""

    speed_mps: float
    box_x_m: float
    before_m: float  # so far before the box or nearer it stands for that
    fault_from_s: float  # the box comes into sight
    start_clear_m: float  # of ground that the operator vouches for

    @property
    def arrived_x_m(self) -> float:
        return self.box_x_m - self.before_m


COURSE = Course(0.8, 12.5, 1.5, 7.5, 9.0)  # 8.7 m ahead
COURSES = {"ragno": Course(0.3, 2.2, 0.7, 5.0, 1.0)}  # 0.7 m ahead


def course_of(robot: str) -> Course:
    return COURSES.get(robot, COURSE)


def footprint_of(config: Config) -> Footprint:
    one = config.robot
    return Footprint(one.front_m, one.rear_m, one.width_m / 2, one.height_m)


def hall(box_x_m: float = COURSE.box_x_m, start_clear_m: float = COURSE.start_clear_m) -> Scene:
    return Scene(
        "fault hall",
        (
            Solid("floor", (-10.0, 40.0), (-10.0, 10.0), (-1.0, 0.0)),
            Solid("left wall", (-6.0, 30.0), (3.0, 4.0), (0.0, 2.5)),
            Solid("right wall", (-6.0, 30.0), (-4.0, -3.0), (0.0, 2.5)),
            Solid("end wall", (17.0, 18.0), (-3.0, 3.0), (0.0, 2.5)),
            Solid("box", (box_x_m, box_x_m + 0.8), (-2.0, 2.0), (0.0, BOX_HIGH_M)),
            Solid("crate", (10.2, 11.0), (1.6, 2.6), (0.0, 0.6)),
        ),
        start_clear_m=start_clear_m,
    )


class Pusher(FakePlanner):
    """A planner that asks for the same motion all the time, and keeps to the middle of the hall.

    Where it stands in vain it lets go for a moment, as a person would try.
    """

    def __init__(self, speed_mps: float = COURSE.speed_mps) -> None:
        super().__init__()
        self._speed_mps = speed_mps
        self._ask_s = self._let_go_s = -math.inf
        self._moved_s = math.nan

    def poll(self, now_s: float) -> list[bytes]:
        if now_s >= self._ask_s:
            self._ask_s = now_s + ASK_S
            self.drive(now_s, *self._wanted(now_s), VALID_S)
        return super().poll(now_s)

    def _wanted(self, now_s: float) -> tuple[float, float]:
        pose = self.pose
        if pose is None or math.isnan(self._moved_s) or abs(pose.v_mps) > MOVES_MPS:
            self._moved_s = now_s
        if now_s - self._moved_s > PATIENCE_S:
            self._moved_s, self._let_go_s = now_s + LET_GO_S, now_s + LET_GO_S
        if pose is None or now_s < self._let_go_s:
            return 0.0, 0.0
        return self._speed_mps, -STEER_YAW * pose.yaw_rad - STEER_Y * pose.y_m


@dataclass(frozen=True, slots=True)
class Moment:
    """The truth, and what was told, at one instant."""

    t_s: float  # of the run
    x_m: float
    y_m: float
    has_power: bool
    is_sent: bool  # mapod has wanted the wheels to turn, since the last moment
    health: int  # as the planner was told; 0: nothing lately, or not running
    reason: str  # why the app lets it stand


@dataclass(slots=True)
class Outcome:
    """What became of one drive with faults."""

    start_s: float
    end_s: float
    stood_s: float | None = None  # from the begin to standing; None: it went on
    reason: str = ""  # as it stood, in mapod's words
    blind_m: float = 0.0  # way from the begin to standing, or to the end of the fault
    told_s: float | None = None  # from the begin until the planner is told; None: it is not
    told: tuple[str, ...] = ()  # what it is told not to be well
    well_s: float | None = None  # from the end until all is well for good; None: never
    again_s: float | None = None  # from the end until it moves; None: never
    collisions: list[str] = field(default_factory=list)
    wrong_free: list[str] = field(default_factory=list)  # FREE cells told, obstacles in truth
    unbidden_s: float = 0.0  # longest time with power since mapod last wanted any


class Drive:
    """One drive in the hall (or `scene`) with faults from, to span_s, and wait_s after them.

    Args:
        robot: whose settings of robots/ it has; "": the shipped ones.
        changes: of those settings, by section and key.
    """

    def __init__(
        self,
        orders: Sequence[str],
        span_s: tuple[float, float],
        wait_s: float,
        seed: int = 1,
        scene: Scene | None = None,
        robot: str = "",
        changes: Mapping[str, dict[str, Any]] | None = None,
    ) -> None:
        self._course = course = course_of(robot)
        scene = scene or hall(course.box_x_m, course.start_clear_m)
        self.planner = Pusher(course.speed_mps)
        config = rig_config(scene, settings_of(robot))
        config = with_changes(config, **(changes or {}))
        self.loop = Loop(scene, seed, config, self.planner)
        self.loop.set_faults(orders)
        self._judge = Judge(scene, footprint_of(self.loop.config))
        self.outcome = Outcome(*span_s)
        self._wait_s = wait_s
        self._is_sent = False  # at any tick since the last moment
        self._moments: list[Moment] = []

    def run(self) -> Outcome:
        while not self._is_over():
            self.loop.step()
            control = self.loop.app.pilot.control
            self._is_sent |= bool(control.v_mps or control.w_radps)
            if self.loop.ticks % TAKE_EVERY == 0:
                self._take()
            if self.loop.ticks % MAP_EVERY == 0:
                self._check_map()
        fill_in(self._moments, self.outcome, self._course.arrived_x_m)
        return self.outcome

    def _is_over(self) -> bool:
        now_s = self.loop.since_begin_s
        if now_s >= LONGEST_S or self.outcome.collisions:
            return True
        rest = self._moments[-25:]
        if now_s < self.outcome.end_s + 1.0 or len(rest) < 25:
            return False
        stands = not any(moment.has_power for moment in rest)
        before_box = rest[-1].x_m > self._course.arrived_x_m
        return stands and (before_box or now_s > self.outcome.end_s + self._wait_s)

    def _take(self) -> None:
        loop, pose = self.loop, self.planner.pose
        truth = truth_of(loop.rig.world, loop.since_begin_s)
        self._judge.step(truth)
        self.outcome.collisions = [contact.words() for contact in self._judge.collisions]
        fresh = pose is not None and loop.now_s - pose.arrived_s < FRESH_S
        self._moments.append(
            Moment(
                truth.since_s,
                *truth.place[:2],
                has_power=loop.rig.drive.powers() != (0, 0),
                is_sent=self._is_sent,
                health=pose.health if pose is not None and fresh else 0,
                reason=loop.app.pilot.control.blocked_by,
            )
        )
        self._is_sent = False

    def _check_map(self) -> None:
        if len(self.outcome.wrong_free) < 3:
            now_s = self.loop.since_begin_s
            self.outcome.wrong_free += [
                f"({x:.1f}, {y:.1f}) at {now_s:.1f} s" for x, y in wrong_free(self.loop)[:3]
            ]


def wrong_free(loop: Loop) -> list[tuple[float, float]]:
    """Places (x, y in the world) of cells told FREE amid what is solid in truth.

    A cell counts where it and all cells around it are solid: so an error of the pose of less than a
    cell does not. It is laid into the world by the robot in the middle, where it is and where it
    takes itself to be: a map belongs to the robot that drives by it.
    """
    pose = loop.app.mapper.maybe_pose(loop.now_s)
    if pose is None or not loop.app.report(loop.now_s)[0]:
        return []
    cells, grid = loop.map_now(), loop.app.mapper.maps.window.grid
    rows, columns = np.nonzero(cells == FREE)
    if len(rows) == 0:
        return []
    x, y = ((n + 0.5) * grid.cell_m for n in (grid.corner_i + columns, grid.corner_j + rows))
    true_x, true_y, true_yaw = loop.rig.world.pose()[:3]
    turn = true_yaw - pose.yaw_rad
    c, s = math.cos(turn), math.sin(turn)
    x, y = x - pose.x_m, y - pose.y_m
    x, y = true_x + c * x - s * y, true_y + s * x + c * y
    around = grid.cell_m * np.array([-1.0, 0.0, 1.0])
    solid = np.ones(len(x), dtype=bool)
    for dx in around:
        for dy in around:
            if solid.any():
                height = loop.rig.world.height_at(x[solid] + dx, y[solid] + dy)
                solid[solid] = np.abs(height) >= SOLID_M
    return [(float(x[k]), float(y[k])) for k in np.nonzero(solid)[0]]


def fill_in(
    moments: Sequence[Moment], outcome: Outcome, arrived_x_m: float = COURSE.arrived_x_m
) -> None:
    t = np.array([moment.t_s for moment in moments])
    x, y = (np.array([getattr(m, axis) for m in moments]) for axis in ("x_m", "y_m"))
    way = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
    speed = np.gradient(way, t)
    power = np.array([moment.has_power for moment in moments])
    health = np.array([moment.health for moment in moments])
    well = health & ALL_WELL == ALL_WELL
    sent_s = np.maximum.accumulate(np.where([m.is_sent for m in moments], t, 0.0))
    outcome.unbidden_s = float(np.max(np.where(power, t - sent_s, 0.0)))
    first = int(np.searchsorted(t, outcome.start_s))
    last = int(np.searchsorted(t, outcome.end_s))
    held = round(STOOD_S * 200 / TAKE_EVERY)
    stands = (speed < STANDS_MPS) & ~power & (x < arrived_x_m)
    stood = [k for k in range(first, len(t) - held) if stands[k : k + held].all()]
    outcome.blind_m = float(way[min(last, len(t) - 1)] - way[first])
    moving = np.nonzero((np.arange(len(t)) >= last) & (speed > MOVES_MPS))[0]
    if stood:
        k = stood[0]
        outcome.stood_s, outcome.reason = float(t[k] - t[first]), moments[k].reason
        outcome.blind_m = float(way[k] - way[first])
        moving = moving[moving > k]
    if len(moving):
        outcome.again_s = max(0.0, float(t[moving[0]] - outcome.end_s))
    _note_told(t, health, outcome)
    ill = np.nonzero((np.arange(len(t)) >= last) & ~well)[0]
    if not len(ill):
        outcome.well_s = 0.0
    elif ill[-1] < len(t) - held:
        outcome.well_s = float(t[ill[-1]] - outcome.end_s)


def _note_told(t: F64, health: npt.NDArray[np.int64], outcome: Outcome) -> None:
    """What the planner is told until a second after the faults' end."""
    during = (t >= outcome.start_s) & (t <= outcome.end_s + 1.0)
    ill = np.nonzero(during & (health & ALL_WELL != ALL_WELL))[0]
    if len(ill):
        outcome.told_s = float(t[ill[0]] - outcome.start_s)
        lost = ALL_WELL & ~int(np.bitwise_and.reduce(health[during]))
        outcome.told = tuple(name for bit, name in enumerate(WELL) if lost >> bit & 1)


def problems(fault: Fault, outcome: Outcome) -> list[str]:
    found = problems_of_pair([fault], outcome)
    if fault.must == "goes on" and outcome.stood_s is not None:
        found.append(f"stopped: {outcome.reason or 'no reason told'}")
    if fault.again and outcome.stood_s is not None and outcome.again_s is None:
        found.append("did not drive again")
    return found


def problems_of_pair(faults: Sequence[Fault], outcome: Outcome) -> list[str]:
    """The same of faults at once, each of which may make the others worse: what holds of all."""
    found = harm(outcome)
    stood_s, well_s = outcome.stood_s, outcome.well_s
    stands_s = [fault.stands_s for fault in faults if fault.must == "stops"]
    if stands_s and stood_s is None:
        found.append("did not stop")
    elif stands_s and stood_s is not None and stood_s > min(stands_s):
        found.append(f"stood after {stood_s:.1f} s only, must after {min(stands_s):g} s")
    recovers_s = sum(fault.recovers_s for fault in faults)
    if well_s is None or well_s > recovers_s:
        after = "never" if well_s is None else f"{well_s:.1f} s after the end"
        found.append(f"well again {after}, must within {recovers_s:g} s")
    return found


def harm(outcome: Outcome) -> list[str]:
    found = [f"collision with {what}" for what in outcome.collisions]
    if outcome.wrong_free:
        found.append(f"told free, and is not: {', '.join(outcome.wrong_free)}")
    if outcome.unbidden_s > UNBIDDEN_S:
        found.append(f"power for {outcome.unbidden_s:.1f} s after mapod had wanted none")
    return found


def drive_with(*faults: Fault, seed: int = 1, start_s: float | None = None) -> Outcome:
    """Faults of one robot at once; start_s: None, where the box comes into sight."""
    [robot] = {fault.robot for fault in faults}
    start_s = course_of(robot).fault_from_s if start_s is None else start_s
    orders = [order for fault in faults for order in fault.orders(start_s)]
    end_s = start_s + max(fault.lasts_s for fault in faults)
    wait_s = sum(fault.recovers_s for fault in faults) + SPARE_S
    return Drive(orders, (start_s, end_s), wait_s, seed, robot=robot).run()
