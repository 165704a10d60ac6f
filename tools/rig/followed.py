"""Follows what the fakes' process tells is true of the robot, and lets the judge look at it."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from fakes.scenes.scene import Scene
from tools.rig.judge import Judge, Truth


def truth_from_line(line: str) -> Truth | None:
    """One line of the file; None for the first one, which names the scene."""
    told: dict[str, Any] = json.loads(line)
    if "since_s" not in told:
        return None
    people = told.get("people")
    return Truth(
        told["since_s"],
        (told["x_m"], told["y_m"], told["yaw_rad"]),
        told["z_m"],
        told["pitch_rad"],
        told["roll_rad"],
        None if people is None else np.array(people, dtype=float).reshape(-1, 3),
    )


class Followed:
    """A growing file of truths, and the judge who has seen all of it so far."""

    def __init__(self, path: Path, scene: Scene) -> None:
        self._path, self.judge = path, Judge(scene)
        self._at, self._rest = 0, ""
        self.newest: Truth | None = None

    def step(self) -> None:
        """Look at what was added."""
        if not self._path.exists():
            return
        with self._path.open(encoding="ascii") as file:
            file.seek(self._at)
            added = file.read()
        self._at += len(added)
        *lines, self._rest = (self._rest + added).split("\n")
        for line in lines:
            truth = truth_from_line(line)
            if truth is not None:
                self.newest = truth
                self.judge.step(truth)

    @property
    def hits(self) -> int:
        """Collisions so far."""
        return len(self.judge.collisions)

    def gap_m(self, x_m: float, y_m: float) -> float:
        """How far the robot truly is from a place; inf before anything is known."""
        if self.newest is None:
            return float("inf")
        x, y, _ = self.newest.place
        return float(np.hypot(x - x_m, y - y_m))
