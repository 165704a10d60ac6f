"""The error of a sweep: what its witnesses tell, and what they must not."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.mapping.body import BodyPose
from core.mapping.surface.cells import BLANK, STATES, TIED
from core.mapping.surface.constants import FAST_S, SIGMA_STATIC_RAD
from core.mapping.surface.error import SweepFilter, forget, roll_on, set_right
from core.mapping.surface.evidence import end_beams
from core.mapping.surface.passing import follow_beams
from core.mapping.surface.sweep import RETURN, Beams, agree, find_witnesses, hold
from core.records import F64
from jit import COMPILED, Records, records
from tests.support.maps.ground_cells import FAR_M, GroundCells, standing

NOISE_M = 0.004
SCAN_S = 0.04
HEIGHT, PITCH, ROLL, STATIC_PITCH, STATIC_ROLL = range(STATES)
MILLI = st.floats(-30.0, 30.0)


class Witnesses:
    """Known level ground across the way, and returns of a sweep that fall on it.

    Ground was seen at t = 0 with the arms that `then` (n, 2) says; the sweep is off by `truth`.
    """

    def __init__(self, truth: F64, seed: int = 3, beams: int = 81) -> None:
        self.truth, self.random = truth, np.random.default_rng(seed)
        self.ground = GroundCells(101)
        self.returns: Records = records(RETURN, beams)
        self.aside_m = np.linspace(-8.0, 8.0, beams)
        self.at = [self.ground.lay(41, round(5 * aside), 0.0) for aside in self.aside_m]
        self.filter = SweepFilter()
        own, P = self.filter.own, self.filter.P
        self.ground.surface = self.ground.surface._replace(own=own, P=P)

    @property
    def error(self) -> F64:
        """What the filter still has wrong."""
        return self.truth - self.filter.own

    def sweep(
        self,
        t_s: float,
        passed_s: float,
        ahead_m: float = FAR_M,
        travel_m: float = 0.0,
        then_m: float = FAR_M,
        outliers: float = 0.0,
    ) -> None:
        """One sweep: seen ahead_m ahead after so much way; laid with the arm then_m."""
        cells, returns = self.ground.cells, self.returns
        for one, at, aside in zip(returns, self.at, self.aside_m, strict=True):
            cells["arm_m"][at], cells["aside_m"][at] = then_m, aside
            h = np.array([1.0, ahead_m, aside, ahead_m + travel_m - then_m, 0.0])
            off = float(h @ self.error) + self.random.normal(0.0, NOISE_M)
            off += 0.5 if self.random.random() < outliers else 0.0
            one["at"] = one["witness"] = at
            one["noise_m2"], one["off_m"], one["height_m"], one["z_m"] = NOISE_M**2, off, off, off
            one["ahead_m"] = one["witness_ahead_m"] = ahead_m
            one["aside_m"] = one["witness_aside_m"] = aside
        surface = self.ground.surface._replace(stand=standing(t_s=t_s, way_m=travel_m))
        set_right(returns, passed_s, surface)

    def sigmas(self) -> F64:
        """The error of each state in its own sigmas."""
        return np.asarray(np.abs(self.error) / np.sqrt(np.diag(self.filter.P)))


def radians(*of: float) -> F64:
    """A state of metres and degrees."""
    return np.array([of[0], *(math.radians(a) for a in of[1:]), 0.0, 0.0])


@pytest.mark.parametrize("truth", [(0.004, 0.2, 0.0), (-0.004, -0.15, 0.2), (0.0, 0.1, -0.3)])
@pytest.mark.parametrize("outliers", [0.0, 0.3])
def test_the_error_of_a_sweep_over_known_ground_is_found(
    truth: tuple[float, float, float], outliers: float
) -> None:
    at_once = Witnesses(radians(*truth))
    for k in range(10):
        at_once.sweep(SCAN_S * k, SCAN_S, outliers=outliers)
    assert (at_once.sigmas() < 3.0).all()
    level_m, roll_rad = at_once.error[HEIGHT] + FAR_M * at_once.error[PITCH], at_once.error[ROLL]
    assert abs(level_m) < 0.003
    assert abs(roll_rad) < math.radians(0.03)
    inliers = at_once.returns["height_m"] < 0.25
    assert abs(at_once.returns["height_m"][inliers].mean()) < 0.003
    assert inliers.sum() == pytest.approx((1.0 - outliers) * inliers.size, abs=12)


def test_too_few_witnesses_tell_nothing() -> None:
    few = Witnesses(radians(0.0, 0.2, 0.0), beams=14)
    before = few.filter.P.copy()
    few.sweep(0.0, 1.0)
    assert not few.filter.own.any()
    assert np.array_equal(few.filter.P, before)


def test_ground_seen_again_from_its_place_tells_nothing_of_what_is_always_wrong() -> None:
    """However often: by the same arms it would be seen where it was laid, whatever the error."""
    again = Witnesses(radians(0.0, 0.2, 0.1))
    for k in range(200):
        again.sweep(1000.0 + k, 1.0)
    assert again.filter.own[STATIC_PITCH] == again.filter.own[STATIC_ROLL] == 0.0
    assert again.filter.P[STATIC_PITCH, STATIC_PITCH] == SIGMA_STATIC_RAD**2
    assert again.error[PITCH] == pytest.approx(0.0, abs=math.radians(0.05))


def test_ground_seen_again_by_other_arms_at_once_is_the_fast_parts() -> None:
    soon = Witnesses(radians(0.0, 0.2, 0.0))
    soon.sweep(0.9 * FAST_S, 1.0, ahead_m=4.0, travel_m=9.0)
    assert soon.filter.own[STATIC_PITCH] == 0.0
    assert soon.filter.own[PITCH] != 0.0


def test_old_ground_seen_again_by_other_arms_tells_what_is_always_wrong() -> None:
    truth = np.array([0.0, 0.0, 0.0, math.radians(0.4), 0.0])
    old = Witnesses(truth)
    for _ in range(400):
        forget(0.5, 0.0, False, old.filter.own, old.filter.P)
        old.sweep(20.0, 0.5, travel_m=old.random.uniform(-16.0, 16.0))
    assert old.filter.own[STATIC_PITCH] == pytest.approx(truth[STATIC_PITCH], rel=0.1)
    assert abs(old.filter.own[STATIC_ROLL]) < math.radians(0.05)
    assert (old.sigmas() < 3.0).all()


def turned(heading_rad: float, random: np.random.Generator, beams: Beams) -> BodyPose:
    """A robot on the spot at the origin, on a level floor, and its sweep."""
    bearings = heading_rad + np.radians(np.linspace(-60.0, 60.0, beams.rays.shape[0]))
    fall = math.radians(7.5)
    across, down = math.cos(fall), math.sin(fall)
    x = across * np.cos(bearings - heading_rad)
    side = np.sin(bearings - heading_rad)
    c, s = math.cos(heading_rad), math.sin(heading_rad)
    beams.rays[:, 2] = -down * np.cos(bearings - heading_rad)
    beams.rays[:, 0], beams.rays[:, 1] = c * x - s * side, s * x + c * side
    beams.lenses[:] = 0.0, 0.0, 1.08
    ranges = -1.08 / beams.rays[:, 2]
    beams.ranges_m[0] = ranges + random.normal(0.0, 0.012, ranges.size)
    return standing()._replace(heading=(c, s))


@pytest.mark.skipif(not COMPILED, reason="an hour through kernels as Python takes minutes")
def test_an_hour_of_turning_on_the_spot_moves_nothing_away() -> None:
    random, ground, off = np.random.default_rng(5), GroundCells(101), SweepFilter()
    surface = ground.surface._replace(own=off.own, P=off.P)
    n, touched = 61, ground.touched
    beams = Beams(np.empty((n, 3)), np.empty((n, 3)), np.empty((1, n)), records(RETURN, n), 9e-6)
    passed_s, worst_rad = 0.8, 0.0
    for k in range(int(3600 / passed_s)):
        stand = turned(random.uniform(-math.pi, math.pi), random, beams)
        surface = surface._replace(stand=stand._replace(t_s=k * passed_s))
        forget(passed_s, 0.0, False, off.own, off.P)
        hold(beams, surface)
        agree(beams.returns, TIED, surface)
        find_witnesses(beams, surface)
        set_right(beams.returns, passed_s, surface)
        touched.used[0] = 0
        end_beams(beams, surface)
        follow_beams(beams, surface)
        worst_rad = max(worst_rad, float(np.abs(off.own[1:3] + off.own[3:]).max()))
    seen = ground.cells["looks"] > 20
    assert seen.sum() > 1000
    assert worst_rad < math.radians(0.1)
    assert abs(off.own[HEIGHT]) < 0.01
    assert np.abs(ground.cells["ground_m"][seen]).max() < 0.03


@pytest.mark.parametrize("height_m", [0.012, -0.017, 0.031])
def test_floor_that_most_returns_agree_on_lies_at_their_mean(height_m: float) -> None:
    """Not at the middle of the bins in which they are counted: that is off by up to half of one."""
    random = np.random.default_rng(6)
    returns = records(RETURN, 200)
    returns["at"], returns["var_m2"] = 7, 1.0
    heights_m = height_m + random.normal(0.0, 0.004, 200)
    returns["height_m"] = returns["near_m"] = heights_m
    returns["height_m"][:40] += 0.3  # a thing
    agree(returns, TIED, GroundCells().surface)
    assert abs(float(returns["height_m"][40:].mean())) < 1e-6
    assert (returns["tied"] == TIED).all()


STEPS = st.lists(
    st.one_of(
        st.tuples(st.just("forget"), st.floats(0.0, 60.0), st.floats(-50.0, 50.0), st.booleans()),
        st.tuples(st.just("roll_on"), st.floats(0.0, 2.0), st.floats(-90.0, 90.0), MILLI),
        st.tuples(
            st.just("set_right"), st.floats(0.0, 60.0), st.floats(0.0, 2.0), st.floats(1.0, 12.0),
            st.floats(-90.0, 90.0), st.floats(-90.0, 90.0), st.floats(0.0, 0.5),
        ),
    ),
    max_size=25,
)  # fmt: skip


@given(steps=STEPS, truth=st.tuples(MILLI, MILLI, MILLI, MILLI, MILLI))
def test_the_covariance_stays_one_whatever_happens(
    steps: list[tuple[Any, ...]], truth: tuple[float, ...]
) -> None:
    any_of = Witnesses(1e-3 * np.array(truth), beams=21)
    own, P = any_of.filter.own, any_of.filter.P
    at = any_of.ground.lay(0, 0, 0.0)
    for name, *given_ in steps:
        if name == "forget":
            passed_s, driven_m, jumps = given_
            forget(passed_s, driven_m, jumps, own, P)
        elif name == "set_right":
            any_of.sweep(*given_)
        else:
            passed_s, travel_m, z_mm = given_
            any_of.ground.cells["arm_m"][at] = 0.5 * travel_m
            stand = standing(0.1, 0.1, way_m=travel_m)._replace(z_m=1e-3 * z_mm)
            surface = any_of.ground.surface._replace(stand=stand)
            roll_on(passed_s, surface)
        assert np.isfinite(own).all()
        assert np.isfinite(P).all()
        size = np.abs(P).max()
        assert np.abs(P - P.T).max() <= 1e-12 * size
        assert (np.diag(P) >= 0.0).all()
        assert np.linalg.eigvalsh(0.5 * (P + P.T)).min() >= -1e-12 * size
    assert (any_of.ground.cells["ground_m"] == BLANK["ground_m"]).all()  # the map stays
