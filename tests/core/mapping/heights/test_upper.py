"""Heights of what stands, filtered over the returns that agree."""

import math

import numpy as np
import pytest

from core.grid.ring import RingGrid
from core.mapping.heights.told import Heights
from core.mapping.heights.upper import EVEN, NO_UPPERS, see_uppers
from core.mapping.surface.constants import MOST
from core.mapping.surface.evidence import vote
from core.mapping.surface.maps import SurfaceMaps
from core.mapping.surface.sweep import ABOVE, BELOW, FLOOR, HIGH, NONE, RETURN
from core.records import F64
from jit import Records, records
from tests.support.maps.ground_cells import LIMITS, NOISE_M2, GroundCells, met
from tests.support.robot.shipped import shipped

LEVEL = np.zeros(2)


def heights(ground: GroundCells, uppers: Records, static_rad: F64 = LEVEL) -> Heights:
    return Heights(RingGrid(41, 0.2), ground.cells, uppers, static_rad, LIMITS.h_pos_m)


def told_m(ground: GroundCells, at: int, uppers: Records) -> tuple[float, float]:
    (height_m,), (var_m2,) = heights(ground, uppers).told_at(np.array([at]))
    return float(height_m), float(var_m2)


@pytest.mark.parametrize(
    ("returns_m", "filtered_m", "below_m"),
    [
        ((0.50,), 0.50, 0.0),
        ((0.50, 0.52, 0.51), 0.51, 0.0),  # their mean, and not the highest
        ((0.50, 0.51, 0.20), 0.505, 0.305),  # a face of what two returns agree on
        ((0.20, 0.50), 0.50, 0.30),  # both say that something stands: a face
        ((0.20, 0.50, 0.51), 0.505, 0.30),
    ],
)
def test_what_stands_is_as_high_as_returns_agree(
    returns_m: tuple[float, ...], filtered_m: float, below_m: float
) -> None:
    ground = GroundCells()
    uppers = ground.filter_heights()
    at = ground.lay(2, 0, 0.0, looks=0, stands=0.0)
    for z_m in returns_m:
        assert met(ground, 20.0, 0.41, z_m)["kind"][0] == ABOVE
    assert told_m(ground, at, uppers)[0] == pytest.approx(filtered_m, abs=1e-6)
    assert uppers["below_m"][at] == pytest.approx(below_m)
    assert ground.cells["top_m"][at] == pytest.approx(max(returns_m))  # by this it is decided
    assert told_m(ground, at, NO_UPPERS)[0] == pytest.approx(max(returns_m))


def test_one_return_over_floor_leaves_the_height_unknown_until_another_agrees() -> None:
    ground = GroundCells()
    uppers = ground.filter_heights()
    at = ground.lay(2, 0, 0.0)
    told = [told_m(ground, at, uppers)]
    for z_m in (0.50, 0.51):
        ground.cells["stands"][at] = 0.5
        met(ground, 20.0, 0.41, z_m)
        told.append(told_m(ground, at, uppers))
    floor_m2 = float(ground.cells["var_m2"][at])
    wanted = [(0.0, floor_m2), (math.nan, math.nan), (0.505, NOISE_M2 / 2)]
    np.testing.assert_allclose(told, wanted, atol=1e-6)


def test_a_return_over_ground_that_is_a_guess_has_a_height_and_is_nothing_else() -> None:
    ground = GroundCells()
    uppers = ground.filter_heights()
    at = ground.lay(2, 0, 0.0, looks=0, stands=0.0, var_m2=0.01)
    assert met(ground, 20.0, 0.41, -0.05)["kind"][0] == NONE
    told = {}
    for name in ("z", "height", "variance"):
        ring = heights(ground, uppers).maybe_ring(name)
        assert ring is not None
        [told[name]] = ring[1](np.array([at]))
    assert told["z"] == pytest.approx(-0.05)
    assert math.isnan(told["height"])
    assert told["variance"] == pytest.approx(NOISE_M2)
    assert ground.cells["stands"][at] == 0.0


def test_what_has_gone_takes_its_height_along() -> None:
    ground = GroundCells()
    uppers = ground.filter_heights()
    at = ground.lay(2, 0, 0.0, looks=0, stands=0.0)
    met(ground, 20.0, 0.41, 0.5)
    assert told_m(ground, at, uppers)[0] == pytest.approx(0.5)
    ground.touched.used[0] = 0
    vote(at, -2.0 * MOST, ground.surface)
    assert math.isnan(told_m(ground, at, uppers)[0])
    met(ground, 21.0, 0.41, 0.3)
    assert told_m(ground, at, uppers)[0] == pytest.approx(0.3)


def count(ground: GroundCells, at: int, kinds: str) -> None:
    """Returns in one cell, one after the other: `F` of floor, `A` above it."""
    returns = records(RETURN, len(kinds))
    returns["kind"] = [FLOOR if kind == "F" else ABOVE for kind in kinds]
    returns["at"], returns["z_m"], returns["noise_m2"] = at, 0.5, NOISE_M2
    see_uppers(returns, ground.surface)


@pytest.mark.parametrize(
    ("kinds", "height_m"),
    [
        ("AAFF", 0.5),  # as many: the higher one
        ("FAAF", 0.5),
        ("FFAA", 0.5),  # whichever comes first
        ("AAFFF", 0.1),
        ("FFFAA", 0.1),
        ("F" * 99 + "A" * EVEN, 0.5),  # it came there later
        ("F" * 99 + "A" * (EVEN - 1), 0.1),
        ("A" * 99 + "F" * EVEN, 0.5),
        ("A" * 99 + "F" * (EVEN + 1), 0.1),
    ],
)
def test_a_cell_that_an_edge_divides_is_as_high_as_most_of_its_returns(
    kinds: str, height_m: float
) -> None:
    ground = GroundCells()
    uppers = ground.filter_heights()
    at = ground.lay(2, 0, 0.1, stands=0.5, top_m=0.4)
    count(ground, at, kinds)
    told = told_m(ground, at, uppers)
    assert told[0] == pytest.approx(height_m)
    assert (told[1] == pytest.approx(ground.cells["var_m2"][at])) == (height_m == 0.1)
    assert told_m(ground, at, NO_UPPERS)[0] == pytest.approx(0.5)  # by this it is decided


def test_what_has_gone_counts_no_more_against_floor() -> None:
    ground = GroundCells()
    uppers = ground.filter_heights()
    at = ground.lay(2, 0, 0.1, stands=0.5, top_m=0.4)
    count(ground, at, "A" * 9)
    vote(at, -2.0 * MOST, ground.surface)
    ground.cells["stands"][at] = 0.5
    count(ground, at, "AAFFF")
    assert told_m(ground, at, uppers)[0] == pytest.approx(0.1)


@pytest.mark.parametrize("kind", [BELOW, HIGH])
def test_what_is_no_part_of_a_thing_tells_nothing(kind: int) -> None:
    ground = GroundCells()
    uppers = ground.filter_heights()
    returns = records(met(ground, 20.0, 0.41, 0.5).dtype, 2)
    returns["kind"], returns["at"] = kind, (ground.at(3, 0), -1)
    returns["kind"][1] = ABOVE  # outside of the map
    before = uppers.copy()
    see_uppers(returns, ground.surface)
    assert (uppers == before).all()


def test_what_the_attitude_is_always_wrong_by_is_taken_out_as_it_is_read() -> None:
    ground = GroundCells()
    uppers = ground.filter_heights()
    ground.own[3:] = 0.01, -0.02
    at = ground.lay(2, 0, 0.0, looks=0, stands=0.0)
    met(ground, 20.0, 0.41, 0.5)  # 5 m ahead
    told = [
        heights(ground, uppers, np.array(s)).told_at(np.array([at]))
        for s in ((0.01, -0.02), (0, 0))
    ]
    assert told[0][0] == pytest.approx(0.5)
    assert told[1][0] == pytest.approx(0.5 + 0.01 * 5.0)


@pytest.mark.parametrize(("is_set", "kept"), [(False, 0), (True, 41 * 41)])
def test_filters_are_kept_where_the_settings_want_them(is_set: bool, kept: int) -> None:
    sizes = {"cells": 41, "filter_heights": is_set}
    maps = SurfaceMaps(shipped(map=sizes, obstacle={"window_cells": 41}))
    assert maps._surface.uppers.size == kept


def test_whether_something_is_soft_is_told_without_its_height() -> None:
    ground = GroundCells()
    uppers = ground.filter_heights()
    at = ground.lay(2, 0, 0.0, stands=0.5)
    met(ground, 20.0, 0.41, 0.5)
    assert math.isnan(told_m(ground, at, uppers)[0])
    ring = heights(ground, uppers).maybe_ring("soft")
    assert ring is not None
    assert ring[1](np.array([at])) == [0.0]
