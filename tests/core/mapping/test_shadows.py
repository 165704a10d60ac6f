"""The shadow filter: against a plain transcription, before each method, and what it may not do."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from config_file import load_config, with_changes
from core.mapping.shadows import ShadowFilter, drop_shadows
from core.records import F64, PointSweep, Scan
from tests import ROOT
from tests.support.cases import examples
from tests.support.maps.slow_certainty import shadows_left

SHIPPED = load_config((ROOT / "mapod.toml").read_text(encoding="utf-8"))
STEP_RAD = math.radians(0.36)
# what a line of two readings makes with the beam is nowhere near the bound
RANGES = st.lists(st.sampled_from([0.0, 1.0, 1.001, 1.5, 3.0, math.nan]), max_size=30)
EDGE = np.array([1.0] * 6 + [1.6] + [3.0] * 6)  # near, mixed, and a wall behind


def scan_of(ranges_m: F64) -> Scan:
    return Scan(0.5, 1e-5, 0.0, STEP_RAD, ranges_m, 7, 0.6)


def left_of(ranges_m: F64, window: int) -> F64:
    out_m, room = np.ones_like(ranges_m), np.zeros(ranges_m.shape[1], np.uint8)
    drop_shadows(ranges_m, STEP_RAD, math.radians(10.0), window, out_m, room)
    return out_m


def filter_of(method: str, *methods: str, **scanner: Any) -> ShadowFilter:
    changes = {"shadow_filter": {"methods": list(methods)}, "scanner": scanner}
    return ShadowFilter(with_changes(SHIPPED, map={"method": method}, **changes))


@settings(max_examples=examples(100), deadline=None)
@given(rows=st.tuples(RANGES, RANGES), window=st.integers(1, 4))
def test_shadows_go_in_each_row(rows: tuple[list[float], list[float]], window: int) -> None:
    n = min(map(len, rows))
    given_m = np.array([row[:n] for row in rows]).reshape(2, n)
    expected = [shadows_left(row[:n], STEP_RAD, math.radians(10.0), window) for row in rows]
    left_m = left_of(given_m, window)
    np.testing.assert_array_equal(left_m, np.array(expected).reshape(2, n))
    was, is_left = np.nan_to_num(given_m), np.nan_to_num(left_m)
    assert ((is_left == was) | (is_left == 0.0)).all()  # nothing is made up,
    assert (np.isnan(left_m) == np.isnan(given_m)).all()  # and no beam gets lost


def test_the_far_side_of_an_edge_goes_and_flat_walls_and_what_is_nearest_stay() -> None:
    assert (left_of(EDGE[None], 1)[0] == 0.0).tolist() == [False] * 6 + [True] * 2 + [False] * 5
    post = np.array([3.0] * 6 + [1.0] + [3.0] * 6)
    assert left_of(post[None], 3)[0, 6] == 1.0


@pytest.mark.parametrize("method", ["surface", "reference_plane", "certainty"])
def test_it_runs_before_the_methods_that_the_settings_name_and_no_other(method: str) -> None:
    scan = scan_of(EDGE[None])
    cleaned = filter_of(method, method).cleaned(scan)
    assert isinstance(cleaned, Scan)
    assert (cleaned.ranges_m[0] == 0.0).any()
    assert (cleaned.t_s, cleaned.counter) == (scan.t_s, scan.counter)
    np.testing.assert_array_equal(scan.ranges_m[0], EDGE)  # what is recorded and shown is whole
    others = {"surface", "reference_plane", "certainty"} - {method}
    assert filter_of(method, *others).cleaned(scan) is scan


def test_rays_of_no_fan_pass_and_a_file_without_the_section_filters_nothing() -> None:
    ways = np.zeros((3, 3))
    sweep = PointSweep(ways, ways, np.array([[1.0, 1.6, 3.0]]), np.zeros(3), 1, 0.0)
    assert filter_of("surface", "surface").cleaned(sweep) is sweep
    text = (ROOT / "robots" / "cart.toml").read_text(encoding="utf-8")
    scan = scan_of(EDGE[None])
    assert ShadowFilter(load_config(text)).cleaned(scan) is scan
