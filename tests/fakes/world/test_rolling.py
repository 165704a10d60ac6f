"""A machine that rolls through a hall: who carries a thing gives way to it."""

from dataclasses import replace

import numpy as np
import pytest

from fakes.scenes.halls import hall_of
from fakes.scenes.movers import box
from fakes.world.rolling import AWAY_M, RollingWorld

AHEAD = np.array([[0.0, 0.0, 0.3]]), np.array([[1.0, 0.0, 0.0]])  # a ray, body frame


@pytest.mark.parametrize(("far_m", "comes"), [(1.6, False), (AWAY_M + 0.1, True)])
def test_what_is_put_down_beside_the_machine_comes_when_it_is_away(
    far_m: float, comes: bool
) -> None:
    hall = hall_of(2)
    carried = box("carried", (far_m - 0.1, far_m + 0.1), (-0.2, 0.2), (0.0, 0.5), from_s=1.0)
    world = RollingWorld(replace(hall.scene, movers=(carried,), walkers=()), 1)
    world.step_to(0.0)
    assert world.met(0.0, *AHEAD).ranges_m[0] > far_m + 0.5
    world.step_to(3.0)
    assert (world.met(3.0, *AHEAD).ranges_m[0] < far_m) == comes
    world.set_power(-0.5, -0.5)
    while far_m - world.place[0] < AWAY_M + 0.05:
        world.step_to(world.since_begin_s + 0.1)
    ahead_m = far_m - 0.1 - world.place[0]
    assert world.met(0.0, *AHEAD).ranges_m[0] == pytest.approx(ahead_m, abs=0.01)
