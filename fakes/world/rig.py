"""The rig: one world, the three devices of its robot, and the driver, on whatever clock steps them.

It moves no bytes: the caller puts a wire on each device.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from fakes.ax3500.device import FakeAx3500
from fakes.lms1xx.device import FakeLms111
from fakes.mti.device import FakeMti
from fakes.scenes.scene import Scene, load_scene
from fakes.stripe.device import FakeStripe
from fakes.urg04lx.device import FakeUrg04lx
from fakes.world.driver import Driver
from fakes.world.error_models import ErrorModels
from fakes.world.kinematic import KinematicWorld
from fakes.world.robot import BODY, MOUNT, Body, Mount
from fakes.world.trajectory import Gait, laps, walking
from fakes.world.world import F64, World

AnyWorld = World | KinematicWorld

LOAD_A = 12.0  # of a motor of this robot at full power
WALKER_TURN_RADPS = 0.3  # of a robot with legs, on the spot
GAIT = Gait()


@dataclass(frozen=True, slots=True)
class Scanner:
    """A scanner that may stand on the robot, and how it is mounted where nobody says it."""

    make: Callable[["Rig", int], FakeLms111 | FakeUrg04lx | FakeStripe]
    mount: Mount = MOUNT


DEFAULT_SCANNER = "lms111"
SCANNERS = {  # by the name of the driver that speaks to it
    "lms111": Scanner(lambda rig, seed: FakeLms111(rig.ranges_m_at, seed)),
    "urg04lx": Scanner(
        lambda rig, seed: FakeUrg04lx(rig.ranges_m_at, seed, "URG-04LX-UG01"),
        MOUNT._replace(tilt_deg=16.0),
    ),
    "stripe": Scanner(lambda rig, seed: FakeStripe(rig.world.met, seed)),
}


def world_of(
    scene: Scene | str | Path,
    seed: int,
    start_delay_s: float,
    errors: ErrorModels | None,
    mount: Mount,
    body: Body = BODY,
) -> AnyWorld:
    """A scene's world: of physics, or of a robot that walks through it. `errors`: see `Rig`."""
    scene = scene if isinstance(scene, Scene) else load_scene(scene, seed)
    if not scene.walks:
        return World(scene, seed, errors, mount, body)
    way = laps(scene.waypoints, scene.speed_mps, WALKER_TURN_RADPS, start_delay_s)
    scene = scene if errors is None else replace(scene, errors=errors)
    walk = walking(way, GAIT, start_delay_s)
    world = KinematicWorld(scene, walk, seed=seed, mount=mount)
    world.ranges_m(np.zeros(1), np.zeros(1))  # compiles kernels before a host waits for its device
    return world


class Rig:
    """World, devices and driver; `step` first, then the wires, with the same `now_s`.

    The driver holds a radio that moves the robot even while the controller is in RS-232 mode, which
    no real one does: so the robot drives by itself while its counters are read.

    Args:
        scene: or a world that is ready; its robot may be one that moves as it is told.
        start_delay_s: from the first step to the driver's first command.
        drives: False: nobody holds the radio, and the wheels obey what comes over the wire only.
        errors: instead of the scene's own; a world that is ready keeps its own.
        scanner: one of `SCANNERS`.
        mount: of its lens; None: that of `SCANNERS`. A world that is ready keeps its own.
        body: of the robot. A world that is ready keeps its own, and must have this one.
        most_mps: the driver drives no faster.
    """

    def __init__(
        self,
        scene: Scene | str | Path | AnyWorld,
        seed: int,
        start_delay_s: float = 3.0,
        drives: bool = True,
        errors: ErrorModels | None = None,
        scanner: str = DEFAULT_SCANNER,
        mount: Mount | None = None,
        body: Body = BODY,
        most_mps: float = math.inf,
    ) -> None:
        on_robot = SCANNERS[scanner]
        self.world: AnyWorld
        if isinstance(scene, AnyWorld):
            self.world = scene
        else:
            self.world = world_of(scene, seed, start_delay_s, errors, mount or on_robot.mount, body)
        self.scanner: Any = on_robot.make(self, seed)
        if mount is not None and isinstance(self.scanner, FakeStripe):  # looks with its own lens
            self.scanner.mount_m, self.scanner.tilt_deg = mount[:3], mount.tilt_deg
        self.ahrs = FakeMti(self.world.motion_at, seed + 1)
        errors = self.world.errors
        share = np.random.default_rng([seed, 5]).uniform(-1.0, 1.0)
        if not isinstance(self.scanner, FakeStripe):  # measures no time of light
            self.scanner.offset_m = errors.range_offset_m * float(share)
        self.ahrs.sheet_errors = errors.ahrs_sheet_errors
        if self.world.scene.steels:
            self.ahrs.distortion_at = self.world.distortion_at
        self.drive = FakeAx3500(self.world.wheels, seed + 2)
        self.drive.load_a, self.drive.radio_overrides = LOAD_A, drives
        route = self.world.scene
        self.driver = Driver(
            self.world.pose,
            self.drive.command,
            route.waypoints if drives and self.world.obeys else (),
            route.speed_mps,
            start_delay_s,
            body.track_width_m,
            most_mps,
        )

    def ranges_m_at(self, t_first_s: float, times_s: F64, bearings_rad: F64) -> F64:
        return self.world.ranges_m(times_s, bearings_rad)

    def step(self, now_s: float) -> None:
        self.world.step_to(now_s)
        self.driver.step(now_s)
