"""Frames of the planner link as bytes: header, flags, CRC-32, authentication tag.

Refuses by giving a reason; nothing here raises on what has arrived.
Source: planner link, sections 2 and 9.
"""

import hashlib
import hmac
import math
import struct
import zlib
from collections import deque
from typing import NamedTuple

VERSION, MAX_FRAME = 1, 368
GEOM, POSE, MAP, DIGEST, STOP_ZONE, TILE, SCAN = 1, 2, 3, 4, 5, 6, 7  # types, to the receiver
OBJECTS, PATH = 13, 14  # likewise
ACK, HELLO, DRIVE, ASK, EXTERNAL_POSE = 8, 9, 10, 11, 12  # to the sender
MORE, REFRESH, AUTH, RESERVED_FLAGS = 1 << 0, 1 << 1, 1 << 4, 0xE0
TAG_SIZE, CRC_SIZE = 8, 4
HEAD = struct.Struct("<BBHI")  # kind, flags, seq, t_ms
CRC_START = 0x2994717F  # of b"MPL1": frames of other layouts never pass
SMALLEST = HEAD.size + CRC_SIZE
KEY_SIZE = 32
OUTBOX = 64  # frames kept for who polls too seldom; the oldest are dropped first


class Frame(NamedTuple):
    """A frame of the right version, flags, length and CRC; its tag is not checked yet."""

    type: int
    flags: int
    seq: int  # modulo 65 536
    t_ms: int  # sender's clock, modulo 2^32
    body: bytes
    signed: bytes  # what its tag covers, after session and nonce
    tag: bytes  # empty without AUTH

    @property
    def size(self) -> int:
        """Bytes of the whole frame, before COBS."""
        return len(self.signed) + len(self.tag) + CRC_SIZE


def int16(number: int) -> int:
    """The low 16 bits, as two's complement.

    >>> int16(0xFFFF), int16(3 - 65_535)
    (-1, 4)
    """
    return (number + 0x8000) % 0x10000 - 0x8000


def frame_from_bytes(data: bytes) -> Frame | str:
    """The frame in one datagram; or, in a word, why it is none."""
    if not SMALLEST <= len(data) <= MAX_FRAME:
        return "length"
    content = data[:-CRC_SIZE]
    if zlib.crc32(content, CRC_START) != int.from_bytes(data[-CRC_SIZE:], "little"):
        return "crc"
    kind, flags, seq, t_ms = HEAD.unpack_from(content)
    if kind >> 4 != VERSION:
        return "version"
    if flags & RESERVED_FLAGS:
        return "flags"
    if not flags & AUTH:
        return Frame(kind & 15, flags, seq, t_ms, content[HEAD.size :], content, b"")
    end = len(content) - TAG_SIZE
    if end < HEAD.size:
        return "length"
    return Frame(
        kind & 15, flags, seq, t_ms, content[HEAD.size : end], content[:end], content[end:]
    )


def bytes_from_frame(
    frame_type: int, seq: int, t_ms: int, body: bytes, flags: int = 0, tag: bytes = b""
) -> bytes:
    """A frame as one datagram; `seq` and `t_ms` may be of any size."""
    head = HEAD.pack(VERSION << 4 | frame_type, flags, seq % 0x10000, t_ms % 2**32)
    content = head + body + tag
    return content + zlib.crc32(content, CRC_START).to_bytes(CRC_SIZE, "little")


def signed_bytes_from_frame(
    frame_type: int, seq: int, t_ms: int, body: bytes, key: bytes, session: int, nonce: int
) -> bytes:
    """A frame with its tag, as one datagram."""
    head = HEAD.pack(VERSION << 4 | frame_type, AUTH, seq % 0x10000, t_ms % 2**32)
    tag = tag_of(head + body, key, session, nonce)
    return bytes_from_frame(frame_type, seq, t_ms, body, AUTH, tag)


def tag_of(signed: bytes, key: bytes, session: int, nonce: int) -> bytes:
    """The 8 bytes that authenticate a frame's bytes up to the tag; `key` has 32 bytes."""
    data = struct.pack("<II", session, nonce) + signed
    return hashlib.blake2s(data, key=key, digest_size=TAG_SIZE).digest()


def tag_is_right(frame: Frame, key: bytes, session: int, nonce: int) -> bool:
    """Compares in constant time."""
    return hmac.compare_digest(frame.tag, tag_of(frame.signed, key, session, nonce))


class Outbox:
    """Frames to be sent: numbered, signed where a key and a session are known, kept until taken."""

    def __init__(self, key: bytes | None) -> None:
        if key is not None and len(key) != KEY_SIZE:
            raise ValueError(f"a key has {KEY_SIZE} bytes, not {len(key)}")
        self.key, self._sent = key, 0
        self._frames: deque[bytes] = deque(maxlen=OUTBOX)

    def put(
        self, now_s: float, frame_type: int, body: bytes, session: int | None, nonce: int
    ) -> None:
        self._sent += 1
        told = frame_type, self._sent, math.floor(now_s * 1000 + 1e-6), body
        if self.key is None or session is None:
            self._frames.append(bytes_from_frame(*told))
        else:
            self._frames.append(signed_bytes_from_frame(*told, self.key, session, nonce))

    def take(self) -> list[bytes]:
        """All of them, oldest first."""
        frames = list(self._frames)
        self._frames.clear()
        return frames
