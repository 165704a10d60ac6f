"""What a scene's file scatters: things at random places of an area, and people who walk there.

A [[scatter]] says which `kind` of thing (see things.py, or "walker"), how many (`count`), where
their middles may lie (`x`, `y`), and how far they keep from the start (`keep_m`), from each other
(`gap_m`) and from goals (`goal_m`); the kind's own sizes are [from, to]. Metres.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

from fakes.scenes.solids import Shape, Solid, Span, span_from
from fakes.scenes.things import KINDS, ROLLED_OVER, Frame, Random, Thing, lifted
from fakes.world.crowd import Walker

Point = tuple[float, float]
Rect = tuple[Span, Span]  # x, y

TRIES = 60  # of places for one thing
UNEVEN_M = 0.08  # ground that nothing is put on
COMMON = {"kind", "name", "count", "x", "y", "keep_m", "gap_m", "goal_m", "turned"}
WALKER_KEYS = COMMON - {"turned", "gap_m", "goal_m"} | {
    "speed_mps", "pause_s", "aside_m", "long_m", "points",
}  # fmt: skip
KEEP_M, GAP_M, GOAL_M = 9.5, 1.7, 1.6  # where an entry says nothing


@dataclass(slots=True)
class Lot:
    """What a scene has so far, while things are put into it."""

    fixed: list[Shape]
    goals: list[Point] = field(default_factory=list)
    areas: list[Rect] = field(default_factory=list)  # for entries that name none
    things: list[Thing] = field(default_factory=list)
    walkers: list[Walker] = field(default_factory=list)

    def standing(self) -> list[Rect]:
        """x and y of all that stands on the ground of the file."""
        return [(shape.x, shape.y) for shape in self.fixed if not is_ground(shape)]


def is_ground(shape: Shape) -> bool:
    """Whether it is a floor rather than something on one: it reaches deep, and is not high."""
    middle = np.array([sum(shape.x) / 2]), np.array([sum(shape.y) / 2])
    return shape.bottom_m <= -0.4 and float(shape.tops_m(*middle)[0]) < 1.0


def check_scatter(entry: dict[str, Any]) -> None:
    """Whether an entry names a kind, and only keys of that kind.

    Raises:
        ValueError: it does not.
    """
    kind = entry.get("kind")
    if kind != "walker" and kind not in KINDS:
        raise ValueError(f"scatter: no kind {kind!r}; there are {', '.join(KINDS)}, walker")
    known = WALKER_KEYS if kind == "walker" else COMMON | KINDS[kind][1].keys()
    if unknown := sorted(entry.keys() - known):
        raise ValueError(f"scatter, {kind}: no key {unknown[0]!r}")


def put(lot: Lot, entry: dict[str, Any], random: Random) -> bool:
    """Put as many of a [[scatter]] as chance wants; False where there is no place for them."""
    least, most = entry.get("count", [1, 1])
    for k in range(int(random.integers(least, most + 1))):
        name = f"{entry.get('name', entry['kind'])} {k + 1}"
        found = (
            _put_walker(lot, entry, name, random)
            if entry["kind"] == "walker"
            else _put_thing(lot, entry, name, random)
        )
        if not found and k < least:
            return False
    return True


def _area(lot: Lot, entry: dict[str, Any], random: Random) -> Rect:
    if "x" in entry:
        return span_from(entry["x"]), span_from(entry["y"])
    return lot.areas[int(random.integers(len(lot.areas)))]


def _put_thing(lot: Lot, entry: dict[str, Any], name: str, random: Random) -> bool:
    maker, sizes = KINDS[entry["kind"]]
    given = {key: entry[key] for key in sizes if key in entry}
    sizes = sizes | {key: (float(low), float(high)) for key, (low, high) in given.items()}
    for _ in range(TRIES):
        x, y = (float(random.uniform(*span)) for span in _area(lot, entry, random))
        turned = bool(entry.get("turned", random.random() < 0.5))
        thing = maker(Frame(name, x, y, turned, sizes, random))
        placed = _maybe_placed(lot, thing)
        if placed is None or not _has_room(lot, placed, entry):
            continue
        if placed.hole is not None and not cut(lot.fixed, *placed.hole):
            continue
        lot.things.append(placed)
        return True
    return False


def _maybe_placed(lot: Lot, thing: Thing) -> Thing | None:
    """A thing lifted onto the ground at its place; None where that is no even ground."""
    (x0, x1), (y0, y1) = thing.spans
    heights = ground_m(lot.fixed, [(x0, y0), (x0, y1), (x1, y0), (x1, y1)])
    low, high = min(heights), max(heights)
    if not high - low <= UNEVEN_M or (thing.hole and high - low > 1e-6):
        return None
    if not thing.shapes:
        return thing
    shapes = tuple(lifted(shape, low, high) for shape in thing.shapes)
    return Thing(shapes, thing.steels, thing.patches)


def _has_room(lot: Lot, thing: Thing, entry: dict[str, Any]) -> bool:
    own, gap_m = thing.spans, float(entry.get("gap_m", GAP_M))
    if away_m((0.0, 0.0), own) < float(entry.get("keep_m", KEEP_M)):
        return False
    if entry["kind"] in ROLLED_OVER:
        return all(apart_m(own, rect) > 0.0 for rect in lot.standing())
    goal_m = float(entry.get("goal_m", GOAL_M))
    if any(away_m(goal, own) < goal_m for goal in lot.goals):
        return False
    if any(apart_m(own, rect) <= 0.0 for rect in lot.standing()):
        return False
    return all(apart_m(own, other.spans) >= gap_m for other in lot.things)


def _put_walker(lot: Lot, entry: dict[str, Any], name: str, random: Random) -> bool:
    """Somebody whose way, with what he may step aside, is free of things."""
    aside_m, radius_m = float(entry.get("aside_m", 1.2)), 0.22
    bars = lot.standing() + [thing.spans for thing in lot.things if thing.shapes or thing.hole]
    for _ in range(TRIES):
        area = _area(lot, entry, random)
        points: list[Point] = []
        for _ in range(int(entry.get("points", 2))):
            x, y = (float(random.uniform(*span)) for span in area)
            points.append((x, y))
        legs = list(pairwise(points))
        if min(math.dist(*leg) for leg in legs) < float(entry.get("long_m", 4.0)):
            continue
        if math.hypot(*points[0]) < float(entry.get("keep_m", 2.5)):
            continue
        way = [_between(leg, k / 40) for leg in legs for k in range(41)]
        if any(away_m(place, rect) < aside_m + radius_m + 0.1 for rect in bars for place in way):
            continue
        heights = ground_m(lot.fixed, way)
        if not max(heights) - min(heights) <= UNEVEN_M:
            continue
        speed, pause = (
            float(random.uniform(*entry.get(key, otherwise)))
            for key, otherwise in (("speed_mps", (0.8, 1.5)), ("pause_s", (1.0, 6.0)))
        )
        lot.walkers.append(Walker(name, tuple(points), speed, 0.0, pause, radius_m, aside_m))
        return True
    return False


def _between(leg: tuple[Point, Point], share: float) -> Point:
    (x0, y0), (x1, y1) = leg
    return x0 + share * (x1 - x0), y0 + share * (y1 - y0)


def away_m(place: Point, rect: Rect) -> float:
    """Of a place from a rectangle; 0 within."""
    return math.hypot(*(max(s[0] - p, p - s[1], 0.0) for p, s in zip(place, rect, strict=True)))


def apart_m(one: Rect, other: Rect) -> float:
    """Of two rectangles; 0 where they touch."""
    return math.hypot(
        *(max(b[0] - a[1], a[0] - b[1], 0.0) for a, b in zip(one, other, strict=True))
    )


def ground_m(fixed: Sequence[Shape], places: Sequence[Point]) -> list[float]:
    """Heights of the ground at places; -inf where there is none."""
    x, y = np.array(places, dtype=float).T
    tops = np.full(len(places), -np.inf)
    for shape in fixed:
        if is_ground(shape):
            tops = np.maximum(tops, shape.tops_m(x, y))
    return [float(top) for top in tops]


def cut(shapes: list[Shape], x: Span, y: Span, depth_m: float) -> bool:
    """Make a hole in the level floor that a rectangle lies in; in place.

    Returns:
        False: it lies in no floor, or in several, and nothing is cut.
    """
    for k, floor in enumerate(shapes):
        if not isinstance(floor, Solid) or not is_ground(floor) or floor.rise_rad:
            continue
        inside = floor.x[0] < x[0] and x[1] < floor.x[1]
        if not (inside and floor.y[0] < y[0] and y[1] < floor.y[1]) or floor.rise_x_rad:
            continue
        low, top = floor.z
        pieces = (
            (floor.x, (floor.y[0], y[0]), top),
            (floor.x, (y[1], floor.y[1]), top),
            ((floor.x[0], x[0]), y, top),
            ((x[1], floor.x[1]), y, top),
            (x, y, top - depth_m),
        )
        shapes[k : k + 1] = [
            Solid(floor.name, px, py, (min(low, pz - 0.5), pz)) for px, py, pz in pieces
        ]
        return True
    return False
