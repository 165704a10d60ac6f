"""The mount with the least occlusion that still sees a strip of some width."""

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from core.records import F64
from tools.placement.measure import Result, over
from tools.placement.sensor import Sensor

STEPS = 5  # along each of height and tilt
ROUNDS = 3  # each within one step of the best of the one before


def near(whole: tuple[float, float], middle: float, axis: F64) -> tuple[float, float]:
    """One step of an axis to either side, within the whole."""
    step = float(axis[1] - axis[0])
    return max(whole[0], middle - step), min(whole[1], middle + step)


def best_mount(
    sensor: Sensor,
    z_m: tuple[float, float],
    tilt_deg: tuple[float, float],
    width_m: float,
    fields: Sequence[F64],
) -> tuple[Result | None, int]:
    """The best, None if no mount sees the strip; and how many were tried."""
    maybe_best: Result | None = None
    tried = 0
    bounds = (z_m, tilt_deg)
    for _ in range(ROUNDS):
        axes = [np.linspace(low, high, STEPS) for low, high in bounds]
        for z, tilt in product(*axes):
            mounted = replace(sensor, z_m=float(z), tilt_rad=math.radians(tilt))
            found = over(mounted, fields)
            tried += 1
            if not found.mean[1] >= width_m or math.isnan(found.mean[0]):  # all is out of view
                continue
            if maybe_best is None or found.mean[0] < maybe_best.mean[0]:
                maybe_best = found
        if maybe_best is None:
            break
        at = (maybe_best.sensor.z_m, math.degrees(maybe_best.sensor.tilt_rad))
        bounds = (near(z_m, at[0], axes[0]), near(tilt_deg, at[1], axes[1]))
    return maybe_best, tried
