"""A machine on two wheels in a level scene: motors and wheels without contacts, in large halls.

Each wheel follows its motor's power after a while; the body goes where the wheels roll. It is many
times quicker than a `World`, and knows neither slip nor nodding. People see the machine and give
way; who carries a thing waits with it until the machine is away. Map frame, metres; it is the same
to the bit however it is stepped.
"""

import math
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from fakes.rays.rays import Rays
from fakes.rays.sight import Met
from fakes.scenes.scene import Scene
from fakes.world.crowd import Crowd
from fakes.world.robot import COUNTS_PER_TURN, MAX_SPEED_MPS, TRACK_WIDTH_M, WHEEL_RADIUS_M

F64 = npt.NDArray[np.float64]
STEP_S = 0.02
AWAY_M = 2.0  # from where a thing is put down
JUST_LESS = 0.999  # than a step: within the next one, whatever is rounded
MOTOR_S = 0.15  # time constant of a motor


class RollingWorld:
    """A machine that starts at the origin, what is around it, and rays for its camera.

    Args:
        seed: of people's pauses.
    """

    def __init__(self, scene: Scene, seed: int) -> None:
        self.scene = scene
        self.crowd = Crowd(scene.walkers, seed) if scene.walkers else None
        self._seed, self._rays = seed, Rays(scene, seed, crowd=self.crowd)
        self._place, self._turned = np.zeros(3), np.zeros(2)  # x, y, yaw; radians of both wheels
        self._speeds, self._power = np.zeros(2), np.zeros(2)
        self._begin_s: float | None = None
        self._steps = 0

    @property
    def place(self) -> tuple[float, float, float]:
        """x, y, yaw, now."""
        x, y, yaw = self._place.tolist()
        return x, y, yaw

    @property
    def speeds(self) -> tuple[float, float]:
        """Ahead, m/s, and turning, rad/s."""
        left, right = self._speeds.tolist()
        return (left + right) / 2, (right - left) / TRACK_WIDTH_M

    def counts(self) -> tuple[float, float]:
        """Encoder counts of the left wheel and the right one."""
        left, right = (self._turned / math.tau * COUNTS_PER_TURN).tolist()
        return left, right

    def set_power(self, one: float, two: float) -> None:
        """Of the left motor and the right one, -1..1."""
        self._power[:] = one, two

    def step_to(self, now_s: float) -> None:
        """Let time pass, in steps of `STEP_S`."""
        if self._begin_s is None:
            self._begin_s = now_s
            self._look()
        while self._begin_s + (self._steps + 1) * STEP_S <= now_s + 1e-9:
            self._steps += 1
            self._wait_with_things()
            self._step()
            self._look()

    @property
    def since_begin_s(self) -> float:
        """The instant of the newest step, on the clock of who walks."""
        return self._steps * STEP_S

    def _step(self) -> None:
        share = 1.0 - math.exp(-STEP_S / MOTOR_S)
        before = self._speeds.copy()
        self._speeds += share * (MAX_SPEED_MPS * self._power - self._speeds)
        left, right = ((before + self._speeds) / 2 * STEP_S).tolist()
        ahead, turn = (left + right) / 2, (right - left) / TRACK_WIDTH_M
        yaw = self._place[2] + turn / 2
        self._place += ahead * math.cos(yaw), ahead * math.sin(yaw), turn
        self._turned += np.array([left, right]) / WHEEL_RADIUS_M

    def _wait_with_things(self) -> None:
        """What comes in this step, and would come beside the machine, comes in the next one."""
        now_s, movers = self.since_begin_s, list(self.scene.movers)
        for k, mover in enumerate(movers):
            is_due = now_s - STEP_S < mover.from_s <= now_s
            if is_due and math.dist(mover.waypoints[0], self.place[:2]) < AWAY_M:
                movers[k] = replace(mover, from_s=now_s + JUST_LESS * STEP_S)
        if tuple(movers) != self.scene.movers:
            self.scene = replace(self.scene, movers=tuple(movers))
            self._rays = Rays(self.scene, self._seed, crowd=self.crowd)

    def _look(self) -> None:
        if self.crowd is not None:
            self.crowd.step(self.since_begin_s, self.place)

    def met(self, t_s: float, begins_body: F64, ways_body: F64) -> Met:
        """What rays (n, 3) of the body frame meet, of now: all leave at the newest step."""
        x, y, yaw = self.place
        c, s = math.cos(yaw), math.sin(yaw)
        t_map_body = np.array([[x, y, 0.0]])
        R_map_body = np.array([[[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]])
        at_s = self.since_begin_s
        return self._rays.met(
            lambda times_s: (t_map_body, R_map_body), at_s, (begins_body, ways_body), 0.0
        )
