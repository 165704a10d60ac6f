"""Where a machine's centre may be: the free polygon made narrower by the machine's radius.

The machine is a disc about the point it turns about, so that it may turn anywhere. All polygons
lie in one plane, in metres. Rings that touch, nest, cross themselves or have no area are repaired.
"""

import math

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

SEGMENTS = 12  # of a quarter circle; circles are drawn round the true ones, never inside
SMOOTH_M = 0.0005  # by which corners of the space may move; all of it is kept as distance
SPECK_M2 = 1e-6  # less is no area, but what rounding leaves


class FloorError(Exception):
    """A floor that cannot be planned on, in words."""


def polygons_in(geometry: BaseGeometry) -> list[Polygon]:
    """The polygons of any geometry, specks left out; lines and points have no area."""
    found = []
    for part in shapely.get_parts(geometry):
        if isinstance(part, Polygon):
            if part.area > SPECK_M2:
                found.append(part)
        elif shapely.get_num_geometries(part) > 1:
            found += polygons_in(part)
    return found


def repaired(geometry: BaseGeometry) -> MultiPolygon:
    """The area of any geometry, valid. Raises FloorError: coordinates that are no numbers."""
    if not np.isfinite(shapely.get_coordinates(geometry)).all():
        raise FloorError("coordinates: must be finite numbers")
    made = shapely.make_valid(geometry, method="structure", keep_collapsed=False)
    return MultiPolygon(polygons_in(shapely.union_all(polygons_in(made))))


def grown(geometry: BaseGeometry, by_m: float) -> BaseGeometry:
    """All points within `by_m` of a geometry; circles are drawn outside the true ones."""
    around_m = by_m / math.cos(math.pi / 4 / SEGMENTS)
    return shapely.buffer(geometry, around_m, quad_segs=SEGMENTS)


def kept_m(by_m: float) -> float:
    """How far from straight walls `narrowed` stays: that, and what its circles and corners cost."""
    return by_m / math.cos(math.pi / 4 / SEGMENTS) + SMOOTH_M


def narrowed(free: BaseGeometry, by_m: float) -> MultiPolygon:
    """All points that lie `by_m` or more inside; half a millimetre may be missing, never too much.

    Few corners: the result is smoothed within the margin that is taken for it.
    """
    inside = shapely.buffer(free, -kept_m(by_m), quad_segs=SEGMENTS)
    return MultiPolygon(polygons_in(shapely.make_valid(shapely.simplify(inside, SMOOTH_M))))


def opened(geometry: BaseGeometry, by_m: float) -> BaseGeometry:
    """Without what is thinner than twice that."""
    return shapely.buffer(shapely.buffer(geometry, -by_m), by_m)


def largest(polygons: list[Polygon]) -> Polygon:
    return max(polygons, key=lambda polygon: polygon.area)
