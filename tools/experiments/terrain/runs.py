"""All runs of the experiments, over their seeds, as many at once as cores."""

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from itertools import repeat
from multiprocessing import get_context
from typing import Any

from core.records import F64
from tools.experiments.terrain.feet import Walked
from tools.experiments.terrain.methods import NAMES
from tools.experiments.terrain.scenes import THINGS
from tools.experiments.terrain.trials import (
    BY_STRIPE,
    GAITS,
    STEEP,
    STRIPE,
    OnRocks,
    Seen,
    Walk,
    boxes_walked,
    rocks_mapped,
    sizes_off,
    thing_seen,
)


@dataclass(frozen=True, slots=True)
class Seeds:
    """How many of each experiment: seeds 1 and so on."""

    sizes: int
    things: int
    rocks: int


FULL, QUICK = Seeds(50, 50, 20), Seeds(2, 2, 1)


@dataclass(slots=True)
class Results:
    """Of each experiment a list, one entry a seed, by method."""

    seeds: Seeds
    by_urg: list[dict[str, F64]] = field(default_factory=list)
    by_stripe: list[dict[str, F64]] = field(default_factory=list)
    things: dict[str, list[dict[str, Seen]]] = field(default_factory=dict)
    rocks: dict[Walk, list[dict[str, OnRocks]]] = field(default_factory=dict)
    boxes: dict[Walk, list[dict[str, Walked]]] = field(default_factory=dict)


def run_all(seeds: Seeds, jobs: int = 0) -> Results:
    """jobs: processes; 0: one a core."""
    found = Results(seeds)
    with ProcessPoolExecutor(jobs or os.cpu_count() or 1, get_context("spawn")) as pool:

        def each(what: str, run: Callable[..., Any], count: int, *given: Any) -> Iterator[Any]:
            print(f"mapod: {what}, {count} seeds", flush=True)
            return pool.map(run, *given)

        ones = range(1, seeds.sizes + 1)
        by_urg = (sizes_off, seeds.sizes, ones, repeat(STEEP), repeat(NAMES))
        found.by_urg = list(each("two boxes, URG-04LX", *by_urg))
        by_stripe = (sizes_off, seeds.sizes, ones, repeat(STRIPE), repeat(BY_STRIPE))
        found.by_stripe = list(each("two boxes, stripe", *by_stripe))
        for thing in THINGS:
            ones = range(1, seeds.things + 1)
            found.things[thing] = list(each(thing, thing_seen, seeds.things, repeat(thing), ones))
        for walk in GAITS:
            ones = range(1, seeds.rocks + 1)
            found.rocks[walk] = list(
                each(f"rocks, {walk}", rocks_mapped, seeds.rocks, ones, repeat(walk))
            )
            found.boxes[walk] = list(
                each(f"feet among boxes, {walk}", boxes_walked, seeds.rocks, ones, repeat(walk))
            )
    return found
