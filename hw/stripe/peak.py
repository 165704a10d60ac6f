"""Kernels of method "peak": bumps of a line's width in each column, then one way through them.

The signal of a pixel is the laser's colour minus the mean of the other two. A bump is where the
mean over a line's width stands above the brighter of the two sides by more than a limit, so that
an edge is none. Each bump's centre of gravity, width and saturation are measured above the local
background; the way through the columns that gains most confidence, less what its jumps cost,
decides which bump is the line (dynamic programming, Viterbi), or that there is none.

Our own method; the numbers are ours, tried on drawn lines.
"""

import math

import numpy as np

from core.records import F64, I32, U8
from jit import kernel

KEPT = 4  # bumps of a column
SATURATED = 250  # of 255
NOISE_SIGMAS = 5.0  # of the mean over a line's width: less is noise
MEAN_OF_DIFFERENCES = 1.128  # of two normal numbers, in their sigmas: 2 / sqrt(pi)
LEAST_CONFIDENCE = 0.1  # of a bump that may be the line
JUMP_A_PX, JUMP_MOST = 0.1, 8.0  # what a step from column to column costs, in confidences
GAP = 4.0  # what it costs to lose the line, and again to find it
ALONE = 0.25  # of these costs, where no other bump is to be had: a thin thing far from the rest
SIGMA_OF_FWHM = 0.4247  # of a normal profile


@kernel
def sum_signal(image: U8, laser: int, sums: I32, rough: F64) -> None:
    """Fills twice the signal, summed down each column, and its mean step from row to row.

    Args:
        image: (h, w, 3).
        laser: the laser's channel, 0..2.
        sums: (h + 1, w).
        rough: (w,).
    """
    h, w = image.shape[0], image.shape[1]
    one, two = (laser + 1) % 3, (laser + 2) % 3
    for u in range(w):
        sums[0, u], rough[u] = 0, 0.0
    for v in range(h):
        for u in range(w):
            signal = (
                2 * np.int64(image[v, u, laser])
                - np.int64(image[v, u, one])
                - np.int64(image[v, u, two])
            )
            sums[v + 1, u] = sums[v, u] + signal
        if v > 0:
            for u in range(w):
                step = sums[v + 1, u] - 2 * sums[v, u] + sums[v - 1, u]
                rough[u] += abs(step)
    for u in range(w):
        rough[u] /= max(1, h - 1)


@kernel
def find_bumps(
    sums: I32, rough: F64, half: int, least: float,
    limits: I32, of_row: I32, last: I32, rows: I32, heights: I32,
) -> None:  # fmt: skip
    """Fills the rows and heights of the highest bumps of each column, as far as there are any.

    A row's heights are all made first, without a branch, which takes a fifth of the time; most rows
    have no bump.

    Args:
        half: of a line's width in rows; 2 * half + 1 are its core, and each side.
        least: contrast of a bump, levels of 0..255.
        limits, of_row, last: (w,) room; limits are what a height must exceed.
        rows, heights: (KEPT, w); a height is in sums of twice the signal, 0: no bump.
    """
    h, w = sums.shape[0] - 1, sums.shape[1]
    core = 2 * half + 1
    reach = 2 * half + core  # from the middle to the far end of a side
    for u in range(w):
        sigma = NOISE_SIGMAS * rough[u] / MEAN_OF_DIFFERENCES * math.sqrt(2.0 * core)
        limits[u], last[u] = int(max(2.0 * core * least, sigma)), -1
        for k in range(KEPT):
            rows[k, u], heights[k, u] = -1, 0
    for v in range(reach, h - reach):
        over = 0
        for u in range(w):
            before = sums[v - 2 * half, u] - sums[v - reach, u]
            behind = sums[v + 1 + reach, u] - sums[v + 1 + 2 * half, u]
            of_row[u] = sums[v + half + 1, u] - sums[v - half, u] - max(before, behind)
            over += of_row[u] > limits[u]
        u = 0
        while over > 0:
            if of_row[u] > limits[u]:
                keep_bump(v, u, of_row[u], core, last, rows, heights)
                over -= 1
            u += 1


@kernel
def keep_bump(v: int, u: int, height: int, core: int, last: I32, rows: I32, heights: I32) -> None:
    """Take it in: as the newest bump's summit, or as a bump of its own instead of the lowest."""
    k = last[u]
    if k >= 0 and v - rows[k, u] <= core:
        if height > heights[k, u]:
            rows[k, u], heights[k, u] = v, height
        return
    k = 0
    for other in range(1, KEPT):
        if heights[other, u] < heights[k, u]:
            k = other
    if height > heights[k, u]:
        rows[k, u], heights[k, u], last[u] = v, height, k


@kernel
def measure_bump(
    image: U8, laser: int, at: tuple[int, int], half: int, sides: tuple[float, float]
) -> tuple[float, float, float]:
    """Centre (row), sigma (rows) and saturated share of the bump at (v, u).

    Its window follows its centre; what is saturated counts as the laser's whole channel, for a
    core that is white has no colour.

    Args:
        sides: mean signal before and behind the line.
    """
    h, (v, u) = image.shape[0], at
    one, two = (laser + 1) % 3, (laser + 2) % 3
    reach, centre, sigma, share = 2 * half, float(v), 0.0, 0.0
    for _ in range(3):
        middle = math.floor(centre + 0.5)
        total = first = second = 0.0
        full = 0
        for row in range(max(0, middle - reach), min(h, middle + reach + 1)):
            value = float(image[row, u, laser])
            if value >= SATURATED:
                full += 1
            else:
                value -= 0.5 * (float(image[row, u, one]) + float(image[row, u, two]))
            along = (row - v + reach) / (2.0 * reach)  # 0..1 from side to side
            value -= sides[0] + min(1.0, max(0.0, along)) * (sides[1] - sides[0])
            if value > 0.0:
                off = row - v
                total, first, second = total + value, first + value * off, second + value * off**2
        if total <= 0.0:
            return float(v), 0.0, 0.0
        mean = first / total
        sigma = math.sqrt(max(0.0, second / total - mean * mean))
        share = full / (2.0 * half + 1.0)
        if abs(mean) > reach:  # what it hung on was something beside it
            return float(v), 0.0, share
        if math.floor(v + mean + 0.5) == middle:
            return v + mean, sigma, share
        centre = v + mean
    return centre, sigma, share


@kernel
def measure_bumps(
    image: U8,
    laser: int,
    sums: I32,
    half: int,
    sigma_px: float,
    limits: I32,
    rows: I32,
    heights: I32,
    centres: F64,
    confidences: F64,
) -> None:
    """Fills centres (rows) and confidences (0..1) of the bumps, each (KEPT, w).

    A confidence is the product of three: of the contrast, 0 at its limit; of the width, 0.6 where
    it is twice or half of the line's; of saturation, 1/2 where the whole line is saturated.

    Args:
        sigma_px: of the line's profile.
    """
    core = 2 * half + 1
    reach = 2 * half + core
    for u in range(image.shape[1]):
        for k in range(KEPT):
            centres[k, u] = confidences[k, u] = 0.0
            if heights[k, u] == 0:
                continue
            v = rows[k, u]
            before = (sums[v - 2 * half, u] - sums[v - reach, u]) / (2.0 * core)
            behind = (sums[v + 1 + reach, u] - sums[v + 1 + 2 * half, u]) / (2.0 * core)
            centre, sigma, share = measure_bump(image, laser, (v, u), half, (before, behind))
            if sigma <= 0.0:
                continue
            octaves = math.log2(sigma / sigma_px)
            confidence = 1.0 - limits[u] / heights[k, u]
            confidence *= math.exp(-0.5 * octaves * octaves) * (1.0 - 0.5 * min(1.0, share))
            centres[k, u], confidences[k, u] = centre, confidence


@kernel
def choose_bumps(
    heights: I32, centres: F64, confidences: F64, gains: F64, came_from: I32, chosen: I32
) -> None:
    """Fills which bump of each column is the line, -1: none, by the best way through all columns.

    Args:
        gains: (2, KEPT + 1) room; the last state is to have no line.
        came_from: (w, KEPT + 1) room.
        chosen: (w,).
    """
    w = chosen.size
    price_before = ALONE
    for k in range(KEPT + 1):
        gains[0, k] = 0.0
    for u in range(w):
        now, before = (u + 1) % 2, u % 2
        highest = bumps = 0
        for k in range(KEPT):
            highest = max(highest, heights[k, u])
            bumps += confidences[k, u] >= LEAST_CONFIDENCE
        price_now = 1.0 if bumps > 1 else ALONE
        price = max(price_now, price_before)
        price_before = price_now
        for k in range(KEPT + 1):
            gain = -math.inf
            if k == KEPT or confidences[k, u] >= LEAST_CONFIDENCE:
                for j in range(KEPT + 1):
                    if u > 0 and j < KEPT and confidences[j, u - 1] < LEAST_CONFIDENCE:
                        continue
                    cost = 0.0
                    if j == KEPT or k == KEPT:
                        cost = GAP if j != k and u > 0 else 0.0
                    elif u > 0:
                        away = abs(centres[k, u] - centres[j, u - 1])
                        cost = min(JUMP_A_PX * away, JUMP_MOST)
                    if gains[before, j] - price * cost > gain:
                        gain, came_from[u, k] = gains[before, j] - price * cost, j
                if k < KEPT:
                    gain += confidences[k, u] * (0.5 + 0.5 * heights[k, u] / highest)
            gains[now, k] = gain
    k = 0
    for j in range(1, KEPT + 1):
        if gains[w % 2, j] > gains[w % 2, k]:
            k = j
    for back in range(w):
        u = w - 1 - back
        chosen[u] = k if k < KEPT else -1
        k = came_from[u, k]
