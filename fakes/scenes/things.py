"""Things to put into a scene: furniture, pallets, racks, panes, mats, from a few numbers each.

A thing is made around a place on level ground at z = 0; `lifted` moves it onto the ground there.
Metres; a `turned` thing lies along y instead of x.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from fakes.scenes.solids import BLACK, GLASS, Pillar, Shape, Solid, Span, soft
from fakes.world.error_models import Patch
from fakes.world.magnetic import MagneticDisturbance

Random = np.random.Generator
FOOT_M = 0.02  # how deep things stand in the ground, so that no slit is left on a slope


@dataclass(frozen=True, slots=True)
class Thing:
    """Solids, and what else comes with them."""

    shapes: tuple[Shape, ...] = ()
    steels: tuple[MagneticDisturbance, ...] = ()
    patches: tuple[Patch, ...] = ()
    hole: tuple[Span, Span, float] | None = None  # x, y, depth: to be cut out of the floor

    @property
    def spans(self) -> tuple[Span, Span]:
        """x and y from lowest to highest."""
        flat: list[tuple[Span, Span]] = [(shape.x, shape.y) for shape in self.shapes]
        flat += [(patch.x, patch.y) for patch in self.patches]
        flat += [self.hole[:2]] if self.hole else []
        x = min(x[0] for x, _ in flat), max(x[1] for x, _ in flat)
        return x, (min(y[0] for _, y in flat), max(y[1] for _, y in flat))


@dataclass(frozen=True, slots=True)
class Frame:
    """Where a thing is made: its name, its middle, and whether it is turned by a right angle."""

    name: str
    x: float
    y: float
    turned: bool

    def box(self, part: str, along: Span, across: Span, z: Span) -> Solid:
        """An upright box, from its spans about the middle."""
        x, y = (across, along) if self.turned else (along, across)
        return Solid(
            f"{self.name}, {part}" if part else self.name,
            (self.x + x[0], self.x + x[1]),
            (self.y + y[0], self.y + y[1]),
            z,
        )

    def pole(self, part: str, along: float, across: float, radius_m: float, z: Span) -> Pillar:
        """An upright cylinder, from its place about the middle."""
        dx, dy = (across, along) if self.turned else (along, across)
        return Pillar(f"{self.name}, {part}", (self.x + dx, self.y + dy), radius_m, z)


Sizes = dict[str, Span]  # what an entry of a scene's file says, from and to
Maker = Callable[[Frame, Random, Sizes], Thing]


def _half(span: float) -> Span:
    return -span / 2, span / 2


def _one(random: Random, sizes: Sizes, key: str, otherwise: Span) -> float:
    """A number between the bounds of an entry, or between these."""
    return float(random.uniform(*sizes.get(key, otherwise)))


def _feet(frame: Frame, long_m: float, wide_m: float, high_m: float, foot_m: float) -> list[Solid]:
    """Four legs, as far out as can be."""
    inner = (long_m / 2 - foot_m, wide_m / 2 - foot_m)
    return [
        frame.box(
            f"leg {2 * i + j + 1}",
            (-long_m / 2, -inner[0]) if i else (inner[0], long_m / 2),
            (-wide_m / 2, -inner[1]) if j else (inner[1], wide_m / 2),
            (0.0, high_m),
        )
        for i in (0, 1)
        for j in (0, 1)
    ]


def box(frame: Frame, random: Random, sizes: Sizes) -> Thing:
    """`size_m` of both edges, `height_m`; standing on the ground."""
    long_m, wide_m = (_one(random, sizes, "size_m", (0.3, 1.0)) for _ in "xy")
    high_m = _one(random, sizes, "height_m", (0.16, 1.2))
    return Thing((frame.box("", _half(long_m), _half(wide_m), (0.0, high_m)),))


def pillar(frame: Frame, random: Random, sizes: Sizes) -> Thing:
    """`radius_m`, `height_m`: as high as a room if nothing is said."""
    high_m = _one(random, sizes, "height_m", (2.5, 2.5))
    radius_m = _one(random, sizes, "radius_m", (0.10, 0.30))
    return Thing((Pillar(frame.name, (frame.x, frame.y), radius_m, (0.0, high_m)),))


def table(frame: Frame, random: Random, sizes: Sizes) -> Thing:
    """`long_m`, `wide_m`, `height_m`: a top on four legs."""
    long_m = _one(random, sizes, "long_m", (1.2, 1.8))
    wide_m = _one(random, sizes, "wide_m", (0.7, 0.9))
    high_m = _one(random, sizes, "height_m", (0.72, 0.72))
    top = frame.box("top", _half(long_m), _half(wide_m), (high_m - 0.03, high_m))
    return Thing((top, *_feet(frame, long_m, wide_m, high_m - 0.03, 0.05)))


def chair(frame: Frame, random: Random, sizes: Sizes) -> Thing:
    """A seat 0.45 m high on four legs, with a back."""
    side = float(random.choice((-0.20, 0.20)))
    seat = frame.box("seat", _half(0.45), _half(0.45), (0.42, 0.45))
    back = frame.box("back", _half(0.45), (side - 0.02, side + 0.02), (0.45, 0.90))
    return Thing((seat, back, *_feet(frame, 0.45, 0.45, 0.42, 0.04)))


def desk(frame: Frame, random: Random, sizes: Sizes) -> Thing:
    """A table with a drawer unit under it and an office chair on a foot before it."""
    made = table(frame, random, sizes).shapes
    top = made[0]
    long_m = (top.x[1] - top.x[0], top.y[1] - top.y[0])[frame.turned]
    wide_m = (top.y[1] - top.y[0], top.x[1] - top.x[0])[frame.turned]
    drawers = (long_m / 2 - 0.50, long_m / 2 - 0.08)
    before = wide_m / 2 + _one(random, sizes, "chair_m", (0.05, 0.35)) + 0.23
    return Thing(
        (
            *made,
            frame.box("drawers", drawers, _half(wide_m - 0.1), (0.0, 0.55)),
            frame.pole("chair's foot", -0.2, before, 0.28, (0.0, 0.10)),
            frame.pole("chair's column", -0.2, before, 0.04, (0.0, 0.42)),
            frame.box("chair's seat", (-0.43, 0.03), (before - 0.23, before + 0.23), (0.42, 0.48)),
            frame.box("chair's back", (-0.43, 0.03), (before + 0.18, before + 0.23), (0.48, 1.0)),
        )
    )


def cupboard(frame: Frame, random: Random, sizes: Sizes) -> Thing:
    """`long_m`, `wide_m`, `height_m`: closed, taller than the lens."""
    long_m = _one(random, sizes, "long_m", (0.8, 1.6))
    wide_m = _one(random, sizes, "wide_m", (0.4, 0.6))
    high_m = _one(random, sizes, "height_m", (1.6, 2.1))
    return Thing((frame.box("", _half(long_m), _half(wide_m), (0.0, high_m)),))


def locker(frame: Frame, random: Random, sizes: Sizes) -> Thing:
    """A cupboard of steel: it bends the magnetic field."""
    yaw_rad = math.radians(_one(random, sizes, "yaw_deg", (-40.0, 40.0)))
    made = cupboard(frame, random, sizes).shapes
    return Thing(made, (MagneticDisturbance(frame.name, (frame.x, frame.y), yaw_rad, 2.0),))


def pallet(frame: Frame, random: Random, sizes: Sizes) -> Thing:
    """1.2 x 0.8 x 0.16 m, with `load_m` of goods on it; below 0.05 m of load it is empty."""
    load_m = _one(random, sizes, "load_m", (-0.6, 0.9))
    wood = frame.box("wood", _half(1.2), _half(0.8), (0.0, 0.16))
    if load_m < 0.05:
        return Thing((wood,))
    goods = frame.box("goods", _half(1.1), _half(0.75), (0.16, 0.16 + load_m))
    return Thing((wood, goods))


def rack(frame: Frame, random: Random, sizes: Sizes) -> Thing:
    """`long_m` of shelves 1.0 m deep on posts, goods on the floor below the first of them."""
    long_m = _one(random, sizes, "long_m", (2.4, 3.0))
    goods_m = (long_m - 0.4) / 2
    lows = (-goods_m - 0.05, 0.05)
    goods = [
        frame.box(
            f"goods {k + 1}",
            (low, low + goods_m),
            (-0.5 + float(random.uniform(0.0, 0.1)), 0.5 - float(random.uniform(0.0, 0.1))),
            (0.0, _one(random, sizes, "height_m", (0.3, 1.0))),
        )
        for k, low in enumerate(lows)
    ]
    shelves = [
        frame.box(f"shelf {k + 1}", _half(long_m), _half(1.0), (low, low + 0.1))
        for k, low in enumerate((1.15, 2.2))
    ]
    return Thing((*goods, *shelves, *_feet(frame, long_m, 1.0, 2.3, 0.08)))


def truck(frame: Frame, random: Random, sizes: Sizes) -> Thing:
    """A fork-lift: its body, and two low forks ahead of it, their tops 0.16 m high."""
    way = 1.0 if random.random() < 0.5 else -1.0
    forks = [
        frame.box(f"fork {k + 1}", _sorted(way * 0.5, way * 1.6), (low, low + 0.14), (0.06, 0.16))
        for k, low in enumerate((-0.35, 0.21))
    ]
    body = frame.box("body", _sorted(-way * 1.2, way * 0.5), _half(1.0), (0.0, 2.0))
    return Thing((body, *forks))


def _sorted(one: float, other: float) -> Span:
    return min(one, other), max(one, other)


def ditch(frame: Frame, random: Random, sizes: Sizes) -> Thing:
    """`long_m`, `wide_m`, `depth_m`: a hole in a level floor."""
    long_m = _one(random, sizes, "long_m", (1.0, 2.5))
    wide_m = _one(random, sizes, "wide_m", (0.5, 1.0))
    hole = frame.box("", _half(long_m), _half(wide_m), (0.0, 1.0))
    return Thing(hole=(hole.x, hole.y, _one(random, sizes, "depth_m", (0.3, 0.8))))


def mat(frame: Frame, random: Random, sizes: Sizes) -> Thing:
    """`size_m`: black, 4 mm thick; nothing comes back from it from beyond 3 m."""
    long_m, wide_m = (_one(random, sizes, "size_m", (0.8, 1.6)) for _ in "xy")
    flat = frame.box("", _half(long_m), _half(wide_m), (0.0, 0.004))
    return Thing((replace(flat, material=BLACK),))


def grass(frame: Frame, random: Random, sizes: Sizes) -> Thing:
    """`size_m`, `height_m`, `density_per_m`: stalks that beams go into and wheels through."""
    long_m, wide_m = (_one(random, sizes, "size_m", (1.0, 2.0)) for _ in "xy")
    high_m = _one(random, sizes, "height_m", (0.16, 0.35))
    tuft = frame.box("", _half(long_m), _half(wide_m), (0.0, high_m))
    density = _one(random, sizes, "density_per_m", (3.0, 8.0))
    return Thing((replace(tuft, material=soft(density)),))


def pane(frame: Frame, random: Random, sizes: Sizes) -> Thing:
    """`long_m` of glass, 2 m high, on a skirting of 0.25 m that every beam sees."""
    long_m = _one(random, sizes, "long_m", (1.5, 3.0))
    foot = frame.box("skirting", _half(long_m), _half(0.10), (0.0, 0.25))
    glass = frame.box("glass", _half(long_m), _half(0.02), (0.25, 2.0))
    return Thing((foot, replace(glass, material=GLASS)))


def cable(frame: Frame, random: Random, sizes: Sizes) -> Thing:
    """`long_m`, `height_m`: a cable cover that the robot rolls over, and nods."""
    long_m = _one(random, sizes, "long_m", (2.0, 4.0))
    high_m = _one(random, sizes, "height_m", (0.006, 0.006))
    return Thing((frame.box("", _half(long_m), _half(0.2), (0.0, high_m)),))


def puddle(frame: Frame, random: Random, sizes: Sizes) -> Thing:
    """`size_m`, `friction`: slippery ground."""
    long_m, wide_m = (_one(random, sizes, "size_m", (0.8, 2.0)) for _ in "xy")
    flat = frame.box("", _half(long_m), _half(wide_m), (0.0, 1.0))
    friction = _one(random, sizes, "friction", (0.3, 0.5))
    return Thing(patches=(Patch(frame.name, flat.x, flat.y, friction),))


MAKERS: dict[str, Maker] = {
    maker.__name__: maker
    for maker in (
        box, pillar, table, chair, desk, cupboard, locker, pallet, rack, truck, ditch, mat, grass,
        pane, cable, puddle,
    )
}  # fmt: skip
SIZES = {  # of each kind, that an entry may set
    "box": {"size_m", "height_m"},
    "pillar": {"radius_m", "height_m"},
    "table": {"long_m", "wide_m", "height_m"},
    "chair": set(),
    "desk": {"long_m", "wide_m", "height_m", "chair_m"},
    "cupboard": {"long_m", "wide_m", "height_m"},
    "locker": {"long_m", "wide_m", "height_m", "yaw_deg"},
    "pallet": {"load_m"},
    "rack": {"long_m", "height_m"},
    "truck": set(),
    "ditch": {"long_m", "wide_m", "depth_m"},
    "mat": {"size_m"},
    "grass": {"size_m", "height_m", "density_per_m"},
    "pane": {"long_m"},
    "cable": {"long_m", "height_m"},
    "puddle": {"size_m", "friction"},
}
ROLLED_OVER = {"cable", "puddle"}  # may lie where the robot goes


def lifted(shape: Shape, low_m: float, high_m: float) -> Shape:
    """A thing's part on ground between two heights: nothing of it is lower than it was made."""
    assert isinstance(shape, Solid | Pillar)
    low = low_m - FOOT_M if shape.z[0] == 0.0 else high_m + shape.z[0]
    return replace(shape, z=(low, high_m + shape.z[1]))
