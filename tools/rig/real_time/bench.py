"""The real process between its fakes and a planner's end that keeps when each scan's map arrived.

World and fakes are a process, the unchanged main.py is another; this process is the planner's end.
All by one monotonic clock.
"""

import bisect
import contextlib
import math
import os
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from fakes.planner_mcu.receiver import FakePlanner
from mapod_link.client import Link
from mapod_link.frames import POSE, Frame
from mapod_link.wires import UdpWire
from tools.cli.options import SHIPPED_CONFIG
from tools.rig.real_time.story import JsonLines
from tools.terminal.processes import RUNNING, RunError, SimulatedRobot, Stop

AGE_S, AGE_AT, AGE_MOST = 0.004, 20, 255  # in a POSE frame's body: unit, offset, "that or more"
NEAR_S = 0.009  # a mapped scan's instant, as told and as stamped, are no farther apart
SETTINGS: dict[str, str | float] = {
    "scanner.scan_rate_hz": 50,
    "scanner.angular_step_deg": 0.5,
    "scanner.first_deg": -45.0,
    "scanner.last_deg": 225.0,
    "map.cells": 201,
    "map.cell_m": 0.1,
    "obstacle.window_cells": 201,
    "log.level": "debug",
    "log.format": "json",
}
SETTLE_S = 6.0  # until the clocks are locked well
LINGER_S = 0.2  # for the last scan's map to arrive
OTHERS_PRIORITY = 10  # SCHED_FIFO of fakes and planner's end: they stand for other machines
SHARED_MEMORY = "/dev/shm"
LAGS = "the world lags"  # what the fakes say once they could not keep up


@dataclass(frozen=True, slots=True)
class Sent:
    """A scan as its fake stamped it; host monotonic seconds."""

    measured_s: float  # its last beam
    sent_s: float  # its last byte, handed to the system


@dataclass(frozen=True, slots=True)
class Burst:
    """What arrived of one tick of the link; host monotonic seconds."""

    t_ms: int  # of the tick, modulo 2^32
    arrived_s: float  # the last frame
    age: int | None = None  # of the newest mapped scan, in steps of AGE_S

    @property
    def maybe_mapped_s(self) -> float | None:
        """When the newest scan of the map was measured, to some 2 ms; None: long ago, or never."""
        if self.age is None or self.age >= AGE_MOST:
            return None
        ago_ms = (round(self.arrived_s * 1000) - self.t_ms + 2**31) % 2**32 - 2**31
        return self.arrived_s - ago_ms / 1000 - (self.age + 0.5) * AGE_S


@dataclass(frozen=True, slots=True)
class Told:
    """A scan whose map has arrived at the planner's end."""

    scan: Sent
    arrived_s: float

    @property
    def latency_s(self) -> float:
        return self.arrived_s - self.scan.sent_s


class FarEnd(FakePlanner):
    """A planner that keeps when each tick's frames arrived; the newest burst may still grow."""

    def __init__(self, seed: int = 0) -> None:
        super().__init__(seed, None, ack_every=4)
        self.bursts: list[Burst] = []

    def note(self, now_s: float, frame: Frame) -> None:
        super().note(now_s, frame)
        if not self.bursts or self.bursts[-1].t_ms != frame.t_ms:
            self.bursts.append(Burst(frame.t_ms, now_s))
        age = frame.body[AGE_AT] if frame.type == POSE else self.bursts[-1].age
        self.bursts[-1] = replace(self.bursts[-1], arrived_s=now_s, age=age)


def scans_from_file(path: Path) -> list[Sent]:
    rows = (line.split() for line in path.read_text(encoding="ascii").splitlines())
    return [Sent(float(row[1]), float(row[2])) for row in rows if len(row) == 3]


def told_scans(
    scans: Sequence[Sent], bursts: Sequence[Burst], unused_s: float = 0.0
) -> tuple[list[Told], int]:
    """Each scan that some tick was the first to tell of; and how many ticks fit no scan.

    Args:
        unused_s: how long a scan goes on after the last of its beams that the app uses.
    """
    instants_s = [scan.measured_s - unused_s for scan in scans]
    told: list[Told] = []
    newest, strangers = -1, 0
    for burst in bursts:
        mapped_s = burst.maybe_mapped_s
        if mapped_s is None:
            continue
        at = bisect.bisect(instants_s, mapped_s)
        near = min(
            range(max(0, at - 1), min(at + 1, len(scans))),
            key=lambda k: abs(instants_s[k] - mapped_s),
            default=None,
        )
        if near is None or abs(instants_s[near] - mapped_s) > NEAR_S:
            strangers += 1
        elif near > newest:
            newest = near
            told.append(Told(scans[near], burst.arrived_s))
    return told, strangers


def quantiles(values: Sequence[float]) -> tuple[float, float, float]:
    """(p50, p99, most); NaN of nothing."""
    ordered = sorted(values)
    if not ordered:
        return math.nan, math.nan, math.nan
    ranks = [max(0, math.ceil(part * len(ordered)) - 1) for part in (0.5, 0.99)]
    return ordered[ranks[0]], ordered[ranks[1]], ordered[-1]


def prefer(pid: int) -> bool:
    """Let a process go before all ordinary ones; False where that is not permitted."""
    alone = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK  # what it starts is ordinary
    try:
        os.sched_setscheduler(pid, alone, os.sched_param(OTHERS_PRIORITY))
    except OSError:
        return False
    return True


class Bench:
    """World, app and planner's end, from start to end."""

    def __init__(
        self,
        folder: Path,
        stop: Stop,
        settings: Mapping[str, object] = SETTINGS,
        world: Sequence[str] = (),
        robot: Path = SHIPPED_CONFIG,
    ) -> None:
        """`world`: more arguments of `python -m fakes`; `robot`: its file of settings."""
        self._stop, self._robot = stop, SimulatedRobot(folder)
        self._settings, self._world, self._file = settings, world, robot
        self.end, self._wire = FarEnd(), UdpWire("127.0.0.1", 0)
        self._link = Link(self._wire, self.end)
        self.stamps, self.log = folder / "stamps.txt", JsonLines(folder / "app.log")
        self.fakes_fifo = False

    def start(self) -> None:
        """Up to a map that has settled. Raises RunError: a process fails, or no map in time."""
        self.launch()
        while not (self._stop.wanted or self.has_map()):
            self.run(0.05)
        self.run(SETTLE_S)

    def launch(self) -> None:
        """World and app; without the app if the wait was broken off. Raises RunError."""
        robot = self._robot
        world = [sys.executable, "-m", "fakes", "--stamp", str(self.stamps), *self._world]
        settings = {**self._settings, "planner.port": self._wire.url}
        robot.start(world, self._file, settings, self._stop)
        self.fakes_fifo = prefer(robot.children[0].pid) and prefer(0)

    @property
    def pids(self) -> list[int]:
        """Of the world, and of the app once it runs."""
        return [child.pid for child in self._robot.children]

    def has_map(self) -> bool:
        """Whether an app that is in running order has told one. Raises RunError: not in time."""
        return self._robot.has_map(time.monotonic(), self.end, RUNNING)

    def run(self, seconds: float) -> None:
        until_s = time.monotonic() + seconds
        while time.monotonic() < until_s and not self._stop.wanted:
            for child in self._robot.children:
                child.check_alive()
            self._link.step(0.05)

    @contextlib.contextmanager
    def closed(self) -> Iterator[None]:
        """All end with the block. Raises RunError: they did not end well."""
        try:
            yield
        finally:
            complaints = self._robot.end()
            self._wire.close()
            os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
        if self._robot.children and LAGS in self._robot.children[0].last_words():
            complaints.append(f"the fakes say: {LAGS}: there is nothing to measure by")
        if complaints:
            raise RunError("\n".join(complaints))


@contextlib.contextmanager
def folder_in_memory() -> Iterator[Path]:
    """Where there is one: a log on a disk that others keep busy would stall the app."""
    memory = SHARED_MEMORY if Path(SHARED_MEMORY).is_dir() else None
    with tempfile.TemporaryDirectory(prefix="mapod-realtime-", dir=memory) as folder:
        yield Path(folder)


def latencies(
    bench: Bench, span_s: tuple[float, float], unused_s: float = 0.0
) -> tuple[int, list[float], int]:
    """Of a bench that is closed: scans sent within a span, their latencies, ticks of no scan."""
    begun_s, ended_s = span_s
    scans = scans_from_file(bench.stamps)
    bursts = [burst for burst in bench.end.bursts if burst.arrived_s >= begun_s]
    told, strangers = told_scans(scans, bursts, unused_s)
    inside = [one.latency_s for one in told if begun_s <= one.scan.sent_s < ended_s]
    return sum(begun_s <= scan.sent_s < ended_s for scan in scans), inside, strangers
