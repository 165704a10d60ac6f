"""The peer of the stripe's bench does the same: it finds the same points, so its cost compares."""

import numpy as np
import pytest

from config_file import load_config
from hw.stripe.images import Decoder
from hw.stripe.options import StripeOptions
from hw.stripe.sweep import SweepMaker
from tools.bench.stripe import SETTINGS, PlainPeer, images

pytest.importorskip("cv2", reason="needs OpenCV: pip install 'mapod[camera]'")


def test_both_find_the_same_points() -> None:
    options = load_config(SETTINGS.read_text(encoding="utf-8")).scanner.options
    assert isinstance(options, StripeOptions)
    [jpeg], maker = images(1), SweepMaker(options)
    image = Decoder((640, 480)).image(jpeg)
    assert isinstance(image, np.ndarray)
    ours_m = maker.sweep(image, 0.0, 0.0).ranges_m[0]
    _, ranges_m = PlainPeer(options).ranges_m(jpeg)
    both = np.isfinite(ours_m) & np.isfinite(ranges_m)
    assert both.mean() > 0.9
    assert np.median(np.abs(ours_m - ranges_m)[both]) < 0.002
