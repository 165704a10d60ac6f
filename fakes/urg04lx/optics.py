"""What the lens makes of what its beams meet: noise, mixed pixels, and codes for what is no range.

A beam is a spot, wider than a step. Where neighbouring rays jump by more than the spot, an edge
stands between them, and the beams beside it get the light of both surfaces. A phase-shift scanner
adds the two as pointers at each of its two modulation frequencies, and takes the range at which
both agree best: between the surfaces, and behind or in front of them where the way to the other
is more than half a wave. A scanner that times pulses takes the mean of the light.

How much light comes back depends on range, slope and remission of the surface: too little and too
much are codes, and what is dark seems a little farther away.

Source: urg04lx sheet, sections 1 and 6, for the codes. All numbers here are [U]: the frequencies
are recalled (their difference has the wave of 22.5 m that code 0 tells of), that errors depend on
brightness and slope is known from published tests, and how much so is our choice.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from fakes.urg04lx.models import Model
from fakes.urg04lx.scip import I32
from fakes.wires.timing import F64

Bool = npt.NDArray[np.bool_]

FAR, DARK, DIM, DISAGREES, TWO_WAVES, TOO_STRONG, IMPOSSIBLE = 0, 1, 2, 7, 8, 18, 19
WHITE = 0.9  # remission to which a model's reach and range offset belong
DARK_OFFSET_M = 0.02  # by which what returns nothing would seem too far; in proportion above
DARK_SHARE = 0.5  # of the least light for a range: below it is DARK, else DIM
HALF_WAVES_M = 299_792_458.0 / 2 / np.array([46.55e6, 53.2e6])  # 3.22 and 2.82 m: modulo these
TURNS = np.arange(7)[:, None]  # of the first wave up to 22.5 m
TWO_WAVES_M, TWO_WAVES_SHARE = 0.12, 0.3  # by which ranges and light of the two may differ
DISAGREE_M, DISAGREE_SHARE = 0.4, 0.5  # a range alone, so far from both sides; how often it is told
NOTHING_M = 1000.0  # no light comes back from there
GRAZING_SHARE = 0.1  # of what the spot covers along the beam: more noise, 1 sigma
STRONG_M, STRONG_SLOPE, STRONG_SHARE = 0.10, 0.05, 0.2  # white, square to the beam; how often


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
        self,
        true_m: F64,
        random: np.random.Generator,
        noise: float = 1.0,
        mixes: bool = True,
        remissions: F64 | float = WHITE,
    ) -> Measured:
        """What a scan tells of true ranges (n,) m; NaN or inf: nothing, -inf: dazzled.

        Args:
            noise: times the model's own; 0: nothing is left to chance.
            mixes: False: each beam is as thin as a ray.
            remissions: (n,) or one for all, share of the light that a surface gives back.
        """
        model, n = self._model, len(true_m)
        chance, whites = random.random((2, n)), np.broadcast_to(remissions, n) / WHITE
        ranges_m = np.where(np.abs(true_m) < NOTHING_M, np.maximum(true_m, 1e-3), np.nan)
        change_m = np.diff(ranges_m)
        edge = self._is_edge(ranges_m, change_m)
        told_m, mixed, apart = ranges_m, np.zeros(n, np.bool_), np.zeros(n, np.bool_)
        if mixes:
            told_m, mixed, apart = self._mixed(ranges_m, edge, whites)
        slope = _slope(np.where(edge, np.nan, change_m)) / self._step_rad / ranges_m
        sigma_m = self.sigma_m(ranges_m, slope)
        told_m = told_m + DARK_OFFSET_M * np.maximum(0.0, 1.0 - whites)
        told_m = told_m + noise * sigma_m * random.standard_normal(n)
        light = np.nan_to_num(whites / np.hypot(1.0, slope) / ranges_m**2)  # white at 1 m: 1
        least = 1.0 / model.reach_m**2
        is_alone = mixed & _is_alone(told_m) & (chance[0] < DISAGREE_SHARE)
        is_square = (slope < STRONG_SLOPE) & (chance[1] < STRONG_SHARE)
        is_strong = (light > 1.0 / STRONG_M**2) & is_square & (noise > 0)
        codes = np.rint(1000 * np.nan_to_num(told_m)).astype(np.int32)
        values = np.where(codes > model.dmax, FAR, codes)
        values[codes < model.dmin] = IMPOSSIBLE
        values[is_alone] = DISAGREES
        values[apart] = TWO_WAVES
        values[(light < least) & ~mixed] = DIM
        values[(light < DARK_SHARE * least) & ~mixed] = DARK
        values[is_strong | (true_m == -np.inf)] = TOO_STRONG
        values[1000 * ranges_m < model.dmin] = IMPOSSIBLE
        return Measured(values.astype(np.int32), mixed)

    def sigma_m(self, ranges_m: F64, slope: F64) -> F64:
        """Noise, 1 sigma (n,) m.

        Args:
            slope: (n,) tangent of the angle of incidence.
        """
        model = self._model
        square_m = np.maximum(model.noise_m, model.noise_share * ranges_m)
        noise_m: F64 = np.hypot(square_m, GRAZING_SHARE * model.spot_rad * slope * ranges_m)
        return noise_m

    def _mixed(self, ranges_m: F64, edge: Bool, whites: F64) -> tuple[F64, Bool, Bool]:
        """Ranges (n,) as the light has them, which are of two surfaces, and where waves differ."""
        half = self._model.spot_rad / self._step_rad / 2  # of the spot, in steps
        at = self._edges[: len(edge)]
        after, before = np.zeros_like(ranges_m), np.zeros_like(ranges_m)  # shares of neighbours
        after[:-1] = np.where(edge, np.maximum(0.0, half - at) / (2 * half), 0.0)
        before[1:] = np.where(edge, np.maximum(0.0, half - (1 - at)) / (2 * half), 0.0)
        shares = np.stack([before, 1.0 - after - before, after])
        met_m, bright = (
            np.stack([np.roll(each, 1), each, np.roll(each, -1)]) for each in (ranges_m, whites)
        )
        light = np.maximum(shares, 0.0) * bright / np.nan_to_num(met_m, nan=1e3) ** 2
        mean = _phase_mean if self._model.is_phase_shift else _light_mean
        told_m, apart = mean(np.nan_to_num(met_m), light)
        mixed = after + before > 0
        return np.where(mixed, told_m, ranges_m), mixed, mixed & apart

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


def _phase_mean(met_m: F64, light: F64) -> tuple[F64, Bool]:
    """Ranges (3, n) and their light to one range (n,), and where the two waves differ too much."""
    total = np.maximum(light.sum(0), 1e-12)
    within, strengths = [], []
    for wave_m in HALF_WAVES_M:
        pointer = (light * np.exp(2j * np.pi * met_m / wave_m)).sum(0)
        within.append(np.angle(pointer) / (2 * np.pi) % 1.0 * wave_m)
        strengths.append(np.abs(pointer) / total)
    first = within[0] + TURNS * HALF_WAVES_M[0]  # (turns, n)
    second = within[1] + np.rint((first - within[1]) / HALF_WAVES_M[1]) * HALF_WAVES_M[1]
    best = np.argmin(np.abs(first - second), axis=0)[None]
    one = np.take_along_axis(first, best, 0)[0]
    two = np.take_along_axis(second, best, 0)[0]
    differ = np.abs(strengths[0] - strengths[1]) > TWO_WAVES_SHARE
    return (one + two) / 2, differ | (np.abs(one - two) > TWO_WAVES_M)


def _light_mean(met_m: F64, light: F64) -> tuple[F64, Bool]:
    total = light.sum(0)
    mean = (light * met_m).sum(0) / np.where(total > 0, total, 1.0)
    return mean, np.zeros(len(mean), np.bool_)


def _slope(change_m: F64) -> F64:
    """Change of the range a step at each ray (n,): of its two sides the lesser; 0: none known."""
    size = np.abs(change_m)
    least: F64 = np.fmin(np.append(size, np.nan), np.append(np.nan, size))
    return np.nan_to_num(least)


def _is_alone(told_m: F64) -> Bool:
    """Far from what both neighbours tell (n,)."""
    alone = np.zeros(len(told_m), np.bool_)
    far = np.abs(np.diff(told_m)) > DISAGREE_M
    alone[1:-1] = far[1:] & far[:-1]
    return alone
