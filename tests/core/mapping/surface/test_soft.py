"""Grass and curtains: soft things are free if settings say so, hard things among them never."""

import itertools
import math

import numpy as np
import pytest

from core.mapping.causes import NO_FLOOR, SOFT, UNREACHED, UNSHOWN
from core.mapping.surface.cells import LOOSE, TIED
from core.mapping.surface.constants import CLEAR, HARD, LET_IN, LIKELY, PASS_THROUGH, STOPPED
from core.mapping.surface.decision import is_passable, rule_of
from core.mapping.surface.evidence import softness, vote
from core.mapping.surface.maps import SurfaceMaps
from core.records import FREE, OBSTACLE
from tests.support.cases import few
from tests.support.maps.flat_ride import Ride, Rig, cells_over, config_of
from tests.support.maps.flat_world import Box, Cylinder, Grass, World
from tests.support.maps.ground_cells import LIMITS, GroundCells, met

MEADOW = Grass(Box((9.0, -1.5, 0.0), (11.0, 1.5, 0.3)), 0.25, 0.7)


def drive(world: World, free_below_m: float) -> Rig:
    """A robot that has driven 4 m straight on."""
    config = config_of(
        map={"method": "surface"},
        scanner={"echo": "both"},
        obstacle={"soft_free_below_m": free_below_m},
    )
    return Rig(config, world, Ride(v_mps=0.7), 6.0).run()


def maps_of(rig: Rig) -> SurfaceMaps:
    maps = rig.mapper.maps
    assert isinstance(maps, SurfaceMaps)
    return maps


def soft_cells(rig: Rig) -> int:
    cells = maps_of(rig).cells
    return int(((cells["stands"] > 0.0) & (cells["soft"] >= LIKELY)).sum())


def test_grass_lower_than_the_settings_say_is_free_and_a_stone_in_it_is_not() -> None:
    stone = Box((9.8, -0.2, 0.0), (10.2, 0.2, 0.28))
    with_stone = drive(World(solids=(stone,), grass=(MEADOW,)), free_below_m=0.45)
    assert cells_over(with_stone, FREE, MEADOW.box) > 30
    assert cells_over(with_stone, FREE, stone) == 0
    assert cells_over(with_stone, OBSTACLE, stone) == 4


@pytest.mark.parametrize("free_below_m", [0.0, 0.15])
def test_grass_that_is_too_high_is_soft_and_an_obstacle(free_below_m: float) -> None:
    rig = drive(World(grass=(MEADOW,)), free_below_m)
    assert soft_cells(rig) > 50
    assert cells_over(rig, FREE, MEADOW.box) == 0
    assert cells_over(rig, OBSTACLE, MEADOW.box) > 100


@pytest.mark.parametrize(("x_m", "radius_m"), few([(9.5, 0.03), (9.1, 0.03), (10.1, 0.05)], 2))
def test_a_post_as_high_as_the_grass_around_it_is_never_free(x_m: float, radius_m: float) -> None:
    y_m = (-1.1, -0.7, -0.3, 0.1, 0.5, 0.9)
    posts = tuple(Cylinder(x_m, y, radius_m, 0.28) for y in y_m)
    config = config_of(
        map={"method": "surface"}, scanner={"echo": "both"}, obstacle={"soft_free_below_m": 0.45}
    )
    rig = Rig(config, World(solids=posts, grass=(MEADOW,)), Ride(v_mps=0.7), 6.0)
    grid = maps_of(rig).grid
    i, j = np.array([grid.cell_of(x_m, y) for y in y_m]).T
    for _ in rig.drive():
        assert SOFT not in maps_of(rig).causes(i, j)
    assert cells_over(rig, FREE, MEADOW.box) > 10


def test_what_lies_down_in_grass_that_was_soft_for_long_is_an_obstacle_at_once() -> None:
    down_s = 10.0
    body = Box((9.4, -0.4, 0.0), (9.8, 0.4, 0.28), from_s=down_s)
    config = config_of(
        map={"method": "surface"}, scanner={"echo": "both"}, obstacle={"soft_free_below_m": 0.45}
    )
    rig = Rig(config, World(solids=(body,), grass=(MEADOW,)), Ride(0.7, stop_s=3.0), 11.0)
    front, were_free = Box((9.4, -0.4, 0.0), (9.6, 0.4, 0.0)), 0
    for now_s in rig.drive():
        if now_s < down_s:
            were_free = cells_over(rig, FREE, front)
        elif now_s > down_s + 0.3:
            assert cells_over(rig, FREE, front) == 0
    assert were_free > 0


@pytest.mark.parametrize("free_below_m", few([0.45, 0.0], 1))
def test_edges_at_which_beams_split_are_not_soft(free_below_m: float) -> None:
    things = (
        Box((9.0, 0.5, 0.0), (9.4, 0.9, 0.4)),
        Box((9.5, -0.9, 0.0), (9.9, -0.3, 0.3), 0.5),
        Box((10.5, -4.0, 0.0), (10.7, 4.0, 2.0)),
        Cylinder(8.9, 0.0, 0.05, 0.4),
    )
    rig = drive(World(solids=things), free_below_m)
    assert soft_cells(rig) == 0
    for x, y in ((9.1, 0.7), (9.6, -0.6), (10.6, 2.0), (8.9, 0.0)):
        assert cells_over(rig, OBSTACLE, Box((x - 0.35, y - 0.35, 0), (x + 0.35, y + 0.35, 1))) > 0


# Beam by beam

FAR = math.nan
STALKS, EVEN = (5.0, 5.2, 4.9), (5.0, 5.0, 5.01)


@pytest.mark.parametrize(
    ("first_m", "behind_m", "vote"),
    [
        (STALKS, (8.0, 8.0, 8.0), LET_IN),
        (STALKS, (FAR, 8.0, FAR), LET_IN),
        (STALKS, (8.0, FAR, 8.0), STOPPED),
        (STALKS, (8.0, 5.4, 8.0), STOPPED),
        (EVEN, (8.0, 8.0, 8.0), STOPPED),
        ((5.0, 5.2, 8.0), (FAR, 8.0, FAR), STOPPED),
        (EVEN, (FAR, FAR, FAR), HARD),
        (STALKS, (5.22, FAR, FAR), HARD),
        ((5.0, 5.2, FAR), (5.22, FAR, FAR), HARD),
    ],
    ids=(
        "stalks",
        "one",
        "stops",
        "close",
        "level",
        "upright",
        "face",
        "behind one",
        "at the last",
    ),
)
def test_a_return_is_soft_if_others_lie_about_it_and_something_far_behind(
    first_m: tuple[float, ...], behind_m: tuple[float, ...], vote: float
) -> None:
    assert softness(np.array([first_m, behind_m]), 1, LIMITS) == vote
    assert softness(np.array([first_m[::-1], behind_m[::-1]]), 1, LIMITS) == vote


def test_where_the_sweep_ends_and_where_one_echo_is_told_nothing_is_soft() -> None:
    ranges_m = np.array([STALKS, (8.0, 8.0, 8.0)])
    at_ends = {softness(ranges_m, b, LIMITS) for b in (0, 2)}
    assert at_ends | {softness(ranges_m[:1], 1, LIMITS)} == {STOPPED}


# Cell by cell


def passable(ground: GroundCells, soft_m: float = 0.5) -> bool:
    limits = LIMITS._replace(soft_m=soft_m)
    return bool(is_passable(ground.at(1, 1), 1, 1, ground.surface._replace(limits=limits)))


GRASS = {"stands": LIKELY, "soft": LIKELY, "top_m": 0.25}


def test_what_is_soft_and_low_may_be_passed_if_nothing_hard_stands_beside_it() -> None:
    ground = GroundCells()
    at = ground.lay(1, 1, 0.0, **GRASS)
    for soft_m, is_low in ((0.5, True), (1.0, True), (0.25, True), (0.24, False), (0.0, False)):
        assert passable(ground, soft_m) is is_low
    for i, j in itertools.product(range(-1, 4), repeat=2):
        if (i, j) == (1, 1):
            continue
        ground.lay(i, j, 0.0, **GRASS)
        assert passable(ground)
        ground.lay(i, j, 0.0, **GRASS | {"stands": 0.1, "soft": LIKELY - 0.1})
        assert passable(ground) is (max(abs(i - 1), abs(j - 1)) > 1)
        ground.lay(i, j, 0.0)
    for name, value in (("soft", LIKELY - 0.1), ("stands", CLEAR)):
        ground.lay(1, 1, 0.0, **GRASS | {name: value})
        assert not passable(ground)
    ground.lay(1, 1, 0.0, **GRASS | {"top_m": 0.0})
    assert not passable(ground, 0.0)
    assert ground.cells["stands"][at] == LIKELY


def test_soft_things_are_free_where_floor_was_seen_among_them_and_can_be_reached() -> None:
    ground = GroundCells()
    cell = ground.cells[ground.lay(2, 2, 0.0, **GRASS, floor_parts=0xFFFF)]

    def cause() -> int:
        return int(rule_of(cell, OBSTACLE, 0.0, 0.0, LIMITS, True, LIMITS.row))

    assert cause() == SOFT
    cell["looks"] = 0
    assert cause() == UNSHOWN
    cell["looks"], cell["tied"] = 4, LOOSE
    assert cause() == UNREACHED
    cell["tied"], cell["under_m"] = TIED, -0.5
    assert cause() == NO_FLOOR


def test_a_hard_thing_has_the_soft_cells_around_it_decided_again() -> None:
    limits, around = LIMITS._replace(soft_m=0.4), []
    for bounds in (LIMITS, limits):
        ground = GroundCells()
        ground.lay(2, 0, 0.0)
        met(ground, 1.0, 0.5, 0.3, bounds)
        around.append(sorted(ground.touched.at[: ground.touched.used[0]].tolist()))
    assert around[0] == [ground.at(2, 0)]
    assert around[1] == sorted(ground.at(i, j) for i in (1, 2, 3) for j in (-1, 0, 1))


def test_what_has_gone_leaves_nothing_of_its_softness() -> None:
    ground = GroundCells()
    at = ground.lay(2, 0, 0.0, stands=CLEAR + 0.1, soft=-50.0, low_m=0.2, top_m=0.3)
    vote(at, PASS_THROUGH, ground.surface)
    assert ground.cells["soft"][at] == 0.0
