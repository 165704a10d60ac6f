"""A simulated run that is recorded: to a file at once, or to a list for who looks at records."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from app import App, Ports
from core.config import Config
from core.saved.encoding import Arrays
from core.saved.state import restore
from fakes.scenes.scene import Scene
from recorder import Recorder
from recording.direct import DirectTap
from recording.records import Record
from recording.tap import AnyTap
from tests.support.closed_loop import SESSION, ClosedLoop
from tools.rig.loop import START_S


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
