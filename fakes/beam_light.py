"""From what the rays of wide beams meet to the echoes that a scanner tells: width, sun, dust, rain.

Source: the scanner reports up to two echoes a beam (lms111 sheet, section 1). How long its pulse
is, and what sun and dust do, are our assumptions.
"""

import math

import numpy as np
import numpy.typing as npt

from fakes.upsets import Upsets

F64 = npt.NDArray[np.float64]
RING = 6  # rays around the one in a beam's middle,
RING_SHARE = 0.65  # so far out, of the beam's half-width
ELSEWHERE = 0.05  # of the sun's rate, where a beam does not look into the sun
DAZZLED_SHARE, SILENT_SHARE = 0.5, 0.3  # of the beams that sunlight upsets; the others come short
SHORTEST_M = 0.3  # of what comes short
DUST_REACH_M = 2.0  # at which a grain is seen 1/e as often as right before the lens
THROUGH_SHARE = 0.6  # of the beams that a grain or a drop returns and that go on behind it, too


def pattern_of(upsets: Upsets) -> F64:
    """The rays (subs, 4) of a beam for the kernel: one in its middle, and a ring if it is wide."""
    middle = np.zeros((1, 4))
    if upsets.beam_rad == 0.0:
        return middle
    angles = np.arange(RING) * math.tau / RING + math.pi / 2  # one up, one down: edges lie level
    around = RING_SHARE * np.column_stack([np.cos(angles), np.sin(angles)])
    aside = around * upsets.beam_exit_m / 2
    return np.concatenate([middle, np.column_stack([aside, around * upsets.beam_rad / 2])])


def through_air(upsets: Upsets, random: np.random.Generator, echoes_m: F64) -> F64:
    """Echoes (2, n) with grains of dust and drops of rain before what would be met (2, n)."""
    n = echoes_m.shape[1]
    met_m = np.full(n, np.inf)
    if upsets.dust_per_m > 0.0:
        left = 1.0 - random.exponential(1.0, n) / (upsets.dust_per_m * DUST_REACH_M)
        with np.errstate(invalid="ignore", divide="ignore"):
            met_m = np.where(left > 0.0, -DUST_REACH_M * np.log(left), np.inf)
    if upsets.rain_per_m > 0.0:
        met_m = np.minimum(met_m, random.exponential(1.0 / upsets.rain_per_m, n))
    goes_on = random.random(n) < THROUGH_SHARE
    is_met = met_m < echoes_m[0]
    first = np.where(is_met, met_m, echoes_m[0])
    second = np.where(is_met, np.where(goes_on, echoes_m[0], np.inf), echoes_m[1])
    return np.stack([first, second])


def in_sunlight(
    upsets: Upsets, random: np.random.Generator, azimuths_rad: F64, echoes_m: F64
) -> F64:
    """Echoes (2, n) of beams at azimuths (n,) of the map, some dazzled (-inf), silent or short."""
    n = echoes_m.shape[1]
    beside = (azimuths_rad - upsets.sun_azimuth_rad + math.pi) % math.tau - math.pi
    rate = upsets.sunlight_rate * np.where(np.abs(beside) <= upsets.sun_half_rad, 1.0, ELSEWHERE)
    is_upset, kind, share = random.random(n) < rate, random.random(n), random.random(n)
    far_m = np.where(np.isfinite(echoes_m[0]), echoes_m[0], 20.0)
    short_m = SHORTEST_M + share * np.maximum(0.0, far_m - SHORTEST_M)
    wrong = np.where(kind < DAZZLED_SHARE + SILENT_SHARE, np.inf, short_m)
    wrong = np.where(kind < DAZZLED_SHARE, -np.inf, wrong)
    return np.stack(
        [np.where(is_upset, wrong, echoes_m[0]), np.where(is_upset, np.inf, echoes_m[1])]
    )
