"""How well a lens is known: errors that are true; what is told of pictures that are too alike."""

import dataclasses

import numpy as np
import pytest

from hw.stripe.geometry import Lens
from tests.tools.calibration.chessboards import BOARD, HELD, SIZE, Held, lens_of, view
from tools.calibration.camera import ORDER, BoardsError, View, doubts, fit

pytest.importorskip("cv2", reason="needs OpenCV: pip install 'mapod[camera]'")
TRUE = Lens(610.0, 604.0, 330.0, 232.0, -0.21, 0.06, 0.0011, -0.0008, 0.0)
FAULTS = lens_of(TRUE[:2], TRUE[2:4], TRUE[4:])
EXACT = [view(held, FAULTS, f"{k}.jpg") for k, held in enumerate(HELD)]
NOISE_PX = 0.1


def noisy(views: list[View], random: np.random.Generator) -> list[View]:
    def moved(one: View) -> View:
        off_px = random.normal(0.0, NOISE_PX, one.corners_px.shape)
        return dataclasses.replace(one, corners_px=one.corners_px + off_px)

    return [moved(one) for one in views]


def test_the_errors_are_those_of_many_draws() -> None:
    random = np.random.default_rng(3)
    found = [fit(noisy(EXACT, random), BOARD, SIZE, False) for _ in range(40)]
    off = np.array([one.lens for one in found]) - np.array(TRUE)
    told = np.median([one.sigmas for one in found], axis=0)
    np.testing.assert_allclose(off[:, :8].std(axis=0), told[:8], rtol=0.4)
    assert np.all(np.abs(off[:, :8].mean(axis=0)) < told[:8])
    assert np.median([one.rms_px for one in found]) == pytest.approx(NOISE_PX * 2**0.5, rel=0.05)


def test_exact_corners_give_the_exact_lens_and_no_doubt() -> None:
    found = fit(EXACT, BOARD, SIZE, True)
    np.testing.assert_allclose(found.lens, TRUE, rtol=1e-3, atol=2e-4)
    assert len(found.sigmas) == len(ORDER)
    assert doubts(found, SIZE) == []


def told_of(held: list[Held]) -> str:
    random = np.random.default_rng(4)
    views = noisy([view(one, FAULTS, f"{k}.jpg") for k, one in enumerate(held)], random)
    return "\n".join(doubts(fit(views, BOARD, SIZE, False), SIZE))


def test_pictures_that_are_too_alike_are_told() -> None:
    told = told_of([Held(0.6, 0.0, 0.0, aside, 0) for aside in (-30, -15, 0, 15, 30)])
    assert "few pictures: 5; take 10 to 30" in told
    assert "corners in 25% of the image alone" in told
    assert "the board leans up or down by" in told
    assert "to the side" not in told
    assert "0.jpg and 11.jpg show the same" in told_of([*HELD[:-1], HELD[0]])


def test_a_picture_that_contradicts_the_others_is_named() -> None:
    bent = dataclasses.replace(EXACT[3], corners_px=EXACT[3].corners_px.copy())
    bent.corners_px[:9] += 8.0
    views = noisy([*EXACT[:3], bent, *EXACT[4:]], np.random.default_rng(5))
    told = doubts(fit(views, BOARD, SIZE, False), SIZE)
    assert "3.jpg fits" in told[0]
    assert "corners are missed by" in told[1]


def test_too_few_pictures_name_what_was_given() -> None:
    with pytest.raises(BoardsError, match=r"needs 4 pictures or more .* there are 3"):
        fit(EXACT[:3], BOARD, SIZE, False)
