"""From a scene's file to what is there: its fixed solids, and what it leaves to chance, drawn.

To chance are left: `mirror` (left and right change places), `chance` in an entry (it is there, or
not), [[slope]] with a range of rises, [rooms], [[scatter]], [goals]. All of it follows from the
seed, the scene's name and the number of the attempt. Map frame, metres.
"""

import math
import zlib
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fakes.scenes.floor_plan import Rooms, rooms_from
from fakes.scenes.scatter import Lot, Point, Rect, check_scatter, put
from fakes.scenes.solids import (
    RAMP_FOOT_M,
    Pillar,
    Ridge,
    Shape,
    Solid,
    bump_from,
    pillar_from,
    ramp_from,
    solid_from,
    span_from,
)
from fakes.scenes.things import Random, Thing
from fakes.world.crowd import Walker, walker_from

STAY = {"from_s", "until_s"}
KEYS = {  # of a scene's file, and of the tables in it
    "": {"x_axis_east_of_north_deg", "description", "campaign", "fair", "start_clear_m", "friction",
         "mirror", "route", "upsets", "goals", "rooms", "solid", "ramp", "slope", "pillar", "bump",
         "person", "walker", "moved_box", "steel", "slip", "patch", "scatter"},
    "solid": {"name", "x", "y", "z", "material", "density_per_m", "chance"},
    "ramp": {"name", "x", "y", "rise_deg", "along", "from_m", "material", "chance"},
    "slope": {"name", "x", "y", "rise_deg", "ease_m", "until_x"},
    "pillar": {"name", "at", "radius_m", "z", "material", "chance"},
    "bump": {"name", "x", "y", "height_m", "along", "profile", "floor_m", "chance"},
    "person": {"name", "waypoints", "speed_mps", "start_s", "legs", "height_m", "radius_m",
               "returns", *STAY, "chance"},
    "walker": {"name", "waypoints", "speed_mps", "start_s", "pause_s", "radius_m", "aside_m",
               "chance"},
    "moved_box": {"name", "x", "y", "z", *STAY, "chance"},
    "steel": {"name", "at", "yaw_deg", "reach_m", "strength", "chance"},
    "patch": {"name", "x", "y", "friction", "chance"},
    "slip": {"left", "right", *STAY},
}  # fmt: skip
SINGLE = {"goals": {"count", "areas"}, "rooms": {"count", "wide_m", "long_m", "door_m"}}
DEEP_M = 1.0  # how far floors reach below their tops


@dataclass(frozen=True, slots=True)
class Drawn:
    """What there is.

    Args:
        table: the file's, without what is not there; what else it holds is not drawn.
    """

    table: dict[str, Any]
    solids: tuple[Shape, ...]
    goals: tuple[Point, ...]
    walkers: tuple[Walker, ...]


def check_keys(table: dict[str, Any], file: str) -> None:
    """Whether a file holds only keys that there are.

    Raises:
        ValueError: it names another; the text says which.
    """
    for kind, known in KEYS.items():
        for entry in table.get(kind, []) if kind else [table]:
            if unknown := sorted(entry.keys() - known):
                raise ValueError(f"{file}, {kind or 'scene'}: no key {unknown[0]!r}")
    for kind, known in SINGLE.items():
        if unknown := sorted(table.get(kind, {}).keys() - known):
            raise ValueError(f"{file}, {kind}: no key {unknown[0]!r}")
    for area in table.get("goals", {}).get("areas", []):
        if unknown := sorted(area.keys() ^ {"x", "y"}):
            raise ValueError(f"{file}, goals: an area has x and y, not {unknown[0]!r}")
    for entry in table.get("scatter", []):
        check_scatter(entry)


def has_chance(table: dict[str, Any]) -> bool:
    """Whether anything in a file is left to chance."""
    if table.keys() & {"mirror", "scatter", "goals", "rooms", "slope"}:
        return True
    return any("chance" in entry for kind in KEYS if kind for entry in table.get(kind, []))


def maybe_drawn(table: dict[str, Any], name: str, seed: int, attempt: int) -> Drawn | None:
    """What a file's table gives; None where this attempt finds no place for something."""
    random = np.random.default_rng([seed % 2**63, zlib.crc32(name.encode()), attempt])
    is_mirrored = bool(table.get("mirror", False)) and random.random() < 0.5
    table = table | {
        kind: [e for e in table[kind] if random.random() < float(e.get("chance", 1.0))]
        for kind in KEYS
        if kind and kind in table
    }
    lot = Lot(_fixed(table, random), [], [])
    rooms = rooms_from(table["rooms"], random) if "rooms" in table else Rooms((), (), ())
    lot.fixed += rooms.walls
    lot.areas += rooms.areas
    lot.goals += _goals(table.get("goals", {}), rooms.goal_areas, random)
    for entry in table.get("scatter", []):
        if not put(lot, entry, random):
            return None
    walkers = [walker_from(entry) for entry in table.get("walker", [])] + lot.walkers
    table = _with_fields(table, lot.things)
    solids = [*lot.fixed, *(shape for thing in lot.things for shape in thing.shapes)]
    drawn = Drawn(table, tuple(solids), tuple(lot.goals), tuple(walkers))
    return _other_side(drawn) if is_mirrored else drawn


def _fixed(table: dict[str, Any], random: Random) -> list[Shape]:
    """The solids that the file itself names."""
    shapes: list[Shape] = [solid_from(entry) for entry in table.get("solid", [])]
    shapes += [ramp_from(entry) for entry in table.get("ramp", [])]
    shapes += [pillar_from(entry) for entry in table.get("pillar", [])]
    shapes += [bump_from(entry) for entry in table.get("bump", [])]
    for entry in table.get("slope", []):
        shapes += _slope(entry, random)
    return shapes


def _slope(entry: dict[str, Any], random: Random) -> list[Shape]:
    """A [[slope]]: name, x, y, rise_deg [from, to]; up along x from z = 0, over `ease_m` (1.5) at
    both ends only half as steep; behind it level ground up to until_x.
    """
    (begin, end), y = span_from(entry["x"]), span_from(entry["y"])
    rise_rad = math.radians(float(random.uniform(*entry["rise_deg"])))
    ease_m, z = float(entry.get("ease_m", 1.5)), 0.0
    shapes: list[Shape] = []
    edges = (begin, begin + ease_m, end - ease_m, end)
    for k, share in enumerate((0.5, 1.0, 0.5)):
        x, rise = (edges[k], edges[k + 1]), share * rise_rad
        after = z + math.tan(rise) * (x[1] - x[0])
        foot = min(z, after) - RAMP_FOOT_M
        shapes.append(Solid(f"{entry['name']} {k + 1}", x, y, (foot, z), rise_x_rad=rise))
        z = after
    until = (end, float(entry["until_x"]))
    shapes.append(Solid(f"{entry['name']}, behind", until, y, (z - DEEP_M, z)))
    return shapes


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


def _with_fields(table: dict[str, Any], things: list[Thing]) -> dict[str, Any]:
    """A table with the steel and the slippery ground that came with things."""
    steels = [
        {"name": s.name, "at": list(s.at), "yaw_deg": math.degrees(s.yaw_rad),
         "reach_m": s.reach_m, "strength": s.strength}
        for thing in things for s in thing.steels
    ]  # fmt: skip
    patches = [
        {"name": p.name, "x": list(p.x), "y": list(p.y), "friction": p.friction}
        for thing in things
        for p in thing.patches
    ]
    return table | {
        "steel": [*table.get("steel", []), *steels],
        "patch": [*table.get("patch", []), *patches],
    }


# -- left and right change places -------------------------------------------------------------


def _other_side(drawn: Drawn) -> Drawn:
    """The same with y and -y changed."""
    return Drawn(
        {key: _turned_over(key, value) for key, value in drawn.table.items()},
        tuple(mirrored(shape) for shape in drawn.solids),
        tuple((x, -y) for x, y in drawn.goals),
        tuple(replace(w, waypoints=tuple((x, -y) for x, y in w.waypoints)) for w in drawn.walkers),
    )


def mirrored(shape: Shape) -> Shape:
    """A shape on the other side."""
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


def _turned_over(kind: str, value: Any) -> Any:
    """The tables of what is no solid, on the other side; all else as it is."""
    if kind == "route":
        points = [[p[0], -p[1], *p[2:]] for p in value["waypoints"]]
        return value | {"waypoints": points}
    if kind == "slip":
        return [e | {"left": e.get("right", 0.0), "right": e.get("left", 0.0)} for e in value]
    if kind not in ("person", "moved_box", "steel", "patch"):
        return value
    over = []
    for entry in value:
        other = dict(entry)
        if "y" in entry:
            other["y"] = [-entry["y"][1], -entry["y"][0]]
        if "at" in entry:
            other["at"] = [entry["at"][0], -entry["at"][1]]
        if "waypoints" in entry:
            other["waypoints"] = [[x, -y] for x, y in entry["waypoints"]]
        if "yaw_deg" in entry:
            other["yaw_deg"] = -entry["yaw_deg"]
        over.append(other)
    return over
