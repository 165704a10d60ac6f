"""What happens on the live rig, for the picture's head and the summary: goals, ticks, doubts."""

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tools.rig.c_planner import PlannerState
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
        """In a line."""
        where = f"({self.goal[0]:.1f}, {self.goal[1]:.1f}) m"
        took_s = (self.ended_s or now_s) - self.begun_s
        if self.ended_s is None:
            return f"{where} not reached in {took_s:.0f} s: {self.why or 'the run ended before'}"
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
        """The goal under way."""
        return self.visits[-1] if self.visits and self.visits[-1].ended_s is None else None

    @property
    def is_over(self) -> bool:
        """No goal is left."""
        return not self._left and self.now is None

    @property
    def reached(self) -> int:
        """Goals that the planner says it has come to."""
        return sum(visit.ended_s is not None and not visit.why for visit in self.visits)

    def step(
        self, now_s: float, state: PlannerState | None, gap_m: Callable[[float, float], float]
    ) -> None:
        """Look at what the planner is about; tell it the next goal where one is due."""
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


@dataclass(slots=True)
class Doubt:
    """A time during which the link did not say that a robot may go."""

    why: str
    begun_s: float
    ended_s: float | None = None


@dataclass(slots=True)
class Doubts:
    """All of them, from the first "go" on."""

    all: list[Doubt] = field(default_factory=list)
    _began: bool = False

    def step(self, now_s: float, advice: str, why: str) -> None:
        """What a receiver says now; "stop" is a doubt."""
        kind, _, number = why.partition(" ")
        if kind == "mode" and number.isdigit() and int(number) < len(MODES):
            why = f"mode {MODES[int(number)]}"
        self._began |= advice != "stop"
        if not self._began:
            return
        last = self.all[-1] if self.all and self.all[-1].ended_s is None else None
        if advice == "stop" and last is None:
            self.all.append(Doubt(why, now_s))
        elif advice != "stop" and last is not None:
            last.ended_s = now_s

    def words(self, now_s: float) -> list[str]:
        """A line for each cause: how often, and how long at most."""
        by_why: dict[str, list[float]] = {}
        for doubt in self.all:
            by_why.setdefault(doubt.why, []).append((doubt.ended_s or now_s) - doubt.begun_s)
        return [
            f"{why}: {len(spans)} times, {max(spans):.2f} s at most"
            for why, spans in sorted(by_why.items())
        ]


class AppLog:
    """The app's log, JSON lines in a file that grows."""

    def __init__(self, path: Path) -> None:
        self._path, self._at, self._rest = path, 0, ""
        self.ticks = self.missed = 0
        self.late_s = self.latest_s = 0.0  # ticks: latest of the last second, and of all
        self.blocked_by = ""  # why the app gives the wheels nothing
        self.real_time: dict[str, Any] = {}
        self.has_started = False
        self._causes: dict[str, str] = {}  # by device that does not run: why

    def step(self) -> None:
        """Take what was added."""
        if not self._path.exists():
            return
        with self._path.open(encoding="utf-8", errors="replace") as file:
            file.seek(self._at)
            added = file.read()
            self._at = file.tell()
        *lines, self._rest = (self._rest + added).split("\n")
        for line in lines:
            if line.startswith("{"):
                self._take(json.loads(line))

    def _take(self, event: dict[str, Any]) -> None:
        match event.get("event"):
            case "ticks_counted":
                self.ticks, self.missed = event["ticks"], event["slots_missed"]
                self.late_s = event.get("latest_s") or 0.0
                self.latest_s = max(self.latest_s, self.late_s)
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
        """Which devices do not run, and why."""
        return "; ".join(f"{device}: {cause}" for device, cause in self._causes.items())

    @property
    def words(self) -> str:
        """Ticks, in short."""
        return f"{self.missed} ticks lost, late by {1000 * self.latest_s:.1f} ms at most"
