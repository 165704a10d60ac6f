"""One simulated robot whose bytes go to several apps at the same instants, so that maps compare.

The first app's words go back to the devices. The others must say the same, or the run ends: then
they would not have heard the same either.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from app import App, Ports
from config_file import load_config, with_changes
from core.config import Config
from core.mapping.paper.maps import ReferencePlaneMaps
from fakes.scenes.scene import Scene
from fakes.wires.wire import Fake, MemoryPort, Wire
from fakes.world.rig import AnyWorld, Rig
from tools.experiments.seen import SeenCells

F64 = npt.NDArray[np.float64]
ROOT = Path(__file__).resolve().parents[2]
START_S = 1000.0
DEVICES = ("scanner", "ahrs", "drive")
UNCOMPENSATED = "reference_plane, uncompensated"  # the paper's method without its step 6
LINK_HZ = 5.0  # nobody listens to the planner's wire here


class DisagreementError(Exception):
    """Two apps that got the same bytes wrote different ones to a device."""


class SharedPort(MemoryPort):
    """The first app's end of a wire; what comes in goes to the same port of the others too."""

    def __init__(self) -> None:
        super().__init__()
        self.others: list[MemoryPort] = []

    def give(self, data: bytes) -> None:
        """One piece for every host."""
        super().give(data)
        for other in self.others:
            other.give(data)

    def take_datagrams(self) -> list[bytes]:
        """What the first host wrote.

        Raises:
            DisagreementError: another host wrote something else.
        """
        written = super().take_datagrams()
        said = b"".join(written)
        for other in self.others:
            if (heard := other.take()) != said:
                raise DisagreementError(f"{said[:80]!r} and {heard[:80]!r}")
        return written


class WatchedRig(Rig):
    """A rig that notes where its scanner's beams truly ended."""

    def __init__(self, seen: SeenCells, *arguments: Any, **named: Any) -> None:
        self.seen = seen
        super().__init__(*arguments, **named)

    def _ranges_m_at(self, t_first_s: float, times_s: F64, bearings_rad: F64) -> F64:
        ranges_m = super()._ranges_m_at(t_first_s, times_s, bearings_rad)
        self.seen.note(self.world, times_s, bearings_rad, np.atleast_2d(ranges_m)[0])
        return ranges_m


def shipped() -> Config:
    """The settings as shipped, with a slow planner's wire."""
    config = load_config((ROOT / "mapod.toml").read_text(encoding="utf-8"))
    return with_changes(config, planner={"rate_hz": LINK_HZ})


def methods(quick: bool, **sections: dict[str, Any]) -> dict[str, Config]:
    """Settings of both methods, otherwise alike; and, but for quick runs, of Kalman cells."""
    base = with_changes(shipped(), **sections) if sections else shipped()
    kinds = {
        "reference_plane": {"method": "reference_plane"},
        "beams": {"method": "beams"},
        "kalman": {"method": "beams", "cell_value": "kalman"},
    }
    if quick:
        kinds.pop("kalman")
    return {name: with_changes(base, map=keys) for name, keys in kinds.items()}


@dataclass(slots=True)
class Run:
    """Rig and apps, stepped together on a simulated clock; faults and orders go to `rig`."""

    rig: WatchedRig
    apps: dict[str, App]
    wires: list[Wire]
    links: list[MemoryPort]
    rate_hz: float
    ticks: int = 0
    now_s: float = START_S

    @property
    def elapsed_s(self) -> float:
        """Simulated time since the begin."""
        return self.now_s - START_S

    def step(self) -> None:
        self.ticks += 1
        self.now_s = START_S + self.ticks / self.rate_hz
        self.rig.step(self.now_s)
        for wire in self.wires:
            wire.step(self.now_s)
        for app in self.apps.values():
            app.step(self.now_s)
        for link in self.links:
            link.take_datagrams()

    def run(
        self, seconds: float, every_s: float = 0.0, each: Callable[[], None] | None = None
    ) -> None:
        """Step for so long; `each` is called after every `every_s` (0: every tick)."""
        apart = max(1, round(every_s * self.rate_hz))
        for tick in range(round(seconds * self.rate_hz)):
            self.step()
            if each and (tick + 1) % apart == 0:
                each()


def run_of(world: AnyWorld | Scene | str, configs: dict[str, Config], seed: int = 1) -> Run:
    """A run of these apps, by name, in a world or a scene."""
    first = next(iter(configs.values()))
    fan = first.scanner.options.spec.directions[[0, -1]]
    span_rad = (math.atan2(fan[0, 1], fan[0, 0]), math.atan2(fan[1, 1], fan[1, 0]))
    watched = WatchedRig(SeenCells(first.map.cell_m, span_rad), world, seed)
    shared = {name: SharedPort() for name in DEVICES}
    fakes: tuple[Fake, ...] = (watched.scanner, watched.ahrs, watched.drive)
    wires = [
        Wire(fake, port, seed + k)
        for k, (fake, port) in enumerate(zip(fakes, shared.values(), strict=True))
    ]
    apps: dict[str, App] = {}
    links: list[MemoryPort] = []
    for name, config in configs.items():
        own: dict[str, MemoryPort] = (
            dict(shared) if not apps else {d: MemoryPort() for d in DEVICES}
        )
        if apps:
            for device, port in own.items():
                shared[device].others.append(port)
        links.append(MemoryPort(datagrams=True))
        ports = Ports(own["scanner"], own["ahrs"], own["drive"], links[-1])
        apps[name] = App(config, ports, session=1)
        if name == UNCOMPENSATED:
            apps[name].mapper.maps = ReferencePlaneMaps(config, compensated=False)
        elif config.map.method == "reference_plane":
            apps[name].mapper.maps = ReferencePlaneMaps(config)
    return Run(watched, apps, wires, links, first.loop.rate_hz)
