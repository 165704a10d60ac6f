"""Records in, maps out: holds scans until attitude and pose cover them, then adds them.

A scan waits a bounded time for the attitude and the pose of its last beam; what never gets them is
counted and dropped, not guessed. Where the odometry's chain breaks, the maps are erased.
Source: design, sections 2, 4 and 7.
"""

import math
from collections import deque
from dataclasses import dataclass

from core.attitude import AttitudeRing
from core.beams import BeamGeometry
from core.config import Config
from core.elevation import MeanCells
from core.grid import RingGrid
from core.obstacles import ObstacleMap
from core.odometry import Odometry, Pose
from core.records import Attitude, ObstacleWindow, Scan, WheelCounts

WAIT_S = 0.08  # a scan's longest wait: five lost attitude samples and a burst of 16 ms
WAITING = 4  # scans; fewer than the scanner codec has slots


@dataclass(slots=True)
class MapperCounts:
    """What became of the records."""

    scans_added: int = 0
    scans_dropped: int = 0  # no attitude or pose came in time
    scans_early: int = 0  # before there was any pose
    points: int = 0
    erased: int = 0


def _last_beam_s(scan: Scan) -> float:
    """When the last beam of a scan left."""
    return scan.t_s + float(scan.ranges_m.shape[1] - 1) * scan.beam_dt_s


class Mapper:
    """Attitude, odometry, elevation and obstacle map of one run, method `beams`."""

    def __init__(self, config: Config) -> None:
        robot, scanner, ahrs = config.robot, config.scanner, config.ahrs
        self.attitudes = AttitudeRing(
            math.radians(ahrs.mount_roll_deg),
            math.radians(ahrs.mount_pitch_deg),
            math.radians(ahrs.mount_yaw_deg),
        )
        self.odometry = Odometry(
            self.attitudes,
            robot.wheel_radius_m,
            robot.encoder_ppr,
            robot.gear_ratio,
            robot.track_width_m,
        )
        self._geometry = BeamGeometry(
            (scanner.mount_x_m, scanner.mount_y_m, scanner.mount_z_m),
            math.radians(scanner.mount_roll_deg),
            math.radians(scanner.mount_tilt_deg),
            math.radians(scanner.mount_yaw_deg),
        )
        bounds_m = (config.obstacle.h_pos_m, config.obstacle.h_neg_m)
        self.elevation = MeanCells(RingGrid(config.map.cells, config.map.cell_m), *bounds_m)
        self.obstacles = ObstacleMap(self.elevation, config.obstacle.window_cells, *bounds_m)
        self.counts = MapperCounts()
        self.newest_scan_s = float("-inf")  # instant of the last beam of the newest scan mapped
        self.delivered_scan_s = float("-inf")  # the same of the newest scan there was
        self.delivered_counts_s = float("-inf")  # instant of the newest encoder counts
        self._waiting: deque[Scan] = deque()
        self._breaks = 0

    def add_attitude(self, attitude: Attitude) -> None:
        """Take one sample of the attitude sensor."""
        self.attitudes.add(attitude)

    def add_counts(self, counts: WheelCounts) -> None:
        """Take one pair of encoder counts."""
        self.delivered_counts_s = max(self.delivered_counts_s, counts.t_s)
        self.odometry.add(counts)

    def add_scan(self, scan: Scan) -> None:
        """Take one scan; it is mapped by a later `settle`."""
        self.delivered_scan_s = max(self.delivered_scan_s, _last_beam_s(scan))
        self._waiting.append(scan)
        if len(self._waiting) > WAITING:
            self._waiting.popleft()
            self.counts.scans_dropped += 1

    def settle(self, now_s: float) -> int:
        """Map the scans that are covered by now; returns how many."""
        self.odometry.settle()
        if self.odometry.breaks != self._breaks:
            self._breaks = self.odometry.breaks
            self.erase()
        added = 0
        while self._waiting:
            scan = self._waiting[0]
            last_s = _last_beam_s(scan)
            if self.attitudes.covers(scan.t_s, last_s) and self.odometry.covers(scan.t_s, last_s):
                self._add(self._waiting.popleft(), last_s)
                added += 1
            elif now_s - scan.arrived_s > WAIT_S:
                self._waiting.popleft()
                if self.odometry.started:
                    self.counts.scans_dropped += 1
                else:
                    self.counts.scans_early += 1
            else:
                break
        return added

    def _add(self, scan: Scan, last_s: float) -> None:
        x_m, y_m = (float(part) for part in self.odometry.xy_at(last_s))
        self.elevation.grid.follow(x_m, y_m)
        self.obstacles.follow(x_m, y_m)
        points, lenses = self._geometry.points_from_scan(scan, self.attitudes, self.odometry)
        self.obstacles.decide(self.elevation.add(points, lenses))
        self.newest_scan_s = last_s
        self.counts.scans_added += 1
        self.counts.points += len(points)

    def erase(self) -> None:
        """Forget both maps: nothing in them can be placed any more."""
        self.elevation.grid.erase()
        self.obstacles.erase()
        self.newest_scan_s = float("-inf")
        self.counts.erased += 1

    def maybe_pose(self, now_s: float) -> Pose | None:
        """The body's pose now, or none."""
        return self.odometry.maybe_pose(now_s)

    def window(self, trusted: bool) -> ObstacleWindow:
        """The obstacle map and what changed in it since the last call."""
        obstacles = self.obstacles
        return ObstacleWindow(
            obstacles.cells,
            obstacles.grid.corner_i,
            obstacles.grid.corner_j,
            obstacles.take_changed(),
            obstacles.epoch,
            trusted,
        )
