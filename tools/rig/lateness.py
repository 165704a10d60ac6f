"""How late ticks begin while a camera's images come fast: `python -m tools.rig.lateness`.

The unchanged main.py with the settings of robots/ragno.toml as a process of its own, and the camera
with a laser in another, which draws a few images and then shows them over and over: no machine that
runs both draws a hundred of them a second. The robot stands. All by the app's own log.
"""

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rich.console import Console
from rich.table import Table

from tools.cli.options import ROBOTS, configured, number_in
from tools.rig.real_time.bench import Bench, folder_in_memory, quantiles
from tools.settings import lens_of, wheels_of
from tools.terminal.processes import RunError, Stop, say

ROBOT = ROBOTS["ragno"]
RATES_HZ = (10.0, 30.0, 100.0)
COUNTED = "ticks_counted"  # of the log's events, each second
DRAWN = 16  # images: more than the app looks back at, to tell a camera that stands still


@dataclass(frozen=True, slots=True)
class Lateness:
    """What one measurement gave."""

    rate_hz: float  # of images
    mapped_hz: float  # that entered the map
    late_s: tuple[float, float, float]  # p50; of each second's latest tick: p50, most
    missed: int  # ticks


def measure(rate_hz: float, seconds: float, stop: Stop) -> Lateness:
    """One measurement from start to end. Raises RunError: a process failed, or did not end well."""
    config = configured(ROBOT)
    world = ["--no-driver", "--scanner", "stripe", "--lens", *map(str, lens_of(config))]
    world += ["--wheels", *map(str, wheels_of(config)), "--period", "1ms"]
    for fault in (f"rate_hz={rate_hz:g}", f"repeated={DRAWN}"):
        world += ["--fault", f"scanner.{fault}@0s"]
    settings = {"scanner.rate_hz": rate_hz, "log.level": "debug", "log.format": "json"}
    with folder_in_memory() as folder:
        bench = Bench(folder, stop, settings, world, ROBOT)
        with bench.closed():
            bench.start()
            begun = [event for event in bench.log.added() if event["event"] == COUNTED][-1:]
            bench.run(seconds)
            counted = [event for event in bench.log.added() if event["event"] == COUNTED]
    return lateness(rate_hz, begun + counted)


def lateness(rate_hz: float, counted: Sequence[Mapping[str, Any]]) -> Lateness:
    """Of what the app's log counts each second; the first is what was counted before."""
    first, *later = counted
    latest = quantiles([event["latest_s"] or 0.0 for event in later])
    return Lateness(
        rate_hz,
        (later[-1]["scans_added"] - first["scans_added"]) / len(later),
        (quantiles([event["late_p50_s"] or 0.0 for event in later])[0], latest[0], latest[2]),
        later[-1]["slots_missed"] - first["slots_missed"],
    )


def table_of(rows: Sequence[Lateness]) -> Table:
    table = Table(title="Ticks of a robot with a camera and a laser, 640 x 480 pixels")
    for heading in ("images/s", "mapped/s", "late p50", "latest p50", "latest", "ticks lost"):
        table.add_column(heading, justify="right")
    for row in rows:
        times = [f"{1000 * value:.2f} ms" for value in row.late_s]
        table.add_row(f"{row.rate_hz:g}", f"{row.mapped_hz:.1f}", *times, str(row.missed))
    return table


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tools.rig.lateness", description=__doc__)
    seconds = "for each measurement (20)"
    parser.add_argument("--seconds", type=number_in(3, 3600), default=20.0, help=seconds)
    options, rows = parser.parse_args(), list[Lateness]()
    with Stop().on_signals() as stop:
        for rate_hz in RATES_HZ:
            if stop.wanted:
                break
            say(f"measuring for {options.seconds:g} s, {rate_hz:g} images a second")
            try:
                rows.append(measure(rate_hz, options.seconds, stop))
            except RunError as error:
                print(f"mapod: {error}", file=sys.stderr)
                return 1
    Console().print(table_of(rows))
    return 0


if __name__ == "__main__":
    sys.exit(main())
