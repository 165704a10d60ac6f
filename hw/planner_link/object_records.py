"""Objects of the vector map as the records of an OBJECTS frame.

A record stands for itself and lies in one frame. An outline of more corners than that holds is told
as a larger one that contains it.
Source: planner link, section 3 (OBJECTS; docs/protocols/planner-link.md).
"""

import math
import struct

import numpy as np

from core.records import F64, OBJECT_STATIC, OBJECT_WALL, ObjectReport

OBJECTS_HEAD = struct.Struct("<BxHHHIII")  # geom_id, count, waiting, look age, digest, first, last
AGE, GONE_REST = struct.Struct("<H"), struct.Struct("<BBI")  # age; kind, corners, id
REST = struct.Struct("<BBIiihhhhBBBx")  # kind, corners, id, x, y, bottom, top, vx, vy, ...
CORNER_BYTES, FEWEST_CORNERS, MOST_CORNERS = 4, 3, 64
GONE = 0  # of a record's kind
ENLARGED = 1 << 0  # flag: the outline is larger than the object's own
FARTHEST_MM, MOST_OFFSET, MOST_UNIT_MM = 2_100_000_000, 32_767, 255
MOST_I16, MOST_AGE_MS = 32_767, 0xFFFF
GROWN_MM = 1.0  # of the enlarged outline: what rounding its corners may take away
BOX = 4  # corners
LEAST_BODY = OBJECTS_HEAD.size + AGE.size + REST.size + CORNER_BYTES * BOX
MOST_BODY = OBJECTS_HEAD.size + AGE.size + REST.size + CORNER_BYTES * MOST_CORNERS


def gone_record(number: int) -> bytes:
    """What follows the age in the record of an object that is no more."""
    return GONE_REST.pack(GONE, 0, number)


def age_ms(now_s: float, seen_s: float) -> int:
    """The age of what was seen, rounded up and saturated; of what was never seen, the most."""
    age = (now_s - seen_s) * 1000
    return MOST_AGE_MS if not age < MOST_AGE_MS else max(0, math.ceil(age - 1e-6))


def maybe_record(told: ObjectReport, most_corners: int) -> bytes | None:
    """What follows the age in an object's record; None: no record can tell it.

    Args:
        most_corners: that a record may have for this receiver, 4 at least.
    """
    outline_mm = np.asarray(told.outline_m, dtype=np.float64).reshape(-1, 2) * 1000
    numbers = (told.bottom_m, told.top_m, *told.velocity_mps, told.confidence)
    is_finite = bool(np.isfinite(outline_mm).all()) and all(map(math.isfinite, numbers))
    if not is_finite or len(outline_mm) < FEWEST_CORNERS or told.bottom_m > told.top_m:
        return None
    if not OBJECT_STATIC <= told.kind <= OBJECT_WALL or not 0 <= told.id < 2**32:
        return None
    flags = ENLARGED if told.enlarged else 0
    if len(outline_mm) > most_corners:
        outline_mm, flags = _larger(outline_mm, most_corners), ENLARGED
        if len(outline_mm) < FEWEST_CORNERS:  # of no area
            return None
    low, high = np.floor(outline_mm.min(axis=0)), np.ceil(outline_mm.max(axis=0))
    unit_mm = max(1, math.ceil(float((high - low).max()) / 2 / (MOST_OFFSET - 2)))
    middle = np.floor((low + high) / 2)
    if float(np.abs(middle).max()) > FARTHEST_MM or unit_mm > MOST_UNIT_MM:
        return None
    if unit_mm > 1:
        outline_mm, flags = _box(low, high, middle, unit_mm), ENLARGED
    offsets = np.rint((outline_mm - middle) / unit_mm).astype("<i2")
    vx, vy = told.velocity_mps
    head = REST.pack(
        *(told.kind, len(offsets), told.id, int(middle[0]), int(middle[1])),
        *(_clipped(math.floor(told.bottom_m * 1000)), _clipped(math.ceil(told.top_m * 1000))),
        *(_clipped(round(vx * 1000)), _clipped(round(vy * 1000))),
        *(round(255 * max(0.0, min(1.0, told.confidence))), flags, unit_mm),
    )
    corners: bytes = offsets.tobytes()
    return head + corners


def _clipped(number: int) -> int:
    return max(-MOST_I16 - 1, min(MOST_I16, number))


def _box(low: F64, high: F64, middle: F64, unit_mm: int) -> F64:
    """(4, 2) mm: the box of an outline, its corners whole units from the middle, outwards."""
    (x0, y0) = np.floor((low - middle) / unit_mm) * unit_mm + middle
    (x1, y1) = np.ceil((high - middle) / unit_mm) * unit_mm + middle
    return np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])


def _larger(outline_mm: F64, most_corners: int) -> F64:
    """(k, 2) mm, counter-clockwise, k at most as many: an outline that contains all of it.

    The convex hull of the millimetres around each corner; or where that has too many corners, what
    lies within the lines that touch it in so many directions.
    """
    around = [np.stack(part, axis=1) for part in _neighbours(outline_mm)]
    hull = _hull(np.concatenate(around))
    if len(hull) <= most_corners:
        return hull
    angles = 2 * math.pi * np.arange(most_corners) / most_corners
    normals = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    middle = hull.mean(axis=0)
    reach = ((hull - middle) @ normals.T).max(axis=0) + GROWN_MM
    after_normals, after_reach = np.roll(normals, -1, axis=0), np.roll(reach, -1)
    # where each line meets the next one: both normals known, a fixed angle apart
    turn = math.sin(2 * math.pi / most_corners)
    x = (reach * after_normals[:, 1] - after_reach * normals[:, 1]) / turn
    y = (after_reach * normals[:, 0] - reach * after_normals[:, 0]) / turn
    return _hull(np.rint(np.stack([x, y], axis=1) + middle))


def _neighbours(points: F64) -> list[tuple[F64, F64]]:
    """x and y of the four whole numbers around each point."""
    (low_x, low_y), (high_x, high_y) = np.floor(points).T, np.ceil(points).T
    return [(low_x, low_y), (low_x, high_y), (high_x, low_y), (high_x, high_y)]


def _hull(points: F64) -> F64:
    """(k, 2) corners of the convex hull, counter-clockwise."""
    ordered = sorted({(float(x), float(y)) for x, y in points})
    halves = [_chain(ordered), _chain(ordered[::-1])]
    return np.array([point for half in halves for point in half[:-1]]).reshape(-1, 2)


def _chain(ordered: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Those of the points that one half of the hull turns left at."""
    chain: list[tuple[float, float]] = []
    for x, y in ordered:
        while len(chain) > 1:
            (x0, y0), (x1, y1) = chain[-2], chain[-1]
            if (x1 - x0) * (y - y0) - (y1 - y0) * (x - x0) > 0.0:
                break
            chain.pop()
        chain.append((x, y))
    return chain
