"""What the planner link does on lines of all rates: `python -m tools.bench.link [--quick]`.

A drive (`drive.py`) goes through mapod's own sender over a simulated line with 10 ms of delay and
1 % of the frames lost, both ways, to a receiver that acknowledges once a tick, ten times a second
or never. Only the cost of encoding is of this machine; all else is the same everywhere.
"""

import argparse
import sys
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from core.records import I8, I32, ObstacleMap
from tools.bench.drive import drive
from tools.bench.link_run import (
    DRIVE_S,
    START_S,
    Case,
    Figures,
    Lane,
    LinePort,
    measure,
    new_link,
    step,
)

QUICK_S = 10.0
LOSSY = (  # section 11
    Case(115_200, 25, "10 Hz"),
    Case(115_200, 25, "tick"),
    Case(115_200, 25, "none"),
    Case(115_200, 10, "10 Hz"),
    Case(115_200, 50, "10 Hz"),
    Case(230_400, 50, "10 Hz"),
    Case(921_600, 50, "10 Hz"),
    Case(921_600, 50, "tick"),
    Case(921_600, 50, "none"),
    Case(921_600, 50, "tick", 401),
)
LEGEND = """In ms: p50/p99/worst. "told": from the tick in which a cell is an obstacle to the tick
whose frames tell it; "held": until the receiver has it, with the time of the line and the delay.
"recovery": how long a cell that a loss has hit stays wrong. "wait": ticks of line time still to be
sent when a tick begins, worst. "kept": ticks in which nothing could be sent. "unsafe": cells FREE
at a receiver without doubt that was told of an OBSTACLE there."""
LINES = (115_200, 230_400, 460_800, 921_600, None)
WINDOWS = (101, 201, 401)
ADVISED_HZ = {(115_200, 201): 25, (115_200, 401): 10}  # section 8; 50 for all others
COST_CELLS, COST_RUN, COST_SETTLE_S, COST_TICKS = 40, 4, 30.0, 500


def advised(lines: tuple[int | None, ...], windows: tuple[int, ...]) -> list[Case]:
    return [
        Case(baud, ADVISED_HZ.get((baud or 0, size), 50), "tick", size)
        for size in windows
        for baud in lines
    ]


def print_table(title: str, cases: Iterable[Case], seconds: float) -> None:
    print(f"\n{title}: 1 % of frames lost, 10 ms one way, {seconds:g} s")
    print(
        f"{'line, rate, window, ACK':<28}{'new obstacle: told':>20}{'held':>14}{'recovery':>14}"
        f"{'pass s':>8}{'suspect %':>11}{'B/s':>7}{'wait':>6}{'kept':>5}{'unsafe':>7}"
    )
    for case in cases:
        print(row(case, measure(replace(case, seconds=seconds))), flush=True)


def row(case: Case, got: Figures) -> str:
    name = f"{case.line} {case.rate_hz} Hz {case.size} {case.ack}"
    return (
        f"{name:<28}{_slashed(got.told_ms):>20}{_slashed(got.held_ms):>14}"
        f"{_slashed(got.recovery_ms):>14}{got.pass_s:>8.2f}{100 * got.suspect:>11.0f}"
        f"{got.bytes_per_s:>7.0f}{got.worst_wait_ticks:>6.2f}{got.ticks_held:>5}{got.unsafe:>7}"
    )


def _slashed(times_ms: tuple[float, ...]) -> str:
    return "/".join(f"{ms:.0f}" for ms in times_ms)


class Clutter:
    """A window of short runs in which, when asked for, some cells near the middle change.

    Runs so short that a slice of the refresh is as many cells in a large window as in a small one.
    """

    def __init__(self, size: int, seed: int = 1) -> None:
        self._random = np.random.default_rng(seed)
        states = self._random.integers(-1, 2, (size, -(-size // COST_RUN)))
        self._cells: I8 = np.repeat(states, COST_RUN, axis=1)[:, :size].astype(np.int8)
        first = size // 2 * size + size // 2 - COST_CELLS // 2
        self._at: I32 = np.arange(first, first + COST_CELLS, dtype=np.int32)

    def next(self, changes: bool) -> ObstacleMap:
        at = self._at if changes else self._at[:0]
        self._cells.ravel()[at] = self._random.integers(-1, 2, at.size)
        return ObstacleMap(self._cells, 0, 0, at, 0, True)


def cost_us(size: int, baud: int = 115_200, rate_hz: int = 50) -> float:
    """Computing of one tick (lower quartile), with the same changes and bytes in any window."""
    down, up = Lane(baud, 0.0, 0.0, 1), Lane(baud, 0.0, 0.0, 2)
    port, clutter = LinePort(down, up), Clutter(size)
    link = new_link(port, baud, size, rate_hz)
    pose = drive(101, 1.0)[0].pose
    costs_s: list[float] = []
    settled = round(COST_SETTLE_S * rate_hz)
    for tick in range(settled + COST_TICKS):
        port.now_s = START_S + tick / rate_hz
        costs_s.append(step(link, port.now_s, pose, clutter.next(tick >= settled)))
        down.arrivals(port.now_s)
    return 1e6 * float(np.quantile(costs_s[-COST_TICKS:], 0.25))


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description="figures of the planner link")
    parser.add_argument("--quick", action="store_true", help="a short drive, fewer lines")
    quick = parser.parse_args(arguments).quick
    seconds = QUICK_S if quick else DRIVE_S
    print("planner link: simulated" + ("" if quick else ", some minutes"))
    print(LEGEND)
    print_table("Losses", LOSSY[:1] if quick else LOSSY, seconds)
    at_random = [replace(case, drives=False) for case in LOSSY]
    print_table("A map that changes at random", at_random[:1] if quick else at_random, seconds)
    lines, windows = (LINES[:1], WINDOWS[:2]) if quick else (LINES, WINDOWS)
    print_table("Lines and windows, as section 8 advises", advised(lines, windows), seconds)
    costs = {size: cost_us(size) for size in WINDOWS}
    print(f"\nOne tick of the sender, {COST_CELLS} changed cells, 115 200 baud, 50 Hz:")
    for size, cost in costs.items():
        print(f"  {size} x {size}: {cost:.0f} us, {cost / costs[101]:.2f} times that of 101 x 101")
    return 0


if __name__ == "__main__":
    sys.exit(main())
