"""Fake positioning system: tells mapod where the world's robot is, in a frame of its own.

It speaks as any receiver of the planner link may, in EXTERNAL_POSE frames.
Source: planner link, section 3.
"""

import math
from collections import deque
from typing import Protocol

import numpy as np

from mapod_link.asking import Upright
from mapod_link.receiver import Receiver

AT_M, TURNED_RAD = np.array([105.0, -49.0, 3.0]), 0.7  # where its frame has the map's origin
LONGEST_AGE_S = 1.0  # that a frame can tell
ASK_S = 1.0  # between two questions whose run of mapod it is


class Seen(Protocol):
    """What can be seen of a world's robot."""

    def pose(self, t_s: float | None = None) -> tuple[float, float, float, float, float]:
        """x, y, yaw, pitch, roll at an instant, map frame."""

    def height_m(self, t_s: float | None = None) -> float:
        """Of the body's origin."""


class FakePositioning:
    """Sees the robot so many times a second, errs, and tells it after a while.

    Attributes:
        mute: it tells nothing.
        rate_hz: poses a second.
        delay_s: from seeing to telling, up to 1 s, which the frame tells as the pose's age.
        jump_m: by which all places are off along its x axis.
        sigma_m, sigma_z_m, sigma_rad: noise of place, height and yaw, white, 1 sigma.
        has_height: False: the short frame, without height and tilt.
    """

    def __init__(self, world: Seen, seed: int, rate_hz: float = 20.0) -> None:
        self.mute, self.delay_s, self.jump_m, self.has_height = False, 0.0, 0.0, True
        self.rate_hz, self.sigma_m, self.sigma_z_m = rate_hz, 0.01, 0.005
        self.sigma_rad, self.sigma_tilt_rad = math.radians(0.3), math.radians(0.3)
        self.told = 0  # poses
        self._world, self._random = world, np.random.default_rng([seed, 11])
        self._due_s = self._asked_s = -math.inf
        self._seen: deque[tuple[float, tuple[float, ...]]] = (
            deque()
        )  # instant; x y z yaw pitch roll

    def step(self, now_s: float, receiver: Receiver) -> None:
        """See what is due, and tell by this receiver what has been processed."""
        if now_s >= self._due_s:
            self._due_s = max(self._due_s, now_s - 1.0 / self.rate_hz) + 1.0 / self.rate_hz
            self._seen.append((now_s, self._measured(now_s)))
        while self._seen and self._seen[0][0] + self.delay_s <= now_s + 1e-9:
            seen_s, values = self._seen.popleft()
            if not self.mute:
                self._tell(now_s, min(now_s - seen_s, LONGEST_AGE_S), values, receiver)
        if now_s - self._asked_s >= ASK_S:
            self._asked_s = now_s
            receiver.ask(now_s, geometry=True)

    def _measured(self, t_s: float) -> tuple[float, ...]:
        x_m, y_m, yaw, pitch, roll = self._world.pose(t_s)
        cos, sin = math.cos(TURNED_RAD), math.sin(TURNED_RAD)
        true = (
            AT_M[0] + cos * x_m - sin * y_m + self.jump_m,
            AT_M[1] + sin * x_m + cos * y_m,
            AT_M[2] + self._world.height_m(t_s),
            yaw + TURNED_RAD,
            pitch,
            roll,
        )
        sigmas = [self.sigma_m] * 2 + [self.sigma_z_m, self.sigma_rad] + [self.sigma_tilt_rad] * 2
        noise = self._random.standard_normal(6)
        return tuple(float(a + s * n) for a, s, n in zip(true, sigmas, noise, strict=True))

    def _tell(
        self, now_s: float, age_s: float, values: tuple[float, ...], receiver: Receiver
    ) -> None:
        x_m, y_m, z_m, yaw, pitch, roll = values
        upright = Upright(z_m, self.sigma_z_m, (pitch, roll), self.sigma_tilt_rad)
        self.told += receiver.external_pose(
            now_s, x_m, y_m, yaw,
            sigma_x_m=self.sigma_m, sigma_y_m=self.sigma_m, sigma_yaw_rad=self.sigma_rad,
            age_s=age_s, upright=upright if self.has_height else None,
        )  # fmt: skip
