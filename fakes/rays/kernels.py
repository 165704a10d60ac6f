"""Rays for kernels: what they may meet, how they come in pencils, and which can meet what.

Each target is tried only by beams whose azimuth lies within what it covers of the horizon. A beam
may be `subs` rays that share an azimuth but for a little: the beam's width. A sweep's rays come in
pencils, one of each beam at a time, so that the rays that meet a target lie side by side.
"""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from jit import allocating_kernel, kernel

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]
BOX, CYLINDER, HULL = 0, 1, 2
PLAIN, BLACK, GLASS = 0, 1, 2
TINY = 1e-12  # instead of a zero that something is divided by
TURN_RAD = 2.0 * math.pi
SLACK_RAD = 1e-6  # by which a target covers more of the horizon than its corners say


class Targets(NamedTuple):
    """What stands still, m of them; map frame, metres."""

    kinds: I64  # (m,) BOX, CYLINDER, HULL
    lows: F64  # (m, 3) lowest corner of the upright box around each,
    highs: F64  # (m, 3) and its highest
    first_planes: I64  # (m + 1,) of a HULL, within `planes`; the next one's where it ends
    planes: F64  # (p, 4) of all: outward normal, and how far along it the plane lies
    materials: I64  # (m,) PLAIN, BLACK, GLASS


class Passers(NamedTuple):
    """Upright parts of what moves, m of them: where they are is known at k instants of a sweep."""

    first_s: float  # of these instants,
    every_s: float  # and how far they are apart
    middles_m: F64  # (k, m, 2)
    radii_m: F64  # (m,); a box has 0
    halves_m: F64  # (m, 2) of a box
    spans_m: F64  # (m, 2) from which height to which
    stays_s: F64  # (m, 2) from when until when it is there


class Horizon(NamedTuple):
    """Where a sweep's beams look, all n of them: it tells which can meet a target."""

    azimuths: F64  # (n,) of each beam's middle, map frame, without jumps; growing if `in_order`
    in_order: bool
    room: tuple[tuple[float, float], tuple[float, float]]  # x, y between which all begin
    spread_rad: float  # by which rays of a beam may be beside its middle


class Pencil(NamedTuple):
    """One ray of each beam of a sweep, by axis; map frame."""

    begins: F64  # (3, n) x, y, z, m
    ways: F64  # (3, n) of unit length
    inverses: F64  # (3, n) one over these, never endless


@kernel
def invert(pencil: Pencil) -> None:
    """Bring `inverses` to the ways."""
    for axis in range(3):  # each in one go, so that many are divided at once
        ways, inverses = pencil.ways[axis], pencil.inverses[axis]
        for i in range(len(ways)):
            way = ways[i]
            inverses[i] = 1.0 / (way if abs(way) >= TINY else TINY)


@kernel
def _covered(low_x: float, high_x: float, low_y: float, high_y: float) -> tuple[float, float]:
    """Least and greatest azimuth that a rectangle covers, seen from (0, 0); a turn from within."""
    if low_x <= 0.0 <= high_x and low_y <= 0.0 <= high_y:
        return -math.pi, math.pi
    middle = math.atan2((low_y + high_y) / 2, (low_x + high_x) / 2)
    least, most = middle, middle
    for x in (low_x, high_x):
        for y in (low_y, high_y):
            away = math.atan2(y, x) - middle
            away -= TURN_RAD * round(away / TURN_RAD)
            least, most = min(least, middle + away), max(most, middle + away)
    return least, most


@kernel
def _range_of(azimuths: F64, least: float, most: float) -> tuple[int, int]:
    """The first beam in least..most and the one after the last."""
    first = np.searchsorted(azimuths, least)
    return int(first), int(np.searchsorted(azimuths, most, side="right"))


@kernel
def spans_of_beams(horizon: Horizon, low: F64, high: F64, spans: I64) -> None:
    """Which beams can meet what lies in a box.

    Args:
        low, high: (3,) corners; heights don't matter.
        spans: (3, 2) takes the first beam of each span and the one after its last; may be empty.
    """
    n = len(horizon.azimuths)
    spans[:] = 0
    (x0, y0), (x1, y1) = horizon.room
    least, most = _covered(low[0] - x1, high[0] - x0, low[1] - y1, high[1] - y0)
    if not horizon.in_order or most - least >= TURN_RAD:
        spans[0, 1] = n
        return
    wider = horizon.spread_rad + SLACK_RAD
    base = TURN_RAD * round((horizon.azimuths[n // 2] - (least + most) / 2) / TURN_RAD)
    for turn in range(3):
        off = base + (turn - 1) * TURN_RAD
        spans[turn, 0], spans[turn, 1] = _range_of(
            horizon.azimuths, least + off - wider, most + off + wider
        )


@allocating_kernel
def spans_of_targets(horizon: Horizon, targets: Targets) -> I64:
    """Which beams can meet each of them: (m, 3, 2) as of `spans_of_beams`."""
    spans = np.empty((len(targets.kinds), 3, 2), dtype=np.int64)
    for j in range(len(spans)):
        spans_of_beams(horizon, targets.lows[j], targets.highs[j], spans[j])
    return spans


@allocating_kernel
def spans_of_passers(horizon: Horizon, passers: Passers) -> I64:
    """The same of what moves, wherever it is during the sweep."""
    spans = np.empty((len(passers.radii_m), 3, 2), dtype=np.int64)
    low, high = np.zeros(3), np.zeros(3)
    for j in range(len(spans)):
        for axis in range(2):
            least, most = math.inf, -math.inf
            for place in passers.middles_m[:, j, axis]:
                least, most = min(least, place), max(most, place)
            half = max(passers.radii_m[j], passers.halves_m[j, axis])
            low[axis], high[axis] = least - half, most + half
        spans_of_beams(horizon, low, high, spans[j])
    return spans
