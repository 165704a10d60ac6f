"""Contours: closed lines along walls, and along each other further inside, one spacing apart.

A machine that follows them turns at corners alone; lanes cost it a turn of one spacing at each end,
which sweeps hardly anything. Where a floor is partly clean, the outermost contour lies beside what
is clean as it lies beside its neighbour.
Source: Held, On the computational geometry of pocket machining, 1991 (contour-parallel).
"""

from collections.abc import Sequence

import shapely
from shapely import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from core.paths.coverage.corners import with_few_corners
from core.paths.coverage.measures import swept_by
from core.paths.coverage.raster import NONE, Raster, edges_along
from core.paths.coverage.sweep import Piece, Sweeper
from core.paths.geometry.rings import Ring, length_of
from core.paths.geometry.space import grown, opened, polygons_in
from core.paths.records import Machine
from core.records import F64

ENTRIES = 24  # places at most at which a contour may be begun and left
ROUND = 0.03  # of the spacing: by about that the outermost is off what bulges into the area
SMOOTH = 0.02  # of the spacing: corners of contours may move by that
CORNER = 2.0  # spacings from a contour to the corner of the next one, at most
LEAST = 0.1  # of what it would win in the open: a contour that wins less is left out
SLIVER = 0.03  # of the width: what is thinner is no floor that is clean, or that is left
REST = 0.6  # of a square of the width: more that is left beside what is clean gets lanes
GRID_M = 1e-6  # on which areas are subtracted
SHUT_M = 1e-6  # between the ends of a contour


def contours_of(area: Polygon, spacing_m: float) -> list[F64]:
    """Closed lines (n, 2), the outermost ones first: that of the area, and each inside of it."""
    found: list[F64] = []
    layer = [with_few_corners(area, ROUND * spacing_m)]
    while layer:
        for one in layer:
            found += [shapely.get_coordinates(r) for r in (one.exterior, *one.interiors)]
        inner = shapely.buffer(
            MultiPolygon(layer), -spacing_m, join_style="mitre", mitre_limit=CORNER
        )
        layer = polygons_in(shapely.simplify(inner, SMOOTH * spacing_m))
    return found


def contour_pieces(
    part: Polygon, todo: Sequence[Polygon], machine: Machine, raster: Raster
) -> list[Piece]:
    """A part of the space in contours, and what they leave in lanes; the raster counts both.

    Args:
        todo: what is to be swept; elsewhere it is clean or no floor.
    """
    spacing_m, width_m = machine.spacing_m, machine.width_m
    shapely.prepare(part)
    todo = [area for area in todo if part.dwithin(area, width_m)]  # the tool gets to no other
    clean = _clean_beside(part, todo, width_m)
    lines = list[F64]()
    off_m = spacing_m - width_m / 2 + SLIVER * width_m
    for area in polygons_in(_without(part, grown(clean, off_m))):
        for line in contours_of(area, spacing_m):
            edges = edges_along(line)
            if raster.area(raster.gain(NONE, edges)) > LEAST * width_m * length_of(line):
                raster.gain(NONE, edges, keep=True)
                lines.append(line)
    found = [Piece((line,)) for line in lines]
    if clean.is_empty:
        return found
    left = polygons_in(_without(MultiPolygon(list(todo)), swept_by(lines, width_m / 2)))
    large = [area for area in left if area.area > REST * width_m**2 or not lines]
    for area in polygons_in(opened(MultiPolygon(large), SLIVER * width_m)):
        if area.area > REST * width_m**2 or not lines:
            for strip in polygons_in(part.intersection(grown(area, SLIVER * width_m))):
                found += Sweeper(strip, spacing_m).best_pieces(raster)[0]
    return found


def _without(area: BaseGeometry, other: BaseGeometry) -> BaseGeometry:
    """Of any two areas the difference, on a grid: turned polygons may touch by rounding alone."""
    a, b = (MultiPolygon(polygons_in(shapely.make_valid(each))) for each in (area, other))
    return shapely.difference(a, b, grid_size=GRID_M)


def _clean_beside(part: Polygon, todo: Sequence[Polygon], width_m: float) -> BaseGeometry:
    """What the tool would sweep from a part of the space though it is clean; slivers left out."""
    swept = _without(grown(part, width_m / 2), MultiPolygon(list(todo)))
    return shapely.buffer(swept, -SLIVER * width_m)


def entries_of(line: F64, spacing_m: float) -> tuple[F64, ...]:
    """The same contour, begun at some places."""
    ring = Ring(line)
    count = max(1, min(ENTRIES, int(ring.length_m / spacing_m)))
    return tuple(
        ring.ahead(k * ring.length_m / count, ring.length_m - SHUT_M) for k in range(count)
    )
