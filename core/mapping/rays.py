"""Exact rigid geometry for every beam at its own instant: where it starts and where it goes.

A beam is a ray in the map frame: the place of the lens at that instant, and a direction of unit
length. A return at range r lies at lens + r * direction. z is the map's: 0 is the ground under the
robot where the run began.
Source: design, sections 5 and 7.
"""

import math

import numpy as np

from core.geometry import R_from_rpy
from core.motion.attitude import AttitudeRing, q_at
from core.motion.odometry import Odometry
from core.records import F64, Scan, record
from jit import kernel

MIN_RANGE_M = 0.15  # nearer is the scanner's own housing (lms111 sheet, section 5)
MAX_BEAMS = 1081  # of the finest scan


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
def _cast(
    n: int,
    bearings: tuple[float, float],
    times: tuple[float, float],
    attitude_t_s: F64,
    q_earth_body: F64,
    start: int,
    count: int,
    yaw_start_rad: float,
    R_body_sensor: F64,
    t_body_sensor: F64,
    first: F64,
    last: F64,
    lenses: F64,
    rays: F64,
) -> None:
    """Fills `lenses` and `rays` (n, 3), map frame.

    `bearings` is (first, step) and `times` (of beam 0, between beams); `first` and `last` (3,) are
    where the body was at the first and at the last beam.
    """
    q, ray, arm = np.empty(4), np.empty(3), np.empty(3)
    cy, sy = math.cos(-yaw_start_rad), math.sin(-yaw_start_rad)
    for i in range(n):
        q_at(attitude_t_s, q_earth_body, start, count, times[0] + i * times[1], q)
        bearing = bearings[0] + i * bearings[1]
        cb, sb = math.cos(bearing), math.sin(bearing)
        share = i / (n - 1) if n > 1 else 0.0
        for k in range(3):
            ray[k] = R_body_sensor[k, 0] * cb + R_body_sensor[k, 1] * sb
            arm[k] = t_body_sensor[k]
        _turn_to_map(q, cy, sy, ray)
        _turn_to_map(q, cy, sy, arm)
        for k in range(3):
            lenses[i, k] = (1 - share) * first[k] + share * last[k] + arm[k]
            rays[i, k] = ray[k]


@record(eq=False)
class Sweep:
    """One scan as rays in the map frame; valid until the next one is cast."""

    t_s: float  # of its last beam
    lenses: F64  # (n, 3) metres
    rays: F64  # (n, 3) unit vectors
    ranges_m: F64  # (echoes, n); NaN: no measurement

    def points(self) -> F64:
        """Its returns (k, 3), map frame, metres: beam by beam, echo by echo."""
        places = self.lenses[:, None, :] + self.ranges_m.T[:, :, None] * self.rays[:, None, :]
        return np.asarray(places[self.ranges_m.T >= MIN_RANGE_M])


class BeamGeometry:
    """Where the scanner sits on the body, and room for the rays of one scan."""

    def __init__(
        self,
        mount_xyz_m: tuple[float, float, float],
        mount_roll_rad: float,
        mount_tilt_rad: float,
        mount_yaw_rad: float,
    ) -> None:
        self._R_body_sensor = R_from_rpy(mount_roll_rad, mount_tilt_rad, mount_yaw_rad)
        self._t_body_sensor = np.array(mount_xyz_m, dtype=np.float64)
        self._lenses = np.zeros((MAX_BEAMS, 3))
        self._rays = np.zeros((MAX_BEAMS, 3))

    def cast(self, scan: Scan, attitudes: AttitudeRing, odometry: Odometry) -> Sweep:
        """The rays of a scan.

        Attitude and odometry must cover the scan from its first beam to its last.
        """
        n = scan.ranges_m.shape[1]
        last_s = scan.t_s + (n - 1) * scan.beam_dt_s
        lenses, rays = self._lenses[:n], self._rays[:n]
        _cast(
            n,
            (scan.first_rad, scan.step_rad),
            (scan.t_s, scan.beam_dt_s),
            attitudes.t_s,
            attitudes.q_earth_body,
            attitudes.start,
            attitudes.count_ahead,
            odometry.yaw_start_rad,
            self._R_body_sensor,
            self._t_body_sensor,
            odometry.xyz_at(scan.t_s),
            odometry.xyz_at(last_s),
            lenses,
            rays,
        )
        return Sweep(last_s, lenses, rays, scan.ranges_m)
