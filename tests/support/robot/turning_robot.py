"""A simulated robot on a known path, its sensors with known errors, for tests of the odometry."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from core.geometry import wrapped
from core.motion.attitude import AttitudeRing
from core.motion.odometry import Odometry
from core.records import F64, Attitude, ExternalPose, WheelCounts

WANDER_S = 60.0  # how slowly the sensor's own yaw wanders
TRACK_M, COUNTS_PER_M = 0.5, 2000 / (2 * math.pi * 0.15)
FIELD_NORTH, FIELD_UP = 0.4, -0.9
YAW_START_RAD = 0.3  # of the sensor, where the map begins
Of = Callable[[float], float]


def _zero(t_s: float) -> float:
    return 0.0


@dataclass(slots=True)
class Errors:
    """What is wrong with the sensors; angles in radians."""

    gyro_noise: float = math.radians(0.3)  # rad/s, each sample
    gyro_bias: float = 0.0
    yaw_noise: float = math.radians(0.05)  # of the sensor's own yaw, each sample
    wander: float = 0.0  # of that yaw, standard deviation, correlated over a minute
    pull: Of = _zero  # added to that yaw
    bend: Of = _zero  # added to the strength of the field
    scale: float = 0.0  # true travel is (1 + scale) times the counted
    asymmetry: float = 0.0
    slip_left_mps: Of = _zero  # how much faster the left wheel runs than its ground
    slip_right_mps: Of = _zero
    magnetic: bool = True
    rates: bool = True
    roughness: float = 0.0  # m per root metre: travel that no wheel counts


@dataclass(slots=True)
class Robot:
    """Drives by speed `v` and rate of turn `w`; attitude at 100 Hz, counters at 20 Hz."""

    v: Of
    w: Of
    errors: Errors = field(default_factory=Errors)
    seed: int = 1
    external: Callable[["Robot"], ExternalPose | None] | None = None  # asked at each 0.1 s
    counts_told: Callable[[float], bool] = lambda t_s: True
    ring: AttitudeRing = field(default_factory=lambda: AttitudeRing(0, 0, 0))
    odometry: Odometry = field(init=False)
    random: np.random.Generator = field(init=False)
    t_s: float = 0.0
    x_m: float = 0.0
    y_m: float = 0.0
    yaw_rad: float = 0.0  # in the map
    left: float = 0.0  # counts
    right: float = 0.0
    restarts: int = 0
    k: int = 0
    wander_rad: float = 0.0
    worst_yaw_rad: float = 0.0  # of what was told

    def __post_init__(self) -> None:
        self.odometry = Odometry(self.ring, 0.15, 500, 1.0, TRACK_M)
        self.random = np.random.default_rng(self.seed)

    @property
    def yaw_error_rad(self) -> float:
        """Told minus true, map frame, now."""
        told = self.ring.newest_rpy()[2] - self.odometry.yaw_start_rad
        return wrapped(told - self.yaw_rad)

    @property
    def error(self) -> F64:
        """Estimate minus truth now: x, y (m), yaw (rad)."""
        state = self.ring.orientation.state.value
        x_m, y_m = self.odometry.xy_at(self.t_s) + state[:2]
        return np.array(
            [x_m - self.x_m, y_m - self.y_m, wrapped(self.yaw_error_rad + float(state[2]))]
        )

    def drive(self, seconds: float) -> "Robot":
        """Let time pass; the first sample is at the present instant."""
        for _ in range(round(seconds * 100)):
            self._tell()
            self._move(0.01)
        self._tell()
        return self

    def _move(self, dt_s: float) -> None:
        errors, t_s = self.errors, self.t_s + 0.5 * dt_s
        v, w = self.v(t_s), self.w(t_s)
        rough = errors.roughness * math.sqrt(abs(v) * dt_s) * self.random.standard_normal()
        step_m, middle = v * dt_s + rough, self.yaw_rad + 0.5 * w * dt_s
        self.x_m += step_m * math.cos(middle)
        self.y_m += step_m * math.sin(middle)
        self.yaw_rad += w * dt_s
        turn_mps = w - errors.asymmetry * v / TRACK_M
        slip = errors.slip_left_mps(t_s), errors.slip_right_mps(t_s)
        per_s = COUNTS_PER_M / (1 + errors.scale)
        self.left += (v - 0.5 * TRACK_M * turn_mps + slip[0]) * dt_s * per_s
        self.right += (v + 0.5 * TRACK_M * turn_mps + slip[1]) * dt_s * per_s
        kept = math.exp(-dt_s / WANDER_S)
        fresh = errors.wander * math.sqrt(1 - kept * kept)
        self.wander_rad = kept * self.wander_rad + fresh * self.random.standard_normal()
        self.k += 1
        self.t_s = 0.01 * self.k

    def _tell(self) -> None:
        errors, noise = self.errors, self.random.standard_normal(3)
        yaw = YAW_START_RAD + self.yaw_rad
        told = yaw + self.wander_rad + errors.pull(self.t_s) + errors.yaw_noise * float(noise[0])
        rate = self.w(self.t_s) + errors.gyro_bias + errors.gyro_noise * float(noise[1])
        rates = (0.0, 0.0, rate) if errors.rates else (math.nan,) * 3
        strength = 1 + errors.bend(self.t_s) + 0.002 * float(noise[2])
        level = strength * FIELD_NORTH
        field = (level * math.cos(yaw), -level * math.sin(yaw), strength * FIELD_UP)
        q = (math.cos(0.5 * told), 0.0, 0.0, math.sin(0.5 * told))
        self.ring.add(Attitude(self.t_s, q, rates, field if errors.magnetic else None))
        if self.k % 5 == 0 and self.counts_told(self.t_s):
            left, right = float(np.floor(self.left)), float(np.floor(self.right))
            self.odometry.add(WheelCounts(self.t_s, left, right, self.restarts))
        if self.external is not None and self.k % 10 == 0:
            pose = self.external(self)
            if pose is not None:
                self.odometry.add_external(pose)
        self.odometry.settle()
        if self.odometry.started:
            self.worst_yaw_rad = max(self.worst_yaw_rad, abs(self.yaw_error_rad))
