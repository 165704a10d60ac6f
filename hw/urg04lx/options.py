"""What the settings say of a Hokuyo scanner: the keys of [scanner] that its driver alone knows.

Angles are bearings: 0 deg is straight ahead, growing counter-clockwise.
Source: urg04lx sheet, sections 1 and 5.
"""

import math
from typing import Annotated, Literal

import numpy as np
from msgspec import Meta, Struct

from core.records import F64, ScannerSpec
from hw.urg04lx.sensor import LEAST_RANGE_MM

Model = Literal["URG-04LX", "URG-04LX-UG01", "UTM-30LX", "UST-10LX"]
CHECKED, MOST_CORRECTED_M = 101, 1.0  # ranges at which a correction is checked; what none exceeds
Bearing = Annotated[float, Meta(ge=-135, le=135)]
MODELS: dict[str, tuple[int, float, float, float, float, float]] = {
    # steps of a turn, their bearing to either side, turns a second, longest range,
    # 1 sigma of a range near, and far as a share: half of the accuracy that is promised
    "URG-04LX": (1024, 119.9, 10.0, 5.6, 0.005, 0.005),
    "URG-04LX-UG01": (1024, 119.9, 10.0, 5.6, 0.015, 0.015),
    "UTM-30LX": (1440, 135.0, 40.0, 30.0, 0.015, 0.0025),
    "UST-10LX": (1440, 135.0, 40.0, 10.0, 0.020, 0.0),
}


class Urg04lxOptions(Struct, frozen=True):
    """Model, used field of view, how scans are asked for, and the correction of ranges."""

    model: Model
    from_deg: Bearing
    to_deg: Bearing
    cluster: Annotated[int, Meta(ge=1, le=99)]
    skip_scans: Annotated[int, Meta(ge=0, le=9)]
    characters: Literal[2, 3]
    stream: bool
    correction: Annotated[list[float], Meta(min_length=4, max_length=4)]
    correction_m: Annotated[list[float], Meta(min_length=2, max_length=2)]

    def __post_init__(self) -> None:
        if self.to_deg - self.from_deg < self.step_deg:
            raise ValueError(
                f"to_deg: must be at least {self.step_deg:g} deg above from_deg = "
                f"{self.from_deg:g}, is {self.to_deg:g}"
            )
        if not 0.0 <= self.correction_m[0] < self.correction_m[1] <= 100.0:
            raise ValueError(
                f"correction_m: must be two ranges in m, 0 <= from < to <= 100, "
                f"is {self.correction_m}"
            )
        nearest_m, farthest_m = self.correction_m
        read_m = np.linspace(nearest_m, farthest_m, CHECKED)
        true_m = read_m + self._added_m(read_m)
        if not (np.abs(true_m - read_m) < MOST_CORRECTED_M).all():
            raise ValueError(
                f"correction: must move no range of correction_m by {MOST_CORRECTED_M:g} m or "
                f"more, is {self.correction}"
            )
        if not (np.diff(true_m) >= 0.0).all():
            raise ValueError(
                f"correction: must leave what is farther farther within correction_m, "
                f"is {self.correction}"
            )

    @property
    def step_deg(self) -> float:
        """Between two values of a scan."""
        return 360.0 / MODELS[self.model][0] * self.cluster

    @property
    def least_m(self) -> float:
        """The nearest range that it tells; less stands for none."""
        return LEAST_RANGE_MM / 1000

    @property
    def period_s(self) -> float:
        return (1 + self.skip_scans) / MODELS[self.model][2]

    @property
    def spec(self) -> ScannerSpec:
        _, side_deg, _, range_m, sigma_m, sigma_share = MODELS[self.model]
        used_deg = np.arange(self.from_deg, self.to_deg + self.step_deg / 2, self.step_deg)
        used_rad = np.radians(used_deg[np.abs(used_deg) <= side_deg])
        return ScannerSpec(
            period_s=self.period_s,
            max_beams=round(2 * side_deg / self.step_deg) + 2,
            max_range_m=range_m,
            echoes=1,
            sigma_m=sigma_m,
            sigma_share=sigma_share,
            is_plane=True,
            light_normal=(0.0, 0.0, 1.0),
            directions=np.stack([np.cos(used_rad), np.sin(used_rad), 0 * used_rad], axis=1),
        )

    def corrected_m(self, ranges_m: F64) -> F64:
        """Ranges (n,) with the polynomial added; beyond its interval, as at the nearer end.

        NaN where nothing above 0 is left.
        """
        if not any(self.correction):
            return ranges_m
        corrected_m = ranges_m + self._added_m(ranges_m)
        corrected_m[corrected_m <= 0.0] = math.nan
        return np.asarray(corrected_m)

    def _added_m(self, ranges_m: F64) -> F64:
        a, b, c, d = self.correction
        nearest_m, farthest_m = self.correction_m
        r = np.minimum(np.maximum(ranges_m, nearest_m), farthest_m)
        return np.asarray(a + r * (b + r * (c + r * d)))

    def describe(self) -> str:
        beams = round((self.to_deg - self.from_deg) / self.step_deg) + 1
        return (
            f"{self.model}, {beams} beams from {self.from_deg:g} to {self.to_deg:g} deg, "
            f"{1 / self.period_s:g} scans/s"
        )
