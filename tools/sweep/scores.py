"""What a replay is worth, in figures of which less is better.

The map is looked at LOOK_HZ times a recorded second, as the planner is told it: nothing is free
while the map is not trusted. Cells are kept apart by their place in the app's own map frame.
"""

import itertools
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from core.grid.ring import RingGrid
from core.records import FREE, I8, OBSTACLE, UNKNOWN
from tools.sweep.look import Look
from tools.sweep.truth import SQUARED, DriveTruth

F64 = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]
LOOK_HZ = 5.0
NEAR_M = 5.0  # of the robot, within which all ground should be decided
AHEAD_M, ASIDE_RAD = 10.0, math.radians(60.0)  # of the robot: what it looks at
VISIT_S = 1.0  # in sight for so long is a visit
AWAY_S = 10.0  # out of sight for so long, and it is another visit
FLIP_S = 2.0  # between two classes of a cell, at most
MEMORY_CELLS = 1024  # along an edge of what is remembered
LONE_FREE = 6  # free neighbours of eight around a single obstacle cell


@dataclass(frozen=True, slots=True)
class Score:
    """One figure; less is better in each."""

    name: str
    unit: str
    about: str
    of_truth: bool = False  # only where the drive was simulated


SCORES = (
    Score(
        "free_on_danger_m2", "m²",
        "ground told as free that is 0.15 m or more above or below the floor; mean over looks",
        of_truth=True,
    ),
    Score(
        "false_obstacle_m2", "m²",
        "cells told as obstacle, 0.4 m or more from any true one and anybody; mean over looks",
        of_truth=True,
    ),
    Score(
        "place_error_m", "m",
        "distance of the robot's told place from its true one; root mean square over looks",
        of_truth=True,
    ),
    Score(
        "flips_m2_per_min", "m²/min",
        "cells that turned from free to obstacle or back within 2 s; area per recorded minute",
    ),
    Score(
        "revisit_share", "share",
        "of cells decided in two visits, 10 s or more apart: those whose class was another then",
    ),
    Score(
        "undecided_share", "share",
        "of the ground within 5 m of the robot: told as neither free nor obstacle; mean over looks",
    ),
    Score(
        "lone_cells", "cells",
        "single obstacle cells with 6 or more free ones around them; mean over looks",
    ),
    Score("scans_lost", "scans", "scans that came and were not mapped"),
    Score(
        "cpu_ms_per_scan", "ms",
        "processor time of the replay per scan mapped, without that of scoring",
    ),
)  # fmt: skip
NAMES = tuple(score.name for score in SCORES)


class Memory:
    """What cells were, one at a time: whether they flip, and what they are when seen again."""

    def __init__(self, cell_m: float) -> None:
        self.grid = RingGrid(MEMORY_CELLS, cell_m)
        self._last: I8 = self.grid.layer(np.int8, UNKNOWN)  # newest decided class,
        self._last_s: F64 = self.grid.layer(np.float64, -np.inf)  # and when it was that
        self._seen_s: F64 = self.grid.layer(np.float64, -np.inf)  # newest instant in sight
        self._since_s: F64 = self.grid.layer(np.float64, np.inf)  # begin of the newest visit
        self._visit: I8 = self.grid.layer(np.int8, UNKNOWN)  # class in the newest visit,
        self._before: I8 = self.grid.layer(np.int8, UNKNOWN)  # and in the one before
        self.flips = 0
        self.revisits = self.changed = 0  # pairs of visits; those that differ

    def end(self) -> None:
        """No look follows, or cells lie elsewhere from now on."""
        self._count(self._before, self._visit)
        self.grid.erase()

    def take(self, look: Look) -> None:
        self._follow(look)
        at = self._at(look)
        last, last_s = self._last[at], self._last_s[at]
        decided = look.cells != UNKNOWN
        flipped = decided & (last == -look.cells) & (look.t_s - last_s <= FLIP_S)
        self.flips += int(flipped.sum())
        self._last[at] = np.where(decided, look.cells, last)
        self._last_s[at] = np.where(decided, look.t_s, last_s)
        self._visit_cells(look, at)

    def _follow(self, look: Look) -> None:
        """The middle goes with the robot, by quarters of the memory, for moving costs."""
        i, j = self.grid.cell_of(*look.pose[:2])
        half = MEMORY_CELLS // 2
        off = max(abs(i - half - self.grid.corner_i), abs(j - half - self.grid.corner_j))
        if off > MEMORY_CELLS // 4:
            self.grid.follow(*look.pose[:2])

    def _at(self, look: Look) -> Any:
        steps = np.arange(look.size)
        return np.ix_(
            (look.corner_j + steps) % MEMORY_CELLS, (look.corner_i + steps) % MEMORY_CELLS
        )

    def _visit_cells(self, look: Look, at: Any) -> None:
        in_sight = sight_of(look)
        seen_s, since_s = self._seen_s[at], self._since_s[at]
        visit, before = self._visit[at], self._before[at]
        begins = in_sight & (look.t_s - seen_s >= AWAY_S)
        self._count(before[begins], visit[begins])
        since_s[begins] = look.t_s
        seen_s[in_sight] = look.t_s
        before[begins], visit[begins] = visit[begins], UNKNOWN
        lasts = in_sight & (look.t_s - since_s >= VISIT_S)
        visit[lasts] = look.cells[lasts]
        self._seen_s[at], self._since_s[at] = seen_s, since_s
        self._visit[at], self._before[at] = visit, before

    def _count(self, before: I8, after: I8) -> None:
        both = (before != UNKNOWN) & (after != UNKNOWN)
        self.revisits += int(both.sum())
        self.changed += int((both & (before != after)).sum())


def sight_of(look: Look) -> Bools:
    """The cells (size, size) that the robot looks at, if nothing stands before them."""
    x, y = look.offsets_m()
    c, s = math.cos(look.pose[2]), math.sin(look.pose[2])
    ahead = c * x[None, :] + s * y[:, None]
    aside = np.abs(c * y[:, None] - s * x[None, :])
    near = x[None, :] ** 2 + y[:, None] ** 2 <= AHEAD_M**2
    return np.asarray(near & (ahead > 0.0) & (aside <= math.tan(ASIDE_RAD) * ahead))


def undecided_share(look: Look) -> float:
    """Of the ground near the robot; what lies outside of the window is undecided, too."""
    x, y = look.offsets_m()
    near = x[None, :] ** 2 + y[:, None] ** 2 <= NEAR_M**2
    decided_m2 = float((near & (look.cells != UNKNOWN)).sum()) * look.cell_m**2
    return max(0.0, 1.0 - decided_m2 / (math.pi * NEAR_M**2))


def lone_cells(cells: I8) -> int:
    """Obstacle cells with no other beside them and free ground around."""
    wide = np.pad(cells, 1)
    rows, columns = cells.shape
    beside = np.zeros((2, rows, columns), dtype=np.int8)  # obstacles, free
    for dj, di in itertools.product(range(3), range(3)):
        if (dj, di) != (1, 1):
            part = wide[dj : dj + rows, di : di + columns]
            beside[0] += part == OBSTACLE
            beside[1] += part == FREE
    return int(((cells == OBSTACLE) & (beside[0] == 0) & (beside[1] >= LONE_FREE)).sum())


class Tally:
    """Sums over the looks of one replay."""

    def __init__(self, cell_m: float, truth: DriveTruth | None) -> None:
        self.memory, self._truth = Memory(cell_m), truth
        self._taken: dict[str, list[float]] = {}
        self._first_s, self._last_s = math.nan, math.nan

    def take(self, look: Look) -> None:
        if math.isnan(self._first_s):
            self._first_s = look.t_s
        self._last_s = look.t_s
        self.memory.take(look)
        figures = {
            "undecided_share": undecided_share(look),
            "lone_cells": float(lone_cells(look.cells)),
        }
        if self._truth is not None:
            figures |= self._truth.figures(look)
        for name, figure in figures.items():
            self._taken.setdefault(name, []).append(figure)

    def scores(self) -> dict[str, float | None]:
        """By name; None where there was nothing to judge it by."""
        memory, minutes = self.memory, (self._last_s - self._first_s) / 60.0
        memory.end()
        area_m2 = memory.flips * memory.grid.cell_m**2
        found: dict[str, float | None] = {
            name: float(np.mean(figures)) for name, figures in self._taken.items()
        }
        if SQUARED in found:
            found["place_error_m"] = math.sqrt(found.pop(SQUARED) or 0.0)
        found["flips_m2_per_min"] = area_m2 / minutes if minutes > 0.0 else None
        found["revisit_share"] = memory.changed / memory.revisits if memory.revisits else None
        return found
