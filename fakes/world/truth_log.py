"""Tells what is true of the robot and of the people around it, for a judge in another process.

A line of JSON, 50 times a second: `since_s` seconds since the world's begin; `x_m y_m z_m` of the
body's origin and `yaw_rad pitch_rad roll_rad` in the map frame, its x axis and origin being those
of the robot's start; `people` a list of [x_m, y_m, radius_m]. The first line is not the robot's: it
names the `scene` and the `seed`.
"""

import json
from typing import Any, TextIO

import numpy as np

from fakes.world.kinematic import KinematicWorld
from fakes.world.world import World

PERIOD_S = 0.02


class GroundTruthLog:
    """Writes a line whenever one is due; each is whole in the file at once."""

    def __init__(self, out: TextIO, world: World | KinematicWorld, scene: str, seed: int) -> None:
        self._out, self._world = out, world
        self._begin_s: float | None = None
        self._due_s = float("-inf")
        self._say({"scene": scene, "seed": seed})

    def step(self, now_s: float) -> None:
        if self._begin_s is None:
            self._begin_s = now_s
        if now_s < self._due_s:
            return
        self._due_s = max(self._due_s + PERIOD_S, now_s)
        x_m, y_m, yaw_rad, pitch_rad, roll_rad = self._world.pose()
        truth = {
            "since_s": now_s - self._begin_s,
            "x_m": x_m,
            "y_m": y_m,
            "z_m": self._world.height_m(),
            "yaw_rad": yaw_rad,
            "pitch_rad": pitch_rad,
            "roll_rad": roll_rad,
        }
        people = np.round(self._world.people(), 3).tolist()
        self._say({name: round(value, 4) for name, value in truth.items()} | {"people": people})

    def _say(self, truth: dict[str, Any]) -> None:
        self._out.write(json.dumps(truth) + "\n")
        self._out.flush()
