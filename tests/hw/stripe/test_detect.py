"""The line in pictures whose truth is known: sub-pixel, or none, and never another one."""

import numpy as np
import pytest

from hw.stripe.detect import Method, Stripe, StripeFinder
from tests.hw.stripe.pictures import F64, U8, Picture, slope

BOTH: tuple[Method, ...] = ("peak", "threshold")


def stripe_of(image: U8, method: Method = "peak", colour: str = "red") -> Stripe:
    size = image.shape[0], image.shape[1]
    return StripeFinder(size, method, colour, 3.3, 20.0).find(image)  # type: ignore[arg-type]


def off_px(found: Stripe, truth: F64) -> F64:
    """Errors where there are points."""
    off = np.abs(found.peaks_px - truth)
    return off[np.isfinite(off)]


def by_hand(rows: dict[int, int], height: int = 41, width: int = 40) -> U8:
    """Black but for the red of some rows."""
    image = np.zeros((height, width, 3), np.uint8)
    for row, value in rows.items():
        image[row, :, 2] = value
    return image


@pytest.mark.parametrize("method", BOTH)
def test_a_line_laid_by_hand_is_where_its_centre_of_gravity_is(method: Method) -> None:
    found = stripe_of(by_hand({19: 100, 20: 200, 21: 100}), method)
    np.testing.assert_allclose(found.peaks_px, 20.0)
    assert (found.contrasts > 50.0).all()
    assert (found.confidences > 0.2).all()


def test_between_two_rows_its_weights_decide() -> None:
    found = stripe_of(by_hand({19: 50, 20: 200, 21: 150}))
    np.testing.assert_allclose(found.peaks_px, (19 * 50 + 20 * 200 + 21 * 150) / 400)


@pytest.mark.parametrize("channel", [0, 1, 2])
def test_each_colour_is_found_and_is_none_to_the_others(channel: int) -> None:
    truth, colours = slope(), ("blue", "green", "red")
    image = Picture(1).line(truth, channel=channel).shot()
    for other, colour in enumerate(colours):
        found = stripe_of(image, colour=colour)
        assert found.share == (pytest.approx(1.0, abs=0.02) if other == channel else 0.0)


@pytest.mark.parametrize("method", BOTH)
@pytest.mark.parametrize("seed", range(3))
def test_a_noisy_line_is_found_to_less_than_a_third_of_a_pixel(method: Method, seed: int) -> None:
    truth = slope()
    found = stripe_of(Picture(seed).line(truth).shot(noise=6.0), method)
    off = off_px(found, truth)
    assert found.share > 0.95
    assert np.median(off) < 0.3
    assert method == "threshold" or np.percentile(off, 95) < 0.4


@pytest.mark.parametrize("method", BOTH)
def test_no_line_is_no_point_and_the_contrast_is_told(method: Method) -> None:
    image = Picture(4).spot(200.0, 300.0, 60.0, (90.0, 90.0, 90.0)).shot(noise=6.0)
    found = stripe_of(image, method)
    assert np.isnan(found.peaks_px).all()
    assert (found.contrasts < 20.0).all()
    assert (found.confidences == 0.0).all()


def test_where_a_line_ends_the_points_end() -> None:
    truth = slope()
    truth[200:320] = np.nan
    found = stripe_of(Picture(5).line(truth).shot())
    assert np.isnan(found.peaks_px[203:317]).all()
    assert np.isfinite(found.peaks_px[np.isfinite(truth)]).mean() > 0.97


@pytest.mark.parametrize("seed", range(4))
def test_beside_a_second_line_and_under_specular_spots_the_right_one_is_found(seed: int) -> None:
    truth = slope()
    picture = Picture(seed).line(truth)
    level = np.where(np.arange(640) % 160 < 40, 170.0, 75.0)  # now and then the brighter one
    picture.line(truth + 60.0 + 20.0 * np.sin(np.arange(640) / 90.0), level)
    picture.spot(90.0, 120.0, 7.0, (230.0, 230.0, 230.0)).spot(400.0, 500.0, 9.0, (60, 60, 255))
    picture.spot(truth[300] - 25.0, 300.0, 5.0, (0.0, 0.0, 255.0))
    found = stripe_of(picture.shot())
    right = np.abs(found.peaks_px - truth) < 1.5
    assert right.mean() > 0.95
    assert np.median(off_px(found, truth)) < 0.3


def test_a_saturated_line_is_found_by_its_flanks_with_less_confidence() -> None:
    truth = slope()
    good = stripe_of(Picture(6).line(truth).shot())
    picture = Picture(6)
    for channel, level in ((2, 700.0), (1, 150.0), (0, 150.0)):
        picture.line(truth, level, channel=channel)
    found = stripe_of(picture.shot())
    assert found.share > 0.9
    assert np.median(off_px(found, truth)) < 0.3
    assert np.median(found.confidences) < np.median(good.confidences)


def test_another_size_is_refused() -> None:
    finder = StripeFinder((40, 50), "peak", "red", 3.0, 20.0)
    with pytest.raises(ValueError, match="is needed"):
        finder.find(np.zeros((41, 50, 3), np.uint8))
