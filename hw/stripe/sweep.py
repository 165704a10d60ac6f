"""An image with its time to a sweep: a ray through the line in each column, and its range.

All rays begin in the camera's centre, at the instant of the image. A rolling shutter is not
allowed for: its rows are up to a frame apart.
"""

import numpy as np

from core.records import U8, PointSweep
from hw.stripe.detect import Stripe, StripeFinder
from hw.stripe.geometry import ranges_from_pixels, variance_of_range
from hw.stripe.options import StripeOptions
from jit import kernel

BLOCK_PX = 32  # of an image, that stays in the nearest cache while it is turned


@kernel
def turn(image: U8, out: U8) -> None:
    """Fills `out` (w, h, 3) with the image (h, w, 3), its rows as columns."""
    h, w = image.shape[0], image.shape[1]
    for top in range(0, h, BLOCK_PX):
        for left in range(0, w, BLOCK_PX):
            for u in range(left, min(w, left + BLOCK_PX)):
                for v in range(top, min(h, top + BLOCK_PX)):
                    for k in range(3):
                        out[u, v, k] = image[v, u, k]


class SweepMaker:
    """Makes sweeps of images of the size that is set; tells of the newest line."""

    def __init__(self, options: StripeOptions) -> None:
        self._options, self._counter = options, 0
        self._is_up = options.along == "rows"  # the line
        w, h = options.image_px
        size = (w, h) if self._is_up else (h, w)
        self._finder = StripeFinder(
            size, options.find, options.colour, options.line_px, options.contrast
        )
        self._turned = np.zeros((*size, 3), np.uint8)
        self._lens, self._plane = options.lens, options.plane
        self.maybe_stripe: Stripe | None = None  # of the newest image

    def sweep(self, image: U8, t_s: float, arrived_s: float) -> PointSweep:
        """Of an image (h, w, 3), blue green red, taken at t_s.

        Raises:
            ValueError: an image of another size.
        """
        if self._is_up:
            w, h = self._options.image_px
            if image.shape != (h, w, 3):
                raise ValueError(f"an image of {w} x {h} px is needed, this is {image.shape}")
            turn(np.ascontiguousarray(image), self._turned)
            image = self._turned
        stripe = self.maybe_stripe = self._finder.find(image)
        n = stripe.peaks_px.size
        along, across = np.arange(n, dtype=np.float64), stripe.peaks_px
        us, vs = (across, along) if self._is_up else (along, across)
        directions, ranges_m = np.zeros((n, 3)), np.zeros(n)
        most_m = float(self._options.max_range_m)
        ranges_from_pixels(us, vs, self._lens, self._plane, most_m, directions, ranges_m)
        self._counter += 1
        return PointSweep(
            origins=np.zeros((n, 3)),
            directions=directions,
            ranges_m=ranges_m[None, :],
            times_s=np.full(n, t_s),
            counter=self._counter,
            arrived_s=arrived_s,
        )

    def warm(self) -> None:
        """Run each kernel once, so that none is compiled while a robot drives."""
        w, h = self._options.image_px
        black = np.zeros((h, w, 3), np.uint8)
        self.sweep(black, 0.0, 0.0)
        turn(black, np.zeros((w, h, 3), np.uint8))
        variance_of_range(self._lens, self._plane, self._options.sigmas, w / 2.0, h / 2.0)
        self.maybe_stripe, self._counter = None, 0
