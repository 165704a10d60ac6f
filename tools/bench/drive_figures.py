"""How big the maps of the synthetic drive are on the planner link: whole, and changes only.

An encoder of its own that knows nothing of budgets: what the link would cost if nothing got lost.
Source: planner link, sections 3 and 10.
"""

from dataclasses import dataclass

import numpy as np

from core.records import FREE, I8, OBSTACLE
from jit import kernel
from tools.bench.drive_scene import Playback, drive

POSE_BYTES, GEOM_BYTES = 38, 30  # on a serial line
MAP_HEAD_BYTES = 24  # of one MAP frame without its operations, likewise
MOST_OPS = 346


@kernel
def _op_bytes(run: int) -> int:
    """Bytes of one operation."""
    if run <= 63:
        return 1
    rest, used = run - 64, 2
    while rest >= 128:
        rest, used = rest // 128, used + 1
    return used


@kernel
def ops_bytes(cells: I8, corner: tuple[int, int], only: bool, wanted: I8, size: int) -> int:
    """Bytes of operations for a window in raster order; with `only`, KEEP over unwanted cells."""
    used, run, state, begun = 0, 0, -2, False
    for row in range(size):
        ring_row = (corner[1] + row) % size * size
        for column in range(size):
            at = ring_row + (corner[0] + column) % size
            code = 2 if only and wanted[at] == 0 else int(cells[at])
            if code == state:
                run += 1
                continue
            if run > 0 and (begun or state != 2):
                used, begun = used + _op_bytes(run), True
            state, run = code, 1
    return used if state == 2 else used + _op_bytes(run)


@dataclass(frozen=True, slots=True)
class Sizes:
    """Of one drive seen through one window."""

    full_mean: float  # bytes on the wire of one whole map
    full_worst: int
    changes_per_s: dict[int, float]  # by rate in Hz: bytes of operations a second
    wire_per_s: dict[int, float]  # likewise with headers, pose and geometry
    worst_tick: int  # bytes of operations, at the fastest rate
    obstacles_per_s: float  # cells that become OBSTACLE, a second


def sizes(scanner: str, size: int, seconds: float, rates_hz: tuple[int, ...]) -> Sizes:
    """Play the drive once per rate, and count."""
    fulls: list[int] = []
    ops_per_s, wire_per_s, worst, obstacles = {}, {}, 0, 0
    steps = drive(scanner, size, seconds)
    for rate_hz in rates_hz:
        playback, ops_sum, wire_sum = Playback(steps, size), 0, 0
        wanted: I8 = np.zeros(size * size, dtype=np.int8)
        for tick in range(1, round(seconds * rate_hz)):
            window = playback.until(tick / rate_hz)
            corner, cells = (window.corner_i, window.corner_j), window.cells.ravel()
            wanted[window.changed] = 1
            ops = ops_bytes(cells, corner, True, wanted, size)
            wanted[window.changed] = 0
            ops_sum += ops
            wire_sum += ops + max(1, -(-ops // MOST_OPS)) * MAP_HEAD_BYTES + POSE_BYTES
            if rate_hz == max(rates_hz):
                worst = max(worst, ops)
                obstacles += int(np.count_nonzero(cells[window.changed] == OBSTACLE))
                full = ops_bytes(cells, corner, False, wanted, size)
                fulls.append(full + -(-full // MOST_OPS) * MAP_HEAD_BYTES)
        ops_per_s[rate_hz] = ops_sum / seconds
        wire_per_s[rate_hz] = wire_sum / seconds + GEOM_BYTES
    return Sizes(
        float(np.mean(fulls)), max(fulls), ops_per_s, wire_per_s, worst, obstacles / seconds
    )


def shares(scanner: str, size: int, seconds: float) -> tuple[float, float]:
    """How much of the window is FREE and OBSTACLE at the drive's end, parts of 1."""
    window = Playback(drive(scanner, size, seconds), size).until(seconds)
    return float((window.cells == FREE).mean()), float((window.cells == OBSTACLE).mean())
