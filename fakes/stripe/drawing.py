"""Kernels that put light onto the fake camera's sensor."""

import math

import numpy as np
import numpy.typing as npt

from fakes.rays.kernels import F64
from jit import kernel

F32 = npt.NDArray[np.float32]
U8 = npt.NDArray[np.uint8]
REACH = 4.0  # sigmas of the line's profile that are drawn
READ_LEVELS, SHOT_LEVELS = 1.2, 0.12  # noise: of reading; variance of light, by its level


@kernel
def draw_line(
    columns: F64, rows: F64, levels: F64, sigma_px: float, along: int, light: F32
) -> None:
    """Add the light of the laser's rays to the sensor's (h, w).

    Args:
        columns, rows, levels: (n,) where each falls, and the sum of levels that it brings.
        along: 0 for a line across the image, each ray on the two columns beside it; 1 for one up.
    """
    h, w = light.shape
    peak = 1.0 / (sigma_px * math.sqrt(2.0 * math.pi))
    most = w if along == 0 else h  # lines that may be drawn on
    deep = h if along == 0 else w
    for k in range(len(columns)):
        aside, across = (columns[k], rows[k]) if along == 0 else (rows[k], columns[k])
        if not (-1.0 < aside < most and -REACH * sigma_px < across < deep + REACH * sigma_px):
            continue
        first = math.floor(aside)
        low = max(0, math.ceil(across - REACH * sigma_px))
        high = min(deep - 1, math.floor(across + REACH * sigma_px))
        for place in range(low, high + 1):
            off = (place - across) / sigma_px
            level = levels[k] * peak * math.exp(-0.5 * off * off)
            for line in range(first, first + 2):
                if 0 <= line < most:
                    share = level * (1.0 - abs(line - aside))
                    if along == 0:
                        light[place, line] += np.float32(share)
                    else:
                        light[line, place] += np.float32(share)


@kernel
def expose(
    ambient: F64,
    every_px: int,
    light: F32,
    response: F64,
    gain: float,
    speckle: float,
    noise: float,
    chance: F32,
    first: int,
    image: U8,
) -> None:
    """Fill the image (h, w, 3) with what the sensor makes of its light.

    Args:
        ambient: levels (m, k, 3) at every so many pixels.
        response: (3,) of blue, green and red to the laser.
        gain: times all levels.
        chance: (a power of two,) of unit variance, from `first` on.
    """
    h, w = light.shape
    mask = len(chance) - 1
    at = first
    for v in range(h):
        row, below = v // every_px, (v % every_px) / every_px
        for u in range(w):
            column, beside = u // every_px, (u % every_px) / every_px
            line = gain * light[v, u]
            if line > 0.0:
                line *= max(0.0, 1.0 + speckle * chance[(3 * at + 77) & mask])
            for k in range(3):
                upper = (1 - beside) * ambient[row, column, k] + beside * ambient[
                    row, column + 1, k
                ]
                lower = (1 - beside) * ambient[row + 1, column, k]
                lower += beside * ambient[row + 1, column + 1, k]
                level = gain * ((1 - below) * upper + below * lower) + line * response[k]
                sigma = noise * math.sqrt(READ_LEVELS * READ_LEVELS + SHOT_LEVELS * level)
                level += sigma * chance[at & mask]
                at += 1
                image[v, u, k] = np.uint8(min(255.0, max(0.0, math.floor(level + 0.5))))
