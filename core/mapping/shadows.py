"""The shadow filter, before any method: what lies right behind an edge goes, mixed pixels with it.

A beam that an edge divides tells a range between both surfaces, or one behind them. With its
neighbours such a return lies in a line that runs along the beams, which no surface that a scanner
sees well does. Of two returns in such a line the farther one goes, so what is nearest stays, a thin
post too. What goes did come back, so it is no sign of missing ground: it tells nothing.

Source: docs/maps.md; the rule is that of ScanShadowsFilter of ROS's laser_filters, as documented.
"""

import math

import msgspec
import numpy as np

from core.config import Config
from core.records import F64, U8, PointSweep, Scan
from jit import Settled, kernel

NOTHING_M = 0.0  # range of a beam that came back and tells nothing; one that did not has NaN
IN_LINE, DROPPED = 1, 2  # bits of a beam: another stands in its line; it goes itself


@kernel
def _mark_lines(
    ranges_m: F64, apart: int, step_rad: float, least: tuple[float, float], marks: U8
) -> None:
    """Mark the beams whose line to the reading `apart` beams on runs along their own way.

    least: sine and cosine of the angle between both.
    """
    sine, cosine = math.sin(abs(apart) * step_rad), math.cos(abs(apart) * step_rad)
    for i in range(max(0, -apart), min(ranges_m.size, ranges_m.size - apart)):
        near_m, far_m = ranges_m[i], ranges_m[i + apart]
        across, along = abs(far_m * sine), abs(near_m - far_m * cosine)
        if near_m > 0.0 and far_m > 0.0 and across * least[1] < along * least[0]:
            marks[i] |= IN_LINE


@kernel
def drop_shadows(
    given_m: F64, step_rad: float, least_rad: float, window: int, out_m: F64, marks: U8
) -> None:
    """Fill out_m (echoes, n) with given_m, each row without what lies in the shadow of an edge.

    For each beam, each other within `window` of it is looked at; of a pair in a line go all within
    `window` of the beam that are farther than its own. marks (n,): room.
    """
    rows, n = given_m.shape
    least = math.sin(least_rad), math.cos(least_rad)
    for row in range(rows):
        ranges_m = given_m[row]
        marks[:n] = 0
        for apart in range(1, window + 1):
            _mark_lines(ranges_m, apart, step_rad, least, marks)
            _mark_lines(ranges_m, -apart, step_rad, least, marks)
        for i in range(n):
            if marks[i] & IN_LINE != 0:
                for k in range(max(0, i - window), min(n, i + window + 1)):
                    if ranges_m[k] > ranges_m[i]:
                        marks[k] |= DROPPED
        for k in range(n):
            out_m[row, k] = NOTHING_M if marks[k] & DROPPED != 0 else ranges_m[k]


class ShadowFilter:
    """Scans as the settings want them for their method, each valid until the next one."""

    def __init__(self, config: Config) -> None:
        given, spec = config.shadow_filter, config.scanner.options.spec
        self._is_on = given is not None and config.map.method in given.methods
        if given is None:
            return
        self._least_rad, self._beams = math.radians(given.angle_deg), given.beams
        self._ranges_m = np.zeros(spec.echoes * spec.max_beams)
        self._marks: U8 = np.zeros(spec.max_beams, dtype=np.uint8)
        self._drop = Settled(drop_shadows)

    def cleaned(self, scan: Scan | PointSweep) -> Scan | PointSweep:
        """A checked scan with `NOTHING_M` where a return is not believed.

        Itself where the filter is off, and if it is no fan of one lens: then neighbours in the
        arrays lie at no known angle.
        """
        if not self._is_on or isinstance(scan, PointSweep):
            return scan
        given_m = np.ascontiguousarray(scan.ranges_m, np.float64)
        out_m = self._ranges_m[: given_m.size].reshape(given_m.shape)
        step_rad = abs(scan.step_rad)
        self._drop(given_m, step_rad, self._least_rad, self._beams, out_m, self._marks)
        return msgspec.structs.replace(scan, ranges_m=out_m)
