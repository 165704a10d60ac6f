"""What the real process uses: `python -m tools.bench.process`. CPU, wake-ups, calls, memory, start.

The unchanged main.py as a process of its own, with real sockets and ptys; world and fakes in
another, on another core where there is one, which hand bytes over every millisecond as a USB
adapter does; this process is the planner's end. Only /proc, strace, the app's log and the planner's
wire are looked at. Counts and ratios compare between machines, times do not.
"""

import argparse
import math
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from itertools import pairwise
from pathlib import Path
from typing import Any

from rich.console import Console

from tools.bench import syscalls
from tools.bench.history import FILE, entry, grown, keep, kept_entries, machine, table_of
from tools.bench.peer import rounds_from_text
from tools.bench.start_up import imports
from tools.bench.syscalls import StraceError, kernels_loaded
from tools.bench.usage import Usage, cpu_s, pin, rates_between, resident_mb, usage_of
from tools.cli.options import ROOT, SHIPPED_CONFIG, a_span
from tools.rig.real_time.bench import (
    LINGER_S,
    SETTLE_S,
    Bench,
    folder_in_memory,
    latencies,
    prefer,
    quantiles,
)
from tools.settings import NotThereError
from tools.terminal.processes import APP, Child, RunError, Stop, say

START = "start"  # of figures that no setting has
WORLD = ("--period", "1ms")
LOG = {"log.level": "debug", "log.format": "json"}  # a line a second more than shipped
SETTINGS: dict[str, Mapping[str, object]] = {
    "shipped": LOG,
    "fast": {
        **LOG,
        "scanner.scan_rate_hz": 50,
        "scanner.angular_step_deg": 0.5,
        "scanner.first_deg": -45.0,
        "scanner.last_deg": 225.0,
        "map.cells": 401,
        "map.cell_m": 0.05,
        "obstacle.window_cells": 401,
    },
}
UNUSED_S = {"shipped": (225 - 150) / 360 / 25, "fast": 0.0}  # of a scan, behind its last used beam
ABOUT = {"shipped": "25 Hz, 481 beams, 101 cells", "fast": "50 Hz, 541 beams, 401 cells"}
LEGEND = """Motors off, the world drives. Peer: a fixed round of Python and NumPy beside the app.
Libraries: `import numba, numpy`. Counts and ratios compare between machines, times do not."""
WINDOW_S = 1.0  # CPU time is that of the least of such windows: others on the machine only add
STRACE_S = 5.0
PEER = [sys.executable, "-m", "tools.bench.peer"]
POLL_S = 0.002  # while it starts
NONE = math.nan
CALLS_TOLD, WIDTH = 8, 100
ALLOWED = os.sched_getaffinity(0)
ROWS = (
    ("cpu_percent", "CPU, % of a core", 1),
    ("cpu_rounds_per_s", "  in rounds of the peer /s", 1),
    ("wakeups_per_s", "wake-ups of the loop /s", 0),
    ("other_wakeups_per_s", "  of other threads", 0),
    ("calls_per_s", "system calls /s", 0),
    ("resident_mb", "resident, MB", 0),
    ("locked_mb", "  of that locked", 0),
    ("minor_faults_per_s", "minor page faults /s", 1),
    ("major_faults", "major page faults", 0),
    ("latency_p50_ms", "scan to wire, ms, p50", 2),
    ("latency_p99_ms", "  p99", 2),
    ("scans_told", "scans told, %", 1),
    ("ticks_lost", "ticks lost", 0),
    ("first_frame_s", "start to first frame, s", 2),
    ("first_map_s", "  to map while running, s", 2),
    ("answered_to_map_s", "  devices answer to map, s", 2),
    ("first_map_cpu_s", "  CPU time to map, s", 2),
    ("first_map_ratio", "  CPU time / libraries'", 2),
    (f"{START}.modules", "modules imported", 0),
    (f"{START}.import_cpu_s", "  CPU time, s", 2),
    (f"{START}.import_ratio", "  CPU time / libraries'", 2),
    (f"{START}.kernels", "compiled kernels loaded", 0),
)


@dataclass(slots=True)
class Measured:
    """Of all settings: figures by "setting.name", calls a second by setting and name."""

    figures: dict[str, float]
    calls: dict[str, dict[str, float]]
    remarks: list[str]


class Watched:
    """One setting: the processes from start to end, and what was seen of them."""

    def __init__(self, setting: str, folder: Path, stop: Stop) -> None:
        self.figures: dict[str, float] = {}
        self.calls: dict[str, float] = {}  # a second, by name
        self.remarks: list[str] = []
        self.bench = Bench(folder, stop, SETTINGS[setting], WORLD)
        self._folder, self._setting = folder, setting
        self._stop, self._events = stop, list[dict[str, Any]]()
        self._span_s = math.nan, math.nan
        self._peer: Child | None = None

    @property
    def app(self) -> int:
        return self.bench.pids[-1]

    def start(self) -> None:
        """Up to a map that has settled. Raises RunError."""
        bench = self.bench
        bench.launch()
        begun_s = time.monotonic()
        self.remarks.append(placed(bench.pids))
        self._peer = Child("peer", PEER, self._folder)  # on this process's cores
        while not bench.end.bursts:
            self._wait(POLL_S)
        while not bench.has_map():
            self._wait(POLL_S)
        mapped_s, mapped_cpu_s = time.monotonic(), cpu_s(self.app)
        since_epoch_s = time.time() - mapped_s
        self._wait(SETTLE_S)
        answered_s = max(map(stamp_s, self._said("device_changed", state="running")), default=NONE)
        self.figures |= {
            "first_frame_s": bench.end.bursts[0].arrived_s - begun_s,
            "first_map_s": mapped_s - begun_s,
            "answered_to_map_s": mapped_s + since_epoch_s - answered_s,
            "first_map_cpu_s": mapped_cpu_s,
        }

    def measure(self, seconds: float) -> None:
        """So long, as it is."""
        counted, seen = self._said("ticks_counted"), [usage_of(self.app)]
        for _ in range(max(1, round(seconds / WINDOW_S))):
            self._wait(WINDOW_S)
            seen.append(usage_of(self.app))
        self._span_s = seen[0].at_s, seen[-1].at_s
        whole = rates_between(seen[0], seen[-1])
        resident, locked = resident_mb(self.app)
        lost = [event["slots_missed"] for event in (*counted[-1:], *self._said("ticks_counted"))]
        self.figures |= {
            "cpu_percent": 100 * least_cpu(seen),
            "cpu_rounds_per_s": self._rounds_per_s(seen),
            "wakeups_per_s": whole.wakeups,
            "other_wakeups_per_s": whole.other_wakeups,
            "minor_faults_per_s": whole.minor_faults,
            "major_faults": whole.major_faults,
            "resident_mb": resident,
            "locked_mb": locked,
            "ticks_lost": lost[-1] - lost[0] if lost else NONE,
        }

    def count_calls(self, seconds: float) -> None:
        """Apart, since it slows the app."""
        try:
            self.calls = syscalls.calls_per_s(self.app, lambda: self._wait(seconds), prefer)
        except StraceError as error:
            self.remarks.append(f"system calls are not counted: {error}")
        else:
            self.figures["calls_per_s"] = sum(self.calls.values())

    def judge_latency(self) -> None:
        """Once all have ended: the fakes write their stamps then."""
        scans, latencies_s, _ = latencies(self.bench, self._span_s, UNUSED_S[self._setting])
        p50_s, p99_s, _ = quantiles(latencies_s)
        self.figures |= {
            "latency_p50_ms": 1000 * p50_s,
            "latency_p99_ms": 1000 * p99_s,
            "scans_told": 100 * len(latencies_s) / scans if scans else NONE,
        }

    def _rounds_per_s(self, seen: Sequence[Usage]) -> float:
        """CPU time in rounds of the peer, each of its least window. Raises RunError."""
        assert self._peer is not None
        if complaint := self._peer.end():
            raise RunError(complaint)
        rounds = rounds_from_text(self._peer.out.read_text(encoding="ascii"))
        spans = [
            [spent for at_s, spent in rounds if before.at_s <= at_s < after.at_s]
            for before, after in pairwise(seen)
        ]
        return least_cpu(seen) / min(statistics.mean(span) for span in spans if span)

    def _wait(self, seconds: float) -> None:
        if self._stop.wanted:
            raise RunError("told to end")
        self.bench.run(seconds)

    def _said(self, event: str, **about: object) -> list[dict[str, Any]]:
        """Lines of the app's log that are new since the last call."""
        return [
            line
            for line in self.bench.log.added()
            if line["event"] == event and about.items() <= line.items()
        ]


def least_cpu(seen: Sequence[Usage]) -> float:
    """Share of a core in the least of the windows."""
    return min(rates_between(before, after).cpu for before, after in pairwise(seen))


def stamp_s(line: dict[str, Any]) -> float:
    """Of a line of the log, seconds since the epoch."""
    return datetime.fromisoformat(line["timestamp"]).timestamp()


def placed(pids: Sequence[int]) -> str:
    """The app on a core of its own, where there are two; in words."""
    *others, own = sorted(ALLOWED)
    if not others:
        return "one core for all: fakes and planner's end disturb the app"
    for pid in (*pids[:-1], os.getpid()):
        pin(pid, set(others))
    pin(pids[-1], {own})
    return f"the app alone on core {own}, fakes and planner's end on {', '.join(map(str, others))}"


def watched(setting: str, seconds: float, stop: Stop) -> Watched:
    """One setting from start to end. Raises RunError."""
    try:
        with folder_in_memory() as folder:
            seen = Watched(setting, folder, stop)
            with seen.bench.closed():
                seen.start()
                seen.measure(seconds)
                seen.bench.run(LINGER_S)
                seen.count_calls(min(seconds, STRACE_S))
            seen.judge_latency()
    finally:
        os.sched_setaffinity(0, ALLOWED)
    return seen


def started() -> tuple[dict[str, float], list[str]]:
    """What a start takes, whatever the settings; remarks."""
    took = imports()
    figures = {
        "modules": took.modules,
        "import_cpu_s": took.cpu_s,
        "libraries_cpu_s": took.libraries_cpu_s,
        "import_ratio": took.ratio,
    }
    with folder_in_memory() as folder:
        config = folder / "mapod.toml"
        config.write_text(SHIPPED_CONFIG.read_text(encoding="utf-8"), encoding="utf-8")
        warm = [*APP, str(config), "--warm"]
        subprocess.run(warm, cwd=ROOT, check=True)  # compiles what is not on disk
        try:
            figures["kernels"] = kernels_loaded(warm, ROOT)
        except StraceError as error:
            return figures, [f"kernels are not counted: {error}"]
    return figures, []


def measured(seconds: float, stop: Stop, names: Sequence[str]) -> Measured:
    """All settings, and what a start takes. Raises RunError."""
    own, remarks = started()
    all_of = Measured({f"{START}.{name}": value for name, value in own.items()}, {}, remarks)
    for name in names:
        say(f"measuring {ABOUT[name]} for {seconds:g} s")
        seen = watched(name, seconds, stop)
        seen.figures["first_map_ratio"] = seen.figures["first_map_cpu_s"] / own["libraries_cpu_s"]
        all_of.figures |= {f"{name}.{figure}": value for figure, value in seen.figures.items()}
        all_of.calls[name] = seen.calls
        all_of.remarks += [words for words in seen.remarks if words not in all_of.remarks]
    return all_of


def show(new: Measured, names: Sequence[str], kept: Mapping[str, Any] | None) -> None:
    """The table, and what stands beside it."""
    say("; ".join(f"{name}: {ABOUT[name]}" for name in names))
    Console(width=WIDTH).print(table_of(names, ROWS, new.figures, kept))
    print(LEGEND)
    for name, calls in new.calls.items():
        if calls:
            most = [f"{call} {count:.0f}" for call, count in [*calls.items()][:CALLS_TOLD]]
            say(f"{name}, system calls a second: {', '.join(most)}")
    for remark in new.remarks:
        say(remark)
    if kept and kept["machine"] != machine():
        say(f"kept last on another machine: {kept['machine']}")


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tools.bench.process", description=__doc__)
    parser.add_argument("--seconds", type=a_span, default=15.0, help="for each setting (15)")
    parser.add_argument("--only", choices=SETTINGS, help="one setting of the two")
    parser.add_argument("--keep", action="store_true", help=f"add them to {FILE.name}")
    options = parser.parse_args()
    names = [name for name in SETTINGS if options.only in (None, name)]
    if options.keep and options.only:
        parser.error("--keep: only both settings are kept, leave out --only")
    entries = kept_entries()
    kept = entries[-1] if entries else None
    with Stop().on_signals() as stop:
        try:
            new = measured(options.seconds, stop, names)
        except (RunError, NotThereError, OSError) as error:
            print(f"mapod: {error}", file=sys.stderr)
            return 1
    show(new, names, kept)
    worse = grown(kept["figures"], new.figures) if kept else []
    for words in worse:
        say(f"grown: {words}")
    if options.keep:
        keep(entry(new.figures, new.calls))
        say(f"kept in {FILE.relative_to(ROOT)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
