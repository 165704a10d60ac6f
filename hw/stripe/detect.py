"""The laser's line in an image: one place in each column, or none.

Where a column has no line it gets no point, and its contrast says how far it was from one. Rows and
columns are pixels of the image as it came, 0 in the middle of the first one. A line nearer to the
upper or lower edge than about four times its width is none for method "peak": nothing is known of
what lies beyond it.
"""

from typing import Literal

import numpy as np
from msgspec import Struct

from core.records import F64, U8
from hw.stripe.peak import (
    KEPT,
    SIGMA_OF_FWHM,
    choose_bumps,
    find_bumps,
    measure_bumps,
    sum_signal,
)
from hw.stripe.threshold import centres_of_mask, colour_mask, morph_columns, morph_rows

Method = Literal["threshold", "peak"]
Colour = Literal["red", "green", "blue"]
CHANNELS: dict[Colour, int] = {"blue": 0, "green": 1, "red": 2}  # as OpenCV has them
LEVEL = 80  # of the laser's channel, that method "threshold" asks for at least


class Stripe(Struct, frozen=True, eq=False):
    """The line of one image, column by column; each (w,)."""

    peaks_px: F64  # row of its middle; NaN: no line there
    contrasts: F64  # levels (0..255) above what is around it; of the best that there is, or 0
    confidences: F64  # 0..1; 0: no line there

    @property
    def share(self) -> float:
        """Of the columns that have a line."""
        return float(np.isfinite(self.peaks_px).mean())


class StripeFinder:
    """Finds the line in images of one size, with room for all that this needs.

    Args:
        size: height and width of the images.
        width_px: of the line, between the places of half its height.
        contrast: that a line has at least, levels of 0..255.
    """

    def __init__(
        self,
        size: tuple[int, int],
        method: Method,
        colour: Colour,
        width_px: float,
        contrast: float,
    ) -> None:
        self.size, self._method, self._laser = size, method, CHANNELS[colour]
        self._contrast, self._half = contrast, max(1, round(width_px / 2))
        self._sigma_px = SIGMA_OF_FWHM * width_px
        h, w = size
        self._chosen = np.zeros(w, np.int32)
        if method == "threshold":
            self._masks = np.zeros((2, h, w), np.uint8)
            return
        self._sums, self._rough = np.zeros((h + 1, w), np.int32), np.zeros(w)
        self._limits, self._of_row, self._last = np.zeros((3, w), np.int32)
        self._rows, self._heights = np.zeros((2, KEPT, w), np.int32)
        self._centres, self._confidences = np.zeros((2, KEPT, w))
        self._gains, self._came_from = np.zeros((2, KEPT + 1)), np.zeros((w, KEPT + 1), np.int32)

    def find(self, image: U8) -> Stripe:
        """The line in an image (h, w, 3), blue green red."""
        if image.shape != (*self.size, 3):
            raise ValueError(f"an image of {(*self.size, 3)} is needed, this is {image.shape}")
        image = np.ascontiguousarray(image)
        return self._by_threshold(image) if self._method == "threshold" else self._by_peak(image)

    def _by_peak(self, image: U8) -> Stripe:
        laser, half, sums, limits = self._laser, self._half, self._sums, self._limits
        rows, heights = self._rows, self._heights
        centres, confidences = self._centres, self._confidences
        sum_signal(image, laser, sums, self._rough)
        find_bumps(
            *(sums, self._rough, half, self._contrast),
            *(limits, self._of_row, self._last, rows, heights),
        )
        measure_bumps(
            image, laser, sums, half, self._sigma_px, limits, rows, heights, centres, confidences
        )
        choose_bumps(heights, centres, confidences, self._gains, self._came_from, self._chosen)
        found, columns = self._chosen >= 0, np.arange(self._chosen.size)
        peaks_px = np.where(found, centres[self._chosen, columns], np.nan)
        told = np.where(found, heights[self._chosen, columns], heights.max(axis=0))
        return Stripe(
            peaks_px,
            told / (2.0 * (2 * half + 1)),
            np.where(found, confidences[self._chosen, columns], 0.0),
        )

    def _by_threshold(self, image: U8) -> Stripe:
        mask, other = self._masks
        outside, peaks_px, contrasts, widths_px = np.zeros((4, self.size[1]))
        colour_mask(image, self._laser, LEVEL, round(self._contrast), mask)
        morph_rows(mask, False, other)  # opening
        morph_rows(other, True, mask)
        for is_any in (True, False):  # closing
            morph_rows(mask, is_any, other)
            morph_columns(other, is_any, mask)
        centres_of_mask(image, self._laser, mask, outside, peaks_px, contrasts, widths_px)
        return Stripe(peaks_px, contrasts, np.clip(contrasts / 255.0, 0.0, 1.0))
