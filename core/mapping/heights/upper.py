"""Heights of what stands by a filter: the highest surface on which returns agree, cell by cell.

The highest return of a thing is as a rule one that noise has lifted. So heights that are told, for
feet, come from a Kalman filter; no decision asks for them, and they are kept only where the
settings want them (`map.filter_heights`). It takes returns that are not of floor and lie within
GATE sigma of it. What lies higher is a higher surface, and begins it anew; what lies as much lower
may be a face of it. A beam that an edge divides ends in the air: where one return alone tells the
surface, and another one or floor lies beneath it, no height is told, unless it is a face. A cell
that an edge divides shows floor as well: `balance` tells of which it shows more.

Heights are of the map frame, as `cells` has them: s is taken out when they are read.
Source: docs/method.md, section 5.
"""

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from core.mapping.surface.cells import Surface
from core.mapping.surface.constants import *
from core.mapping.surface.sweep import ABOVE, FLOOR, NONE
from jit import Records, kernel, records

Uppers = npt.NDArray[Any]  # flat, of UPPER; of no cell where no height is filtered

UPPER = np.dtype(
    [
        ("z_m", np.float32),
        ("var_m2", np.float32),  # its variance; inf: none
        ("below_m", np.float32),  # how far beneath it another return was; 0: none
        ("arm_m", np.float32),  # how far ahead it was seen, and how far had been driven
        ("aside_m", np.float32),
        ("agreed", np.uint8),  # 1: a second return agrees with it
        ("balance", np.int8),  # returns that are not of floor, less those of floor
    ],
    align=True,
)
EVEN = 16  # returns in a row outweigh whatever a cell has shown before
BLANK_UPPER = np.zeros((), dtype=UPPER)
BLANK_UPPER["var_m2"] = math.inf
NO_UPPERS: Uppers = records(UPPER, 0)


@kernel
def see_uppers(returns: Records, surface: Surface) -> None:
    """Returns of a sweep that are not of floor, nor far below it, into the filters.

    Those of floor are counted against them.
    """
    if surface.uppers.size == 0:
        return
    own = surface.own
    for b in range(returns.size):
        one = returns[b]
        if one.at < 0 or (one.kind != ABOVE and one.kind != NONE and one.kind != FLOOR):
            continue
        upper, arm = surface.uppers[one.at], one.ahead_m + surface.stand.travel_m
        if one.kind == FLOOR:
            upper.balance = max(-EVEN, upper.balance - 1)
            continue
        upper.balance = min(EVEN, upper.balance + 1)
        z, noise = one.z_m + own[3] * arm + own[4] * one.aside_m, one.noise_m2
        off, together = z - upper.z_m, upper.var_m2 + noise
        if upper.var_m2 < math.inf and abs(off) <= GATE * math.sqrt(together):
            gain = upper.var_m2 / together
            upper.z_m += gain * off
            upper.arm_m += gain * (arm - upper.arm_m)
            upper.aside_m += gain * (one.aside_m - upper.aside_m)
            upper.var_m2, upper.agreed = (1.0 - gain) * upper.var_m2, 1
        elif upper.var_m2 == math.inf or off > 0.0:
            upper.below_m = upper.below_m + off if upper.var_m2 < math.inf else 0.0
            upper.z_m, upper.var_m2, upper.agreed = z, noise, 0
            upper.arm_m, upper.aside_m = arm, one.aside_m
        else:
            upper.below_m = max(upper.below_m, -off)
