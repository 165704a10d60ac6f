"""What the real process uses: `python -m tools.bench.process`. CPU, wake-ups, calls, memory, start.

The unchanged main.py as a process of its own, with real sockets and ptys; world and fakes in
another, on another core where there is one, which hand bytes over every millisecond as a USB
adapter does; this process is the planner's end. Only /proc, strace, the app's log and the planner's
wire are looked at. Counts and ratios compare between machines, times do not.
"""

import argparse
import math
import os
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from rich.console import Console

from tools.bench import syscalls
from tools.bench.history import FILE, entry, grown, keep, kept_entries, table_of
from tools.bench.start_up import imports, peer_s
from tools.bench.syscalls import StraceError, kernels_loaded
from tools.bench.usage import Rates, cpu_s, pin, rates_between, resident_mb, usage_of
from tools.cli.options import ROOT, SHIPPED_CONFIG, a_span
from tools.rig.latency import (
    LINGER_S,
    SETTLE_S,
    Bench,
    folder_in_memory,
    latencies,
    prefer,
    quantiles,
)
from tools.terminal.processes import APP, RunError, Stop, say

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
HEADINGS = {"shipped": "25 Hz, 101 cells", "fast": "50 Hz, 541 beams, 401 cells"}
WINDOW_S = 3.0  # CPU time is that of the least of such windows: others on the machine only add
STRACE_S = 5.0
POLL_S = 0.002  # while it starts
START = "start"  # of figures that no setting has
NONE = math.nan
CALLS_TOLD = 8
ALLOWED = os.sched_getaffinity(0)
ROWS = (
    ("cpu_percent", "CPU, % of a core", 1),
    ("system_percent", "  of that in the kernel, some", 1),
    ("cpu_rounds_per_s", "CPU, in rounds of a peer a second", 1),
    ("wakeups_per_s", "wake-ups of the loop a second", 0),
    ("other_wakeups_per_s", "wake-ups of other threads a second", 0),
    ("calls_per_s", "system calls a second", 0),
    ("resident_mb", "resident, MB", 0),
    ("locked_mb", "  of that locked", 0),
    ("minor_faults_per_s", "minor faults a second", 1),
    ("major_faults", "major faults", 0),
    ("latency_p50_ms", "scan to wire, ms: p50", 2),
    ("latency_p99_ms", "  p99", 2),
    ("ticks_lost", "ticks lost", 0),
    ("first_frame_s", "process start to first frame, s", 2),
    ("first_map_s", "  to first map while running, s", 2),
    ("answered_to_map_s", "  from the last device's answer to it, s", 2),
    ("first_map_cpu_s", "  CPU time until then, s", 2),
    ("first_map_ratio", "  CPU time against import numba, numpy", 2),
)
START_ROWS = (
    ("modules", "modules that `import main` loads", 0),
    ("import_cpu_s", "  its CPU time, s", 2),
    ("import_ratio", "  against import numba, numpy", 2),
    ("kernels", "compiled kernels loaded", 0),
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
        self._stop, self._events = stop, list[dict[str, Any]]()
        self._span_s = math.nan, math.nan

    @property
    def app(self) -> int:
        return self.bench.pids[-1]

    def start(self) -> None:
        """Up to a map that has settled. Raises RunError."""
        bench = self.bench
        bench.launch()
        begun_s = time.monotonic()
        self.remarks.append(placed(bench.pids))
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
        first = last = usage_of(self.app)
        counted = self._said("ticks_counted")
        cpu: list[Rates] = []
        for _ in range(max(1, round(seconds / WINDOW_S))):
            self._wait(WINDOW_S)
            before, last = last, usage_of(self.app)
            cpu.append(rates_between(before, last))
        self._span_s = first.at_s, last.at_s
        whole, least = rates_between(first, last), min(cpu, key=lambda window: window.cpu)
        resident, locked = resident_mb(self.app)
        lost = [event["slots_missed"] for event in (*counted[-1:], *self._said("ticks_counted"))]
        self.figures |= {
            "cpu_percent": 100 * least.cpu,
            "system_percent": 100 * least.cpu * whole.system / whole.cpu,
            "wakeups_per_s": whole.wakeups,
            "other_wakeups_per_s": whole.other_wakeups,
            "minor_faults_per_s": whole.minor_faults,
            "major_faults": whole.major_faults,
            "resident_mb": resident,
            "locked_mb": locked,
            "ticks_lost": lost[-1] - lost[0] if lost else NONE,
        }

    def count_calls(self) -> None:
        """Apart, since it slows the app."""
        try:
            self.calls = syscalls.calls_per_s(self.app, lambda: self._wait(STRACE_S), prefer)
        except StraceError as error:
            self.remarks.append(f"system calls are not counted: {error}")
        else:
            self.figures["calls_per_s"] = sum(self.calls.values())

    def judge_latency(self) -> None:
        """Once all have ended: the fakes write their stamps then."""
        scans, latencies_s, _ = latencies(self.bench, self._span_s)
        p50_s, p99_s, _ = quantiles(latencies_s)
        self.figures |= {
            "latency_p50_ms": 1000 * p50_s,
            "latency_p99_ms": 1000 * p99_s,
            "scans_told": len(latencies_s) / scans if scans else NONE,
        }

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
                seen.count_calls()
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
        "peer_s": peer_s(),
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
        say(f"measuring {HEADINGS[name]} for {seconds:g} s")
        seen = watched(name, seconds, stop)
        peer = min(own["peer_s"], peer_s())
        seen.figures["cpu_rounds_per_s"] = seen.figures["cpu_percent"] / 100 / peer
        seen.figures["first_map_ratio"] = seen.figures["first_map_cpu_s"] / own["libraries_cpu_s"]
        all_of.figures |= {f"{name}.{figure}": value for figure, value in seen.figures.items()}
        all_of.calls[name] = seen.calls
        all_of.remarks += [words for words in seen.remarks if words not in all_of.remarks]
    return all_of


def show(new: Measured, names: Sequence[str], kept: Mapping[str, Any] | None) -> None:
    console = Console()
    shown = {name: HEADINGS[name] for name in names}
    console.print(table_of(shown, ROWS, new.figures, kept))
    console.print(table_of({START: "start"}, START_ROWS, new.figures, kept))
    for name, calls in new.calls.items():
        if calls:
            most = [f"{call} {count:.0f}" for call, count in [*calls.items()][:CALLS_TOLD]]
            say(f"{HEADINGS[name]}, calls a second: {', '.join(most)}")
    for remark in new.remarks:
        say(remark)


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
        except RunError as error:
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
