"""One run: the planner drives the robot to the goals of a scene, and the truth is written down.

Scene, seed and faults decide all of it: two runs of one `RunSpec` have the same digest, in whatever
process. A run ends when all goals have been dealt with, at a collision, or when its time is up.
"""

import hashlib
import math
import struct
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from core.config import Config
from fakes.scenes.scene import Scene, load_scene
from fakes.world.error_models import as_the_sheets_say
from tools.rig.planner.host import CPlanner, PlannerSettings, PlannerState
from tools.rig.runs.loop import Loop, Planner, rig_config, settings_of
from tools.rig.truth.judge import RATE_HZ, Contact, Judge, truth_of
from tools.rig.truth.stops import Orders, Stop, StopWatch

LIMIT_S = 600.0  # of a run, simulated
FIRST_GOAL_S = 4.0  # until then the robot stands, and its gyro is learnt
GIVEN_UP_S = 15.0  # the planner says "stopped" for so long
STUCK_S = 60.0  # the robot stands for so long, whatever the planner says
GOAL_RADIUS_M = 0.3  # the planner's own
NEAR_M = 0.3  # more, by which what it believes of its place may be off
DWELLS_S = 2.0  # a robot that stands so long at its goal is there, whatever its planner says
POSE = struct.Struct("<7d")


class Pilot(Planner, Protocol):
    """A planner that drives to a goal by itself."""

    def goal(self, x_m: float, y_m: float) -> Any: ...

    def state(self, now_s: float) -> PlannerState: ...


@dataclass(frozen=True, slots=True)
class RunSpec:
    """What decides a run: scene or its name or file, chance, and `fakes.faults.timetable` texts."""

    scene: Scene | str | Path
    seed: int
    faults: tuple[str, ...] = ()
    limit_s: float = LIMIT_S
    robot: str = ""  # of robots/; "": the shipped one

    @property
    def name(self) -> str:
        return self.scene.name if isinstance(self.scene, Scene) else Path(self.scene).stem


@dataclass(frozen=True, slots=True)
class Missed:
    """A goal that was not reached."""

    number: int  # from 1
    x_m: float
    y_m: float
    cause: str


@dataclass(frozen=True, slots=True)
class RunResult:
    """What came of a run."""

    scene: str
    seed: int
    faults: tuple[str, ...]
    ended: str  # in words
    goals: int
    reached: int
    missed: tuple[Missed, ...]
    collisions: tuple[Contact, ...]
    bumps: tuple[Contact, ...]  # of people into a robot that stood
    stops: tuple[Stop, ...]
    worst_stop_m: float
    least_gap_m: float  # inf: nothing came near
    driven_m: float
    sim_s: float
    cpu_s: float  # of computing, on one core
    digest: str  # of the true path and of all bytes on the link

    @property
    def false_stops(self) -> tuple[Stop, ...]:
        return tuple(stop for stop in self.stops if stop.is_false)


@dataclass(slots=True)
class Goals:
    """Which goal the robot is on its way to, and what became of the others."""

    all: Sequence[tuple[float, float]]
    at: int = -1  # the current one's place in `all`; -1: none was given yet
    reached: int = 0
    missed: list[Missed] = field(default_factory=list)

    @property
    def maybe_current(self) -> tuple[float, float] | None:
        """x, y; None before the first and after the last."""
        return self.all[self.at] if 0 <= self.at < len(self.all) else None

    def miss(self, number: int, cause: str) -> None:
        self.missed.append(Missed(number + 1, *self.all[number], cause))


class Run:
    """One run, a tick at a time; by default the planner in C, and the settings of its robot."""

    def __init__(
        self,
        spec: RunSpec,
        pilot: Pilot | None = None,
        config: Config | None = None,
        new_loop: Callable[..., Loop] = Loop,
    ) -> None:
        self.spec = spec
        scene = spec.scene
        self.scene = scene if isinstance(scene, Scene) else load_scene(scene, spec.seed)
        clear_m = self.scene.start_clear_m
        self.pilot = pilot or CPlanner(PlannerSettings(start_clear_m=clear_m))
        errors = as_the_sheets_say(self.scene.errors)
        config = config or rig_config(self.scene, settings_of(spec.robot))
        self.loop = new_loop(self.scene, spec.seed, config, self.pilot, errors=errors)
        self.loop.set_faults(spec.faults)
        self.judge = Judge(self.scene)
        self.watch = StopWatch(self.judge, faulty=bool(spec.faults))
        self.goals = Goals(self.scene.goals)
        self.ended = "" if self.goals.all else "the scene has no goals"
        self.state = self.pilot.state(self.loop.now_s)
        self._ticks_per_truth = round(self.loop.config.loop.rate_hz / RATE_HZ)
        self._stopped_s = self._stood_s = 0.0  # since the goal was given: planner, and robot
        self._digest = hashlib.blake2b(digest_size=16)
        self.loop.link_port.taps.append(lambda wire, way, data: self._digest.update(data))
        self._begun_s = time.process_time()

    @property
    def since_begin_s(self) -> float:
        return self.loop.since_begin_s

    def to_end(self, *each: Callable[["Run"], None]) -> RunResult:
        while not self.ended:
            self.step()
            for one in each:
                one(self)
        return self.result()

    def step(self) -> None:
        self.loop.step()
        if self.loop.ticks % self._ticks_per_truth == 0:
            self._look()

    def _look(self) -> None:
        truth = truth_of(self.loop.rig.world, self.since_begin_s)
        self.judge.step(truth)
        angles = truth.pitch_rad, truth.roll_rad
        self._digest.update(POSE.pack(truth.since_s, *truth.place, *angles, truth.height_m))
        self.state = self.pilot.state(self.loop.now_s)
        self.watch.step(self._orders())
        if self.judge.collisions:
            self._end("collision with " + self.judge.collisions[0].words())
        elif self.since_begin_s >= self.spec.limit_s:
            self._end(f"time was up after {self.spec.limit_s:.0f} s")
        else:
            self._follow_goals()

    def _orders(self) -> Orders:
        state, control = self.state, self.loop.app.pilot.control
        asked = bool(state.v_mps or state.w_radps)
        return Orders(
            asked,
            bool(control.v_mps or control.w_radps),
            control.blocked_by if asked and control.blocked_by else state.why,
            state.state in ("driving", "stopped"),
        )

    def _follow_goals(self) -> None:
        goal = self.goals.maybe_current
        if goal is None:
            if self.since_begin_s >= FIRST_GOAL_S:
                self._next_goal()
            return
        state, away_m = self.state.state, math.dist(self.judge.truth.place[:2], goal)
        self._stopped_s = self._stopped_s + 1.0 / RATE_HZ if state == "stopped" else 0.0
        self._stood_s = self._stood_s + 1.0 / RATE_HZ if self.judge.stands_s > 0.0 else 0.0
        near = away_m <= GOAL_RADIUS_M + NEAR_M
        if near and self._stood_s > (0.0 if state == "arrived" else DWELLS_S):
            self.goals.reached += 1
            self._next_goal()
        elif state == "arrived" and self._stood_s > 0.0:
            self._give_up(f"the planner took a place for it that is {away_m:.2f} m away")
        elif self._stopped_s >= GIVEN_UP_S or self._stood_s >= STUCK_S:
            self._give_up(f"{self.cause}, {away_m:.1f} m short of it")

    def _give_up(self, cause: str) -> None:
        self.goals.miss(self.goals.at, cause)
        self._next_goal()

    def _next_goal(self) -> None:
        self.goals.at += 1
        self._stopped_s = self._stood_s = 0.0
        goal = self.goals.maybe_current
        if goal is None:
            self.ended = "all goals were tried"
        else:
            self.pilot.goal(*goal)

    @property
    def cause(self) -> str:
        control = self.loop.app.pilot.control
        words = [f"the planner: {self.state.why}" if self.state.why else ""]
        words += [f"mapod: {control.blocked_by}" if control.blocked_by else ""]
        return "; ".join(filter(None, words)) or f"the planner is {self.state.state}"

    def _end(self, why: str) -> None:
        self.ended = why
        goal = self.goals.maybe_current
        if goal is not None:
            away_m = math.dist(self.judge.truth.place[:2], goal)
            self.goals.miss(self.goals.at, f"{why} ({self.cause}), {away_m:.1f} m short of it")
        for number in range(self.goals.at + 1, len(self.goals.all)):
            self.goals.miss(number, f"never tried: {why}")

    def result(self) -> RunResult:
        judge, goals = self.judge, self.goals
        return RunResult(
            scene=self.spec.name,
            seed=self.spec.seed,
            faults=self.spec.faults,
            ended=self.ended,
            goals=len(goals.all),
            reached=goals.reached,
            missed=tuple(goals.missed),
            collisions=tuple(judge.collisions),
            bumps=tuple(judge.bumps),
            stops=tuple(self.watch.stops),
            worst_stop_m=self.watch.worst_way_m,
            least_gap_m=judge.least_gap_m,
            driven_m=judge.driven_m,
            sim_s=self.since_begin_s,
            cpu_s=time.process_time() - self._begun_s,
            digest=self._digest.hexdigest(),
        )
