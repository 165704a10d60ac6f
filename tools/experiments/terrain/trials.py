"""The experiments, seed by seed: two boxes, single things, rocks; and feet on rocks and boxes."""

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np

from core.mapping.method import Maps
from core.mapping.shadows import ShadowFilter
from core.records import F64
from fakes.scenes.scene import Scene
from hw.stripe.options import StripeOptions
from tools.experiments.terrain import scenes
from tools.experiments.terrain.feet import Walked, walked
from tools.experiments.terrain.measure import Figures, figures, truth_of, width_and_height_m
from tools.experiments.terrain.methods import (
    NAMES,
    SHADED,
    Region,
    heights_m,
    maps_of,
    settings_of,
)
from tools.experiments.terrain.ride import STEADY, STEP_M, WALKING, Gait, Ride, Sensor
from tools.experiments.terrain.sensors import Stripe
from tools.experiments.terrain.urg import Mount, Urg

STEEP, FLAT = Mount(0.35, 55.0), Mount(0.50, 35.0)  # c and b of docs/terrain.md
STRIPE = Mount(0.40, 40.0, is_stripe=True)  # as in robots/ragno.toml
BY_STRIPE = (  # the reference plane takes beams of one lens alone
    *(f"certainty, {steps}" for steps in ("none", "all", "all, filled")),
    "surface",
)
BOXES = Region((0.60, 1.00), (-0.40, 0.40), 0.005)
SINGLE = Region((0.60, 1.00), (-0.40, 0.40), 0.010)
ROCKY = Region((0.0, scenes.ROCKY_M), (-scenes.ROCKY_M / 2, scenes.ROCKY_M / 2), 0.010)
AMONG_BOXES = Region((0.40, 1.20), (-0.50, 0.50), 0.010)
FILLED = "certainty, all, filled"
BY_FEET = {FILLED: "certainty, all", "surface": "surface", SHADED: SHADED}  # and what is measured
LEAD_M = 0.15  # the ride begins and ends so far before and behind a region
NEAR_CELLS = 2  # so near to a thing, it is in the map
Walk = Literal["steady", "walking"]
GAITS: dict[Walk, Gait] = {"steady": STEADY, "walking": WALKING}


class Seen(NamedTuple):
    """A thing in a map: the figures of its region, and whether half its height is told at it."""

    figures: Figures
    is_there: bool


class OnRocks(NamedTuple):
    """A map of rocks: the figures of its region, and what feet get of it, of some methods."""

    figures: Figures
    walked: Walked | None


def ridden(
    scene: Scene, mount: Mount, region: Region, gait: Gait, seed: int, names: Sequence[str]
) -> dict[str, Maps]:
    """Maps after one ride over a region, by method: all get the same scans."""
    configs = {name: settings_of(name, mount, gait, region.cell_m) for name in names}
    options = next(iter(configs.values())).scanner.options
    sensor: Sensor = Urg(scene, mount, seed)
    if isinstance(options, StripeOptions):
        sensor = Stripe(scene, mount, options, seed)
    ahead_m = mount.height_m / math.tan(math.radians(mount.tilt_deg))
    begin_m, end_m = (x - ahead_m + STEP_M * _chance(seed) for x in region.x_m)
    ride = Ride(sensor, (begin_m - LEAD_M, end_m + LEAD_M), gait, seed)
    maps = {name: (maps_of(config), ShadowFilter(config)) for name, config in configs.items()}
    for scan in ride.scans():
        for one, shadows in maps.values():
            one.add(shadows.cleaned(scan), ride.attitudes, ride.track)
    return {name: one for name, (one, _) in maps.items()}


def mapped_m(
    scene: Scene, mount: Mount, region: Region, gait: Gait, seed: int, names: Sequence[str]
) -> dict[str, F64]:
    """Heights [j, i] of the region in those maps."""
    maps = ridden(scene, mount, region, gait, seed, names)
    return {name: heights_m(one, region) for name, one in maps.items()}


def _chance(seed: int) -> float:
    """Where in a cell the lines of a ride's scans lie: none is on the edges of cells for always."""
    return float(np.random.default_rng([seed, 3]).random())


def sizes_off(seed: int, mount: Mount, names: Sequence[str]) -> dict[str, F64]:
    """Relative errors (4,) of the sizes a to d by method, signed; NaN: it can't be told."""
    boxes = scenes.two_boxes(seed)
    scene = scenes.scene("two boxes", *boxes)
    true_m = np.array([scenes.SIZES_M[name] for name in "abcd"])
    off = {}
    for name, told in mapped_m(scene, mount, BOXES, STEADY, seed, names).items():
        (a, c), (b, d) = (width_and_height_m(told, BOXES, box) for box in boxes)
        off[name] = np.array([a, b, c, d]) / true_m - 1.0
    return off


def thing_seen(thing: str, seed: int, names: Sequence[str] = NAMES) -> dict[str, Seen]:
    """One thing alone on the floor, by method."""
    scene = scenes.scene(thing, scenes.thing(thing, seed))
    truth = truth_of(scene, SINGLE)
    stands = truth.high_m > 0.0
    about = stands.copy()
    for axis in (0, 1):
        for cells in range(1, NEAR_CELLS + 1):
            about |= np.roll(stands, cells, axis) | np.roll(stands, -cells, axis)
    half_m = truth.high_m.max() / 2
    return {
        name: Seen(figures(told, truth), bool((told[about] >= half_m).any()))
        for name, told in mapped_m(scene, STEEP, SINGLE, STEADY, seed, names).items()
    }


def _walked(maps: dict[str, Maps], scene: Scene, region: Region, seed: int) -> dict[str, Walked]:
    """What feet get, by those of `BY_FEET` that are there."""
    return {
        name: walked(maps[name], heights_m(maps[by], region), scene, region, seed)
        for name, by in BY_FEET.items()
        if name in maps and by in maps
    }


def rocks_mapped(seed: int, walk: Walk, names: Sequence[str] = NAMES) -> dict[str, OnRocks]:
    """Rocks on 2 x 2 m, by method."""
    scene = scenes.scene("rocks", *scenes.rocks(seed))
    truth = truth_of(scene, ROCKY)
    maps = ridden(scene, FLAT, ROCKY, GAITS[walk], seed, names)
    feet = _walked(maps, scene, ROCKY, seed)
    return {
        name: OnRocks(figures(heights_m(one, ROCKY), truth), feet.get(name))
        for name, one in maps.items()
    }


def boxes_walked(seed: int, walk: Walk) -> dict[str, Walked]:
    """The two boxes on 0.8 x 1 m of floor, by the methods that feet are told of."""
    scene = scenes.scene("two boxes", *scenes.two_boxes(seed))
    names = list(dict.fromkeys([*BY_FEET, *BY_FEET.values()]))
    maps = ridden(scene, STEEP, AMONG_BOXES, GAITS[walk], seed, names)
    return _walked(maps, scene, AMONG_BOXES, seed)
