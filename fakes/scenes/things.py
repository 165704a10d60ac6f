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


Sizes = dict[str, Span]  # each from, to


@dataclass(frozen=True, slots=True)
class Frame:
    """Where a thing is made, whether it is turned by a right angle, and what its sizes may be."""

    name: str
    x: float
    y: float
    turned: bool
    sizes: Sizes
    random: Random

    def drawn(self, size: str) -> float:
        """One of its sizes, anew with each call."""
        return float(self.random.uniform(*self.sizes[size]))

    def half(self, size: str) -> Span:
        """The span of a size about the middle, anew with each call."""
        return _half(self.drawn(size))

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

    def feet(self, long_m: float, wide_m: float, high_m: float, foot_m: float) -> list[Solid]:
        """Four legs, as far out as can be."""
        inner = (long_m / 2 - foot_m, wide_m / 2 - foot_m)
        return [
            self.box(
                f"leg {2 * i + j + 1}",
                (-long_m / 2, -inner[0]) if i else (inner[0], long_m / 2),
                (-wide_m / 2, -inner[1]) if j else (inner[1], wide_m / 2),
                (0.0, high_m),
            )
            for i in (0, 1)
            for j in (0, 1)
        ]


Maker = Callable[[Frame], Thing]
KINDS: dict[str, tuple[Maker, Sizes]] = {}
ROLLED_OVER = {"cable", "puddle"}  # may lie where the robot goes


def kind(**sizes: Span) -> Callable[[Maker], Maker]:
    """Makes a function a kind of thing, of sizes that an entry of a scene's file may change."""

    def known(maker: Maker) -> Maker:
        KINDS[maker.__name__] = maker, sizes
        return maker

    return known


def _half(span: float) -> Span:
    return -span / 2, span / 2


@kind(size_m=(0.3, 1.0), height_m=(0.16, 1.2))
def box(at: Frame) -> Thing:
    """Closed, standing on the ground."""
    return Thing((at.box("", at.half("size_m"), at.half("size_m"), (0.0, at.drawn("height_m"))),))


@kind(height_m=(2.5, 2.5), radius_m=(0.1, 0.3))
def pillar(at: Frame) -> Thing:
    """As high as a room if nothing is said."""
    high_m = at.drawn("height_m")
    return Thing((Pillar(at.name, (at.x, at.y), at.drawn("radius_m"), (0.0, high_m)),))


@kind(long_m=(1.2, 1.8), wide_m=(0.7, 0.9), height_m=(0.72, 0.72))
def table(at: Frame) -> Thing:
    """A top on four legs."""
    long_m, wide_m, high_m = (at.drawn(size) for size in ("long_m", "wide_m", "height_m"))
    top = at.box("top", _half(long_m), _half(wide_m), (high_m - 0.03, high_m))
    return Thing((top, *at.feet(long_m, wide_m, high_m - 0.03, 0.05)))


@kind()
def chair(at: Frame) -> Thing:
    """A seat 0.45 m high on four legs, with a back."""
    side = float(at.random.choice((-0.20, 0.20)))
    seat = at.box("seat", _half(0.45), _half(0.45), (0.42, 0.45))
    back = at.box("back", _half(0.45), (side - 0.02, side + 0.02), (0.45, 0.90))
    return Thing((seat, back, *at.feet(0.45, 0.45, 0.42, 0.04)))


@kind(long_m=(1.2, 1.8), wide_m=(0.7, 0.9), height_m=(0.72, 0.72), chair_m=(0.05, 0.35))
def desk(at: Frame) -> Thing:
    """A table with a drawer unit under it and an office chair on a foot before it."""
    made = table(at).shapes
    top = made[0]
    long_m = (top.x[1] - top.x[0], top.y[1] - top.y[0])[at.turned]
    wide_m = (top.y[1] - top.y[0], top.x[1] - top.x[0])[at.turned]
    drawers = (long_m / 2 - 0.50, long_m / 2 - 0.08)
    before = wide_m / 2 + at.drawn("chair_m") + 0.23
    return Thing(
        (
            *made,
            at.box("drawers", drawers, _half(wide_m - 0.1), (0.0, 0.55)),
            at.pole("chair's foot", -0.2, before, 0.28, (0.0, 0.10)),
            at.pole("chair's column", -0.2, before, 0.04, (0.0, 0.42)),
            at.box("chair's seat", (-0.43, 0.03), (before - 0.23, before + 0.23), (0.42, 0.48)),
            at.box("chair's back", (-0.43, 0.03), (before + 0.18, before + 0.23), (0.48, 1.0)),
        )
    )


@kind(long_m=(0.8, 1.6), wide_m=(0.4, 0.6), height_m=(1.6, 2.1))
def cupboard(at: Frame) -> Thing:
    """Closed, taller than the lens."""
    return Thing((at.box("", at.half("long_m"), at.half("wide_m"), (0.0, at.drawn("height_m"))),))


@kind(long_m=(0.8, 1.6), wide_m=(0.4, 0.6), height_m=(1.6, 2.1), yaw_deg=(-40.0, 40.0))
def locker(at: Frame) -> Thing:
    """A cupboard of steel: it bends the magnetic field."""
    steel = MagneticDisturbance(at.name, (at.x, at.y), math.radians(at.drawn("yaw_deg")), 2.0)
    return Thing(cupboard(at).shapes, (steel,))


@kind(load_m=(-0.6, 0.9))
def pallet(at: Frame) -> Thing:
    """1.2 x 0.8 x 0.16 m, with so much of goods on it; below 0.05 m of load it is empty."""
    load_m = at.drawn("load_m")
    wood = at.box("wood", _half(1.2), _half(0.8), (0.0, 0.16))
    if load_m < 0.05:
        return Thing((wood,))
    return Thing((wood, at.box("goods", _half(1.1), _half(0.75), (0.16, 0.16 + load_m))))


@kind(long_m=(2.4, 3.0), height_m=(0.3, 1.0))
def rack(at: Frame) -> Thing:
    """Shelves 1.0 m deep on posts, goods on the floor below the first of them."""
    long_m = at.drawn("long_m")
    goods_m = (long_m - 0.4) / 2
    goods = [
        at.box(
            f"goods {k + 1}",
            (low, low + goods_m),
            (-0.5 + float(at.random.uniform(0.0, 0.1)), 0.5 - float(at.random.uniform(0.0, 0.1))),
            (0.0, at.drawn("height_m")),
        )
        for k, low in enumerate((-goods_m - 0.05, 0.05))
    ]
    shelves = [
        at.box(f"shelf {k + 1}", _half(long_m), _half(1.0), (low, low + 0.1))
        for k, low in enumerate((1.15, 2.2))
    ]
    return Thing((*goods, *shelves, *at.feet(long_m, 1.0, 2.3, 0.08)))


@kind()
def truck(at: Frame) -> Thing:
    """A fork-lift: its body, and two low forks ahead of it, their tops 0.16 m high."""
    is_ahead = at.random.random() < 0.5
    fork, body = ((0.5, 1.6), (-1.2, 0.5)) if is_ahead else ((-1.6, -0.5), (-0.5, 1.2))
    forks = [
        at.box(f"fork {k + 1}", fork, (low, low + 0.14), (0.06, 0.16))
        for k, low in enumerate((-0.35, 0.21))
    ]
    return Thing((at.box("body", body, _half(1.0), (0.0, 2.0)), *forks))


@kind(long_m=(1.0, 2.5), wide_m=(0.5, 1.0), depth_m=(0.3, 0.8))
def ditch(at: Frame) -> Thing:
    """A hole in a level floor."""
    hole = at.box("", at.half("long_m"), at.half("wide_m"), (0.0, 1.0))
    return Thing(hole=(hole.x, hole.y, at.drawn("depth_m")))


@kind(size_m=(0.8, 1.6))
def mat(at: Frame) -> Thing:
    """Black, 4 mm thick; nothing comes back from it from beyond 3 m."""
    flat = at.box("", at.half("size_m"), at.half("size_m"), (0.0, 0.004))
    return Thing((replace(flat, material=BLACK),))


@kind(size_m=(1.0, 2.0), height_m=(0.16, 0.35), density_per_m=(3.0, 8.0))
def grass(at: Frame) -> Thing:
    """Stalks that beams go into and wheels through."""
    tuft = at.box("", at.half("size_m"), at.half("size_m"), (0.0, at.drawn("height_m")))
    return Thing((replace(tuft, material=soft(at.drawn("density_per_m"))),))


@kind(long_m=(1.5, 3.0))
def pane(at: Frame) -> Thing:
    """Glass, 2 m high, on a skirting of 0.25 m that every beam sees."""
    along = at.half("long_m")
    glass = replace(at.box("glass", along, _half(0.02), (0.25, 2.0)), material=GLASS)
    return Thing((at.box("skirting", along, _half(0.10), (0.0, 0.25)), glass))


@kind(long_m=(2.0, 4.0), height_m=(0.006, 0.006))
def cable(at: Frame) -> Thing:
    """A cable cover that the robot rolls over, and nods."""
    return Thing((at.box("", at.half("long_m"), _half(0.2), (0.0, at.drawn("height_m"))),))


@kind(size_m=(0.8, 2.0), friction=(0.3, 0.5))
def puddle(at: Frame) -> Thing:
    """Slippery ground."""
    flat = at.box("", at.half("size_m"), at.half("size_m"), (0.0, 1.0))
    return Thing(patches=(Patch(at.name, flat.x, flat.y, at.drawn("friction")),))


def lifted(shape: Shape, low_m: float, high_m: float) -> Shape:
    """A thing's part on ground between two heights: nothing of it is lower than it was made."""
    assert isinstance(shape, Solid | Pillar)
    low = low_m - FOOT_M if shape.z[0] == 0.0 else high_m + shape.z[0]
    return replace(shape, z=(low, high_m + shape.z[1]))
