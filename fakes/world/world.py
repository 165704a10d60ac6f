"""The truth behind the fakes: a scene and a robot in MuJoCo, whose last second can be asked about.

Instants are host times. The world begins at the first instant it is stepped to, and does not read
a clock: real time and simulated time are the same to it. Two worlds with the same scene and seed
that get the same commands at the same instants are the same to the bit.
"""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt

from fakes.rays.rays import Rays
from fakes.rays.sight import Met
from fakes.scenes.scene import Scene, load_scene
from fakes.world import robot
from fakes.world.crowd import Crowd
from fakes.world.error_models import ErrorModels
from fakes.world.kernels import motion_at, pose_at, poses_at, row_at
from fakes.world.magnetic import distortion
from fakes.world.rotations import rotation_z
from fakes.world.slip import Spinning, bursts

F64 = npt.NDArray[np.float64]
mj: Any = mujoco  # compiled: it comes without types
STEP_S = robot.STEPS * robot.STEP_S  # of the world: a tick of 200 Hz
KEPT = 200  # steps, 1 s: how far back instants may lie
SETTLING_STEPS = 200  # before the world begins, so that the robot rests on its contacts
LEAST_FRICTION = 1e-3  # of the scene's own bodies, where wheels are given theirs by place
SAME_S = 1e-9  # instants that are no farther apart are one
LOOK_STEPS = 4  # between two looks at people and at the ground's friction
MOTOR_SLEW_MPS2 = 3.0  # how fast the controller lets the wanted rim speed change
MOTOR_SPREAD = 0.01  # 1 sigma of what makes each motor faster or slower than the command


class Wheels:
    """The two motors and their encoders, as the controller is wired: 1 is left, 2 is right."""

    def __init__(
        self,
        angles_rad: Callable[[], tuple[float, float]],
        seed: int,
        radius_m: float = robot.WHEEL_RADIUS_M,
    ) -> None:
        self._angles_rad, self._radius_m = angles_rad, radius_m
        self._gains = np.random.default_rng(seed).normal(1.0, MOTOR_SPREAD, 2).tolist()
        self._wanted_mps, self._rims_mps = [0.0, 0.0], [0.0, 0.0]

    def counts(self) -> tuple[float, float]:
        """Encoder edges (channel 1, channel 2) at the instant the world was stepped to."""
        left_rad, right_rad = self._angles_rad()
        scale = robot.COUNTS_PER_TURN / math.tau
        return left_rad * scale, right_rad * scale

    def set_power(self, one: float, two: float) -> None:
        """Share of full power per channel, -1..1, held until the next call."""
        for k, (power, gain) in enumerate(zip((one, two), self._gains, strict=True)):
            self._wanted_mps[k] = max(-1.0, min(1.0, power)) * robot.MAX_SPEED_MPS * gain

    def step(self, ctrl_radps: F64) -> None:
        """Bring what the motors are told, (2,), one step nearer to what is wanted."""
        if self._rims_mps != self._wanted_mps:
            most = MOTOR_SLEW_MPS2 * STEP_S
            for k in (0, 1):
                change = self._wanted_mps[k] - self._rims_mps[k]
                self._rims_mps[k] += max(-most, min(most, change))
                ctrl_radps[k] = self._rims_mps[k] / self._radius_m


class Ground:
    """How slippery the floor is, and in which places: a share of what dry floor gives to wheels."""

    def __init__(self, scene: Scene, model: Any) -> None:
        self._model, self._patches, self._friction = model, scene.patches, scene.friction
        self._wheels = [model.geom(name).id for name in ("left", "right")]
        self._is_even = not self._patches and self._friction == 1.0
        if not self._is_even:  # of two bodies in contact the greater friction counts
            model.geom_friction[model.geom_group == 0, 0] = LEAST_FRICTION

    def under_wheels(self, data: Any) -> None:
        for wheel in () if self._is_even else self._wheels:
            x, y = data.geom_xpos[wheel][:2]
            friction = self._friction
            for patch in self._patches:
                if patch.x[0] <= x <= patch.x[1] and patch.y[0] <= y <= patch.y[1]:
                    friction = patch.friction
            self._model.geom_friction[wheel, 0] = friction


class World:
    """Physics of one robot in one scene, and rays for its scanner.

    `obeys`: what the motors want is done.

    Args:
        scene: a scene, the name of a shipped one, or the path of a scene's file.
        seed: spreads the strength of the two motors; of the scene's chances, people and upsets.
        errors: instead of the scene's own.
        mount: of the scanner's lens.
        body: of the robot.
    """

    obeys = True

    def __init__(
        self,
        scene: Scene | str | Path,
        seed: int,
        errors: ErrorModels | None = None,
        mount: robot.Mount = robot.MOUNT,
        body: robot.Body = robot.BODY,
    ) -> None:
        self.scene = scene if isinstance(scene, Scene) else load_scene(scene, seed)
        self.errors = self.scene.errors if errors is None else errors
        self._model = mj.MjModel.from_xml_string(robot.mjcf(self.scene, body))
        self._data = mj.MjData(self._model)
        self._ground = Ground(self.scene, self._model)
        self._crowd = Crowd(self.scene.walkers, seed) if self.scene.walkers else None
        slips = (*self.scene.slips, *bursts(self.errors.slip_bursts_per_min, seed))
        self._spinning = Spinning(slips, STEP_S) if slips else None
        self.wheels = Wheels(self.wheel_angles_rad, seed, body.wheel_radius_m)
        self._R_earth_map = rotation_z(-self.scene.x_axis_east_of_north_rad)
        self._rays = Rays(self.scene, seed, self.errors, self._crowd, mount)
        self._begin_s: float | None = None
        self._now_s, self._steps = 0.0, 0  # steps taken since the begin
        # x y z, qw qx qy qz, both wheels' angles; rate of turn, specific force of the sensor
        self._ring = np.zeros((KEPT, 15))
        self._settle()
        self._look_around()
        self._warm()

    def _warm(self) -> None:
        """Run the kernels once, so that none is compiled while a host waits for its device."""
        self.motion_at(self._now_s)
        self.ranges_m(np.full(1, self._now_s), np.zeros(1))

    def _settle(self) -> None:
        """Rest on the ground, then call that place the origin of the map."""
        for _ in range(SETTLING_STEPS):
            mj.mj_step(self._model, self._data, robot.STEPS)
        q_pos = self._data.qpos
        yaw = pose_at(q_pos)[2]
        turn = np.array([math.cos(yaw / 2), 0.0, 0.0, -math.sin(yaw / 2)])
        level = np.empty(4)
        mj.mju_mulQuat(level, turn, q_pos[3:7].copy())
        q_pos[0:2], q_pos[3:7], q_pos[7:9] = 0.0, level, 0.0
        self._data.qvel[:] = 0.0
        mj.mj_forward(self._model, self._data)
        self._record()

    def _record(self) -> None:
        row = self._ring[self._steps % KEPT]
        row[:9], row[9:] = self._data.qpos[:9], self._data.sensordata
        if self._spinning is not None:
            row[7:9] += self._spinning.rad

    def step_to(self, now_s: float) -> None:
        """Advance physics to `now_s`, a host time that never goes back."""
        if self._begin_s is None:
            self._begin_s = now_s
        self._now_s = max(self._now_s, now_s)
        while self._begin_s + self._steps * STEP_S < now_s - SAME_S:
            self._step()

    def _step(self) -> None:
        self.wheels.step(self._data.ctrl)
        mj.mj_step(self._model, self._data, robot.STEPS)
        self._steps += 1
        if self._spinning is not None:
            self._spinning.step(self._steps, self._data.qpos[7:9])
        self._record()
        if self._steps % LOOK_STEPS == 0:
            self._look_around()

    def _look_around(self) -> None:
        """People go on, up to the next look; wheels get the friction of the ground they are on."""
        self._ground.under_wheels(self._data)
        if self._crowd is not None:
            now_s, q_pos = self._steps * STEP_S, self._data.qpos
            place = pose_at(q_pos)[:3]
            if self._steps == 0:
                self._crowd.step(0.0, place)
            self._crowd.step(now_s + LOOK_STEPS * STEP_S, place)

    def people(self) -> F64:
        """x, y, radius (n, 3) of everybody who walks about and gives way, now; map frame."""
        if self._crowd is None:
            return np.zeros((0, 3))
        return self._crowd.people(self._since_begin_s(None))

    def _row(self, t_s: float | None) -> F64:
        """All that is remembered of an instant (15,), or of now."""
        return row_at(self._ring, self._steps, self._since_begin_s(t_s) / STEP_S)

    def _since_begin_s(self, t_s: float | None) -> float:
        begin_s = self._now_s if self._begin_s is None else self._begin_s
        return (self._now_s if t_s is None else t_s) - begin_s

    def wheel_angles_rad(self) -> tuple[float, float]:
        """How far (left, right) have turned since the begin, forward positive."""
        state = self._row(None)
        return float(state[7]), float(state[8])

    def pose(self, t_s: float | None = None) -> tuple[float, float, float, float, float]:
        """(x, y, yaw, pitch, roll) of the body in the map frame, now or at an instant gone by."""
        return pose_at(self._row(t_s))

    def height_m(self, t_s: float | None = None) -> float:
        """How high the body frame's origin lies above the map's z = 0."""
        return float(self._row(t_s)[2])

    def height_at(self, x: npt.ArrayLike, y: npt.ArrayLike, t_s: float | None = None) -> F64:
        """Height (n,) of the highest surface at x (n,), y (n,), map frame, now or at an instant."""
        return self.scene.height_at(x, y, self._since_begin_s(t_s))

    def distortion_at(self, t_s: float) -> F64:
        """What (3, 3) steel makes of the earth's field (north, west, up) where the robot is."""
        x, y = self._row(t_s)[:2]
        return distortion(self.scene.steels, float(x), float(y))

    def motion_at(self, t_s: float) -> tuple[F64, F64, F64]:
        """What an attitude sensor on the body, its axes along the body's, goes through.

        Returns:
            R_earth_sensor (3, 3), earth being north, west, up; rate of turn (3,) rad/s and
            specific force (3,) m/s2, both along the sensor's axes: standing, z is +9.81.
        """
        step = self._since_begin_s(t_s) / STEP_S
        return motion_at(self._ring, self._steps, step, self._R_earth_map)

    def ranges_m(self, times_s: F64, bearings_rad: F64) -> F64:
        """What beams from the lens meet: (n,) metres, NaN where nothing is within 30 m.

        Args:
            times_s: (n,) instants of the last second, in order.
            bearings_rad: (n,) in the scan plane, from straight ahead, counter-clockwise.

        Returns:
            (n,), or (2, n) where beams have second echoes; see `Rays`.
        """
        begin_s = self._now_s - self._since_begin_s(None)
        return self._rays.ranges_m(self._poses, times_s, bearings_rad, begin_s)

    def met(self, t_s: float, begins_body: F64, ways_body: F64) -> Met:
        """What rays (n, 3) of the body frame meet at an instant of the last second."""
        begin_s = self._now_s - self._since_begin_s(None)
        return self._rays.met(self._poses, t_s, (begins_body, ways_body), begin_s)

    def _poses(self, times_s: F64) -> tuple[F64, F64]:
        begin_s = self._now_s - self._since_begin_s(None)
        return poses_at(self._ring, self._steps, (times_s - begin_s) / STEP_S)
