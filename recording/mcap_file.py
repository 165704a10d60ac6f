"""One recording on disk as it is written: an MCAP file that is whole up to the newest `sync`.

Source: mcap.dev, specification, version 0.
"""

import contextlib
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mcap.writer import Writer

from recording.records import (
    CALLS,
    END,
    METADATA,
    OF_CALLS,
    PROFILE,
    STAMP,
    WIRE_SCHEMA,
    nanoseconds,
    topic_of,
    with_check,
)

CHUNK_BYTES = 4 << 20  # a chunk that `sync` has not ended before
WIRE_TEXT = b"""f64 little-endian: seconds of the host's monotonic clock
char: kind, as docs/recording.md of mapod has it
bytes: data"""


class RecordingFile:
    """An MCAP file. All of it may raise OSError: then it is whole up to the newest `sync`."""

    def __init__(self, path: Path, metadata: Mapping[str, str], ports: list[str]) -> None:
        self.path = path
        self._offset_s = float(metadata["utc_offset_s"])
        self._file = path.open("wb")
        self._writer: Any = Writer(self._file, chunk_size=CHUNK_BYTES, enable_data_crcs=True)
        self._writer.start(PROFILE, f"mapod {metadata['version']}")
        self._writer.add_metadata(METADATA, with_check(metadata))
        self._schemas: dict[str, int] = {}  # by name
        self._channels: dict[str, int] = {}  # by topic, of JSON
        wire = self._writer.register_schema(WIRE_SCHEMA, "text", WIRE_TEXT)
        self._ports = [
            self._writer.register_channel(topic_of(k, name), "mapod", wire)
            for k, name in enumerate(ports)
        ]
        self._calls = self._writer.register_channel(CALLS, "mapod", wire)

    @property
    def size(self) -> int:
        """Bytes on disk by now."""
        return self._file.tell()

    def wire(
        self,
        t_s: float,
        kind: bytes,
        port: int,
        data: bytes,
        sequence: int,
        logged_s: float | None = None,
    ) -> None:
        """A record of a port, or of a call of the app.

        Args:
            logged_s: where it stands for who draws the file, if not at its own time.
        """
        channel = self._calls if kind in OF_CALLS else self._ports[port]
        t_ns = nanoseconds(t_s, self._offset_s)
        logged_ns = t_ns if logged_s is None else nanoseconds(logged_s, self._offset_s)
        message = STAMP.pack(t_s, kind) + data
        self._writer.add_message(channel, logged_ns, message, t_ns, sequence & 0xFFFFFFFF)

    def message(self, topic: str, schema: str, text: str, t_s: float, data: bytes) -> None:
        """A message in JSON.

        Args:
            text: the JSON schema of that name.
        """
        if topic not in self._channels:
            if schema not in self._schemas:
                self._schemas[schema] = self._writer.register_schema(
                    schema, "jsonschema", text.encode()
                )
            self._channels[topic] = self._writer.register_channel(
                topic, "json", self._schemas[schema]
            )
        t_ns = nanoseconds(t_s, self._offset_s)
        self._writer.add_message(self._channels[topic], t_ns, data, t_ns)

    def metadata(self, name: str, entries: Mapping[str, str]) -> None:
        """Something else about the run, under a name of its own."""
        self._writer.add_metadata(name, with_check(entries))

    def end_chunk(self) -> None:
        """What was written can be read once the system has it on the disk."""
        self._writer.flush()

    def sync(self) -> None:
        """What was written is on the disk afterwards, and can be read whatever comes."""
        self.end_chunk()
        os.fsync(self._file.fileno())

    def finish(self, end: Mapping[str, str]) -> None:
        """Say how it ended, write the index, and close."""
        self._writer.flush()
        self._writer.add_metadata(END, with_check(end))
        self._writer.finish()
        self._file.flush()
        os.fsync(self._file.fileno())
        self._file.close()

    def abandon(self) -> None:
        """Close it as it is, after an OSError."""
        with contextlib.suppress(OSError):
            self._file.close()
