"""Scan-to-link latency and tick lateness of the real process: `python -m tools.rig.latency`.

The unchanged main.py as a process of its own at 50 Hz x 541 beams and 201 x 201 cells; world and
fakes in another, which stamps each scan's last byte; this process is the planner's end and stamps
the arrival of the frames that carry the scan's map. All by one monotonic clock. First with the
machine left alone, then with all of its cores loaded.
"""

import argparse
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
from typing import Any

from rich.console import Console
from rich.table import Table

from fakes.planner_mcu.receiver import FakePlanner
from mapod_link.client import Link
from mapod_link.frames import POSE, Frame
from mapod_link.wires import UdpWire
from tools.cli.options import SHIPPED_CONFIG
from tools.rig.load import loaded
from tools.rig.story import JsonLines
from tools.terminal.processes import RUNNING, RunError, SimulatedRobot, Stop, say

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
LOADED_S, LINGER_S = 2.0, 0.2  # for the load to begin; for the last scan's map to arrive
OTHERS_PRIORITY = 10  # SCHED_FIFO of fakes and planner's end: they stand for other machines
GOAL_P99_S = 0.005
LEAST_TOLD = 0.99  # of the scans: what is never told has no latency
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


@dataclass(frozen=True, slots=True)
class Figures:
    """What one measurement gave. Times in seconds."""

    name: str
    scans: int  # that left the scanner
    told: int  # of those scans
    strangers: int  # ticks that fit no scan
    latency_s: tuple[float, float, float]  # p50, p99, most
    late_s: tuple[float, float]  # of the ticks: median of the medians, and the latest
    ticks: int
    missed: int
    rights: str  # what the machine permitted, and what it means where it did not

    @property
    def is_good(self) -> bool:
        complete = self.told >= LEAST_TOLD * self.scans > 0
        known = self.strangers <= (1 - LEAST_TOLD) * self.scans
        return self.latency_s[1] < GOAL_P99_S and not self.missed and complete and known


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


def measure(name: str, seconds: float, stop: Stop, load: bool) -> Figures:
    """One measurement from start to end. Raises RunError: a process failed, or did not end well."""
    with folder_in_memory() as folder:
        bench = Bench(folder, stop)
        with bench.closed():
            bench.start()
            with contextlib.ExitStack() as stack:
                if load:
                    say(f"load: {stack.enter_context(loaded(seconds + 60.0))}")
                    bench.run(LOADED_S)
                before, begun_s = bench.log.added(), time.monotonic()
                bench.run(seconds)
                ended_s = time.monotonic()
            bench.run(LINGER_S)
        return figures(name, bench, before, (begun_s, ended_s))


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


def figures(
    name: str, bench: Bench, before: list[dict[str, Any]], span_s: tuple[float, float]
) -> Figures:
    after = bench.log.added()
    counted, earlier = (
        [event for event in events if event["event"] == "ticks_counted"]
        for events in (after, before)
    )
    ended = next((event for event in after if event["event"] == "app_stopped"), {})
    rights = next((event for event in before if event["event"] == "real_time_taken"), {})
    scans, latencies_s, strangers = latencies(bench, span_s)
    return Figures(
        name=name,
        scans=scans,
        told=len(latencies_s),
        strangers=strangers,
        latency_s=quantiles(latencies_s),
        late_s=(
            quantiles([event["late_p50_s"] or 0.0 for event in counted])[0],
            max((event["latest_s"] or 0.0 for event in counted), default=math.nan),
        ),
        ticks=ended.get("ticks", 0),
        missed=ended.get("slots_missed", 0) - (earlier[-1]["slots_missed"] if earlier else 0),
        rights=rights_words(rights, bench.fakes_fifo),
    )


def rights_words(taken: dict[str, Any], fakes_fifo: bool) -> str:
    no_fifo = "not permitted (run as root, or give the user `rtprio 20`)"
    not_locked = "not locked (raise `memlock` in limits.conf)"
    others = "too" if fakes_fifo else "not: under load their own delays are in the figures"
    return (
        f"SCHED_FIFO {'taken' if taken.get('sched_fifo') else no_fifo}; "
        f"memory {'locked' if taken.get('memory_locked') else not_locked}; "
        f"fakes and planner's end preferred {others}"
    )


def table_of(rows: Sequence[Figures]) -> Table:
    table = Table(title="50 Hz x 541 beams, 201 x 201 cells: last byte of a scan to its map")
    for heading in ("", "p50", "p99", "most", "scans told", "ticks late p50", "most", "ticks lost"):
        table.add_column(heading, justify="right")
    for row in rows:
        times = [f"{1000 * value:.2f} ms" for value in (*row.latency_s, *row.late_s)]
        told = f"{row.told} of {row.scans}"
        table.add_row(row.name, *times[:3], told, *times[3:], str(row.missed))
    return table


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tools.rig.latency", description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0, help="for each measurement (60)")
    parser.add_argument("--only", choices=("alone", "loaded"), help="one measurement of the two")
    options, rows = parser.parse_args(), list[Figures]()
    with Stop().on_signals() as stop:
        for name in ("alone", "loaded"):
            if options.only in (None, name) and not stop.wanted:
                say(f"measuring for {options.seconds:g} s, the machine {name}")
                try:
                    rows.append(measure(name, options.seconds, stop, name == "loaded"))
                except RunError as error:
                    print(f"mapod: {error}", file=sys.stderr)
                    return 1
    if not rows:
        return 1
    Console().print(table_of(rows))
    say(rows[0].rights)
    for row in rows:
        if row.strangers:
            say(f"{row.name}: {row.strangers} ticks of the link fit no scan")
    met = rows[0].is_good
    say(f"goal (p99 below {1000 * GOAL_P99_S:g} ms, no tick lost): {'met' if met else 'NOT met'}")
    return 0 if met else 1


if __name__ == "__main__":
    sys.exit(main())
