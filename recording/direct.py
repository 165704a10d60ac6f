"""Recording by who can wait for the disk: a simulated run, or a test. No process and no bound."""

import json
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from recording.openings import Openings
from recording.records import OF_WIRES
from recording.run_file import RunFile

SYNC_S = 1.0


class DirectTap:
    """Takes records as `recording.tap.Tap` does, and writes them at once."""

    def __init__(self, path: Path, clock: Callable[[], float]) -> None:
        self.calls, self.clock, self.trouble = 0, clock, ""
        self._path, self._sequence = path, 0
        self._file: RunFile | None = None
        self._synced_s = -math.inf

    def begin(self, first: Mapping[str, Any]) -> None:
        more = {"part": "1", "continues": ""}
        self._file = RunFile(self._path, first, more, Openings([], 0.0))

    def note(
        self, t_s: float, kind: bytes, port: int = 0, data: bytes = b"", more: bytes = b""
    ) -> None:
        assert self._file is not None
        self._file.take(t_s, kind, port, data + more, self._sequence)
        self._sequence += kind in OF_WIRES

    def line(self, t_s: float, level: str, event: str, keys: Mapping[str, Any]) -> None:
        """The log of a simulated run is nobody's."""

    def flush(self, now_s: float) -> None:
        assert self._file is not None
        if now_s - self._synced_s >= SYNC_S:
            self._synced_s = now_s
            self._file.sync()

    def metadata(self, name: str, entries: Mapping[str, str]) -> None:
        """What only the simulation knows, under a name of its own."""
        assert self._file is not None
        self._file.metadata(name, entries)

    def end(self, wait_s: float) -> None:
        assert self._file is not None
        self._file.finish({"cause": "the run ended", "dropped": json.dumps({})})
