"""Method `surface`: a map of the ground and of what stands on it, in heights of the map frame.

For each sweep: cast its beams; hold each return against the ground that is known or predicted
there; take the sweep's own error out; put the returns into cells; follow the beams through cells;
tie ground to what can be reached; decide the cells again that were touched.

Source: docs/method.md, section 1.
"""

import math

import numpy as np

from core.config import Config
from core.grid.places import parts_of
from core.grid.ring import RingGrid
from core.grid.window import ObstacleWindow
from core.mapping.along import REACH_M
from core.mapping.body import body_pose_at
from core.mapping.causes import BEYOND_STEP, NO_FLOOR
from core.mapping.freshness import Freshness
from core.mapping.layers import LayerView, ages_at, at_cells, state_view, states_at, view_of
from core.mapping.rays import BeamGeometry
from core.mapping.slip import FaceMatcher
from core.mapping.surface.cells import BLANK, CELL, LOOSE, TIED, Cells, Ground, Surface
from core.mapping.surface.constants import CLEAR, FLAT_M, GUESS, LIKELY, WITNESSES
from core.mapping.surface.decision import Decision, Shown, decide_cells
from core.mapping.surface.error import Room, SweepFilter, roll_on, set_right
from core.mapping.surface.evidence import end_beams
from core.mapping.surface.passing import follow_beams
from core.mapping.surface.sweep import (
    RETURN,
    Beams,
    Stand,
    Sway,
    agree,
    find_faces,
    find_witnesses,
    hold,
    noise_m2,
)
from core.mapping.surface.ties import spread_ties
from core.mapping.surface.touched import Limits, Touched, none_touched
from core.mapping.terrain import F32, JUDGED, around, terrain_of
from core.motion.attitude import AttitudeRing
from core.motion.odometry import Odometry
from core.records import F64, I32, I64, PointSweep, Scan
from jit import kernel, records, with_fields

EVIDENCE = {  # fields of a cell, by what they tell
    "scans that saw its floor": "looks",
    "log-odds that something stands in it": "stands",
    "log-odds that this lets beams in": "soft",
}


@kernel
def take_sweep(
    first: Beams, behind: Beams, stand: Stand, passed_s: float, guess: int, limits: Limits,
    surface: Surface, P: F64, room: Room, touched: Touched, shown: Shown, used: int,
) -> tuple[int, int]:  # fmt: skip
    """A sweep's first echoes, and what ends behind those; the first ones alone set it right.

    Args:
        behind: the second echoes; of no returns where there are none.
        guess: what ground is tied to on which most returns agree.

    Returns:
        How many returns there are, and how many cells of the window have changed (before: `used`).
    """
    touched.used[0] = 0
    count = hold(first, stand, limits.h_pos_m, surface)
    find_faces(first.returns)
    agree(first.returns, guess, limits, room.bins)
    find_witnesses(first, stand, surface)
    set_right(first.returns, stand.t_s, passed_s, stand.travel_m, surface, P, room)
    end_beams(first, stand, limits, surface, touched)
    if behind.returns.size > 0:
        count += hold(behind, stand, limits.h_pos_m, surface)
        find_faces(behind.returns)
        set_right(behind.returns, stand.t_s, passed_s, stand.travel_m, surface, P, room)
        end_beams(behind, stand, limits, surface, touched)
    follow_beams(first, stand, limits, surface, P, touched)
    spread_ties(limits, surface, touched)
    return count, decide_cells(touched.at[: touched.used[0]], surface, limits, shown, used)


class SurfaceMaps:
    """The maps of one run, kept up scan by scan."""

    def __init__(self, config: Config) -> None:
        scanner, obstacle, robot = config.scanner, config.obstacle, config.robot
        spec = scanner.options.spec
        tilt_rad = math.radians(max(0.0, scanner.mount_tilt_deg))
        far_m = scanner.mount_z_m / max(math.tan(tilt_rad), scanner.mount_z_m / REACH_M)
        rises, away_m = 0.5 * scanner.mount_z_m / far_m, math.hypot(scanner.mount_z_m, far_m)
        self._geometry = BeamGeometry.of(scanner)
        self.grid = RingGrid(config.map.cells, config.map.cell_m)
        self.cells: Cells = self.grid.layer(CELL, BLANK)
        self._flat = with_fields(self.cells.reshape(-1))
        self.window = ObstacleWindow(obstacle.window_cells, config.map.cell_m)
        footprint = (robot.front_m, robot.rear_m, robot.width_m / 2)
        self.fresh = Freshness(self.grid, obstacle.free_max_age_s, footprint)
        parts = parts_of(config.map.cell_m)
        self._limits = Limits(
            obstacle.h_pos_m, obstacle.h_neg_m, robot.height_m, (GUESS * obstacle.h_pos_m) ** 2,
            math.sqrt(2.0) * far_m, parts, obstacle.soft_free_below_m,
        )  # fmt: skip
        noise = noise_m2(away_m, scanner.mount_z_m / away_m, FLAT_M**2)
        self._decision = Decision(self.window, self.fresh, self._limits, noise)
        self._error = SweepFilter(far_m)
        self._ground = Ground(self._flat, self.grid.size, self.grid.cell_m, rises, self._error.own)
        self._sway = Sway(scanner.mount_x_m)
        tall = self.grid.layer(np.uint8, 0).reshape(-1)
        self._touched = none_touched(tall, self.fresh.seen_s)
        self._returns = [records(RETURN, spec.max_beams) for _ in range(2)]
        for echo in self._returns:
            echo["witness"] = -1
        self._faces = FaceMatcher(self.grid, spec.max_beams)
        self._anchored = False  # some ground is tied to that under the wheels

    def warm(self) -> None:
        """Run the kernels to which the first scans do not come, once; the maps stay empty."""
        nothing = np.zeros(0, dtype=np.int32)
        self.window.put(nothing, np.zeros(0, dtype=np.int8))
        self._error.warm()
        decide_cells(nothing, self._surface, self._limits, self._decision.shown, 0)
        self.causes(nothing.astype(np.int64), nothing.astype(np.int64))

    @property
    def error_rad(self) -> tuple[float, float]:
        """By how much roll and pitch of the newest sweep were told too large."""
        own = self._error.own
        return float(own[2] + own[4]), float(-own[1] - own[3])

    @property
    def _surface(self) -> Surface:
        return self._ground.surface(self.grid.corner_i, self.grid.corner_j)

    def add(self, scan: Scan | PointSweep, attitudes: AttitudeRing, odometry: Odometry) -> int:
        """Take a sweep that attitude and odometry cover; how many returns it had."""
        sweep = self._geometry.cast(scan, attitudes, odometry)
        body = body_pose_at(sweep.t_s, attitudes, odometry)
        passed_s, driven_m = self._error.follow(sweep.t_s, body.travel_m, attitudes.orientation)
        lens_m2 = self._sway.follow(passed_s, body.slopes)
        self.grid.follow(body.x_m, body.y_m)
        surface, own, P = self._surface, self._error.own, self._error.P
        self.fresh.follow(sweep.t_s, body.x_m, body.y_m, body.heading)
        self._decision.follow(body.x_m, body.y_m, self.grid, surface)
        place = (body.x_m, body.y_m, body.z_m, body.travel_m)
        roll_on(
            *place, passed_s if driven_m else 0.0, self._error.far_m, surface, P, self._error.room
        )
        z_m = body.z_m - own[0] - own[3] * body.travel_m
        stand = Stand(
            body.x_m, body.y_m, z_m, *self._sway.slopes, *body.heading, sweep.t_s, body.travel_m
        )
        self._sway.stand = stand
        n, ranges_m = len(sweep.rays), sweep.ranges_m
        first, behind = (
            Beams(
                sweep.origins, sweep.rays, ranges_m[k:], returns[: n * (k < len(ranges_m))], lens_m2
            )
            for k, returns in enumerate(self._returns)
        )
        self._touched = self._touched._replace(oldest_s=self.fresh.oldest_s)
        count, self.window.used = take_sweep(
            first, behind, stand, passed_s, LOOSE if self._anchored else TIED, self._limits,
            surface, P, self._error.room, self._touched, self._decision.shown,
            self.window.used,
        )  # fmt: skip
        if not self._anchored:
            seen = surface.cells[self._touched.at[: self._touched.used[0]]]
            self._anchored = int(((seen["tied"] == TIED) & (seen["looks"] > 1)).sum()) > WITNESSES
        self._faces.set_right(sweep, first.returns["height_m"], body, odometry, is_sure=True)
        self.fresh.expire(self.window)
        return count

    def causes(self, i: I64, j: I64) -> F64:
        """Why the window shows what it does at world cells i, j (n,)."""
        return self._decision.causes(i, j, self._surface).astype(np.float64)

    def heights_m(self) -> F64:
        """Heights (size, size) of the grid, map frame: what stands, else the ground; NaN: none."""
        cells, own = self.cells, self._error.own
        ground = cells["ground_m"] - own[3] * cells["arm_m"] - own[4] * cells["aside_m"]
        heights_m: F64 = ground + self._over_ground_m()
        return heights_m

    def heights_over_plane_m(self) -> F64:
        """The same over the plane on which the robot stands: what is always wrong tilts both."""
        stand, grid = self._sway.stand, self.grid
        if stand is None:
            return self.heights_m()
        places = np.arange(grid.size)
        x_m = grid.corner_i + (places - grid.corner_i) % grid.size + 0.5
        y_m = grid.corner_j + (places - grid.corner_j) % grid.size + 0.5
        dx_m, dy_m = x_m * grid.cell_m - stand.x_m, y_m * grid.cell_m - stand.y_m
        along = stand.slope_x * dx_m[None, :] + stand.slope_y * dy_m[:, None]
        return np.asarray(self.heights_m() - stand.z_m - along)

    def _over_ground_m(self) -> F64:
        """How high what stands is, 0 where floor was seen, NaN elsewhere: (size, size)."""
        cells = self.cells
        stands = (cells["stands"] > 0.0) & np.isfinite(cells["top_m"])
        floor = np.where(cells["looks"] > 0, 0.0, np.nan)
        return np.where(stands, cells["top_m"], floor)

    def _terrain(self) -> F32:
        """Slope, step and roughness (3, n) of all cells: slopes, what stands, and what lacks."""
        flat, cell_m = self._flat, self.grid.cell_m
        near = around(self.grid, np.arange(flat.size))
        z_m = np.where(near >= 0, self.heights_m().reshape(-1)[near], np.nan)
        slopes = np.abs(flat["slope_x"]) + np.abs(flat["slope_y"])
        stands_m = np.where(flat["stands"] > 0.0, np.maximum(0.0, flat["top_m"]), 0.0)
        relief_m = stands_m - np.minimum(0.0, flat["under_m"]) + cell_m * slopes
        return terrain_of(z_m, relief_m, cell_m)

    def _maybe_ring(self, name: str) -> F64 | None:
        """A layer (size, size) of the grid."""
        cells = self.cells
        if name == "height":
            return self._over_ground_m()
        if name == "z":
            return self.heights_m()
        if name == "variance":
            return np.where(cells["looks"] > 0, cells["var_m2"], np.nan)
        if name == "slope":
            slope = np.arctan(np.hypot(cells["slope_x"], cells["slope_y"]))
            return np.where(cells["looks"] > 0, slope, np.nan)
        if name == "soft":
            soft = (cells["stands"] > 0.0) & (cells["soft"] >= LIKELY)
            return np.where(np.isnan(self._over_ground_m()), np.nan, soft)
        if name in JUDGED:
            return np.asarray(self._terrain()[JUDGED.index(name)].reshape(cells.shape), float)
        return None

    def maybe_layer(self, name: str) -> LayerView | None:
        """A layer by its name; none where there is none."""
        if name == "state":
            return state_view(self.window)
        ring = self._maybe_ring(name)
        return None if ring is None else view_of(name, self.grid, ring)

    def maybe_values(self, name: str, i: I64, j: I64) -> F64 | None:
        """Of a layer, at world cells."""
        if name == "state":
            return states_at(self.window, i, j)
        if name == "cause":
            return self.causes(i, j)
        if name == "age":
            return ages_at(self.fresh, self.grid, i, j)
        ring = self._maybe_ring(name)
        return None if ring is None else at_cells(self.grid, i, j, ring)

    def evidence(self, i: int, j: int) -> dict[str, float]:
        """What was counted in a world cell, by what it counts."""
        record = self.cells[j % self.grid.size, i % self.grid.size]
        return {about: round(float(record[field]), 1) for about, field in EVIDENCE.items()}

    @property
    def static_rad(self) -> F64:
        """What pitch and roll are always wrong by, (2,), as far as that is known."""
        return self._error.own[3:]

    def go_on_from(self, at: I32, records: Cells, static_rad: F64) -> None:
        """Cells of an earlier run by flat indices (n,), into a map that is empty."""
        self._flat[at] = records
        self._touched.tall[at] = (records["stands"] > CLEAR) & np.isfinite(records["top_m"])
        self._error.own[3:] = static_rad
        self._anchored = True

    def erase(self) -> None:
        """Forget everything."""
        self.grid.erase()
        self.window.erase()
        self._error.restart()
        self._faces.erase()
        self._anchored = False

    def is_low(self, i: int, j: int) -> bool:
        """Whether an obstacle cell is one by missing ground, not by something that stands."""
        if not self.window.is_obstacle(i, j):
            return False
        cause = int(self.causes(np.array([i]), np.array([j]))[0])
        return cause in (NO_FLOOR, BEYOND_STEP)
