"""The flight recorder: a run's last seconds in memory, and on disk when something went wrong."""

import re
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import zstandard

from recording.openings import Openings
from recording.records import HEAD, OF_WIRES

KEPT_S = 30.0
BLOCK_S = 1.0
LEVEL = 1  # of the compression: fast


@dataclass(frozen=True, slots=True)
class Block:
    """The records of a second."""

    begun_s: float
    sequence: int  # of its first record that moves the app
    packed: bytes


class FlightRecorder:
    """Keeps the newest records, packed; `save` may raise OSError.

    Args:
        openings: of the same run, for files that begin in the middle of it.
    """

    def __init__(self, run: Mapping[str, Any], openings: Openings, kept_s: float) -> None:
        self._run, self._folder, self._keep = run, Path(run["flight"]), int(run["flight_keep"])
        self._openings, self._kept_s = openings, kept_s
        self._blocks: deque[Block] = deque()
        self._new, self._begun_s, self._sequence = bytearray(), 0.0, 0
        self._folder.mkdir(parents=True, exist_ok=True)
        probe = self._folder / ".writable"
        probe.touch()
        probe.unlink()

    def take(self, t_s: float, kind: bytes, port: int, data: bytes, sequence: int) -> None:
        if not self._new:
            self._begun_s, self._sequence = t_s, sequence
        self._new += HEAD.pack(t_s, kind, port, len(data)) + data
        if t_s - self._begun_s >= BLOCK_S:
            packed = zstandard.ZstdCompressor(LEVEL).compress(bytes(self._new))
            self._blocks.append(Block(self._begun_s, self._sequence, packed))
            self._new.clear()
            while t_s - self._blocks[0].begun_s > self._kept_s + BLOCK_S:
                self._blocks.popleft()

    def save(self, cause: str, message: str, end: Mapping[str, str]) -> Path:
        """Into a file of its own; the oldest of those that are too many go."""
        from recording.run_file import RunFile  # what is needed for a file alone

        now = datetime.now(UTC).strftime("%Y%m%dT%H%M%SZ")
        path = self._folder / f"{now}-{slug(cause)}.mcap"
        begun_s, sequence = self._begun_s, self._sequence
        if self._blocks:
            begun_s, sequence = self._blocks[0].begun_s, self._blocks[0].sequence
        more = {"part": "1", "continues": "", "flight": cause, "message": message}
        file = RunFile(path, self._run, more, self._openings, sequence, begun_s)
        try:
            for block in self._unpacked():
                for t_s, kind, port, data in records_in(block):
                    file.take(t_s, kind, port, data, sequence)
                    sequence += kind in OF_WIRES
                file.end_chunk()
            file.finish(end)
        except OSError:
            file.abandon()
            raise
        kept = sorted(self._folder.glob("*Z-*.mcap"), key=age_of)
        for old in kept[: -self._keep]:
            old.unlink()
        return path

    def _unpacked(self) -> Iterator[bytes]:
        """The blocks' records."""
        unpack = zstandard.ZstdDecompressor()
        for block in self._blocks:
            yield unpack.decompress(block.packed)
        yield bytes(self._new)


def records_in(data: bytes) -> Iterator[tuple[float, bytes, int, bytes]]:
    """Those that lie there whole, one after the other."""
    at = 0
    while at < len(data):
        t_s, kind, port, length = HEAD.unpack_from(data, at)
        at += HEAD.size + length
        yield t_s, kind, port, data[at - length : at]


def age_of(path: Path) -> tuple[float, str]:
    return path.stat().st_mtime, path.name


def slug(cause: str) -> str:
    return re.sub(r"[^a-z0-9]+", "-", cause.lower()).strip("-") or "kept"
