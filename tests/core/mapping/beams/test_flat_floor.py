"""Method `beams` on floor that is no obstacle, however the robot moves: none is invented."""

import math

import numpy as np
import pytest

from core.records import FREE, OBSTACLE
from tests.support.cases import few
from tests.support.flat_ride import Ride, Rig, config_of, places_where
from tests.support.flat_world import FAR_M, Profile, World, ramp


def drive(world: World, metres: float, v_mps: float = 1.0) -> Rig:
    """A robot that has driven straight on."""
    return Rig(config_of(), world, Ride(v_mps=v_mps), metres / v_mps).run()


@pytest.mark.parametrize("seed", few([1, 2, 3], 1))
@pytest.mark.parametrize(
    "ride",
    [
        pytest.param(Ride(v_mps=1.0), id="straight"),
        pytest.param(Ride(), id="standing"),
        pytest.param(Ride(w_radps=0.6), id="on the spot"),
        pytest.param(Ride(v_mps=0.5, w_radps=0.3), id="arc"),
        pytest.param(Ride(v_mps=0.8, pitching_rad=math.radians(3)), id="pitching"),
        pytest.param(Ride(pitching_rad=math.radians(3)), id="rocking"),
    ],
)
def test_flat_floor_has_no_obstacle(ride: Ride, seed: int) -> None:
    rig = Rig(config_of(), World(seed=seed), ride, 5.0, seed).run()
    assert len(places_where(rig, OBSTACLE)) == 0
    swept = ride.v_mps > 0 or ride.w_radps > 0 or ride.pitching_rad > 0
    assert len(places_where(rig, FREE)) > (300 if swept else 80)


def test_the_floor_that_the_line_has_swept_is_free_without_holes() -> None:
    rig = drive(World(), 6.0)
    free = places_where(rig, FREE)
    for x in np.arange(9.3, 13.7, 0.2):
        for y in np.arange(-1.9, 2.0, 0.2):
            assert np.any(np.hypot(*(free - (x, y)).T) < 0.15), (x, y)


@pytest.mark.parametrize("v_mps", few([1.0, 0.3], 1))
def test_speed_bumps_are_crossed_without_false_obstacles(v_mps: float) -> None:
    """A bump 5 cm high, 40 cm long, under the robot from x = 1 m on: the body pitches by it."""
    bump = Profile(
        ((-FAR_M, 0.0), (1.0, 0.0), (1.15, 0.05), (1.25, 0.05), (1.4, 0.0), (FAR_M, 0.0))
    )
    rig = drive(World(bump), 3.0, v_mps)
    assert len(places_where(rig, OBSTACLE)) == 0


def test_a_ramp_in_view_is_free_ground_and_its_map_height_is_kept() -> None:
    rig = drive(World(ramp(9.5, math.radians(5))), 4.0)
    assert len(places_where(rig, OBSTACLE)) == 0
    grid = rig.maps.cells.grid
    i, j = grid.cell_of(11.1, 0.1)
    cell = rig.maps.cells.cells[j % grid.size, i % grid.size]
    assert cell["z_m"] == pytest.approx(1.6 * math.tan(math.radians(5)), abs=0.04)
