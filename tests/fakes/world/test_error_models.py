"""Errors of the scanner: wide beams, both echoes, sunlight, dust, rain; and where they are set."""

import math
from dataclasses import fields, replace

import numpy as np
import pytest

from fakes.lms1xx.device import FakeLms111
from fakes.rays.beam_kernels import PULSE_M, echoes_from_rays
from fakes.rays.light import DUST_REACH_M, ELSEWHERE, THROUGH_SHARE
from fakes.scenes.scene import Scene, Solid
from fakes.world.error_models import NONE, ErrorModels, as_the_sheets_say
from fakes.world.kinematic import KinematicWorld
from fakes.world.rig import Rig
from fakes.world.trajectory import held
from tests.support.robot.flat_floor import F64, FLAT, FLOOR, LENS_X_M, SWEEP_RAD, TILT

WIDE = ErrorModels(beam_rad=0.015, beam_exit_m=0.008, mixed_pixels=True)


def sweeps(scene: Scene, errors: ErrorModels, count: int = 1, seed: int = 1) -> F64:
    """Echoes (2, count * 481) of a lens that stands with a level scan plane, x ahead."""
    world = KinematicWorld(replace(scene, errors=errors), held(pitch_rad=-TILT), seed=seed)
    world.step_to(100.0)
    world.step_to(101.0)
    return np.concatenate(
        [
            np.atleast_2d(world.ranges_m(np.full(481, 100.0 + 0.04 * k), SWEEP_RAD))
            for k in range(count)
        ],
        axis=1,
    )


def walls(*near_and_far: tuple[float, float, float]) -> Scene:
    """Upright plates across the way: x, from y, to y."""
    plates = (Solid(f"{x}", (x, x + 0.01), (low, high), (0, 3)) for x, low, high in near_and_far)
    return Scene("walls", (FLOOR, *plates))


def test_a_wide_beam_on_a_wall_is_as_long_as_a_thin_one() -> None:
    scene = walls((4.0, -20.0, 20.0))
    wide, thin = sweeps(scene, WIDE), sweeps(scene, NONE)
    ahead = np.abs(SWEEP_RAD) < math.radians(20.0)
    np.testing.assert_allclose(wide[0, ahead], thin[0, ahead], atol=2e-3)
    assert np.isnan(wide[1]).all()


def test_a_beam_over_an_edge_has_two_echoes_where_the_surfaces_lie_far_behind_each_other() -> None:
    scene = walls((4.0, -20.0, 0.0), (7.0, -20.0, 20.0))
    first, second = sweeps(scene, WIDE)
    twice = np.isfinite(second)
    assert 3 <= twice.sum() <= 5  # 60 mm at 4 m, beams every 17 mm
    assert (np.abs(SWEEP_RAD[twice]) < 0.010).all()
    x = np.cos(SWEEP_RAD[twice])
    np.testing.assert_allclose(first[twice] * x, 4.0 - LENS_X_M, atol=5e-3)
    np.testing.assert_allclose(second[twice] * x, 7.0 - LENS_X_M, atol=5e-3)


def test_a_beam_over_an_edge_of_surfaces_close_behind_each_other_ends_between_them() -> None:
    scene = walls((4.0, -20.0, 0.0), (4.3, -20.0, 20.0))
    mixed, apart = sweeps(scene, WIDE), sweeps(scene, replace(WIDE, mixed_pixels=False))
    for echoes, between in ((mixed, 3), (apart, 0)):
        ahead_m = echoes[0] * np.cos(SWEEP_RAD) + LENS_X_M
        near = np.abs(SWEEP_RAD) < math.radians(5.0)
        is_between = (ahead_m > 4.02) & (ahead_m < 4.28) & near
        assert between <= is_between.sum() <= between + 2
        assert np.isnan(echoes[1, near]).all()


@pytest.mark.parametrize("mixes", [True, False])
def test_echoes_of_rays_are_those_of_a_slow_and_obvious_way(mixes: bool) -> None:
    random = np.random.default_rng(5)
    ranges_m = random.choice([3.0, 3.2, 3.45, 5.0, 5.4, 9.0, np.inf], (200, 7))
    ranges_m += random.uniform(0.0, 0.01, ranges_m.shape)
    echoes = echoes_from_rays(ranges_m.T.copy(), mixes)
    weights = np.array([0.28] + [0.12] * 6)
    for k, row in enumerate(ranges_m):
        groups: list[list[int]] = []
        for ray in np.argsort(row, kind="stable"):
            if np.isinf(row[ray]):
                break
            if not groups or row[ray] - row[groups[-1][-1]] > PULSE_M:
                groups.append([])
            groups[-1].append(int(ray))
        wanted = [
            float(np.average(row[group], weights=weights[group])) if mixes else row[min(group)]
            for group in groups
        ]
        np.testing.assert_allclose(echoes[:, k], [*wanted, np.inf, np.inf][:2], atol=1e-12)


def test_beams_into_the_sun_come_back_dazzled_silent_or_short_and_others_rarely() -> None:
    sun = ErrorModels(sunlight_rate=0.4, sun_azimuth_rad=0.5, sun_half_rad=0.2)
    scene = walls((8.0, -20.0, 20.0))
    [echo], [true_m] = sweeps(scene, sun, 25), sweeps(scene, NONE, 25)
    into = np.abs(np.tile(SWEEP_RAD, 25) - 0.5) < 0.2
    is_upset = ~(echo == true_m)
    assert is_upset[into].mean() == pytest.approx(0.4, abs=0.03)
    assert is_upset[~into].mean() == pytest.approx(0.4 * ELSEWHERE, abs=0.005)
    upset = echo[into & is_upset]
    assert np.isneginf(upset).mean() == pytest.approx(0.5, abs=0.06)
    assert np.isnan(upset).mean() == pytest.approx(0.3, abs=0.06)
    short = upset[np.isfinite(upset)]
    assert (short < true_m[into & is_upset][np.isfinite(upset)]).all()
    assert 3.0 < short.mean() < 5.5


def test_dust_returns_beams_mostly_from_near_and_rain_evenly_along_their_way() -> None:
    """Both let some go on."""
    scene = walls((8.0, -20.0, 20.0))
    [true_m] = sweeps(scene, NONE, 25)
    wet_m, _ = sweeps(scene, ErrorModels(rain_per_m=0.02), 25)
    met = wet_m < true_m
    assert met.mean() == pytest.approx(np.mean(1 - np.exp(-0.02 * true_m)), abs=0.01)
    assert np.mean(wet_m[met] / true_m[met]) == pytest.approx(0.5, abs=0.04)
    first, second = sweeps(scene, ErrorModels(dust_per_m=0.05), 25)
    met = first < true_m
    assert met.mean() == pytest.approx(1 - math.exp(-0.05 * DUST_REACH_M), abs=0.01)
    assert np.median(first[met]) == pytest.approx(DUST_REACH_M * math.log(2), abs=0.15)
    assert np.isfinite(second[met]).mean() == pytest.approx(THROUGH_SHARE, abs=0.05)
    through = met & np.isfinite(second)
    np.testing.assert_array_equal(second[through], true_m[through])


def test_a_dazzled_beam_is_told_with_the_devices_code_for_it() -> None:
    ranges_m = np.array([np.nan, -np.inf, 2.0, np.inf])

    def look(first_s: float, times_s: F64, bearings_rad: F64) -> F64:
        return np.resize(ranges_m, len(times_s))

    fake = FakeLms111(look, 1)
    fake.noise_m, fake.offset_m = 0.0, 0.03
    fake.head.sweep_from(0.0)
    codes, _ = fake.head.echoes_mm(0)
    assert codes[:4].tolist() == [0, 1, 2030, 0]


def test_the_sheets_upsets_keep_what_a_scene_has_of_its_own() -> None:
    own = ErrorModels(sunlight_rate=0.1, dust_per_m=0.01, slip_bursts_per_min=3.0)
    both = as_the_sheets_say(own)
    assert (both.sunlight_rate, both.dust_per_m, both.slip_bursts_per_min) == (0.1, 0.01, 3.0)
    assert both.beam_rad == pytest.approx(0.015, abs=1e-4)
    assert both.ahrs_sheet_errors
    assert both.mixed_pixels
    assert as_the_sheets_say(both) == both
    assert all(not getattr(NONE, f.name) for f in fields(NONE) if f.name != "sun_half_rad")


def test_the_rig_gives_the_devices_the_upsets_of_the_scene_or_those_that_it_is_told() -> None:
    sheet = as_the_sheets_say()
    plain, own = Rig(FLAT, 1), Rig(replace(FLAT, errors=sheet), 1)
    told, other = Rig(FLAT, 1, errors=sheet), Rig(FLAT, 2, errors=sheet)
    assert plain.scanner.offset_m == 0.0
    assert not plain.ahrs.sheet_errors
    assert own.scanner.offset_m == told.scanner.offset_m != other.scanner.offset_m
    for rig in (own, told, other):
        assert 0.0 < abs(rig.scanner.offset_m) <= 0.030
        assert rig.ahrs.sheet_errors
