"""Contours: how far apart they lie, and where they begin beside what is clean."""

import numpy as np
import pytest
import shapely

from core.paths.coverage.contours import contour_pieces, contours_of
from core.paths.coverage.raster import Raster
from core.paths.records import Machine

MACHINE = Machine(radius_m=0.2, clearance_m=0.0, width_m=0.4, overlap_m=0.1)
SPACE = shapely.box(0, 0, 4, 3)
FLOOR = shapely.box(-0.2, -0.2, 4.2, 3.2)


def test_contours_lie_exactly_one_spacing_apart_until_there_is_no_room() -> None:
    rings = [shapely.LinearRing(line) for line in contours_of(SPACE, 0.3)]
    assert len(rings) == 5
    for k, ring in enumerate(rings):
        assert ring.bounds == pytest.approx((0.3 * k, 0.3 * k, 4 - 0.3 * k, 3 - 0.3 * k), abs=1e-6)


def test_beside_clean_floor_the_first_contour_overlaps_as_neighbours_do() -> None:
    todo = [FLOOR.intersection(shapely.box(2, -1, 9, 9))]
    pieces = contour_pieces(SPACE, todo, MACHINE, Raster(todo, MACHINE.width_m))
    low_x = min(way[:, 0].min() for piece in pieces for way in piece.variants)
    assert low_x == pytest.approx(2.0 - MACHINE.overlap_m + MACHINE.width_m / 2, abs=0.01)


def test_a_strip_between_clean_floor_that_has_no_room_for_a_contour_gets_a_lane() -> None:
    todo = [shapely.box(1.9, -0.2, 2.1, 3.2)]
    [piece] = contour_pieces(SPACE, todo, MACHINE, Raster(todo, MACHINE.width_m))
    band = shapely.LineString(piece.variants[0]).buffer(MACHINE.width_m / 2)
    assert todo[0].difference(band).area < 0.01
    assert np.ptp(piece.variants[0][:, 1]) > 2.5


def test_parts_that_overlap_or_cross_themselves_by_rounding_are_planned() -> None:
    bow = shapely.Polygon([(2, 0), (4, 2), (4, 0), (2, 2)])
    todo = [bow, shapely.box(3, 0, 4, 2), shapely.box(3, 1, 4, 3)]
    assert contour_pieces(SPACE, todo, MACHINE, Raster(todo, MACHINE.width_m))
