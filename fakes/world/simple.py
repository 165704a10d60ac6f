"""What stands behind a fake that runs alone, in closed formulas: a room, a motion, two wheels.

It needs no MuJoCo. What two of them see does not hang together: for that there is a world.
"""

import math
import re

import numpy as np

from fakes.rays.kernels import PLAIN
from fakes.rays.sight import Met
from fakes.world.rotations import F64

AHEAD_M, BEHIND_M, LEFT_M, RIGHT_M = 5.0, 3.0, 2.5, 2.0  # walls of the room, from the lens
FAR_M = 100.0
GRAVITY_MPS2 = 9.81
TURNING_RADPS = math.radians(10.0)
SWAY_RAD, SWAY_RADPS = math.radians(5.0), math.pi
COUNTS_PER_S = 2122.0  # of a wheel at full power
MOTOR_S = 0.15  # time constant of a motor

ROOMS = ("room", "empty", "wall:METRES")
GROUNDS = ("floor", "wall:METRES")
MOTIONS = ("still", "turning", "swaying")


class Room:
    """What a level scanner sees: `room`, `empty`, or one wall across its way, `wall:2.5`.

    Raises:
        ValueError: no such scene.
    """

    def __init__(self, scene: str) -> None:
        found = re.fullmatch(r"(room|empty)|(wall):(\d+(?:\.\d*)?)", scene)
        if found is None:
            raise ValueError(f"no scene {scene!r}; there are {', '.join(ROOMS)}, or a world's")
        self._kind = found[1] or found[2]
        self._wall_m = float(found[3]) if found[3] else math.inf

    def ranges_m_at(self, t_first_s: float, times_s: F64, bearings_rad: F64) -> F64:
        """(n,) metres, NaN where nothing is; bearings (n,) from straight ahead, leftwards."""
        c, s = np.cos(bearings_rad), np.sin(bearings_rad)
        with np.errstate(divide="ignore"):
            if self._kind == "room":
                along = np.where(c > 0, AHEAD_M, BEHIND_M) / np.abs(c)
                across = np.where(s > 0, LEFT_M, RIGHT_M) / np.abs(s)
                return np.minimum(along, across)
            ranges_m = np.where(c > 0, self._wall_m / c, np.nan)
        return np.where(ranges_m < FAR_M, ranges_m, np.nan)


class Ground:
    """What a camera sees: the ground under a robot, `floor`, or with a wall on it, `wall:0.8`,
    that far ahead of the body's origin.

    Raises:
        ValueError: no such scene.
    """

    def __init__(self, scene: str) -> None:
        found = re.fullmatch(r"floor|wall:(\d+(?:\.\d*)?)", scene)
        if found is None:
            raise ValueError(f"no scene {scene!r}; there are {', '.join(GROUNDS)}, or a world's")
        self._wall_m = float(found[1]) if found[1] else math.inf

    def met(self, t_s: float, begins_body: F64, ways_body: F64) -> Met:
        """What rays (n, 3) of the body frame meet, which is the map's."""
        (x, _, z), (way_x, _, way_z) = begins_body.T, ways_body.T
        with np.errstate(divide="ignore"):
            floor_m = np.where(way_z < 0, -z / way_z, np.inf)
            wall_m = np.where(way_x > 0, (self._wall_m - x) / way_x, np.inf)
        is_wall = wall_m < floor_m
        ranges_m = np.minimum(floor_m, wall_m)
        ranges_m[ranges_m > FAR_M] = np.inf
        points = begins_body + np.where(np.isfinite(ranges_m), ranges_m, 0.0)[:, None] * ways_body
        normals = np.where(is_wall[:, None], np.array([-1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0]))
        plain = np.full(len(x), PLAIN, dtype=np.int64)
        return Met(ways_body, ranges_m, points, normals, is_wall.astype(np.int64), plain)


class Motion:
    """What a sensor goes through that stands still, turns on the spot, or sways sideways.

    Raises:
        ValueError: no such motion.
    """

    def __init__(self, scene: str) -> None:
        if scene not in MOTIONS:
            raise ValueError(f"no scene {scene!r}; there are {', '.join(MOTIONS)}, or a world's")
        self._scene = scene

    def motion_at(self, t_s: float) -> tuple[F64, F64, F64]:
        """R_earth_sensor (3, 3), rate of turn (3,) rad/s, specific force (3,) m/s2."""
        yaw = roll = yaw_rate = roll_rate = 0.0
        if self._scene == "turning":
            yaw, yaw_rate = math.remainder(TURNING_RADPS * t_s, math.tau), TURNING_RADPS
        elif self._scene == "swaying":
            roll = SWAY_RAD * math.sin(SWAY_RADPS * t_s)
            roll_rate = SWAY_RAD * SWAY_RADPS * math.cos(SWAY_RADPS * t_s)
        cy, sy, cr, sr = math.cos(yaw), math.sin(yaw), math.cos(roll), math.sin(roll)
        R = np.array([[cy, -sy * cr, sy * sr], [sy, cy * cr, -cy * sr], [0.0, sr, cr]])
        return R, np.array([roll_rate, 0.0, yaw_rate]), R.T @ np.array([0.0, 0.0, GRAVITY_MPS2])


class TwoWheels:
    """Wheels in the air: they follow the power that they are given after a while."""

    def __init__(self, counts_per_s: float = COUNTS_PER_S) -> None:
        self._counts_per_s = counts_per_s
        self._wanted, self._speeds, self._turned = (0.0, 0.0), [0.0, 0.0], [0.0, 0.0]
        self._now_s: float | None = None

    def step_to(self, now_s: float) -> None:
        gone_s = max(0.0, now_s - (now_s if self._now_s is None else self._now_s))
        self._now_s = now_s
        share = 1.0 - math.exp(-gone_s / MOTOR_S)
        for k in (0, 1):
            self._speeds[k] += share * (self._counts_per_s * self._wanted[k] - self._speeds[k])
            self._turned[k] += self._speeds[k] * gone_s

    def counts(self) -> tuple[float, float]:
        return self._turned[0], self._turned[1]

    def set_power(self, one: float, two: float) -> None:
        self._wanted = one, two
