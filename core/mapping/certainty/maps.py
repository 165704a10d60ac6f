"""Method `certainty`: elevation and certainty of small cells about the sensor, scan by scan.

For each scan: cast its beams; take out what is likely no surface; with three scans at hand judge
the middle one; put its readings into cells; filter; decide again the cells that it touched. So a
map that looks at three scans is one scan behind. Of two echoes the first counts.
Source: docs/certainty.md, equation by equation; design, section 7.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from core.config import Config
from core.geometry import R_from_rpy
from core.grid.ring import RingGrid
from core.grid.touched import Touched
from core.grid.window import ObstacleWindow, Shown
from core.mapping import layers
from core.mapping.body import AT_START, BodyPose, body_pose_at
from core.mapping.certainty import scans
from core.mapping.certainty.cas import heights_at, mark
from core.mapping.certainty.cells import Cells, Pass, Rules, gather, update, widen
from core.mapping.certainty.decision import decide, list_causes
from core.mapping.certainty.limit import changes_of, frame_of, limits_of
from core.mapping.certainty.scans import Look
from core.mapping.footing import Ground
from core.mapping.freshness import Freshness
from core.mapping.rays import BeamGeometry, Sweep
from core.mapping.terrain import JUDGED, OWN, around, terrain_of
from core.motion.attitude import AttitudeRing
from core.motion.track import Track
from core.records import F64, I32, I64, U8, PointSweep, Scan
from jit import Settled, kernel

HEIGHTS = ("z", "height")


@dataclass(slots=True)
class Kept:
    """A scan that waits for the next one; room for the most beams there can be."""

    max_beams: int
    ranges_m: F64 = field(init=False)  # (n,), and all others too; NaN: nothing, or taken out
    limits_m: F64 = field(init=False)
    points: F64 = field(init=False)  # (n, 3), map frame
    beams: tuple[int, float, float] = (0, 0.0, 0.0)  # how many, first and step; 0: no scan
    t_s: float = -math.inf  # of its last beam
    turn_rad: float = 0.0  # how far its beams are turned, within their plane

    def __post_init__(self) -> None:
        self.ranges_m = np.full(self.max_beams, math.nan)
        self.limits_m, self.points = np.zeros(self.max_beams), np.zeros((self.max_beams, 3))

    def look_for(self, judged: "Kept") -> Look:
        """It as another scan, which is judged, compares itself with it."""
        n, _, step_rad = self.beams
        if n == 0 or self.beams != judged.beams:
            return Look(self.ranges_m[:0], math.nan)
        turned_rad = judged.turn_rad - self.turn_rad
        return Look(self.ranges_m[:n], turned_rad / step_rad if step_rad else 0.0)


@kernel
def map_scan(
    points: F64,
    limits_m: F64,
    kept: U8,
    t_s: float,
    room: tuple[Pass, Touched, Touched],
    cells: Cells,
    body: BodyPose,
    oldest_s: float,
    rules: Rules,
    shown: Shown,
    used: int,
) -> tuple[int, int]:
    """Readings (n, 3) into cells, the filter, and what that means.

    Args:
        room: for the cells that are met, those and their neighbours, and the neighbours of these.

    Returns:
        How many readings fell into the map, and how many cells of the window have changed.
    """
    one, near, about = room
    count = gather(points, limits_m, kept, body, rules, cells.ring, one)
    update(one, t_s, cells, rules)
    widen(one.met, cells.ring, near)
    mark(near, cells, rules)
    widen(near, cells.ring, about)
    return count, decide(about.at[: about.used[0]], cells, body, oldest_s, rules, shown, used)


def bearings_of(directions: F64) -> tuple[float, float]:
    """First bearing and mean step of rays (n, 3) of one lens, side by side, sensor frame."""
    first, last = (math.atan2(directions[k, 1], directions[k, 0]) for k in (0, -1))
    return first, (last - first) / max(1, len(directions) - 1)


def rules_of(config: Config) -> Rules:
    """What the settings tell."""
    given, obstacle = config.certainty, config.obstacle
    assert given is not None  # as the settings were checked
    return Rules(
        gain=given.gain,
        most=given.most,
        free_from=given.free_from,
        cas=given.cas,
        cas_certainty=given.cas_certainty,
        cas_height_m=given.cas_height_m,
        h_pos_m=obstacle.h_pos_m,
        h_neg_m=obstacle.h_neg_m,
        height_m=config.robot.height_m,
    )


class CertaintyMaps:
    """`Maps` by elevation and certainty, about the sensor."""

    def __init__(self, config: Config) -> None:
        assert config.certainty is not None  # as the settings were checked
        scanner, robot, settings = config.scanner, config.robot, config.certainty
        self._config, self._settings, self._rules = config, settings, rules_of(config)
        self._geometry = BeamGeometry.of(scanner)
        self._R_body_sensor = R_from_rpy(*scanner.mount_rpy_rad)
        spec = scanner.options.spec
        assert spec.light_normal is not None  # likewise
        self._is_fan, self._normal_body = spec.is_plane, self._R_body_sensor @ spec.light_normal
        self._bearings = bearings_of(spec.directions)
        self.grid = RingGrid(config.map.cells, config.map.cell_m)
        self.window = ObstacleWindow(config.obstacle.window_cells, config.map.cell_m)
        footprint = (robot.front_m, robot.rear_m, robot.width_m / 2)
        self.fresh = Freshness(self.grid, config.obstacle.free_max_age_s, footprint)
        count, beams = config.map.cells**2, spec.max_beams
        self.cells = Cells(
            height_m=self.grid.layer(np.float64, math.nan).reshape(-1),
            low_m=self.grid.layer(np.float64, math.nan).reshape(-1),
            certainty=self.grid.layer(np.int32, 0).reshape(-1),
            marks=self.grid.layer(np.uint8, 0).reshape(-1),
            seen_s=self.fresh.seen_s,
            ring=self.grid.ring,
        )
        low_m, limit_m = np.zeros((2, count))
        self._pass = Pass(Touched.none(count), low_m, limit_m, np.zeros(count, dtype=np.int32))
        self._near, self._about = Touched.none(count), Touched.none(count)
        self._scans = [Kept(beams) for _ in range(3)]  # the oldest first
        self._room: U8 = np.zeros(beams, dtype=np.uint8)
        self._body = AT_START
        self._step_rad, self._changes = 0.0, changes_of(config, 0.0)
        self._limits_of, self._map_scan = Settled(limits_of), Settled(map_scan)
        self._yaw_rad = self._turned_rad = 0.0  # of the body; without its jumps by a whole turn

    def warm(self) -> None:
        """Run the kernels to which the first scans do not come, once; the maps stay empty."""
        none, nowhere = np.zeros(0), np.zeros(0, dtype=np.int64)
        look, kept = Look(none, math.nan), self._room[:0]
        scans.keep_all(none, kept)
        scans.keep_supported(none, look, look, self._settings.three_scans_m, kept)
        scans.drop_small_groups(none, none, self._settings.group_gap_m, self._settings.min_group)
        self.window.put(nowhere.astype(np.int32), np.zeros(0, dtype=np.int8))
        self._map(np.zeros((0, 3)), none, kept, 0.0)
        self._decide(nowhere.astype(np.int32))
        self.causes(nowhere, nowhere)
        self._heights_m(nowhere, fills=True)

    def add(self, scan: Scan | PointSweep, attitudes: AttitudeRing, odometry: Track) -> int:
        """Take a scan that both cover; how many readings were mapped, of this scan or the last."""
        if self._is_fan and not isinstance(scan, Scan):
            raise ValueError("method certainty knows rays of no plane: its scanner sends fans")
        rays = self._geometry.cast(scan, attitudes, odometry)
        self._body = body_pose_at(rays.t_s, attitudes, odometry)
        lens_x_m, lens_y_m = float(rays.origins[-1, 0]), float(rays.origins[-1, 1])
        self.grid.follow(lens_x_m, lens_y_m)
        self.cells = self.cells._replace(ring=self.grid.ring)
        self.fresh.follow(rays.t_s, self._body.x_m, self._body.y_m, self._body.heading)
        entered = self.window.follow_in(self.grid, lens_x_m, lens_y_m)
        if entered.size:
            self._decide(entered)
        self._scans.append(self._scans.pop(0))
        self._take(scan, rays, attitudes.rpy_at(rays.t_s), odometry.yaw_start_rad)
        used = self._map_due()
        self.fresh.expire(self.window)
        return used

    def _take(
        self,
        scan: Scan | PointSweep,
        rays: Sweep,
        rpy_rad: tuple[float, float, float],
        yaw_start_rad: float,
    ) -> None:
        """A scan with what is likely no surface taken out, and the limits of its readings."""
        newest, settings = self._scans[-1], self._settings
        n = scan.ranges_m.shape[1]
        first_rad, step_rad = self._bearings
        if isinstance(scan, Scan):
            first_rad, step_rad = scan.first_rad, scan.step_rad
        newest.beams, newest.t_s = (n, first_rad, step_rad), rays.t_s
        # a tilted plane is turned by less than the body, one that is upside down the other way
        self._turned_rad += math.remainder(rpy_rad[2] - self._yaw_rad, 2.0 * math.pi)
        self._yaw_rad = rpy_rad[2]
        newest.turn_rad = self._turned_rad * self._R_body_sensor[2, 2]
        ranges_m, points = newest.ranges_m[:n], newest.points[:n]
        given_m = np.ascontiguousarray(rays.ranges_m[0])
        scans.take(given_m, ranges_m)
        if settings.min_group > 1:
            gap_m, least = settings.group_gap_m, settings.min_group
            scans.drop_small_groups(given_m, ranges_m, gap_m, least)
        np.multiply(rays.rays, ranges_m[:, None], out=points)
        points += rays.origins
        roll, pitch, yaw = rpy_rad
        origin = np.array([self._body.x_m, self._body.y_m, self._body.z_m])
        frame = frame_of((roll, pitch, yaw - yaw_start_rad), origin, self._normal_body)
        if self._step_rad != step_rad:
            self._step_rad = step_rad
            self._changes = changes_of(self._config, step_rad)
        self._limits_of(points, rays.rays, ranges_m, frame, self._changes, newest.limits_m[:n])

    def _map_due(self) -> int:
        """The newest scan, or the one before it where three are looked at."""
        before, middle, newest = self._scans
        one = middle if self._settings.three_scans else newest
        n = one.beams[0]
        if n == 0:
            return 0
        ranges_m, kept = one.ranges_m[:n], self._room[:n]
        if self._settings.three_scans:
            looks = before.look_for(middle), newest.look_for(middle)
            scans.keep_supported(ranges_m, *looks, self._settings.three_scans_m, kept)
        else:
            scans.keep_all(ranges_m, kept)
        return self._map(one.points[:n], one.limits_m[:n], kept, one.t_s)

    def _map(self, points: F64, limits_m: F64, kept: U8, t_s: float) -> int:
        """Readings into cells, the filter, and what that means; how many fell into the map."""
        room, window = (self._pass, self._near, self._about), self.window
        given = self.cells, self._body, self.fresh.oldest_s, self._rules, window.shown, window.used
        used, window.used = self._map_scan(points, limits_m, kept, t_s, room, *given)
        return used

    def _decide(self, listed: I32) -> None:
        window = self.window
        window.used = decide(
            listed,
            self.cells,
            self._body,
            self.fresh.oldest_s,
            self._rules,
            window.shown,
            window.used,
        )

    def _heights_m(self, at: I64, fills: bool) -> F64:
        found = np.empty(at.size)
        heights_at(at, self.cells, fills, found)
        return found

    def _over_ground_m(self, at: I64, z_m: F64) -> F64:
        """Heights (n,), map frame, over the plane on which the robot stands."""
        size, body = self.grid.size, self._body
        i = self.grid.corner_i + (at % size - self.grid.corner_i) % size
        j = self.grid.corner_j + (at // size - self.grid.corner_j) % size
        dx_m, dy_m = (
            (k + 0.5) * self.grid.cell_m - place for k, place in ((i, body.x_m), (j, body.y_m))
        )
        return np.asarray(z_m - body.z_m - body.slopes[0] * dx_m - body.slopes[1] * dy_m)

    def maybe_ring(self, name: str) -> layers.RingLayer | None:
        """Heights, with the fill of (11) where that is set; slope, step, roughness without it."""

        def told(at: I64) -> F64:
            if name in HEIGHTS:
                z_m = self._heights_m(at, self._settings.fill)
                return z_m if name == "z" else self._over_ground_m(at, z_m)
            near = around(self.grid, at)
            known_m = self._heights_m(np.maximum(near, 0).ravel(), False).reshape(near.shape)
            z_m = np.where(near >= 0, known_m, math.nan)
            relief_m = z_m[:, OWN] - self.cells.low_m[at]
            judged = terrain_of(z_m, relief_m, self.grid.cell_m)
            return np.asarray(judged[JUDGED.index(name)], float)

        return (self.grid, told) if name in (*HEIGHTS, *JUDGED) else None

    def maybe_ground(self) -> "CertaintyMaps":
        """Itself: its heights are all of one frame."""
        return self

    def ground_at(self, at: I64) -> Ground:
        """Heights that were read, at flat indices (n,), without the fill."""
        z_m, low_m = np.full((2, self.grid.size, self.grid.size), math.nan)
        z_m.reshape(-1)[at] = self._heights_m(at, False)
        low_m.reshape(-1)[at] = self.cells.low_m[at]
        return Ground(self.grid, z_m, low_m, np.zeros(z_m.shape))

    def filled_at(self, at: I64) -> Ground:
        """The same: nothing tells how sure the fill of (11) is."""
        return self.ground_at(at)

    def causes(self, i: I64, j: I64) -> F64:
        found: U8 = np.zeros(i.size, dtype=np.uint8)
        list_causes(
            i,
            j,
            self.cells,
            self._body,
            self.fresh.oldest_s,
            self._rules,
            self.window.shown,
            found,
        )
        return found.astype(np.float64)

    def ages_s(self, i: I64, j: I64) -> F64:
        seen_s = layers.at_cells(self.grid, i, j, lambda at: self.fresh.seen_s[at])
        return self.fresh.ages_s(seen_s)

    def evidence(self, i: int, j: int) -> dict[str, float]:
        """Its certainty."""
        at = j % self.grid.size * self.grid.size + i % self.grid.size
        return {"certainty of its height": float(self.cells.certainty[at])}

    def heights_m(self) -> F64:
        """Heights (size, size) of the grid that were read, map frame; NaN: none."""
        return self.ground_at(np.arange(self.cells.height_m.size)).z_m

    def go_on_from(self, corner_i: int, corner_j: int) -> None:
        """The window's corner is that of an earlier run: the grid has the same middle."""
        half = self.window.grid.size // 2 - self.grid.size // 2
        self.grid.corner_i, self.grid.corner_j = corner_i + half, corner_j + half
        self.cells = self.cells._replace(ring=self.grid.ring)

    def erase(self) -> None:
        """Forget everything, and the scans that wait."""
        self.grid.erase()
        self.window.erase()
        for kept in self._scans:
            kept.beams = (0, 0.0, 0.0)
