"""The map at one moment of a replay, as the app tells it."""

from dataclasses import dataclass

import numpy as np

from app import App
from core.motion.track import Pose
from core.records import FREE as IS_FREE
from core.records import OBSTACLE as IS_OBSTACLE
from core.records import U8
from mapod_link.bodies import FREE, OBSTACLE, UNKNOWN


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """Classes of cells, and where the robot is among them."""

    states: U8  # (size, size), row j, column i from the corner
    corner: tuple[int, int]  # world cell (i, j) of states[0, 0]
    cell_m: float
    pose: Pose | None  # None: not known

    def cell(self, x_m: float, y_m: float) -> tuple[float, float]:
        """Column and row of a place, in cells from the window's lowest corner."""
        return x_m / self.cell_m - self.corner[0], y_m / self.cell_m - self.corner[1]


def moment_of(app: App, now_s: float) -> Moment:
    """What is told now; without trust, nothing is free. Changes nothing in the app."""
    window = app.mapper.maps.window
    grid, cells = window.grid, np.asarray(window.cells)
    states = np.full(cells.shape, UNKNOWN, np.uint8)
    states[cells == IS_OBSTACLE] = OBSTACLE
    if not app.tiles.doubt:
        states[cells == IS_FREE] = FREE
    return Moment(
        np.roll(states, (-grid.corner_j, -grid.corner_i), axis=(0, 1)),
        (grid.corner_i, grid.corner_j),
        app.config.map.cell_m,
        app.mapper.odometry.maybe_pose(now_s),
    )
