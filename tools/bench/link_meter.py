"""What a simulated planner link is measured by: how soon cells are told, how long losses last.

It knows the map as the sender means it, as each frame tells it, and as the receiver holds it.
Source: planner link, sections 5 and 11.
"""

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from core.records import F64, FREE, I32, I64, OBSTACLE, U8, ObstacleMap
from mapod_link import bodies
from mapod_link.bodies import maybe_map_geometry, maybe_map_update
from mapod_link.cell_map import CellMap
from mapod_link.frames import MAP, REFRESH, Frame, int16

Mask = npt.NDArray[np.bool_]
CODE: U8 = np.array([bodies.UNKNOWN, bodies.OBSTACLE, bodies.FREE], dtype=np.uint8)
assert (OBSTACLE, FREE) == (1, -1), "CODE is indexed by the records' cells"


def _inside(i: I64, j: I64, corner: tuple[int, int], size: int) -> Mask:
    """Which world cells a window of (size, size) with that lowest cell covers."""
    column, row = i - corner[0], j - corner[1]
    inside: Mask = (column >= 0) & (column < size) & (row >= 0) & (row < size)
    return inside


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """The receiver's map at one instant."""

    cells: U8  # (size, size) from the window's origin
    origin: tuple[int, int] | None
    is_suspect: bool

    def at(self, i: I64, j: I64) -> U8:
        """States (k,) of world cells; what the window does not cover is unknown."""
        states = np.zeros(i.size, dtype=np.uint8)
        if self.origin is not None:
            inside = _inside(i, j, self.origin, len(self.cells))
            states[inside] = self.cells[j[inside] - self.origin[1], i[inside] - self.origin[0]]
        return states


class Waiting:
    """World cells that something has been asked of since some instant."""

    def __init__(self) -> None:
        self.i: I64 = np.zeros(0, dtype=np.int64)
        self.j: I64 = np.zeros(0, dtype=np.int64)
        self.since_s: F64 = np.zeros(0)

    def add(self, i: I64, j: I64, since_s: float) -> None:
        """Those of them that do not wait already."""
        fresh = ~np.isin((i << 20) + j, (self.i << 20) + self.j)
        self.i, self.j = np.append(self.i, i[fresh]), np.append(self.j, j[fresh])
        self.since_s = np.append(self.since_s, np.full(int(fresh.sum()), since_s))

    def take(self, done: Mask) -> F64:
        """Let go of some; returns since when they waited."""
        since_s = self.since_s[done]
        self.i, self.j, self.since_s = self.i[~done], self.j[~done], self.since_s[~done]
        return since_s


@dataclass(slots=True)
class Readings:
    """What was measured, seconds unless named otherwise."""

    told_s: list[F64] = field(default_factory=list)  # new obstacle, tick to tick
    held_s: list[F64] = field(default_factory=list)  # new obstacle, tick to arrival
    recovered_s: list[F64] = field(default_factory=list)
    passes_s: list[float] = field(default_factory=list)  # how long each refresh pass took
    suspect_s: float = 0.0
    unsafe: int = 0  # cells x frames: FREE at the receiver, told as OBSTACLE, suspect clear


class Meter:
    """Watches one link; its owner calls it in the order of time."""

    def __init__(self, size: int) -> None:
        self._size = size
        self.readings = Readings()
        self._new, self._wrong = Waiting(), Waiting()
        self._window: ObstacleMap | None = None  # as the sender means it
        self._was: tuple[int, int] = (0, 0)  # its corner one tick before
        self._before = np.zeros((size, size), dtype=np.int8)  # its cells one tick before
        self._told = CellMap(size, size)  # as all frames up to the newest that arrived tell it
        self._unseen: list[Frame] = []  # lost, and nothing arrived since
        self._geom_id: int | None = None
        self._suspect_since_s: float | None = None
        self._passed_s: float | None = None  # end of the newest refresh pass
        self.is_on = False

    def begin(self, now_s: float) -> None:
        self.is_on = True
        if self._suspect_since_s is not None:
            self._suspect_since_s = now_s

    def end(self, now_s: float) -> None:
        """No more of them; what still waits, or is still wrong, counts as if it were right now."""
        self._watch_suspect(now_s, False)
        self.readings.told_s.append(now_s - self._new.since_s)
        self.readings.held_s.append(now_s - self._new.since_s)
        self.readings.recovered_s.append(now_s - self._wrong.since_s)
        self.is_on = False

    # The sender's side

    def mean(self, now_s: float, window: ObstacleMap) -> None:
        """A tick: what the map is from now on."""
        at: I32 = window.changed
        row, column = at.astype(np.int64) // self._size, at.astype(np.int64) % self._size
        i = window.corner_i + (column - window.corner_i) % self._size
        j = window.corner_j + (row - window.corner_j) % self._size
        was_in = _inside(i, j, self._was, self._size)
        was_obstacle = (self._before[row, column] == OBSTACLE) & was_in
        is_new = (window.cells[row, column] == OBSTACLE) & ~was_obstacle
        self._window, self._was = window, (window.corner_i, window.corner_j)
        self._before[...] = window.cells
        self._new.add(i[is_new], j[is_new], now_s)
        self._new.take(self._meant(self._new) != bodies.OBSTACLE)
        self._wrong.take(~self._covered(self._wrong))

    def _covered(self, cells: Waiting) -> Mask:
        assert self._window is not None
        corner = (self._window.corner_i, self._window.corner_j)
        return _inside(cells.i, cells.j, corner, self._size)

    def _meant(self, cells: Waiting) -> U8:
        """Their states, as the sender means them; outside its window unknown."""
        assert self._window is not None
        states = CODE[self._window.cells[cells.j % self._size, cells.i % self._size]]
        return np.where(self._covered(cells), states, bodies.UNKNOWN).astype(np.uint8)

    # The receiver's side

    def lose(self, at_s: float, frame: Frame, view: View) -> None:
        """A frame that should have arrived now: what the receiver holds wrongly for it."""
        self._unseen.append(frame)
        self._count_pass(at_s, frame)
        update = maybe_map_update(frame.body, self._size**2) if frame.type == MAP else None
        if update is None or view.origin is None:
            return
        ox, oy = view.origin
        ox, oy = ox + int16(update.ox - ox), oy + int16(update.oy - oy)
        for state, first, end in update.runs:
            if state == bodies.KEEP:
                continue
            cell = np.arange(first, end, dtype=np.int64)
            i, j = ox + cell % self._size, oy + cell // self._size
            differs = view.at(i, j) != state
            self._wrong.add(i[differs], j[differs], at_s)

    def take(self, at_s: float, tick_s: float, frame: Frame, view: View) -> None:
        """A frame of tick `tick_s` has been taken by the receiver, whose map is now `view`."""
        self._count_pass(at_s, frame)
        for earlier in [*self._unseen, frame]:
            self._tell(earlier)
        self._unseen.clear()
        self._watch_suspect(at_s, view.is_suspect)
        if frame.type != MAP:
            return
        has_it = view.at(self._new.i, self._new.j) == bodies.OBSTACLE
        since_s = self._new.take(has_it)
        right = view.at(self._wrong.i, self._wrong.j) == self._meant(self._wrong)
        wrong_since_s = self._wrong.take(right)
        if not self.is_on:
            return
        self.readings.told_s.append(np.maximum(0.0, tick_s - since_s))
        self.readings.held_s.append(at_s - since_s)
        self.readings.recovered_s.append(at_s - wrong_since_s)
        if not view.is_suspect and view.origin is not None:
            self.readings.unsafe += self._unsafe(view)

    def _unsafe(self, view: View) -> int:
        """Cells that the receiver takes for FREE though it was told of an OBSTACLE."""
        if view.origin != self._told.origin:
            return int(np.count_nonzero(view.cells == bodies.FREE))
        wrong = (view.cells == bodies.FREE) & (self._told.cells == bodies.OBSTACLE)
        return int(np.count_nonzero(wrong))

    def _tell(self, frame: Frame) -> None:
        if frame.type != MAP:
            return
        geom_id, update = (
            maybe_map_geometry(frame.body),
            maybe_map_update(frame.body, self._size**2),
        )
        assert update is not None, "the sender's frames fit"
        if geom_id != self._geom_id:
            self._geom_id, self._told = geom_id, CellMap(self._size, self._size)
        self._told.move(update.ox, update.oy)
        self._told.apply(update)

    def _watch_suspect(self, at_s: float, is_suspect: bool) -> None:
        if self._suspect_since_s is not None and self.is_on:
            self.readings.suspect_s += at_s - self._suspect_since_s
        self._suspect_since_s = at_s if is_suspect else None

    def _count_pass(self, at_s: float, frame: Frame) -> None:
        """A refresh slice that goes to the last cell ends a pass."""
        if frame.type != MAP or not frame.flags & REFRESH:
            return
        update = maybe_map_update(frame.body, self._size**2)
        if update is not None and update.runs and update.runs[-1][2] == self._size**2:
            if self._passed_s is not None and self.is_on:
                self.readings.passes_s.append(at_s - self._passed_s)
            self._passed_s = at_s
