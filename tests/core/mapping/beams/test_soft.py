"""Grass and curtains: things that beams go into are marked soft, and free only if settings say."""

import math

import numpy as np
import pytest

from core.mapping.beams.classifier import SOFT_LEAST, is_soft
from core.mapping.rays import Sweep
from core.records import FREE, OBSTACLE
from tests.support.cases import few
from tests.support.cell_rig import CellRig, floor_around, sweep_to
from tests.support.flat_ride import Ride, Rig, cells_over, config_of
from tests.support.flat_world import Box, Cylinder, Grass, World

MEADOW = Grass(Box((9.0, -1.5, 0.0), (11.0, 1.5, 0.3)), 0.25, 0.7)


def drive(world: World, free_below_m: float) -> Rig:
    """A robot that has driven 4 m straight on."""
    config = config_of(scanner={"echo": "both"}, obstacle={"soft_free_below_m": free_below_m})
    return Rig(config, world, Ride(v_mps=0.7), 6.0).run()


def soft_cells(rig: Rig) -> int:
    cells = rig.maps.cells.flat
    return sum(bool(is_soft(cells, int(at))) for at in np.flatnonzero(cells["above"] > 0))


def test_soft_grass_lower_than_the_settings_say_is_free_and_a_stone_in_it_is_not() -> None:
    stone = Box((9.8, -0.2, 0.0), (10.2, 0.2, 0.28))
    low = drive(World(solids=(stone,), grass=(MEADOW,)), free_below_m=0.45)
    high = drive(World(grass=(MEADOW,)), free_below_m=0.15)
    assert soft_cells(high) > 20
    assert cells_over(high, OBSTACLE, MEADOW.box) > 30
    assert cells_over(low, OBSTACLE, MEADOW.box) < 0.6 * cells_over(high, OBSTACLE, MEADOW.box)
    assert cells_over(low, OBSTACLE, Box((9.6, -0.4, 0), (10.4, 0.4, 1))) > 0


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
        assert cells_over(rig, OBSTACLE, Box((x - 0.35, y - 0.35, 0), (x + 0.35, y + 0.35, 1))) > 0


# Cell by cell


def stalks(rig: CellRig, doubles: int, singles: int, apart_m: float = 0.5) -> None:
    """Returns in the cell at (2.1, 0.1), of which some echo again from behind."""
    one = sweep_to([(2.1, 0.1, 0.3)] * (doubles + singles), t_s=rig.t_s)
    second = np.where(np.arange(doubles + singles) < doubles, one.ranges_m[0] + apart_m, math.nan)
    rig.take(Sweep(rig.t_s, one.origins, one.rays, np.stack([one.ranges_m[0], second])))


def soft_rig(free_below_m: float) -> CellRig:
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


@pytest.mark.parametrize(("doubles", "apart_m"), [(20, 0.05), (1, 0.5)])
def test_echoes_close_together_and_a_lone_double_echo_are_hard(
    doubles: int, apart_m: float
) -> None:
    rig = CellRig()
    stalks(rig, doubles, 20, apart_m)
    assert rig.cell(2.1, 0.1)["soft"] == 0
    assert rig.cell(2.1, 0.1)["hard"] >= 20


def test_a_soft_cell_beside_something_hard_is_no_free_ground() -> None:
    rig = soft_rig(0.4)
    for _ in range(2):
        stalks(rig, SOFT_LEAST + 2, 0)
    assert rig.state(2.1, 0.1) == FREE
    for _ in range(2):
        rig.add((2.1, 0.3, 0.5))
        stalks(rig, SOFT_LEAST + 2, 0)
    assert rig.state(2.1, 0.1) == OBSTACLE
