"""A plane by sums, against least squares of the linear algebra library."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.mapping.plane_fit import NO_POINTS, plane_of_sums, with_point

NUMBER = st.floats(-2.0, 2.0)
POINTS = st.lists(st.tuples(NUMBER, NUMBER, NUMBER, st.floats(0.1, 10.0)), min_size=1, max_size=25)


@given(points=POINTS)
def test_it_is_the_plane_of_least_squares_that_is_rather_level(
    points: list[tuple[float, float, float, float]],
) -> None:
    level, sums = 0.5, NO_POINTS
    for u, v, z, w in points:
        sums = with_point(sums, u, v, z, w)
    u, v, z, w = np.array(points).T
    root, none = np.sqrt(w), np.zeros(2)
    A = np.vstack([root[:, None] * np.column_stack([np.ones_like(u), u, v]), np.zeros((2, 3))])
    A[-2, 1] = A[-1, 2] = np.sqrt(level)
    expected, *_ = np.linalg.lstsq(A, np.concatenate([root * z, none]), rcond=None)
    assert plane_of_sums(sums, level, np.inf) == pytest.approx(tuple(expected), abs=1e-6)


def test_it_is_no_steeper_than_it_may_be_and_goes_through_the_middle_of_its_points() -> None:
    sums = with_point(with_point(NO_POINTS, 1.0, 0.0, 1.0, 1.0), 3.0, 0.0, 9.0, 1.0)
    assert plane_of_sums(sums, 1e-9, 0.5) == pytest.approx((4.0, 0.5, 0.0))
