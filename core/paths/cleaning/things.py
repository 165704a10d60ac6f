"""What is known to stand or to move on a floor, and which of its sides were seen.

A view of the floor ends a little before what stands there. Before a side that was seen, that gap is
floor. Behind what was seen from one side alone, it may be the rest of the thing.
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
import shapely
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from core.records import F64, Flags

WALL_M = 0.01  # half of a wall's thickness: it is known as a line
GAP_M = 0.12  # from the end of a view to what it ends at, at most


class Thing(NamedTuple):
    """One of them, map frame, metres."""

    outline: Polygon
    seen: F64 | None = None  # (k, 4) x1, y1, x2, y2, outside to the right; None: all around


def thing_of(outline: F64, finished: Flags) -> Thing:
    """One of a map of objects: corners (n, 2) counter-clockwise, and which sides were seen."""
    sides = np.hstack([outline, np.roll(outline, -1, axis=0)])
    return Thing(Polygon(outline), sides[finished])


def new_thing(outline: F64 | Polygon) -> Thing:
    """One that no map holds yet: nobody knows how far it reaches."""
    return Thing(Polygon(outline), np.zeros((0, 4)))


def walls(lines_m: F64, aside_m: float = WALL_M) -> list[Thing]:
    """Lines (n, 4), x1, y1, x2, y2, as things that reach so far to either side."""
    lines = shapely.linestrings(lines_m.reshape(-1, 2, 2))
    return [Thing(one) for one in shapely.buffer(lines, aside_m, cap_style="square")]


def outlines(things: Iterable[Thing]) -> list[Polygon]:
    return [one.outline for one in things]


def before(things: Sequence[Thing]) -> BaseGeometry:
    """All places that lie before what was seen of things, as far as views may end before it."""
    whole = [one.outline for one in things if one.seen is None]
    sides = [one.seen for one in things if one.seen is not None and len(one.seen)]
    near = [shapely.buffer(shapely.union_all(whole), GAP_M, quad_segs=2)]
    if sides:
        a, b = np.vstack(sides)[:, :2], np.vstack(sides)[:, 2:]
        along = GAP_M * (b - a) / np.maximum(np.hypot(*(b - a).T), 1e-9)[:, None]
        out = np.column_stack([along[:, 1], -along[:, 0]])
        a, b = a - along, b + along  # round the corner between two of them
        near += list(shapely.polygons(np.stack([a, a + out, b + out, b], axis=1)))
    return shapely.union_all(near)
