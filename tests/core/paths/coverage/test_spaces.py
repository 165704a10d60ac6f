"""Sweeps through passages that a disc does not pass: all rooms, on the floor, and back."""

import math

import pytest
import shapely

from core.paths.coverage.measures import band_of
from core.paths.coverage.plan import plan_coverage
from core.paths.coverage.spaces import plan_all_spaces
from core.paths.geometry.rings import joined
from core.paths.geometry.shaped_ways import Shape, off_floor_m2
from core.paths.geometry.ways import Way, turns_along
from core.paths.records import CoveragePlan, Machine

LONG = [(0.5, 0.25), (-0.5, 0.25), (-0.5, -0.25), (0.5, -0.25)]
MACHINE = Machine(radius_m=math.hypot(0.5, 0.25), clearance_m=0.02, width_m=0.5, overlap_m=0.02)
SHAPE = Shape(LONG, MACHINE.clearance_m)
ROOMS = [shapely.box(x, 0, x + 2.8, 3) for x in (0, 3, 6)]
DOORS = [shapely.box(2.7, 1, 3.1, 1.7), shapely.box(5.7, 1, 6.1, 1.7)]
FLAT = shapely.union_all([*ROOMS, *DOORS])
SHUT = shapely.union_all([*ROOMS, DOORS[0]])


def checked(plan: CoveragePlan, floor: shapely.Geometry) -> CoveragePlan:
    """It holds what each plan must."""
    for before, after in zip(plan.segments[:-1], plan.segments[1:], strict=True):
        assert after.points[0] == pytest.approx(before.points[-1], abs=1e-9)
        assert after.kind != before.kind
    points = joined([segment.points for segment in plan.segments])
    assert off_floor_m2(floor, SHAPE, Way(points, turns_along(points))) < 1e-9
    band = band_of(plan.segments, MACHINE.width_m)
    assert plan.covered.difference(band).area < 1e-9
    assert plan.covered.area + plan.uncovered.area == pytest.approx(plan.reachable.area)
    assert plan.reachable.area + plan.unreachable.area == pytest.approx(floor.area)
    return plan


def test_all_rooms_behind_narrow_doors_are_swept_and_it_comes_back() -> None:
    alone = plan_coverage(FLAT, MACHINE, dock=(1.4, 1.5))
    plan = checked(plan_all_spaces(FLAT, MACHINE, SHAPE, dock=(1.4, 1.5)), FLAT)
    assert plan.reachable.area == pytest.approx(3 * alone.reachable.area, rel=0.02)
    assert plan.covered.area > 0.97 * plan.reachable.area
    assert plan.segments[0].points[0] == pytest.approx((1.4, 1.5))
    assert plan.segments[-1].points[-1] == pytest.approx((1.4, 1.5))


def test_without_a_dock_it_ends_with_a_sweep_and_what_no_door_leads_to_is_told() -> None:
    plan = checked(plan_all_spaces(SHUT, MACHINE, SHAPE, start=(1.4, 1.5)), SHUT)
    assert plan.segments[-1].kind == "sweep"
    assert plan.unreachable.covers(ROOMS[2])
    assert len(plan.space.geoms) == 2


def test_one_room_is_the_plan_of_its_disc() -> None:
    plan = plan_all_spaces(ROOMS[0], MACHINE, SHAPE, dock=(1.4, 1.5))
    alone = plan_coverage(ROOMS[0], MACHINE, dock=(1.4, 1.5))
    points, those = (joined([s.points for s in one.segments]) for one in (plan, alone))
    assert points == pytest.approx(those)
