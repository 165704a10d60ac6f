"""The ground around a place: a plane where it is one, and no wall taken for a ramp."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.mapping.surface.cells import APART, ground_of
from core.mapping.surface.constants import REACH, STEEPEST
from tests.support.maps.ground_cells import RISES, GroundCells

CELL_M, FAR_AWAY_M = 0.2, -50.0
SLOPES = st.floats(-0.1, 0.1)


def laid(slope_x: float, slope_y: float, **more: float) -> GroundCells:
    """A plane z = 0.3 + slope_x x + slope_y y but for the cell at (0, 0)."""
    ground = GroundCells()
    for i in range(-3, 4):
        for j in range(-3, 4):
            if (i, j) != (0, 0):
                x, y = (i + 0.5) * CELL_M, (j + 0.5) * CELL_M
                ground.lay(i, j, 0.3 + slope_x * x + slope_y * y, **more)
    return ground


@given(slope_x=SLOPES, slope_y=SLOPES)
def test_ground_in_a_plane_is_expected_in_that_plane(slope_x: float, slope_y: float) -> None:
    """Seen from its foot: the slopes that are likely beforehand hold it back a little."""
    ground = laid(slope_x, slope_y)
    plane = ground.plane(0, 0, 1e4 * -slope_x, 1e4 * -slope_y)
    assert plane.z_m == pytest.approx(0.3 + 0.1 * slope_x + 0.1 * slope_y, abs=0.005)
    assert (plane.slope_x, plane.slope_y) == pytest.approx((slope_x, slope_y), abs=0.02)
    assert plane.is_before


def test_nothing_around_tells_nothing() -> None:
    assert GroundCells().plane(0, 0, 0.0, 0.0).var_m2 == math.inf


@pytest.mark.parametrize("slope", [0.5, -0.5, 3.0])
def test_ground_is_never_told_steeper_than_a_wheel_climbs(slope: float) -> None:
    ground = laid(slope, -slope)
    for x_m in (FAR_AWAY_M, -FAR_AWAY_M):
        plane = ground.plane(0, 0, x_m, 0.0)
        assert abs(plane.slope_x) <= STEEPEST
        assert abs(plane.slope_y) <= STEEPEST


def test_what_rises_towards_the_robot_does_not_lift_the_ground_before_it() -> None:
    """Ground behind a place that gets higher the nearer it is: the top of a wall, not a ramp."""
    ground = GroundCells()
    for k in range(1, REACH + 1):
        for j in (-1, 0, 1):
            ground.lay(k, j, 0.5 - 0.2 * CELL_M * k)
    nearest = 0.5 - 0.2 * CELL_M * REACH
    free, held = (ground.plane(0, 0, x_m, 0.1) for x_m in (50.0, FAR_AWAY_M))
    assert held.z_m <= nearest + RISES * REACH * CELL_M + 1e-6
    assert free.z_m > held.z_m + 0.04  # seen from the other side it is a ramp
    assert free.is_before
    assert not held.is_before


def test_the_nearest_ground_tells_what_it_is_tied_to_and_how_old_it_is() -> None:
    ground = GroundCells()
    for k in (1, 2, 3):
        ground.lay(k, 0, 0.0, floor_s=float(k))
    ground.lay(-1, 0, 0.0, tied=APART, floor_s=9.0, var_m2=1e-6)
    plane = ground.plane(0, 0, FAR_AWAY_M, 0.0)
    assert (plane.tied, plane.seen_s) == (APART, 9.0)
    assert 1e-6 < plane.var_m2 < 1e-4


def test_where_something_rises_the_ground_is_less_sure_than_that() -> None:
    ground = GroundCells()
    ground.lay(1, 0, 0.4, top_m=0.5)
    assert ground.plane(0, 0, FAR_AWAY_M, 0.0).var_m2 > 0.25
    for k in (-1, 2):
        ground.lay(k, 0, 0.0)
    assert abs(ground.plane(0, 0, FAR_AWAY_M, 0.0).z_m) < 0.01


@given(*[st.floats(-0.02, 0.02)] * 2, st.floats(-30, 30), st.floats(-9, 9))
def test_what_the_attitude_is_always_off_by_moves_ground_by_its_arms(
    static_p: float, static_r: float, arm_m: float, aside_m: float
) -> None:
    ground = GroundCells()
    at = ground.lay(2, -3, 0.7, arm_m=arm_m, aside_m=aside_m)
    ground.own[:] = 0.3, 0.1, 0.2, static_p, static_r  # the fast part has been taken out before
    expected = 0.7 - static_p * arm_m - static_r * aside_m
    assert ground_of(ground.cells[at], ground.own) == pytest.approx(expected, abs=1e-6)
