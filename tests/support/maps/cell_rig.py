"""The maps of method `surface` fed sweep by sweep, from any place: for tests of the map's life."""

import math

import numpy as np

from core.mapping.rays import Sweep
from core.mapping.surface.maps import SurfaceMaps
from core.motion.path import Place
from core.records import PointSweep
from tests.support.maps.flat_ride import config_of

Point = tuple[float, float, float]
CELL_M, LENS_M, SCAN_S = 0.2, 0.3, 0.04  # so low that beams skim the floor
PART_M = 0.05  # floor is noted in parts of cells, so large
NO_SCAN = PointSweep(np.zeros((1, 3)), np.ones((1, 3)), np.ones((1, 1)), np.zeros(1), 0, 0.0)


def sweep_to(points: list[Point], lens: Point, t_s: float, returns: bool = True) -> Sweep:
    """One beam from a lens to each place (map frame, metres); or none of them comes back."""
    array = np.array(points, dtype=np.float64).reshape(-1, 3)
    lenses = np.tile(np.array(lens), (len(array), 1))
    ranges_m = np.linalg.norm(array - lenses, axis=1)
    told_m = ranges_m if returns else np.full_like(ranges_m, np.nan)
    return Sweep(t_s, lenses, (array - lenses) / ranges_m[:, None], told_m[None, :])


def floor_at(x: float, y: float, cells: int = 3) -> list[Point]:
    """Level floor all over so many cells in a square, about the cell at a place."""
    low_x, low_y = (CELL_M * (math.floor(at / CELL_M) - (cells - 1) / 2) for at in (x, y))
    steps = PART_M * (np.arange(round(cells * CELL_M / PART_M)) + 0.5)
    return [(float(low_x + dx), float(low_y + dy), 0.0) for dx in steps for dy in steps]


class Orientation:
    doubted = 0


class Motion:
    """Attitude and odometry of a robot that stays level and looks along x."""

    orientation = Orientation()
    yaw_start_rad = travel_m = x_m = y_m = w_radps = 0.0
    corrected_m = np.zeros(2)

    def rpy_at(self, t_s: float) -> tuple[float, float, float]:
        return 0.0, 0.0, 0.0

    def place_at(self, t_s: float) -> Place:
        return self.x_m, self.y_m, 0.0, self.travel_m

    def correct_slip(self, heading: tuple[float, float], slipped_m: float) -> None:
        raise AssertionError("this robot does not slip")


class CellRig:
    """Maps that take sweeps made by hand; the robot has moved a little, and stands at x, y."""

    def __init__(self, cells: int = 41, window: int = 41, free_max_age_s: float = 120.0) -> None:
        obstacle = {"window_cells": window, "free_max_age_s": free_max_age_s}
        self.maps = SurfaceMaps(config_of(map={"cells": cells}, obstacle=obstacle))
        self.window, self.grid = self.maps.window, self.maps.grid
        self._motion = Motion()
        self.t_s = 0.0
        for x in (-0.2, 0.0):
            self.follow(x, 0.0)
            self.add()

    @property
    def place(self) -> tuple[float, float]:
        return self._motion.x_m, self._motion.y_m

    def follow(self, x: float, y: float) -> None:
        """The robot stands elsewhere when the next sweep is taken."""
        self._motion.travel_m += math.hypot(x - self._motion.x_m, y - self._motion.y_m)
        self._motion.x_m, self._motion.y_m = x, y

    def take(self, sweep: Sweep) -> int:
        """Take a sweep; how many returns it had."""
        self.maps._geometry = self  # type: ignore[assignment]
        self._sweep = sweep
        returns = self.maps.add(NO_SCAN, self._motion, self._motion)  # type: ignore[arg-type]
        self.t_s += SCAN_S
        return returns

    def cast(self, *_: object) -> Sweep:
        """In place of the geometry's own."""
        return self._sweep

    def add(self, *points: Point, returns: bool = True) -> int:
        """A sweep from the robot's lens to these places; how many returns it had."""
        return self.take(sweep_to(list(points), (*self.place, LENS_M), self.t_s, returns))

    def lay_floor(self, x: float, y: float, cells: int = 5) -> None:
        """Floor about the cell at a place, line by line, as a scanner that drives on sees it."""
        ahead = np.array(self.place) - (x, y)
        points = sorted(floor_at(x, y, cells), key=lambda p: -float(np.dot(ahead, p[:2])))
        lines = [points[k : k + 4 * cells] for k in range(0, len(points), 4 * cells)]
        for line in [line for line in lines for _ in range(2)]:
            self.add(*line)

    def state(self, x: float, y: float) -> int:
        """What the cell at a place means; the place must be in the window."""
        grid = self.window.grid
        i, j = grid.cell_of(x, y)
        assert 0 <= i - grid.corner_i < grid.size
        assert 0 <= j - grid.corner_j < grid.size
        return int(self.window.cells[j % grid.size, i % grid.size])
