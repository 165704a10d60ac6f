"""Method `surface`: a map of the ground and of what stands on it, in heights of the map frame.

For each sweep: cast its beams; hold each return against the ground that is known or predicted
there; take the sweep's own error out; put the returns into cells; follow the beams through cells;
tie ground to what can be reached; decide the cells again that were touched.

Source: docs/method.md, section 1.
"""

import math

import numpy as np

from core.config import Config
from core.grid.places import PART_M, parts_of
from core.grid.ring import RingGrid
from core.grid.touched import Touched
from core.grid.window import ObstacleWindow, Shown
from core.mapping import along, layers
from core.mapping.body import AT_START, BodyPose, Sway, body_pose_at
from core.mapping.freshness import Freshness
from core.mapping.heights.told import Heights
from core.mapping.heights.upper import BLANK_UPPER, NO_UPPERS, UPPER, see_uppers
from core.mapping.rays import BeamGeometry
from core.mapping.slip import FaceMatcher
from core.mapping.surface import cells, sweep
from core.mapping.surface.cells import CELL, LOOSE, TIED, Limits, Room, Surface
from core.mapping.surface.constants import *
from core.mapping.surface.decision import decide_cells, list_causes
from core.mapping.surface.error import SweepFilter, roll_on, set_right
from core.mapping.surface.evidence import end_beams, spread_ties
from core.mapping.surface.passing import follow_beams
from core.mapping.surface.sweep import RETURN, Beams, agree, find_faces, find_witnesses, hold
from core.motion.attitude import AttitudeRing
from core.motion.track import Track
from core.records import F64, I32, I64, U8, UNKNOWN, PointSweep, Scan
from jit import Settled, kernel, records, with_fields

EVIDENCE = {  # fields of a cell, by what they tell
    "scans that saw its floor": "looks",
    "log-odds that something stands in it": "stands",
    "log-odds that this lets beams in": "soft",
}


@kernel
def take_sweep(
    first: Beams, behind: Beams, passed_s: float, rolled_s: float, surface: Surface, shown: Shown,
    used: int,
) -> tuple[int, int]:  # fmt: skip
    """A sweep's first echoes, and what ends behind those; the first ones alone set it right.

    Args:
        behind: the second echoes; of no returns where there are none.
        passed_s, rolled_s: since the last scan; and if the robot has moved, else 0.

    Returns:
        How many returns there are, and how many cells of the window have changed (before: `used`).
    """
    touched, now, count, tied = surface.touched, surface.now[0], 0, 0
    touched.used[0] = 0
    now.scan += 1
    roll_on(rolled_s, surface)
    for echo in range(2):
        beams = first if echo == 0 else behind
        if beams.returns.size == 0:
            break
        count += hold(beams, surface)
        find_faces(beams.returns, surface.limits.is_plane)
        if echo == 0:
            agree(beams.returns, LOOSE if now.anchored else TIED, surface)
            find_witnesses(beams, surface)
        set_right(beams.returns, passed_s, surface)
        end_beams(beams, surface)
        see_uppers(beams.returns, surface)
    follow_beams(first, surface)
    spread_ties(surface)
    if now.anchored == 0:
        for at in touched.at[: touched.used[0]]:
            tied += surface.cells[at].tied == TIED and surface.cells[at].looks > 1
        now.anchored = tied > WITNESSES
    return count, decide_cells(touched.at[: touched.used[0]], surface, shown, used)


def limits_of(config: Config, are_pictures: bool = False) -> Limits:
    """What the settings tell, worked out once.

    Args:
        are_pictures: sweeps show fields of floor, not a line of it: what stands there shows, too.
    """
    scanner, obstacle, mount_z_m = config.scanner, config.obstacle, config.scanner.mount_z_m
    tilt_rad, spec = math.radians(max(0.0, scanner.mount_tilt_deg)), scanner.options.spec
    far_m = mount_z_m / max(math.tan(tilt_rad), mount_z_m / along.REACH_M)
    away_m, parts = math.hypot(mount_z_m, far_m), parts_of(config.map.cell_m)
    guess_m2 = (GUESS * obstacle.h_pos_m) ** 2
    limits = Limits(
        h_pos_m=obstacle.h_pos_m,
        h_neg_m=obstacle.h_neg_m,
        height_m=config.robot.height_m,
        soft_m=obstacle.soft_free_below_m,
        guess_m2=guess_m2,
        sure_m2=guess_m2,
        wheels_m2=math.inf,
        floor_says=PASS_LOW if are_pictures else 0.0,
        sigma_m=spec.sigma_m,
        sigma_share=spec.sigma_share,
        noise_m2=0.0,
        far_m=far_m,
        is_plane=spec.is_plane,
        rises=0.5 * mount_z_m / far_m,
        parts=parts,
        row=min(parts, parts * parts - 1),
        block=max(1, round(REACH_M / config.map.cell_m)),
    )
    noise_m2 = sweep.noise_m2(away_m, mount_z_m / away_m, FLAT_M**2, limits)
    return limits._replace(noise_m2=noise_m2)


def as_it_stands(limits: Limits) -> Limits:
    """The same for a robot that has not moved yet: floor is the plane on which it stands."""
    floor_m2 = (limits.h_pos_m / GATE) ** 2  # sure_m2 is less: what lies on it is set by agreement
    return limits._replace(sure_m2=0.5 * floor_m2, wheels_m2=floor_m2, floor_says=PASS_LOW, row=0)


class SurfaceMaps:
    """`Maps` of one run, kept up scan by scan."""

    def __init__(self, config: Config, are_pictures: bool = False) -> None:
        scanner, robot, window_cells = config.scanner, config.robot, config.obstacle.window_cells
        beams = scanner.options.spec.max_beams
        self._geometry = BeamGeometry.of(scanner)
        self.grid = RingGrid(config.map.cells, config.map.cell_m)
        self.cells: cells.Cells = self.grid.layer(CELL, cells.BLANK)
        uppers = NO_UPPERS
        if config.map.filter_heights:
            uppers = with_fields(self.grid.layer(UPPER, BLANK_UPPER).reshape(-1))
        self.window = ObstacleWindow(window_cells, config.map.cell_m)
        footprint = (robot.front_m, robot.rear_m, robot.width_m / 2)
        self.fresh = Freshness(self.grid, config.obstacle.free_max_age_s, footprint)
        # a wheel that lifts the lens tips the body, by the lever from the axle to the lens
        self._error, self._sway = SweepFilter(), Sway(ALIKE_S, scanner.mount_x_m)
        self._limits = limits_of(config, are_pictures)
        self._stood: BodyPose | None = None  # where its map began, until it moves
        h_pos_m = self._limits.h_pos_m
        self._heights = Heights(self.grid, self.cells, uppers, self.static_rad, h_pos_m)
        self._surface = Surface(
            cells=with_fields(self.cells.reshape(-1)),
            tall=self.grid.layer(np.uint8, 0).reshape(-1),
            seen_s=self.fresh.seen_s,
            oldest_s=-math.inf,
            ring=self.grid.ring,
            limits=as_it_stands(self._limits),
            stand=AT_START,
            own=self._error.own,
            P=self._error.P,
            touched=Touched.none(self.cells.size),
            now=records(cells.NOW),
            uppers=uppers,
            room=Room.none(),
        )
        self._returns = [records(RETURN, beams) for _ in range(2)]
        self._returns[1]["witness"] = -1  # second echoes tell nothing of the sweep
        self._faces = FaceMatcher(self.grid, beams)
        self._take = Settled(take_sweep)

    def warm(self) -> None:
        nothing = np.zeros(0, dtype=np.int32)
        self.window.put(nothing, np.zeros(0, dtype=np.int8))
        decide_cells(nothing, self._surface, self.window.shown, 0)
        self.causes(nothing.astype(np.int64), nothing.astype(np.int64))

    def add(self, scan: Scan | PointSweep, attitudes: AttitudeRing, odometry: Track) -> int:
        """Take a sweep that attitude and odometry cover; how many returns it had."""
        rays = self._geometry.cast(scan, attitudes, odometry)
        body = body_pose_at(rays.t_s, attitudes, odometry)
        self._move(body)
        passed_s, driven_m = self._error.follow(body, attitudes.orientation.doubted)
        lens_m2 = FLAT_M**2 + self._sway.follow(passed_s, body.slopes) ** 2
        self.grid.follow(body.x_m, body.y_m)
        self.fresh.follow(rays.t_s, body.x_m, body.y_m, body.heading)
        surface, window = self._stand(body._replace(slopes=self._sway.slopes)), self.window
        entered = window.follow_in(self.grid, body.x_m, body.y_m)
        shown = window.shown
        if entered.size:
            window.used = decide_cells(entered, surface, shown, window.used)
        n, ranges_m = len(rays.rays), rays.ranges_m
        first, behind = (
            Beams(rays.origins, rays.rays, ranges_m[k:], of[: n * (k < len(ranges_m))], lens_m2)
            for k, of in enumerate(self._returns)
        )
        rolled_s = passed_s if driven_m else 0.0
        count, window.used = self._take(
            first, behind, passed_s, rolled_s, surface, shown, window.used
        )
        self._faces.set_right(rays, first.returns["height_m"], body, odometry)
        self.fresh.expire(window)
        return count

    def _move(self, body: BodyPose) -> None:
        """What a robot saw that had not moved yet is a first guess; the map begins as it moves."""
        if self._surface.limits is self._limits:
            return  # it has moved
        if self._stood is None:
            self._stood = body
        (hx, hy), (gx, gy) = body.heading, self._stood.heading
        driven_m = abs(body.travel_m - self._stood.travel_m)
        turned_m = math.hypot(hx - gx, hy - gy) * self._limits.far_m
        if driven_m > PART_M or turned_m > THING_M:
            told = np.flatnonzero(self.window.cells).astype(np.int32)
            self.window.put(told, np.full(told.size, UNKNOWN, dtype=np.int8))
            self._forget()
            self._surface = self._surface._replace(limits=self._limits)

    def _stand(self, body: BodyPose) -> Surface:
        """The robot stands there, at this instant."""
        ring, oldest_s = self.grid.ring, self.fresh.oldest_s
        self._surface = self._surface._replace(ring=ring, oldest_s=oldest_s, stand=body)
        return self._surface

    def causes(self, i: I64, j: I64) -> F64:
        found: U8 = np.zeros(i.size, dtype=np.uint8)
        surface = self._stand(self._surface.stand)
        list_causes(i, j, surface, self.window.shown, found)
        return found.astype(np.float64)

    def heights_m(self) -> F64:
        """Heights (size, size) of the grid, map frame: what stands, else the ground; NaN: none."""
        told_m, _ = self._heights.told_at(np.arange(self.cells.size))
        return told_m.reshape(self.cells.shape)

    def ages_s(self, i: I64, j: I64) -> F64:
        seen_s = layers.at_cells(self.grid, i, j, lambda at: self.fresh.seen_s[at])
        return self.fresh.ages_s(seen_s)

    def maybe_ring(self, name: str) -> layers.RingLayer | None:
        return self._heights.maybe_ring(name)

    def maybe_ground(self) -> Heights:
        return self._heights

    def evidence(self, i: int, j: int) -> dict[str, float]:
        record = self.cells[j % self.grid.size, i % self.grid.size]
        return {about: round(float(record[field]), 1) for about, field in EVIDENCE.items()}

    @property
    def static_rad(self) -> F64:
        """What pitch and roll are always wrong by, (2,), as far as that is known."""
        return self._error.own[3:]

    def go_on_from(self, at: I32, records: cells.Cells, static_rad: F64) -> None:
        """Cells of an earlier run by flat indices (n,), into a map that is empty."""
        self._surface.cells[at] = records
        self._surface.tall[at] = (records["stands"] > CLEAR) & np.isfinite(records["top_m"])
        self._error.own[3:] = static_rad
        self._surface = self._surface._replace(limits=self._limits)

    def _forget(self) -> None:
        """Nothing is known of the ground, or of the sweep's error."""
        self.grid.erase()
        self._error.restart()
        self._faces.erase()
        self._surface.now["anchored"] = 0

    def erase(self) -> None:
        """Forget everything."""
        self._forget()
        self.window.erase()
        self._stood = None
        self._surface = self._surface._replace(limits=as_it_stands(self._limits))
