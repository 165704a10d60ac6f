"""What happens on the live rig, for the picture and the summary: goals, doubts, app, truth."""

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fakes.scenes.scene import Scene
from tools.rig.planner.host import PlannerState
from tools.rig.truth.judge import Judge, Truth
from tools.terminal.screen import MODES

GIVE_UP_S = 15.0  # that a planner says it has stopped
HEED_S = 1.0  # until a planner that was told a goal says so
Goal = tuple[float, float]


@dataclass(slots=True)
class Visit:
    """What became of one goal."""

    goal: Goal  # m, map frame
    begun_s: float
    ended_s: float | None = None
    why: str = ""  # it was not reached; "" while it may be, or where it was
    gap_m: float = math.nan  # in truth, at the end

    def words(self, now_s: float) -> str:
        where = f"({self.goal[0]:.1f}, {self.goal[1]:.1f}) m"
        took_s = (self.ended_s or now_s) - self.begun_s
        if self.ended_s is None:
            return f"{where} not reached in {took_s:.0f} s: the run ended before"
        if self.why:
            return f"{where} not reached: {self.why}"
        off = f", truly {self.gap_m:.2f} m off" if math.isfinite(self.gap_m) else ""
        return f"{where} reached in {took_s:.0f} s{off}"


class Tour:
    """Goals, one after the other: told to a planner, and kept what became of them."""

    def __init__(self, goals: Sequence[Goal], tell: Callable[[float, float], None]) -> None:
        self._left, self._tell = list(goals), tell
        self.total, self.visits = len(goals), list[Visit]()
        self._stopped_s: float | None = None

    @property
    def now(self) -> Visit | None:
        return self.visits[-1] if self.visits and self.visits[-1].ended_s is None else None

    @property
    def is_over(self) -> bool:
        return not self._left and self.now is None

    @property
    def reached(self) -> int:
        return sum(visit.ended_s is not None and not visit.why for visit in self.visits)

    def step(
        self, now_s: float, state: PlannerState | None, gap_m: Callable[[float, float], float]
    ) -> None:
        visit = self.now
        if visit is None:
            if self._left and state is not None:
                goal = self._left.pop(0)
                self.visits.append(Visit(goal, now_s))
                self._stopped_s = None
                self._tell(*goal)
            return
        if state is None or now_s - visit.begun_s < HEED_S:
            return
        if state.state == "arrived":
            visit.ended_s, visit.gap_m = now_s, gap_m(*visit.goal)
        elif state.state == "stopped":
            self._stopped_s = now_s if self._stopped_s is None else self._stopped_s
            if now_s - self._stopped_s >= GIVE_UP_S:
                visit.ended_s, visit.why, visit.gap_m = now_s, state.why, gap_m(*visit.goal)
        else:
            self._stopped_s = None


class Doubts:
    """When and why the link did not say that a robot may go, from the first "go" on."""

    def __init__(self) -> None:
        self._spans_s: dict[str, list[float]] = {}  # by cause
        self._now: tuple[str, float] | None = None  # cause and begin
        self._began = False

    def step(self, now_s: float, advice: str, why: str) -> None:
        """What a receiver says now; "stop" is a doubt."""
        kind, _, number = why.partition(" ")
        if kind == "mode" and number.isdigit() and int(number) < len(MODES):
            why = f"mode {MODES[int(number)]}"
        self._began |= advice != "stop"
        if advice != "stop":
            self._end(now_s)
        elif self._began and self._now is None:
            self._now = why, now_s

    def _end(self, now_s: float) -> None:
        if self._now is not None:
            why, begun_s = self._now
            self._spans_s.setdefault(why, []).append(now_s - begun_s)
            self._now = None

    def words(self, now_s: float) -> list[str]:
        """At the end, a line for each cause: how often, and how long at most."""
        self._end(now_s)
        return [
            f"{why}: {len(spans_s)} times, {max(spans_s):.2f} s at most"
            for why, spans_s in sorted(self._spans_s.items())
        ]


class JsonLines:
    """A file of JSON objects that another process writes, one a line, as it grows."""

    def __init__(self, path: Path) -> None:
        self._path, self._at, self._rest = path, 0, ""

    def added(self) -> list[dict[str, Any]]:
        """The whole lines since the last call; what is no object is left out."""
        if not self._path.exists():
            return []
        with self._path.open(encoding="utf-8", errors="replace") as file:
            file.seek(self._at)
            text = file.read()
            self._at = file.tell()
        *lines, self._rest = (self._rest + text).split("\n")
        return [json.loads(line) for line in lines if line.startswith("{")]


class AppLog:
    """What the app's log tells."""

    def __init__(self, path: Path) -> None:
        self._lines = JsonLines(path)
        self.ticks = self.missed = 0
        self.latest_s = 0.0  # tick
        self.blocked_by = ""  # why the app gives the wheels nothing
        self.real_time: dict[str, Any] = {}
        self.has_started = False
        self._causes: dict[str, str] = {}  # by device that does not run: why

    def step(self) -> None:
        for event in self._lines.added():
            match event.get("event"):
                case "ticks_counted":
                    self.ticks, self.missed = event["ticks"], event["slots_missed"]
                    self.latest_s = max(self.latest_s, event.get("latest_s") or 0.0)
                case "app_started":
                    self.has_started = True
                case "device_changed" if event["state"] == "running":
                    self._causes.pop(event["device"], None)
                case "device_changed":
                    self._causes[event["device"]] = event["cause"]
                case "drive_changed":
                    self.blocked_by = event["blocked_by"]
                case "real_time_taken":
                    self.real_time = event
                case _:
                    pass

    @property
    def missing(self) -> str:
        return "; ".join(f"{device}: {cause}" for device, cause in self._causes.items())

    @property
    def words(self) -> str:
        return f"{self.missed} ticks lost, late by {1000 * self.latest_s:.1f} ms at most"


class TruthLog:
    """What the fakes' process tells is true of the robot, and the judge who has seen all of it."""

    def __init__(self, path: Path, scene: Scene) -> None:
        self._lines, self.judge = JsonLines(path), Judge(scene)

    def step(self) -> None:
        for told in self._lines.added():
            if "since_s" not in told:  # the first line names the scene
                continue
            people = told.get("people")
            self.judge.step(
                Truth(
                    told["since_s"],
                    (told["x_m"], told["y_m"], told["yaw_rad"]),
                    told["z_m"],
                    told["pitch_rad"],
                    told["roll_rad"],
                    None if people is None else np.array(people, dtype=float).reshape(-1, 3),
                )
            )

    def gap_m(self, x_m: float, y_m: float) -> float:
        return math.dist(self.judge.truth.place[:2], (x_m, y_m))
