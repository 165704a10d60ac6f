"""Recordings as a target: an MCAP file with what is in it, whole, cut and damaged.

An input is a program of records; those of a wire, of the log and of health get a right head, number
and sum, alone or in a chunk, and the file a right beginning. Or it is bytes as they are. The file
is read as far as it can be, and no reason for its end but RecordingError is let pass.
"""

import os
import struct
import tempfile
import zlib
from functools import cache
from pathlib import Path

import zstandard

from recording.mcap_stream import (
    CHANNEL,
    CHUNK,
    CHUNK_HEAD,
    DATA_END,
    FOOTER,
    HEADER,
    MAGIC,
    MESSAGE,
    MESSAGE_HEAD,
    METADATA,
    RECORD,
)
from recording.reader import Recording
from recording.records import (
    ASK,
    ASKED,
    CALLS,
    CHANGED,
    FORM,
    HEALTH,
    IN,
    LOGS,
    OPENED,
    OUT,
    PORT_STATE,
    READABLE,
    STAMP,
    STEP,
    TURN,
    RecordingError,
    with_check,
)
from recording.records import METADATA as OF_THE_RUN
from tools.fuzz.program import instruction, instructions_of, refused

RAW, MESSAGES, CHUNKED, TOLD = range(4)  # by the low 2 bits of an instruction's first byte
TOPIC_SHIFT = 2  # three bits of MESSAGES and CHUNKED: a topic
MISNUMBERED = 32  # this bit beside them
BARE, ENDED = 64, 128  # of the first instruction: no right beginning; a right end
TOPICS = ("/wire/0/scanner", "/wire/1/ahrs", CALLS, LOGS, HEALTH, "/wire/0/scanner", "/other", "")
MOST_STEPS, MOST_READ = 200, 5000
RUN = {
    "form": FORM,
    "version": "0.1.0",
    "config": "",
    "ports": '["scanner","ahrs"]',
    "wires": '[{"datagrams":false,"silence_s":null},{"datagrams":false,"silence_s":1.0}]',
    "session": "7",
    "utc_offset_s": "1.7e9",
    "from_start": "true",
    "recording": "1",
}


def text(words: str) -> bytes:
    encoded = words.encode("utf-8", "surrogateescape")
    return struct.pack("<I", len(encoded)) + encoded


def record(opcode: int, content: bytes) -> bytes:
    return RECORD.pack(opcode, len(content)) + content


def metadata(entries: dict[str, str]) -> bytes:
    told = b"".join(text(key) + text(value) for key, value in entries.items())
    content = text(OF_THE_RUN) + struct.pack("<I", len(told)) + told
    return record(METADATA, content)


def message(topic: int, number: int, content: bytes) -> bytes:
    return record(MESSAGE, MESSAGE_HEAD.pack(topic, number % 2**32, 0, 0) + content)


def chunk(content: bytes) -> bytes:
    packed = zstandard.compress(content)
    head = CHUNK_HEAD.pack(0, 0, len(content), zlib.crc32(content))
    return record(CHUNK, head + text("zstd") + struct.pack("<Q", len(packed)) + packed)


def file_of(program: bytes) -> bytes:
    """The file that a program writes."""
    entries, parts, number, first = dict(RUN), list[bytes](), 0, None
    for kind, data in instructions_of(program, MOST_STEPS):
        first = kind if first is None else first
        if kind & 3 == RAW:
            parts.append(data)
        elif kind & 3 == TOLD:
            key, _, value = data.decode("utf-8", "replace").partition("=")
            entries[key] = value
        else:
            topic = kind >> TOPIC_SHIFT & 7
            number += 7 * bool(kind & MISNUMBERED)
            told = message(topic, number, data)
            number += TOPICS[topic] in (TOPICS[0], TOPICS[1], CALLS)
            parts.append(chunk(told) if kind & 3 == CHUNKED else told)
    if first is not None and first & BARE:
        return b"".join(parts)
    channels = [
        record(CHANNEL, struct.pack("<HH", k, 0) + text(topic) + text("json") + bytes(4))
        for k, topic in enumerate(TOPICS)
    ]
    begin = record(HEADER, text("mapod") + text("")) + metadata(with_check(entries))
    data = MAGIC + begin + b"".join(channels + parts)
    if first is not None and first & ENDED:
        data += record(DATA_END, struct.pack("<I", zlib.crc32(data)))
        data += record(FOOTER, bytes(20)) + MAGIC
    return data


@cache
def place() -> Path:
    """A file in memory for this process."""
    memory = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None
    return Path(tempfile.mkdtemp(prefix="mapod-fuzz-", dir=memory)) / "fuzz.mcap"


def run(program: bytes) -> int:
    """How many records were read."""
    path, count = place(), 0
    path.write_bytes(file_of(program))
    try:
        recording = Recording(path)
        for count, one in enumerate(recording.records(), start=1):
            assert abs(one.t_s) < 1e12
            if count >= MOST_READ:
                break
        for line in recording.logs():
            assert line.event.isprintable()
        for where in recording.places():
            assert isinstance(where.x_m, float)
        _ = recording.loaded_map
        assert recording.version.isprintable()
    except RecordingError as error:
        refused(error)
    return count


def write_seeds(folder: Path) -> None:
    """A run in which ports open, bytes come and go, and the app tells; alone and in chunks."""
    stamp = STAMP.pack
    told = [
        (0, stamp(1.0, OPENED)),
        (0, stamp(1.0, CHANGED) + PORT_STATE.pack(1, 1, 1, 0) + b"open"),
        (1, stamp(1.01, IN) + b"\xfa\xff\x32\x00"),
        (2, stamp(1.02, STEP)),
        (0, stamp(1.03, OUT) + b"sRN"),
        (2, stamp(1.04, TURN) + READABLE.pack(3)),
        (2, stamp(1.05, ASK) + ASKED.pack(0.5, 0.1, 0.3) + b"modbus"),
        (3, b'{"t_s":1.0,"level":"info","event":"device_changed","keys":{"state":"running"}}'),
        (4, b'{"t_s":1.0,"x_m":1.5,"y_m":0.5,"yaw_rad":0.1}'),
        (6, b"{}"),
    ]
    for name, way in (("messages", MESSAGES), ("chunks", CHUNKED)):
        pieces = [instruction(way, content, topic) for topic, content in told]
        ended = bytes([pieces[0][0] | ENDED]) + pieces[0][1:]
        (folder / name).write_bytes(b"".join(pieces))
        (folder / f"{name}-ended").write_bytes(ended + b"".join(pieces[1:]))
        for number, piece in enumerate(pieces):
            (folder / f"{name}-{number}").write_bytes(piece)
    for number, entry in enumerate(("opening=2", "load_map=AAAA", "ports=[1]", "session=-1")):
        (folder / f"told-{number}").write_bytes(instruction(TOLD, entry.encode()) + pieces[0])
    small = file_of(b"".join(pieces))
    (folder / "raw").write_bytes(bytes([RAW | BARE]) + instruction(RAW, small)[1:])
