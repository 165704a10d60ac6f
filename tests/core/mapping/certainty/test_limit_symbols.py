"""The closed forms of the plausibility limit against the derivatives that symbols give."""

import math

import pytest
from hypothesis import assume, given, settings

from tests.core.mapping.certainty.test_limit import CHANGED, VALUES, Seen, Values
from tests.support.cases import examples
from tests.support.maps.symbolic_limit import slopes_in_a_cell


@settings(max_examples=examples(40), deadline=None)
@given(of=VALUES)
def test_each_part_is_the_derivative_of_where_a_beam_ends(of: Values) -> None:
    seen = Seen(of)
    assume(abs(seen.R[2, 2]) > 0.2)
    slopes = slopes_in_a_cell(of)
    for name, change in CHANGED.items():
        part = seen.limit_m(**{change: 1.0})
        assert part == pytest.approx(abs(slopes[name]), rel=1e-8, abs=1e-9)
    assert seen.limit_m(travel_m=1.0) == pytest.approx(math.hypot(slopes["x"], slopes["y"]))
    assert seen.limit_m(sigma_m=1.0) == pytest.approx(3.0 * abs(slopes["r"]))
    assert seen.limit_m(sigma_share=0.01) == pytest.approx(0.03 * of["r"] * abs(slopes["r"]))
    assert seen.limit_m(beam_rad=1.0) == pytest.approx(abs(slopes["phi"]), abs=1e-9)
    assert seen.limit_m(cell_m=1.0) == pytest.approx(abs(slopes["x"]) + abs(slopes["y"]))
