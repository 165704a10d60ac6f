"""Halls for a machine that cleans: the same for a seed, as large as told, with room to drive."""

import itertools
import math

import pytest

from fakes.scenes.halls import AREA_M2, GAP_M, START_M, hall_of
from fakes.scenes.scatter import apart_m, away_m

SEEDS = range(40)


def test_a_seed_gives_the_same_hall_and_another_seed_another() -> None:
    assert hall_of(7) == hall_of(7)
    assert len({hall_of(seed).scene.solids for seed in SEEDS}) == len(SEEDS)
    with pytest.raises(ValueError, match="seed: must be 0 or more, is -1"):
        hall_of(-1)


@pytest.mark.slow
def test_halls_are_of_all_sizes_and_have_things_of_each_kind_with_room_between() -> None:
    areas, kinds, parted = [], set(), 0
    for seed in SEEDS:
        hall = hall_of(seed)
        areas.append(math.prod(high - low for low, high in hall.inside))
        assert len(hall.things) >= areas[-1] / 40
        spans = [thing.spans for thing in hall.things]
        assert min(away_m((0.0, 0.0), own) for own in spans) >= START_M
        assert min(apart_m(a, b) for a, b in itertools.combinations(spans, 2)) >= GAP_M
        kinds |= {thing.shapes[0].name.split()[0] for thing in hall.things}
        parted += len(hall.walls) == 6
    assert min(areas) >= AREA_M2[0]
    assert max(areas) <= AREA_M2[1]
    assert max(areas) - min(areas) > 350.0
    assert kinds == {"rack", "pallet", "chair", "box", "pillar", "cupboard"}
    assert parted >= 5


@pytest.mark.slow
def test_odd_seeds_have_people_and_a_box_that_is_carried_elsewhere() -> None:
    for seed in SEEDS:
        hall = hall_of(seed)
        assert bool(hall.scene.walkers) == bool(hall.moved) == (seed % 2 == 1)
        if hall.moved:
            before, after = hall.moved
            assert before.until_s < after.from_s
            assert math.dist(before.waypoints[0], after.waypoints[0]) > GAP_M
