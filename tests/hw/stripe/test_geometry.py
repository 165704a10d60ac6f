"""Ranges against a ray and a plane cut plainly, derivatives against differences."""

import math
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from hw.stripe.geometry import (
    LaserPlane,
    Lens,
    Sigmas,
    ranges_from_pixels,
    slopes_from_pixel,
    variance_of_range,
)

F64 = npt.NDArray[np.float64]
PLAIN = Lens(600.0, 610.0, 320.0, 240.0)
BENT = Lens(600.0, 610.0, 318.0, 243.0, -0.25, 0.08, 0.001, -0.002, 0.01)
ABOVE = LaserPlane(0.3, math.radians(20.0), 2)
BELOW = LaserPlane(-0.2, math.radians(-12.0), 2)
LEFT = LaserPlane(0.25, math.radians(25.0), 1)
SETUPS = [(lens, plane) for lens in (PLAIN, BENT) for plane in (ABOVE, BELOW, LEFT)]


def pixel_of(lens: Lens, point: F64) -> tuple[float, float]:
    """Where the camera sees a point (3,) of the sensor frame, by OpenCV's formula written out."""
    x, y = -point[1] / point[0], -point[2] / point[0]
    r2 = x * x + y * y
    radial = 1 + lens.k1 * r2 + lens.k2 * r2**2 + lens.k3 * r2**3
    x_d = x * radial + 2 * lens.p1 * x * y + lens.p2 * (r2 + 2 * x * x)
    y_d = y * radial + lens.p1 * (r2 + 2 * y * y) + 2 * lens.p2 * x * y
    return lens.cx + lens.fx * x_d, lens.cy + lens.fy * y_d


def cut(plane: LaserPlane, ray: F64) -> F64:
    """Where a ray from the camera's centre meets the plane through three points of it."""
    a = np.zeros(3)
    a[plane.axis] = plane.baseline_m
    along = np.zeros(3)
    along[3 - plane.axis] = 1.0  # the other of y and z
    dip = np.array([math.cos(plane.beta_rad), 0.0, 0.0])
    dip[plane.axis] = -math.sin(plane.beta_rad)
    normal = np.cross(along, dip)
    return np.asarray(ray * (normal @ a) / (normal @ ray))


def measured(lens: Lens, plane: LaserPlane, u: float, v: float) -> tuple[float, F64]:
    directions, ranges_m = np.zeros((1, 3)), np.zeros(1)
    ranges_from_pixels(np.array([u]), np.array([v]), lens, plane, 100.0, directions, ranges_m)
    return float(ranges_m[0]), directions[0]


@pytest.mark.parametrize(("lens", "plane"), SETUPS)
def test_points_of_the_plane_are_found_again_from_their_pixels(
    lens: Lens, plane: LaserPlane
) -> None:
    rng = np.random.default_rng(1)
    for _ in range(50):
        away_m, aside_m = rng.uniform(0.4, 3.0), rng.uniform(-0.1, 0.1)
        point = np.array([away_m, aside_m, aside_m])
        point[plane.axis] = plane.baseline_m - away_m * math.tan(plane.beta_rad)
        if abs(point[plane.axis]) > 0.5 * away_m:
            continue
        range_m, ray = measured(lens, plane, *pixel_of(lens, point))
        np.testing.assert_allclose(range_m * ray, point, atol=1e-8)
        np.testing.assert_allclose(cut(plane, ray), point, atol=1e-8)


def test_by_hand_the_axis_is_met_at_the_baseline_over_the_tangent() -> None:
    range_m, ray = measured(PLAIN, ABOVE, 320.0, 240.0)
    assert range_m == pytest.approx(0.3 / math.tan(math.radians(20.0)))
    np.testing.assert_allclose(ray, [1.0, 0.0, 0.0])
    range_m, ray = measured(PLAIN, LaserPlane(0.5, math.pi / 4, 2), 320.0, 240.0 - 610.0)
    assert range_m * ray == pytest.approx([0.25, 0.0, 0.25])  # q = -1: x = 0.5 / (1 + 1)


def test_above_the_planes_horizon_and_where_no_line_is_there_is_no_range() -> None:
    beyond = 240.0 + 610.0 * math.tan(math.radians(20.0))
    for v in (beyond + 1.0, beyond + 0.01, math.nan):  # behind us, too far, no line
        range_m, ray = measured(PLAIN, ABOVE, 320.0, v)
        assert math.isnan(range_m)
        assert np.linalg.norm(ray) == pytest.approx(1.0)


@pytest.mark.parametrize(("lens", "plane"), SETUPS)
@pytest.mark.parametrize(("u", "v"), [(320.0, 240.0), (150.0, 180.0), (250.0, 300.0)])
def test_derivatives_are_those_of_differences(
    lens: Lens, plane: LaserPlane, u: float, v: float
) -> None:
    def by(step: float, **changed: Any) -> float:
        """Central difference by the one thing that is changed."""
        ((name, unit),) = changed.items()
        ends = []
        for sign in (1.0, -1.0):
            moved, at = plane, [u, v]
            if name == "pixel":
                at[plane.axis - 1] += sign * step * unit
            else:
                moved = plane._replace(**{name: getattr(plane, name) + sign * step * unit})
            ends.append(measured(lens, moved, at[0], at[1])[0])
        return float((ends[0] - ends[1]) / (2 * step * unit))

    range_m, _ = measured(lens, plane, u, v)
    if math.isnan(range_m):
        pytest.skip("no point of the plane is seen there")
    sigmas = Sigmas(0.001, 0.002, 0.3)
    variance, by_b, by_beta, by_w = variance_of_range(lens, plane, sigmas, u, v)
    assert by_b == pytest.approx(by(1e-6, baseline_m=1.0), rel=1e-5)
    assert by_beta == pytest.approx(by(1e-6, beta_rad=1.0), rel=1e-5)
    assert by_w == pytest.approx(by(1e-3, pixel=1.0), rel=1e-5)
    parts = (by_b * 0.001) ** 2 + (by_beta * 0.002) ** 2 + (by_w * 0.3) ** 2
    assert variance == pytest.approx(parts)


def test_the_variance_is_that_of_many_draws() -> None:
    rng, sigmas, n = np.random.default_rng(2), Sigmas(0.002, 0.001, 0.3), 4000
    variance, *_ = variance_of_range(BENT, ABOVE, sigmas, 200.0, 260.0)
    drawn = [
        measured(BENT, LaserPlane(b, beta, 2), 200.0, v)[0]
        for b, beta, v in zip(
            rng.normal(ABOVE.baseline_m, sigmas.baseline_m, n),
            rng.normal(ABOVE.beta_rad, sigmas.beta_rad, n),
            rng.normal(260.0, sigmas.pixel, n),
            strict=True,
        )
    ]
    assert np.var(drawn) == pytest.approx(variance, rel=0.1)


def test_the_error_by_pixels_grows_with_the_square_of_the_distance() -> None:
    sigmas, errors = Sigmas(0.0, 0.0, 0.3), []
    for away_m in (1.0, 2.0):
        q = math.tan(ABOVE.beta_rad) - ABOVE.baseline_m / away_m
        variance, *_ = variance_of_range(PLAIN, ABOVE, sigmas, 320.0, 240.0 + 610.0 * q)
        errors.append(math.sqrt(variance) / away_m**2)
    assert errors[0] == pytest.approx(errors[1], rel=0.1)
    assert errors[1] == pytest.approx(0.3 / 610.0 / 0.3, rel=0.1)  # s_w / (f b)


def test_a_lens_without_a_way_back_gives_nothing() -> None:
    folded = Lens(600.0, 600.0, 320.0, 240.0, -2.0)
    assert all(map(math.isnan, slopes_from_pixel(folded, 5000.0, 240.0)))
