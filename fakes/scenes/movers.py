"""What moves or comes and goes in a scene: people on their way, boxes that are taken away.

All by a timetable in seconds since the world's begin. They do not see the robot and nothing stops
them; the robot drives through them. (Of a `RollingWorld`, what is put down waits for it.) Map
frame, metres.
"""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fakes.scenes.solids import Span

F64 = npt.NDArray[np.float64]
LEG_M, LEG_RADIUS_M, LEG_ASIDE_M, LEG_SWING_M = 0.85, 0.07, 0.10, 0.25
STRIDE_M = 1.4  # two steps


@dataclass(frozen=True, slots=True)
class Part:
    """An upright cylinder of a mover, or, where `half_m` is given, an upright box.

    Args:
        aside_m: to the left of the way; swing_m: how far it swings ahead and back, every stride.
    """

    z: Span
    radius_m: float = 0.0
    half_m: tuple[float, float] | None = None  # along x and y, whichever way it goes
    aside_m: float = 0.0
    swing_m: float = 0.0


@dataclass(frozen=True, slots=True)
class Mover:
    """Parts that follow waypoints at an even speed; before and after they stand.

    Args:
        returns: walks back and forth for ever instead of standing at the last waypoint.
        from_s, until_s: when it is there at all.
    """

    name: str
    parts: tuple[Part, ...]
    waypoints: tuple[tuple[float, float], ...]
    speed_mps: float = 0.0
    start_s: float = 0.0
    returns: bool = False
    from_s: float = -math.inf
    until_s: float = math.inf

    def is_there(self, t_s: F64) -> npt.NDArray[np.bool_]:
        return np.asarray((t_s >= self.from_s) & (t_s < self.until_s))

    def middles_m(self, part: Part, t_s: F64) -> F64:
        """x, y (n, 2) of the middle of a part at instants (n,)."""
        points = np.array(self.waypoints, dtype=float)
        if len(points) == 1:
            return np.repeat(points, len(t_s), axis=0)
        steps = np.diff(points, axis=0)
        ends_m = np.concatenate([[0.0], np.cumsum(np.hypot(*steps.T))])
        gone_m = np.maximum(0.0, self.speed_mps * (t_s - self.start_s))
        phase = np.where(self.returns | (gone_m < ends_m[-1]), gone_m, 0.0) * math.tau / STRIDE_M
        if self.returns:
            gone_m = ends_m[-1] - np.abs(ends_m[-1] - gone_m % (2 * ends_m[-1]))
        gone_m = np.minimum(gone_m, ends_m[-1])
        leg = np.clip(np.searchsorted(ends_m, gone_m, side="right") - 1, 0, len(steps) - 1)
        ahead = (steps / np.diff(ends_m)[:, None])[leg]
        middles = points[leg] + (gone_m - ends_m[leg])[:, None] * ahead
        left = np.stack([-ahead[:, 1], ahead[:, 0]], -1)
        swing_m = part.swing_m * np.sin(phase)[:, None]
        return np.asarray(middles + part.aside_m * left + swing_m * ahead)

    def tops_m(self, x: F64, y: F64, t_s: float) -> F64:
        """Height of its top over the points (n,) at an instant; -inf beside it or while away."""
        tops = np.full(np.broadcast(x, y).shape, -np.inf)
        at_s = np.array([t_s])
        for part in self.parts if self.is_there(at_s)[0] else ():
            ((x_m, y_m),) = self.middles_m(part, at_s)
            if part.half_m is None:
                inside = np.hypot(x - x_m, y - y_m) <= part.radius_m
            else:
                inside = (np.abs(x - x_m) <= part.half_m[0]) & (np.abs(y - y_m) <= part.half_m[1])
            tops = np.maximum(tops, np.where(inside, part.z[1], -np.inf))
        return tops


def person(
    name: str,
    waypoints: tuple[tuple[float, float], ...],
    speed_mps: float = 1.2,
    start_s: float = 0.0,
    legs: bool = True,
    height_m: float = 1.75,
    radius_m: float = 0.22,
    returns: bool = False,
    from_s: float = -math.inf,
    until_s: float = math.inf,
) -> Mover:
    """Somebody who walks; with legs that swing, or as one round body down to the floor."""
    sides = (1.0, -1.0) if legs else ()
    parts = [Part((LEG_M if legs else 0.0, height_m), radius_m)] + [
        Part((0.0, LEG_M), LEG_RADIUS_M, None, side * LEG_ASIDE_M, side * LEG_SWING_M)
        for side in sides
    ]
    return Mover(name, tuple(parts), waypoints, speed_mps, start_s, returns, from_s, until_s)


def box(
    name: str, x: Span, y: Span, z: Span, from_s: float = -math.inf, until_s: float = math.inf
) -> Mover:
    """A box that is put there at an instant, or taken away."""
    half_m = ((x[1] - x[0]) / 2, (y[1] - y[0]) / 2)
    middle = (sum(x) / 2, sum(y) / 2)
    return Mover(name, (Part(z, 0.0, half_m),), (middle,), from_s=from_s, until_s=until_s)
