"""Which beams met a cell, and which passed over or through it, scan by scan."""

from collections import deque
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from app import App
from core.mapping.rays import MIN_RANGE_M, BeamGeometry, Sweep, span_s
from core.records import F64, PointSweep, Scan
from tools.why.words import STATES, word_of

Cell = tuple[int, int]  # world cell, along x and y
KEPT = 6  # beams of a kind, and changes
OF_A_SCAN = 2  # beams of a kind that are kept of one scan
LEVEL = 1e-12  # of a direction: along an axis no faster


@dataclass(frozen=True, slots=True)
class BeamAt:
    """One beam at one cell."""

    t_s: float  # when it left
    scan: int  # the scanner's own number
    beam: int  # of the used ones, from 0
    range_m: float  # to what it met; of one that passed, to the cell
    z_m: float  # there, map frame


@dataclass(frozen=True, slots=True)
class Change:
    """A cell became something else."""

    t_s: float
    state: int
    cause: int


def ranges_in(sweep: Sweep, cell: Cell, cell_m: float) -> tuple[F64, F64]:
    """At which ranges (n,) beams enter and leave the column of a cell; NaN: they never do."""
    near, far = np.full(len(sweep.rays), MIN_RANGE_M), np.full(len(sweep.rays), np.inf)
    for axis in (0, 1):
        low, high = cell[axis] * cell_m, (cell[axis] + 1) * cell_m
        begin, ray = sweep.origins[:, axis], sweep.rays[:, axis]
        moves = np.abs(ray) > LEVEL
        step = np.where(moves, ray, 1.0)
        ends = np.sort(np.stack([(low - begin) / step, (high - begin) / step]), axis=0)
        inside = (low <= begin) & (begin < high)
        near = np.where(moves, np.maximum(near, ends[0]), np.where(inside, near, np.inf))
        far = np.where(moves, np.minimum(far, ends[1]), far)
    crosses = near < far
    return np.where(crosses, near, np.nan), np.where(crosses, far, np.nan)


def beams_at(
    sweep: Sweep, scan: Scan | PointSweep, cell: Cell, cell_m: float
) -> tuple[list[BeamAt], list[BeamAt]]:
    """The beams of a sweep that met something in a cell, and those that went on behind it."""
    near, far = ranges_in(sweep, cell, cell_m)
    first_s, last_s = span_s(scan)
    times_s = np.linspace(first_s, last_s, len(near))
    ranges_m = np.where(sweep.ranges_m >= MIN_RANGE_M, sweep.ranges_m, np.nan)
    inside = (ranges_m >= near) & (ranges_m <= far)
    nearest_m = np.where(np.isnan(ranges_m), np.inf, ranges_m).min(axis=0)
    passes = (nearest_m > far) & np.isfinite(nearest_m) & ~inside.any(axis=0)

    def told(beam: int, range_m: float) -> BeamAt:
        z_m = sweep.origins[beam, 2] + range_m * sweep.rays[beam, 2]
        return BeamAt(float(times_s[beam]), scan.counter, beam, float(range_m), float(z_m))

    met = [told(int(beam), ranges_m[echo, beam]) for echo, beam in np.argwhere(inside)]
    return met, [told(int(beam), near[beam]) for beam in np.flatnonzero(passes)]


class CellWatch:
    """One cell while a recording is played: its newest beams, and when it changed."""

    def __init__(self, app: App, cell: Cell) -> None:
        self.cell, self._app = cell, app
        self._geometry = BeamGeometry.of(app.config.scanner)
        self._scan: Scan | PointSweep | None = None
        self._state = 0
        self.met: deque[BeamAt] = deque(maxlen=KEPT)
        self.passed: deque[BeamAt] = deque(maxlen=KEPT)
        self.changes: deque[Change] = deque(maxlen=KEPT)

    def look(self, now_s: float) -> None:
        """After each call of the app."""
        mapper = self._app.mapper
        scan = mapper.newest_scan
        if scan is self._scan:
            return
        self._scan = scan
        i, j = np.array([self.cell[0]]), np.array([self.cell[1]])
        states, causes = mapper.maybe_values("state", i, j), mapper.maps.causes(i, j)
        assert states is not None
        state = int(np.nan_to_num(states[0]))
        if state != self._state:
            self._state = state
            self.changes.append(Change(now_s, state, int(causes[0])))
        if scan is None:
            return
        first_s, last_s = span_s(scan)
        attitudes, odometry = mapper.attitudes, mapper.odometry
        if attitudes.reaches(first_s, last_s) and odometry.covers(first_s, last_s):
            sweep = self._geometry.cast(scan, attitudes, odometry)
            met, passed = beams_at(sweep, scan, self.cell, self._app.config.map.cell_m)
            self.met.extend(met[:OF_A_SCAN])
            self.passed.extend(passed[:OF_A_SCAN])

    def facts(self) -> dict[str, Any]:
        """As numbers and words, newest first."""
        return {
            "met": [asdict(beam) for beam in reversed(self.met)],
            "passed": [asdict(beam) for beam in reversed(self.passed)],
            "changes": [
                {"t_s": change.t_s, "to": STATES[change.state], "cause": word_of(change.cause)}
                for change in reversed(self.changes)
            ],
        }
