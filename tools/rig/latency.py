"""Scan-to-link latency and tick lateness of the real process: `python -m tools.rig.latency`.

The unchanged main.py as a process of its own at 50 Hz x 541 beams and 201 x 201 cells; world and
fakes in another, which stamps each scan's last byte; this process is the planner's end and stamps
the arrival of the frames that carry the scan's map. All by one monotonic clock. First with the
machine left alone, then with all of its cores loaded.
"""

import argparse
import contextlib
import json
import math
import os
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from mapod_link.client import Link
from mapod_link.wires import UdpWire
from tools.cli.options import ROOT
from tools.rig.far_end import FarEnd, sent_from_file, told_scans
from tools.rig.load import loaded
from tools.settings import NotThereError, rewritten
from tools.terminal.processes import Child, RunError, Stop, ports_of, say

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
START_S, SETTLE_S = 120.0, 6.0  # until the map runs; and until the clocks are locked well
LINGER_S = 0.2  # for the last scan's map to arrive
OTHERS_PRIORITY = 10  # SCHED_FIFO of fakes and planner's end: they stand for other machines
GOAL_P99_S = 0.005
LEAST_TOLD = 0.99  # of the scans: what is never told has no latency
SHARED_MEMORY = "/dev/shm"
STEAL = 8  # field of the first line of /proc/stat
LAGS = "the world lags"  # what the fakes say once they could not keep up


@dataclass(frozen=True, slots=True)
class Figures:
    """What one measurement gave. Times in seconds; quantiles are (p50, p99, most)."""

    name: str
    seconds: float
    scans: int  # that left the scanner
    latency_s: tuple[float, float, float]
    told: int  # of those scans
    strangers: int  # ticks that fit no scan
    late_s: tuple[float, float]  # of the ticks: median of the medians, and the latest
    ticks: int
    missed: int
    locked: bool
    fifo: bool
    fakes_fifo: bool
    stolen_s: float  # by the host of a virtual machine, of all cores together

    @property
    def is_good(self) -> bool:
        """Within the goal, no tick lost, and hardly a scan that was never told."""
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


def stolen_s() -> float:
    """How long the host of this virtual machine, if it is one, has had its cores so far."""
    fields = Path("/proc/stat").read_text(encoding="ascii").partition("\n")[0].split()
    return int(fields[STEAL]) / os.sysconf("SC_CLK_TCK")


def events_of(app: Child) -> list[dict[str, Any]]:
    """What the app has logged so far, whole lines only."""
    lines = app.log.read_text(errors="replace").splitlines()
    return [json.loads(line) for line in lines if line.startswith("{") and line.endswith("}")]


class Bench:
    """World, app and planner's end, from start to end."""

    def __init__(self, folder: Path, options: argparse.Namespace, stop: Stop) -> None:
        self._folder, self._options, self._stop = folder, options, stop
        self.end = FarEnd(options.seed)
        self._wire = UdpWire("127.0.0.1", 0)
        self._link = Link(self._wire, self.end)
        self.children: list[Child] = []
        self.stamps = folder / "stamps.txt"
        self.fakes_fifo = False

    def start(self) -> None:
        """Fakes and app, up to a map that has settled.

        Raises:
            RunError: one of them fails, or there is no map in time.
        """
        options = self._options
        words = ["--scene", options.scene, "--seed", str(options.seed)]
        fakes = self._child("fakes", "-m", "fakes", *words, "--stamp", str(self.stamps))
        self.fakes_fifo = prefer(fakes.pid) and prefer(0)
        ports = ports_of(fakes, self._stop) or {}
        values = SETTINGS | {f"{name}.port": url for name, url in ports.items()}
        values["planner.port"] = self._wire.url
        config = self._folder / "mapod.toml"
        config.write_text(rewritten(Path(options.config).read_text(), values))
        self._child("app", str(ROOT / "main.py"), "--config", str(config))
        overdue_s = time.monotonic() + START_S
        while not self._runs() and not self._stop.wanted:
            self.step(0.05)
            if time.monotonic() > overdue_s:
                raise RunError(f"no map within {START_S:.0f} s")
        self.run(SETTLE_S)

    def _runs(self) -> bool:
        return not self.end.blank and self.end.pose is not None and self.end.pose.mode == 1

    def step(self, wait_s: float) -> float:
        """Hear and answer; gives the time."""
        for child in self.children:
            child.check_alive()
        return self._link.step(wait_s)

    def run(self, seconds: float, progress: Progress | None = None) -> None:
        """Measure for so long."""
        task = progress.add_task("measuring", total=seconds) if progress else None
        begin_s = now_s = time.monotonic()
        while now_s - begin_s < seconds and not self._stop.wanted:
            now_s = self.step(0.05)
            if progress and task is not None:
                progress.update(task, completed=min(seconds, now_s - begin_s))

    def close(self) -> list[str]:
        """All processes end; complaints."""
        complaints = [child.end() for child in reversed(self.children)]
        self._wire.close()
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
        return [words for words in complaints if words]

    def _child(self, name: str, *words: str) -> Child:
        self.children.append(Child(name, [sys.executable, *words], self._folder))
        return self.children[-1]


def measure(
    name: str, options: argparse.Namespace, stop: Stop, console: Console, load: bool
) -> Figures:
    """One measurement from start to end.

    Raises:
        RunError: a process failed, or did not end well.
    """
    # In memory: a log file on a disk that others keep busy would stall the app as it writes there.
    memory = SHARED_MEMORY if Path(SHARED_MEMORY).is_dir() else None
    with tempfile.TemporaryDirectory(prefix="mapod-realtime-", dir=memory) as name_of_folder:
        bench = Bench(Path(name_of_folder), options, stop)
        begun_s = ended_s = stolen = 0.0
        try:
            bench.start()
            before = events_of(bench.children[1])
            with contextlib.ExitStack() as stack:
                if load:
                    words = stack.enter_context(loaded(options.seconds + 60.0))
                    say(f"load: {words}")
                    bench.run(2.0)
                progress = stack.enter_context(Progress(console=console, transient=True))
                begun_s, stolen_before_s = time.monotonic(), stolen_s()
                bench.run(options.seconds, progress)
                ended_s, stolen = time.monotonic(), stolen_s() - stolen_before_s
            bench.run(LINGER_S)
        finally:
            complaints = bench.close()
        if LAGS in bench.children[0].last_words():
            complaints.append(f"the fakes say: {LAGS}: there is nothing to measure by")
        if complaints:
            raise RunError("\n".join(complaints))
        return replace(figures(name, bench, before, begun_s, ended_s), stolen_s=stolen)


def figures(
    name: str, bench: Bench, before: list[dict[str, Any]], begun_s: float, ended_s: float
) -> Figures:
    """What the stamps of both ends and the app's log say of a span of host time."""
    events = events_of(bench.children[1])
    taken = next((event for event in events if event["event"] == "real_time_taken"), {})
    counted = [event for event in events if event["event"] == "ticks_counted"]
    first = [event for event in before if event["event"] == "ticks_counted"][-1:]
    since = counted[len([event for event in before if event["event"] == "ticks_counted"]) :]
    ended: dict[str, Any] = next((one for one in events if one["event"] == "app_stopped"), {})
    scans = sent_from_file(bench.stamps, "scan")
    span = (burst for burst in bench.end.bursts if burst.arrived_s >= begun_s)
    told, strangers = told_scans(scans, list(span))
    inside = [one for one in told if begun_s <= one.scan.sent_s < ended_s]
    late_s = [event["latest_s"] or 0.0 for event in since]
    middle_s = [event["late_p50_s"] or 0.0 for event in since]
    return Figures(
        name=name,
        seconds=ended_s - begun_s,
        scans=sum(begun_s <= scan.sent_s < ended_s for scan in scans),
        latency_s=quantiles([one.latency_s for one in inside]),
        told=len(inside),
        strangers=strangers,
        late_s=(quantiles(middle_s)[0], max(late_s, default=math.nan)),
        ticks=int(ended.get("ticks", 0)),
        missed=int(ended.get("slots_missed", 0)) - sum(event["slots_missed"] for event in first),
        locked=bool(taken.get("memory_locked")),
        fifo=bool(taken.get("sched_fifo")),
        fakes_fifo=bench.fakes_fifo,
        stolen_s=0.0,
    )


def table_of(rows: Sequence[Figures]) -> Table:
    """All measurements side by side."""
    table = Table(title="50 Hz x 541 beams, 201 x 201 cells: last byte of a scan to its map")
    for heading in ("", "p50", "p99", "most", "scans told", "ticks late p50", "most", "ticks lost"):
        table.add_column(heading, justify="right")
    for row in rows:
        times = [f"{1000 * value:.2f} ms" for value in (*row.latency_s, *row.late_s)]
        told = f"{row.told} of {row.scans}"
        table.add_row(row.name, *times[:3], told, *times[3:], str(row.missed))
    return table


def permissions(row: Figures) -> list[str]:
    """What the machine permitted, and what it means where it did not."""
    fifo = "taken" if row.fifo else "not permitted (run as root, or give the user `rtprio 20`)"
    locked = "locked" if row.locked else "not locked (raise `memlock` in limits.conf)"
    others = "too" if row.fakes_fifo else "not: under load their own delays are in the figures"
    return [
        f"SCHED_FIFO {fifo}; memory {locked}; fakes and planner's end preferred {others}",
        f"{row.strangers} ticks of the link fit no scan" if row.strangers else "",
        f"{row.name}: the host of this virtual machine had its cores for {row.stolen_s:.2f} s"
        if row.stolen_s
        else "",
    ]


def main() -> int:
    """Exit status: 0 if the goal was met without load."""
    parser = argparse.ArgumentParser(prog="python -m tools.rig.latency", description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0, help="for each measurement (60)")
    parser.add_argument("--seed", type=int, default=1, help="of the world")
    parser.add_argument("--scene", default="corridor", help="which world")
    parser.add_argument("--config", default=str(ROOT / "mapod.toml"), help="the robot")
    parser.add_argument("--only", choices=("alone", "loaded"), help="one measurement of the two")
    options = parser.parse_args()
    console, rows = Console(), list[Figures]()
    with Stop().on_signals() as stop:
        for name in ("alone", "loaded"):
            if options.only in (None, name) and not stop.wanted:
                say(f"measuring for {options.seconds:g} s, the machine {name}")
                try:
                    rows.append(measure(name, options, stop, console, name == "loaded"))
                except (RunError, NotThereError) as error:
                    print(f"mapod: {error}", file=sys.stderr)
                    return 1
    if not rows:
        return 1
    console.print(table_of(rows))
    for line in dict.fromkeys(line for row in rows for line in permissions(row) if line):
        say(line)
    met = rows[0].is_good
    say(f"goal (p99 below {1000 * GOAL_P99_S:g} ms, no tick lost): {'met' if met else 'NOT met'}")
    return 0 if met else 1


if __name__ == "__main__":
    sys.exit(main())
