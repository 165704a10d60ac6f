"""Wheels that count more than the ground which they cover, for so long."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

F64 = npt.NDArray[np.float64]
BURSTS_UNTIL_S = 1800.0  # of a world's life
AT_ONCE = 200  # steps whose shares are found together
BURST_S = (0.2, 1.0)  # how long a wheel spins
BURST_SHARE = (0.05, 0.30)  # and how much too much it counts


@dataclass(frozen=True, slots=True)
class Slip:
    """By which share more than travelled the encoders count: 0.0476 makes 4.4 m of 4.2 m.

    The ground travelled stays what it is; times are seconds since the world's begin.
    """

    left: float
    right: float
    from_s: float = -math.inf
    until_s: float = math.inf


def shares(slips: Sequence[Slip], t_s: npt.NDArray[np.floating[Any]]) -> F64:
    """Shares (n, 2) of left and right at instants (n,) since the world's begin."""
    sums = np.zeros((len(t_s), 2))
    for slip in slips:
        sums[(t_s >= slip.from_s) & (t_s < slip.until_s)] += (slip.left, slip.right)
    return sums


def bursts(per_min: float, seed: int) -> tuple[Slip, ...]:
    """Moments at which the left, the right or both wheels spin, so often in the mean."""
    random = np.random.default_rng([seed, 3])
    count = random.poisson(per_min * BURSTS_UNTIL_S / 60.0) if per_min > 0.0 else 0
    slips = []
    for begin_s in random.uniform(0.0, BURSTS_UNTIL_S, count):
        share, long_s = random.uniform(*BURST_SHARE), random.uniform(*BURST_S)
        spins = ((1, 0), (0, 1), (1, 1))[random.integers(3)]
        slips.append(Slip(share * spins[0], share * spins[1], begin_s, begin_s + long_s))
    return tuple(slips)


class Spinning:
    """What wheels have turned without the robot so far, (left, right) rad; told of every step."""

    def __init__(self, slips: Sequence[Slip], step_s: float) -> None:
        self.rad = np.zeros(2)
        self._slips, self._step_s = slips, step_s
        self._turned_rad = np.zeros(2)
        self._shares = np.zeros((AT_ONCE, 2))  # of the steps around the newest one

    def step(self, number: int, turned_rad: F64) -> None:
        """Step `number`, from 1 on, has brought the wheels to so much."""
        k = number % AT_ONCE
        if k == 0 or number == 1:
            self._shares = shares(self._slips, (number - k + np.arange(AT_ONCE)) * self._step_s)
        self.rad += self._shares[k] * (turned_rad - self._turned_rad)
        self._turned_rad[:] = turned_rad
