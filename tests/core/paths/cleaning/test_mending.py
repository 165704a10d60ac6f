"""A path is mended: its rest is kept, and goes round what has come to stand on it."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import Polygon

from core.paths.cleaning.mending import ASIDE_M, mended
from core.paths.geometry.visibility import VisibilityGraph
from core.paths.records import Segment
from tests.support.cases import examples

ROOM = shapely.box(0.0, 0.0, 6.0, 4.0)
LANES = np.array([[1, 1], [5, 1], [5, 2], [1, 2], [1, 3], [5, 3]], np.float64)
HERE = np.array([0.5, 1.0])


def mend(space: Polygon, has_work: object = None, rest: np.ndarray = LANES) -> tuple[Segment, ...]:
    works = has_work or (lambda x, y: True)
    return mended(rest, HERE, VisibilityGraph(space), works)  # type: ignore[arg-type]


def length(segments: tuple[Segment, ...], kind: str) -> float:
    return float(sum(shapely.LineString(one.points).length for one in segments if one.kind == kind))


def test_a_path_that_nothing_bars_stays_as_it_was() -> None:
    travel, sweep = mend(ROOM)
    assert (travel.kind, sweep.kind) == ("travel", "sweep")
    assert travel.points.tolist() == [[0.5, 1.0], [1.0, 1.0]]
    assert sweep.points == pytest.approx(LANES)


def test_beside_what_has_come_a_little_nearer_it_is_moved_and_no_stretch_is_left_out() -> None:
    nearer = ROOM.difference(shapely.box(2.0, 0.0, 4.0, 1.0 + ASIDE_M - 0.02))
    segments = mend(nearer)
    (sweep,) = (one for one in segments if one.kind == "sweep")
    line = shapely.LineString(sweep.points)
    assert nearer.buffer(1e-6).covers(line)
    assert line.hausdorff_distance(shapely.LineString(LANES)) < ASIDE_M
    assert length(segments, "travel") == pytest.approx(0.5)


def test_what_stands_on_it_parts_it_and_the_way_goes_round() -> None:
    space = ROOM.difference(shapely.box(2.5, 0.85, 3.5, 1.5))
    segments = mend(space)
    assert [one.kind for one in segments] == ["travel", "sweep", "travel", "sweep"]
    assert segments[1].points[-1] == pytest.approx([2.5, 1.0], abs=ASIDE_M)
    assert segments[3].points[0] == pytest.approx([3.5, 1.0], abs=ASIDE_M)
    assert length(segments, "sweep") == pytest.approx(13.0, abs=2 * ASIDE_M)


def test_a_path_that_is_broken_up_is_none() -> None:
    posts = [shapely.box(x, 0.4, x + 0.4, 3.6) for x in (1.5, 2.5, 3.5)]
    assert mend(ROOM.difference(shapely.union_all(posts))) == ()


def test_what_is_clean_is_left_out_and_what_is_short_too() -> None:
    segments = mend(ROOM, lambda x, y: y > 1.5 or 3.0 < x < 3.2)
    assert [one.kind for one in segments] == ["travel", "sweep"]
    assert segments[1].points[0] == pytest.approx([5.0, 1.5], abs=0.1)
    assert mend(ROOM, lambda x, y: False) == ()
    assert mend(ROOM, rest=LANES[:1]) == ()
    assert mend(ROOM, rest=LANES[:0]) == ()


PLACES = st.tuples(st.floats(-0.5, 6.5), st.floats(-0.5, 4.5))
BOXES = st.lists(
    st.builds(
        lambda at, a, b: shapely.box(at[0], at[1], at[0] + a, at[1] + b),
        PLACES, st.floats(0.02, 2.0), st.floats(0.02, 2.0),
    ),
    max_size=4,
)  # fmt: skip


@settings(max_examples=examples(60))
@given(rest=st.lists(PLACES, min_size=2, max_size=8, unique=True), boxes=BOXES)
def test_every_metre_lies_in_the_space_and_begins_where_the_last_ended(
    rest: list[tuple[float, float]], boxes: list[Polygon]
) -> None:
    left = ROOM.difference(shapely.union_all(boxes)).buffer(-0.05)
    spaces = [one for one in getattr(left, "geoms", [left]) if one.area > 0.01]
    if not spaces:
        return
    space = max(spaces, key=lambda one: one.area)
    here = np.array(space.representative_point().coords[0])
    at = here
    for one in mended(np.array(rest), here, VisibilityGraph(space), lambda x, y: True):
        assert math.dist(at, one.points[0]) < 1e-3
        assert space.buffer(1e-3).covers(shapely.LineString(one.points))
        at = one.points[-1]
