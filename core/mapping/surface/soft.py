"""Soft things, which scatter beams and let them in: grass, a curtain of stalks.

What stands is soft if first echoes from it have another one behind them and lie off the middle of
both their neighbours. It is hard if last echoes lie where their neighbours' do, also those behind
what is soft. Each return is a vote. The edge of a hard thing parts beams as well; but beside an
upright one a neighbour goes far past, and a level one is met at even ranges.

Source: docs/method.md, section 4.
"""

import math

from core.mapping.surface.constants import GATE, HARD, LET_IN, SIGMA_RANGE_M, STOPPED, THING_M
from core.records import F64
from jit import kernel


@kernel
def _last_m(ranges_m: F64, b: int) -> float:
    """The last echo of a beam; NaN: none."""
    last = ranges_m[0, b]
    for k in range(1, ranges_m.shape[0]):
        if ranges_m[k, b] > last:
            last = ranges_m[k, b]
    return float(last)


@kernel
def softness(ranges_m: F64, b: int) -> float:
    """What the first of a beam's echoes says of what it met: whether that lets beams in.

    ranges_m (echoes, n): it, and those behind it.
    """
    r, alike = ranges_m[0, b], GATE * math.sqrt(1.5) * SIGMA_RANGE_M
    before, after = max(0, b - 1), min(ranges_m.shape[1] - 1, b + 1)
    if not _last_m(ranges_m, b) - r > THING_M:
        is_met = before < b and abs(_last_m(ranges_m, before) - r) < alike
        is_met = is_met or (after > b and abs(_last_m(ranges_m, after) - r) < alike)
        return HARD if is_met else STOPPED
    one, other = ranges_m[0, before], ranges_m[0, after]
    are_beside = max(abs(one - r), abs(other - r)) < 2.0 * THING_M
    scatters = abs(r - 0.5 * (one + other)) > alike
    return LET_IN if before < b < after and are_beside and scatters else STOPPED
