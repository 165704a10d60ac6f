"""What the planner link does on lines of all rates: `python -m tools.bench.link [--quick]`.

The synthetic drive (`drive_scene.py`) goes through mapod's own sender over a simulated line
with 10 ms of delay and 1 % of the frames lost, both ways, to a receiver that acknowledges once a
tick, ten times a second or never. Printed beside the figures of the planner link, sections 10
and 11. Only the cost of encoding is of this machine; all else is the same everywhere.
"""

import argparse
import sys
from dataclasses import replace

import numpy as np

from core.records import I8, I32, ObstacleMap
from tools.bench.drive_building import Place
from tools.bench.drive_figures import sizes
from tools.bench.drive_scene import SCANS_S
from tools.bench.link_line import Lane, LinePort
from tools.bench.link_run import START_S, Case, Figures, measure, new_link, step

QUICK_S = 10.0
RATES_HZ = (10, 25, 50)
DRIVE_SHEET = {  # section 10: whole map mean, worst; changes with pose and headers, bytes a second
    ("tilted", 101): (559, 1904, 2684, 4788, 6815),
    ("tilted", 201): (2078, 3888, 4241, 6965, 8980),
    ("tilted", 401): (3731, 5467, 4266, 6988, 9005),
    ("level", 101): (147, 440, 2019, 3188, 4795),
    ("level", 201): (543, 1025, 3839, 5525, 7510),
    ("level", 401): (2343, 3155, 5540, 8495, 11175),
}
SEEDS = (1, 2, 3)
LOSS_SHEET = (  # section 11: new obstacle and recovery in ms, refresh pass in s, suspect in %
    (Case(115_200, 25, "10 Hz"), "0/0/160", "120/480", "0.53", "10"),
    (Case(115_200, 25, "tick"), "", "", "", ""),
    (Case(115_200, 25, "none"), "0/0/1040", "200/920", "0.52", "33"),
    (Case(115_200, 10, "10 Hz"), "0/0/100", "100/100", "0.49", "2"),
    (Case(115_200, 50, "10 Hz"), "0/0/100", "120/980", "0.83", "14"),
    (Case(230_400, 50, "10 Hz"), "0/0/80", "60/200", "0.18", "6"),
    (Case(921_600, 50, "10 Hz"), "0/0/100", "20/98", "0.18", "6"),
    (Case(921_600, 50, "tick"), "0/0/40", "20/40", "0.18", "2"),
    (Case(921_600, 50, "none"), "0/0/120", "40/180", "0.18", "16"),
    (Case(921_600, 50, "tick", 401), "0/0/40", "20/40", "0.16", "3"),
)
LEGEND = """in brackets the sheet's (section 11). In ms: p50/p99/worst. "told": from the tick in
which a cell is an obstacle to the tick whose frames tell it; "held": until the receiver has it,
with the time of the line and the delay. "wait": ticks of line time still to be sent when a tick
begins, worst. "kept": ticks in which nothing could be sent. "unsafe": cells FREE at a receiver
without doubt that was told of an OBSTACLE there."""
LINES = (115_200, 230_400, 460_800, 921_600, None)
WINDOWS = (101, 201, 401)
ADVISED_HZ = {(115_200, 201): 25, (115_200, 401): 10}  # section 8; 50 for all others
COST_CELLS, COST_RUN, COST_SETTLE_S, COST_TICKS = 40, 4, 30.0, 500


def print_drive(seconds: float, windows: tuple[int, ...] = WINDOWS) -> None:
    """How big the maps of the drive are, beside those that the sheet was measured with."""
    print(f"\nThe synthetic drive, {seconds:g} s; in brackets the sheet's (section 10), bytes")
    print(f"{'':<14}{'whole map, mean':>22}{'worst':>18}", end="")
    print("".join(f"{f'changes a second, {rate} Hz':>28}" for rate in RATES_HZ))
    for (scanner, size), sheet in DRIVE_SHEET.items():
        if size not in windows:
            continue
        got = sizes(scanner, size, seconds, RATES_HZ)
        values = [got.full_mean, got.full_worst, *got.wire_per_s.values()]
        widths = (22, 18, 28, 28, 28)
        cells = zip(values, sheet, widths, strict=True)
        print(f"{scanner + ' ' + str(size):<14}", end="")
        print("".join(f"{f'{value:.0f} ({said})':>{width}}" for value, said, width in cells))


def print_loss(seconds: float, seeds: tuple[int, ...]) -> None:
    """The rows of section 11."""
    print(f"\n1 % of frames lost, 10 ms one way, tilted, {len(seeds)} drives of {seconds:g} s;")
    print(LEGEND)
    _print_head()
    for case, obstacle, recovery, pass_s, suspect in LOSS_SHEET:
        got = measure(replace(case, seconds=seconds, seeds=seeds))
        print_row(case, got, (obstacle, recovery, pass_s, suspect))


def print_grid(seconds: float, lines: tuple[int | None, ...] = LINES) -> None:
    """Every line with every window, at the rate that section 8 advises."""
    print(f"\nEvery line and window at the rate of section 8, ACK once a tick, {seconds:g} s")
    _print_head()
    for scanner in ("tilted", "level"):
        for baud in lines:
            for size in WINDOWS:
                rate_hz = ADVISED_HZ.get((baud or 0, size), 50)
                case = Case(baud, rate_hz, "tick", size, scanner, seconds=seconds)
                print_row(case, measure(case), ("", "", "", ""))


def _print_head() -> None:
    print(
        f"{'line, rate, window, ACK':<34}{'new obstacle: told':>22}{'held':>14}"
        f"{'recovery':>24}{'pass s':>14}{'suspect %':>14}{'B/s':>7}{'wait':>6}{'kept':>5}"
        f"{'unsafe':>7}"
    )


def print_row(case: Case, got: Figures, sheet: tuple[str, str, str, str]) -> None:
    """One line of a table."""
    said = [f" ({text})" if text else "" for text in sheet]
    name = f"{case.line} {case.rate_hz} Hz {case.size} {case.scanner} {case.ack}"
    print(
        f"{name:<34}"
        f"{_slashed(got.told_ms) + said[0]:>22}{_slashed(got.held_ms):>14}"
        f"{_slashed(got.recovery_ms) + said[1]:>24}{f'{got.pass_s:.2f}' + said[2]:>14}"
        f"{f'{100 * got.suspect:.0f}' + said[3]:>14}{got.bytes_per_s:>7.0f}"
        f"{got.worst_wait_ticks:>6.2f}{got.ticks_held:>5}{got.unsafe:>7}",
        flush=True,
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
        """One tick later."""
        at = self._at if changes else self._at[:0]
        self._cells.ravel()[at] = self._random.integers(-1, 2, at.size)
        return ObstacleMap(self._cells, 0, 0, at, 0, True)


def cost_us(size: int, baud: int = 115_200, rate_hz: int = 50) -> float:
    """Computing of one tick (lower quartile), with the same changes and bytes in any window."""
    down, up = Lane(baud, 0.0, 0.0, 1), Lane(baud, 0.0, 0.0, 2)
    port, clutter = LinePort(down, up), Clutter(size)
    link = new_link(port, baud, size, rate_hz)
    place = Place(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    costs_s: list[float] = []
    settled = round(COST_SETTLE_S * rate_hz)
    for tick in range(settled + COST_TICKS):
        port.now_s = START_S + tick / rate_hz
        costs_s.append(step(link, port.now_s, place, clutter.next(tick >= settled)))
        down.arrivals(port.now_s)
    return 1e6 * float(np.quantile(costs_s[-COST_TICKS:], 0.25))


def print_cost() -> None:
    """What a tick of the sender costs in windows of all sizes."""
    costs = {size: cost_us(size) for size in WINDOWS}
    print(f"\nOne tick of the sender, {COST_CELLS} changed cells, 115 200 baud, 50 Hz:")
    for size, cost in costs.items():
        print(f"  {size} x {size}: {cost:.0f} us, {cost / costs[101]:.2f} times that of 101 x 101")


def main(arguments: list[str] | None = None) -> int:
    """Exit status."""
    parser = argparse.ArgumentParser(description="figures of the planner link")
    parser.add_argument("--quick", action="store_true", help="a short drive, fewer lines")
    quick = parser.parse_args(arguments).quick
    seconds = QUICK_S if quick else SCANS_S
    print("planner link: simulated, some minutes" if not quick else "planner link: simulated")
    print_drive(seconds, WINDOWS[:2] if quick else WINDOWS)
    print_loss(seconds, SEEDS[:1] if quick else SEEDS)
    print_grid(seconds, LINES[:1] if quick else LINES)
    print_cost()
    return 0


if __name__ == "__main__":
    sys.exit(main())
