"""What the planner is told of the ground before and behind the robot, at one instant.

It says nothing that the drive control would not say: the same footprint, margin, way to stop and
ground that somebody vouches for. What is not to be trusted gives no free way and no speed.
Source: planner link, section 3 (STOP_ZONE); design, section 8.
"""

import math

import numpy as np

from core.driving.control import FASTER, FASTER_MPS, MOVING_MPS, SET_OUT_MPS, DriveControl
from core.driving.corridor import SECTORS, free_path, nearest_in_sectors, nearest_obstacle
from core.driving.stop_zone import LONGEST_M, Motion, Obstruction
from core.grid.window import ObstacleWindow
from core.motion.track import Pose
from core.records import OBSTACLE, DriveRequest, StopZoneReport

UNKNOWN, CLEAR, SLOW, STOP = range(4)  # states
OBSTRUCTED, UNSEEN, DROP, UNTRUSTED = 1, 2, 4, 8  # causes, bits
CONTACT_S = 3.0  # so far ahead in time, contacts are looked for
NOT_TRUSTED = StopZoneReport(0, 0, 0, 0, 0, 0, 0, 0, 0, (0.0,) * SECTORS, UNKNOWN, UNTRUSTED)


class ZoneReporter:
    """Reports of one robot, from its drive control and the window that this looks at."""

    def __init__(
        self,
        control: DriveControl,
        window: ObstacleWindow,
        max_speed_mps: float,
        has_sectors: bool = True,
    ) -> None:
        """`has_sectors`: somebody reads them; else there are none in a report."""
        self._control, self._window, self._max_mps = control, window, max_speed_mps
        self._sectors_m = np.zeros(SECTORS if has_sectors else 0)

    def report(
        self,
        pose: Pose | None,
        trusted: bool,
        moves: Motion,
        request: DriveRequest | None,
    ) -> StopZoneReport:
        """The stop zone as it is now.

        Args:
            trusted: the inputs are such that free may be told.
            moves: forward m/s and rad/s, as measured.
            request: what the robot is asked to do, if it is.
        """
        if pose is None or not trusted:
            return NOT_TRUSTED
        control, zone, grid = self._control, self._control.zone, self._window.grid
        ground = self._window.cells, (grid.corner_i, grid.corner_j, grid.size), grid.cell_m
        place, (front_m, rear_m, side_m) = (pose.x_m, pose.y_m, pose.yaw_rad), zone.rect
        turned = (pose.x_m, pose.y_m, pose.yaw_rad + math.pi)
        # of a way: the margin, metres to look, and the ground that is vouched for
        way = zone.margin_m, LONGEST_M, control.clear
        ahead_m, *cell, hard_ahead_m = free_path(*ground, place, zone.rect, *way)
        behind_m, *_, hard_behind_m = free_path(*ground, turned, (rear_m, front_m, side_m), *way)
        nearest_m, bearing_rad = nearest_obstacle(*ground, place, zone.rect)
        if self._sectors_m.size:
            nearest_in_sectors(*ground, place, self._sectors_m)
        ahead = Obstruction(ahead_m, *cell)
        state, causes = self._judge(pose, ahead, moves, request)
        return StopZoneReport(
            ahead_m,
            hard_ahead_m,
            behind_m,
            hard_behind_m,
            self._contact_s(pose, moves),
            min(self._max_mps, zone.allowed_mps(ahead_m)),
            min(self._max_mps, zone.allowed_mps(behind_m)),
            nearest_m,
            bearing_rad,
            tuple(self._sectors_m.tolist()),
            state,
            causes,
        )

    def _contact_s(self, pose: Pose, moves: Motion) -> float:
        rate_mps = self._control.zone.rate_mps(*moves)
        if rate_mps < MOVING_MPS:
            return math.inf
        found = self._control.look(pose, moves, 0.0, CONTACT_S)
        return found.free_m / rate_mps if found.free_m < CONTACT_S * rate_mps else math.inf

    def _judge(
        self,
        pose: Pose,
        ahead: Obstruction,
        moves: Motion,
        request: DriveRequest | None,
    ) -> tuple[int, int]:
        """State, and causes if it is not clear, of the way that the robot takes or would take."""
        control = self._control
        motion, found = control.heading_for(moves, request), ahead
        rate_mps, full_mps = control.zone.rate_mps(*moves), self._max_mps
        if any(motion):
            full_mps = control.zone.rate_mps(*control.at_full_speed(motion))
            found = control.look(pose, motion, full_mps)
        allowed_mps = control.zone.allowed_mps(found.free_m)
        if allowed_mps >= full_mps:
            return CLEAR, 0
        causes = UNSEEN
        if found.state == OBSTACLE:
            causes = OBSTRUCTED | DROP if control.is_drop(found) else OBSTRUCTED
        stops = allowed_mps <= SET_OUT_MPS if rate_mps < MOVING_MPS else allowed_mps == 0.0
        fast = rate_mps > FASTER * allowed_mps + FASTER_MPS
        return (STOP if stops or fast else SLOW), causes
