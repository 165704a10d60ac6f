"""What the planner link is given to tell: the maps of a drive, recorded once, and random ones.

The drive is mapod's own through the shipped scene. The scanner turns at 50 Hz with 541 beams,
cells are 5 cm wide. The same drive can then be told over any line, at any rate.
"""

import functools
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from app import App, Ports
from config_file import load_config, with_changes
from core.config import Config
from core.records import I8, I32, I64, UNKNOWN, ObstacleMap, PoseReport
from fakes.wires.wire import MemoryPort, Wire
from fakes.world.rig import Rig
from tools.conformance.sender import STANDING, World

CELL_M = 0.05
SCAN_HZ = 50
FAST = {"scan_rate_hz": SCAN_HZ, "angular_step_deg": 0.5, "first_deg": -45.0, "last_deg": 225.0}
SCENE, SEED, START_S = "corridor", 1, 1000.0
SETTLE_S = 5.0  # the sensors answer, the robot begins to drive
SHIPPED = Path(__file__).resolve().parents[2] / "mapod.toml"


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """Pose and window as the app had them at one instant."""

    t_s: float  # since the drive began
    pose: PoseReport
    cells: I8  # (size, size), a ring as in `ObstacleMap`
    corner_i: int
    corner_j: int


def fast_config(size: int) -> Config:
    shipped = load_config(SHIPPED.read_text(encoding="utf-8"))
    cells = {"cells": size, "cell_m": CELL_M}
    return with_changes(shipped, scanner=FAST, map=cells, obstacle={"window_cells": size})


@functools.lru_cache(maxsize=2)
def drive(size: int, seconds: float) -> tuple[Moment, ...]:
    """One moment for each scan of so many seconds."""
    rig = Rig(SCENE, SEED, start_delay_s=SETTLE_S - 1.0)
    scanner, ahrs, wheels = MemoryPort(), MemoryPort(), MemoryPort()
    planner = MemoryPort(datagrams=True)
    wires = [Wire(rig.scanner, scanner, 1), Wire(rig.ahrs, ahrs, 2), Wire(rig.drive, wheels, 3)]
    config = fast_config(size)
    app = App(config, Ports(scanner, ahrs, wheels, planner), session=1)
    grid, period_s = app.mapper.maps.window.grid, 1.0 / config.loop.rate_hz
    moments: list[Moment] = []
    for tick in range(round((SETTLE_S + seconds) / period_s)):
        t_s = tick * period_s - SETTLE_S
        rig.step(START_S + t_s)
        for wire in wires:
            wire.step(START_S + t_s)
        app.step(START_S + t_s)
        planner.take_datagrams()
        if t_s >= len(moments) / SCAN_HZ:
            _, pose = app.report(START_S + t_s)
            cells = app.mapper.maps.window.cells.copy()
            moments.append(Moment(t_s, pose, cells, grid.corner_i, grid.corner_j))
    return tuple(moments)


class Playback:
    """The drive again, as the windows that the core would hand to the link at its own rate."""

    def __init__(self, moments: tuple[Moment, ...]) -> None:
        self._moments, self._at = moments, 0
        self._told: I8 = np.zeros_like(moments[0].cells)

    @property
    def pose(self) -> PoseReport:
        """At the moment that was given last."""
        return self._moments[self._at].pose

    def until(self, t_s: float) -> ObstacleMap:
        """The window at a time of the drive, and what has changed in it since the last call."""
        moments, before = self._moments, self._moments[self._at]
        while self._at + 1 < len(moments) and moments[self._at + 1].t_s <= t_s + 1e-9:
            self._at += 1
        now = moments[self._at]
        came_in = _came_in(before, now)
        self._told[came_in] = UNKNOWN  # the receiver knows that without being told
        changed: I32 = np.flatnonzero(now.cells != self._told).astype(np.int32)
        self._told = now.cells
        return ObstacleMap(now.cells, now.corner_i, now.corner_j, changed, 0, True)


class RandomMap:
    """Windows that change and move at random, more than a robot's: they fill a slow line."""

    pose = STANDING

    def __init__(self, size: int, seed: int, changes: int = 25) -> None:
        self._world, self._changes, self._steps = World(size, seed), changes, 0

    def until(self, t_s: float) -> ObstacleMap:
        while self._steps <= t_s * SCAN_HZ:
            self._steps += 1
            self._world.change(self._changes)
            if self._steps % 4 == 0:
                self._world.wander()
        return self._world.window()


def _came_in(before: Moment, now: Moment) -> npt.NDArray[np.bool_]:
    """Which cells (size, size) of the ring stand for other places of the world than before."""
    size = len(now.cells)
    rows = _stands_for(before.corner_j, size) != _stands_for(now.corner_j, size)
    columns = _stands_for(before.corner_i, size) != _stands_for(now.corner_i, size)
    mask: npt.NDArray[np.bool_] = rows[:, None] | columns
    return mask


def _stands_for(corner: int, size: int) -> I64:
    """World index (size,) of each row or column of a ring with that lowest one."""
    world: I64 = corner + (np.arange(size) - corner) % size
    return world
