"""The solids of a scene: boxes and wedges, pillars, ridges; and what they are made of.

Each knows its top over a point, and itself as MuJoCo XML. Map frame, metres.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
import numpy.typing as npt

F64 = npt.NDArray[np.float64]
Span = tuple[float, float]
RAMP_FOOT_M = 0.5  # how far ramps and ridges reach below the ground: no beam passes under them
ARC_PARTS = 24  # flat pieces of a round ridge
DEEP_M = 1.0  # how far floors reach below their tops


@dataclass(frozen=True, slots=True)
class Material:
    """What a solid does to a beam.

    `glass` returns it only where it comes nearly at a right angle, `black` only from near; in what
    is `soft` a beam ends at a random depth: it meets so many stalks a metre, and wheels none.
    """

    kind: Literal["plain", "glass", "black", "soft"] = "plain"
    density_per_m: float = 0.0  # of stalks, of soft things

    def __post_init__(self) -> None:
        if self.kind not in ("plain", "glass", "black", "soft"):
            raise ValueError(f"material {self.kind!r}: must be plain, glass, black or soft")
        if (self.kind == "soft") is not (self.density_per_m > 0.0):
            raise ValueError("density_per_m: what is soft has one above 0, and nothing else has")


PLAIN, GLASS, BLACK = Material(), Material("glass"), Material("black")


def soft(density_per_m: float) -> Material:
    """Grass, or a curtain of stalks: a beam goes 1 / density_per_m metres in it, on average."""
    return Material("soft", density_per_m)


class Shape(Protocol):
    """What every solid offers."""

    @property
    def name(self) -> str: ...
    @property
    def material(self) -> Material: ...
    @property
    def x(self) -> Span: ...
    @property
    def y(self) -> Span: ...
    @property
    def bottom_m(self) -> float: ...
    def tops_m(self, x: F64, y: F64) -> F64:
        """Height of its top over the points (n,); -inf beside it."""

    def mjcf(self, key: str) -> tuple[str, str]:
        """(asset, geom) as MuJoCo XML; the asset may be empty."""


@dataclass(frozen=True, slots=True)
class Solid:
    """An upright box; from z[1] at its lowest x and y its top rises along y by `rise_rad`, along x
    by `rise_x_rad`: negative goes down.
    """

    name: str
    x: Span
    y: Span
    z: Span
    rise_rad: float = 0.0
    rise_x_rad: float = 0.0
    material: Material = PLAIN

    @property
    def bottom_m(self) -> float:
        return self.z[0]

    def tops_m(self, x: F64, y: F64) -> F64:
        inside = (x >= self.x[0]) & (x <= self.x[1]) & (y >= self.y[0]) & (y <= self.y[1])
        top_m = self.z[1] + math.tan(self.rise_rad) * (y - self.y[0])
        if self.rise_x_rad:
            top_m = top_m + math.tan(self.rise_x_rad) * (x - self.x[0])
        return np.where(inside, top_m, -np.inf)

    def corners(self) -> list[tuple[float, float, float]]:
        slope_x, slope_y = math.tan(self.rise_x_rad), math.tan(self.rise_rad)
        return [
            (x, y, z)
            for y in self.y
            for x in self.x
            for z in (self.z[0], self.z[1] + slope_y * (y - self.y[0]) + slope_x * (x - self.x[0]))
        ]

    def mjcf(self, key: str) -> tuple[str, str]:
        if self.rise_rad or self.rise_x_rad:
            return _hull(key, self.corners())
        spans = (self.x, self.y, self.z)
        middle = " ".join(f"{(low + high) / 2!r}" for low, high in spans)
        half = " ".join(f"{(high - low) / 2!r}" for low, high in spans)
        return "", f'<geom name="{key}" type="box" pos="{middle}" size="{half}" class="scene"/>'


@dataclass(frozen=True, slots=True)
class Pillar:
    """An upright cylinder."""

    name: str
    at: tuple[float, float]
    radius_m: float
    z: Span
    material: Material = PLAIN

    @property
    def x(self) -> Span:
        return self.at[0] - self.radius_m, self.at[0] + self.radius_m

    @property
    def y(self) -> Span:
        return self.at[1] - self.radius_m, self.at[1] + self.radius_m

    @property
    def bottom_m(self) -> float:
        return self.z[0]

    def tops_m(self, x: F64, y: F64) -> F64:
        inside = np.hypot(x - self.at[0], y - self.at[1]) <= self.radius_m
        return np.where(inside, self.z[1], -np.inf)

    def mjcf(self, key: str) -> tuple[str, str]:
        middle = f"{self.at[0]!r} {self.at[1]!r} {sum(self.z) / 2!r}"
        size = f"{self.radius_m!r} {(self.z[1] - self.z[0]) / 2!r}"
        return (
            "",
            f'<geom name="{key}" type="cylinder" pos="{middle}" size="{size}" class="scene"/>',
        )


@dataclass(frozen=True, slots=True)
class Ridge:
    """A profile drawn out across the way: its top goes through `tops` along x or y.

    Args:
        tops: (way from the lowest x or y, height), first at 0, last at the span's other end; never
            bent upwards: MuJoCo wants it convex.
    """

    name: str
    x: Span
    y: Span
    tops: tuple[tuple[float, float], ...]
    along: Literal["x", "y"] = "x"
    material: Material = PLAIN

    @property
    def bottom_m(self) -> float:
        return min(top for _, top in self.tops) - RAMP_FOOT_M

    def tops_m(self, x: F64, y: F64) -> F64:
        inside = (x >= self.x[0]) & (x <= self.x[1]) & (y >= self.y[0]) & (y <= self.y[1])
        way_m = x - self.x[0] if self.along == "x" else y - self.y[0]
        ways_m, tops_m = np.array(self.tops).T
        return np.where(inside, np.interp(way_m, ways_m, tops_m), -np.inf)

    def mjcf(self, key: str) -> tuple[str, str]:
        low = self.bottom_m
        outline = [*self.tops, (self.tops[0][0], low), (self.tops[-1][0], low)]
        if self.along == "x":
            corners = [(self.x[0] + way, y, z) for y in self.y for way, z in outline]
        else:
            corners = [(x, self.y[0] + way, z) for x in self.x for way, z in outline]
        return _hull(key, corners)


def bump(
    name: str, x: Span, y: Span, height_m: float = 0.05, along: Literal["x", "y"] = "x"
) -> Ridge:
    """A speed bump, driven over along x or y: an arc of a circle."""
    low, high = x if along == "x" else y
    long_m = high - low
    radius_m = (long_m**2 / 4 + height_m**2) / (2 * height_m)
    half_rad = math.asin(long_m / 2 / radius_m)
    turns = [half_rad * (2 * k / ARC_PARTS - 1) for k in range(1, ARC_PARTS)]
    arc = [
        (long_m / 2 + radius_m * math.sin(a), radius_m * (math.cos(a) - 1) + height_m)
        for a in turns
    ]
    return Ridge(name, x, y, ((0.0, 0.0), *arc, (long_m, 0.0)), along)


def _hull(key: str, corners: list[tuple[float, float, float]]) -> tuple[str, str]:
    """A convex body through its corners."""
    vertices = " ".join(f"{part!r}" for corner in corners for part in corner)
    asset = f'<mesh name="mesh_{key}" vertex="{vertices}"/>'
    return asset, f'<geom name="{key}" type="mesh" mesh="mesh_{key}" class="scene"/>'


def mjcf_from_solids(solids: Sequence[Shape]) -> tuple[str, str]:
    """(assets, geoms) of solids as MuJoCo XML, the k-th one's geom being `solid<k>`."""
    parts = [solid.mjcf(f"solid{k}") for k, solid in enumerate(solids)]
    return "\n".join(asset for asset, _ in parts if asset), "\n".join(geom for _, geom in parts)


def ramp(
    name: str,
    x: Span,
    y: Span,
    rise_rad: float,
    along: Literal["x", "y"] = "y",
    from_m: float = 0.0,
    material: Material = PLAIN,
) -> Solid:
    """A wedge that rises along x or y, from a height, and reaches below the ground."""
    low, high = {"x": x, "y": y}[along]
    foot_m = min(from_m, from_m + math.tan(rise_rad) * (high - low)) - RAMP_FOOT_M
    rises = (0.0, rise_rad) if along == "x" else (rise_rad, 0.0)
    return Solid(name, x, y, (foot_m, from_m), *rises, material)


@dataclass(frozen=True, slots=True)
class Slope:
    """A way up along x from z = 0, of a rise that is left to chance.

    Args:
        rise_deg: from, to.
        until_x: how far the level ground behind it reaches.
        ease_m: at both ends it is only half as steep.
    """

    name: str
    x: Span
    y: Span
    rise_deg: Span
    until_x: float
    ease_m: float = 1.5

    def drawn(self, random: np.random.Generator) -> "list[Solid]":
        rise_rad, z = math.radians(float(random.uniform(*self.rise_deg))), 0.0
        (begin, end), parts = self.x, []
        edges = (begin, begin + self.ease_m, end - self.ease_m, end)
        for k, share in enumerate((0.5, 1.0, 0.5)):
            x, rise = (edges[k], edges[k + 1]), share * rise_rad
            parts.append(ramp(f"{self.name} {k + 1}", x, self.y, rise, "x", z))
            z += math.tan(rise) * (x[1] - x[0])
        behind = (z - DEEP_M, z)
        return [*parts, Solid(f"{self.name}, behind", (end, self.until_x), self.y, behind)]


def span_from(pair: list[float]) -> Span:
    """[from, to] of a scene's file.

    Raises:
        ValueError: it is no such pair, or ends before it begins.
    """
    if not isinstance(pair, list) or len(pair) != 2:
        raise ValueError(f"must be [from, to], is {pair!r}")
    low, high = float(pair[0]), float(pair[1])
    if not low < high:
        raise ValueError(f"must be [from, to] with from < to, is {pair}")
    return low, high
