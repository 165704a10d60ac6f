"""Grass and curtains: things that beams go into are marked soft, and free only if settings say."""

import math

import numpy as np
import pytest

from core.mapping.beams.classifier import SOFT_LEAST, is_soft
from core.mapping.rays import Sweep
from core.records import FREE, OBSTACLE
from tests.support.cases import few
from tests.support.cell_rig import CellRig, floor_around, sweep_to
from tests.support.flat_ride import Ride, Rig, config_of, places_where
from tests.support.flat_world import Box, Cylinder, Grass, World

MEADOW = Grass(Box((9.0, -1.5, 0.0), (11.0, 1.5, 0.3)), 0.25, 0.7)
BOTH = {"echo": "both"}


def drive(world: World, echo: str = "both", free_below_m: float = 0.0, metres: float = 5.0) -> Rig:
    """A robot that has driven straight on at half a metre per second."""
    config = config_of(scanner={"echo": echo}, obstacle={"soft_free_below_m": free_below_m})
    return Rig(config, world, Ride(v_mps=0.5), metres / 0.5).run()


def soft_cells(rig: Rig) -> int:
    """How many cells of the elevation map are soft."""
    cells = rig.maps.cells.flat
    return sum(bool(is_soft(cells, int(at))) for at in np.flatnonzero(cells["above"] > 0))


def obstacles_in(rig: Rig, box: Box) -> int:
    """Obstacle cells whose middle lies over a box."""
    found = places_where(rig, OBSTACLE)
    inside = [(found[:, k] >= box.low[k]) & (found[:, k] <= box.high[k]) for k in (0, 1)]
    return int(np.sum(inside[0] & inside[1]))


def test_grass_is_an_obstacle_as_shipped_and_marked_soft() -> None:
    rig = drive(World(grass=(MEADOW,)))
    assert obstacles_in(rig, MEADOW.box) > 30
    assert soft_cells(rig) > 20


def test_grass_lower_than_the_settings_say_is_free_and_higher_grass_is_not() -> None:
    low = drive(World(grass=(MEADOW,)), free_below_m=0.45)
    high = drive(World(grass=(MEADOW,)), free_below_m=0.15)
    assert obstacles_in(high, MEADOW.box) > 30
    assert obstacles_in(low, MEADOW.box) < 0.4 * obstacles_in(high, MEADOW.box)


def test_a_stone_in_the_grass_is_an_obstacle_whatever_the_settings_say() -> None:
    stone = Box((9.8, -0.2, 0.0), (10.2, 0.2, 0.28))
    rig = drive(World(solids=(stone,), grass=(MEADOW,)), free_below_m=0.45)
    assert obstacles_in(rig, Box((9.6, -0.4, 0), (10.4, 0.4, 1))) > 0


@pytest.mark.parametrize("free_below_m", few([0.45, 0.0], 1))
def test_edges_at_which_beams_split_are_not_soft(free_below_m: float) -> None:
    things = (
        Box((9.0, 0.5, 0.0), (9.4, 0.9, 0.4)),
        Box((9.5, -0.9, 0.0), (9.9, -0.3, 0.3), 0.5),
        Box((10.5, -4.0, 0.0), (10.7, 4.0, 2.0)),
        Cylinder(8.9, 0.0, 0.05, 0.4),
    )
    rig = drive(World(solids=things), free_below_m=free_below_m)
    assert soft_cells(rig) == 0
    for x, y in ((9.1, 0.7), (9.6, -0.6), (10.6, 2.0), (8.9, 0.0)):
        assert obstacles_in(rig, Box((x - 0.35, y - 0.35, 0), (x + 0.35, y + 0.35, 1))) > 0


def test_a_scanner_that_tells_one_echo_never_makes_anything_free_that_stands() -> None:
    rig = drive(World(grass=(MEADOW,)), echo="first")
    assert obstacles_in(rig, MEADOW.box) > 30
    assert soft_cells(rig) == 0


# Cell by cell


def stalks(rig: CellRig, doubles: int, singles: int, top_m: float = 0.3) -> None:
    """Returns in the cell at (2.1, 0.1), of which some echo again from the floor behind."""
    one = sweep_to([(2.1, 0.1, top_m)] * (doubles + singles), t_s=rig.t_s)
    second = np.where(np.arange(doubles + singles) < doubles, one.ranges_m[0] + 0.5, math.nan)
    rig.take(Sweep(rig.t_s, one.origins, one.rays, np.stack([one.ranges_m[0], second])))


def soft_rig(free_below_m: float) -> CellRig:
    """A cell with floor all around and in it."""
    rig = CellRig(soft_free_below_m=free_below_m)
    for _ in range(30):
        rig.add((2.1, 0.1, 0.0), *floor_around(2.1, 0.1))
    return rig


@pytest.mark.parametrize(
    ("doubles", "singles", "free_below_m", "state"),
    [
        (SOFT_LEAST + 2, 0, 0.4, FREE),
        (SOFT_LEAST + 2, 0, 0.0, OBSTACLE),
        (SOFT_LEAST + 2, 0, 0.25, OBSTACLE),
        (SOFT_LEAST // 2 - 1, 0, 0.4, OBSTACLE),
        (SOFT_LEAST + 2, 4 * SOFT_LEAST, 0.4, OBSTACLE),
        (0, 4 * SOFT_LEAST, 0.4, OBSTACLE),
    ],
    ids=["soft", "off", "too high", "too few", "mostly hard", "all hard"],
)
def test_a_soft_cell_is_free_only_below_the_height_of_the_settings(
    doubles: int, singles: int, free_below_m: float, state: int
) -> None:
    rig = soft_rig(free_below_m)
    for _ in range(2):
        stalks(rig, doubles, singles)
    assert rig.state(2.1, 0.1) == state


def test_two_echoes_close_together_are_one_thing() -> None:
    rig = CellRig()
    one = sweep_to([(2.1, 0.1, 0.3)] * 20)
    rig.take(Sweep(0.0, one.origins, one.rays, np.stack([one.ranges_m[0], one.ranges_m[0] + 0.05])))
    assert rig.cell(2.1, 0.1)["soft"] == 0


def test_a_soft_cell_beside_something_hard_is_no_free_ground() -> None:
    rig = soft_rig(0.4)
    for _ in range(2):
        stalks(rig, SOFT_LEAST + 2, 0)
    assert rig.state(2.1, 0.1) == FREE
    for _ in range(2):
        rig.add((2.1, 0.3, 0.5))
        stalks(rig, SOFT_LEAST + 2, 0)
    assert rig.state(2.1, 0.1) == OBSTACLE


def test_a_lone_double_echo_on_a_plain_surface_is_hard() -> None:
    rig = CellRig()
    one = sweep_to([(2.1, 0.1, 0.3)] * 5)
    second = np.where(np.arange(5) == 2, one.ranges_m[0] + 0.5, math.nan)
    rig.take(Sweep(0.0, one.origins, one.rays, np.stack([one.ranges_m[0], second])))
    assert (int(rig.cell(2.1, 0.1)["soft"]), int(rig.cell(2.1, 0.1)["hard"])) == (0, 5)
