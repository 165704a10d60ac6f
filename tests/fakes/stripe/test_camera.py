"""What the fake camera draws, against geometry that is worked out by hand."""

import math
from typing import Any

import numpy as np
import pytest

from fakes.scenes.scene import Scene
from fakes.scenes.solids import Material, Shape, Solid
from fakes.stripe.camera import HEIGHT, WIDTH, Line
from fakes.stripe.device import FakeStripe
from fakes.stripe.lens import pixels_from_points, ways_from_pixels
from fakes.world.kinematic import KinematicWorld
from fakes.world.simple import Ground
from fakes.world.trajectory import Way, stand

FLOOR = Solid("floor", (-5.0, 5.0), (-5.0, 5.0), (-1.0, 0.0))
QUIET: dict[str, Any] = {"noise": 0.0, "speckle": 0.0, "ambient": "dark"}
BENT = (-0.25, 0.08, 0.001, -0.002, 0.01)


def camera(*solids: Shape, **attributes: Any) -> FakeStripe:
    """Above the floor and these, or without any before a wall 1.2 m ahead."""
    if solids:
        world = KinematicWorld(Scene("here", (FLOOR, *solids)), Way(stand(10.0)))
        world.step_to(0.0)
        fake = FakeStripe(world.met, 1)
    else:
        fake = FakeStripe(Ground("wall:1.2").met, 1)
    for name, value in attributes.items():
        setattr(fake, name, value)
    return fake


def line_of(fake: FakeStripe) -> Line:
    fake.camera.image(0.0)
    line = fake.camera.line
    assert line is not None
    return line


def middles(image: Any, channel: int = 2) -> Any:
    """Rows (w,) of the light's middle in each column; NaN where there is none."""
    light = image[:, :, channel].astype(float)
    light[light < 10] = 0.0
    with np.errstate(invalid="ignore"):
        return (light * np.arange(len(image))[:, None]).sum(axis=0) / light.sum(axis=0)


def test_a_wall_has_the_line_where_triangles_say() -> None:
    fake = camera(**QUIET, tilt_deg=0.0)
    rows = middles(fake.camera.image(0.0))
    away_m = 1.2 - 0.2
    height_m = 0.12 - away_m * math.tan(math.radians(11.0))
    assert rows == pytest.approx(239.5 - 600 * height_m / away_m, abs=0.1)


def test_the_line_is_as_wide_as_it_is_told_and_has_the_lasers_colour() -> None:
    fake = camera(**QUIET, tilt_deg=0.0, line_px=6.0, colour="green", laser=3.0)
    image = fake.camera.image(0.0).astype(int)
    column = image[:, 320]
    half = column[:, 1].max() / 2
    assert 5 <= (column[:, 1] > half).sum() <= 7
    assert column[:, 1].max() > 5 * max(column[:, 0].max(), column[:, 2].max())


def test_beside_the_camera_the_laser_draws_a_line_up_the_image() -> None:
    fake = camera(**QUIET, tilt_deg=0.0, along="rows", laser_deg=9.0, baseline_m=0.1)
    image = fake.camera.image(0.0)
    columns = middles(np.transpose(image, (1, 0, 2)))
    left_m = 0.1 - math.tan(math.radians(9.0))
    on_wall = columns[:400]  # below is the floor
    assert on_wall[np.isfinite(on_wall)] == pytest.approx(319.5 - 600 * left_m, abs=0.2)
    assert np.isfinite(on_wall).mean() > 0.9


def test_a_place_that_the_laser_reaches_and_the_camera_does_not_see_has_no_light() -> None:
    """Behind a box as high as h, down to the line of sight: the laser comes from 51 deg above."""
    meets_m = 0.2 + 0.4 / math.tan(math.radians(40.0))
    edge_m = meets_m - 0.1  # h / tan(51 deg) = 0.081 < 0.1 < 0.119 = h / tan(40 deg)
    box = Solid("box", (edge_m - 0.1, edge_m), (-0.1, 0.1), (0.0, 0.1))
    image = camera(box, **QUIET).camera.image(0.0)
    lit = np.isfinite(middles(image))
    behind = np.abs(np.arange(WIDTH) - 319.5) < 600 * 0.09 / 0.62
    assert not lit[behind].any()
    assert lit[np.abs(np.arange(WIDTH) - 319.5) > 600 * 0.12 / 0.5].all()
    low = Solid("box", (edge_m - 0.1, edge_m), (-0.1, 0.1), (0.0, 0.05))  # seen over its edge
    assert np.isfinite(middles(camera(low, **QUIET).camera.image(0.0))).all()


def test_what_is_black_returns_little_and_what_is_far_less() -> None:
    def brightest(away_m: float, material: Material) -> float:
        wall = Solid("wall", (0.2 + away_m, 2.0), (-4.0, 4.0), (0.0, 2.0), material=material)
        levels = line_of(camera(wall, **QUIET, tilt_deg=0.0, texture=0.0)).levels
        return float(levels.max())

    plain, black = Material("plain"), Material("black")
    assert brightest(0.5, black) < 0.1 * brightest(0.5, plain)
    assert brightest(1.0, plain) == pytest.approx(brightest(0.5, plain) / 4, rel=0.1)


def test_the_lens_bends_and_its_way_back_is_the_same() -> None:
    fake = camera(distortion=BENT)
    columns, rows = (part.ravel() for part in np.mgrid[0:WIDTH:80.0, 0:HEIGHT:60.0])
    ways = ways_from_pixels(fake, columns, rows)
    again = pixels_from_points(fake, 3.0 * ways)
    np.testing.assert_allclose(again, (columns, rows), atol=1e-6)
    straight = line_of(camera(tilt_deg=0.0)).rows
    bent = line_of(camera(tilt_deg=0.0, distortion=BENT)).rows
    assert np.ptp(straight) < 0.01 < 0.1 < np.ptp(bent)


def test_light_and_exposure_decide_how_bright_it_is() -> None:
    def mean(**attributes: Any) -> float:
        return float(camera(**attributes).camera.image(0.0).mean())

    dark, lamp, window, sun = (mean(ambient=a) for a in ("dark", "lamp", "window", "sun"))
    assert dark < 3 < 15 < lamp < 35 < 50 < window < 250 < sun
    assert mean(ambient="lamp", exposure=0.5) == pytest.approx(lamp / 2, rel=0.15)
    assert mean(ambient="sun", auto_exposure=True) == pytest.approx(110.0, rel=0.1)


def test_it_takes_the_same_pictures_again_with_the_same_seed_and_no_two_alike() -> None:
    one, two = camera(), camera()
    first, second = one.camera.image(0.0), one.camera.image(0.0)
    assert (two.camera.image(0.0) == first).all()
    assert (first != second).mean() > 0.3
