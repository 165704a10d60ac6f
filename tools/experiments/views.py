"""The maps of an app at one instant, laid out alike whichever method made them.

Cells are those of the window that the planner gets, aligned with the map frame. The heights of
`reference_plane`, whose own map turns with the robot, are taken as its window is: by the cell of
its map into which the centre of a cell of the window falls.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from app import App
from core.grid.ring import RingGrid
from core.mapping.method import Maps
from core.mapping.paper.maps import ReferencePlaneMaps
from core.mapping.surface.maps import SurfaceMaps
from core.records import I8

F64 = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class MapView:
    """States and heights, (size, size), [j, i] from the world cell (corner_i, corner_j) on."""

    name: str
    corner_i: int
    corner_j: int
    cell_m: float
    states: I8
    heights_m: F64  # NaN: nothing fell in
    pose: tuple[float, float, float]  # x, y, yaw that the app believes

    @property
    def size(self) -> int:
        return int(self.states.shape[0])

    def centres_m(self) -> tuple[F64, F64]:
        """Centres along x (size,) and y (size,), map frame."""
        steps = np.arange(self.size) + 0.5
        along_x, along_y = (self.corner_i + steps, self.corner_j + steps)
        return np.asarray(along_x * self.cell_m), np.asarray(along_y * self.cell_m)

    def part(self, x_m: tuple[float, float], y_m: tuple[float, float]) -> npt.NDArray[np.bool_]:
        """Cells (size, size) whose centres lie in a rectangle of the map."""
        x, y = self.centres_m()
        columns, rows = (x > x_m[0]) & (x < x_m[1]), (y > y_m[0]) & (y < y_m[1])
        return np.asarray(rows[:, None] & columns[None, :])


def straightened(grid: RingGrid, layer: npt.NDArray[Any]) -> npt.NDArray[Any]:
    return np.roll(layer, (-(grid.corner_j % grid.size), -(grid.corner_i % grid.size)), axis=(0, 1))


def view_of(name: str, app: App) -> MapView:
    maps = app.mapper.maps
    grid = maps.window.grid
    pose = app.mapper.maybe_pose(app.mapper.newest_scan_s)
    place = (pose.x_m, pose.y_m, pose.yaw_rad) if pose else (0.0, 0.0, 0.0)
    states = straightened(grid, maps.window.cells).copy()
    heights_m = _heights_m(maps)
    return MapView(name, grid.corner_i, grid.corner_j, grid.cell_m, states, heights_m, place)


def heights_over_ground_m(maps: SurfaceMaps) -> F64:
    """Over the plane that fits the ground best: what is wrong with an attitude tilts all of it.

    (size, size), [j, i] from the world cell (corner_i, corner_j) on.
    """
    heights_m = straightened(maps.grid, maps.heights_m())
    is_ground = straightened(maps.grid, (maps.cells["looks"] > 0) & (maps.cells["stands"] <= 0.0))
    rows, columns = np.indices(heights_m.shape)
    at = np.stack([columns, rows, np.ones_like(rows)], axis=-1).astype(float)
    if is_ground.sum() < 3:
        return heights_m
    plane, *_ = np.linalg.lstsq(at[is_ground], heights_m[is_ground], rcond=None)
    return np.asarray(heights_m - at @ plane)


def _heights_m(maps: Maps) -> F64:
    if isinstance(maps, ReferencePlaneMaps):
        return straightened(maps.window.grid, maps.heights_m())
    assert isinstance(maps, SurfaceMaps)
    grid, straight = maps.grid, heights_over_ground_m(maps)
    window = maps.window.grid
    wide = np.pad(straight, window.size, constant_values=np.nan)
    j, i = (
        window.size + at - begin
        for at, begin in ((window.corner_j, grid.corner_j), (window.corner_i, grid.corner_i))
    )
    return wide[j : j + window.size, i : i + window.size].copy()
