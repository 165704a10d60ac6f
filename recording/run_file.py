"""A file of a run as the writer fills it: records as they come from the app, states as messages."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from recording.foxglove import Messages, RobotShape, encoded
from recording.mcap_file import RecordingFile
from recording.openings import Openings
from recording.packing import Heights, scan_from, state_from
from recording.records import HEIGHTS, LINE, OF_WIRES, SCAN, STATE
from recording.schemas import SCHEMAS


class RunFile:
    """One file. All of it may raise OSError: then it is whole up to the newest `sync`."""

    def __init__(
        self,
        path: Path,
        run: Mapping[str, Any],
        more: Mapping[str, str],
        openings: Openings,
        sequence: int = 0,
        begun_s: float = 0.0,
    ) -> None:
        """What stands at its head.

        Args:
            run: what the app said first; `more`: of this very file.
            openings: of the run so far, for a file that begins in the middle of it.
            sequence: number of its first record; `begun_s`: about when that is.
        """
        opening = openings.before(sequence)
        about = {"from_start": "false" if sequence else "true", "opening": str(len(opening))}
        metadata = {**run["metadata"], **more, **about}
        self.path = path
        self._file = RecordingFile(path, metadata, json.loads(metadata["ports"]))
        self._messages = Messages(RobotShape(**run["shape"]), float(metadata["utc_offset_s"]))
        self._heights = Heights()
        for number, record in enumerate(opening, sequence - len(opening)):
            of = record.t_s, record.kind, record.port, record.data
            self._file.wire(*of, number, logged_s=begun_s)

    @property
    def size(self) -> int:
        return self._file.size

    def take(self, t_s: float, kind: bytes, port: int, data: bytes, sequence: int) -> None:
        """A record from the app. `sequence`: its number, where it moves the app."""
        if kind in OF_WIRES:
            self._file.wire(t_s, kind, port, data, sequence)
        elif kind == STATE:
            for told in self._messages.of_state(state_from(t_s, data)):
                self._tell(t_s, *told)
        elif kind == HEIGHTS:
            if (heights := self._heights.take(data)) is not None:
                self._tell(t_s, *self._messages.of_heights(t_s, *heights))
        elif kind == SCAN:
            for told in self._messages.of_scan(scan_from(data)):
                self._tell(t_s, *told)
        elif kind == LINE:
            said = json.loads(data)
            words = " ".join(f"{name}={value}" for name, value in sorted(said["keys"].items()))
            text = f"{said['event']} {words}".rstrip()
            topic, schema, message = self._messages.of_log(t_s, said["level"], text)
            self._tell(t_s, topic, schema, {**message, "of": {**said, "t_s": t_s}})

    def metadata(self, name: str, entries: Mapping[str, str]) -> None:
        self._file.metadata(name, entries)

    def end_chunk(self) -> None:
        self._file.end_chunk()

    def sync(self) -> None:
        self._file.sync()

    def finish(self, end: Mapping[str, str]) -> None:
        self._file.finish(end)

    def abandon(self) -> None:
        self._file.abandon()

    def _tell(self, t_s: float, topic: str, schema: str, message: dict[str, Any]) -> None:
        self._file.message(topic, schema, SCHEMAS[schema], t_s, encoded(message))
