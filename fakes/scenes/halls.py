"""Halls for a machine that cleans floors: walls, racks, pallets, chairs, boxes, people, a dock.

A seed gives the same hall everywhere. The machine starts at the origin, looks along x, and has the
dock behind it. Even seeds stand still; in odd ones people walk, and a box is carried elsewhere
while the machine is at work. Between two things a machine has room. Map frame, metres.
"""

import math
from typing import NamedTuple

import numpy as np

from fakes.scenes.movers import Mover
from fakes.scenes.movers import box as moved_box
from fakes.scenes.scatter import Rect, apart_m, away_m
from fakes.scenes.scene import Scene
from fakes.scenes.solids import Shape, Solid, Span
from fakes.scenes.things import KINDS, Frame, Random, Thing
from fakes.world.crowd import Walker

AREA_M2 = 100.0, 600.0
LONGER = 2.2  # than wide, at most
WALL_M, HIGH_M, DEEP_M = 0.2, 2.5, -1.0
BEHIND_M = 0.75  # of the origin: the wall with the dock
DOCK = (-BEHIND_M, -0.5), (-0.25, 0.25), (0.0, 0.3)
START_M = 2.0  # around the origin nothing stands
GAP_M = 1.1  # between two things
ASIDE_M = 0.3  # of things from walls
PARTED_M2 = 220.0  # from there on there may be a wall across
DOOR_M = (1.8, 2.4)
ONE_IN_M2 = 14.0  # of floor there is a thing
MIX = {"rack": 3, "pallet": 4, "chair": 4, "box": 6, "pillar": 2, "cupboard": 2}
SIZES = {"box": {"size_m": (0.12, 0.8), "height_m": (0.15, 0.9)}}
PERSON_IN_M2 = 180.0
TRIES = 400
CARRIED_S, AWAY_S = (120.0, 300.0), 45.0  # when the box is taken up; how long it is nowhere


class Hall(NamedTuple):
    """A scene, and what of it is one thing."""

    scene: Scene
    inside: Rect  # between the outer walls
    walls: tuple[Solid, ...]  # outer ones, and the one across
    dock: Solid
    things: tuple[Thing, ...]  # that stay where they are
    moved: tuple[Mover, ...]  # the same box, before and after


def hall_of(seed: int, area_m2: Span = AREA_M2) -> Hall:
    """The hall of a seed, with a floor of an area from, to.

    Raises:
        ValueError: a seed below 0.
    """
    if seed < 0:
        raise ValueError(f"seed: must be 0 or more, is {seed}")
    random = np.random.default_rng([seed, 0x48A11])
    inside = _inside(random, area_m2)
    walls, doorway = _walls(inside, random)
    dock = Solid("dock", *DOCK)
    things: list[Thing] = []
    keep = [(wall.x, wall.y) for wall in walls]
    is_lively = seed % 2 == 1
    spare = [_place(inside, keep, doorway, things, random, "box") for _ in range(2 * is_lively)]
    things += [thing for thing in spare if thing is not None]
    moved = _carried(things, random) if len(things) == 2 else ()
    floor_m2 = math.prod(span[1] - span[0] for span in inside)
    names = [name for name, share in MIX.items() for _ in range(share)]
    for _ in range(round(floor_m2 / ONE_IN_M2)):
        kind = names[int(random.integers(len(names)))]
        if (thing := _place(inside, keep, doorway, things, random, kind)) is not None:
            things.append(thing)
    stay = tuple(things[2:] if moved else things)
    walkers = _walkers(inside, keep, things, random, round(floor_m2 / PERSON_IN_M2) * is_lively)
    x, y = ((low - 1.0, high + 1.0) for low, high in inside)
    floor = Solid("floor", x, y, (DEEP_M, 0.0))
    shapes: tuple[Shape, ...] = (floor, *walls, dock, *(s for t in stay for s in t.shapes))
    scene = Scene(
        f"hall {seed}", shapes, movers=moved, walkers=walkers, start_clear_m=1.2,
        description=f"a hall of {floor_m2:.0f} m2",
    )  # fmt: skip
    return Hall(scene, inside, walls, dock, stay, moved)


def _inside(random: Random, area_m2: Span) -> Rect:
    floor_m2, ratio = random.uniform(*area_m2), random.uniform(1.0, LONGER)
    wide, long_m = math.sqrt(floor_m2 / ratio), math.sqrt(floor_m2 * ratio)
    low = -random.uniform(0.2, 0.8) * wide
    return (-BEHIND_M, float(long_m) - BEHIND_M), (float(low), float(low + wide))


def _walls(inside: Rect, random: Random) -> tuple[tuple[Solid, ...], Rect | None]:
    """The outer ones, and perhaps one across; then its doorway with room before it."""
    (x0, x1), (y0, y1) = inside
    up, out = (DEEP_M, HIGH_M), (x0 - WALL_M, x1 + WALL_M)
    walls = [
        Solid("wall behind", (x0 - WALL_M, x0), inside[1], up),
        Solid("wall ahead", (x1, x1 + WALL_M), inside[1], up),
        Solid("right wall", out, (y0 - WALL_M, y0), up),
        Solid("left wall", out, (y1, y1 + WALL_M), up),
    ]
    if (x1 - x0) * (y1 - y0) < PARTED_M2 or random.random() < 0.4:
        return tuple(walls), None
    x = x0 + float(random.uniform(0.4, 0.65)) * (x1 - x0)
    half = float(random.uniform(*DOOR_M)) / 2
    y = float(random.uniform(y0 + half + 0.6, y1 - half - 0.6))
    across = (x, x + WALL_M)
    walls += [
        Solid("wall across, right", across, (y0, y - half), up),
        Solid("wall across, left", across, (y + half, y1), up),
    ]
    return tuple(walls), ((x - 1.2, x + WALL_M + 1.2), (y - half, y + half))


def _place(
    inside: Rect, walls: list[Rect], doorway: Rect | None, others: list[Thing], random: Random,
    kind: str,
) -> Thing | None:  # fmt: skip
    """A thing where there is room for it; None: no place was found."""
    maker, sizes = KINDS[kind]
    for _ in range(TRIES):
        x, y = (float(random.uniform(*span)) for span in inside)
        turned = bool(random.random() < 0.5)
        name = f"{kind} {len(others) + 1}"
        thing = maker(Frame(name, x, y, turned, sizes | SIZES.get(kind, {}), random))
        own = thing.spans
        if away_m((0.0, 0.0), own) < START_M or not _within(own, inside):
            continue
        if any(apart_m(own, wall) < ASIDE_M for wall in walls):
            continue
        if doorway is not None and apart_m(own, doorway) <= 0.0:
            continue
        if all(apart_m(own, other.spans) >= GAP_M for other in others):
            return thing
    return None


def _within(own: Rect, inside: Rect) -> bool:
    return all(
        outer[0] < span[0] and span[1] < outer[1] for span, outer in zip(own, inside, strict=True)
    )


def _carried(boxes: list[Thing], random: Random) -> tuple[Mover, ...]:
    """One box at the first place, then at the second."""
    at_s = float(random.uniform(*CARRIED_S))
    (one,), (other,) = (thing.shapes for thing in boxes)
    assert isinstance(one, Solid)
    half = [(span[1] - span[0]) / 2 for span in (one.x, one.y)]
    x, y = ((sum(s) / 2 - h, sum(s) / 2 + h) for s, h in zip((other.x, other.y), half, strict=True))
    before = moved_box("carried box", one.x, one.y, one.z, until_s=at_s)
    return before, moved_box("carried box", x, y, one.z, from_s=at_s + AWAY_S)


def _walkers(
    inside: Rect, walls: list[Rect], things: list[Thing], random: Random, count: int
) -> tuple[Walker, ...]:
    """People on straight ways between things."""
    bars, found = walls + [thing.spans for thing in things], list[Walker]()
    for _ in range(TRIES):
        if len(found) == count:
            break
        begin, end = (
            (float(random.uniform(*_less(inside[0]))), float(random.uniform(*_less(inside[1]))))
            for _ in range(2)
        )
        way = [
            tuple(a + k / 40 * (b - a) for a, b in zip(begin, end, strict=True)) for k in range(41)
        ]
        is_long = math.dist(begin, end) >= 4.0 and math.hypot(*begin) > START_M
        if not is_long or any(away_m((p[0], p[1]), bar) < 0.6 for bar in bars for p in way):
            continue
        speed, pause = float(random.uniform(0.7, 1.3)), float(random.uniform(1.0, 5.0))
        found.append(
            Walker(f"person {len(found) + 1}", (begin, end), speed, pause_s=pause, aside_m=0.6)
        )
    return tuple(found)


def _less(span: Span) -> Span:
    return span[0] + 0.6, span[1] - 0.6
