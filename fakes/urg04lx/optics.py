"""What the lens makes of what its beams meet: noise, mixed pixels, and codes for what is no range.

A beam is a spot, wider than a step. Where neighbouring rays jump by more than the spot, an edge
stands between them, and the beams beside it get the light of both surfaces. A phase-shift scanner
adds the two as pointers at each of its two modulation frequencies, and takes the range at which
both agree best: between the surfaces, and behind or in front of them where the way to the other
is more than half a wave. A scanner that times pulses takes the mean of the light.

Source: urg04lx sheet, sections 1 and 6. The frequencies are those of published measurements: their
difference has the wave of 22.5 m that the sheet's code 0 tells of. Thresholds are our choice.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from fakes.urg04lx.models import Model
from fakes.urg04lx.scip import I32
from fakes.wires.timing import F64

Bool = npt.NDArray[np.bool_]

FAR, DISAGREES, TWO_WAVES, TOO_STRONG, IMPOSSIBLE = 0, 7, 8, 18, 19
HALF_WAVES_M = 299_792_458.0 / 2 / np.array([46.55e6, 53.2e6])  # 3.22 and 2.82 m: modulo these
NOTHING_M = 1000.0  # no light comes back from there
TURNS = np.arange(7)[:, None]  # of the first wave up to 22.5 m
TWO_WAVES_M = 0.12  # by which the two may differ
DISAGREE_M, DISAGREE_SHARE = 0.4, 0.5  # a range alone, so far from both sides; how often it is told
GRAZING_SHARE = 0.1  # of what the spot covers along the beam: more noise, 1 sigma
STRONG_M, STRONG_SLOPE, STRONG_SHARE = 0.10, 0.05, 0.2  # near, square to the beam; how often


class Measured(NamedTuple):
    """Of each beam (n,)."""

    values: I32  # mm, or a code
    mixed: Bool  # it got the light of two surfaces: the truth, which no host is told


class Optics:
    """One scanner's lens.

    Args:
        seed: of where between two steps an edge stands. It stays there, so that what stands still
            looks the same in each scan, but for noise.
    """

    def __init__(self, model: Model, seed: int) -> None:
        self._model, self._step_rad = model, 2 * np.pi / model.ares
        self._edges = np.random.default_rng([seed, 1]).random(model.last + 1)

    def measured(
        self, true_m: F64, random: np.random.Generator, noise: float = 1.0, mixes: bool = True
    ) -> Measured:
        """What a scan tells of true ranges (n,) m; NaN or inf: nothing, -inf: dazzled.

        Args:
            noise: times the model's own.
            mixes: False: each beam is as thin as a ray.
        """
        model, n = self._model, len(true_m)
        chance = random.random((2, n))
        ranges_m = np.where(np.abs(true_m) < NOTHING_M, true_m, np.nan)
        change_m = np.diff(ranges_m)
        light_m, mixed, apart = ranges_m, np.zeros(n, np.bool_), np.zeros(n, np.bool_)
        if mixes:
            light_m, mixed, apart = self._mixed(ranges_m, change_m)
        slope = self._slope(ranges_m, change_m)
        told_m = light_m + noise * self._sigma_m(ranges_m, slope) * random.standard_normal(n)
        codes = np.rint(1000 * np.nan_to_num(told_m, nan=1e6)).astype(np.int32)
        is_alone = mixed & _is_alone(told_m) & (chance[0] < DISAGREE_SHARE)
        is_square = (ranges_m < STRONG_M) & (slope < STRONG_SLOPE) & (chance[1] < STRONG_SHARE)
        values = np.where(codes > model.dmax, FAR, codes)
        values[is_alone] = DISAGREES
        values[apart] = TWO_WAVES
        values[is_square & (noise > 0)] = TOO_STRONG
        values[true_m == -np.inf] = TOO_STRONG
        values[(codes < model.dmin) & ~apart | (1000 * ranges_m < model.dmin)] = IMPOSSIBLE
        return Measured(values.astype(np.int32), mixed)

    def _slope(self, ranges_m: F64, change_m: F64) -> F64:
        """How steep a surface is at each ray (n,): tangent of the angle to its normal."""
        size_m = np.abs(change_m)  # of a ray's two sides the lesser counts: the other is an edge
        least_m = np.fmin(np.append(size_m, np.nan), np.append(np.nan, size_m))
        slope: F64 = np.nan_to_num(least_m) / (self._step_rad * _at_least_1_cm(ranges_m))
        return slope

    def _sigma_m(self, ranges_m: F64, slope: F64) -> F64:
        far_m = _at_least_1_cm(ranges_m)
        square_m = np.maximum(self._model.noise_m, self._model.noise_share * far_m)
        sigma_m: F64 = np.hypot(square_m, GRAZING_SHARE * self._model.spot_rad * slope * far_m)
        return sigma_m

    def _mixed(self, ranges_m: F64, change_m: F64) -> tuple[F64, Bool, Bool]:
        """Ranges (n,) as the light has them, which are of two surfaces, and where waves differ."""
        half = self._model.spot_rad / self._step_rad / 2  # of the spot, in steps
        at = self._edges[: len(change_m)]
        edge = self._is_edge(ranges_m, change_m)
        after, before = np.zeros_like(ranges_m), np.zeros_like(ranges_m)  # shares of neighbours
        after[:-1] = np.where(edge, np.maximum(0.0, half - at) / (2 * half), 0.0)
        before[1:] = np.where(edge, np.maximum(0.0, half - (1 - at)) / (2 * half), 0.0)
        own = np.maximum(0.0, 1.0 - after - before)
        met_m = np.stack([np.roll(ranges_m, 1), ranges_m, np.roll(ranges_m, -1)])
        shares = np.stack([before, own, after])
        mixed = after + before > 0
        light = np.maximum(shares, 0.0) / _at_least_1_cm(met_m) ** 2
        mean = _phase_mean if self._model.is_phase_shift else _light_mean
        told_m, apart_m = mean(np.nan_to_num(met_m), light)
        return np.where(mixed, told_m, ranges_m), mixed, mixed & (apart_m > TWO_WAVES_M)

    def _is_edge(self, ranges_m: F64, change_m: F64) -> Bool:
        """Between each two rays (n - 1,): a jump that is not the next piece of a steep surface."""
        spot_m = self._model.spot_rad * np.minimum(ranges_m[1:], ranges_m[:-1])
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = change_m[1:] / change_m[:-1]
        goes_on = (ratio > 0.5) & (ratio < 2.0)
        is_steep = np.zeros(len(change_m), np.bool_)
        is_steep[:-1] |= goes_on
        is_steep[1:] |= goes_on
        edges: Bool = (np.abs(change_m) > spot_m) & ~is_steep
        return edges


def _phase_mean(met_m: F64, light: F64) -> tuple[F64, F64]:
    """Ranges (3, n) and their light to one range (n,), and by how much two waves differ."""
    within = []
    for wave_m in HALF_WAVES_M:
        pointer = (light * np.exp(2j * np.pi * met_m / wave_m)).sum(0)
        within.append(np.angle(pointer) / (2 * np.pi) % 1.0 * wave_m)
    first = within[0] + TURNS * HALF_WAVES_M[0]  # (turns, n)
    second = within[1] + np.rint((first - within[1]) / HALF_WAVES_M[1]) * HALF_WAVES_M[1]
    best = np.argmin(np.abs(first - second), axis=0)[None]
    one = np.take_along_axis(first, best, 0)[0]
    two = np.take_along_axis(second, best, 0)[0]
    return (one + two) / 2, np.abs(one - two)


def _light_mean(met_m: F64, light: F64) -> tuple[F64, F64]:
    total = light.sum(0)
    mean = (light * met_m).sum(0) / np.where(total > 0, total, 1.0)
    return mean, np.zeros_like(mean)


def _at_least_1_cm(ranges_m: F64) -> F64:
    """Something to divide by, NaN too."""
    return np.maximum(np.nan_to_num(ranges_m), 0.01)


def _is_alone(told_m: F64) -> Bool:
    """Far from what both neighbours tell (n,)."""
    alone = np.zeros(len(told_m), np.bool_)
    far = np.abs(np.diff(told_m)) > DISAGREE_M
    alone[1:-1] = far[1:] & far[:-1]
    return alone
