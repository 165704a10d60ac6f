"""From the settings to ports, devices, links and servers: everything that `App` steps."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from typing import TYPE_CHECKING, NamedTuple

from core.config import Config, ConfigError
from core.driving.control import link_refusal
from core.mapping.mapper import Mapper
from hw.device import NoPort, Port
from hw.planner_link.receivers import Planners
from hw.planner_link.sender import LinkSettings, Wire
from hw.ports.url import CAMERAS
from hw.ports.wires import PortUrlError, open_port, parse_url, ports_beside
from hw.registry import (
    ATTITUDE_SENSORS,
    CAMERA_PORTS,
    DEPTH_CAMERAS,
    DRIVES,
    SCANNERS,
    AnyDevice,
    AttitudeSensor,
    DepthSensor,
    Drive,
    Scanner,
    Surroundings,
)
from hw.runtime.wakeup import EventSource, NoEvents

if TYPE_CHECKING:
    from beside import Work
    from cleaner import Cleaner
    from core.objects.seen import Seen
    from core.paths.cleaning.planned import Planned
    from hw.modbus.image import RegisterImage
    from perception import Perception


NO_POLYGONS = (
    "depth.driver: {!r} needs the library of polygons, which is not installed: "
    "pip install 'mapod[objects]'"
)


@dataclass(frozen=True, slots=True)
class DepthPorts:
    """The wires of a depth camera."""

    control: Port
    open_at: Callable[[int], Port]  # another one of the same host, by its number


@dataclass(frozen=True, slots=True)
class Ports:
    """The wires of the app."""

    scanner: Port
    ahrs: Port
    drive: Port
    planner: Port
    receivers: tuple[Port, ...] = ()  # who else gets the map: the rest of `planner.port`
    depth: DepthPorts | None = None  # None: there is no depth camera, or nobody looks at it

    @property
    def of_devices(self) -> tuple[Port, Port, Port]:
        """Those that a scan's bytes come over, and what places it."""
        return self.scanner, self.ahrs, self.drive

    def close(self) -> None:
        for port in (*self.of_devices, self.planner, *self.receivers):
            port.close()
        if self.depth is not None:
            self.depth.control.close()


class Devices(NamedTuple):
    """What measures and moves, each on its port, in the order in which they are heard."""

    ahrs: AttitudeSensor
    drive: Drive
    scanner: Scanner
    depth: DepthSensor | None = None  # None: there is none, or its frames are replayed

    @property
    def of_scans(self) -> tuple[AttitudeSensor, Drive, Scanner]:
        """Those that are heard between ticks too: a depth camera is stepped at ticks alone."""
        return self.ahrs, self.drive, self.scanner

    @property
    def every(self) -> list[AnyDevice]:
        """All that there are."""
        return list(self.by_section.values())

    @property
    def by_section(self) -> dict[str, AnyDevice]:
        """By the section of mapod.toml that describes them."""
        found: dict[str, AnyDevice] = {
            "scanner": self.scanner, "ahrs": self.ahrs, "drive": self.drive,
        }  # fmt: skip
        if self.depth is not None:
            found["depth"] = self.depth
        return found


def no_ports(config: Config) -> Ports:
    nowhere = NoPort()
    others = (nowhere,) * (len(config.planner.ports) - 1)
    depth = DepthPorts(nowhere, lambda number: nowhere) if config.has_camera else None
    return Ports(nowhere, nowhere, nowhere, nowhere, others, depth)


def check_ports(config: Config) -> None:
    """ConfigError for a URL that names no port, one for two, or seven bits where all are needed.

    And for a depth camera, where the library of what it sees lacks.
    """
    if config.depth is not None and config.has_camera and find_spec("shapely") is None:
        raise ConfigError(NO_POLYGONS.format(config.depth.driver))
    given = [("scanner", config.scanner.port), ("ahrs", config.ahrs.port)]
    given += [("drive", config.drive.port)] if config.drive.port else []
    if config.depth is not None and config.has_camera:
        given.append(("depth", config.depth.port))
    given += [("planner", url) for url in config.planner.ports]
    given += [("modbus", url) for url in config.modbus.ports]
    lines: dict[str, str] = {}  # by the path of a serial line: whose it is
    for section, url in given:
        try:
            parts = parse_url(url)
        except PortUrlError as error:
            raise ConfigError(f"{section}.port: {error}") from None
        _check_camera(config, section, url, parts.kind)
        if parts.kind != "serial":
            continue
        if parts.bytesize != 8 and section in ("planner", "modbus"):
            raise ConfigError(f"{section}.port: bytesize must be 8 here, is 7 in {url!r}")
        if parts.path in lines:
            raise ConfigError(f"{section}.port: {url!r} is {lines[parts.path]}.port already")
        lines[parts.path] = section


def _check_camera(config: Config, section: str, url: str, kind: str) -> None:
    """ConfigError for a camera's port where none is read, or another kind where only such is."""
    driver = str(getattr(getattr(config, section), "driver", ""))
    read = CAMERA_PORTS.get((section, driver), ())
    if kind in CAMERAS and kind not in read:
        readers = [
            f"{whose}.driver = {name!r}" for (whose, name), of in CAMERA_PORTS.items() if kind in of
        ]
        raise ConfigError(
            f"{section}.port: {url!r} is a camera's: only {' or '.join(readers)} reads one"
        )
    if section == "depth" and read and kind not in read:
        allowed = " or ".join(f"{one}:///" for one in read)
        raise ConfigError(
            f"depth.port: must begin with {allowed} for driver {driver!r}, is {url!r}"
        )


def open_ports(config: Config) -> Ports:
    """The ports of devices and planners, none of them connected yet.

    Raises:
        ConfigError: as check_ports; a host without an address.
    """

    def opened(section: str, url: str) -> Port:
        try:
            return open_port(url)
        except PortUrlError as error:
            raise ConfigError(f"{section}.port: {error}") from None

    check_ports(config)
    return Ports(
        opened("scanner", config.scanner.port),
        opened("ahrs", config.ahrs.port),
        opened("drive", config.drive.port) if config.drive.port else NoPort(),
        opened("planner", config.planner.ports[0]),
        tuple(opened("planner", url) for url in config.planner.ports[1:]),
        _depth_ports(config, opened),
    )


def _depth_ports(config: Config, opened: Callable[[str, str], Port]) -> DepthPorts | None:
    if config.depth is None or not config.has_camera:
        return None
    url = config.depth.port
    control = opened("depth", url)
    if parse_url(url).kind != "tcp":
        return DepthPorts(control, lambda number: NoPort())
    return DepthPorts(control, ports_beside(url))


def full_counts_per_s(config: Config) -> float:
    """Of a wheel's encoder, at the robot's greatest speed."""
    robot = config.robot
    turns_per_s = robot.max_speed_mps / (2 * math.pi * robot.wheel_radius_m) * robot.gear_ratio
    return turns_per_s * 4 * robot.encoder_ppr


def devices_on(ports: Ports, config: Config) -> Devices:
    scanner, ahrs, drive = config.scanner, config.ahrs, config.drive
    counts_per_s, may_move = full_counts_per_s(config), config.robot.enable_motors

    def around(url: str) -> Surroundings:
        return Surroundings(url, counts_per_s, may_move)

    depth, wires = config.depth, ports.depth
    camera = None
    if depth is not None and config.has_camera and wires is not None:
        near = Surroundings(depth.port, counts_per_s, may_move, wires.open_at)
        camera = DEPTH_CAMERAS[depth.driver].make(wires.control, depth.options, near)
    return Devices(
        ATTITUDE_SENSORS[ahrs.driver].make(ports.ahrs, ahrs.options, around(ahrs.port)),
        DRIVES[drive.driver].make(ports.drive, drive.options, around(drive.port)),
        SCANNERS[scanner.driver].make(ports.scanner, scanner.options, around(scanner.port)),
        camera,
    )


def planners_on(ports: Ports, config: Config, session: int, key: bytes | None) -> Planners:
    planner, may_move, has_key = config.planner, config.robot.enable_motors, key is not None
    tick_s = 1.0 / planner.rate_hz
    return Planners(
        [
            Wire(
                port,
                line_baud=parse_url(url).baud,
                drive_refusal=link_refusal(url, has_key, may_move),
                pose_refusal=link_refusal(url, has_key, True),
            )
            for port, url in zip((ports.planner, *ports.receivers), planner.ports, strict=True)
        ],
        LinkSettings(
            size=config.obstacle.window_cells,
            cell_mm=round(config.map.cell_m * 1000),
            tick_s=tick_s,
            key=key,
            stale_ms=max(150, math.ceil(3000 * tick_s)),
            push=planner.push,
        ),
        session,
    )


def maybe_perception(
    config: Config, devices: Devices, mapper: Mapper, frames: "Work[Seen] | None"
) -> "Perception | None":
    """What looks at the depth camera; none where there is none."""
    if not config.has_camera:
        return None
    from beside import AtOnce
    from perception import Perception  # polygons are for who has such a camera

    return Perception(config, devices.depth, mapper, frames or AtOnce())


def maybe_cleaner(
    config: Config,
    mapper: Mapper,
    perception: "Perception | None",
    plans: "Work[Planned | None] | None",
) -> "Cleaner | None":
    """What plans paths over the floor; none where nobody asks for them."""
    if config.coverage is None or not config.coverage.plan or perception is None:
        return None
    from beside import AtOnce
    from cleaner import Cleaner

    live = None
    if perception.look is not None:
        from core.paths.cleaning.live import LiveCleaning  # polygons: not for a replay

        live = LiveCleaning(config.coverage, config.robot.start_clear_m)
        perception.look.tell = live.see
    return Cleaner(config.coverage, mapper, live, plans or AtOnce())


def maybe_image(
    config: Config, planners: Planners, session: int, version: str
) -> "RegisterImage | None":
    """What Modbus clients read; none where nobody may."""
    if not config.modbus.ports:
        return None
    from hw.modbus.image import RegisterImage  # only where somebody reads it

    may_drive = config.modbus.allow_drive and config.robot.enable_motors
    return RegisterImage(
        size=config.obstacle.window_cells,
        cell_mm=round(config.map.cell_m * 1000),
        session=session,
        version=version,
        ask=planners.requests.ask if may_drive else None,
    )


def modbus_servers(config: Config, image: "RegisterImage | None") -> EventSource:
    """A server, not started yet, for each port of [modbus], by what the log calls it."""
    if image is None:
        return NoEvents()
    from hw.modbus.server import ModbusServer  # asyncio is for who wants to be served
    from hw.runtime.servers import Servers

    servers = {
        f"modbus {url}": ModbusServer(
            url, image, time.monotonic, unit=config.modbus.unit, utc_s=time.time
        )
        for url in config.modbus.ports
    }
    return Servers(servers)
