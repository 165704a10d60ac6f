"""The records of an MCAP file one after the other. It may be cut off or damaged anywhere.

Every byte that decides something is checked: chunks by their own sums, a whole file by the sum of
its data. What is not to be believed is a RecordingError, never less or more than was written.
Source: mcap.dev, specification, version 0.
"""

import struct
import zlib
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

import zstandard

from recording.records import RecordingError

MAGIC = b"\x89MCAP0\r\n"
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, METADATA, DATA_END = 1, 2, 3, 4, 5, 6, 12, 15
OPCODES = range(1, 16)
RECORD = struct.Struct("<BQ")  # opcode, length
MESSAGE_HEAD = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
NUMBERS = struct.Struct("<HI")  # the first two of these
CHUNK_HEAD = struct.Struct("<QQQI")  # times of the first and the last, size, sum
MOST_BYTES = 256 << 20  # of a chunk, or of what stands by itself
MOST_NAME = 1000  # letters of a channel's names: all channels are kept


@dataclass(slots=True)
class McapStream:
    """One file, read from its begin."""

    path: Path
    is_cut: bool = False  # known after reading: it ends before its end was written
    channels: dict[int, tuple[str, str]] = field(default_factory=dict)  # topic, message encoding
    _sum: int = 0
    _place: int = 0  # behind what was read

    def records(self) -> Iterator[tuple[int, bytes]]:
        """Opcode and content of each, but for chunks: what is in them instead.

        Raises:
            RecordingError: it is no MCAP file, or damaged. OSError.
        """
        for block in self._blocks():
            for opcode, begin, end in self._places(block):
                yield opcode, block[begin:end]

    def messages(self, topics: Collection[str]) -> Iterator[tuple[str, int, bytes]]:
        """Topic, number and content of each message of these topics. Raises as `records`."""
        channels = self.channels
        for block in self._blocks():
            for opcode, begin, end in self._places(block):
                if opcode != MESSAGE or end - begin < MESSAGE_HEAD.size:
                    continue
                channel, number = NUMBERS.unpack_from(block, begin)
                if channel not in channels:
                    raise RecordingError(f"{self.path} is damaged: a message of no channel")
                topic, _ = channels[channel]
                if topic in topics:
                    yield topic, number, block[begin + MESSAGE_HEAD.size : end]

    def _blocks(self) -> Iterator[bytes]:
        """What chunks hold, and each record outside of them, head and content."""
        with self.path.open("rb") as file:
            size = file.seek(0, 2)
            file.seek(max(0, size - len(MAGIC)))
            is_ended = file.read() == MAGIC and size > len(MAGIC)
            file.seek(0)
            magic = file.read(len(MAGIC))
            if magic != MAGIC[: len(magic)] or not magic:
                raise RecordingError(f"{self.path} is not an MCAP file")
            self._sum, self.is_cut = zlib.crc32(magic), True
            try:
                yield from self._blocks_of(file, size, is_ended)
            except (struct.error, UnicodeDecodeError, IndexError, zstandard.ZstdError):
                raise self._damaged(file.tell()) from None

    def _blocks_of(self, file: BinaryIO, size: int, is_ended: bool) -> Iterator[bytes]:
        while len(head := file.read(RECORD.size)) == RECORD.size:
            opcode, length = RECORD.unpack(head)
            if opcode not in OPCODES:
                raise self._damaged(file.tell())
            if file.tell() + length > size:
                if is_ended:
                    raise self._damaged(file.tell())
                return
            if length > MOST_BYTES:
                raise self._damaged(file.tell())
            content = file.read(length)
            if opcode == DATA_END:
                (stored,) = struct.unpack("<I", content)
                if stored != self._sum:
                    raise self._damaged(file.tell())
                self.is_cut = False
                return
            self._sum = zlib.crc32(content, zlib.crc32(head, self._sum))
            self._place = file.tell()
            yield self._opened(content, self._place) if opcode == CHUNK else head + content
        if is_ended:
            raise self._damaged(file.tell())

    def _opened(self, content: bytes, place: int) -> bytes:
        """What a chunk holds."""
        _, _, size, stored = CHUNK_HEAD.unpack_from(content)
        compression, at = text_at(content, CHUNK_HEAD.size)
        (length,) = struct.unpack_from("<Q", content, at)
        packed = content[at + 8 :]
        if length != len(packed) or size > MOST_BYTES:
            raise self._damaged(place)
        if compression == "zstd":
            if zstandard.frame_content_size(packed) not in (size, -1):
                raise self._damaged(place)
            packed = zstandard.ZstdDecompressor().decompress(packed, max_output_size=size)
        elif compression:
            raise RecordingError(f"{self.path}: compressed with {compression!r}, not with zstd")
        if stored and zlib.crc32(packed) != stored:
            raise self._damaged(place)
        return packed

    def _places(self, block: bytes) -> Iterator[tuple[int, int, int]]:
        """Opcode of each record in a block, where its content begins, and where it ends.

        One at a time: a block may hold thirty million that are empty, in a file of a few kilobytes.
        """
        at, size = 0, len(block)
        try:
            while at < size:
                opcode, length = RECORD.unpack_from(block, at)
                begin, at = at + RECORD.size, at + RECORD.size + length
                if at > size:
                    raise self._damaged(self._place)
                if opcode == CHANNEL:
                    self._learn(block[begin:at])
                yield opcode, begin, at
        except (struct.error, UnicodeDecodeError):
            raise self._damaged(self._place) from None

    def _learn(self, channel: bytes) -> None:
        number, _ = struct.unpack_from("<HH", channel)
        topic, at = text_at(channel, 4)
        encoding, _ = text_at(channel, at)
        if len(topic) + len(encoding) > MOST_NAME:
            raise self._damaged(self._place)
        self.channels[number] = (topic, encoding)

    def _damaged(self, place: int) -> RecordingError:
        return RecordingError(f"{self.path} is damaged before byte {place}")


def text_at(content: bytes, at: int) -> tuple[str, int]:
    """The text that begins there, and where it ends. Raises struct.error, UnicodeDecodeError."""
    (length,) = struct.unpack_from("<I", content, at)
    at += 4
    if at + length > len(content):
        raise struct.error
    return content[at : at + length].decode(), at + length


def metadata_of(content: bytes) -> tuple[str, dict[str, str]]:
    """Name and entries of a metadata record. Raises struct.error, UnicodeDecodeError."""
    name, at = text_at(content, 0)
    (length,) = struct.unpack_from("<I", content, at)
    at, end, entries = at + 4, at + 4 + length, {}
    if end > len(content):
        raise struct.error
    while at < end:
        key, at = text_at(content, at)
        entries[key], at = text_at(content, at)
    return name, entries
