"""From what the rays of wide beams meet to the echoes that a scanner tells: width, sun, dust, rain.

Source: the scanner reports up to two echoes a beam (lms111 sheet, section 1). How long its pulse
is, and what sun and dust do, are our assumptions.
"""

import math

import numpy as np

from fakes.rays.kernels import F64
from fakes.world.error_models import ErrorModels
from jit import allocating_kernel

RING = 6  # rays around the one in a beam's middle,
RING_SHARE = 0.65  # so far out, of the beam's half-width
ELSEWHERE = 0.05  # of the sun's rate, where a beam does not look into the sun
DAZZLED_SHARE, SILENT_SHARE = 0.5, 0.3  # of the beams that sunlight upsets; the others come short
SHORTEST_M = 0.3  # of what comes short
DUST_REACH_M = 2.0  # at which a grain is seen 1/e as often as right before the lens
GOLDEN, PLACES, TOP = np.uint64(0x9E3779B97F4A7C15), np.uint64(1 << 20), np.uint64(11)
MIXES = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
SHIFTS = np.uint64(30), np.uint64(27), np.uint64(31)
THROUGH_SHARE = 0.6  # of the beams that a grain or a drop returns and that go on behind it, too


def pattern_of(errors: ErrorModels) -> F64:
    """The rays (subs, 4) of a beam for the kernel: one in its middle, and a ring if it is wide."""
    middle = np.zeros((1, 4))
    if errors.beam_rad == 0.0:
        return middle
    angles = np.arange(RING) * math.tau / RING + math.pi / 2  # one up, one down: edges lie level
    around = RING_SHARE * np.column_stack([np.cos(angles), np.sin(angles)])
    aside = around * errors.beam_exit_m / 2
    return np.concatenate([middle, np.column_stack([aside, around * errors.beam_rad / 2])])


@allocating_kernel
def shares(key: int, n: int, what: int) -> F64:
    """Numbers of chance (n,), 0 up to 1: the same again for the same key, sort and place."""
    drawn = np.empty(n)
    for k in range(n):  # splitmix64, of Steele, Lea and Flood, OOPSLA 2014
        z = np.uint64(key) + (np.uint64(what) * PLACES + np.uint64(k)) * GOLDEN
        z = (z ^ (z >> SHIFTS[0])) * MIXES[0]
        z = (z ^ (z >> SHIFTS[1])) * MIXES[1]
        drawn[k] = float((z ^ (z >> SHIFTS[2])) >> TOP) * 2.0**-53
    return drawn


@allocating_kernel
def through_air(key: int, dust_per_m: float, rain_per_m: float, echoes_m: F64) -> None:
    """Put grains of dust and drops of rain into echoes (2, n), before what would be met."""
    n = echoes_m.shape[1]
    grains, drops, on = shares(key, n, 0), shares(key, n, 1), shares(key, n, 2)
    for k in range(n):
        met_m = math.inf
        if dust_per_m > 0.0:
            left = 1.0 + math.log(1.0 - grains[k]) / (dust_per_m * DUST_REACH_M)
            met_m = -DUST_REACH_M * math.log(left) if left > 0.0 else math.inf
        if rain_per_m > 0.0:
            met_m = min(met_m, -math.log(1.0 - drops[k]) / rain_per_m)
        if met_m < echoes_m[0, k]:
            echoes_m[1, k] = echoes_m[0, k] if on[k] < THROUGH_SHARE else math.inf
            echoes_m[0, k] = met_m


@allocating_kernel
def in_sunlight(
    key: int, rate: float, sun_rad: float, half_rad: float, azimuths_rad: F64, echoes_m: F64
) -> None:
    """Make some of the echoes (2, n) of beams at azimuths (n,) dazzled (-inf), silent or short.

    Args:
        rate: of the beams that look into the sun, half_rad to either side of sun_rad.
    """
    n = echoes_m.shape[1]
    hits, kinds, ways = shares(key, n, 3), shares(key, n, 4), shares(key, n, 5)
    for k in range(n):
        beside = (azimuths_rad[k] - sun_rad + math.pi) % math.tau - math.pi
        if hits[k] >= (rate if abs(beside) <= half_rad else rate * ELSEWHERE):
            continue
        far_m = echoes_m[0, k] if math.isfinite(echoes_m[0, k]) else 20.0
        wrong_m = SHORTEST_M + ways[k] * max(0.0, far_m - SHORTEST_M)
        if kinds[k] < DAZZLED_SHARE + SILENT_SHARE:
            wrong_m = -math.inf if kinds[k] < DAZZLED_SHARE else math.inf
        echoes_m[0, k], echoes_m[1, k] = wrong_m, math.inf
