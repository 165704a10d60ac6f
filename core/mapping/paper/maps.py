"""The paper's maps as a mapping method: scans in, the planner's window out.

One attitude and one displacement per scan, those of its last beam; of two echoes the first. Height
and tilt of the mount count; its roll and yaw are not in the paper and are left out. The paper's map
turns with the robot, the window does not: after each scan each cell of the window takes the state
of the paper's cell in which its centre lies. A cell of the one may be met by no centre of the
other, so an obstacle is also put where its own centre lies: none is lost between the two.
Source: the paper, chapter 4; design, section 7.
"""

import math

import numpy as np

from core.config import Config
from core.grid.window import ObstacleWindow
from core.mapping import causes
from core.mapping.causes import AGED, BEYOND_METHOD, EARLIER_RUN, OUTSIDE, UNSEEN
from core.mapping.freshness import Freshness
from core.mapping.layers import RingLayer, at_cells
from core.mapping.paper.grid import centre_of, index_of, rule_of, state_of
from core.mapping.paper.steps import PaperSettings, ReferencePlane, sigma_from_bearing
from core.mapping.rays import MIN_RANGE_M
from core.motion.attitude import AttitudeRing
from core.motion.track import Track
from core.records import F64, FREE, I8, I32, I64, OBSTACLE, U8, UNKNOWN, PointSweep, Scan
from jit import kernel

_shown_cause = kernel(causes.shown_cause)

NOWHERE = -1  # a cell of the window that lies outside the paper's maps


@kernel
def _find_sources(
    corner: tuple[int, int],
    lens: tuple[float, float, float],
    states: I8,
    cell_m: float,
    source: I32,
) -> None:
    """For each cell of the window (size, size) the paper's cell, as a flat index, or NOWHERE.

    `lens` is x, y and yaw of the body's forward direction at the lens, map frame.
    """
    size, cells = source.shape[0], states.shape[0]
    c, s = math.cos(lens[2]), math.sin(lens[2])
    for j in range(corner[1], corner[1] + size):
        dy_m = (j + 0.5) * cell_m - lens[1]
        for i in range(corner[0], corner[0] + size):
            dx_m = (i + 0.5) * cell_m - lens[0]
            column = index_of(s * dx_m - c * dy_m, cell_m, cells)
            row = index_of(c * dx_m + s * dy_m, cell_m, cells)
            inside = 0 <= row < cells and 0 <= column < cells
            source[j % size, i % size] = row * cells + column if inside else NOWHERE
    for row in range(cells):
        for column in range(cells):
            if states[row, column] == OBSTACLE:
                right_m, ahead_m = centre_of(column, cell_m, cells), centre_of(row, cell_m, cells)
                i = math.floor((lens[0] + c * ahead_m + s * right_m) / cell_m)
                j = math.floor((lens[1] + s * ahead_m - c * right_m) / cell_m)
                if 0 <= i - corner[0] < size and 0 <= j - corner[1] < size:
                    source[j % size, i % size] = row * cells + column


@kernel
def _is_old(seen_s: float, covered_s: float, oldest_s: float) -> bool:
    """Beams met a cell (seen_s) and the robot stood on it (covered_s) longer ago than is fresh."""
    return max(seen_s, covered_s) < oldest_s


@kernel
def _list_changes(
    source: I32,
    states: I8,
    seen_s: F64,
    covered_s: F64,
    oldest_s: float,
    shown: I8,
    at: I32,
    new: I8,
) -> int:
    """Where the window (flat) shows other than its sources' states; returns how many cells.

    Free ground is shown as unknown if beams met it (seen_s, of the paper's cells) and the robot
    stood on it (covered_s, of the window's) longer ago than is fresh.
    """
    used = 0
    for k in range(source.size):
        state = states[source[k]] if source[k] != NOWHERE else UNKNOWN
        if state == FREE and _is_old(seen_s[source[k]], covered_s[k], oldest_s):
            state = UNKNOWN
        if shown[k] != state:
            at[used], new[used] = k, state
            used += 1
    return used


@kernel
def _list_causes(
    at: I32,
    source: I32,
    states: I8,
    average_m: F64,
    count: I32,
    bounds_m: tuple[float, float],
    times: tuple[F64, F64, float],
    shown: I8,
    out: U8,
) -> None:
    """Fill `out` (n,) with the causes of what the window shows at its flat cells `at` (n,).

    -1: outside. times: as of `_list_changes`; bounds_m: h_pos and h_neg.
    """
    for k in range(at.size):
        out[k] = OUTSIDE
        if at[k] < 0:
            continue
        cause, cell = BEYOND_METHOD, source[at[k]]
        if cell != NOWHERE:
            cause = rule_of(average_m[cell], bounds_m[0], bounds_m[1])
            if states[cell] == UNKNOWN:
                cause = UNSEEN if count[cell] == 0 else EARLIER_RUN
            elif state_of(cause) == FREE and _is_old(times[0][cell], times[1][at[k]], times[2]):
                cause = AGED
        out[k] = _shown_cause(cause, state_of(cause), shown[at[k]])


class ReferencePlaneMaps:
    """`Maps` by the paper's method; `plane` has its own two maps, in its own frame."""

    def __init__(self, config: Config, compensated: bool = True) -> None:
        scanner, obstacle, ground = config.scanner, config.obstacle, config.ground
        settings = PaperSettings(
            lens_height_m=scanner.mount_z_m,
            tilt_rad=math.radians(scanner.mount_tilt_deg),
            max_range_m=scanner.options.spec.max_range_m,
            cells=config.map.cells,
            cell_m=config.map.cell_m,
            h_pos_m=obstacle.h_pos_m,
            h_neg_m=obstacle.h_neg_m,
            epsilon_rad=math.radians(ground.total_pitch_deg),
            eta_rad=math.radians(ground.step_pitch_deg),
            compensated=compensated,
        )
        self.plane = ReferencePlane(settings, np.zeros(0))
        self.window = ObstacleWindow(obstacle.window_cells, config.map.cell_m)
        size = obstacle.window_cells
        robot = config.robot
        footprint = (robot.front_m, robot.rear_m, robot.width_m / 2)
        self.fresh = Freshness(self.window.grid, obstacle.free_max_age_s, footprint)
        self._mount_xy_m = scanner.mount_x_m, scanner.mount_y_m
        self._source: I32 = np.full((size, size), NOWHERE, dtype=np.int32)
        self._at: I32 = np.full(size**2, 0, dtype=np.int32)
        self._new: I8 = np.full(size**2, 0, dtype=np.int8)
        self._beams = (0, 0.0, 0.0)

    def warm(self) -> None:
        """The first scan runs all the others."""
        self.plane.grid.warm()

    def add(self, scan: Scan | PointSweep, attitudes: AttitudeRing, odometry: Track) -> int:
        if not isinstance(scan, Scan):
            raise ValueError("the reference plane is made for scanners of one plane")
        last_s = scan.t_s + (scan.ranges_m.shape[1] - 1) * scan.beam_dt_s
        self._follow_beams(scan)
        roll_rad, pitch_rad, yaw_rad = attitudes.rpy_at(last_s)
        ranges_m = np.where(scan.ranges_m[0] >= MIN_RANGE_M, scan.ranges_m[0], np.nan)
        restarts = self.plane.restarts
        used = self.plane.add(ranges_m, yaw_rad, pitch_rad, roll_rad, odometry.place_at(last_s)[3])
        if self.plane.restarts != restarts:
            self.window.erase()
        self._show(last_s, odometry.xy_at(last_s), yaw_rad - odometry.yaw_start_rad)
        return used

    def _follow_beams(self, scan: Scan) -> None:
        """Other beams than so far are another reference plane: all starts anew."""
        beams = scan.ranges_m.shape[1], scan.first_rad, scan.step_rad
        if beams != self._beams:
            bearing_rad = scan.first_rad + scan.step_rad * np.arange(beams[0], dtype=np.float64)
            self.plane.set_beams(sigma_from_bearing(bearing_rad))
            if self._beams[0] != 0:
                self.erase()
            self._beams = beams

    def _show(self, t_s: float, xy_m: F64, yaw_rad: float) -> None:
        """The paper's states in the window, from the body's position (2,) and yaw in the map."""
        x_m, y_m = float(xy_m[0]), float(xy_m[1])
        self.window.follow(x_m, y_m)
        c, s = math.cos(yaw_rad), math.sin(yaw_rad)
        forward_m, left_m = self._mount_xy_m
        lens = x_m + c * forward_m - s * left_m, y_m + s * forward_m + c * left_m, yaw_rad
        corner = self.window.grid.corner_i, self.window.grid.corner_j
        states, cell_m = self.plane.obstacles, self.plane.settings.cell_m
        _find_sources(corner, lens, states, cell_m, self._source)
        self.plane.grid.seen_s.ravel()[self.plane.touched] = t_s
        self.fresh.follow(t_s, x_m, y_m, (c, s))
        changed = _list_changes(
            self._source.ravel(),
            states.ravel(),
            self.plane.grid.seen_s.ravel(),
            self.fresh.seen_s,
            self.fresh.oldest_s,
            self.window.cells.ravel(),
            self._at,
            self._new,
        )
        self.window.put(self._at[:changed], self._new[:changed])

    def maybe_ring(self, name: str) -> RingLayer | None:
        """Height above the reference; none for any other name."""
        sources, averages_m = self._source.reshape(-1), self.plane.elevation_m.reshape(-1)

        def heights_m(at: I64) -> F64:
            source = sources[at]
            return np.where(source == NOWHERE, np.nan, averages_m[source])

        return (self.window.grid, heights_m) if name == "height" else None

    def maybe_ground(self) -> None:
        """None: heights of different references can't be compared."""

    def evidence(self, i: int, j: int) -> dict[str, float]:
        """Nothing that is not in its layers."""
        return {}

    def _cells(self, i: I64, j: I64) -> I32:
        """Flat indices (n,) in the window of world cells; -1 outside."""
        found = at_cells(self.window.grid, i, j, lambda at: at.astype(np.float64))
        return np.where(np.isnan(found), -1, found).astype(np.int32)

    def causes(self, i: I64, j: I64) -> F64:
        plane, settings, fresh = self.plane.grid, self.plane.settings, self.fresh
        found: U8 = np.zeros(i.size, dtype=np.uint8)
        _list_causes(
            self._cells(i, j),
            self._source.ravel(),
            plane.states.ravel(),
            plane.average_m.ravel(),
            plane.count.ravel(),
            (settings.h_pos_m, settings.h_neg_m),
            (plane.seen_s.ravel(), fresh.seen_s, fresh.oldest_s),
            self.window.cells.ravel(),
            found,
        )
        return found.astype(np.float64)

    def ages_s(self, i: I64, j: I64) -> F64:
        """Of the paper's cells that beams met, and ours that the robot stood on."""
        at, fresh = self._cells(i, j), self.fresh
        sources = np.where(at < 0, NOWHERE, self._source.ravel()[at])
        met_s = np.where(sources == NOWHERE, -np.inf, self.plane.grid.seen_s.ravel()[sources])
        seen_s = np.where(at < 0, -np.inf, np.maximum(met_s, fresh.seen_s[at]))
        return fresh.ages_s(seen_s)

    def erase(self) -> None:
        self.plane.erase()
        self.window.erase()
        self._source[...] = NOWHERE

    def heights_m(self) -> F64:
        """Average heights (size, size) of what the window shows, in its layout; NaN: nothing."""
        averages_m = self.plane.elevation_m.ravel()
        return np.where(self._source == NOWHERE, np.nan, averages_m[self._source])
