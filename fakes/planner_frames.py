"""Frames of the planner link at the planner's end: COBS, CRC-32, bodies, cell operations.

Written from the sheet alone; shares nothing with the sender. Refuses by giving None or a reason.
Source: planner link, sections 2, 3 and 9.
"""

import hashlib
import hmac
import math
import struct
from dataclasses import dataclass

VERSION, MAX_FRAME = 1, 368
GEOM, POSE, MAP, DIGEST, ACK, HELLO, DRIVE = 1, 2, 3, 4, 8, 9, 10  # frame types
AUTH, RESERVED_FLAGS = 1 << 4, 0xE0
UNKNOWN, FREE, OBSTACLE, KEEP = 0, 1, 2, 3  # what an operation does to a cell
TAG_SIZE, CRC_SIZE = 8, 4
HEAD = struct.Struct("<BBHI")  # kind, flags, seq, t_ms
GEOM_BODY = struct.Struct("<BxHHHIHH")
POSE_BODY = struct.Struct("<iihhhhhHBBBB")
MAP_HEAD = struct.Struct("<hhHB3s")  # ox, oy, repaired, geom_id, start
DIGEST_BODY = struct.Struct("<BxxxI")
DRIVE_BODY = struct.Struct("<IIhhHH")  # session, nonce, v, w, valid_ms, reserved
LAYOUT = b"MPL1"  # hashed before every frame
MAX_ENCODED = MAX_FRAME + 4  # COBS adds at most three bytes; one more is already too long


def _table_entry(byte: int) -> int:
    for _ in range(8):
        byte = byte >> 1 ^ (0xEDB88320 if byte & 1 else 0)
    return byte


CRC_TABLE = [_table_entry(byte) for byte in range(256)]


def crc32(data: bytes) -> int:
    """The CRC of zip and Ethernet."""
    register = 0xFFFFFFFF
    for byte in data:
        register = register >> 8 ^ CRC_TABLE[(register ^ byte) & 0xFF]
    return register ^ 0xFFFFFFFF


def int16(number: int) -> int:
    """The low 16 bits, as two's complement."""
    return (number + 0x8000) % 0x10000 - 0x8000


def cobs_from_bytes(data: bytes) -> bytes:
    """COBS, without the delimiter."""
    encoded = bytearray()
    runs = data.split(b"\0")
    for last, run in ((i == len(runs) - 1, run) for i, run in enumerate(runs)):
        while len(run) > 254 or (len(run) == 254 and not last):
            encoded += b"\xff" + run[:254]
            run = run[254:]
        encoded += bytes([len(run) + 1]) + run
    return bytes(encoded)


def maybe_bytes_from_cobs(encoded: bytes) -> bytes | None:
    """What was encoded; None if the code bytes do not fit the length or a zero lies within."""
    decoded, at = bytearray(), 0
    while at < len(encoded):
        code = encoded[at]
        run = encoded[at + 1 : at + code]
        if code == 0 or len(run) != code - 1 or 0 in run:
            return None
        decoded += run
        at += code
        if code < 255 and at < len(encoded):
            decoded.append(0)
    return bytes(decoded)


def serial_from_frame(frame: bytes) -> bytes:
    """A frame as it goes over a serial line."""
    return cobs_from_bytes(frame) + b"\0"


class Deframer:
    """Cuts a serial stream into frames; keeps at most one frame of bytes."""

    def __init__(self) -> None:
        self._encoded = bytearray()

    def feed(self, data: bytes) -> list[bytes | None]:
        """The frames that these bytes complete; None stands for one that cannot be read."""
        frames: list[bytes | None] = []
        *ended, rest = data.split(b"\0")
        for piece in ended:
            self._keep(piece)
            if self._encoded:
                fits = len(self._encoded) < MAX_ENCODED
                frames.append(maybe_bytes_from_cobs(bytes(self._encoded)) if fits else None)
            self._encoded.clear()
        self._keep(rest)
        return frames

    def _keep(self, piece: bytes) -> None:
        self._encoded += piece[: MAX_ENCODED - len(self._encoded)]


@dataclass(frozen=True, slots=True)
class Frame:
    """A frame of the right version, flags, length and CRC."""

    type: int
    flags: int
    seq: int
    t_ms: int
    body: bytes
    signed: bytes  # what its tag covers, after session and nonce
    tag: bytes  # empty without AUTH


def frame_from_bytes(data: bytes) -> Frame | str:
    """The frame; or, in a word, why it is none."""
    if not HEAD.size + CRC_SIZE <= len(data) <= MAX_FRAME:
        return "length"
    content, crc = data[:-CRC_SIZE], data[-CRC_SIZE:]
    if crc32(LAYOUT + content) != int.from_bytes(crc, "little"):
        return "crc"
    kind, flags, seq, t_ms = HEAD.unpack_from(content)
    if kind >> 4 != VERSION:
        return "version"
    if flags & RESERVED_FLAGS:
        return "flags"
    tag_size = TAG_SIZE if flags & AUTH else 0
    if len(content) < HEAD.size + tag_size:
        return "length"
    end = len(content) - tag_size
    body = content[HEAD.size : end]
    return Frame(kind & 15, flags, seq, t_ms, body, content[:end], content[end:])


def bytes_from_frame(
    frame_type: int, seq: int, t_ms: int, body: bytes, flags: int = 0, tag: bytes = b""
) -> bytes:
    """A frame as one datagram."""
    head = HEAD.pack(VERSION << 4 | frame_type, flags, seq % 0x10000, t_ms % 2**32)
    content = head + body + tag
    return content + crc32(LAYOUT + content).to_bytes(CRC_SIZE, "little")


def tag_of(signed: bytes, key: bytes, session: int, nonce: int) -> bytes:
    """The tag of an authenticated frame, section 9."""
    data = struct.pack("<II", session, nonce) + signed
    return hashlib.blake2s(data, key=key, digest_size=TAG_SIZE).digest()


def tag_is_right(frame: Frame, key: bytes, session: int, nonce: int) -> bool:
    """Compares in constant time."""
    return hmac.compare_digest(frame.tag, tag_of(frame.signed, key, session, nonce))


@dataclass(frozen=True, slots=True)
class Geometry:
    """What the sender says of its window."""

    geom_id: int
    width: int  # cells along map x
    height: int  # cells along map y
    cell_m: float
    session: int
    tick_s: float
    stale_s: float


def maybe_geometry(body: bytes) -> Geometry | None:
    """None if the length or a size is wrong."""
    if len(body) != GEOM_BODY.size:
        return None
    geom_id, width, height, cell_mm, session, tick_ms, stale_ms = GEOM_BODY.unpack(body)
    if not (width and height and cell_mm):
        return None
    return Geometry(
        geom_id, width, height, cell_mm / 1000, session, tick_ms / 1000, stale_ms / 1000
    )


@dataclass(frozen=True, slots=True)
class Pose:
    """Where the robot is and how well it is, as told by one POSE frame."""

    t_ms: int  # sender's clock
    arrived_s: float  # receiver's clock
    x_m: float
    y_m: float
    yaw_rad: float  # counter-clockwise
    pitch_rad: float  # nose down positive
    roll_rad: float
    v_mps: float
    w_radps: float
    health: int  # bits of section 3
    age_scan_s: float  # inf: 1.02 s or more
    age_ahrs_s: float
    age_enc_s: float
    mode: int


def maybe_pose(body: bytes, t_ms: int, arrived_s: float) -> Pose | None:
    """None if the length is wrong."""
    if len(body) != POSE_BODY.size:
        return None
    x_mm, y_mm, yaw, pitch, roll, v, w, health, *ages, mode = POSE_BODY.unpack(body)
    scan_s, ahrs_s, enc_s = (math.inf if age == 255 else age * 0.004 for age in ages)
    return Pose(
        t_ms, arrived_s,
        x_mm / 1000, y_mm / 1000, yaw / 10_000, pitch / 10_000, roll / 10_000, v / 1000, w / 1000,
        health, scan_s, ahrs_s, enc_s, mode,
    )  # fmt: skip


def drive_body(session: int, nonce: int, v_mps: float, w_radps: float, valid_s: float) -> bytes:
    """Body of a DRIVE frame.

    Raises:
        ValueError: a speed or a time that the frame cannot tell.
    """
    v_mmps, w_mradps, valid_ms = round(v_mps * 1000), round(w_radps * 1000), round(valid_s * 1000)
    if max(abs(v_mmps), abs(w_mradps)) > 32_767 or not 0 <= valid_ms <= 1000:
        raise ValueError(f"no DRIVE frame tells {v_mps} m/s, {w_radps} rad/s for {valid_s} s")
    return DRIVE_BODY.pack(session, nonce, v_mmps, w_mradps, valid_ms, 0)


def maybe_runs(ops: bytes, start: int, cells: int) -> list[tuple[int, int, int]] | None:
    """(state, first cell, cell after the last) of each operation; None if they do not fit."""
    runs, at, cursor = [], 0, start
    while at < len(ops):
        state, code = ops[at] >> 6, ops[at] & 63
        at, length = at + 1, code + 1
        if code == 63:
            number, size = 0, 0
            while size == 0 or ops[at - 1] & 0x80:
                if at == len(ops) or size == 3:
                    return None
                number |= (ops[at] & 0x7F) << 7 * size
                at, size = at + 1, size + 1
            length = 64 + number
        if cursor + length > cells:
            return None
        runs.append((state, cursor, cursor + length))
        cursor += length
    return runs
