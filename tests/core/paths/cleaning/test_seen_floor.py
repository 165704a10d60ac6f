"""Floor that was seen: free only where a view had it often enough, and never beyond."""

import numpy as np
import shapely

from core.paths.cleaning.seen_floor import SeenFloor
from core.paths.cleaning.swept_floor import SweptFloor

CELL_M, LEAST = 0.05, 2
random = np.random.default_rng(5)


def star(middle: tuple[float, float], corners: int = 40) -> np.ndarray:
    bearings = np.sort(random.uniform(0.0, 2.0 * np.pi, corners))
    reach = 1.5 + 0.5 * np.sin(3.0 * bearings + random.uniform(0.0, 6.0))
    away = np.column_stack([np.cos(bearings), np.sin(bearings)])
    return np.asarray(np.array(middle) + reach[:, None] * away)


def test_all_that_is_free_was_seen_as_often_as_asked() -> None:
    floor, views = SeenFloor((0.3, -0.2), 6.0, CELL_M, LEAST), []
    for _ in range(12):
        views.append(star((random.uniform(-2.0, 2.0), random.uniform(-2.0, 2.0))))
        floor.add(views[-1])
    shapes = [shapely.make_valid(shapely.Polygon(view)) for view in views]
    twice = shapely.union_all([a & b for k, a in enumerate(shapes) for b in shapes[:k]])
    free = floor.free()
    assert free.area > 0.75 * (twice & shapely.box(-2.7, -3.2, 3.3, 2.8)).area
    assert free.difference(twice).area < 1e-6


def test_where_something_stands_is_not_free_until_it_is_seen_again() -> None:
    floor = SeenFloor((0.0, 0.0), 6.0, CELL_M, LEAST)
    view = np.array([[-2.0, -2.0], [2.0, -2.0], [2.0, 2.0], [-2.0, 2.0]])
    person = np.array([[0.1, 0.1], [0.5, 0.1], [0.5, 0.4], [0.1, 0.4]])
    for _ in range(LEAST):
        floor.add(view)
    assert floor.is_free(view)
    floor.doubt(person)
    assert not floor.is_free(view)
    assert floor.free().intersection(shapely.Polygon(person)).area == 0.0
    for _ in range(LEAST - 1):
        floor.add(view)
    assert not floor.is_free(view)
    floor.add(view)
    assert floor.is_free(view)


def test_what_has_moved_leaves_the_floor_as_it_was() -> None:
    floor = SeenFloor((0.0, 0.0), 6.0, CELL_M, LEAST)
    for _ in range(12):
        floor.add(star((random.uniform(-1.0, 1.0), random.uniform(-1.0, 1.0))))
    strip = shapely.get_coordinates(shapely.box(-2.5, -2.5, -2.3, 2.5))[:-1]
    floor.explain([shapely.Polygon(strip)])
    before = floor.count.copy()
    person = 0.3 * star((-6.5, 0.0))
    doubts = [floor.doubt(person + np.array([0.05 * k, 0.0])) for k in range(6)]
    assert floor.count.sum() < before.sum()
    assert not floor.is_free(strip)
    for doubt in doubts:
        floor.restore(doubt)
    np.testing.assert_array_equal(floor.count, before)
    assert floor.is_free(strip)
    doubt = floor.doubt(person)
    floor.explain([])
    floor.restore(doubt)
    assert not floor.is_free(strip)  # nothing explains it any more


def test_what_is_explained_is_free_until_something_stands_there() -> None:
    floor = SeenFloor((0.0, 0.0), 6.0, CELL_M, LEAST)
    strip = shapely.box(1.0, -1.0, 1.2, 1.0)
    ring = shapely.get_coordinates(strip)[:-1]
    floor.explain([strip])
    assert floor.is_free(ring)
    assert floor.area_m2 == 0.0
    floor.doubt(ring)
    assert not floor.is_free(ring)
    floor.explain([strip])
    floor.explain([])
    assert not floor.is_free(ring)


def test_a_speck_that_was_not_seen_bars_no_way_and_what_counts_as_a_thing_does() -> None:
    floor = SeenFloor((0.0, 0.0), 6.0, 0.025, LEAST)
    view = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    inner = 0.9 * view
    for _ in range(LEAST):
        floor.add(view)
    for edge_m, is_free in ((0.02, True), (0.1, False)):
        floor.doubt(edge_m / 2 * view)
        assert floor.is_free(inner) == is_free


def test_an_unseen_row_of_single_cells_is_no_thing_and_a_wider_one_may_be() -> None:
    way = np.array([[-0.5, -0.4], [0.5, -0.4], [0.5, 0.4], [-0.5, 0.4]])
    for rows, is_free in ((1, True), (2, False)):
        floor = SeenFloor((0.0, 0.0), 6.0, 0.025, 1)
        for x0, x1 in ((-1.0, 0.001), (0.025 * rows - 0.001, 1.0)):
            floor.add(np.array([[x0, -1.0], [x1, -1.0], [x1, 1.0], [x0, 1.0]]))
        assert floor.is_free(way) == is_free


def test_outside_and_without_sense_nothing_is_free() -> None:
    floor = SeenFloor((0.0, 0.0), 2.0, CELL_M, LEAST)
    far = np.array([[5.0, 5.0], [6.0, 5.0], [6.0, 6.0]])
    for view in (far, np.zeros((0, 2)), np.full((4, 2), np.nan), 10.0 * far - 20.0):
        floor.add(view)
        floor.doubt(view)
    assert floor.free().is_empty


def test_bands_that_overlap_leave_no_seam_between_them_and_clean_nothing_beside_them() -> None:
    floor = SweptFloor((0.0, 0.0), 6.0, CELL_M)
    bands = [shapely.box(-2.0, low, 2.0, low + 0.62) for low in (-1.01, -0.40, 0.21)]
    for band in bands:
        floor.add(shapely.get_coordinates(band)[:-1])
    swept = shapely.union_all(bands)
    assert swept.covers(floor.area().buffer(-1e-9))
    assert swept.buffer(-CELL_M, join_style="mitre").difference(floor.area()).area < 1e-9
    floor.add(np.array([[2.5, 2.5], [np.nan, 2.5], [2.5, 2.9]]))  # no outline: nothing is swept
    assert swept.covers(floor.area().buffer(-1e-9))
