"""An image to a sweep, and what the settings promise of it."""

import math
from typing import Any

import numpy as np
import pytest

from core.mapping.rays import check_sweep
from hw.stripe.options import StripeOptions
from hw.stripe.sweep import SweepMaker
from tests.hw.stripe.pictures import F64, U8, Picture

GIVEN: dict[str, Any] = {
    "path": "/stream", "rate_hz": 10.0, "latency_s": 0.05, "image_px": [640, 480],
    "along": "columns", "find": "peak", "colour": "red", "line_px": 3.3, "contrast": 20.0,
    "focal_px": [600.0, 600.0], "centre_px": [319.5, 239.5], "distortion": [0.0] * 5,
    "baseline_m": 0.3, "laser_deg": 20.0, "sigma_px": 0.3, "sigma_baseline_m": 0.001,
    "sigma_laser_deg": 0.1, "max_range_m": 4.0,
}  # fmt: skip


def options_of(**changes: Any) -> StripeOptions:
    return StripeOptions(**{**GIVEN, **changes})


def rows_of_wall(away_m: F64) -> F64:
    """Rows of the line on walls across the view, so far ahead, as GIVEN has camera and laser."""
    return np.asarray(239.5 + 600.0 * (math.tan(math.radians(20.0)) - 0.3 / away_m))


def walls_m() -> F64:
    """A wall 1.2 m ahead, and right of it one at 2.0 m; between them nothing."""
    away_m = np.where(np.arange(640) < 300, 1.2, 2.0)
    away_m[290:320] = np.nan
    return away_m


def shot(along: str) -> U8:
    image = Picture(1).line(rows_of_wall(walls_m())).shot()
    if along == "rows":  # the picture of a camera that lies on its side: left is up
        image = np.ascontiguousarray(image.transpose(1, 0, 2))
    return image


@pytest.mark.parametrize("along", ["columns", "rows"])
def test_walls_are_where_they_stand(along: str) -> None:
    turned = {"image_px": [480, 640], "centre_px": [239.5, 319.5]} if along == "rows" else {}
    options = options_of(along=along, **turned)
    sweep = SweepMaker(options).sweep(shot(along), 7.0, 7.1)
    check_sweep(sweep, options.spec.max_beams)
    points = sweep.ranges_m[0][:, None] * sweep.directions
    truth_m = walls_m()
    off_m = np.abs(points[:, 0] - truth_m)
    assert np.nanmedian(off_m) < 0.01
    assert np.isfinite(points[:, 0][np.isfinite(truth_m)]).mean() > 0.97
    assert np.isnan(sweep.ranges_m[0, 295:315]).all()
    np.testing.assert_allclose(np.linalg.norm(sweep.directions, axis=1), 1.0)
    aside = 1 if along == "columns" else 2
    np.testing.assert_allclose(points[100, aside], 1.2 * (319.5 - 100) / 600.0, atol=0.01)
    assert (sweep.times_s == 7.0).all()
    assert (sweep.counter, sweep.arrived_s) == (1, 7.1)


def test_errors_are_as_large_as_the_settings_say() -> None:
    """At the range of the spec's share, with the pixel's error alone."""
    options = options_of(sigma_baseline_m=0.0, sigma_laser_deg=0.0, max_range_m=2.0)
    assert options.spec.sigma_share * 2.0 == pytest.approx(2.0**2 / (600 * 0.3) * 0.3, rel=0.1)
    assert options.spec.sigma_m < options.spec.sigma_share * 2.0
    assert options.spec.directions.shape == (640, 3)
    assert "0.3 m above it, dipping 20 deg" in options.describe()


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"baseline_m": 0.0}, "baseline_m: must be 0.01 m or more"),
        ({"focal_px": [600.0, 0.0]}, "focal_px: must be above 0"),
        ({"focal_px": [math.inf, 600.0]}, "focal_px: must be above 0, up to 50000, is .inf"),
        ({"focal_px": [600.0, 1e308]}, "focal_px: must be above 0, up to 50000"),
        ({"focal_px": [math.nan, 600.0]}, "focal_px: must be above 0, up to 50000"),
        ({"centre_px": [319.5, 1e9]}, "centre_px: must be within -480 to 960 px of height"),
        ({"centre_px": [math.nan, 239.5]}, "centre_px: must be within -640 to 1280 px of width"),
        ({"distortion": [-3.0, 0.0, 0.0, 0.0, 0.0]}, "distortion: folds the image"),
        ({"laser_deg": -60.0}, "laser_deg: must let the camera see"),
    ],
)
def test_what_cannot_be_is_refused(changes: dict[str, Any], told: str) -> None:
    with pytest.raises(ValueError, match=told):
        options_of(**changes)


@pytest.mark.parametrize("along", ["columns", "rows"])
def test_an_image_of_another_size_is_refused(along: str) -> None:
    with pytest.raises(ValueError, match="is needed"):
        SweepMaker(options_of(along=along)).sweep(np.zeros((240, 320, 3), np.uint8), 0.0, 0.0)
