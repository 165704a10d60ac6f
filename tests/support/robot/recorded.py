"""A simulated run that is recorded: to a file at once, or to a list for who looks at records."""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from app import App, Ports
from core.config import Config
from core.saved.encoding import Arrays
from core.saved.state import restore
from fakes.planner_mcu.receiver import FakePlanner
from fakes.scenes.scene import Scene, Solid
from recorder import Recorder
from recording.direct import DirectTap
from recording.records import LINE, Record
from recording.tap import AnyTap
from tests.support.robot.closed_loop import SESSION, ClosedLoop
from tests.support.robot.shipped import FLOOR, shipped
from tools.rig.runs.loop import START_S, Loop


class ListTap:
    """Keeps what it is told."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self.calls, self.clock, self.trouble = 0, clock, ""
        self.first: Mapping[str, Any] = {}
        self.records: list[Record] = []

    def begin(self, first: Mapping[str, Any]) -> None:
        self.first = first

    def note(
        self, t_s: float, kind: bytes, port: int = 0, data: bytes = b"", more: bytes = b""
    ) -> None:
        self.records.append(Record(t_s, kind, port, data + more))

    def line(self, t_s: float, level: str, event: str, keys: Mapping[str, Any]) -> None: ...

    def flush(self, now_s: float) -> None: ...

    def end(self, wait_s: float) -> None: ...


class RecordedLoop(ClosedLoop):
    """World, fakes and app, stepped together, and all of the app recorded."""

    def __init__(
        self,
        to: Path | type[ListTap],
        config: Config,
        scene: Scene | str = "corridor",
        *,
        drives: bool = True,
        loaded: Arrays | None = None,
        key: bytes | None = None,
    ) -> None:
        def clock() -> float:
            return self.now_s

        self.now_s, self._loaded = START_S, loaded
        self.tap: AnyTap = DirectTap(to, clock) if isinstance(to, Path) else to(clock)
        self.recorder = Recorder(config, "0.1", self.tap)
        super().__init__(config, scene, drives=drives, key=key)

    def _new_app(self, key: bytes | None) -> App:
        scanner, ahrs, drive = self.ports.values()
        ports = self.recorder.ports(Ports(scanner, ahrs, drive, self.link_port))
        app = App(self.config, ports, session=SESSION, key=key)
        recorded = self.recorder.begin(app, key is not None, self._loaded)
        if self._loaded is not None:
            restore(app.mapper, self._loaded, self.config, self.now_s)
            self.recorder.restored(self.now_s)
        return recorded


def note_line(tap: AnyTap, t_s: float, level: str, event: str, keys: Mapping[str, Any]) -> None:
    """A line of the log, as a robot's recording keeps it."""
    said = {"level": level, "event": event, "keys": dict(keys)}
    tap.note(t_s, LINE, 0, json.dumps(said, default=str).encode())


class DriveToBox(Loop):
    """A recorded robot that is asked on and on to go ahead, with a box in its way."""

    def __init__(
        self,
        tap_with: Callable[[Callable[[], float]], AnyTap],  # given the clock
        box_x_m: float,  # the box's face
        start_clear_m: float,
        asked_mps: float,
    ) -> None:
        self.planner, self.now_s, self._asked_mps = FakePlanner(), START_S, asked_mps
        config = shipped(robot={"enable_motors": True, "start_clear_m": start_clear_m})
        self.recorder = Recorder(config, "0.1", tap_with(lambda: self.now_s))
        box = Solid("box", (box_x_m, box_x_m + 0.5), (-0.83, 0.87), (0.0, 0.93))
        super().__init__(Scene("hall", (FLOOR, box)), 1, config, self.planner)

    def _new_app(self, key: bytes | None) -> App:
        scanner, ahrs, drive = self.ports.values()
        ports = self.recorder.ports(Ports(scanner, ahrs, drive, self.link_port))
        app = App(self.config, ports, session=SESSION)
        return self.recorder.begin(app, key is not None, None)

    def drive(self, seconds: float) -> None:
        for _ in range(round(seconds * 200)):
            if self.ticks % 10 == 0:
                self.planner.drive(self.now_s, self._asked_mps, 0.0, 0.3)
            self.step()
