"""From a scene's file to what is there: its fixed solids, and what it leaves to chance, drawn.

To chance are left: `mirror` (left and right change places), `chance` in an entry (it is there, or
not), [[slope]] with a range of rises, [rooms], [[scatter]], [goals]. All of it follows from the
seed, the scene's name and the number of the attempt. Map frame, metres.
"""

import math
import zlib
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, TypedDict

import numpy as np

from fakes.scenes.entries import LISTS, made
from fakes.scenes.floor_plan import Rooms, rooms_from
from fakes.scenes.movers import Mover
from fakes.scenes.scatter import Lot, Point, Rect, put
from fakes.scenes.solids import Pillar, Ridge, Shape, Solid
from fakes.scenes.things import Random
from fakes.world.crowd import Walker
from fakes.world.error_models import Patch
from fakes.world.magnetic import MagneticDisturbance
from fakes.world.slip import Slip


class Drawn(TypedDict):
    """What there is; all else the file says itself."""

    solids: tuple[Shape, ...]
    goals: tuple[Point, ...]
    waypoints: tuple[tuple[float, ...], ...]
    movers: tuple[Mover, ...]
    walkers: tuple[Walker, ...]
    steels: tuple[MagneticDisturbance, ...]
    patches: tuple[Patch, ...]
    slips: tuple[Slip, ...]


def has_chance(table: dict[str, Any]) -> bool:
    if table.keys() & {"mirror", "scatter", "goals", "rooms", "slope"}:
        return True
    return any("chance" in entry for kind in LISTS for entry in table.get(kind, []))


def maybe_drawn(table: dict[str, Any], name: str, seed: int, attempt: int) -> Drawn | None:
    """What a file's table gives; None where this attempt finds no place for something."""
    random = np.random.default_rng([seed % 2**63, zlib.crc32(name.encode()), attempt])
    is_mirrored = bool(table.get("mirror", False)) and random.random() < 0.5
    there: dict[str, list[Any]] = {
        kind: [
            made(kind, entry)
            for entry in table.get(kind, [])
            if random.random() < float(entry.get("chance", 1.0))
        ]
        for kind in LISTS
    }
    lot = Lot([solid for kind in ("solid", "ramp", "pillar", "bump") for solid in there[kind]])
    for slope in there["slope"]:
        lot.fixed += slope.drawn(random)
    rooms = rooms_from(table["rooms"], random) if "rooms" in table else Rooms((), (), ())
    lot.fixed += rooms.walls
    lot.areas += rooms.areas
    lot.goals += _goals(table.get("goals", {}), rooms.goal_areas, random)
    for entry in table.get("scatter", []):
        if not put(lot, entry, random):
            return None
    # a thing's steel is turned as if a file had said it, in degrees: each seed keeps its last bit
    steels = [
        replace(steel, yaw_rad=math.radians(math.degrees(steel.yaw_rad)))
        for thing in lot.things
        for steel in thing.steels
    ]
    drawn = Drawn(
        solids=(*lot.fixed, *(shape for thing in lot.things for shape in thing.shapes)),
        goals=tuple(lot.goals),
        waypoints=tuple(
            tuple(float(part) for part in point)
            for point in table.get("route", {}).get("waypoints", [])
        ),
        movers=(*there["person"], *there["moved_box"]),
        walkers=(*there["walker"], *lot.walkers),
        steels=(*there["steel"], *steels),
        patches=(*there["patch"], *(patch for thing in lot.things for patch in thing.patches)),
        slips=tuple(there["slip"]),
    )
    return _other_side(drawn) if is_mirrored else drawn


def _goals(entry: dict[str, Any], areas: tuple[Rect, ...], random: Random) -> list[Point]:
    """[goals]: count [from, to] of areas {x, y}, each used once, in the order of the file."""
    given = tuple((_span(a["x"]), _span(a["y"])) for a in entry.get("areas", [])) or areas
    if not given:
        return []
    least, most = entry.get("count", [1, 1])
    count = min(len(given), int(random.integers(least, most + 1)))
    chosen = sorted(random.permutation(len(given))[:count])
    return [
        (float(random.uniform(*given[k][0])), float(random.uniform(*given[k][1]))) for k in chosen
    ]


def _span(pair: list[float]) -> tuple[float, float]:
    """[from, to]; a place has both the same."""
    low, high = float(pair[0]), float(pair[1])
    if low > high:
        raise ValueError(f"an area needs [from, to] with from <= to, is {pair}")
    return low, high


def _over(points: Sequence[tuple[float, ...]]) -> tuple[Any, ...]:
    return tuple((x, -y, *more) for x, y, *more in points)


def _other_side(drawn: Drawn) -> Drawn:
    """The same with y and -y changed."""
    return Drawn(
        solids=tuple(mirrored(shape) for shape in drawn["solids"]),
        goals=_over(drawn["goals"]),
        waypoints=_over(drawn["waypoints"]),
        movers=tuple(replace(m, waypoints=_over(m.waypoints)) for m in drawn["movers"]),
        walkers=tuple(replace(w, waypoints=_over(w.waypoints)) for w in drawn["walkers"]),
        steels=tuple(
            replace(s, at=(s.at[0], -s.at[1]), yaw_rad=-s.yaw_rad) for s in drawn["steels"]
        ),
        patches=tuple(replace(p, y=(-p.y[1], -p.y[0])) for p in drawn["patches"]),
        slips=tuple(replace(s, left=s.right, right=s.left) for s in drawn["slips"]),
    )


def mirrored(shape: Shape) -> Shape:
    y = (-shape.y[1], -shape.y[0])
    match shape:
        case Pillar():
            return replace(shape, at=(shape.at[0], -shape.at[1]))
        case Ridge(along="y"):
            long_m = shape.y[1] - shape.y[0]
            tops = tuple((long_m - way, top) for way, top in reversed(shape.tops))
            return replace(shape, y=y, tops=tops)
        case Solid():
            top = shape.z[1] + math.tan(shape.rise_rad) * (shape.y[1] - shape.y[0])
            return replace(shape, y=y, z=(shape.z[0], top), rise_rad=-shape.rise_rad)
        case Ridge():
            return replace(shape, y=y)
    raise ValueError(f"{shape.name} has no other side")
