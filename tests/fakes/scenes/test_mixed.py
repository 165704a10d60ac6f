"""Scenes out of things of all scenes: of a seed, reachable, and of many kinds."""

import pytest

from fakes.scenes.mixed import MIXED, elements, mixed_table
from fakes.scenes.scatter import check_scatter
from fakes.scenes.scene import campaign_scenes, load_scene, problems
from tests.support.cases import few


@pytest.mark.slow
@pytest.mark.parametrize("seed", few(range(1, 5), 2))
def test_goals_of_a_mixed_scene_can_be_reached_and_a_seed_is_one_scene(seed: int) -> None:
    scene = load_scene(MIXED, seed)
    assert scene.goals
    assert problems(scene) == []
    assert scene == load_scene(MIXED, seed)
    assert scene.solids != load_scene(MIXED, seed + 1).solids


def test_its_things_are_those_of_the_campaigns_scenes() -> None:
    kinds = {entry["kind"] for entry in elements()}
    assert {"rack", "walker", "puddle", "ditch", "pane", "grass", "truck", "chair"} <= kinds
    for entry in elements():
        check_scatter(entry)
        assert not entry.keys() & {"x", "y"}
    assert MIXED not in campaign_scenes()


def test_seeds_choose_things_of_many_scenes_some_with_people() -> None:
    tables = [mixed_table(seed, 0) for seed in range(40)]
    chosen = {entry["kind"] for table in tables for entry in table["scatter"]}
    assert chosen == {entry["kind"] for entry in elements()}
    peopled = sum(any(entry["kind"] == "walker" for entry in table["scatter"]) for table in tables)
    assert 8 < peopled < 32
    assert 4 < sum("upsets" in table for table in tables) < 36
    assert tables[0] != mixed_table(0, 1)
