"""The map of one moment as a picture: x to the right, y up, one metre to scale.

It needs no library for pictures, so that a robot can make it.
"""

import itertools
import math
from typing import Any

import numpy as np
import numpy.typing as npt

from app import App
from core.mapping import causes
from core.records import FREE, OBSTACLE
from tools.export.raster import STATE_RGBA, png_from
from tools.why.beams import Cell

Pixels = npt.NDArray[np.uint8]
RGB = tuple[int, int, int]
EDGE_PX = 880  # of the map, at most
FREE_RGB, OBSTACLE_RGB = STATE_RGBA[FREE][:3], STATE_RGBA[OBSTACLE][:3]
UNKNOWN_RGB, WAITING_RGB, AGED_RGB = (228, 228, 228), (240, 228, 66), (170, 190, 180)
DROP_RGB, ROBOT_RGB, BAR_RGB, ASKED_RGB = (204, 121, 167), (0, 0, 0), (0, 0, 0), (0, 114, 178)
WAITING = (causes.UNSHOWN, causes.CONTRADICTED, causes.EDGE, causes.FOOT, causes.EARLIER_RUN)
DROPS = (causes.LOW, causes.NO_FLOOR, causes.TOO_LOW)
LEGEND = (
    "green free, orange obstacle, pink drop, yellow seen but not sure, grey green free grown old, "
    "grey unknown; black the robot, and the cell that ends its way; blue the cell asked for"
)


class Picture:
    """A window of cells, each some pixels wide, and lines on it."""

    def __init__(self, app: App) -> None:
        maps = app.mapper.maps
        grid = maps.window.grid
        self._corner, self._size, self._cell_m = (
            (grid.corner_i, grid.corner_j),
            grid.size,
            grid.cell_m,
        )
        self._px = max(1, EDGE_PX // grid.size)
        j, i = np.indices((grid.size, grid.size)).reshape(2, -1)
        found = maps.causes(i + grid.corner_i, j + grid.corner_j)
        cells = colours_of(found.astype(int)).reshape(grid.size, grid.size, 3)
        self.pixels: Pixels = cells.repeat(self._px, axis=0).repeat(self._px, axis=1)[::-1].copy()

    def frame_cell(self, cell: Cell, colour: RGB) -> None:
        """A border around a cell, a little larger than it."""
        i, j = cell
        low, high = -0.25, 1.25
        corners = [
            (i + low, j + low),
            (i + high, j + low),
            (i + high, j + high),
            (i + low, j + high),
        ]
        self.line([*corners, corners[0]], colour)

    def line(self, cells: list[tuple[float, float]], colour: RGB) -> None:
        """From point to point, in cells of the endless grid; two pixels wide."""
        edge = self.pixels.shape[0]
        for (ax, ay), (bx, by) in itertools.pairwise(cells):
            steps = 2 + math.ceil(math.hypot(bx - ax, by - ay) * self._px)
            x = np.linspace(ax, bx, steps) - self._corner[0]
            y = np.linspace(ay, by, steps) - self._corner[1]
            column = np.floor(x * self._px).astype(int)
            row = edge - 1 - np.floor(y * self._px).astype(int)
            for right, down in ((0, 0), (1, 0), (0, 1)):
                inside = (column + right >= 0) & (column + right < edge)
                inside &= (row + down >= 0) & (row + down < edge)
                self.pixels[row[inside] + down, column[inside] + right] = colour

    def robot(self, app: App, now_s: float) -> None:
        """Its outline, and a line from the axle ahead."""
        pose, robot = app.mapper.maybe_pose(now_s), app.config.robot
        if pose is None:
            return
        c, s = math.cos(pose.yaw_rad), math.sin(pose.yaw_rad)

        def place(ahead_m: float, left_m: float) -> tuple[float, float]:
            x_m, y_m = c * ahead_m - s * left_m, s * ahead_m + c * left_m
            return (pose.x_m + x_m) / self._cell_m, (pose.y_m + y_m) / self._cell_m

        side_m = robot.width_m / 2
        outline = [(1, 1), (1, -1), (-1, -1), (-1, 1), (1, 1)]
        ends_m = {1: robot.front_m, -1: -robot.rear_m}
        self.line([place(ends_m[end], side * side_m) for end, side in outline], ROBOT_RGB)
        self.line([place(0.0, 0.0), place(robot.front_m + 0.3, 0.0)], ROBOT_RGB)

    def metre(self) -> None:
        """One metre, at the lower left."""
        i, j = self._corner[0] + 2.0, self._corner[1] + 2.0
        self.line([(i, j), (i + 1.0 / self._cell_m, j)], ROBOT_RGB)


def colours_of(found: npt.NDArray[np.int_]) -> Pixels:
    """A colour (n, 3) for each cause (n,)."""
    table = np.full((256, 3), UNKNOWN_RGB, np.uint8)
    table[causes.FIRST_FREE : causes.FIRST_OBSTACLE] = FREE_RGB
    table[causes.FIRST_OBSTACLE : causes.FIRST_DOUBT] = OBSTACLE_RGB
    table[list(WAITING)], table[causes.AGED], table[list(DROPS)] = WAITING_RGB, AGED_RGB, DROP_RGB
    return table[found]


def picture_of(app: App, now_s: float, moment: dict[str, Any], asked: Cell | None) -> bytes:
    """A PNG of the map as it is now."""
    picture = Picture(app)
    picture.robot(app, now_s)
    picture.metre()
    if bars := moment["stands"]["way_ends_at"]:
        picture.frame_cell((bars["i"], bars["j"]), BAR_RGB)
    if asked is not None:
        picture.frame_cell(asked, ASKED_RGB)
    opaque = np.full((*picture.pixels.shape[:2], 1), 255, np.uint8)
    return png_from(np.concatenate([picture.pixels, opaque], axis=2))
