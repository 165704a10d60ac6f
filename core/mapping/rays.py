"""Exact rigid geometry for every beam at its own instant: where it starts and where it goes.

A beam is a ray in the map frame: the place of the lens at that instant, and a direction of unit
length. A return at range r lies at lens + r * direction. z is the map's: 0 is the ground under the
robot where the run began. The beams may be a fan (`Scan`) or any others (`PointSweep`).
Source: design, sections 5 and 7.
"""

import math

import numpy as np
from msgspec import Struct

from core.device_settings import Scanner
from core.geometry import R_from_rpy
from core.motion.attitude import AttitudeRing
from core.motion.path import Place
from core.motion.track import Track
from core.records import F64, PointSweep, Scan
from jit import Settled, kernel

Vector = tuple[float, float, float]
NO_ARM: Vector = (0.0, 0.0, 0.0)
MIN_RANGE_M = 0.15  # nearer is a scanner's own housing, or the robot's body


@kernel
def _turn_between(
    q: F64, a: int, b: int, share: float, heading: tuple[float, float], R: F64
) -> None:
    """The rotation (3, 3) of a share of the way from sample a of q (n, 4) to b, then of a heading.

    Along the shorter arc: the sum of both quaternions, whose length is divided out at last.
    """
    dot = q[a, 0] * q[b, 0] + q[a, 1] * q[b, 1] + q[a, 2] * q[b, 2] + q[a, 3] * q[b, 3]
    c, s = 1.0 - share, share if dot >= 0.0 else -share
    w, x = c * q[a, 0] + s * q[b, 0], c * q[a, 1] + s * q[b, 1]
    y, z = c * q[a, 2] + s * q[b, 2], c * q[a, 3] + s * q[b, 3]
    ww, xx, yy, zz = w * w, x * x, y * y, z * z
    length2 = ww + xx + yy + zz
    cy, sy, k = heading[0] / length2, heading[1] / length2, 1.0 / length2
    ahead = ww + xx - yy - zz, 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)
    left = 2.0 * (x * y + w * z), ww - xx + yy - zz, 2.0 * (y * z - w * x)
    up = 2.0 * (x * z - w * y), 2.0 * (y * z + w * x), ww - xx - yy + zz
    for n in range(3):
        R[0, n], R[1, n] = cy * ahead[n] - sy * left[n], sy * ahead[n] + cy * left[n]
        R[2, n] = k * up[n]


@kernel
def _fan(first_rad: float, step_rad: float, directions: F64) -> None:
    """Fills the directions (n, 3) of a fan in the plane x-y."""
    for i in range(directions.shape[0]):
        bearing = first_rad + i * step_rad
        directions[i, 0], directions[i, 1] = math.cos(bearing), math.sin(bearing)
        directions[i, 2] = 0.0


@kernel
def _times(t_s: float, step_s: float, times_s: F64) -> None:
    """Fills the times (n,) of a fan."""
    for i in range(times_s.size):
        times_s[i] = t_s + i * step_s


@kernel
def _place(t: Vector, R: F64, given: F64, out: F64) -> None:
    """Fills `out` (n, 3) with t and R (3, 3) times each row given; both may be one array."""
    for i in range(given.shape[0]):
        x, y, z = given[i]
        for k in range(3):
            out[i, k] = t[k] + R[k, 0] * x + R[k, 1] * y + R[k, 2] * z


@kernel
def _cast(
    fan: tuple[F64, F64, F64],
    attitude_t_s: F64,
    q_earth_body: F64,
    start: int,
    count: int,
    yaw_start_rad: float,
    first: Place,
    last: Place,
    R: F64,
    from_map: F64,
    rays: F64,
) -> None:
    """Fills `from_map` and `rays` (n, 3), map frame.

    `fan` is origins and directions (n, 3) in the body's frame, and times (n,); `first` and `last`
    are where the body was at the first and at the last beam; `R` (3, 3) is room for how it lies.
    """
    origins, directions, times_s = fan
    n, kept = times_s.size, attitude_t_s.size
    heading = math.cos(-yaw_start_rad), math.sin(-yaw_start_rad)
    a = newest = (start + count - 2) % kept  # the sample before a beam: near the last one's
    b = (a + 1) % kept  # and the one after it
    for i in range(n):
        at_s = times_s[i]
        while a != newest and attitude_t_s[b] <= at_s:
            a, b = b, b + 1 if b + 1 < kept else 0
        while a != start and attitude_t_s[a] > at_s:
            a, b = a - 1 if a > 0 else kept - 1, a
        turned = (at_s - attitude_t_s[a]) / (attitude_t_s[b] - attitude_t_s[a])
        _turn_between(q_earth_body, a, b, turned, heading, R)
        share = i / (n - 1) if n > 1 else 0.0
        x, y, z = origins[i]
        u, v, w = directions[i]
        for k in range(3):
            arm = R[k, 0] * x + R[k, 1] * y + R[k, 2] * z
            from_map[i, k] = (1.0 - share) * first[k] + share * last[k] + arm
            rays[i, k] = R[k, 0] * u + R[k, 1] * v + R[k, 2] * w


@kernel
def last_echo_m(ranges_m: F64, b: int) -> float:
    """The last echo of a beam, of ranges (echoes, n); NaN: none."""
    last = ranges_m[0, b]
    for k in range(1, ranges_m.shape[0]):
        if ranges_m[k, b] > last:
            last = ranges_m[k, b]
    return float(last)


class Sweep(Struct, frozen=True, eq=False):
    """One scan as rays in the map frame; valid until the next one is cast."""

    t_s: float  # of its last beam
    origins: F64  # (n, 3) metres
    rays: F64  # (n, 3) unit vectors
    ranges_m: F64  # (echoes, n); NaN: no measurement

    def points(self) -> F64:
        """Its returns (k, 3), map frame, metres: beam by beam, echo by echo."""
        places = self.origins[:, None, :] + self.ranges_m.T[:, :, None] * self.rays[:, None, :]
        return np.asarray(places[self.ranges_m.T >= MIN_RANGE_M])


def span_s(scan: Scan | PointSweep) -> tuple[float, float]:
    """When its first and its last beam left."""
    if isinstance(scan, Scan):
        return scan.t_s, scan.t_s + float(scan.ranges_m.shape[1] - 1) * scan.beam_dt_s
    return float(scan.times_s[0]), float(scan.times_s[-1])


def check_sweep(scan: Scan | PointSweep, max_beams: int) -> None:
    """Let a sweep pass whose arrays the kernels may walk, which check no index.

    Raises:
        ValueError: too many beams, arrays that do not fit together, or what is no number.
    """
    echoes, beams = scan.ranges_m.shape
    if echoes < 1 or not 1 <= beams <= max_beams:
        raise ValueError(f"a sweep has 1 to {max_beams} beams, this one {echoes} x {beams} ranges")
    if isinstance(scan, Scan):
        step_s, angles = scan.beam_dt_s, scan.first_rad + beams * scan.step_rad
        if not (step_s >= 0.0 and math.isfinite(scan.t_s + beams * step_s + angles)):
            raise ValueError("a scan's times and bearings are finite and its times ascend")
        return
    shapes = scan.origins.shape, scan.directions.shape, scan.times_s.shape
    if shapes != ((beams, 3), (beams, 3), (beams,)):
        raise ValueError(f"a sweep of {beams} rays has arrays of the shapes {shapes}")
    first_s, last_s = span_s(scan)
    if not (first_s <= scan.times_s.min() and scan.times_s.max() <= last_s):
        raise ValueError("a sweep's first time is its earliest and its last the latest")
    if not (np.isfinite(scan.origins).all() and np.isfinite(scan.directions).all()):
        raise ValueError("a sweep's origins and directions are finite")


class BeamGeometry:
    """Where the scanner sits on the body, and room for the rays of one sweep."""

    @classmethod
    def of(cls, scanner: Scanner) -> "BeamGeometry":
        """As the settings have it."""
        most = scanner.options.spec.max_beams
        return cls(scanner.mount_xyz_m, *scanner.mount_rpy_rad, most)

    def __init__(
        self,
        mount_xyz_m: tuple[float, float, float],
        mount_roll_rad: float,
        mount_tilt_rad: float,
        mount_yaw_rad: float,
        max_beams: int,
    ) -> None:
        self._R_body_sensor = R_from_rpy(mount_roll_rad, mount_tilt_rad, mount_yaw_rad)
        self._t_body_sensor: Vector = mount_xyz_m
        self._origins, self._directions = np.zeros((max_beams, 3)), np.zeros((max_beams, 3))
        self._fan = (0, 0.0, 0.0)  # beams, first and step of the directions there are
        self._times_s, self._R = np.zeros(max_beams), np.zeros((3, 3))
        self._from_map, self._rays = np.zeros((max_beams, 3)), np.zeros((max_beams, 3))
        self._cast = Settled(_cast)

    def _on_body(self, scan: Scan | PointSweep) -> tuple[F64, F64, F64]:
        """Origins and directions (n, 3) in the body's frame, and times (n,); until the next one."""
        n = scan.ranges_m.shape[1]
        origins, directions, times_s = self._origins[:n], self._directions[:n], self._times_s[:n]
        if isinstance(scan, PointSweep):
            self._fan = (0, 0.0, 0.0)
            _place(
                self._t_body_sensor,
                self._R_body_sensor,
                np.ascontiguousarray(scan.origins),
                origins,
            )
            _place(NO_ARM, self._R_body_sensor, np.ascontiguousarray(scan.directions), directions)
            times_s[:] = scan.times_s
            return origins, directions, times_s
        if self._fan != (n, scan.first_rad, scan.step_rad):
            self._fan = (n, scan.first_rad, scan.step_rad)
            origins[:] = self._t_body_sensor
            _fan(scan.first_rad, scan.step_rad, directions)
            _place(NO_ARM, self._R_body_sensor, directions, directions)
        _times(scan.t_s, scan.beam_dt_s, times_s)
        return origins, directions, times_s

    def cast(self, scan: Scan | PointSweep, attitudes: AttitudeRing, odometry: Track) -> Sweep:
        """The rays of a checked sweep; attitude and odometry cover it from first beam to last."""
        first_s, last_s = span_s(scan)
        fan, n = self._on_body(scan), scan.ranges_m.shape[1]
        from_map, rays = self._from_map[:n], self._rays[:n]
        self._cast(
            fan,
            attitudes.t_s,
            attitudes.q_earth_body,
            attitudes.start,
            attitudes.count_ahead,
            odometry.yaw_start_rad,
            odometry.place_at(first_s),
            odometry.place_at(last_s),
            self._R,
            from_map,
            rays,
        )
        return Sweep(last_s, from_map, rays, np.ascontiguousarray(scan.ranges_m, np.float64))
