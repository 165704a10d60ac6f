"""Kernels of method "threshold": pixels of the laser's colour, mended, and their middle.

A pixel counts where the laser's channel and its lead over both others are large enough. Opening
along the line (3 pixels) takes away specks, closing (3 x 3) mends the line's holes; the centre of
what is left in a column is the line. It cannot tell two lines: their middle is what it gives.

Source: the way of the paper of 2011, as far as it is told of; its numbers are not known.
"""

import math

import numpy as np

from core.records import F64, U8
from jit import kernel


@kernel
def colour_mask(image: U8, laser: int, level: int, lead: int, mask: U8) -> None:
    """Fills the mask (h, w): 1 where the image (h, w, 3) has the laser's colour."""
    one, two = (laser + 1) % 3, (laser + 2) % 3
    for v in range(mask.shape[0]):
        for u in range(mask.shape[1]):
            value = np.int64(image[v, u, laser])  # of bytes Numba makes unsigned numbers
            others = max(np.int64(image[v, u, one]), np.int64(image[v, u, two]))
            mask[v, u] = 1 if value >= level and value - others >= lead else 0


@kernel
def morph_rows(given: U8, is_any: bool, out: U8) -> None:
    """Fills `out` (h, w) with dilation (is_any) or erosion over three columns of each row.

    What lies beyond an edge counts neither for nor against.
    """
    h, w = given.shape
    for v in range(h):
        for u in range(w):
            left, middle, right = given[v, max(0, u - 1)], given[v, u], given[v, min(w - 1, u + 1)]
            out[v, u] = (left | middle | right) if is_any else (left & middle & right)


@kernel
def morph_columns(given: U8, is_any: bool, out: U8) -> None:
    """The same over three rows of each column."""
    h, w = given.shape
    for v in range(h):
        above, below = max(0, v - 1), min(h - 1, v + 1)
        for u in range(w):
            first, middle, last = given[above, u], given[v, u], given[below, u]
            out[v, u] = (first | middle | last) if is_any else (first & middle & last)


@kernel
def centres_of_mask(
    image: U8, laser: int, mask: U8, outside: F64, peaks_px: F64, contrasts: F64, widths_px: F64
) -> None:
    """Fills each column's centre (NaN: none), contrast (levels) and width (rows); each (w,).

    Args:
        outside: (w,) room.
    """
    h, w = mask.shape
    one, two = (laser + 1) % 3, (laser + 2) % 3
    for u in range(w):
        peaks_px[u] = contrasts[u] = widths_px[u] = 0.0
        outside[u] = 0.0
    for v in range(h):
        for u in range(w):
            others = np.int64(image[v, u, one]) + np.int64(image[v, u, two])
            signal = np.int64(image[v, u, laser]) - 0.5 * others
            if mask[v, u]:
                widths_px[u] += 1.0
                peaks_px[u] += v
                contrasts[u] += signal
            else:
                outside[u] += signal
    for u in range(w):
        count = widths_px[u]
        if count > 0.0:
            peaks_px[u] /= count
            contrasts[u] = contrasts[u] / count - outside[u] / max(1.0, h - count)
        else:
            peaks_px[u] = math.nan
