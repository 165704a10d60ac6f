"""A robot that drives through the world of `flat_world.py`: its sensors' records, in order.

The robot of the settings: scanner where they say, drive axle, and a castor 0.4 m ahead of it on
which it leans. It begins at the origin of the map frame, looking along +x.
"""

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from config_file import load_config, with_changes
from core.config import Config
from core.geometry import q_from_rpy
from core.mapping.mapper import Mapper
from core.mapping.surface.maps import SurfaceMaps
from core.records import Attitude, Scan, WheelCounts
from hw.lms1xx.options import Lms1xxOptions
from jit import COMPILED
from tests import ROOT
from tests.support.maps.flat_world import F64, Box, Profile, World

SHIPPED = load_config((ROOT / "mapod.toml").read_text(encoding="utf-8"))
CASTOR_M = 0.4
SCAN_S, ATTITUDE_S, COUNTS_S = 0.04, 0.01, 0.05
BEAM_DT_S = 0.25 / 360 / 25
EARTH_YAW_RAD = 0.7  # of the map's x axis
SHAKE_S = 0.3  # how long the attitude sensor's error lasts
STEP_S = 0.005  # of the path's integration


def config_of(**sections: dict[str, Any]) -> Config:
    return with_changes(SHIPPED, **sections)


def R_of(rpy: F64) -> F64:
    """Rotations (n, 3, 3) of (roll, pitch, yaw) rows (n, 3)."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy).T, np.sin(rpy).T
    zero, one = np.zeros(len(rpy)), np.ones(len(rpy))
    Rx = np.array([[one, zero, zero], [zero, cr, -sr], [zero, sr, cr]])
    Ry = np.array([[cp, zero, sp], [zero, one, zero], [-sp, zero, cp]])
    Rz = np.array([[cy, -sy, zero], [sy, cy, zero], [zero, zero, one]])
    return np.asarray(np.einsum("ijn,jkn,kln->nil", Rz, Ry, Rx))


@dataclass(frozen=True)
class Ride:
    """Steady speed and turn, on whatever the ground is; and how the body pitches."""

    v_mps: float = 0.0
    w_radps: float = 0.0
    start_s: float = 0.0  # until then it stands,
    stop_s: float = math.inf  # and from then on again
    pitching_rad: float = 0.0  # amplitude
    pitching_hz: float = 1.0
    noise_rad: float = math.radians(0.05)  # of the attitude sensor
    bias_rad: tuple[float, float] = (0.0, 0.0)  # roll, pitch: measured minus true
    gyro_bias_radps: tuple[float, float, float] = (0.0, 0.0, 0.0)
    slip: float = 0.0  # share of the travel that the wheels count too much


class Path3:
    """The true motion (n, 3) of the body over time, by small steps."""

    def __init__(self, ride: Ride, ground: Profile, seconds: float) -> None:
        self._ride = ride
        self._t_s = np.arange(0.0, seconds + 1.0, STEP_S)
        moves = (self._t_s >= ride.start_s) & (self._t_s < ride.stop_s)
        self._travel_m = np.cumsum(np.where(moves, ride.v_mps * STEP_S, 0.0))
        self._yaw_rad = np.cumsum(np.where(moves, ride.w_radps * STEP_S, 0.0))
        places, leaning = np.zeros((len(moves), 2)), np.zeros((len(moves), 2))
        place = np.zeros(2)
        for k, yaw in enumerate(self._yaw_rad):
            ahead = np.array([math.cos(yaw), math.sin(yaw)])
            left = np.array([-ahead[1], ahead[0]])
            feet = place + np.array([0 * ahead, CASTOR_M * ahead, 0.25 * left, -0.25 * left])
            axle, castor, port, starboard = ground.height(feet)
            pitch = -math.atan2(castor - axle, CASTOR_M)
            places[k], leaning[k] = place, (math.atan2(port - starboard, 0.5), pitch)
            step_m = ride.v_mps * STEP_S if moves[k] else 0.0
            place = place + step_m * math.cos(pitch) * ahead
        self._xyz_m = np.column_stack([places, ground.height(places)])
        self._leaning_rad = leaning

    def xyz(self, t_s: F64) -> F64:
        """Places (n, 3) of the body's origin."""
        return np.column_stack([np.interp(t_s, self._t_s, part) for part in self._xyz_m.T])

    def rpy(self, t_s: F64) -> F64:
        """(roll, pitch, yaw) rows (n, 3) in the map frame."""
        lean = [np.interp(t_s, self._t_s, part) for part in self._leaning_rad.T]
        ride = self._ride
        lean[1] = lean[1] + ride.pitching_rad * np.sin(2 * np.pi * ride.pitching_hz * t_s)
        return np.column_stack([*lean, np.interp(t_s, self._t_s, self._yaw_rad)])

    def wheels(self, t_s: float) -> tuple[float, float]:
        """Travel of the left and of the right wheel."""
        travel = (1.0 + self._ride.slip) * float(np.interp(t_s, self._t_s, self._travel_m))
        rim = 0.5 * SHIPPED.robot.track_width_m * float(np.interp(t_s, self._t_s, self._yaw_rad))
        return travel - rim, travel + rim


class Rig:
    """Mapper, world and robot on one clock."""

    def __init__(
        self, config: Config, world: World, ride: Ride, seconds: float, seed: int = 7
    ) -> None:
        if not COMPILED:
            pytest.skip("a ride through kernels as Python takes minutes")
        self.mapper = Mapper(config)
        self.world, self.ride, self.seconds = world, ride, seconds
        self.path = Path3(ride, world.ground, seconds)
        self.now_s = 0.0
        self._config, self._counts = config, 0  # told so far
        self._attitudes = self._measured_attitudes(np.random.default_rng(seed))

    @property
    def maps(self) -> SurfaceMaps:
        """Those of method `surface`."""
        maps = self.mapper.maps
        assert isinstance(maps, SurfaceMaps)
        return maps

    def drive(self) -> Iterator[float]:
        """Scan by scan, each on the map when its time is yielded."""
        for k in range(1, int(self.seconds / SCAN_S)):
            begin_s = k * SCAN_S
            scan = self._scan(begin_s)
            self._tell(begin_s + SCAN_S)
            self.mapper.add_scan(scan)
            self.mapper.settle(begin_s + SCAN_S)
            self.now_s = begin_s + SCAN_S
            yield self.now_s

    def run(self) -> "Rig":
        for _ in self.drive():
            pass
        return self

    def place(self) -> tuple[float, float, float]:
        """Where the body's origin truly is now."""
        x, y, z = (float(part) for part in self.path.xyz(np.array([self.now_s]))[0])
        return x, y, z

    def _scan(self, begin_s: float) -> Scan:
        """What the scanner measures."""
        scanner = self._config.scanner
        options = scanner.options
        assert isinstance(options, Lms1xxOptions)
        n = round((options.last_deg - options.first_deg) / options.angular_step_deg) + 1
        dt_s = BEAM_DT_S * options.angular_step_deg / 0.25
        t_s: F64 = np.asarray(begin_s + dt_s * np.arange(n), dtype=np.float64)
        bearings = np.radians(np.linspace(options.first_deg - 90, options.last_deg - 90, n))
        mount = np.radians([[scanner.mount_roll_deg, scanner.mount_tilt_deg, 0.0]])
        flat_rays = np.column_stack([np.cos(bearings), np.sin(bearings), np.zeros(n)])
        R_map_body = R_of(self.path.rpy(t_s))
        rays = np.einsum("nij,nj->ni", R_map_body, flat_rays @ R_of(mount)[0].T)
        arm = np.array(scanner.mount_xyz_m)
        lenses = self.path.xyz(t_s) + R_map_body @ arm
        ranges_m = self.world.ranges(lenses, rays, t_s, options.spec.echoes)
        step = float(bearings[1] - bearings[0])
        return Scan(begin_s, dt_s, float(bearings[0]), step, ranges_m, 0, begin_s + SCAN_S)

    def _tell(self, until_s: float) -> None:
        """Attitudes and counts up to an instant."""
        while self._attitudes[0].t_s <= until_s + 1e-9:
            self.mapper.add_attitude(self._attitudes.popleft())
        robot = self._config.robot
        per_m = 4 * robot.encoder_ppr / (2 * math.pi * robot.wheel_radius_m)
        while self._counts * COUNTS_S <= until_s + 1e-9:
            left, right = self.path.wheels(self._counts * COUNTS_S)
            counts = WheelCounts(self._counts * COUNTS_S, left * per_m, right * per_m, 0)
            self.mapper.add_counts(counts)
            self._counts += 1

    def _measured_attitudes(self, random: np.random.Generator) -> deque[Attitude]:
        """What the attitude sensor says: the truth, its bias, and an error that wanders."""
        t_s: F64 = np.arange(round(self.seconds / ATTITUDE_S) + 2, dtype=np.float64) * ATTITUDE_S
        now, soon = self.path.rpy(t_s), self.path.rpy(t_s + 0.001)
        turn = np.einsum("nji,njk->nik", R_of(now), R_of(soon)) / 0.001
        rates = np.column_stack([turn[:, 2, 1], turn[:, 0, 2], turn[:, 1, 0]])
        rates += self.ride.gyro_bias_radps
        kept = math.exp(-ATTITUDE_S / SHAKE_S)
        error_rad = random.normal(0.0, math.sqrt(1 - kept**2) * self.ride.noise_rad, now.shape)
        for k in range(1, len(t_s)):
            error_rad[k] += kept * error_rad[k - 1]
        told = now + error_rad + [*self.ride.bias_rad, EARTH_YAW_RAD]
        return deque(
            Attitude(at_s, tuple(q_from_rpy(*rpy).tolist()), tuple(rate))
            for at_s, rpy, rate in zip(t_s.tolist(), told, rates.tolist(), strict=True)
        )


def places_where(rig: Rig, state: int) -> npt.NDArray[np.float64]:
    """Middles (k, 2) of the window's cells that mean `state`."""
    window = rig.mapper.maps.window
    grid = window.grid
    rows, columns = np.nonzero(window.cells == state)
    i = grid.corner_i + (columns - grid.corner_i) % grid.size
    j = grid.corner_j + (rows - grid.corner_j) % grid.size
    return np.column_stack([(i + 0.5) * grid.cell_m, (j + 0.5) * grid.cell_m])


def cells_over(rig: Rig, state: int, box: Box) -> int:
    """How many of the window's cells of a state have their middle over a box."""
    found = places_where(rig, state)
    over = [(found[:, k] >= box.low[k]) & (found[:, k] <= box.high[k]) for k in (0, 1)]
    return int(np.sum(over[0] & over[1]))


def state_at(rig: Rig, x: float, y: float) -> int:
    window = rig.mapper.maps.window
    grid = window.grid
    i, j = grid.cell_of(x, y)
    assert 0 <= i - grid.corner_i < grid.size
    assert 0 <= j - grid.corner_j < grid.size
    return int(window.cells[j % grid.size, i % grid.size])
