"""Takes an app's state now and then for its recording: pose, maps and newest sweep.

It reads, and changes nothing. Heights lie far apart in memory: they are gathered a few rows at each
step, so that none takes long.
"""

from collections.abc import Callable

import numpy as np

from core.driving.pilot import Pilot
from core.mapping.mapper import Mapper
from core.mapping.tiles import TileValues
from core.records import PoseReport, Scan
from recording.packing import pack_heights, pack_scan, pack_state
from recording.ports import Notes
from recording.records import HEIGHTS, SCAN, STATE

HEIGHTS_S = 2.0  # from one gathering of all heights to the next, at least,
CELLS_PER_S = 10_000  # and of no more cells than this
CELLS = 1500  # of which heights are gathered in one step

Report = Callable[[float], tuple[bool, PoseReport]]  # now: whether free may be told, and the pose


class StateTaker:
    """Looks at one app."""

    def __init__(
        self,
        notes: Notes,
        mapper: Mapper,
        pilot: Pilot,
        tiles: TileValues,
        report: Report,
        rate_hz: float,
    ) -> None:
        self._notes, self._mapper, self._pilot = notes, mapper, pilot
        self._tiles, self._report = tiles, report
        self._period_s = 1.0 / rate_hz
        self._taken_s = -np.inf
        self._heights = HeightsTaker(notes, mapper)

    def look(self, now_s: float) -> None:
        """After a step."""
        if now_s - self._taken_s >= self._period_s:
            self._taken_s = now_s
            self._take(now_s)
        elif self._mapper.counts.scans_added:
            self._heights.step(now_s)

    def _take(self, now_s: float) -> None:
        trusted, pose = self._report(now_s)
        window, scan = self._mapper.maps.window, self._mapper.newest_scan
        corner, cell_m = (window.grid.corner_i, window.grid.corner_j), window.grid.cell_m
        zone = self._pilot.zone
        state = pack_state(pose, zone, window.cells, corner, cell_m, trusted)
        self._notes.note(now_s, STATE, 0, *state)
        if isinstance(scan, Scan):
            self._notes.note(scan.t_s, SCAN, 0, pack_scan(scan, self._tiles.maybe_scan()))


class HeightsTaker:
    """The heights of the cells of the obstacle map, row by row, and their variances."""

    def __init__(self, notes: Notes, mapper: Mapper) -> None:
        self._notes, self._mapper = notes, mapper
        size = mapper.maps.window.grid.size
        self._size, self._rows = size, max(1, CELLS // size)  # of one step
        self._columns = np.tile(np.arange(size), self._rows)
        self._in_rows = np.repeat(np.arange(self._rows), size)
        self._row, self._corner, self._begun_s = size, (0, 0), -np.inf

    def step(self, now_s: float) -> None:
        """Some rows more, as a record of their own: a large one would take long by itself."""
        size, grid = self._size, self._mapper.maps.window.grid
        if self._row >= size:
            if now_s - self._begun_s < max(HEIGHTS_S, size**2 / CELLS_PER_S):
                return
            self._row, self._corner, self._begun_s = 0, (grid.corner_i, grid.corner_j), now_s
        count = min(self._rows, size - self._row) * size
        i = self._corner[0] + self._columns[:count]
        j = self._corner[1] + self._row + self._in_rows[:count]
        heights = []
        for name in ("height", "variance"):
            values = self._mapper.maybe_values(name, i, j)
            values = np.full(count, np.nan) if values is None else values
            heights.append(values.astype("<f4").tobytes())
        data = pack_heights(size, self._corner, grid.cell_m, self._row, heights)
        self._notes.note(self._begun_s, HEIGHTS, 0, data)
        self._row += self._rows
