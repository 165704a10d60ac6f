"""The places of a beam: in their cells, one each step, others in each scan."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.grid.places import Ring
from core.mapping.along import (
    MOST_PLACES,
    OUTSIDE,
    REACH_M,
    STEP_M,
    first_place_m,
    places_along,
)
from core.mapping.rays import MIN_RANGE_M

WINDOW = Ring(1, -11, 1, 5, 8, 0.25)  # from (0.25, -2.75) to (2.25, -0.75)
DOWN = (0.0, 0.0, -1.0)


def cells(
    lens: tuple[float, float], ray: tuple[float, float, float], first_m: float, end_m: float
) -> list[int]:
    at = np.full(MOST_PLACES, -7, dtype=np.int32)
    origin, along = np.array([*lens, 1.0]), np.array(ray)
    count = places_along(origin, along, first_m, end_m, WINDOW, at)
    assert (at[count:] == -7).all()
    return [int(cell) for cell in at[:count]]


@given(
    st.tuples(st.floats(-1, 4), st.floats(-4, 1)),
    st.floats(-4, 4),
    st.floats(0, 1),
    st.floats(0, 9),
)
def test_each_place_lies_in_its_cell(
    lens: tuple[float, float], turn: float, first_m: float, end_m: float
) -> None:
    ray = (math.cos(turn), math.sin(turn), 0.0)
    found = cells(lens, ray, first_m, end_m)
    assert len(found) == max(0, math.ceil((end_m - first_m) / STEP_M))
    for k, at in enumerate(found):
        u, v = ((lens[n] + (first_m + k * STEP_M) * ray[n]) / WINDOW.cell_m for n in (0, 1))
        if min(abs(u - round(u)), abs(v - round(v))) < 1e-9:
            continue  # on the edge of a cell, to rounding
        i, j = math.floor(u), math.floor(v)
        is_inside = (
            0 <= i - WINDOW.corner_i < WINDOW.size and 0 <= j - WINDOW.corner_j < WINDOW.size
        )
        assert at == (j % WINDOW.size * WINDOW.size + i % WINDOW.size if is_inside else OUTSIDE)


@pytest.mark.parametrize(
    ("x", "y", "at"),
    [
        (0.25, -2.75, 5 * 8 + 1),  # the corner is in the window
        (2.0, -2.75, 5 * 8 + 0),
        (0.25, -1.0, 4 * 8 + 1),
        (0.25, -2.0, 0 * 8 + 1),  # where the ring turns over
        (2.25, -2.75, OUTSIDE),  # that on the other side is not
        (0.25, -0.75, OUTSIDE),
        (math.nextafter(0.25, 0), -2.0, OUTSIDE),
        (0.5, math.nextafter(-2.75, -3), OUTSIDE),
    ],
)
def test_an_edge_belongs_to_the_cell_beyond_it(x: float, y: float, at: int) -> None:
    assert cells((x, y), DOWN, 0.0, STEP_M) == [at]


def test_no_place_is_farther_than_it_reaches() -> None:
    assert len(cells((1.0, -2.0), DOWN, MIN_RANGE_M, 1e9)) == MOST_PLACES - 1
    assert len(cells((1.0, -2.0), DOWN, 0.0, REACH_M + 5.0)) == MOST_PLACES - 1


def test_the_places_of_some_scans_and_beams_leave_nothing_out() -> None:
    firsts = [first_place_m(b, serial) - MIN_RANGE_M for serial in range(40, 50) for b in range(4)]
    assert min(firsts) >= 0.0
    assert max(firsts) < STEP_M
    assert np.diff(np.sort([*firsts, STEP_M])).max() < 0.1 * STEP_M
