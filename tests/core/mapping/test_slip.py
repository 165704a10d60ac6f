"""How far off a wall seems: by sweeps that are cast at it from places where the robot is not."""

import math

import numpy as np
import pytest

from core.grid.ring import RingGrid
from core.mapping.body import BodyPose
from core.mapping.rays import Sweep
from core.mapping.slip import LOW_M, MOST_M, FaceMatcher

WALL_M, LENS_M, FALL, BEAMS = 4.05, 1.0, 0.13, 61
AHEAD = (1.0, 0.0)


def seen(
    matcher: FaceMatcher, x_m: float, ahead_m: float = 0.0, *, heading: tuple[float, float] = AHEAD,
    height_m: float | None = None, skewed: float = 0.0,
) -> float | None:  # fmt: skip
    """What a sweep from x tells, if the pose is so far ahead of that: of a wall across the way.

    height_m: of all returns over the ground, else as the wall has it. skewed: the wall's slope.
    """
    bearings = np.radians(np.linspace(-15.0, 15.0, BEAMS))
    rays = np.column_stack([np.cos(bearings), np.sin(bearings), np.full(BEAMS, -FALL)])
    ranges_m = (WALL_M - x_m) / (rays[:, 0] - skewed * rays[:, 1])
    heights_m = LENS_M - FALL * ranges_m if height_m is None else np.full(BEAMS, height_m)
    lenses = np.tile([x_m + ahead_m, 0.0, LENS_M], (BEAMS, 1))
    body = BodyPose(x_m + ahead_m, 0.0, 0.0, heading, (0.0, 0.0), x_m)
    sweep = Sweep(x_m, lenses, rays, ranges_m[None, :])
    return matcher.maybe_offset_m(sweep, heights_m, body)


def drive_up(height_m: float | None = None, skewed: float = 0.0) -> FaceMatcher:
    """A matcher that has seen the wall from a metre of the way."""
    matcher = FaceMatcher(RingGrid(101, 0.2), BEAMS)
    for x_m in np.arange(0.0, 1.0, 0.02):
        seen(matcher, float(x_m), height_m=height_m, skewed=skewed)
    return matcher


@pytest.mark.parametrize("ahead_m", [0.0, 0.06, -0.06, 0.18])
def test_a_wall_tells_how_far_the_pose_is_ahead(ahead_m: float) -> None:
    assert seen(drive_up(), 1.0, ahead_m) == pytest.approx(ahead_m, abs=0.005)


def test_what_is_farther_off_is_another_wall() -> None:
    assert seen(drive_up(), 1.0, MOST_M + 0.05) is None


def test_a_top_a_slope_and_what_looks_aside_tell_nothing() -> None:
    assert seen(drive_up(height_m=0.5), 1.0, height_m=0.5) is None
    assert seen(drive_up(height_m=LOW_M - 0.01), 1.0, height_m=LOW_M - 0.01) is None
    assert seen(drive_up(skewed=0.5), 1.0, skewed=0.5) is None
    assert seen(drive_up(skewed=0.2), 1.0, skewed=0.2) is not None


@pytest.mark.parametrize(("turned_deg", "is_new"), [(15.0, False), (25.0, True)])
def test_who_has_turned_too_far_begins_anew(turned_deg: float, is_new: bool) -> None:
    turned = math.radians(turned_deg)
    heading = math.cos(turned), math.sin(turned)
    assert (seen(drive_up(), 1.0, heading=heading) is None) == is_new


def test_what_the_grid_has_forgotten_tells_nothing() -> None:
    grid = RingGrid(101, 0.2)
    matcher = FaceMatcher(grid, BEAMS)
    for x_m in np.arange(0.0, 1.0, 0.02):
        seen(matcher, float(x_m))
    assert seen(matcher, 1.0) is not None
    grid.erase()
    assert seen(matcher, 1.0) is None
