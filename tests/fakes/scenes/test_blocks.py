"""What fills a place between two heights: the truth."""

import numpy as np
import pytest

from fakes.scenes.scene import Scene, Solid, load_scene
from fakes.scenes.solids import GLASS, Pillar, soft
from tests.support.robot.flat_floor import FLOOR


def blocks(*things: Solid | Pillar, low: float = 0.15, high: float = 1.30) -> bool:
    """Whether something of a robot's height meets these at 5, 0."""
    scene = Scene("some", (FLOOR, *things))
    return bool(scene.blocks([5.0], [0.0], low, high)[0])


def thing(z: tuple[float, float], **more: object) -> Solid:
    return Solid("thing", (4.5, 5.5), (-0.5, 0.5), z, **more)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("z", "bars"),
    [
        ((0.0, 0.14), False),
        ((0.0, 0.15), False),  # touches
        ((0.0, 0.16), True),
        ((0.70, 0.72), True),  # a table top
        ((1.29, 1.50), True),
        ((1.30, 1.50), False),
        ((1.40, 2.50), False),
        ((-1.0, 3.0), True),
    ],
)
def test_what_reaches_between_two_heights_blocks(z: tuple[float, float], bars: bool) -> None:
    assert blocks(thing(z)) is bars


def test_glass_blocks_and_a_post_where_it_is_and_the_floor_and_grass_do_not() -> None:
    assert not blocks()
    assert blocks(thing((0.0, 1.0), material=GLASS))
    assert not blocks(thing((0.0, 1.0), material=soft(3.0)))
    assert blocks(low=-0.5)  # the floor itself, asked for
    post = Scene("some", (FLOOR, Pillar("post", (5.0, 0.0), 0.5, (0.0, 2.0))))
    found = post.blocks([5.49, 5.4, 5.51, 5.49], np.zeros(4), np.array([0.1, 0.1, 0.1, 2.1]), 3.0)
    np.testing.assert_array_equal(found, [True, True, False, False])
    assert post.blocks(np.zeros(0), np.zeros(0), 0.0, 1.0).shape == (0,)


def test_asking_few_points_finds_what_asking_all_finds() -> None:
    """Solids are left out by their bounds; that changes nothing."""
    scene = load_scene("yard")
    random = np.random.default_rng(2)
    x, y = random.uniform([-10, -10], [35, 10], (80, 2)).T
    slow = np.zeros(80, dtype=bool)
    tops = np.full(80, -np.inf)
    for solid in scene.solids:
        tops = np.maximum(tops, solid.tops_m(x, y))
        if solid.material.kind != "soft":
            slow |= (solid.tops_m(x, y) > 0.15) & (solid.bottom_m < 1.3)
    one_by_one = [bool(scene.blocks([a], [b], 0.15, 1.3)[0]) for a, b in zip(x, y, strict=True)]
    np.testing.assert_array_equal(scene.blocks(x, y, 0.15, 1.3), slow)
    np.testing.assert_array_equal(one_by_one, slow)
    np.testing.assert_array_equal(scene.height_at(x, y), np.where(np.isinf(tops), np.nan, tops))
