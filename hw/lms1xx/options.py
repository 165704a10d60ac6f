"""What the settings say of a SICK LMS1xx: the keys of [scanner] that its driver alone knows.

Angles are the device's: 90 deg is straight ahead, growing counter-clockwise.
Source: lms111 sheet, section 1.
"""

from typing import Annotated, Literal

import numpy as np
from msgspec import Meta, Struct

from core.records import ScannerSpec
from hw.lms1xx.cola import DialectSetting
from hw.lms1xx.telegrams import MAX_BEAMS, Echo

MODES = {(50, 0.5), (25, 0.25), (25, 0.5)}  # Hz, deg
MAX_RANGE_M, SIGMA_M = 20.0, 0.012  # of an LMS111; 1 sigma of a range
AHEAD_DEG = 90.0  # the device angle that is bearing 0

DeviceAngle = Annotated[float, Meta(ge=-45, le=225)]


class Lms1xxOptions(Struct, frozen=True):
    """Rate, step, used field of view and echoes.

    "auto" finds the dialect out; "binary" and "ascii" (CoLa-B and CoLa-A) never try the other.
    """

    dialect: DialectSetting
    scan_rate_hz: Literal[25, 50]
    angular_step_deg: float
    first_deg: DeviceAngle
    last_deg: DeviceAngle
    echo: Echo
    accepted_status: list[Annotated[int, Meta(ge=2, le=255)]]  # beside 0, of scans that are used

    def __post_init__(self) -> None:
        if (self.scan_rate_hz, self.angular_step_deg) not in MODES:
            raise ValueError(
                "angular_step_deg: must be 0.5 at 50 Hz, 0.25 or 0.5 at 25 Hz, "
                f"is {self.angular_step_deg} at {self.scan_rate_hz} Hz"
            )
        if self.last_deg - self.first_deg < self.angular_step_deg:
            raise ValueError(
                "last_deg: must be at least one angular_step_deg above "
                f"first_deg = {self.first_deg}, is {self.last_deg}"
            )

    @property
    def spec(self) -> ScannerSpec:
        step_deg = self.angular_step_deg
        used_deg = np.arange(self.first_deg, self.last_deg + step_deg / 2, step_deg)
        bearings_rad = np.radians(used_deg - AHEAD_DEG)
        return ScannerSpec(
            period_s=1.0 / self.scan_rate_hz,
            max_beams=MAX_BEAMS,
            max_range_m=MAX_RANGE_M,
            echoes=2 if self.echo == "both" else 1,
            sigma_m=SIGMA_M,
            sigma_share=0.0,
            is_plane=True,
            light_normal=(0.0, 0.0, 1.0),
            directions=np.stack(
                [np.cos(bearings_rad), np.sin(bearings_rad), 0 * bearings_rad], axis=1
            ),
        )

    def describe(self) -> str:
        beams = round((self.last_deg - self.first_deg) / self.angular_step_deg) + 1
        return (
            f"{beams} beams from {self.first_deg:g} to {self.last_deg:g} deg, "
            f"{self.scan_rate_hz} scans/s"
        )
