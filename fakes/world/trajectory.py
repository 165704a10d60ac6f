"""Motions on order for a kinematic world: where the body is at each instant, in closed formulas.

A trajectory takes instants (n,), seconds since the world's begin, and gives poses (n, 6): x, y,
yaw, pitch, roll, z. Map frame, metres and radians; yaw goes on over pi. Before and after its time
it stands.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from fakes.world.rotations import F64

Trajectory = Callable[[F64], F64]

ACCELERATION_MPS2, ACCELERATION_RADPS2 = 0.4, 1.0  # at most, as the driver's


@dataclass(frozen=True, slots=True)
class Leg:
    """A piece of a way: an arc that takes the body from rest to rest.

    `length_m` may be negative: backwards. Either length or angle or both may be zero.
    """

    duration_s: float
    length_m: float = 0.0
    turned_rad: float = 0.0
    ramp_s: float = 0.0  # of the duration, at both ends: getting up to speed and back to rest


def stand(seconds: float) -> Leg:
    return Leg(seconds)


def straight(length_m: float, speed_mps: float) -> Leg:
    """Ahead, or back where the length is negative."""
    return arc(length_m, 0.0, speed_mps)


def arc(length_m: float, turned_rad: float, speed_mps: float) -> Leg:
    """Ahead or back while the body turns evenly with the way.

    Raises:
        ValueError: a turn without a way.
    """
    if turned_rad and not length_m:
        raise ValueError("an arc of no length is a turn")
    duration_s, ramp_s = _times(abs(length_m), speed_mps, ACCELERATION_MPS2)
    return Leg(duration_s, length_m, turned_rad, ramp_s)


def turn(turned_rad: float, rate_radps: float) -> Leg:
    """On the spot; left is positive."""
    duration_s, ramp_s = _times(abs(turned_rad), rate_radps, ACCELERATION_RADPS2)
    return Leg(duration_s, 0.0, turned_rad, ramp_s)


def _times(way: float, speed: float, acceleration: float) -> tuple[float, float]:
    """(duration, ramp) of a way from rest to rest; a short one does not come to its speed."""
    speed = min(speed, math.sqrt(way * acceleration / (math.pi / 2)))
    ramp_s = math.pi / 2 * speed / acceleration
    return (way / speed + ramp_s if way > 0 else 0.0), ramp_s


def _progress(t_s: F64, leg: Leg) -> F64:
    """Share (n,) of a leg that is behind, t_s (n,) after its begin; the speed is smooth."""
    ramp_s, end_s = leg.ramp_s, leg.duration_s
    if ramp_s == 0.0:
        return np.zeros_like(t_s)

    def way(s: F64) -> F64:
        """Along the first half at full speed 1: the speed rises as half a cosine does."""
        rising = np.minimum(s, ramp_s)
        risen = rising / 2 - ramp_s / math.tau * np.sin(math.pi * rising / ramp_s)
        return np.asarray(risen + np.maximum(s - ramp_s, 0.0))

    t_s, whole = np.clip(t_s, 0.0, end_s), end_s - ramp_s
    return np.where(t_s < end_s / 2, way(t_s), whole - way(end_s - t_s)) / whole


class Way:
    """Legs one after the other, on the flat; callable as a trajectory.

    Args:
        start: x, y, yaw at the begin.
    """

    def __init__(self, *legs: Leg, start: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> None:
        self.legs = legs
        self.begins_s = np.concatenate([[0.0], np.cumsum([leg.duration_s for leg in legs])])
        places = [np.array(start, dtype=float)]
        for leg in legs:
            places.append(_along(places[-1], leg, np.ones(1))[0])
        self._places = np.array(places)  # where each leg begins; the last one: where all ends

    @property
    def duration_s(self) -> float:
        return float(self.begins_s[-1])

    def __call__(self, t_s: F64) -> F64:
        poses = np.zeros((len(t_s), 6))
        which = np.searchsorted(self.begins_s, t_s, side="right") - 1
        for k, leg in enumerate(self.legs):
            on_it = which == k
            share = _progress(t_s[on_it] - self.begins_s[k], leg)
            poses[on_it, :3] = _along(self._places[k], leg, share)
        poses[which < 0, :3] = self._places[0]
        poses[which >= len(self.legs), :3] = self._places[-1]
        return poses


def _along(place: F64, leg: Leg, share: F64) -> F64:
    """x, y, yaw (n, 3) after shares (n,) of a leg that begins at a place (3,)."""
    x, y, yaw = place
    turned, gone_m = leg.turned_rad * share, leg.length_m * share
    chord_m = gone_m * np.sinc(turned / math.tau)  # numpy's sinc holds pi already
    heading = yaw + turned / 2
    return np.stack(
        [x + chord_m * np.cos(heading), y + chord_m * np.sin(heading), yaw + turned], -1
    )


def knots(rows: Sequence[Sequence[float]]) -> Trajectory:
    """From rest to rest through rows of (t_s, x, y, yaw, pitch, roll, z), as smooth as a hand."""
    table = np.array(rows, dtype=float)
    if table.ndim != 2 or table.shape[1] != 7 or (np.diff(table[:, 0]) <= 0).any():
        raise ValueError("knots are rows of (t, x, y, yaw, pitch, roll, z) in order of time")

    def poses(t_s: F64) -> F64:
        k = np.clip(np.searchsorted(table[:, 0], t_s, side="right") - 1, 0, max(0, len(table) - 2))
        before, after = table[k], table[np.minimum(k + 1, len(table) - 1)]
        span_s = np.where(after[:, 0] > before[:, 0], after[:, 0] - before[:, 0], 1.0)
        u = np.clip((t_s - before[:, 0]) / span_s, 0.0, 1.0)
        eased = u**3 * (10.0 - 15.0 * u + 6.0 * u**2)  # least jerk
        return np.asarray(before[:, 1:] + eased[:, None] * (after - before)[:, 1:])

    return poses


def held(
    pitch_rad: float = 0.0,
    roll_rad: float = 0.0,
    z_m: float = 0.0,
    place: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Trajectory:
    """Stands for ever, tilted as on objects; `place` is x, y, yaw."""
    return knots([(0.0, *place, pitch_rad, roll_rad, z_m)])


def tilted(
    base: Trajectory, pitch_rad: float, roll_rad: float, z_m: float, from_s: float, takes_s: float
) -> Trajectory:
    """A trajectory that from an instant on is pitched, rolled and raised by so much more."""
    more = knots(
        [(from_s, 0, 0, 0, 0, 0, 0), (from_s + takes_s, 0, 0, 0, pitch_rad, roll_rad, z_m)]
    )
    return lambda t_s: np.asarray(base(t_s) + more(t_s))


def nodding(base: Trajectory, pitch_rad: float, rate_hz: float, from_s: float = 0.0) -> Trajectory:
    """A trajectory whose body pitches to and fro by so much, about its axle's foot."""

    def poses(t_s: F64) -> F64:
        out = np.array(base(t_s))
        since_s = np.maximum(0.0, t_s - from_s)
        fade = np.minimum(1.0, since_s * rate_hz)  # over the first period, so that no rate jumps
        out[:, 3] += pitch_rad * fade * np.sin(math.tau * rate_hz * since_s)
        return out

    return poses


def laps(
    corners: Sequence[Sequence[float]], speed_mps: float, rate_radps: float, stands_s: float
) -> Trajectory:
    """From the origin along x, y of corners and back, over and over; it turns on the spot at each.

    Args:
        stands_s: before it sets out.

    Raises:
        ValueError: no corner lies away from the origin.
    """
    legs, x, y, yaw = [], 0.0, 0.0, 0.0
    for to_x, to_y in (*(corner[:2] for corner in corners), (0.0, 0.0)):
        turned = math.remainder(math.atan2(to_y - y, to_x - x) - yaw, math.tau)
        legs += [turn(turned, rate_radps), straight(math.hypot(to_x - x, to_y - y), speed_mps)]
        x, y, yaw = to_x, to_y, yaw + turned
    turned = math.remainder(-yaw, math.tau)
    lap, a_lap_rad = Way(*legs, turn(turned, rate_radps)), yaw + turned
    if not lap.duration_s:
        raise ValueError("a lap needs a corner away from the origin")

    def poses(t_s: F64) -> F64:
        number, since_s = np.divmod(np.maximum(0.0, t_s - stands_s), lap.duration_s)
        out = lap(since_s)
        out[:, 2] += number * a_lap_rad
        return out

    return poses


@dataclass(frozen=True, slots=True)
class Gait:
    """How a body with legs sways with its steps: yaw and roll once a stride, the rest twice."""

    stride_hz: float = 0.7
    bob_m: float = 0.005
    yaw_rad: float = math.radians(3.0)
    roll_rad: float = math.radians(1.0)
    pitch_rad: float = math.radians(1.0)


def walking(base: Trajectory, gait: Gait, from_s: float) -> Trajectory:
    """A trajectory whose body sways from an instant on, about its origin: also where it turns."""

    def poses(t_s: F64) -> F64:
        out = np.array(base(t_s))
        since_s = np.maximum(0.0, t_s - from_s)
        begun = np.minimum(1.0, since_s * gait.stride_hz)  # of the first stride
        fade = begun**2 * (3.0 - 2.0 * begun)  # so that no rate jumps
        phase = math.tau * gait.stride_hz * since_s
        out[:, 2] += gait.yaw_rad * fade * np.sin(phase)
        out[:, 3] += gait.pitch_rad * fade * np.sin(2 * phase + 1.0)  # nods before it rises
        out[:, 4] += gait.roll_rad * fade * np.sin(phase + 1.0)
        out[:, 5] += gait.bob_m * fade * np.sin(2 * phase)
        return out

    return poses
