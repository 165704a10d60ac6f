"""Outlines of many corners as a planner is told them: they contain the thing, and little more."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from core.objects.records import Floats
from core.objects.told_outlines import MOST_CORNERS, STEPS_M, told_outline
from tests.support.cases import examples


def ragged(line: list[tuple[float, float]], wide_m: float, noise_m: float, seed: int) -> Floats:
    """A band along a line, with a corner each few centimetres that is off by chance."""
    band = shapely.LineString(line).buffer(wide_m / 2, cap_style="flat", join_style="mitre")
    ring = np.asarray(shapely.segmentize(band, 0.05).exterior.coords)[:-1]
    return ring + noise_m * np.random.default_rng(seed).uniform(-1.0, 1.0, ring.shape)


@pytest.mark.parametrize("noise_m", [0.005, 0.01, 0.02])
def test_two_walls_that_meet_stay_an_l_and_leave_the_room_between_them(noise_m: float) -> None:
    corner = ragged([(0.0, 3.0), (0.0, 0.0), (4.0, 0.0)], 0.1, noise_m, 3)
    assert len(corner) > 2 * MOST_CORNERS
    told, is_larger = told_outline(corner)
    own, shape = shapely.Polygon(corner), shapely.Polygon(told)
    assert is_larger
    assert len(told) <= MOST_CORNERS
    assert shape.is_valid
    assert shape.covers(own)
    assert shapely.LinearRing(told).is_ccw
    assert shape.hausdorff_distance(own) < 0.1
    assert not shape.intersects(shapely.box(0.2, 0.2, 4.0, 3.0))


def test_few_corners_are_told_as_they_are() -> None:
    box = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])
    told, is_larger = told_outline(box)
    assert told is box
    assert not is_larger


@settings(max_examples=examples(30))
@given(st.integers(0, 10**6), st.integers(65, 300), st.floats(0.05, 0.9))
def test_what_is_told_contains_the_thing_and_grows_by_centimetres(
    seed: int, corners: int, noise: float
) -> None:
    random = np.random.default_rng(seed)
    angle = np.arange(corners) * math.tau / corners
    radius_m = 1.0 + noise * random.uniform(-1.0, 1.0, corners)
    star = radius_m[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    told, is_larger = told_outline(star)
    if not is_larger:
        assert told is star
        return
    shape, own = shapely.Polygon(told), shapely.Polygon(star)
    assert len(told) <= MOST_CORNERS
    assert shape.is_valid
    assert shape.covers(own)
    assert own.buffer(3.0 * STEPS_M[-1]).covers(shape)
