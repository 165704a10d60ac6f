"""Settings of the devices, as their sections of the file have them, with what their drivers add.

Degrees stand in the file and here alone.
"""

import math
from typing import Annotated, Protocol, runtime_checkable

from msgspec import Meta, Struct

from core.records import ScannerSpec
from core.run_settings import Port

Degrees = Annotated[float, Meta(ge=-180, le=180)]
Offset = Annotated[float, Meta(ge=-5, le=5)]


@runtime_checkable
class Options(Protocol):
    """The keys that a driver alone knows: a struct of its own."""

    def describe(self) -> str: ...


@runtime_checkable
class ScannerOptions(Options, Protocol):
    """Those of a scanner also say what it can do."""

    @property
    def spec(self) -> ScannerSpec: ...


@runtime_checkable
class DepthOptions(Options, Protocol):
    """Those of a depth camera also say how often it tells something."""

    @property
    def period_s(self) -> float:
        """From one frame to the next, as it is wanted."""


class OnMount(Struct, frozen=True):
    """A device that looks ahead, and where it sits on the body."""

    driver: str
    port: str
    mount_x_m: Offset
    mount_y_m: Offset
    mount_z_m: Annotated[float, Meta(gt=0, le=5)]
    mount_roll_deg: Degrees
    mount_tilt_deg: Annotated[float, Meta(ge=-90, le=90)]
    mount_yaw_deg: Degrees
    options: Options

    @property
    def mount_xyz_m(self) -> tuple[float, float, float]:
        return self.mount_x_m, self.mount_y_m, self.mount_z_m

    @property
    def mount_rpy_rad(self) -> tuple[float, float, float]:
        """Roll, tilt and yaw."""
        roll, tilt = math.radians(self.mount_roll_deg), math.radians(self.mount_tilt_deg)
        return roll, tilt, math.radians(self.mount_yaw_deg)


class Scanner(OnMount, frozen=True):
    """The range sensor."""

    port: Port
    options: ScannerOptions


class Depth(OnMount, frozen=True):
    """The depth camera, whose port is "" where there is none."""

    options: DepthOptions


class Ahrs(Struct, frozen=True):
    """The attitude sensor, and how its case is turned on the body."""

    driver: str
    port: Port
    mount_roll_deg: Degrees
    mount_pitch_deg: Degrees
    mount_yaw_deg: Degrees
    options: Options


class Drive(Struct, frozen=True):
    """The motor controller, of which the encoder counters are read, and which moves the wheels."""

    driver: str
    port: str  # "" where there is none
    full_power_mps: Annotated[float, Meta(ge=0.01, le=20)]
    options: Options
