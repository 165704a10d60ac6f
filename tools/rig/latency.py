"""Scan-to-link latency and tick lateness of the real process: `python -m tools.rig.latency`.

The unchanged main.py as a process of its own at 50 Hz x 541 beams and 201 x 201 cells; world and
fakes in another, which stamps each scan's last byte; this process is the planner's end and stamps
the arrival of the frames that carry the scan's map. All by one monotonic clock. First with the
machine left alone, then with all of its cores loaded.
"""

import argparse
import contextlib
import math
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from rich.console import Console
from rich.table import Table

from tools.rig.real_time.bench import LINGER_S, Bench, folder_in_memory, latencies, quantiles
from tools.rig.real_time.load import loaded
from tools.terminal.processes import RunError, Stop, say

LOADED_S = 2.0  # for the load to begin
GOAL_P99_S = 0.005
LEAST_TOLD = 0.99  # of the scans: what is never told has no latency


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
