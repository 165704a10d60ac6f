"""The map that a planner is told, at one instant of a replay."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from app import App
from core.records import FREE, I8, UNKNOWN

F64 = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Look:
    """The map at one instant. Cells (size, size), [j, i] from world cell (corner_i, corner_j)."""

    t_s: float
    cells: I8  # as told
    corner_i: int
    corner_j: int
    cell_m: float
    pose: tuple[float, float, float]  # x, y, yaw in the map frame

    @property
    def size(self) -> int:
        return int(self.cells.shape[0])

    def offsets_m(self) -> tuple[F64, F64]:
        """From the robot to the centres of columns (size,) and rows (size,), along map x and y."""
        steps = np.arange(self.size) + 0.5
        x = (self.corner_i + steps) * self.cell_m - self.pose[0]
        return np.asarray(x), np.asarray((self.corner_j + steps) * self.cell_m - self.pose[1])


def maybe_look(app: App, now_s: float) -> Look | None:
    """None before the first scan, and while nobody knows where the robot is."""
    pose = app.mapper.maybe_pose(now_s)
    if pose is None or not app.mapper.counts.scans_added:
        return None
    window = app.mapper.maps.window
    grid = window.grid
    shift = (-(grid.corner_j % grid.size), -(grid.corner_i % grid.size))
    cells = np.roll(window.cells, shift, axis=(0, 1))
    if app.tiles.doubt:
        cells[cells == FREE] = UNKNOWN
    place = (pose.x_m, pose.y_m, pose.yaw_rad)
    return Look(now_s, cells, grid.corner_i, grid.corner_j, grid.cell_m, place)
