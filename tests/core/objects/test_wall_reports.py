"""Walls as a planner is told of them: pieces between doors, each under an id of its own."""

from itertools import count

import numpy as np
import pytest
import shapely

from core.objects.vector_map.walls import WallRecord
from core.objects.wall_reports import LONGEST_M, TOP_M, WallReports
from core.records import OBJECT_WALL

SIGMA_M = 0.01


def wall(number: int, *segments: tuple[float, float, float, float]) -> WallRecord:
    return WallRecord(number, np.array(segments).reshape(-1, 4), np.zeros((0, 4)), 1.0, 7.0, 0.9)


def reports() -> WallReports:
    numbers = count(1)
    return WallReports(SIGMA_M, lambda: 3 * next(numbers) + 2)


def test_a_wall_is_a_band_about_its_line_that_ends_at_no_known_height() -> None:
    (one,), gone = reports().changed(wall(4, (1.0, 2.0, 4.0, 6.0)))
    band, line = shapely.Polygon(one.outline_m), shapely.LineString([(1.0, 2.0), (4.0, 6.0)])
    assert shapely.LinearRing(one.outline_m).is_ccw
    assert band.symmetric_difference(line.buffer(3 * SIGMA_M, cap_style="flat")).area < 1e-9
    assert (one.kind, one.bottom_m, one.top_m) == (OBJECT_WALL, 0.0, TOP_M)
    assert (one.velocity_mps, one.confidence, one.seen_s) == ((0.0, 0.0), 0.9, 7.0)
    assert not gone


def test_a_door_that_opens_makes_two_of_one_and_closes_again() -> None:
    told = reports()
    (whole,), _ = told.changed(wall(4, (0.0, 0.0, 5.0, 0.0)))
    (first, behind), gone = told.changed(wall(4, (0.0, 0.0, 2.0, 0.0), (3.0, 0.0, 5.0, 0.0)))
    assert first.id == whole.id != behind.id
    assert not gone
    (again,), gone = told.changed(wall(4, (0.0, 0.0, 5.0, 0.0)))
    assert (again.id, gone) == (whole.id, [behind.id])
    (_, another), _ = told.changed(wall(4, (0.0, 0.0, 2.0, 0.0), (3.0, 0.0, 5.0, 0.0)))
    assert another.id not in (whole.id, behind.id), "an id is used once"


def test_a_wall_that_is_taken_down_takes_all_its_pieces_along() -> None:
    told = reports()
    pieces, _ = told.changed(wall(4, (0.0, 0.0, 2.0, 0.0), (3.0, 0.0, 5.0, 0.0)))
    other, _ = told.changed(wall(5, (0.0, 9.0, 2.0, 9.0)))
    assert len({one.id for one in [*pieces, *other]}) == 3
    assert told.gone(4) == [one.id for one in pieces]
    assert told.gone(4) == told.gone(77) == []


@pytest.mark.parametrize(("length_m", "pieces"), [(LONGEST_M, 1), (2.5 * LONGEST_M, 3)])
def test_a_wall_longer_than_an_outline_can_be_is_cut(length_m: float, pieces: int) -> None:
    found, _ = reports().changed(wall(4, (0.0, 0.0, 0.0, length_m)))
    assert len(found) == len({one.id for one in found}) == pieces
    outlines = [shapely.Polygon(one.outline_m) for one in found]
    assert shapely.union_all(outlines).area == pytest.approx(length_m * 6 * SIGMA_M)
