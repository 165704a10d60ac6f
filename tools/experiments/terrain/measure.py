"""What is measured on a map of centimetres: sizes of boxes, and what is off the truth."""

import math
from typing import NamedTuple

import numpy as np

from core.records import F64
from fakes.scenes.scene import Scene
from fakes.scenes.solids import Solid
from tools.experiments.terrain.methods import Region

ARTEFACT_M = 0.015  # a cell so far off the truth is one
SAMPLES = 5  # of the truth along an edge of a cell, its ends included
BESIDE_M = (0.030, 0.080)  # off a box's sides, there is the floor to which it is compared


class Truth(NamedTuple):
    """Lowest and highest surface in each cell of a region, [j, i]."""

    low_m: F64
    high_m: F64


class Figures(NamedTuple):
    """Of one map against the truth of its region."""

    rms_m: float  # of how far heights lie outside of what is truly in their cells
    unknown: float  # share of the cells, 0..1
    too_high: int  # artefacts
    too_low: int


def truth_of(scene: Scene, region: Region) -> Truth:
    i, j = region.cells()
    part = np.linspace(1e-6, 1.0 - 1e-6, SAMPLES)
    x, y = ((cells[:, None] + part).ravel() * region.cell_m for cells in (i, j))
    all_x, all_y = np.meshgrid(x, y)
    tiles = scene.height_at(all_x.ravel(), all_y.ravel()).reshape(len(j), SAMPLES, len(i), SAMPLES)
    return Truth(tiles.min(axis=(1, 3)), tiles.max(axis=(1, 3)))


def off_m(heights_m: F64, truth: Truth) -> F64:
    """How far heights lie above (positive) or below what is truly in their cells; 0: between."""
    return np.fmax(heights_m - truth.high_m, 0.0) - np.fmax(truth.low_m - heights_m, 0.0)


def figures(heights_m: F64, truth: Truth) -> Figures:
    """NaN for the rms of a map that knows nothing."""
    known = np.isfinite(heights_m)
    off = off_m(heights_m, truth)[known]
    rms_m = math.sqrt(float(np.mean(off**2))) if off.size else math.nan
    too_high, too_low = int((off > ARTEFACT_M).sum()), int((off < -ARTEFACT_M).sum())
    return Figures(rms_m, 1.0 - float(known.mean()), too_high, too_low)


def _median(values: F64) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else math.nan


def _edge_m(at_m: F64, profile_m: F64, half_m: float) -> float:
    """Where a profile, from inside of a box outwards, ends to be above a height; NaN: nowhere.

    In a straight line to the next cell, where that is known; else it is the middle of the last one:
    how much of it is box is not known where the rest lies in its shadow, half of it in the mean.
    """
    known = np.flatnonzero(np.isfinite(profile_m))
    below = known[profile_m[known] < half_m]
    if not below.size or below[0] == known[0]:
        return math.nan
    last, end = int(known[known < below[0]][-1]), int(below[0])
    if end != last + 1:
        return float(at_m[last])
    share = (profile_m[last] - half_m) / (profile_m[last] - profile_m[end])
    return float(at_m[last] + share * (at_m[end] - at_m[last]))


def width_and_height_m(heights_m: F64, region: Region, box: Solid) -> tuple[float, float]:
    """Of a box in a map [j, i]: by one procedure for all; NaN: it can't be told.

    Its place is known. Rows of cells across it, over the middle half of its length, give a profile:
    the median over these rows. The top is the median of the middle half of the profile, the floor
    that of 30 to 80 mm beside both sides; the height is their difference. The width is from where
    the profile falls below half of it on one side to where it does so on the other.
    """
    i, j = region.cells()
    x, y = (np.asarray((cells + 0.5) * region.cell_m, np.float64) for cells in (i, j))
    (x0, x1), (y0, y1) = box.x, box.y
    middle_m, half_m = (y0 + y1) / 2, (y1 - y0) / 2
    part = heights_m[:, np.abs(x - (x0 + x1) / 2) < (x1 - x0) / 4]
    profile_m = np.array([_median(row) for row in part])
    aside = np.abs(y - middle_m)
    top_m = _median(profile_m[aside < half_m / 2])
    beside = (aside > half_m + BESIDE_M[0]) & (aside < half_m + BESIDE_M[1])
    floor_m = _median(profile_m[beside])
    if math.isnan(top_m) or math.isnan(floor_m):
        return math.nan, math.nan
    at_half_m = (top_m + floor_m) / 2
    left, right = y >= middle_m, y < middle_m
    ends = (
        _edge_m(y[left], profile_m[left], at_half_m),
        _edge_m(y[right][::-1], profile_m[right][::-1], at_half_m),
    )
    return ends[0] - ends[1], top_m - floor_m
