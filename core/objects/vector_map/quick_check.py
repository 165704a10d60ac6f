"""A quick look: do some rays of a frame meet what the map expects there? Then nothing has changed.

It judges only whether a whole frame is worth its cost. It changes nothing, frees nothing, and in
doubt asks for the whole frame.
"""

import math

import numpy as np
from msgspec import Struct

from core.objects.records import Floats
from core.objects.vector_map.object_map import ObjectMap
from core.objects.vector_map.settings import QuickCheckSettings
from jit import kernel


class QuickCheck(Struct, frozen=True, eq=False):
    """What a quick look found."""

    agrees: bool  # False: take the whole frame
    reason: str  # why not; "" where it agrees
    compared: int  # rays that could be compared
    nearer: int  # of those, met something before the map has it
    further: int  # and met nothing where the map has something


@kernel
def _cast(edges: Floats, x: float, y: float, bearings: Floats, most: float, ranges: Floats) -> None:
    """Fills ranges (n,) from (x, y) along bearings to the nearest edge (m, 4), at most `most`."""
    for k in range(bearings.shape[0]):
        dx, dy = math.cos(bearings[k]), math.sin(bearings[k])
        nearest = most
        for m in range(edges.shape[0]):
            ax, ay = edges[m, 0] - x, edges[m, 1] - y
            ex, ey = edges[m, 2] - edges[m, 0], edges[m, 3] - edges[m, 1]
            cross = dx * ey - dy * ex
            if cross == 0.0:
                continue
            along, share = (ax * ey - ay * ex) / cross, (ax * dy - ay * dx) / cross
            if 0.0 <= share <= 1.0 and 0.0 < along < nearest:
                nearest = along
        ranges[k] = nearest


def expected_ranges(
    objects: ObjectMap, origin: tuple[float, float], bearings_rad: Floats, max_range_m: float
) -> Floats:
    """How far rays go from a place of the map until they meet an object or a wall: (n,) m.

    Args:
        origin: x and y, m.
        bearings_rad: (n,) map frame, counter-clockwise from x.
        max_range_m: what lies further is not looked for; rays that meet nothing have this range.
    """
    x, y = origin
    far = x - max_range_m, y - max_range_m, x + max_range_m, y + max_range_m
    found, walls = objects.near(far)
    edges = [np.hstack([one.polygon, np.roll(one.polygon, -1, axis=0)]) for one in found]
    edges += [wall.segments for wall in walls]
    ranges = np.empty(len(bearings_rad))
    rows = np.ascontiguousarray(np.vstack(edges)) if edges else np.zeros((0, 4))
    _cast(rows, float(x), float(y), np.asarray(bearings_rad, np.float64), max_range_m, ranges)
    return ranges


def quick_check(
    objects: ObjectMap,
    origin: tuple[float, float],
    bearings_rad: Floats,
    ranges_m: Floats,
    settings: QuickCheckSettings,
) -> QuickCheck:
    """Compare measured ranges with those that the map expects.

    A ray may also meet what its neighbours expect: at an edge, a little noise decides which.

    Args:
        bearings_rad: (n,) rising, map frame.
        ranges_m: (n,) measured over the floor plane; NaN: no measurement, inf: met nothing.

    Raises:
        ValueError: bearings and ranges are not as many.
    """
    if np.shape(bearings_rad) != np.shape(ranges_m) or len(bearings_rad) < 3:
        raise ValueError(
            f"bearings_rad, ranges_m: must be as many, at least 3; are {len(bearings_rad)} and"
            f" {len(ranges_m)}"
        )
    s = settings
    expected = expected_ranges(objects, origin, bearings_rad, s.max_range_m)
    padded = np.concatenate([expected[:1], expected, expected[-1:]])
    around = np.stack([padded[:-2], expected, padded[2:]])
    known = ~np.isnan(ranges_m)
    measured = np.minimum(ranges_m, s.max_range_m)
    nearer = int((known & (measured < around.min(axis=0) - s.tolerance_m)).sum())
    further = int((known & (measured > around.max(axis=0) + s.tolerance_m)).sum())
    unknown = 1.0 - float(known.mean())
    reason = ""
    if unknown > s.most_unknown:
        reason = f"{unknown:.0%} of the rays have no measurement"
    elif nearer or further:
        reason = f"{nearer} rays end before what the map has there, {further} behind it"
    return QuickCheck(reason == "", reason, int(known.sum()), nearer, further)
