"""Coverage paths on floors by chance and on nasty ones: inside, complete, honest about the rest."""

import math
from itertools import pairwise

import numpy as np
import pytest
import shapely
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from core.paths.coverage.measures import Motion, measures, swept_by
from core.paths.coverage.plan import FIRST, PRICES, plan_coverage
from core.paths.geometry.rings import joined, length_of
from core.paths.geometry.space import FloorError, repaired
from core.paths.geometry.visibility import bends_of, graph_of
from core.paths.records import CoveragePlan, Machine
from core.records import F64
from tests.core.paths.floors import KINDS, VACUUM
from tests.support.cases import examples

MOTION = Motion(speed_mps=0.3, accel_mps2=0.5, turn_radps=1.5)
HALL = shapely.box(0, 0, 3, 2)
PLAIN = Machine(radius_m=0.2, clearance_m=0.05, width_m=0.3, overlap_m=0.05)


def path_of(plan: CoveragePlan) -> F64:
    return joined([segment.points for segment in plan.segments])


def planned(floor: BaseGeometry, machine: Machine = VACUUM) -> CoveragePlan | None:
    """None where the machine has no room at all, which the planner must say."""
    try:
        return plan_coverage(floor, machine)
    except FloorError as error:
        assert "no room" in str(error)  # noqa: PT017
        return None


@settings(max_examples=examples(5), deadline=None)
@given(kind=st.sampled_from(sorted(KINDS)), seed=st.integers(0, 10**6))
def test_every_metre_lies_inside_and_segments_join_and_what_is_missed_is_told(
    kind: str, seed: int
) -> None:
    floor = KINDS[kind](seed)
    plan = planned(floor)
    if plan is None:
        return
    ends = [(a.points[-1], b.points[0]) for a, b in pairwise(plan.segments)]
    assert all(np.array_equal(a, b) for a, b in ends)
    path = path_of(plan)
    outside = swept_by([path], VACUUM.radius_m).difference(floor.buffer(1e-7))
    assert outside.area < 1e-9
    band = swept_by([s.points for s in plan.segments if s.kind == "sweep"], VACUUM.width_m / 2)
    missed = plan.reachable.difference(band)
    assert missed.symmetric_difference(plan.uncovered).area < 1e-3
    whole = plan.reachable.union(plan.unreachable)
    assert whole.symmetric_difference(repaired(floor)).area < 1e-3
    assert plan.uncovered.area < 0.03 * plan.reachable.area + 0.01


ROOM = shapely.box(0, 0, 8, 7)
WITH_PILLAR = ROOM.difference(shapely.box(4, 3, 4.3, 3.3))


@pytest.mark.parametrize("floor", [ROOM, WITH_PILLAR])
def test_no_strips_are_left_along_walls_and_between_bands(floor: Polygon) -> None:
    machine = Machine(radius_m=0.35, clearance_m=0.065, width_m=0.6, overlap_m=0.01)
    plan = plan_coverage(floor, machine, (0.5, 0.5), (0.5, 0.5))
    assert plan.uncovered.area < 0.004 * plan.reachable.area


@pytest.mark.parametrize("gap_m", [0.302, 0.31])
def test_one_tight_passage_costs_no_more_than_its_own_ways(gap_m: float) -> None:
    posts = [shapely.box(x, y, x + 0.1, y + 0.1) for x in (1, 2, 3) for y in (1, 2)]
    other, door = shapely.box(4.2, 0, 6, 3), shapely.box(3.9, 1, 4.3, 1 + gap_m)
    floor = shapely.box(0, 0, 4, 3).difference(shapely.union_all(posts))
    machine = Machine(radius_m=0.15, clearance_m=0.0, width_m=0.3, overlap_m=0.02)
    plan = plan_coverage(shapely.union_all([floor, other, door]), machine)
    assert plan.uncovered.area < 0.01 * plan.reachable.area
    graph = graph_of(plan.space.geoms[0])
    assert len(graph.nodes) < 0.5 * len(bends_of(plan.space.geoms[0])[0])


def test_a_corridor_as_wide_as_the_tool_is_driven_once() -> None:
    machine = Machine(radius_m=0.15, clearance_m=0.0, width_m=0.3, overlap_m=0.0)
    plan = plan_coverage(shapely.box(0, 0, 10, 0.302), machine)
    assert sum(length_of(segment.points) for segment in plan.segments) < 10.0
    assert plan.uncovered.area < 0.01 * plan.reachable.area
    there = plan_coverage(shapely.box(0, 0, 10, 0.302), machine, dock=(0.2, 0.15))
    assert there.segments[-1].points[-1] == pytest.approx((0.2, 0.15), abs=0.01)


def test_where_all_is_clean_the_way_to_the_dock_is_left() -> None:
    plan = plan_coverage(HALL, VACUUM, (0.5, 0.5), (2.5, 1.5), clean=HALL)
    [way] = plan.segments
    assert (way.kind, way.points.tolist()) == ("travel", [[0.5, 0.5], [2.5, 1.5]])
    assert plan_coverage(HALL, VACUUM, (0.5, 0.5), clean=HALL).segments == ()


SPIKE = Polygon([(0, 0), (2, 0), (2, 1), (5, 1), (2, 1), (2, 2), (0, 2)])
BOW = Polygon([(0, 0), (2, 2), (2, 0), (0, 2)])
TOUCHING = Polygon(HALL.exterior, [[(1, 0), (1.5, 1), (2, 0)], [(1.5, 1), (1, 2), (2, 2)]])
NESTED = Polygon(
    HALL.exterior, [shapely.box(0.6, 0.6, 1.4, 1.4).exterior, shapely.box(0.8, 0.8, 1, 1).exterior]
)
SPECKS = shapely.union_all([HALL, *(shapely.box(4 + k, 0, 4.05 + k, 0.05) for k in range(5))])
SAME = Polygon([(0, 0), (0, 0), (2, 0), (2, 0), (2, 2), (0, 2), (0, 1), (0, 1), (0, 0)])


@pytest.mark.parametrize(
    "floor", [SPIKE, BOW, TOUCHING, NESTED, SPECKS, SAME, shapely.GeometryCollection([HALL])]
)
def test_spiky_crossing_touching_and_nested_rings_and_specks_are_planned(
    floor: BaseGeometry,
) -> None:
    plan = plan_coverage(floor, VACUUM)
    assert plan.uncovered.area < 0.02 * plan.reachable.area
    assert swept_by([path_of(plan)], 0.15).difference(repaired(floor).buffer(1e-7)).area < 1e-9


@pytest.mark.parametrize(
    ("floor", "said"),
    [
        (Polygon(), "widest place has 0.000 m"),
        (shapely.box(0, 0, 5, 0.2), "needs 0.15 m around its centre, the widest place has 0.100 m"),
        (Polygon([(0, 0), (math.inf, 0), (1, 1)]), "must be finite numbers"),
        (shapely.LineString([(0, 0), (1, 1)]), "no room"),
    ],
)
def test_a_floor_without_room_is_an_error_that_says_how_much_there_is(
    floor: BaseGeometry, said: str
) -> None:
    with pytest.raises(FloorError, match=said):
        plan_coverage(floor, VACUUM)


def test_lanes_lie_exactly_as_far_apart_as_asked_and_only_the_last_overlaps() -> None:
    plan = plan_coverage(HALL, PLAIN, angle_rad=0.0, is_refined=False)
    path = path_of(plan)
    is_lane = np.abs(np.diff(path[:, 1])) < 1e-6
    heights = np.unique(np.round(path[1:][is_lane, 1], 4))
    gaps = np.sort(np.diff(heights))
    assert heights[0] == pytest.approx(0.25, abs=0.002)
    assert heights[-1] == pytest.approx(1.75, abs=0.002)
    np.testing.assert_allclose(gaps[-6:] if len(gaps) > 6 else gaps[1:], 0.25, atol=2e-3)
    assert gaps.max() < 0.25 + 1e-3


def test_the_path_begins_at_the_start_and_ends_at_the_dock() -> None:
    floor = shapely.union_all([HALL, shapely.box(2.9, 0.5, 5, 1.4)])
    plan = plan_coverage(floor, VACUUM, start=(0.3, 0.3), dock=(4.7, 0.9))
    path = path_of(plan)
    np.testing.assert_allclose(path[0], (0.3, 0.3), atol=1e-6)
    np.testing.assert_allclose(path[-1], (4.7, 0.9), atol=1e-6)
    assert plan_coverage(floor, VACUUM, dock=(4.7, 0.9)).segments[0].points[0] == pytest.approx(
        (4.7, 0.9), abs=1e-6
    )
    with pytest.raises(FloorError, match=r"start: 9,9 is .* m from where the machine fits"):
        plan_coverage(floor, VACUUM, start=(9.0, 9.0))


def test_rooms_are_done_one_after_the_other() -> None:
    left, right = shapely.box(0, 0, 2, 2), shapely.box(2, 0, 4, 2)
    wall = shapely.box(1.95, 0.9, 2.05, 2)
    plan = plan_coverage(
        shapely.box(0, 0, 4, 2).difference(wall), VACUUM, start=(3.5, 0.5), rooms=[left, right]
    )
    middles = (path_of(plan)[1:] + path_of(plan)[:-1]) / 2
    far = middles[np.abs(middles[:, 0] - 2) > 0.35]
    is_left = far[:, 0] < 2
    assert not is_left[0]
    assert np.count_nonzero(np.diff(is_left.astype(int))) == 1
    assert plan.uncovered.area < 0.01 * plan.reachable.area


def test_what_is_clean_is_not_swept_again_and_a_hole_that_appears_is_gone_round() -> None:
    first = plan_coverage(HALL, VACUUM)
    whole = measures(first, HALL, VACUUM, MOTION)
    clean = shapely.box(0, 0, 1.5, 2)
    box = shapely.box(2.2, 0.8, 2.4, 1.1)
    floor = HALL.difference(box)
    rest = plan_coverage(floor, VACUUM, start=(0.3, 0.3), clean=clean)
    told = measures(rest, floor, VACUUM, MOTION)
    assert told.outside_m2 < 1e-9
    assert told.length_m < 0.75 * whole.length_m
    assert rest.uncovered.area < 0.02 * rest.reachable.area
    done = plan_coverage(floor, VACUUM, start=(0.3, 0.3), clean=HALL)
    assert sum(len(s.points) for s in done.segments if s.kind == "sweep") == 0
    assert done.uncovered.is_empty


@settings(max_examples=examples(2), deadline=None)
@given(seed=st.integers(0, 10**6), done=st.floats(0.05, 0.9), x=st.floats(0.1, 0.9))
def test_an_old_path_is_mended_or_something_better_is_driven(
    seed: int, done: float, x: float
) -> None:
    """Behind its first part something comes to stand on the rest of it."""
    floor = KINDS["rooms"](seed)
    plan = plan_coverage(floor, VACUUM)
    path = path_of(plan)
    k = max(1, int(done * (len(path) - 1)))
    new = shapely.Point(path[k:].mean(axis=0)).buffer(0.1 + 0.1 * x)
    free, here = floor.difference(new), (float(path[k, 0]), float(path[k, 1]))
    assume(free.boundary.distance(shapely.Point(here)) > VACUUM.margin_m)
    clean = swept_by([path[: k + 1]], VACUUM.width_m / 2)
    worth_m2 = []
    for old in (None, path[k:]):
        rest = plan_coverage(free, VACUUM, here, clean=clean, old=old)
        outside = swept_by([path_of(rest)], VACUUM.radius_m).difference(free.buffer(1e-7))
        assert outside.area < 1e-9
        band = swept_by([s.points for s in rest.segments], VACUUM.width_m / 2).difference(clean)
        length_m = sum(shapely.LineString(s.points).length for s in rest.segments)
        worth_m2.append(band.area - PRICES[0][-1] * VACUUM.width_m * length_m)
    assert worth_m2[1] > worth_m2[0] - 0.02


def test_the_old_path_goes_on_where_a_new_one_buys_a_little_floor_at_a_lower_price() -> None:
    floor = KINDS["rooms"](10)
    path = path_of(plan_coverage(floor, VACUUM))
    k = int(0.4 * (len(path) - 1))
    free = floor.difference(shapely.Point(path[k:].mean(axis=0)).buffer(0.15))
    clean = swept_by([path[: k + 1]], VACUUM.width_m / 2)
    here = float(path[k, 0]), float(path[k, 1])
    new_m, old_m = (
        length_of(path_of(plan_coverage(free, VACUUM, here, clean=clean, old=old, prices=FIRST)))
        for old in (None, path[k:])
    )
    assert old_m < 0.95 * new_m


def test_where_nothing_has_changed_the_old_path_goes_on() -> None:
    floor = KINDS["rooms"](3)
    path = path_of(plan_coverage(floor, VACUUM, None, (0.5, 0.5)))
    k = len(path) // 3
    clean = swept_by([path[: k + 1]], VACUUM.width_m / 2)
    here = float(path[k, 0]), float(path[k, 1])
    dock = float(path[0, 0]), float(path[0, 1])
    rest = path_of(plan_coverage(floor, VACUUM, here, dock, clean=clean, old=path[k:]))
    left_m = shapely.LineString(path[k:]).length
    assert shapely.LineString(rest).length < 1.01 * left_m
    near = shapely.LineString(path[k:]).buffer(0.05)
    assert shapely.LineString(rest).intersection(near).length > 0.8 * left_m


def test_a_chair_leg_splits_lanes_and_not_the_hall() -> None:
    """A leg of 4 cm in the middle of a hall costs little more than a hall without it."""
    leg = HALL.difference(shapely.box(1.48, 0.98, 1.52, 1.02))
    without, with_leg = (
        measures(plan_coverage(floor, VACUUM), floor, VACUUM, MOTION) for floor in (HALL, leg)
    )
    assert with_leg.length_m < 1.1 * without.length_m
    assert with_leg.covered_of_reachable > 0.98


@pytest.mark.slow
@example(seed=0)
@settings(max_examples=examples(2), deadline=None)
@given(seed=st.integers(0, 10**6))
def test_furnished_rooms_are_covered_in_little_more_than_the_ideal_length(seed: int) -> None:
    floor = KINDS["rooms"](seed)
    plan = planned(floor)
    if plan is not None and plan.reachable.area > 1.0:
        told = measures(plan, floor, VACUUM, MOTION)
        assert told.covered_of_reachable > 0.975
        assert told.length_ratio < 1.5


def test_the_same_floor_gives_the_same_plan() -> None:
    floor = KINDS["rooms"](7)
    first, second = (path_of(plan_coverage(floor, VACUUM)) for _ in range(2))
    np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("radius_m", -0.1, "radius_m: must be from 0 to 100, is -0.1"),
        ("width_m", 0.0, "width_m: must be from 0.01 to 100, is 0"),
        ("overlap_m", 0.29, "overlap_m: must be at most 0.8 of width_m 0.3, is 0.29"),
        ("clearance_m", math.nan, "clearance_m: must be from 0 to 100, is nan"),
    ],
)
def test_a_machine_that_cannot_be_is_refused(key: str, value: float, said: str) -> None:
    given = {"radius_m": 0.15, "clearance_m": 0.0, "width_m": 0.3, "overlap_m": 0.0}
    with pytest.raises(ValueError, match=said):
        Machine(**{**given, key: value})
