"""A tiny world in closed formulas, for tests of the maps: rays against ground and solids.

The ground is a polyline of height along one direction, level across it, so that steps, ditches and
ramps are exact; solids are boxes and cylinders, which may move. Metres, frame map: the robot of
`tests/support/maps/flat_ride.py` begins at the origin, looking along +x.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

F64 = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]
FAR_M = 300.0  # where profiles end
REACH_M = 20.0  # of the scanner
DIVERGENCE = 0.5  # of the step between beams: how far apart the halves of one beam are
DEPTH_M = 0.4  # two echoes of one beam must be so far apart


@dataclass(frozen=True)
class Profile:
    """Height z over u, a polyline of points (u, z); u grows along `yaw_rad` of the map.

    Two points of the same u are a vertical face.
    """

    points: tuple[tuple[float, float], ...] = ((-FAR_M, 0.0), (FAR_M, 0.0))
    yaw_rad: float = 0.0

    def along(self, xy: F64) -> F64:
        """u of places (n, 2)."""
        return np.asarray(xy[:, 0] * math.cos(self.yaw_rad) + xy[:, 1] * math.sin(self.yaw_rad))

    def height(self, xy: F64) -> F64:
        """z of places (n, 2); of a vertical face, either end."""
        u, z = np.array(self.points).T
        return np.asarray(np.interp(self.along(xy), u, z))

    def hit(self, lenses: F64, rays: F64, _t_s: F64) -> F64:
        """Range (n,) at which each ray first meets the ground, inf where it does not."""
        u0, du = self.along(lenses), self.along(rays)
        z0, dz = lenses[:, 2], rays[:, 2]
        nearest = np.full(len(rays), np.inf)
        for (ua, za), (ub, zb) in zip(self.points, self.points[1:], strict=False):
            eu, ez = ub - ua, zb - za
            with np.errstate(divide="ignore", invalid="ignore"):
                cross = du * ez - dz * eu
                r = ((ua - u0) * ez - (za - z0) * eu) / cross
                share = ((ua - u0) * dz - (za - z0) * du) / cross
            met = (r > 0) & (share >= 0) & (share <= 1)
            nearest = np.where(met, np.minimum(nearest, r), nearest)
        return nearest


def ditch(near_m: float, width_m: float, yaw_rad: float = 0.0) -> Profile:
    """A ditch across the way, 1 m deep, whose near edge lies at u = near_m."""
    far_m = near_m + width_m
    edges = ((near_m, 0.0), (near_m, -1.0), (far_m, -1.0), (far_m, 0.0))
    return Profile(((-FAR_M, 0.0), *edges, (FAR_M, 0.0)), yaw_rad)


def kerb(at_m: float, rise_m: float) -> Profile:
    """A step up (or down, if negative) across the way."""
    return Profile(((-FAR_M, 0.0), (at_m, 0.0), (at_m, rise_m), (FAR_M, rise_m)))


def ramp(at_m: float, slope_rad: float, length_m: float = FAR_M) -> Profile:
    """Level ground, a ramp from u = at_m of a level length, level ground again."""
    rise_m = math.tan(slope_rad) * length_m
    end_m = at_m + length_m
    return Profile(((-FAR_M, 0.0), (at_m, 0.0), (end_m, rise_m), (end_m + FAR_M, rise_m)))


class Solid(Protocol):
    """Something that rays meet."""

    def hit(self, lenses: F64, rays: F64, t_s: F64) -> F64:
        """Range (n,) at which each ray (n, 3) first meets it at its instant (n,); inf: never."""


def _slab(lens: F64, ray: F64, low: float, high: float) -> tuple[F64, F64]:
    """Ranges at which rays enter and leave low..high along one axis."""
    with np.errstate(divide="ignore", invalid="ignore"):
        a, b = (low - lens) / ray, (high - lens) / ray
    inside = (lens >= low) & (lens <= high)
    enter = np.where(ray == 0, np.where(inside, -np.inf, np.inf), np.minimum(a, b))
    leave = np.where(ray == 0, np.where(inside, np.inf, -np.inf), np.maximum(a, b))
    return enter, leave


@dataclass(frozen=True)
class Box:
    """A box between two corners, turned by `yaw_rad` about its middle, there from..until."""

    low: tuple[float, float, float]
    high: tuple[float, float, float]
    yaw_rad: float = 0.0
    from_s: float = -math.inf
    until_s: float = math.inf

    def span(self, lenses: F64, rays: F64, t_s: F64) -> tuple[F64, F64]:
        """Ranges (n,) at which rays enter and leave; (inf, -inf) where they pass by."""
        cx, cy = (0.5 * (a + b) for a, b in zip(self.low[:2], self.high[:2], strict=True))
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        x, y = lenses[:, 0] - cx, lenses[:, 1] - cy
        own = (
            (cx + c * x + s * y, c * rays[:, 0] + s * rays[:, 1]),
            (cy - s * x + c * y, c * rays[:, 1] - s * rays[:, 0]),
            (lenses[:, 2], rays[:, 2]),
        )
        enter, leave = np.full(len(rays), -np.inf), np.full(len(rays), np.inf)
        for (lens, ray), low, high in zip(own, self.low, self.high, strict=True):
            a, b = _slab(lens, ray, low, high)
            enter, leave = np.maximum(enter, a), np.minimum(leave, b)
        met = (enter <= leave) & (enter > 0) & (t_s >= self.from_s) & (t_s < self.until_s)
        return np.where(met, enter, np.inf), np.where(met, leave, -np.inf)

    def hit(self, lenses: F64, rays: F64, t_s: F64) -> F64:
        return self.span(lenses, rays, t_s)[0]


@dataclass(frozen=True)
class Cylinder:
    """An upright cylinder on the floor that walks at a steady speed from where it is at t = 0."""

    x_m: float
    y_m: float
    radius_m: float
    top_m: float
    vx_mps: float = 0.0
    vy_mps: float = 0.0

    def place(self, t_s: float) -> tuple[float, float]:
        """Its axis at an instant."""
        return self.x_m + self.vx_mps * t_s, self.y_m + self.vy_mps * t_s

    def hit(self, lenses: F64, rays: F64, t_s: F64) -> F64:
        """Where rays meet its mantle; its lid is not seen from below or from afar."""
        x = lenses[:, 0] - self.x_m - self.vx_mps * t_s
        y = lenses[:, 1] - self.y_m - self.vy_mps * t_s
        a = rays[:, 0] ** 2 + rays[:, 1] ** 2
        b = x * rays[:, 0] + y * rays[:, 1]
        inner = b * b - a * (x * x + y * y - self.radius_m**2)
        r = (-b - np.sqrt(np.maximum(inner, 0.0))) / a
        z = lenses[:, 2] + r * rays[:, 2]
        return np.where((inner > 0) & (r > 0) & (z <= self.top_m), r, np.inf)


@dataclass(frozen=True)
class Grass:
    """A box of stalks: beams go in by chance, `depth_m` in the mean, and echo from behind too."""

    box: Box
    depth_m: float
    echo_twice: float  # share of the beams


def nowhere(points: F64) -> Bools:
    """No place (k, 3) swallows light."""
    return np.zeros(len(points), dtype=np.bool_)


@dataclass
class World:
    """Ground, solids, grass, and places from which nothing comes back."""

    ground: Profile = Profile()
    solids: tuple[Solid, ...] = ()
    grass: tuple[Grass, ...] = ()
    is_black: Callable[[F64], Bools] = nowhere
    noise_m: float = 0.012
    seed: int = 1

    def __post_init__(self) -> None:
        self.random = np.random.default_rng(self.seed)

    def nearest(self, lenses: F64, rays: F64, t_s: F64) -> F64:
        """Range (n,) to the nearest surface along rays (n, 3) at instants (n,); inf: none."""
        things: tuple[Solid, ...] = (self.ground, *self.solids)
        return np.asarray(np.min([thing.hit(lenses, rays, t_s) for thing in things], axis=0))

    def ranges(self, lenses: F64, rays: F64, t_s: F64, echoes: int = 1) -> F64:
        """What the scanner measures (echoes, n): NaN where nothing comes back."""
        if echoes == 2:
            first, second = self._halves(lenses, rays, t_s)
        else:
            first, second = self.nearest(lenses, rays, t_s), np.full(len(rays), np.inf)
        for grass in self.grass:
            first, second = self._through(grass, lenses, rays, t_s, first, second)
        out = np.stack([first, second])[:echoes]
        for echo in out:
            places = lenses + np.where(np.isfinite(echo), echo, 0.0)[:, None] * rays
            echo[~np.isfinite(echo) | (echo > REACH_M) | self.is_black(places)] = np.nan
        noisy = out + self.random.normal(0.0, self.noise_m, out.shape)
        if echoes == 2:  # what comes first is the first
            alone = np.isnan(noisy[0]) & np.isfinite(noisy[1])
            noisy[0, alone], noisy[1, alone] = noisy[1, alone], np.nan
        return noisy

    def _halves(self, lenses: F64, rays: F64, t_s: F64) -> tuple[F64, F64]:
        """A beam has a width: its halves may meet different things, and then echo twice."""
        step = np.gradient(rays, axis=0) * 0.5 * DIVERGENCE
        one = self.nearest(lenses, rays - step, t_s)
        two = self.nearest(lenses, rays + step, t_s)
        near, far = np.minimum(one, two), np.maximum(one, two)
        return near, np.where(far - near > DEPTH_M, far, np.inf)

    def _through(
        self, grass: Grass, lenses: F64, rays: F64, t_s: F64, first: F64, second: F64
    ) -> tuple[F64, F64]:
        """Echoes of beams of which some end within the grass."""
        enter, leave = grass.box.span(lenses, rays, t_s)
        stopped = enter + self.random.exponential(grass.depth_m, len(enter))
        inside = np.isfinite(enter) & (stopped < np.minimum(leave, first))
        twice = inside & (self.random.random(len(enter)) < grass.echo_twice)
        behind = np.where(first - stopped > 0.15, first, np.inf)
        second = np.where(twice, behind, np.where(inside, np.inf, second))
        return np.where(inside, stopped, first), second
