"""Slip of both wheels alike: seen by what stands, and corrected."""

import math

import pytest

from core.motion.slip import GAP_M, MOST_SLIP, STRETCH_M, SlipEstimator
from tests.support.cases import few
from tests.support.maps.flat_ride import Ride, Rig, config_of
from tests.support.maps.flat_world import Box, Solid, World

SHELVES: tuple[Solid, ...] = tuple(
    Box((8.0 + 2 * k, y, 0.0), (8.4 + 2 * k, y + 0.6, 1.5))
    for k, y in enumerate((-2.6, 2.0, -2.6, 2.0, -2.6, 2.0, -2.6, 2.0))
)


@pytest.mark.parametrize(
    ("slip", "v_mps", "off_m"),
    few([(0.15, 0.8, 0.45), (-0.1, 0.8, 0.45), (0.0, 0.5, 0.01), (0.15, 0.4, 0.45)], 2),
)
def test_two_thirds_of_a_slip_towards_upright_faces_are_corrected(
    slip: float, v_mps: float, off_m: float
) -> None:
    """15 % of 8 m are 1.2 m, of which the first 0.2 m come before any face is known."""
    ride = Ride(v_mps=v_mps, slip=slip)
    rig = Rig(config_of(), World(solids=SHELVES), ride, 8.0 / v_mps).run()
    assert rig.path.wheels(rig.now_s)[0] == pytest.approx(8.0 * (1.0 + slip), abs=0.1)
    assert abs(float(rig.mapper.odometry.xy_at(rig.now_s)[0]) - rig.place()[0]) < off_m


def answers(
    share: float, corrected: float = 0.0, jump_m: float = 0.0, step_m: float = 0.02
) -> list[float]:
    """What an estimator says of 4 m with so much slip, of which a share is corrected meanwhile."""
    slip, found = SlipEstimator(), []
    for k in range(round(4.0 / step_m)):
        travel_m = k * step_m
        applied_m = -corrected * share * travel_m
        offset_m = share * travel_m + applied_m + (jump_m if travel_m > 0.35 else 0.0)
        answer = slip.maybe_slipped_m(travel_m, offset_m, applied_m)
        found += [] if answer is None else [answer]
    return found


@pytest.mark.parametrize("corrected", [0.0, 0.5, 1.0, 1.5])
@pytest.mark.parametrize("share", [0.05, -0.12])
def test_the_slip_is_the_same_whatever_is_corrected_meanwhile(
    share: float, corrected: float
) -> None:
    told = answers(share, corrected)
    assert len(told) == 5
    assert sum(told) == pytest.approx(share * 4.0, rel=0.15)


def test_a_jump_to_other_faces_and_what_moves_or_stands_is_no_slip() -> None:
    assert sum(answers(0.1, jump_m=-0.15)) == pytest.approx(sum(answers(0.1)), abs=0.005)
    assert answers(0.0, jump_m=0.1) == []
    for share in (0.0, 0.01, 1.2 * MOST_SLIP, 1.0):
        assert answers(share) == []


def test_a_gap_and_an_uneven_growth_tell_nothing() -> None:
    assert answers(0.1, step_m=1.1 * GAP_M) == []
    slip = SlipEstimator()
    for k in range(60):
        travel_m = 1.2 * STRETCH_M * k / 60
        offset_m = 0.1 * travel_m + 0.02 * math.sin(10 * travel_m)
        assert slip.maybe_slipped_m(travel_m, offset_m, 0.0) is None
