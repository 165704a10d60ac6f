"""Closed lines joined to one, and the corners that their outlines are spared."""

import math

import numpy as np
import shapely

from core.paths.coverage.contours import contours_of
from core.paths.coverage.corners import with_few_corners
from core.paths.coverage.loops import joined_loops
from core.paths.coverage.measures import swept_by
from core.paths.geometry.rings import length_of
from core.paths.geometry.visibility import VisibilityGraph

SPACING_M = 0.5
SPACE = shapely.box(0, 0, 7, 5).difference(shapely.Point(2.5, 2.2).buffer(0.6))


def test_contours_become_one_closed_line_that_is_no_longer_and_sweeps_nearly_the_same() -> None:
    lines = contours_of(SPACE, SPACING_M)
    assert len(lines) > 4
    [loop] = joined_loops(lines, VisibilityGraph(SPACE), SPACING_M)
    assert math.dist(loop[0], loop[-1]) < 1e-9
    assert SPACE.buffer(1e-6).covers(shapely.LineString(loop))
    assert length_of(loop) < 1.02 * sum(length_of(line) for line in lines)
    before, after = swept_by(lines, 0.25), swept_by([loop], 0.25)
    assert after.intersection(before).area > 0.97 * before.area


def test_lines_that_are_far_apart_or_parted_by_a_wall_stay_alone() -> None:
    space = shapely.box(0, 0, 9, 3).difference(shapely.box(3.99, 0.1, 4.01, 2.9))
    squares = [shapely.box(x, 1, x + 0.9, 2) for x in (0.5, 3.05, 4.05, 7.9)]
    lines = [shapely.get_coordinates(square.exterior) for square in squares]
    assert len(joined_loops(lines, VisibilityGraph(space), SPACING_M)) == 4
    assert len(joined_loops(lines, VisibilityGraph(shapely.box(0, 0, 9, 3)), SPACING_M)) == 3


def test_arcs_round_a_pillar_get_fewer_corners_and_never_come_nearer_to_it() -> None:
    thin = with_few_corners(SPACE, 0.02)
    assert SPACE.buffer(1e-6).covers(thin)
    assert len(shapely.get_coordinates(thin)) < 0.5 * len(shapely.get_coordinates(SPACE))
    assert SPACE.hausdorff_distance(thin) < 0.03


def test_a_pillar_in_a_bay_that_is_as_narrow_keeps_its_corners() -> None:
    pillar = shapely.Point(0, 0).buffer(1.0, quad_segs=8)
    tight = pillar.buffer(0.004).difference(pillar)
    assert tight.buffer(1e-6).covers(with_few_corners(tight, 0.1))
    bow = np.array([[0, 0], [4, 0], [4, 4], [2, 1], [0, 4]], dtype=float)
    assert with_few_corners(shapely.Polygon(bow), 0.1).equals(shapely.Polygon(bow))
