"""Cells of method `beams` on a level ground, fed return by return: for tests of single cells."""

from typing import Any

import numpy as np
import numpy.typing as npt

from core.config import Obstacle
from core.grid.window import ObstacleWindow
from core.mapping.beams.carving import FreeSpaceCarver
from core.mapping.beams.cells import CellGrid
from core.mapping.beams.classifier import NEW_S, CellClassifier
from core.mapping.beams.elevation import Elevation
from core.mapping.beams.ground_plane import LEVEL
from core.mapping.freshness import Freshness
from core.mapping.rays import Sweep

F64 = npt.NDArray[np.float64]
Point = tuple[float, float, float]
CELL_M, H, HEIGHT_M = 0.2, 0.10, 1.30
SURE = (True, True, True)  # the ground is known well, and so is its height just now
LENS: Point = (0.0, 0.0, 1.08)
SCAN_S = 0.04
NEW_LOOKS = round(NEW_S / SCAN_S)
FOOTPRINT = (0.5, 0.2, 0.3)  # ahead, behind, to either side


def sweep_to(points: list[Point], lens: Point = LENS, t_s: float = 0.0) -> Sweep:
    """One beam from a lens to each place (map frame, metres)."""
    array = np.array(points, dtype=np.float64).reshape(-1, 3)
    lenses = np.tile(np.array(lens), (len(array), 1))
    ranges_m = np.linalg.norm(array - lenses, axis=1)
    return Sweep(t_s, lenses, (array - lenses) / ranges_m[:, None], ranges_m[None, :])


def floor_around(x: float, y: float) -> list[Point]:
    """A floor return in each of the eight cells around a place."""
    steps = (-CELL_M, 0.0, CELL_M)
    return [(x + dx, y + dy, 0.0) for dx in steps for dy in steps if (dx, dy) != (0.0, 0.0)]


class CellRig:
    """An elevation map and the obstacle map made of it, bounds +-0.10 m."""

    def __init__(
        self,
        cells: int = 41,
        window: int = 41,
        *,
        filters: bool = False,
        soft_free_below_m: float = 0.0,
        free_max_age_s: float = 120.0,
        period_s: float = SCAN_S,
    ) -> None:
        self.cells = CellGrid(cells, CELL_M)
        self.window = ObstacleWindow(window, CELL_M)
        self.elevation = Elevation(self.cells, H, -H, HEIGHT_M, filters, 1081)
        self.fresh = Freshness(self.cells.grid, free_max_age_s, FOOTPRINT)
        self.carver = FreeSpaceCarver(self.cells, self.fresh)
        self.obstacle = Obstacle(H, -H, window, soft_free_below_m, free_max_age_s)
        self.period_s = period_s
        self.classifier = self.classifier_into(self.window)
        self.ground = LEVEL
        self.x = self.y = self.t_s = 0.0

    def classifier_into(self, window: ObstacleWindow) -> CellClassifier:
        return CellClassifier(self.cells, window, self.fresh, self.obstacle, self.period_s)

    def take(self, sweep: Sweep, trust: tuple[bool, bool, bool] = SURE) -> int:
        """A whole scan; how many returns it had."""
        self.fresh.follow(sweep.t_s, self.x, self.y, (1.0, 0.0))
        returns = self.fill(sweep, trust)
        self.carver.add(sweep, self.ground)
        self.classifier.decide(self.cells.touched[: self.cells.used])
        self.fresh.expire(self.window)
        self.t_s += self.period_s
        return returns

    def fill(self, sweep: Sweep, trust: tuple[bool, bool, bool] = SURE) -> int:
        """The returns of a scan into the cells, and nothing more; how many it had."""
        self.cells.begin_scan()
        return self.elevation.add(sweep, self.ground, trust)

    def add(self, *points: Point, lens: Point = LENS) -> int:
        return self.take(sweep_to(list(points), lens, self.t_s))

    def add_silent(self, *points: Point, lens: Point = LENS) -> int:
        """A scan of beams towards places, of which nothing comes back."""
        sweep = sweep_to(list(points), lens, self.t_s)
        silent = np.full_like(sweep.ranges_m, np.nan)
        return self.take(Sweep(sweep.t_s, sweep.origins, sweep.rays, silent))

    def follow(self, x: float, y: float) -> None:
        self.x, self.y = x, y
        self.cells.grid.follow(x, y)
        self.classifier.follow(x, y)

    def state(self, x: float, y: float) -> int:
        """What the cell at a place means; the place must be in the window."""
        grid = self.window.grid
        i, j = grid.cell_of(x, y)
        assert 0 <= i - grid.corner_i < grid.size
        assert 0 <= j - grid.corner_j < grid.size
        return int(self.window.cells[j % grid.size, i % grid.size])

    def cell(self, x: float, y: float) -> Any:
        """The record (one element) of the cell at a place."""
        i, j = self.cells.grid.cell_of(x, y)
        size = self.cells.grid.size
        return self.cells.cells[j % size, i % size]
