"""Every device that mapod knows, by the `driver` key of its section in the settings.

A new device is a folder beside this file and a line below: the struct of the keys that its driver
alone knows, and how to make it of a port. What the app calls on it is one of the protocols here.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

from core.records import Attitude, DepthImage, PointSweep, Scan, WheelCounts
from hw.ax3500.session import Ax3500, Ax3500Options
from hw.depth_images.options import FolderOptions, KinectOptions
from hw.device import DeviceStatus, NoPort, Port
from hw.lms1xx.options import Lms1xxOptions
from hw.lms1xx.session import Lms111
from hw.mti.session import Mti, MtiOptions
from hw.no_depth.options import NoDepthOptions
from hw.no_drive.session import NoDrive, NoDriveOptions
from hw.ports.url import parse_url
from hw.stripe.options import StripeOptions
from hw.urg04lx.options import Urg04lxOptions
from hw.urg04lx.session import Urg04lx
from hw.visionary.options import VisionaryOptions

MTI_BAUD = 115_200  # its own, where the port has none (tcp)


class AnyDevice(Protocol):
    """What every device on its port is to the app. No call waits."""

    status: DeviceStatus
    port: Port

    @property
    def has_heard(self) -> bool:
        """Whether measurements wait for the next step."""

    @property
    def due_s(self) -> float:
        """When it wants to be heard though nothing has arrived; -inf: stepped, at every tick."""

    @property
    def settled(self) -> bool:
        """After `stop`: nothing is left that it must still bring about."""

    @property
    def identity(self) -> str:
        """Type, serial number, firmware, as far as it has told; for the log when it runs."""

    def hear(self, now_s: float) -> None:
        """Take in what has arrived since the last step."""

    def keep(self, now_s: float) -> None:
        """The same for what nobody waits for: what it means may be found out at the next step."""

    def stop(self) -> None:
        """The program ends: last words; step it until it has settled."""

    def measured(self) -> dict[str, float]:
        """Voltages, temperatures and the like, by name with its unit; for the log now and then."""


class Clocked(AnyDevice, Protocol):
    """A device that stamps what it measures by a clock of its own."""

    @property
    def clock_locked(self) -> bool:
        """Whether that clock is known well enough."""

    @property
    def clock_uncertainty_s(self) -> float:
        """Typical error of its measurements' times, beyond a constant delay."""


class Scanner(Clocked, Protocol):
    """What measures ranges. Its period, beams and range are its options' `spec`."""

    def step(self, now_s: float) -> Sequence[Scan | PointSweep]:
        """The sweeps that are complete since the last step; no more beams than its spec says."""

    @property
    def is_impaired(self) -> bool:
        """Whether it sees worse than it should, by a dirty window for instance: told, no more."""

    @property
    def doubt(self) -> str:
        """Why nobody may drive by what it sees though scans come, in words; "" if all is well."""


class AttitudeSensor(Clocked, Protocol):
    """What tells how the body lies and turns."""

    def step(self, now_s: float) -> Sequence[Attitude]:
        """The samples since the last step."""


class Drive(AnyDevice, Protocol):
    """What counts the wheels' turns and moves them."""

    def step(self, now_s: float) -> Sequence[WheelCounts]:
        """The pairs of counts since the last step."""

    def drive(self, left: float, right: float) -> None:
        """Wheel power until the next tick, -1..1 of full; not called for 0.1 s, it is zero."""

    @property
    def trouble(self) -> str:
        """Why the motors do not obey, in words; "" if they do."""

    @property
    def emergency_stop(self) -> bool:
        """Whether it is pressed."""


class DepthSensor(Clocked, Protocol):
    """What measures a depth at each pixel of an image. It is stepped at every tick."""

    def step(self, now_s: float) -> Sequence[DepthImage]:
        """The newest image since the last step, or none."""

    @property
    def doubt(self) -> str:
        """Why what it sees is not to be believed though images come; "" if all is well."""


@dataclass(frozen=True, slots=True)
class Surroundings:
    """What a driver may want to know beside its own options."""

    url: str  # of its port
    max_counts_per_s: float  # of a wheel's encoder, at the robot's greatest speed
    enable_motors: bool
    open_at: Callable[[int], Port] | None = None  # a port of the same host by its number


Made = TypeVar("Made", bound=AnyDevice, covariant=True)


@dataclass(frozen=True, slots=True)
class Driver(Generic[Made]):
    """A kind of device: the keys of its own, and how to make one that is set so."""

    options: type[Any]  # a msgspec struct; a scanner's has `spec`, and all have `describe()`
    make: Callable[[Port, Any, Surroundings], Made]


def _mti(port: Port, options: MtiOptions, around: Surroundings) -> Mti:
    return Mti(port, rate_hz=options.rate_hz, baud=parse_url(around.url).baud or MTI_BAUD)


def _urg04lx(port: Port, options: Urg04lxOptions, around: Surroundings) -> Urg04lx:
    return Urg04lx(port, options, parse_url(around.url).baud)


def _stripe(port: Port, options: StripeOptions, around: Surroundings) -> Scanner:
    from hw.stripe.session import StripeScanner  # images and JPEGs: for who has a camera

    return StripeScanner(port, options, parse_url(around.url).host)


def _ax3500(port: Port, options: Ax3500Options, around: Surroundings) -> Ax3500:
    speed, enable = around.max_counts_per_s, around.enable_motors
    return Ax3500(port, options, max_counts_per_s=speed, enable_motors=enable)


def _visionary(port: Port, options: VisionaryOptions, around: Surroundings) -> DepthSensor:
    from hw.visionary.camera import Visionary  # kernels and images: for who has a depth camera

    return Visionary(port, options, around.open_at or (lambda number: NoPort()))


def _kinect(port: Port, options: KinectOptions, around: Surroundings) -> DepthSensor:
    from hw.depth_images.session import kinect_on  # likewise

    return kinect_on(port, options)


def _folder(port: Port, options: FolderOptions, around: Surroundings) -> DepthSensor:
    from hw.depth_images.session import folder_on  # likewise

    return folder_on(port, options)


def _no_depth(port: Port, options: NoDepthOptions, around: Surroundings) -> DepthSensor:
    raise ValueError("where there is no depth camera none is made")


SCANNERS: dict[str, Driver[Scanner]] = {
    "lms111": Driver(Lms1xxOptions, lambda port, options, around: Lms111(port, options)),
    "urg04lx": Driver(Urg04lxOptions, _urg04lx),
    "stripe": Driver(StripeOptions, _stripe),
}
ATTITUDE_SENSORS: dict[str, Driver[AttitudeSensor]] = {"mti": Driver(MtiOptions, _mti)}
DRIVES: dict[str, Driver[Drive]] = {
    "ax3500": Driver(Ax3500Options, _ax3500),
    "none": Driver(NoDriveOptions, lambda port, options, around: NoDrive(port)),
}
DEPTH_CAMERAS: dict[str, Driver[DepthSensor]] = {
    "none": Driver(NoDepthOptions, _no_depth),
    "visionary": Driver(VisionaryOptions, _visionary),
    "kinect": Driver(KinectOptions, _kinect),
    "folder": Driver(FolderOptions, _folder),
}
CAMERA_PORTS = {  # what carries images alone, by the section and the driver that reads it
    ("scanner", "stripe"): ("v4l2", "folder"),
    ("depth", "kinect"): ("kinect", "fakenect"),
    ("depth", "folder"): ("folder",),
}
