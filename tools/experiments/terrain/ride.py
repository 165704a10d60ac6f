"""A sensor that is carried over a scene: true poses, what is told of them, and its scans.

Each scan is taken at one instant, as by a sensor that stands still for it.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from core.geometry import R_from_rpy, q_from_R
from core.motion.attitude import AttitudeRing
from core.motion.path import Place
from core.motion.shift import Shift
from core.motion.track import Pose
from core.pose_fix import PoseFix
from core.records import F64, Attitude, ExternalPose, PointSweep, Scan, WheelCounts

STEP_M, PERIOD_S = 0.010, 0.1  # between two scans
BESIDE_S = 0.005  # of the two attitude samples about a scan
UNKNOWN_RATES = (math.nan, math.nan, math.nan)


class Sensor(Protocol):
    """What is carried."""

    def sweep(self, t_s: float, counter: int, xyz_m: F64, R: F64) -> Scan | PointSweep:
        """What it tells from a body at xyz_m (3,), turned by R (3, 3): map frame."""


@dataclass(frozen=True, slots=True)
class Gait:
    """How a body sways, and how wrong what is told of its pose is (1 sigma, anew in each scan)."""

    yaw_rad: float = 0.0  # largest, to either side
    bob_m: float = 0.0  # up and down, twice a stride
    stride_hz: float = 0.7
    place_m: float = 0.0  # error of x, y and z
    angle_rad: float = 0.0  # error of roll, pitch and yaw


STEADY = Gait()
WALKING = Gait(math.radians(3.0), 0.005, place_m=0.003, angle_rad=math.radians(0.5))


class GivenTrack:
    """A `Track` of places that are told with each scan, and hold until the next one."""

    yaw_start_rad = v_mps = w_radps = 0.0
    breaks = outliers = 0
    broken_by = ""
    maybe_shift: Shift | None = None
    waits = False

    def __init__(self) -> None:
        self.corrected_m: F64 = np.zeros(2)
        self.covariance: F64 = np.zeros((3, 3))
        self.owed: F64 = np.zeros(3)
        self.newest_s, self._place = -math.inf, (0.0, 0.0, 0.0, 0.0)

    @property
    def started(self) -> bool:
        return self.newest_s > -math.inf

    @property
    def travel_m(self) -> float:
        return self._place[3]

    def tell(self, t_s: float, xyz_m: F64, yaw_rad: float) -> None:
        x, y, z = xyz_m.tolist()
        travel_m = self.travel_m
        if self.started:
            dx, dy = x - self._place[0], y - self._place[1]
            travel_m += math.cos(yaw_rad) * dx + math.sin(yaw_rad) * dy
        self.newest_s, self._place = t_s, (x, y, z, travel_m)

    def start_at(self, xyz_m: F64, yaw_rad: float, travel_m: float) -> None:
        """The places are told in the map frame already."""

    def add(self, counts: WheelCounts) -> None:
        """It has no wheels."""

    def add_external(self, pose: ExternalPose) -> bool:
        return False

    def correct_slip(self, along: tuple[float, float], slipped_m: float) -> None:
        """Nothing slips."""

    def correct_by(self, fix: PoseFix, at_s: float) -> bool:
        return False

    def break_off(self, why: str) -> None:
        """All places stay those that are told."""

    def settle(self) -> None:
        """Nothing waits."""

    def covers(self, from_s: float, to_s: float) -> bool:
        return self.started and to_s <= self.newest_s + BESIDE_S

    def xy_at(self, at_s: float) -> F64:
        return np.array(self._place[:2])

    def place_at(self, at_s: float) -> Place:
        return self._place

    def maybe_pose(self, at_s: float) -> Pose | None:
        return None


class Ride:
    """Straight ahead along x; the same seed tells the same.

    Args:
        x_m: where the body is in the first scan, and at most in the last.
    """

    def __init__(self, sensor: Sensor, x_m: tuple[float, float], gait: Gait, seed: int) -> None:
        self.attitudes, self.track = AttitudeRing(0.0, 0.0, 0.0), GivenTrack()
        self._sensor, self._gait = sensor, gait
        self._random = np.random.default_rng([seed, 7])
        self._x_m = np.arange(x_m[0], x_m[1] + STEP_M / 2, STEP_M)

    def scans(self) -> Iterator[Scan | PointSweep]:
        """Each scan, once attitude and track tell the pose of its instant."""
        for k, x_m in enumerate(self._x_m.tolist()):
            t_s = 1.0 + k * PERIOD_S
            phase = 2.0 * math.pi * self._gait.stride_hz * t_s
            xyz_m = np.array([x_m, 0.0, self._gait.bob_m * math.sin(2.0 * phase)])
            rpy_rad = np.array([0.0, 0.0, self._gait.yaw_rad * math.sin(phase)])
            self._tell(t_s, xyz_m, rpy_rad)
            yield self._sensor.sweep(t_s, k % 65536, xyz_m, R_from_rpy(*rpy_rad.tolist()))

    def _tell(self, t_s: float, xyz_m: F64, rpy_rad: F64) -> None:
        told_m = xyz_m + self._gait.place_m * self._random.standard_normal(3)
        told_rad = rpy_rad + self._gait.angle_rad * self._random.standard_normal(3)
        q = q_from_R(R_from_rpy(*told_rad.tolist())).tolist()
        for at_s in (t_s - BESIDE_S, t_s + BESIDE_S):
            self.attitudes.add(Attitude(at_s, (q[0], q[1], q[2], q[3]), UNKNOWN_RATES))
        self.track.tell(t_s, told_m, float(told_rad[2]))
