"""How well a mount does over many stepfields."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from core.records import F64, I8
from tools.placement.field import stepfield
from tools.placement.sensor import Sensor
from tools.placement.sight import OCCLUDED, OUTSIDE, SEEN, look

CELL_M = 0.05
LONG_M, SIDE_M = 3.0, 2.5  # of the strip looked at: along the way, and to either side
XS: F64 = np.arange(CELL_M / 2, LONG_M, CELL_M)
YS: F64 = np.arange(-SIDE_M + CELL_M / 2, SIDE_M, CELL_M)
MEASURES = ("occluded", "width_m", "sigma_m", "sigma_90_m")


@dataclass(frozen=True, slots=True)
class Result:
    """Mean over the fields, and half of its 95 % interval, of each of MEASURES."""

    sensor: Sensor
    mean: F64  # (4,)
    within: F64  # (4,)


def seen_of(sensor: Sensor, heights: F64) -> tuple[I8, F64]:
    """State and 1 sigma of height (m) of the cells [i, j] at XS, YS."""
    states = np.empty((len(XS), len(YS)), dtype=np.int8)
    sigmas = np.empty(states.shape)
    look(heights, XS, YS, sensor.numbers, states, sigmas)
    return states, sigmas


def measured(sensor: Sensor, heights: F64) -> F64:
    """(4,) MEASURES over one field; NaN where nothing is seen."""
    states, sigmas = seen_of(sensor, heights)
    seen = states == SEEN
    looked = int((states != OUTSIDE).sum())
    if not seen.any():
        return np.array([1.0 if looked else np.nan, 0.0, np.nan, np.nan])
    width_m = CELL_M * int((seen.mean(axis=0) >= 0.5).sum())
    share = int((states == OCCLUDED).sum()) / looked
    return np.array([share, width_m, *np.quantile(sigmas[seen], (0.5, 0.9))])


def over(sensor: Sensor, fields: Sequence[F64]) -> Result:
    rows = np.array([measured(sensor, heights) for heights in fields])
    spread = rows.std(axis=0, ddof=1) if len(rows) > 1 else np.full(len(MEASURES), np.nan)
    return Result(sensor, rows.mean(axis=0), 1.96 * spread / np.sqrt(len(rows)))


def fields_of(seed: int, count: int, highest_m: float) -> list[F64]:
    return [stepfield(seed, number, highest_m) for number in range(count)]
