"""Heights of what stands by a filter: the highest surface on which returns agree, cell by cell.

The highest return of a thing is as a rule one that noise has lifted. So heights that are told, for
feet, come from a Kalman filter; no decision asks for them, and they are kept only where the
settings want them (`map.filter_heights`):

    gain = var / (var + noise),  z += gain (z_return - z),  var = (1 - gain) var

It takes returns that are not of floor and lie within GATE sigma of it. What lies higher is a higher
surface, and begins it anew; what lies as much lower may be a face of it. A beam that an edge
divides ends in the air: where one return alone tells the surface, and another one or floor lies
beneath it, no height is told, unless it is a face.

Heights are of the map frame, as `cells` has them: s is taken out when they are read.
Source: docs/method.md, section 5.
"""

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from core.mapping.surface import cells
from core.mapping.surface.cells import Surface
from core.mapping.surface.constants import *
from core.mapping.surface.sweep import ABOVE, NONE
from core.records import F64
from jit import Records, kernel

Uppers = npt.NDArray[Any]  # flat, of UPPER; none where no height is filtered

UPPER = np.dtype(
    [
        ("z_m", np.float32),
        ("var_m2", np.float32),  # its variance; inf: none
        ("below_m", np.float32),  # how far beneath it another return was; 0: none
        ("arm_m", np.float32),  # how far ahead it was seen, and how far had been driven
        ("aside_m", np.float32),
        ("agreed", np.uint8),  # 1: a second return agrees with it
    ],
    align=True,
)
BLANK_UPPER = np.zeros((), dtype=UPPER)
BLANK_UPPER["var_m2"] = math.inf


@kernel
def see_uppers(returns: Records, surface: Surface) -> None:
    """Returns of a sweep that are not of floor, nor far below it, into the filters."""
    if surface.uppers.size == 0:
        return
    own = surface.own
    for b in range(returns.size):
        one = returns[b]
        if one.at < 0 or (one.kind != ABOVE and one.kind != NONE):
            continue
        upper, arm = surface.uppers[one.at], one.ahead_m + surface.stand.travel_m
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


def _tilt_m(of: cells.Cells | Uppers, static_rad: F64) -> F64:
    """By what a height errs where pitch and roll are always wrong by static_rad (2,)."""
    return np.asarray(static_rad[0] * of["arm_m"] + static_rad[1] * of["aside_m"])


def ground_m(of: cells.Cells, static_rad: F64) -> F64:
    """Height of the ground of cells, map frame."""
    return np.asarray(of["ground_m"] - _tilt_m(of, static_rad))


def heights_m(of: cells.Cells, uppers: Uppers | None, static_rad: F64) -> tuple[F64, F64]:
    """Height and its variance, of what stands in cells, else of the ground; NaN: none.

    Without filters, or where nothing is in them, the highest return is what stands.
    """
    z_m, var_m2 = ground_m(of, static_rad), of["var_m2"].astype(float)
    stands, seen = of["stands"] > 0.0, of["looks"] > 0
    is_top = stands & np.isfinite(of["top_m"])
    height_m = z_m + np.where(is_top, of["top_m"], np.where(seen, 0.0, np.nan))
    if uppers is not None:
        is_upper = np.isfinite(uppers["var_m2"]) & (stands | ~seen)
        is_single = (uppers["below_m"] == 0.0) & ~seen
        is_sure = (uppers["agreed"] > 0) | (of["stands"] >= LIKELY) | is_single
        upper_m = np.where(is_sure, uppers["z_m"] - _tilt_m(uppers, static_rad), np.nan)
        height_m = np.where(is_upper, upper_m, height_m)
        var_m2 = np.where(is_upper, uppers["var_m2"], var_m2)
    return height_m, np.where(np.isnan(height_m), np.nan, var_m2)
