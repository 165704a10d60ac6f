"""Method `beams`: exact rigid geometry for every beam at its own instant.

Gives the returns of a scan as points in the map frame, each with the place of the lens at that
instant. Heights are above the ground plane under the robot: the body's origin has height 0.
Source: design, sections 5 and 7.
"""

import math

import numpy as np

from core.attitude import AttitudeRing, q_at
from core.geometry import R_from_rpy
from core.jit import kernel
from core.odometry import Odometry
from core.records import F64, Scan

MIN_RANGE_M = 0.15  # nearer is the scanner's own housing (lms111 sheet, section 5)
MAX_POINTS = 2 * 1081  # two echoes of the finest scan


@kernel
def _turn_to_map(q: F64, cy: float, sy: float, v: F64) -> None:
    """Turn `v` (3,) from the body to the earth frame by `q`, then by the heading at the start."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    bx, by, bz = v[0], v[1], v[2]
    ex = (1 - 2 * (y * y + z * z)) * bx + 2 * (x * y - w * z) * by + 2 * (x * z + w * y) * bz
    ey = 2 * (x * y + w * z) * bx + (1 - 2 * (x * x + z * z)) * by + 2 * (y * z - w * x) * bz
    ez = 2 * (x * z - w * y) * bx + 2 * (y * z + w * x) * by + (1 - 2 * (x * x + y * y)) * bz
    v[0], v[1], v[2] = cy * ex - sy * ey, sy * ex + cy * ey, ez


@kernel
def _points_from_ranges(
    ranges_m: F64,
    bearings: tuple[float, float],
    times: tuple[float, float],
    attitude_t_s: F64,
    q_earth_body: F64,
    start: int,
    count: int,
    yaw_start_rad: float,
    R_body_sensor: F64,
    t_body_sensor: F64,
    xy_first: F64,
    xy_last: F64,
    points: F64,
    lenses: F64,
) -> int:
    """Fills `points` and `lenses` (MAX_POINTS, 3), map frame; returns how many.

    `bearings` is (first, step) and `times` (of beam 0, between beams); `xy_first` and `xy_last`
    (2,) are where the body was at the first and at the last beam.
    """
    echoes, n = ranges_m.shape
    q = np.empty(4)
    cy, sy = math.cos(-yaw_start_rad), math.sin(-yaw_start_rad)
    ray, arm = np.empty(3), np.empty(3)
    used = 0
    for i in range(n):
        any_return = False
        for e in range(echoes):
            any_return |= ranges_m[e, i] >= MIN_RANGE_M
        if not any_return:
            continue
        q_at(attitude_t_s, q_earth_body, start, count, times[0] + i * times[1], q)
        bearing = bearings[0] + i * bearings[1]
        cb, sb = math.cos(bearing), math.sin(bearing)
        share = i / (n - 1) if n > 1 else 0.0
        for k in range(3):
            ray[k] = R_body_sensor[k, 0] * cb + R_body_sensor[k, 1] * sb
            arm[k] = t_body_sensor[k]
        _turn_to_map(q, cy, sy, ray)
        _turn_to_map(q, cy, sy, arm)
        for e in range(echoes):
            r = ranges_m[e, i]
            if r >= MIN_RANGE_M and used < points.shape[0]:
                for k in range(3):
                    at = (1 - share) * xy_first[k] + share * xy_last[k] if k < 2 else 0.0
                    lenses[used, k] = at + arm[k]
                    points[used, k] = lenses[used, k] + r * ray[k]
                used += 1
    return used


class BeamGeometry:
    """Where the scanner sits on the body, and room for the points of one scan."""

    def __init__(
        self,
        mount_xyz_m: tuple[float, float, float],
        mount_roll_rad: float,
        mount_tilt_rad: float,
        mount_yaw_rad: float,
    ) -> None:
        self._R_body_sensor = R_from_rpy(mount_roll_rad, mount_tilt_rad, mount_yaw_rad)
        self._t_body_sensor = np.array(mount_xyz_m, dtype=np.float64)
        self._points = np.zeros((MAX_POINTS, 3))
        self._lenses = np.zeros((MAX_POINTS, 3))

    def points_from_scan(
        self, scan: Scan, attitudes: AttitudeRing, odometry: Odometry
    ) -> tuple[F64, F64]:
        """Points and lens places (k, 3), map frame, metres; valid until the next call.

        Attitude and odometry must cover the scan from its first beam to its last.
        """
        last_s = scan.t_s + (scan.ranges_m.shape[1] - 1) * scan.beam_dt_s
        used = _points_from_ranges(
            scan.ranges_m,
            (scan.first_rad, scan.step_rad),
            (scan.t_s, scan.beam_dt_s),
            attitudes.t_s,
            attitudes.q_earth_body,
            attitudes.start,
            attitudes.count,
            odometry.yaw_start_rad,
            self._R_body_sensor,
            self._t_body_sensor,
            odometry.xy_at(scan.t_s),
            odometry.xy_at(last_s),
            self._points,
            self._lenses,
        )
        return self._points[:used], self._lenses[:used]
