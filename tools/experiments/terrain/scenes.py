"""What is looked at: two boxes of known size; single things; rocks. Floor lies at z = 0."""

import math

import numpy as np

from fakes.scenes.scene import Scene
from fakes.scenes.solids import Pillar, Shape, Solid

FLOOR = Solid("floor", (-9.0, 9.0), (-9.0, 9.0), (-1.0, 0.0))
SIZES_M = {"a": 0.103, "b": 0.115, "c": 0.154, "d": 0.078}  # the paper's
BOX_LONG_M = 0.120  # of both boxes, along the rail
BOX_AT_M = ((0.80, 0.12), (0.80, -0.12))  # their middles, before they are moved by chance
MOVED_M = 0.010
THINGS = ("box", "cylinder", "post")
ROCKS, ROCKY_M = 60, 2.0
ROCK_LONG_M, ROCK_HIGH_M, ROCK_RISE_DEG = (0.10, 0.35), (0.03, 0.15), 12.0


def _moved(seed: int, at_m: tuple[float, float], number: int) -> tuple[float, float]:
    dx, dy = np.random.default_rng([seed, number]).uniform(-MOVED_M, MOVED_M, 2).tolist()
    return at_m[0] + dx, at_m[1] + dy


def box(name: str, middle_m: tuple[float, float], size_m: tuple[float, float, float]) -> Solid:
    """A box that stands on the floor; its size is along x, along y, and upwards."""
    (x, y), (long_m, wide_m, high_m) = middle_m, size_m
    along, across = (x - long_m / 2, x + long_m / 2), (y - wide_m / 2, y + wide_m / 2)
    return Solid(name, along, across, (0.0, high_m))


def two_boxes(seed: int) -> tuple[Solid, Solid]:
    """One of the width a and the height c, one of b and d: each somewhere within a cell or two."""
    sizes = ((SIZES_M["a"], SIZES_M["c"]), (SIZES_M["b"], SIZES_M["d"]))
    one, other = (
        box(f"box {k}", _moved(seed, BOX_AT_M[k], k), (BOX_LONG_M, wide_m, high_m))
        for k, (wide_m, high_m) in enumerate(sizes)
    )
    return one, other


def thing(name: str, seed: int) -> Shape:
    """ValueError: nothing is called so."""
    at_m = _moved(seed, (0.80, 0.0), 5)
    if name == "box":
        return box(name, at_m, (0.2, 0.2, 0.15))
    if name not in THINGS:
        raise ValueError(f"thing: must be one of {', '.join(THINGS)}, is {name!r}")
    return Pillar(name, at_m, 0.06 if name == "cylinder" else 0.005, (0.0, 0.15))


def rocks(seed: int) -> list[Shape]:
    """Slanting blocks, over each other, on 2 x 2 m from x = 0 on."""
    random = np.random.default_rng([seed, 11])
    made: list[Shape] = []
    for k in range(ROCKS):
        long_m, wide_m = random.uniform(*ROCK_LONG_M, 2).tolist()
        x, y = random.uniform(0.0, ROCKY_M - long_m), random.uniform(-1.0, 1.0 - wide_m)
        rises = np.radians(random.uniform(-ROCK_RISE_DEG, ROCK_RISE_DEG, 2)).tolist()
        falls_m = sum(
            max(0.0, -math.tan(rise) * way)
            for rise, way in zip(rises, (wide_m, long_m), strict=True)
        )
        top_m = falls_m + random.uniform(*ROCK_HIGH_M) * 0.5
        made.append(
            Solid(f"rock {k}", (x, x + long_m), (y, y + wide_m), (-0.5, top_m), rises[0], rises[1])
        )
    return made


def scene(name: str, *things: Shape) -> Scene:
    return Scene(name, (FLOOR, *things))
