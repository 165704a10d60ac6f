"""Frames as a sender writes them, and the answers of a receiver, written from the sheet once more.

Shares nothing with the sender in `hw` nor with the public receiver: what is wrong there must not be
wrong here too.
Source: planner link, sections 2, 3 and 9.
"""

import hashlib
import struct
import zlib
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

U8 = npt.NDArray[np.uint8]

GEOM, POSE, MAP, DIGEST, STOP_ZONE, TILE, SCAN, ACK, HELLO = 1, 2, 3, 4, 5, 6, 7, 8, 9
UNKNOWN, FREE, OBSTACLE, KEEP = 0, 1, 2, 3
MORE, REFRESH, AUTH = 0x01, 0x02, 0x10
NEED_GEOM, NEED_FULL, STALE, SUSPECT = 0x01, 0x02, 0x04, 0x08
DIGEST_OK, AUTH_FAILED = 0x20, 0x40
SEED, MAX_FRAME, SHORTEST = b"MPL1", 368, 12


def int16(number: int) -> int:
    """The low 16 bits as a signed number."""
    low = number & 0xFFFF
    return low - 0x10000 if low & 0x8000 else low


def sealed(content: bytes) -> bytes:
    """A frame's bytes with the CRC that makes them one."""
    return content + struct.pack("<I", zlib.crc32(SEED + content))


@dataclass(frozen=True, slots=True)
class Key:
    """What section 9 makes tags with."""

    key: bytes  # 32
    session: int
    nonce: int

    def tag(self, content: bytes) -> bytes:
        """8 bytes over the frame up to the tag."""
        data = struct.pack("<II", self.session, self.nonce) + content
        return hashlib.blake2s(data, key=self.key, digest_size=8).digest()


def frame(
    kind: int, seq: int, t_ms: int, body: bytes, flags: int = 0, key: Key | None = None
) -> bytes:
    """One frame, as in a datagram; with a key also tagged."""
    flags |= AUTH if key else 0
    content = struct.pack("<BBHI", 0x10 | kind, flags, seq & 0xFFFF, t_ms & 0xFFFFFFFF) + body
    return sealed(content + key.tag(content) if key else content)


@dataclass(frozen=True, slots=True)
class Geom:
    """What a GEOM frame tells."""

    geom_id: int
    width: int
    height: int
    session: int
    stale_ms: int = 150
    tick_ms: int = 20
    cell_mm: int = 50

    def body(self) -> bytes:
        """16 bytes."""
        sizes = struct.pack("<BBHHH", self.geom_id, 0, self.width, self.height, self.cell_mm)
        return sizes + struct.pack("<IHH", self.session, self.tick_ms, self.stale_ms)


def pose_body(x_mm: int = 0) -> bytes:
    """24 bytes: a robot that stands there, in health."""
    return struct.pack("<iihhhhhHBBBB", x_mm, 0, 0, 0, 0, 0, 0, 0x7F, 2, 1, 3, 1)


def map_body(origin: tuple[int, int], repaired: int, geom_id: int, start: int, ops: bytes) -> bytes:
    """10 bytes and operations."""
    ox, oy = int16(origin[0]), int16(origin[1])
    head = struct.pack("<hhHB", ox, oy, repaired & 0xFFFF, geom_id)
    return head + struct.pack("<I", start)[:3] + ops


def digest_body(geom_id: int, cells: U8) -> bytes:
    """8 bytes: what a receiver must hold, (height, width), by its packed CRC."""
    return struct.pack("<BxxxI", geom_id, zlib.crc32(packed(cells)))


def packed(cells: U8) -> bytes:
    """Four cells a byte, row by row, the first in the lowest bits, zeros at the end."""
    flat = np.zeros(-(-cells.size // 4) * 4, np.uint8)
    flat[: cells.size] = cells.ravel()
    quads = flat.reshape(-1, 4)
    return (quads[:, 0] | quads[:, 1] << 2 | quads[:, 2] << 4 | quads[:, 3] << 6).tobytes()


def op(state: int, run: int, leb_bytes: int = 0) -> bytes:
    """One operation; `leb_bytes` asks for a longer LEB128 number than is needed.

    Raises:
        ValueError: a run that takes more than three LEB128 bytes.
    """
    if run <= 63 and not leb_bytes:
        return bytes([state << 6 | run - 1])
    digits: list[int] = []
    rest = run - 64
    while rest >= 0x80 or len(digits) + 1 < leb_bytes:
        digits.append(0x80 | rest & 0x7F)
        rest >>= 7
    digits.append(rest)
    if run < 64 or len(digits) > 3:
        raise ValueError(f"no operation of {leb_bytes} LEB128 bytes has a run of {run}")
    return bytes([state << 6 | 63, *digits])


def ops_of(runs: list[tuple[int, int]]) -> bytes:
    """Operations of (state, run) pairs."""
    return b"".join(op(state, run) for state, run in runs)


def cobs(data: bytes, short_end: bool = False) -> bytes:
    """COBS without delimiter; `short_end` leaves out the 0x01 after a last run of exactly 254."""
    out, parts = bytearray(), data.split(b"\0")
    for part in parts:
        while len(part) >= 254:
            out += b"\xff" + part[:254]
            part = part[254:]
        out += bytes([len(part) + 1]) + part
    if short_end and parts[-1] and len(parts[-1]) % 254 == 0:
        del out[-1]
    return bytes(out)


def maybe_uncobs(encoded: bytes) -> bytes | None:
    """What was encoded; None where the code bytes do not fit."""
    out, at = bytearray(), 0
    while at < len(encoded):
        code = encoded[at]
        if code == 0 or at + code > len(encoded):
            return None
        out += encoded[at + 1 : at + code]
        at += code
        if code != 0xFF and at < len(encoded):
            out.append(0)
    return bytes(out)


class Splitter:
    """Cuts a serial stream at its zeros; keeps no more than one frame."""

    def __init__(self) -> None:
        self._held = bytearray()

    def feed(self, data: bytes) -> list[bytes | None]:
        """The frames that end here; None for one that is no COBS, or too long."""
        frames: list[bytes | None] = []
        for byte in data:
            if byte:
                if len(self._held) <= MAX_FRAME + 4:
                    self._held.append(byte)
                continue
            if self._held:
                fits = len(self._held) <= MAX_FRAME + 3
                frames.append(maybe_uncobs(bytes(self._held)) if fits else None)
            self._held.clear()
        return frames


@dataclass(frozen=True, slots=True)
class Ack:
    """What a receiver says of itself."""

    last_seq: int
    mask: int
    echo_t_ms: int
    hold_s: float
    bad_frames: int
    status: int
    geom_id: int


@dataclass(frozen=True, slots=True)
class Hello:
    """What a receiver says at its start."""

    nonce: int
    max_cells: int
    max_frame: int
    capabilities: int


def answer_from_frame(data: bytes, key: Key | None = None) -> Ack | Hello | str:
    """An ACK or a HELLO, or in words why it is neither; other good frames are "another type"."""
    if len(data) < SHORTEST or sealed(data[:-4]) != data:
        return "no valid CRC"
    kind, flags = data[0], data[1]
    if kind >> 4 != 1 or flags & 0xE0:
        return "unknown version or flags"
    end = len(data) - 4 - (8 if flags & AUTH else 0)
    body = data[8:end]
    if kind & 15 == HELLO:
        return Hello(*struct.unpack("<IIHH", body)) if len(body) == 12 else "HELLO: bad length"
    if kind & 15 != ACK:
        return "another type"
    if key and not (flags & AUTH and key.tag(data[:end]) == data[end:-4]):
        return "ACK without a valid tag"
    if len(body) != 16:
        return "ACK: bad length"
    last, mask, echo, hold, bad, status, geom_id = struct.unpack("<HIIHHBB", body)
    return Ack(last, mask, echo, hold * 1e-4, bad, status, geom_id)
