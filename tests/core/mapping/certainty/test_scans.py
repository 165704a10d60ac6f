"""Steps before the map: the kernels against a plain transcription, and what each is there for."""

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from core.mapping.certainty.scans import (
    Look,
    drop_small_groups,
    keep_supported,
    take,
)
from core.mapping.shadows import NOTHING_M
from tests.support.cases import examples
from tests.support.maps.slow_certainty import groups_left, supported

STEP_RAD = math.radians(0.36)
RANGES = st.lists(st.one_of(st.sampled_from([1.0, 1.05, 1.3, 3.0]), st.just(math.nan)), max_size=30)


@settings(max_examples=examples(100), deadline=None)
@given(ranges=RANGES, least=st.integers(1, 5))
def test_small_groups_go(ranges: list[float], least: int) -> None:
    left = np.array(ranges)
    drop_small_groups(np.array(ranges), left, 0.1, least)
    np.testing.assert_array_equal(left, groups_left(ranges, 0.1, least))


def test_a_thin_thing_stays_whose_neighbours_the_shadow_filter_took_out() -> None:
    post = [3.0] * 4 + [math.nan, 1.0, math.nan] + [3.0] * 4
    for between, is_left in ((math.nan, False), (NOTHING_M, True)):
        given_m = np.array([between if math.isnan(r) else r for r in post])
        left = np.array(post)
        drop_small_groups(given_m, left, 0.1, 3)
        assert (left[5] == 1.0) == is_left
        assert (left[[0, 10]] == 3.0).all()


@settings(max_examples=examples(100), deadline=None)
@given(
    ranges=RANGES,
    others=st.tuples(RANGES, RANGES),
    shifts=st.tuples(st.floats(-40, 40), st.floats(-40, 40)),
)
def test_what_neither_the_scan_before_nor_the_next_supports_goes(
    ranges: list[float], others: tuple[list[float], list[float]], shifts: tuple[float, float]
) -> None:
    kept = np.ones(len(ranges), np.uint8)
    looks = [Look(np.array(other), shift) for other, shift in zip(others, shifts, strict=True)]
    keep_supported(np.array(ranges), looks[0], looks[1], 0.1, kept)
    expected = supported(ranges, list(zip(others, shifts, strict=True)), 0.1)
    assert "".join(map(str, kept)) == expected
    before, after = (Look(np.array(other), math.nan) for other in others)
    keep_supported(np.array(ranges), before, after, 0.1, kept)
    assert not kept.any()  # scans of other beams say nothing


def test_what_is_no_range_is_not_taken() -> None:
    ranges_m = np.ones(5)
    take(np.array([math.nan, -1.0, 0.0, 0.1, 0.2]), ranges_m)
    np.testing.assert_array_equal(ranges_m, [math.nan] * 4 + [0.2])
