"""Wheels that count more than the ground which they cover, for so long."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

F64 = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Slip:
    """By which share more than travelled the encoders count: 0.0476 makes 4.4 m of 4.2 m.

    The ground travelled stays what it is; times are seconds since the world's begin.
    """

    left: float
    right: float
    from_s: float = -math.inf
    until_s: float = math.inf


def shares(slips: Sequence[Slip], t_s: F64) -> F64:
    """Shares (n, 2) of left and right at instants (n,) since the world's begin."""
    sums = np.zeros((len(t_s), 2))
    for slip in slips:
        sums[(t_s >= slip.from_s) & (t_s < slip.until_s)] += (slip.left, slip.right)
    return sums


def slip_from(entry: dict[str, Any]) -> Slip:
    """A [[slip]] of a scene's file: left, right; from_s, until_s."""
    times = (float(entry.get("from_s", -math.inf)), float(entry.get("until_s", math.inf)))
    return Slip(float(entry["left"]), float(entry["right"]), *times)
