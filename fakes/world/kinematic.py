"""A world whose robot moves as it is told: along a trajectory, exactly, without physics.

It has the face of a `World`: the same devices stand on it. Wheels count what the body's motion
makes them roll, and their motors move nothing. What has been can be asked about for KEPT_S, and a
world is the same to the bit however it is stepped. A scene's walkers are not there.
"""

import math
from pathlib import Path

import numpy as np
import numpy.typing as npt

from fakes.rays.rays import Rays
from fakes.rays.sight import Met
from fakes.scenes.scene import Scene, load_scene
from fakes.world import robot
from fakes.world.magnetic import distortion
from fakes.world.rotations import R_from_angles, rotation_z
from fakes.world.slip import bursts, shares
from fakes.world.terrain import stance
from fakes.world.trajectory import Trajectory
from fakes.world.world import Wheels

F64 = npt.NDArray[np.float64]
STEP_S = 0.002
BLOCK = 256  # steps that are computed at once
KEPT_S = 600.0  # at least; a drive of hours would fill the memory
SMOOTH_S = 0.015  # 1 sigma of what tyres and springs take off the edges of the ground
MARGIN = 32  # steps beyond a block that its smoothing and its derivatives look at
GRAVITY_MPS2 = 9.81
X, Y, YAW, PITCH, ROLL, Z, LEFT, RIGHT = range(8)  # columns; then rate of turn, specific force
RATE, FORCE = slice(8, 11), slice(11, 14)


class KinematicWorld:
    """A robot on a trajectory in a scene, and rays for its scanner.

    Args:
        scene: a scene, the name of a shipped one, or the path of a scene's file.
        trajectory: time zero is the first instant that the world is stepped to.
        follows: True: height, pitch and roll come from the ground under the wheels, and those of
            the trajectory are added; for ramps, bumps and kerbs.
        seed: of what beams meet in soft things, and of the scene's upsets.
        mount: of the scanner's lens.
    """

    obeys = False  # what the motors want is not heard

    def __init__(
        self,
        scene: Scene | str | Path,
        trajectory: Trajectory,
        follows: bool = False,
        seed: int = 1,
        mount: robot.Mount = robot.MOUNT,
    ) -> None:
        self.scene = scene if isinstance(scene, Scene) else load_scene(scene, seed)
        self.errors = self.scene.errors
        self.wheels = Wheels(self.wheel_angles_rad, seed)
        self._trajectory, self._follows = trajectory, follows
        self._slips = (*self.scene.slips, *bursts(self.errors.slip_bursts_per_min, seed))
        self._rays = Rays(self.scene, seed, self.errors, mount=mount)
        self._begin_s: float | None = None
        self._now_s = 0.0
        self._rows = np.zeros((0, 14))  # one a step; grows by doubling, up to twice KEPT_S
        self._oldest = 0  # step of the first of them
        self._known = 0  # steps that are computed, since the begin

    def step_to(self, now_s: float) -> None:
        if self._begin_s is None:
            self._begin_s = now_s
        self._now_s = max(self._now_s, now_s)

    def _rows_at(self, times_s: F64) -> F64:
        """Rows (n, 14) at host times (n,), interpolated; the first row before the begin.

        Raises:
            ValueError: an instant is longer ago than KEPT_S, and not kept any more.
        """
        begin_s = self._now_s if self._begin_s is None else self._begin_s
        k = np.maximum(0.0, (np.minimum(times_s, self._now_s) - begin_s) / STEP_S)
        before = np.floor(k).astype(np.int64)
        while self._known < before.max() + 2:
            self._compute()
        share, at = (k - before)[:, None], before - self._oldest
        if at.min() < 0:
            at_s = begin_s + self._oldest * STEP_S
            raise ValueError(f"the world is known from {at_s:.3f} s on, not at {times_s.min():.3f}")
        return np.asarray((1 - share) * self._rows[at] + share * self._rows[at + 1])

    def _compute(self) -> None:
        first = self._known
        self._make_room()
        steps = np.arange(first - MARGIN, first + BLOCK + MARGIN)
        t_s = np.asarray(steps * STEP_S, dtype=float)
        poses = self._poses_at(t_s)
        rates, forces, speeds = _felt(poses)
        speeds *= 1.0 + shares(self._slips, t_s)
        at = first - self._oldest
        inner, rows = slice(MARGIN, MARGIN + BLOCK), self._rows[at : at + BLOCK]
        rows[:, :6] = poses[inner]
        rows[:, RATE], rows[:, FORCE] = rates[inner], forces[inner]
        begun = self._rows[at - 1, LEFT : RIGHT + 1] if first else np.zeros(2)
        # the mean of the speeds at both ends of a step; nothing has turned before the begin
        turned = (speeds[MARGIN - 1 : MARGIN + BLOCK - 1] + speeds[inner]) / 2 * STEP_S
        turned[0] *= first > 0
        rows[:, LEFT : RIGHT + 1] = begun + np.cumsum(turned, axis=0)
        self._known += BLOCK

    def _make_room(self) -> None:
        """For a block more: twice as many rows, or else the older half of them is forgotten."""
        used, kept = self._known - self._oldest, round(KEPT_S / STEP_S)
        if used + BLOCK <= len(self._rows):
            return
        if used < 2 * kept:
            more = np.zeros((max(BLOCK, len(self._rows)), 14))
            self._rows = np.concatenate([self._rows, more])
            return
        self._rows[:kept] = self._rows[used - kept : used]
        self._oldest = self._known - kept

    def _poses_at(self, t_s: F64) -> F64:
        """Poses (n, 6) at even instants (n,) since the begin."""
        if not self._follows:
            return np.array(self._trajectory(np.maximum(t_s, 0.0)))
        taps = np.arange(-MARGIN, MARGIN + 1) * STEP_S
        weights = np.exp(-0.5 * (taps / SMOOTH_S) ** 2)
        longer_s = np.concatenate([t_s[0] + taps[:MARGIN], t_s, t_s[-1] + taps[MARGIN + 1 :]])
        poses = np.array(self._trajectory(np.maximum(longer_s, 0.0)))
        ground = self.scene.ground_near(poses[:, X], poses[:, Y])
        stood = stance(ground.height_at, poses[:, X], poses[:, Y], poses[:, YAW])
        poses = poses[MARGIN:-MARGIN]
        for column, values in zip((PITCH, ROLL, Z), stood, strict=True):
            poses[:, column] += np.convolve(values, weights / weights.sum(), "valid")
        return poses

    def _since_begin_s(self, t_s: float | None) -> float:
        begin_s = self._now_s if self._begin_s is None else self._begin_s
        return (self._now_s if t_s is None else t_s) - begin_s

    def _row(self, t_s: float | None) -> F64:
        return np.asarray(self._rows_at(np.array([self._now_s if t_s is None else t_s]))[0])

    def wheel_angles_rad(self) -> tuple[float, float]:
        row = self._row(None)
        return float(row[LEFT]), float(row[RIGHT])

    def pose(self, t_s: float | None = None) -> tuple[float, float, float, float, float]:
        x, y, yaw, pitch, roll = (float(part) for part in self._row(t_s)[:5])
        return x, y, math.remainder(yaw, math.tau), pitch, roll

    def height_m(self, t_s: float | None = None) -> float:
        return float(self._row(t_s)[Z])

    def height_at(self, x: npt.ArrayLike, y: npt.ArrayLike, t_s: float | None = None) -> F64:
        return self.scene.height_at(x, y, self._since_begin_s(t_s))

    def people(self) -> F64:
        """Nobody (0, 3): as a `World` tells x, y and radius of its walkers."""
        return np.zeros((0, 3))

    def distortion_at(self, t_s: float) -> F64:
        row = self._row(t_s)
        return distortion(self.scene.steels, float(row[X]), float(row[Y]))

    def motion_at(self, t_s: float) -> tuple[F64, F64, F64]:
        row = self._rows_at(np.array([t_s]))
        R_map_sensor = R_from_angles(row[:, YAW], row[:, PITCH], row[:, ROLL])[0]
        R_earth_map = rotation_z(-self.scene.x_axis_east_of_north_rad)
        return R_earth_map @ R_map_sensor, row[0, RATE], row[0, FORCE]

    def ranges_m(self, times_s: F64, bearings_rad: F64) -> F64:
        begin_s = self._now_s - self._since_begin_s(None)
        return self._rays.ranges_m(self._bodies_at, times_s, bearings_rad, begin_s)

    def met(self, t_s: float, begins_body: F64, ways_body: F64) -> Met:
        """What rays (n, 3) of the body frame meet at an instant gone by."""
        begin_s = self._now_s - self._since_begin_s(None)
        return self._rays.met(self._bodies_at, t_s, (begins_body, ways_body), begin_s)

    def _bodies_at(self, times_s: F64) -> tuple[F64, F64]:
        rows = self._rows_at(times_s)
        return rows[:, [X, Y, Z]], R_from_angles(rows[:, YAW], rows[:, PITCH], rows[:, ROLL])


def _felt(poses: F64) -> tuple[F64, F64, F64]:
    """(rates of turn (n, 3), specific forces (n, 3), speeds of both wheels (n, 2) rad/s).

    By differences between even instants; the first and the last two rows are of no worth.
    A wheel's angle is counted against the body: it turns by what the body's point above the
    ground, at the wheel's foot, moves ahead.
    """
    yaw, pitch, roll = poses[:, YAW], poses[:, PITCH], poses[:, ROLL]
    R = R_from_angles(yaw, pitch, roll)
    dyaw, dpitch, droll = (np.gradient(part, STEP_S) for part in (yaw, pitch, roll))
    rates = np.stack(
        [
            droll - dyaw * np.sin(pitch),
            dpitch * np.cos(roll) + dyaw * np.sin(roll) * np.cos(pitch),
            -dpitch * np.sin(roll) + dyaw * np.cos(roll) * np.cos(pitch),
        ],
        -1,
    )
    origins = poses[:, [X, Y, Z]]
    sites = origins + R @ np.array(robot.AHRS_BODY_M)
    accelerations = np.zeros_like(sites)
    accelerations[1:-1] = (sites[2:] - 2 * sites[1:-1] + sites[:-2]) / STEP_S**2
    accelerations[:, 2] += GRAVITY_MPS2
    forces = np.einsum("nji,nj->ni", R, accelerations)
    ahead_mps = np.einsum("nj,nj->n", R[:, :, 0], np.gradient(origins, STEP_S, axis=0))
    aside_mps = rates[:, 2] * robot.TRACK_WIDTH_M / 2
    speeds = np.stack([ahead_mps - aside_mps, ahead_mps + aside_mps], -1) / robot.WHEEL_RADIUS_M
    return rates, forces, speeds
