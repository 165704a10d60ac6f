"""The whole robot in one process on a simulated clock: world, fakes, wires, app, planner.

No clock is read and nothing waits. Two loops of the same scene, seed and settings say the same to
the bit, as long as their planners do. Faults are set on wires and fakes, at once or on a timetable.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from app import App, Ports
from config_file import load_config, with_changes
from core.config import Config
from fakes.faults.timetable import Schedule, order_from_text
from fakes.planner_mcu.receiver import FakePlanner
from fakes.positioning.system import FakePositioning
from fakes.scenes.scene import Scene
from fakes.wires.wire import DatagramWire, MemoryPort, Wire
from fakes.world.error_models import ErrorModels
from fakes.world.rig import DEFAULT_SCANNER, SCANNERS, AnyWorld, Rig
from fakes.world.robot import BODY, Mount, body_with
from mapod_link.receiver import Receiver
from tools.settings import lens_of, wheels_of

SHIPPED = Path(__file__).resolve().parents[3] / "mapod.toml"
ROBOTS = SHIPPED.with_name("robots")  # the settings of others
START_S = 1000.0
SESSION = 0x5A17C0DE
WATCHDOG = 0x02  # register 00 of a controller that a PC drives
CELLS = 121  # of the elevation map: on a ramp, the floor comes in sight 11 m ahead
NAMES = ("scanner", "ahrs", "drive", "planner")  # of fakes and wires

Tap = Callable[[str, str, bytes], None]  # wire's name, "d2h" or "h2d", what went over it


class Planner(Protocol):
    """The planner's end of the link: frames in, frames out."""

    def feed_datagram(self, now_s: float, data: bytes) -> Any: ...

    def poll(self, now_s: float) -> list[bytes]: ...


class TappedPort(MemoryPort):
    """A port of the app of which somebody keeps all bytes, as the app wrote and as it got them."""

    def __init__(self, name: str, datagrams: bool = False) -> None:
        super().__init__(datagrams)
        self._name = name
        self.taps: list[Tap] = []

    def write(self, data: bytes) -> None:
        self._tell("h2d", data)
        super().write(data)

    def give(self, data: bytes) -> None:
        """What the app hears, after all faults of the wire."""
        self._tell("d2h", data)
        super().give(data)

    def _tell(self, way: str, data: bytes) -> None:
        if data and self.connected:
            for tap in self.taps:
                tap(self._name, way, data)


def rig_config(scene: Scene, settings: Path = SHIPPED, *, radio: bool = False) -> Config:
    """Settings with a larger map, of a robot that may be driven in this scene."""
    return with_changes(
        load_config(settings.read_text(encoding="utf-8")),
        robot={"enable_motors": True, "start_clear_m": scene.start_clear_m},
        drive={"radio": radio},
        map={"cells": CELLS},
    )


def settings_of(robot: str) -> Path:
    """The file of a robot of robots/; "": the shipped one."""
    return ROBOTS / f"{robot}.toml" if robot else SHIPPED


class Loop:
    """World, fakes, app and planner, stepped together."""

    def __init__(
        self,
        scene: Scene | str | Path | AnyWorld,
        seed: int = 1,  # of all chance, the planner's apart
        config: Config | None = None,  # None: as shipped for this scene
        planner: Planner | None = None,  # None: a public receiver that drives nowhere
        *,
        drives: bool = False,  # a radio drives along the scene's route, and the app only looks on
        key: bytes | None = None,  # of the link
        errors: ErrorModels | None = None,  # instead of the scene's own
        start_s: float = START_S,  # of the host's clock
    ) -> None:
        scanner = DEFAULT_SCANNER if config is None else config.scanner.driver
        scanner = scanner if scanner in SCANNERS else DEFAULT_SCANNER  # the caller has its own
        mount = None if config is None else Mount(*lens_of(config))
        body = BODY if config is None else body_with(*wheels_of(config))
        self.rig = Rig(
            scene, seed, drives=drives, errors=errors, scanner=scanner, mount=mount, body=body
        )
        self.config = config or rig_config(self.rig.world.scene, radio=drives)
        if not drives:  # a vehicle that is driven from the PC has the watchdog on
            self.rig.drive.parameters[0x00], self.rig.drive.mode = WATCHDOG, "rs232_watchdog"
        self.link_end: Planner = planner or FakePlanner(key=key)
        devices = self.rig.scanner, self.rig.ahrs, self.rig.drive
        self.fakes: dict[str, Any] = dict(zip(NAMES, (*devices, self.link_end), strict=True))
        self.ports = {name: TappedPort(name) for name in NAMES[:-1]}
        self.link_port = TappedPort("planner", datagrams=True)
        self.positioning = FakePositioning(self.rig.world, seed)
        self._is_watched = self.config.motion.source == "external"  # by that, over the link's end
        self._device_wires = tuple(
            Wire(self.fakes[name], port, seed + k)
            for k, (name, port) in enumerate(self.ports.items())
        )
        self._link_wire = DatagramWire(self.fakes["planner"], self.link_port, seed + 3)
        self.wires = dict(zip(NAMES, (*self._device_wires, self._link_wire), strict=True))
        self.app = self._new_app(key)
        self.start_s, self.now_s = start_s, start_s
        self.ticks, self._rate_hz = 0, self.config.loop.rate_hz
        self._schedule: Schedule | None = None
        self.happened: list[tuple[float, str]] = []  # faults on and off, with their instants

    def _new_app(self, key: bytes | None) -> App:
        """For who puts something between the app and its ports to change."""
        scanner, ahrs, drive = self.ports.values()
        ports = Ports(scanner, ahrs, drive, self.link_port)
        return App(self.config, ports, session=SESSION, key=key)

    def listen(self, tap: Tap) -> None:
        for port in (*self.ports.values(), self.link_port):
            port.taps.append(tap)

    def set_faults(self, texts: Sequence[str]) -> None:
        """Faults from now on, say "scanner.wire.mute@12s+2s". Raises FaultError: no such one."""
        if not texts:
            self._schedule = None
            return
        targets: dict[str, tuple[Any, ...]] = {
            name: (self.fakes[name], self.wires[name]) for name in self.fakes
        }
        targets["positioning"] = (self.positioning,)
        self._schedule = Schedule([order_from_text(text) for text in texts], targets)

    def step(self) -> None:
        self._advance()
        self.app.step(self.now_s)
        self._link_wire.step(self.now_s)

    def _advance(self) -> None:
        self.ticks += 1
        now_s = self.now_s = self.start_s + self.ticks / self._rate_hz
        if self._schedule is not None:
            self.happened += [(now_s, said) for said in self._schedule.step(now_s)]
        self.rig.step(now_s)
        if self._is_watched and isinstance(self.link_end, Receiver):
            self.positioning.step(now_s, self.link_end)
        for wire in self._device_wires:
            wire.step(now_s)

    def hang(self, seconds: float) -> None:
        """The app does nothing for so long, while all else goes on."""
        for _ in range(round(seconds * self._rate_hz)):
            self._advance()
            self._link_wire.step(self.now_s)

    def run(self, seconds: float, each: Callable[[], None] | None = None) -> None:
        for _ in range(round(seconds * self.config.loop.rate_hz)):
            self.step()
            if each:
                each()

    @property
    def since_begin_s(self) -> float:
        return self.now_s - self.start_s

    def map_now(self) -> npt.NDArray[np.int8]:
        """The app's obstacle window, (size, size) [j, i] from its corner."""
        window = self.app.mapper.maps.window
        grid, cells = window.grid, window.cells
        return np.roll(cells, (-grid.corner_j, -grid.corner_i), axis=(0, 1))
