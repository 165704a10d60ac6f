"""What a coverage path is worth, in the figures of the field. Metres, seconds, radians."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from core.paths.geometry.rings import joined, length_of
from core.paths.records import CoveragePlan, Machine, Segment
from core.records import F64

ROUND = 16  # segments of a quarter circle of the band; inside the true one, so too little counts
TURN_RAD = math.radians(5.0)  # a corner of less is driven without a stop


@dataclass(frozen=True, slots=True, kw_only=True)
class Motion:
    """How the machine drives: straight from rest to rest, and turns on the spot."""

    speed_mps: float
    accel_mps2: float
    turn_radps: float


@dataclass(frozen=True, slots=True)
class Measures:
    """Shares are of 1."""

    covered_of_reachable: float  # of what the tool can get to
    covered_of_free: float  # of all free floor
    overlap: float  # swept length x width beyond the area that it covers, of that area
    length_m: float
    length_ratio: float  # path length x width / reachable area; 1 is ideal
    travel_m: float  # without sweeping
    turns: int
    turned_rad: float
    time_s: float
    outside_m2: float  # swept by the machine's whole radius, off the floor: must be 0


def band_of(segments: Sequence[Segment], width_m: float) -> BaseGeometry:
    """All within half the tool's width of what sweeps."""
    lines = [s.points for s in segments if s.kind == "sweep"]
    return swept_by(lines, width_m / 2)


def swept_by(lines: Sequence[F64], reach_m: float) -> BaseGeometry:
    """All within reach of lines (n, 2)."""
    if not lines:
        return shapely.Polygon()
    edges = np.vstack([np.hstack([line[:-1], line[1:]]) for line in lines]).reshape(-1, 2, 2)
    bands = shapely.buffer(shapely.linestrings(edges), reach_m, quad_segs=ROUND)
    return shapely.union_all(bands)


def turns_of(points: F64) -> F64:
    """(n - 2,) radians turned at each inner corner of a path (n, 2), without sign."""
    way = np.diff(points, axis=0)
    heading = np.arctan2(way[:, 1], way[:, 0])
    turn = np.diff(heading)
    return np.abs((turn + math.pi) % (2 * math.pi) - math.pi)


def leg_time(length_m: float, motion: Motion) -> float:
    """Seconds from rest to rest by a trapezoid of speed, or a triangle where it is short.

    >>> leg_time(2.0, Motion(speed_mps=1.0, accel_mps2=1.0, turn_radps=1.0))
    3.0
    >>> leg_time(0.25, Motion(speed_mps=1.0, accel_mps2=1.0, turn_radps=1.0))
    1.0
    """
    ramps_m = motion.speed_mps**2 / motion.accel_mps2
    if length_m < ramps_m:
        return 2 * math.sqrt(length_m / motion.accel_mps2)
    return length_m / motion.speed_mps + motion.speed_mps / motion.accel_mps2


def path_time(points: F64, motion: Motion) -> float:
    """Seconds for a path (n, 2): straight legs, and turns on the spot between them."""
    turned = turns_of(points)
    stops = np.flatnonzero(turned > TURN_RAD) + 1
    bounds = [0, *stops.tolist(), len(points) - 1]
    legs = [length_of(points[a : b + 1]) for a, b in pairwise(bounds)]
    driven_s = sum(leg_time(leg, motion) for leg in legs)
    return driven_s + float(turned[turned > TURN_RAD].sum()) / motion.turn_radps


def measures_of(
    segments: Sequence[Segment],
    free: BaseGeometry,
    reachable: BaseGeometry,
    machine: Machine,
    motion: Motion,
) -> Measures:
    """Of any planner's segments, each of which begins where the one before ends."""
    if not segments:
        return Measures(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0, 0.0, 0.0, 0.0)
    path = joined([segment.points for segment in segments])
    swept_m = sum(length_of(s.points) for s in segments if s.kind == "sweep")
    band = band_of(segments, machine.width_m)
    outside = swept_by([path], machine.radius_m).difference(free)
    area_m2 = band.area
    turned = turns_of(path)
    return Measures(
        covered_of_reachable=band.intersection(reachable).area / reachable.area,
        covered_of_free=band.intersection(free).area / free.area,
        overlap=max(0.0, swept_m * machine.width_m - area_m2) / max(area_m2, 1e-12),
        length_m=length_of(path),
        length_ratio=length_of(path) * machine.width_m / reachable.area,
        travel_m=length_of(path) - swept_m,
        turns=int((turned > TURN_RAD).sum()),
        turned_rad=float(turned[turned > TURN_RAD].sum()),
        time_s=path_time(path, motion),
        outside_m2=outside.area,
    )


def measures(plan: CoveragePlan, free: BaseGeometry, machine: Machine, motion: Motion) -> Measures:
    """Of a plan of ours."""
    return measures_of(plan.segments, free, plan.reachable, machine, motion)
