"""A made-up drive for the page: a floor with walls, a ditch and a ramp, and a robot that sees it.

It shares nothing with mapod: it gives arrays as a page gets them, so that tests know what is where.
"""

import math
from typing import TypeVar

import numpy as np
import numpy.typing as npt

U8 = npt.NDArray[np.uint8]
F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]
A = TypeVar("A", U8, F32)
SIZE, CELL_M = 401, 0.05
UNKNOWN, FREE, OBSTACLE = 0, 1, 2
REACH_M, STEP_M, BEAMS = 8.0, 0.05, 541
HALF_VIEW_RAD = math.radians(115.0)
WIDE_M = 40.0  # of the floor, from -WIDE_M/2 along both axes
WALLS = (  # x0, y0, x1, y1 in metres, height
    (-3.0, -2.2, 16.0, -2.0, 1.2),
    (-3.0, 2.0, 5.0, 2.2, 1.2),
    (6.6, 2.0, 16.0, 2.2, 1.2),
    (-3.2, -2.2, -3.0, 2.2, 1.2),
    (5.0, 2.0, 5.2, 7.5, 1.2),
    (6.4, 4.0, 6.6, 7.5, 1.2),
    (5.0, 7.5, 9.0, 7.7, 1.2),
    (3.2, 0.9, 3.8, 1.5, 0.6),
    (1.2, -1.7, 1.9, -1.2, 0.35),
    (8.6, -1.0, 8.8, -0.8, 1.0),
    (11.0, 0.6, 11.9, 1.4, 0.5),
)
DITCH = (9.4, -2.0, 9.8, 2.0, -0.35)
RAMP_X_M, RAMP_RISE = 10.5, 0.06
CAUSES = {
    UNKNOWN: ("unseen", "Nothing fell into it yet."),
    FREE: ("floor", "Floor was met here, and nothing stands on it."),
    OBSTACLE: ("high", "Its height is beyond h_pos_m: 0.62 m, told by 14 beams in 6 scans."),
}
DROP_TEXT = "Floor was due here and never showed: beams came back from below the ground behind it."


def filled(value: float) -> F32:
    return np.full((SIZE, SIZE), value, np.float32)


class Floor:
    """What is true: heights of cells of the whole floor, rows along y."""

    def __init__(self) -> None:
        side = round(WIDE_M / CELL_M)
        x_m = (np.arange(side) + 0.5) * CELL_M - WIDE_M / 2
        ramp_m = np.clip(x_m - RAMP_X_M, 0.0, 4.0) * RAMP_RISE
        self.heights_m = np.repeat(ramp_m[None, :], side, axis=0)
        self.is_wall, self.is_ditch = np.zeros((2, side, side), bool)
        for x0, y0, x1, y1, height_m in (*WALLS, DITCH):
            part = np.s_[self.index(y0) : self.index(y1), self.index(x0) : self.index(x1)]
            self.heights_m[part] = height_m
            (self.is_wall if height_m > 0.0 else self.is_ditch)[part] = True

    @staticmethod
    def index(place_m: float) -> int:
        return round((place_m + WIDE_M / 2) / CELL_M)


class Drive:
    """The robot on its way; each `advance` is a tenth of a second."""

    def __init__(self) -> None:
        self.floor = Floor()
        self.random = np.random.default_rng(7)
        self.t_s = 1000.0
        self.x_m, self.y_m, self.yaw_rad = -1.6, -0.3, 0.0
        self.v_mps, self.w_radps = 0.5, 0.0
        self.origin = (0, 0)  # (i, j) of the window's lowest corner
        self.cells = np.zeros((SIZE, SIZE), np.uint8)
        self.seen_s = filled(-math.inf)
        self.points = np.zeros((0, 3), np.float32)
        self.follow()

    def advance(self, seconds: float = 0.1) -> None:
        """Straight down the corridor, in a gentle bend, and to a halt before the ditch."""
        self.t_s += seconds
        ahead_m = 8.6 - self.x_m
        self.v_mps = 0.5 if ahead_m > 1.0 else max(0.0, 0.5 * ahead_m - 0.2)
        self.w_radps = (
            0.12 * math.cos(0.5 * self.x_m) * self.v_mps - 0.6 * self.yaw_rad * self.v_mps
        )
        self.x_m += self.v_mps * math.cos(self.yaw_rad) * seconds
        self.y_m += self.v_mps * math.sin(self.yaw_rad) * seconds
        self.yaw_rad += self.w_radps * seconds
        self.follow()
        self.look()

    def follow(self) -> None:
        """The window keeps the robot in its middle; what enters it is unknown."""
        i = math.floor(self.x_m / CELL_M) - SIZE // 2
        j = math.floor(self.y_m / CELL_M) - SIZE // 2
        right, up = i - self.origin[0], j - self.origin[1]
        if right or up:
            self.cells = shifted(self.cells, right, up, UNKNOWN)
            self.seen_s = shifted(self.seen_s, right, up, -math.inf)
            self.origin = (i, j)

    def look(self) -> None:
        """Beams from the robot: free where they pass, obstacle where they end at something."""
        bearings = self.yaw_rad + np.linspace(-HALF_VIEW_RAD, HALF_VIEW_RAD, BEAMS)
        far_m = np.arange(STEP_M, REACH_M, STEP_M)
        x_m = self.x_m + np.cos(bearings)[:, None] * far_m
        y_m = self.y_m + np.sin(bearings)[:, None] * far_m
        column, row = np.floor(x_m / CELL_M).astype(int), np.floor(y_m / CELL_M).astype(int)
        half = round(WIDE_M / CELL_M / 2)
        solid = self.floor.is_wall[row + half, column + half]
        ends = np.where(solid.any(axis=1), solid.argmax(axis=1), len(far_m))
        passed = np.arange(len(far_m)) < ends[:, None]
        hit = solid & (np.arange(len(far_m)) - ends[:, None] < 2) & ~passed
        hit |= passed & self.floor.is_ditch[row + half, column + half]
        column, row = column - self.origin[0], row - self.origin[1]
        for mask, state in ((passed, FREE), (hit, OBSTACLE)):
            self.cells[row[mask], column[mask]] = state
            self.seen_s[row[mask], column[mask]] = self.t_s
        at = np.flatnonzero(ends < len(far_m))
        last = ends[at]
        self.points = np.column_stack([x_m[at, last], y_m[at, last], np.full(len(at), 0.2)]).astype(
            np.float32
        )

    def layer(self, name: str) -> F32:
        """A layer of the window, NaN where nothing was seen."""
        seen = self.cells != UNKNOWN
        i, j = (part + round(WIDE_M / CELL_M / 2) for part in self.origin)
        true = self.floor.heights_m[j : j + SIZE, i : i + SIZE]
        noise = self.random.normal(0.0, 0.004, (SIZE, SIZE))
        slope_y, slope_x = np.gradient(true, CELL_M)
        values = {
            "height": true + noise,
            "variance": 2e-5 + 1e-4 * np.minimum(self.t_s - self.seen_s, 60.0) / 60.0,
            "slope": np.arctan(np.hypot(slope_x, slope_y)),
            "age": self.t_s - self.seen_s,
            "edge": np.where(self.cells == FREE, 0.3, 0.0),
            "foothold": np.where(self.cells == FREE, 0.8, 0.2),
            "cause": np.where(self.cells == FREE, 1.0, np.where(true < 0.0, 3.0, 2.0)),
        }[name]
        return np.where(seen, values, math.nan).astype(np.float32)

    def cell(self, i: int, j: int) -> dict[str, object]:
        """The answer to a question for one cell."""
        column, row = i - self.origin[0], j - self.origin[1]
        half = round(WIDE_M / CELL_M / 2)
        inside = 0 <= column < SIZE and 0 <= row < SIZE
        state = int(self.cells[row, column]) if inside else UNKNOWN
        height_m = float(self.floor.heights_m[j + half, i + half]) if inside and state else None
        cause, text = CAUSES[state]
        if state == OBSTACLE and height_m is not None and height_m < 0.0:
            cause, text = "drop", DROP_TEXT
        return {
            "type": "cell", "i": i, "j": j, "x_m": (i + 0.5) * CELL_M, "y_m": (j + 0.5) * CELL_M,
            "state": state, "height_m": height_m, "variance_m2": 4e-5 if state else None,
            "slope_rad": 0.02 if state else None, "cause": cause, "text": text,
            "age_s": self.t_s - float(self.seen_s[row, column]) if state else None,
        }  # fmt: skip


def shifted(cells: A, right: int, up: int, empty: float) -> A:
    """The same cells in a window that has moved."""
    moved: A = np.roll(cells, (-up, -right), axis=(0, 1))
    for axis, step in ((0, up), (1, right)):
        gone = np.s_[-step:] if step > 0 else np.s_[:-step]
        if step:
            moved[(gone, slice(None)) if axis == 0 else (slice(None), gone)] = empty
    return moved
