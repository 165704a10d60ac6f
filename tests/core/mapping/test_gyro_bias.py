"""A gyro with a bias, as each has one, on a robot that nods: what was no ground before is none."""

import math

import numpy as np
import pytest

from core.records import OBSTACLE
from jit import COMPILED
from tests.support.cases import few
from tests.support.maps.flat_ride import Ride, Rig, config_of, places_where
from tests.support.maps.flat_world import World, kerb

KERB_M, STANDS_S = 9.53, 4.0
LANES_M = (-0.3, -0.1, 0.1, 0.3)  # the cells that the robot's width of 0.6 m covers
BIAS_RADPS = tuple(np.radians([-0.05, 0.15, 0.1]).tolist())


@pytest.mark.skipif(not COMPILED, reason="a ride through kernels as Python takes minutes")
@pytest.mark.parametrize("seed", few(range(40, 52), 2))
def test_a_kerb_bars_the_way_of_a_robot_that_nods_and_whose_gyro_has_a_bias(seed: int) -> None:
    ride = Ride(
        v_mps=0.6,
        start_s=STANDS_S,
        pitching_rad=math.radians(0.3),
        gyro_bias_radps=BIAS_RADPS,
    )
    rig = Rig(config_of(), World(kerb(KERB_M, 0.12)), ride, STANDS_S + 8.0, seed).run()
    x, y = places_where(rig, OBSTACLE).T
    at_kerb = np.abs(x - KERB_M) < 0.5
    assert all(np.any(np.abs(y[at_kerb] - lane) < 0.05) for lane in LANES_M)
