"""How long a recording is, found without reading all of it."""

import struct
from pathlib import Path
from typing import BinaryIO

from recording.mcap_stream import CHUNK, CHUNK_HEAD, MAGIC, RECORD
from recording.reader import Recording
from recording.records import RecordingError
from tools.replay.instants import Timeline


def end_of(recording: Recording) -> float | None:
    """Host clock of the newest whole chunk's last message; None: there is none."""
    newest_ns = 0
    for path in recording.parts:
        newest_ns = max(newest_ns, newest_in(path))
    return newest_ns / 1e9 - recording.utc_offset_s if newest_ns else None


def timeline_of(recording: Recording, begin_s: float) -> Timeline:
    """From its first call, which a player knows, to its end.

    Raises:
        RecordingError: it has neither.
    """
    end_s = end_of(recording)
    if end_s is None and not begin_s:
        raise RecordingError(f"{recording.parts[0]} was cut off before its first second ended")
    return Timeline(begin_s, max(begin_s, end_s or begin_s), recording.utc_offset_s)


def newest_in(path: Path) -> int:
    """Nanoseconds since 1970; 0: it holds nothing that is whole."""
    newest_ns = 0
    with path.open("rb") as file:
        size = file.seek(0, 2)
        file.seek(len(MAGIC))
        while (found := _maybe_record(file)) is not None:
            opcode, end = found
            if end > size:
                break
            if opcode == CHUNK and len(head := file.read(CHUNK_HEAD.size)) == CHUNK_HEAD.size:
                newest_ns = max(newest_ns, CHUNK_HEAD.unpack(head)[1])
            file.seek(end)
    return newest_ns


def _maybe_record(file: BinaryIO) -> tuple[int, int] | None:
    """Opcode of the next record and where it ends."""
    try:
        opcode, length = RECORD.unpack(file.read(RECORD.size))
    except struct.error:
        return None
    return opcode, file.tell() + length
