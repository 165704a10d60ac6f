"""Records in, maps out: holds scans until attitude and pose reach them, then adds them.

A scan waits a bounded time for the attitude and the pose of its last beam; what never gets them is
counted and dropped, not guessed. Where the odometry's chain breaks, the maps are erased; what still
holds of the obstacle map, where the robot can have moved but little, is laid under the new one.
Source: design, sections 2, 4 and 7.
"""

import math
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

from core.config import Config
from core.mapping import layers
from core.mapping.carried import carried
from core.mapping.footing import USUAL, Footing
from core.mapping.layers import LayerView
from core.mapping.method import MAX_SLOPE_RAD, Maps
from core.mapping.rays import check_sweep, span_s
from core.mapping.shadows import ShadowFilter
from core.motion.attitude import AttitudeRing
from core.motion.gravity import WHY, WHY_AGAIN, GravityCheck
from core.motion.odometry import Odometry
from core.motion.pose_track import PoseTrack
from core.motion.shift import Shift
from core.motion.track import Pose, Track
from core.records import F64, I64, Attitude, ObstacleMap, PointSweep, Scan, WheelCounts

if TYPE_CHECKING:
    from core.mapping.combined import CombinedMaps

WAIT_S = 0.08  # a scan's longest wait: five lost attitude samples and a burst of 16 ms
WAITING = 4  # scans; fewer than the scanner codec has slots


@dataclass(slots=True)
class MapperCounts:
    """What became of the records."""

    scans_added: int = 0
    scans_dropped: int = 0  # no attitude or pose came in time
    scans_tilted: int = 0  # the robot leant too far for a map
    scans_early: int = 0  # before there was any pose
    points: int = 0
    erased: int = 0


def _maps_of(config: Config) -> Maps:
    """Those of the method that the settings name; what the others are made of is not loaded."""
    if config.map.method == "reference_plane":
        from core.mapping.paper.maps import ReferencePlaneMaps

        return ReferencePlaneMaps(config)
    if config.map.method == "certainty":
        from core.mapping.certainty.maps import CertaintyMaps

        return CertaintyMaps(config)
    from core.mapping.surface.maps import SurfaceMaps

    return SurfaceMaps(config)


def _maybe_combined(config: Config, scanned: Maps) -> "CombinedMaps | None":
    """With the map of a depth camera, where there is one."""
    if not config.has_camera:
        return None
    from core.mapping.combined import CombinedMaps

    return CombinedMaps(config, scanned)


class Mapper:
    """Attitude, odometry and the maps of one run, by the method that the settings name."""

    def __init__(self, config: Config) -> None:
        robot, ahrs = config.robot, config.ahrs
        is_paper = config.map.method == "reference_plane"  # which takes the sensor's angles
        mount_rpy_rad = (
            math.radians(ahrs.mount_roll_deg),
            math.radians(ahrs.mount_pitch_deg),
            math.radians(ahrs.mount_yaw_deg),
        )
        self.attitudes = AttitudeRing(*mount_rpy_rad, levels=not is_paper)
        self.gravity = GravityCheck(robot.max_speed_mps, mount_rpy_rad)
        self._doubt_changes = 0  # of it, as far as the maps know
        self._by_poses = config.motion.source == "external"
        if self._by_poses:
            self.odometry: Track = PoseTrack(self.attitudes)
        else:
            self.odometry = Odometry(
                self.attitudes,
                robot.wheel_radius_m,
                robot.encoder_ppr,
                robot.gear_ratio,
                robot.track_width_m,
                on_rail=config.motion.source == "rail",
                robot=robot,
            )
        self.scanned = _maps_of(config)  # of the scanner alone
        self._maybe_combined = _maybe_combined(config, self.scanned)
        self.maps: Maps = self._maybe_combined or self.scanned
        self._shadows = ShadowFilter(config)
        self.counts = MapperCounts()
        self.continued = False  # the map is that of an earlier run
        self.off_start_m = 0.0  # it may be off by so much from where this run began; inf: any way
        self._may_carry = not config.has_camera and config.map.method == "surface"
        self.newest_scan_s = float("-inf")  # instant of the last beam of the newest scan mapped
        self.newest_scan: Scan | PointSweep | None = None  # itself; none since the map was erased
        self.delivered_scan_s = float("-inf")  # the same of the newest scan there was
        self.delivered_counts_s = float("-inf")  # instant of the newest encoder counts
        self._waiting: deque[Scan | PointSweep] = deque()
        self._max_beams = config.scanner.options.spec.max_beams
        self._breaks = 0
        self._pose_s = math.nan  # asked since the last settling,
        self._pose: Pose | None = None  # and its answer

    def go_on_from(self, xyz_m: F64, yaw_rad: float, travel_m: float) -> None:
        """Before anything has come: the map frame is an earlier run's, the body stands here."""
        self.odometry.start_at(xyz_m, yaw_rad, travel_m)
        self.continued, self.off_start_m = True, math.inf

    @property
    def waits(self) -> bool:
        """Whether a scan waits for its attitude or its pose."""
        return bool(self._waiting)

    @property
    def place_told_s(self) -> float:
        """Instant of the newest that tells the place: encoder counts, or a pose that fits."""
        return self.odometry.newest_s if self._by_poses else self.delivered_counts_s

    def add_attitude(self, attitude: Attitude) -> None:
        self._pose_s = math.nan
        felt = attitude.accel_mps2
        if self.attitudes.add(attitude) and felt is not None:
            self.gravity.take(attitude.t_s, felt, self.attitudes)

    def add_counts(self, counts: WheelCounts) -> None:
        self.delivered_counts_s = max(self.delivered_counts_s, counts.t_s)
        self.odometry.add(counts)

    def add_scan(self, scan: Scan | PointSweep) -> None:
        """Take one sweep, to be mapped by `settle`; ValueError if its scanner may not send it."""
        check_sweep(scan, self._max_beams)
        self.delivered_scan_s = max(self.delivered_scan_s, span_s(scan)[1])
        self._waiting.append(scan)
        if len(self._waiting) > WAITING:
            self._waiting.popleft()
            self.counts.scans_dropped += 1

    @property
    def doubt(self) -> str:
        """Why the attitude is not to be believed, in words; "": it is."""
        return WHY if self.gravity.doubted else ""

    def settle(self, now_s: float) -> int:
        """Map the scans that attitude and pose reach by now; returns how many."""
        if self.gravity.changes != self._doubt_changes:  # by a wrong tilt floor may look free
            self._doubt_changes = self.gravity.changes
            self.odometry.break_off(self.doubt or WHY_AGAIN)
        is_broken = self.odometry.breaks != self._breaks
        if not (self._waiting or self.odometry.waits or is_broken):
            return 0
        self._pose_s = math.nan
        self.odometry.settle()
        if self.odometry.breaks != self._breaks:
            is_one = self.odometry.breaks == self._breaks + 1
            self._breaks = self.odometry.breaks
            shift = self.odometry.maybe_shift if is_one and self._may_carry else None
            self.erase() if shift is None else self._begin_anew(shift)
        added = 0
        while self._waiting:
            scan = self._waiting[0]
            first_s, last_s = span_s(scan)
            if self.attitudes.reaches(first_s, last_s) and self.odometry.covers(first_s, last_s):
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

    def _add(self, scan: Scan | PointSweep, last_s: float) -> None:
        roll_rad, pitch_rad, _ = self.attitudes.rpy_at(last_s)
        if max(abs(roll_rad), abs(pitch_rad)) > MAX_SLOPE_RAD:
            self.counts.scans_tilted += 1
            return
        self.counts.points += self.maps.add(
            self._shadows.cleaned(scan), self.attitudes, self.odometry
        )
        self.newest_scan_s, self.newest_scan = last_s, scan
        self.counts.scans_added += 1

    def add_frame(self, sweep: PointSweep, standing: I64) -> bool:
        """Map what a frame of the depth camera shows; False: nobody knows where it was taken.

        Args:
            standing: (k, 2) world cells in which it shows something that bars the way.
        """
        first_s, last_s = span_s(sweep)
        is_placed = self.attitudes.reaches(first_s, last_s)
        is_placed = is_placed and self.odometry.covers(first_s, last_s)
        if self._maybe_combined is None or not is_placed:
            return False
        roll_rad, pitch_rad, _ = self.attitudes.rpy_at(last_s)
        if max(abs(roll_rad), abs(pitch_rad)) > MAX_SLOPE_RAD:
            return False
        self._maybe_combined.add_frame(sweep, standing, self.attitudes, self.odometry)
        return True

    def erase(self) -> None:
        """Forget both maps: nothing in them can be placed any more."""
        self.maps.erase()
        self.newest_scan_s, self.newest_scan = float("-inf"), None
        self.counts.erased += 1
        self.off_start_m = math.inf

    def _begin_anew(self, shift: Shift) -> None:
        """A new map, under which lies what still holds of the old one."""
        laid, off_m = carried(self.maps, shift), self.off_start_m + shift.reach_m
        self.erase()
        self.maps.window.lay_under(*laid)
        self.off_start_m = off_m

    def maybe_pose(self, now_s: float) -> Pose | None:
        """The body's pose now, or none; what is taken in meanwhile counts from `settle` on."""
        if now_s != self._pose_s:
            pose = None if self.gravity.doubted else self.odometry.maybe_pose(now_s)
            self._pose, self._pose_s = pose, now_s
        return self._pose

    def maybe_layer(self, name: str, *, footing: Footing = USUAL) -> LayerView | None:
        """A layer by its name in `core.mapping.layers.UNITS`, a copy; None where there is none."""
        return layers.maybe_layer(self.maps, name, footing=footing)

    def maybe_values(self, name: str, i: I64, j: I64, *, footing: Footing = USUAL) -> F64 | None:
        """The same, or one of `core.mapping.layers.ON_ASKING`, at world cells i, j (n,)."""
        return layers.maybe_values(self.maps, name, i, j, footing=footing)

    def window(self, trusted: bool) -> ObstacleMap:
        """The obstacle map and what changed in it since the last call."""
        window = self.maps.window
        return ObstacleMap(
            window.cells,
            window.grid.corner_i,
            window.grid.corner_j,
            window.take_changed(),
            window.epoch,
            trusted,
        )
