"""What the fake camera sees against what is true, and each of its errors by itself."""

import math
from typing import Any

import numpy as np
import pytest

from fakes.rays.kernels import BLACK, PLAIN
from fakes.rays.sight import Met
from fakes.visionary.faults import Faults
from fakes.visionary.lens import Lens, axis_of, lens_of, ways_of
from fakes.visionary.models import KINDS, Model
from fakes.visionary.picture import Camera, Maps, Sight
from fakes.wires.timing import F64
from fakes.world.rotations import rotation_y, rotation_z
from fakes.world.simple import Ground

NONE = {"noise": 0.0, "flying": 0.0, "multipath": 0.0}
FEW = lens_of(KINDS["t_mini"], 2)  # 128 x 106


class Panel:
    """A panel, left of the camera's middle, before a wall; it may move to the left."""

    def __init__(self, near_m: float = 1.0, far_m: float = 2.0, mps: float = 0.0) -> None:
        self.near_m, self.far_m, self.mps, self.material = near_m, far_m, mps, PLAIN

    def met(self, t_s: float, begins: F64, ways: F64) -> Met:
        with np.errstate(divide="ignore", invalid="ignore"):  # rays along the wall
            near_m, far_m = ((at - begins[:, 0]) / ways[:, 0] for at in (self.near_m, self.far_m))
            is_near = begins[:, 1] + near_m * ways[:, 1] > self.mps * t_s
        ranges_m = np.where(is_near, near_m, far_m)
        normals = np.broadcast_to(np.array([-1.0, 0.0, 0.0]), ways.shape)
        points = begins + np.where(np.isfinite(ranges_m), ranges_m, 0.0)[:, None] * ways
        materials = np.where(is_near, self.material, PLAIN)
        return Met(ways, ranges_m, points, normals, is_near.astype(np.int64), materials)


class Turned:
    """The same machine and the same scene, all turned and tilted in the map."""

    def __init__(self, sight: Sight) -> None:
        self._sight = sight
        self._R = rotation_z(1.1) @ rotation_y(0.05)

    def met(self, t_s: float, begins: F64, ways: F64) -> Met:
        met = self._sight(t_s, begins, ways)
        ways, points, normals = (one @ self._R.T for one in (met.ways, met.points, met.normals))
        return met._replace(ways=ways, points=points, normals=normals)


def maps(
    sight: Sight, lens: Lens = FEW, model: Model = "t_mini", seed: int = 1, **given: Any
) -> Maps:
    faults = Faults(model)
    faults.tilt_deg, faults.mount_m = 0.0, (0.0, 0.0, 0.4)
    for name, value in (NONE | given).items():
        assert hasattr(faults, name), name
        setattr(faults, name, value)
    return Camera(faults, KINDS[model], sight, seed).maps(0.0, lens)


def off_m(seen: Maps) -> F64:
    """Of a T Mini's ranges; NaN where there is none."""
    return np.asarray(np.where(seen.raw > 0, 0.00025 * seen.raw - seen.truth_m, np.nan))


@pytest.mark.parametrize("model", list(KINDS))
def test_without_errors_each_depth_is_that_of_its_ray(model: Model) -> None:
    lens, kind = lens_of(KINDS[model], 1), KINDS[model]
    seen = maps(Panel().met, lens, model)
    ways = ways_of(lens, 0.0).reshape(*seen.raw.shape, 3)
    lens_m = -kind.away_mm / 1000
    walls_m = np.array([1.0, 2.0]) - lens_m
    ahead_m = seen.raw * kind.unit_mm / 1000
    if not kind.is_planar:
        ahead_m = ahead_m * (ways @ axis_of(0.0))
    assert np.abs(ahead_m[..., None] - walls_m).min(axis=2).max() < kind.unit_mm / 1000
    is_near = np.abs(ahead_m - walls_m[0]) < 0.01
    assert is_near[:, :10].all()  # left
    assert not is_near[:, -10:].any()


def test_planes_between_rays_are_what_each_ray_would_meet() -> None:
    for sight in (Panel().met, Ground("wall:1.6").met):
        one = maps(sight, every_px=1)
        np.testing.assert_allclose(maps(sight).truth_m, one.truth_m, atol=1e-9)


def test_how_the_machine_is_turned_in_the_map_does_not_matter() -> None:
    for sight in (Panel().met, Ground("wall:1.6").met):
        for given in ({}, {"multipath": 1.0, "shiny_share": 0.5}, {"every_px": 1}):
            one, turned = (
                maps(each, tilt_deg=25.0, **given) for each in (sight, Turned(sight).met)
            )
            np.testing.assert_allclose(turned.truth_m, one.truth_m, atol=1e-9)
            assert np.abs(turned.raw.astype(int) - one.raw).max() <= 1
            np.testing.assert_array_equal(turned.third, one.third)


def test_the_same_seed_sees_the_same_and_another_other_noise() -> None:
    one, same = (maps(Panel().met, noise=1.0, flying=1.0) for _ in range(2))
    other = maps(Panel().met, noise=1.0, flying=1.0, seed=2)
    np.testing.assert_array_equal(one.raw, same.raw)
    assert (one.raw != other.raw).mean() > 0.5


def test_noise_grows_with_the_distance_and_as_less_light_returns() -> None:
    near, far = (maps(Panel(d, d).met, noise=1.0) for d in (1.0, 3.0))
    dark = maps(Panel(1.0, 1.0).met, noise=1.0, reflectivity=0.1)
    sigmas_m = [float(np.nanstd(off_m(one))) for one in (near, far, dark)]
    assert 0.001 < sigmas_m[0] < 0.004
    assert sigmas_m[1] > 1.5 * sigmas_m[0]
    assert sigmas_m[2] > 1.3 * sigmas_m[0]
    assert abs(float(np.nanmean(off_m(far)))) < 0.0005


def test_pixels_fly_at_edges_and_nowhere_else() -> None:
    seen = maps(Panel().met, flying=1.0)
    flies = np.abs(off_m(seen)) > 0.01
    assert flies.any(axis=1).mean() > 0.9
    columns = np.nonzero(flies.any(axis=0))[0]
    assert np.ptp(columns) <= 3
    between = np.sort(0.00025 * seen.raw[flies])
    assert between[0] > 1.0
    assert between[-1] < 2.3
    assert np.ptp(between) > 0.5


def test_a_floor_that_is_seen_flat_has_no_edges() -> None:
    seen = maps(Ground("floor").met, flying=1.0, least_amplitude=1e-5, ambiguity_m=99.0)
    column_m = seen.truth_m[:, 64]
    assert np.diff(column_m[column_m < 50.0]).min() < -0.3  # from row to row, far away
    assert np.nanmax(np.abs(off_m(seen))) < 0.001


def test_black_and_shiny_things_are_missing() -> None:
    panel = Panel(near_m=3.5, far_m=4.0)
    panel.material = BLACK
    seen = maps(panel.met)
    left, right = seen.third[:, :40], seen.third[:, -40:]
    assert (left != 0).mean() > 0.9
    assert (right == 0).mean() > 0.9
    shiny = maps(Panel().met, shiny_share=1.0)
    good = (shiny.third == 0) & (shiny.raw > 0)
    facing = np.abs(ways_of(FEW, 0.0)[:, 0].reshape(good.shape))
    assert good[facing > 0.98].mean() > 0.95
    assert good[facing < 0.95].mean() < 0.75  # what is near and dull enough to be seen all the same
    assert good.mean() < maps(Panel().met).raw.astype(bool).mean()


def test_an_old_camera_tells_how_much_light_returns() -> None:
    near, far = (maps(Panel(d, d).met, lens_of(KINDS["t"], 0), "t") for d in (1.0, 4.0))
    assert near.third.min() > far.third.max() > 0


def test_a_range_beyond_the_ambiguity_seems_near() -> None:
    seen = maps(Panel(1.0, 1.0).met, ambiguity_m=0.9)
    assert np.median(off_m(seen)) == pytest.approx(-0.9, abs=1e-3)


def test_light_over_two_walls_makes_corners_longer() -> None:
    seen = maps(Ground("wall:1.2").met, multipath=1.0, tilt_deg=25.0)
    longer_m = np.nanmean(off_m(seen), axis=1)
    dip = math.radians(25.0) - math.atan2(0.4, 1.2)  # of the axis below the corner
    corner = round(FEW.centre_px[1] - abs(FEW.focal_px[1]) * math.tan(dip))
    assert abs(int(np.argmax(longer_m)) - corner) <= 8
    assert 0.01 < longer_m.max() < 0.06
    assert longer_m[-5:].max() < 0.3 * longer_m.max()
    assert np.nanmin(off_m(seen)) > -0.0003


def test_what_moves_during_the_exposure_is_torn() -> None:
    still, moving = (maps(Panel(mps=v).met, exposure_s=0.02) for v in (0.0, 3.0))
    assert (np.abs(off_m(still)) > 0.01).sum() == 0
    torn = np.abs(off_m(moving)) > 0.01
    assert torn.any(axis=1).all()
    assert 2 <= np.ptp(np.nonzero(torn.any(axis=0))[0]) <= 12  # 6 cm, 1 m away


@pytest.mark.parametrize("fault", ["all_invalid", "standby"])
def test_without_light_no_pixel_is_valid(fault: str) -> None:
    given: dict[str, Any] = {fault: True}
    seen = maps(Panel().met, **given)
    assert not seen.raw.any()
    assert seen.third.all()
