"""A floor for tests of the simulated world, and a robot of physics that drives on it."""

import math

import numpy as np
import numpy.typing as npt

from fakes.scenes.scene import Scene, Solid
from fakes.world.kinematic import KinematicWorld
from fakes.world.world import World

F64 = npt.NDArray[np.float64]
FLOOR = Solid("floor", (-30.0, 30.0), (-15.0, 15.0), (-1.0, 0.0))
FLAT = Scene("flat", (FLOOR,))
TILT = math.radians(7.5)  # of the scan plane
LENS_X_M = 0.25 * math.cos(TILT) - 1.08 * math.sin(TILT)  # of a body pitched so that it is level
SWEEP_RAD = np.radians(np.linspace(-60.0, 60.0, 481))


def driven(scene: Scene | str, seconds: float, one: float, two: float, seed: int = 1) -> World:
    """A world that began at 50 s, after so long at constant power."""
    world = World(scene, seed)
    world.step_to(50.0)
    world.wheels.set_power(one, two)
    world.step_to(50.0 + seconds)
    return world


def rims_m(world: World | KinematicWorld) -> tuple[float, float]:
    """Way of the left and the right rim since the begin, by the encoders."""
    left, right = (count / 2000 * math.tau * 0.15 for count in world.wheels.counts())
    return left, right
