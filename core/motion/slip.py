"""Slip of both wheels alike: the place runs ahead of what stands still, evenly with the travel.

No gyro sees such slip. Something that matches scans to the map tells how far off the place seems
(`core.mapping.slip`). What was corrected meanwhile is added back: else each correction would
look like slip the other way. Only what has grown evenly over a stretch, by a few hundredths of it,
is slip: the top of a table moves as fast as the robot, and a thing that stands does not move.
"""

from collections import deque

import numpy as np

from core.geometry import slope_of

STRETCH_M, STRETCH_SCANS = 0.7, 12  # travel, and scans of it, over which slip must have grown,
GAP_M = 0.3  # without a longer gap,
JUMP_M = 0.03  # from scan to scan is no slip: other things were matched; it is left out
LEAST_SLIP, MOST_SLIP = 0.015, 0.2  # by this share of the travel,
ROUGH_M = 0.015  # and evenly
SIGMA_M = 0.01  # of what that says


class SlipEstimator:
    """Offsets along one direction over the travel, until they show slip."""

    def __init__(self) -> None:
        self._series: deque[tuple[float, float]] = deque(maxlen=500)  # travel, offset
        self._jumps_m = 0.0  # sum of those since the series began

    def restart(self) -> None:
        """Offsets from now on have nothing to do with those before."""
        self._series.clear()
        self._jumps_m = 0.0

    def maybe_slipped_m(self, travel_m: float, offset_m: float, corrected_m: float) -> float | None:
        """How far the place has run ahead since the last answer, or None while nothing shows it.

        Args:
            travel_m: of the wheels, signed.
            offset_m: how far ahead the place seems to be now.
            corrected_m: sum of all corrections of the place so far, in the same direction.
        """
        series = self._series
        if series and abs(travel_m - series[-1][0]) > GAP_M:
            self.restart()
        offset_m -= corrected_m + self._jumps_m
        if series and abs(offset_m - series[-1][1]) > JUMP_M:
            self._jumps_m += offset_m - series[-1][1]
            offset_m = series[-1][1]
        series.append((travel_m, offset_m))
        if len(series) < STRETCH_SCANS or abs(travel_m - series[0][0]) < STRETCH_M:
            return None
        travels_m, offsets_m = np.array(series).T
        self.restart()
        share = slope_of(travels_m, offsets_m)
        over_m = travels_m - travels_m.mean()
        rough_m = float(np.abs(offsets_m - offsets_m.mean() - share * over_m).max())
        if not LEAST_SLIP <= abs(share) <= MOST_SLIP or rough_m > ROUGH_M:
            return None
        return share * float(travels_m[-1] - travels_m[0])
