"""Frames of the planner link, version 1: encode what goes to the planner, decode what it answers.

No I/O, no clock. What is no valid frame gives `BadFrame`; nothing raises on input.
Source: planner link, sections 2, 3 and 9 (docs/planner-link.md).
"""

import hashlib
import hmac
import math
import struct
import zlib
from dataclasses import dataclass

from cobs import cobs

from core.records import PoseReport
from hw.session import BadFrame

VERSION = 1
GEOM, POSE, MAP, ACK, HELLO, DRIVE, EXTERNAL_POSE = 1, 2, 3, 8, 9, 10, 12
MORE, REFRESH, AUTH = 1 << 0, 1 << 1, 1 << 4
KNOWN_FLAGS = 0x1F  # an unknown bit of 5..7 drops the frame
NEED_GEOM, NEED_FULL, PLANNER_STOPPED = 1 << 0, 1 << 1, 1 << 4
CRC_START = 0x2994717F  # CRC-32 of b"MPL1": frames of other layouts never pass
MAX_FRAME = 368
HEAD, CRC, TAG_BYTES = struct.Struct("<BBHI"), struct.Struct("<I"), 8
GEOM_BODY, POSE_BODY = struct.Struct("<BxHHHIHH"), struct.Struct("<iihhhhhHBBBB")
MAP_HEAD = struct.Struct("<hhHB3s")
ACK_BODY, HELLO_BODY = struct.Struct("<HIIHHBB"), struct.Struct("<IIHH")
DRIVE_BODY = struct.Struct("<IIhhHH")
LONGEST_VALID_MS, NO_SPEED = 1000, -(2**15)
EXTERNAL_BODY = struct.Struct("<IIiihHHhHH")
NO_YAW, NO_PLACE, MOST_YAW = -(2**15), -(2**31), 31416  # 0.0001 rad
MOST_CORRELATION, OLDEST_MS = 10_000, 1000
AGE_UNIT_S = 0.004


@dataclass(frozen=True, slots=True)
class Ack:
    """What a planner says of the frames that it got."""

    last_seq: int
    mask: int  # bit i: frame last_seq - 1 - i was accepted
    echo_t_ms: int
    hold_s: float
    bad_frames: int
    status: int
    geom_id: int


@dataclass(frozen=True, slots=True)
class Hello:
    """A planner that has just started."""

    nonce: int
    max_cells: int
    max_frame: int


@dataclass(frozen=True, slots=True)
class Drive:
    """What a commander wants the robot to do; every field lies within its range."""

    seq: int
    t_ms: int  # the commander's clock
    session: int  # of the run that it has heard
    nonce: int  # of its HELLO
    v_mps: float  # forward
    w_radps: float  # counter-clockwise
    valid_s: float  # 0: stop now


@dataclass(frozen=True, slots=True)
class External:
    """Where a positioning system saw the robot; every field lies within its range."""

    seq: int
    t_ms: int  # the sender's clock
    session: int  # of the run that it has heard
    nonce: int  # of its HELLO
    x_m: float  # in the positioning system's frame
    y_m: float
    yaw_rad: float  # NaN: it does not tell
    sigma_x_m: float  # standard deviations
    sigma_y_m: float
    correlation: float  # of x and y, -1..1
    sigma_yaw_rad: float
    age_s: float  # how long before `t_ms` the robot was there


@dataclass(frozen=True, slots=True)
class Secret:
    """What the authentication tag is made with besides the frame."""

    key: bytes  # 32
    session: int
    nonce: int

    def tag(self, frame: bytes) -> bytes:
        """The tag of a frame's bytes up to the tag."""
        data = struct.pack("<II", self.session, self.nonce) + frame
        return hashlib.blake2s(data, key=self.key, digest_size=TAG_BYTES).digest()


def encode_frame(
    kind: int, flags: int, seq: int, t_ms: int, body: bytes, secret: Secret | None = None
) -> bytes:
    """One whole frame, not yet COBS-encoded."""
    flags |= AUTH if secret else 0
    frame = HEAD.pack(VERSION << 4 | kind, flags, seq % 2**16, t_ms % 2**32) + body
    if secret:
        frame += secret.tag(frame)
    return frame + CRC.pack(zlib.crc32(frame, CRC_START))


def encode_serial(frame: bytes) -> bytes:
    """A frame as it goes over a serial line."""
    encoded: bytes = cobs.encode(frame)  # type: ignore[no-untyped-call]
    return encoded + b"\0"


def serial_bytes(frame_bytes: int) -> int:
    """The most that a frame of so many bytes takes on a serial line."""
    return frame_bytes + frame_bytes // 254 + 2


def encode_geom(
    geom_id: int, size: int, cell_mm: int, session: int, tick_s: float, stale_ms: int
) -> bytes:
    """Body of a GEOM frame; the window is square."""
    tick_ms = min(0xFFFF, round(tick_s * 1000))
    return GEOM_BODY.pack(geom_id, size, size, cell_mm, session, tick_ms, stale_ms)


def encode_pose(pose: PoseReport) -> bytes:
    """Body of a POSE frame; what does not fit is told as the nearest that does."""
    return POSE_BODY.pack(
        _int(pose.x_m * 1000, 31),
        _int(pose.y_m * 1000, 31),
        max(-31416, min(31415, _int(pose.yaw_rad * 10_000, 15))),
        _int(pose.pitch_rad * 10_000, 15),
        _int(pose.roll_rad * 10_000, 15),
        _int(pose.v_mps * 1000, 15),
        _int(pose.w_radps * 1000, 15),
        pose.health & 0xFFFF,
        _age(pose.age_scan_s),
        _age(pose.age_ahrs_s),
        _age(pose.age_enc_s),
        pose.mode,
    )


def _int(value: float, bits: int) -> int:
    """Rounded and saturated to a signed number; 0 for what is no number."""
    if math.isnan(value):
        return 0
    return round(max(-(2.0**bits), min(2.0**bits - 1, value)))


def _age(age_s: float) -> int:
    """Units of 4 ms; 255 is 1020 ms and more, and never."""
    return int(max(0.0, min(255.0, age_s / AGE_UNIT_S)))


def encode_map(
    origin: tuple[int, int], repaired: int, geom_id: int, start: int, ops: bytes
) -> bytes:
    """Body of a MAP frame; `origin` is the world cell (i, j) of the window's lowest corner."""
    ox, oy = ((part + 0x8000) % 0x10000 - 0x8000 for part in origin)
    return MAP_HEAD.pack(ox, oy, repaired % 2**16, geom_id, start.to_bytes(3, "little")) + ops


def decode_answer(
    frame: bytes, secret: Secret | None = None
) -> Ack | Hello | Drive | External | BadFrame:
    """A frame that comes to the sender; with a secret, only one with the right tag (HELLO: any)."""
    if not HEAD.size + CRC.size <= len(frame) <= MAX_FRAME:
        return BadFrame("bad length", frame)
    if CRC.unpack(frame[-4:])[0] != zlib.crc32(frame[:-4], CRC_START):
        return BadFrame("bad checksum", frame)
    kind, flags, seq, t_ms = HEAD.unpack_from(frame)
    if kind >> 4 != VERSION or flags & ~KNOWN_FLAGS:
        return BadFrame("unknown version or flag", frame)
    end = len(frame) - CRC.size - (TAG_BYTES if flags & AUTH else 0)
    tagged = flags & AUTH and secret is not None
    tag_right = tagged and secret and hmac.compare_digest(secret.tag(frame[:end]), frame[end:-4])
    if secret is not None and kind & 0x0F != HELLO and not tag_right:
        return BadFrame("no valid tag", frame)
    body = frame[HEAD.size : max(end, HEAD.size)]
    if kind & 0x0F == ACK and len(body) == ACK_BODY.size:
        last, mask, echo, hold, bad, status, geom_id = ACK_BODY.unpack(body)
        return Ack(last, mask, echo, hold * 1e-4, bad, status, geom_id)
    if kind & 0x0F == HELLO and len(body) == HELLO_BODY.size:
        nonce, max_cells, max_frame, _ = HELLO_BODY.unpack(body)
        return Hello(nonce, max_cells, max_frame)
    if kind & 0x0F == DRIVE:
        return _maybe_drive(body, seq, t_ms) or BadFrame("DRIVE out of range", frame)
    if kind & 0x0F == EXTERNAL_POSE:
        pose = _maybe_external(body, seq, t_ms)
        return pose or BadFrame("EXTERNAL_POSE out of range", frame)
    return BadFrame("neither ACK nor HELLO nor DRIVE nor EXTERNAL_POSE", frame)


def is_kind(frame: bytes, kind: int) -> bool:
    """Whether a refused frame would have been one of that type."""
    return frame[:1] == bytes([VERSION << 4 | kind])


def _maybe_drive(body: bytes, seq: int, t_ms: int) -> Drive | None:
    """None unless all of it is as section 3 wants it: nothing is obeyed in part."""
    if len(body) != DRIVE_BODY.size:
        return None
    session, nonce, v_mmps, w_mradps, valid_ms, reserved = DRIVE_BODY.unpack(body)
    if NO_SPEED in (v_mmps, w_mradps) or valid_ms > LONGEST_VALID_MS or reserved or not nonce:
        return None
    return Drive(seq, t_ms, session, nonce, v_mmps / 1000, w_mradps / 1000, valid_ms / 1000)


def _maybe_external(body: bytes, seq: int, t_ms: int) -> External | None:
    """None unless all of it is as section 3 wants it: nothing is used in part."""
    if len(body) != EXTERNAL_BODY.size:
        return None
    session, nonce, x_mm, y_mm, yaw, sigma_x, sigma_y, tied, sigma_yaw, age_ms = (
        EXTERNAL_BODY.unpack(body)
    )
    has_yaw = yaw != NO_YAW
    if not nonce or NO_PLACE in (x_mm, y_mm) or not sigma_x or not sigma_y:
        return None
    if abs(tied) > MOST_CORRELATION or age_ms > OLDEST_MS:
        return None
    if has_yaw and not (-MOST_YAW <= yaw < MOST_YAW and sigma_yaw):
        return None
    return External(
        seq,
        t_ms,
        session,
        nonce,
        x_mm / 1000,
        y_mm / 1000,
        yaw / 10_000 if has_yaw else math.nan,
        sigma_x / 1000,
        sigma_y / 1000,
        tied / MOST_CORRELATION,
        sigma_yaw / 10_000,
        age_ms / 1000,
    )


class Deframer:
    """Takes a serial stream cut anywhere; gives the frames between its zeros."""

    def __init__(self) -> None:
        self._buffer = bytearray()
        self._skipping = False

    def feed(self, data: bytes) -> list[bytes | BadFrame]:
        """The frames that these bytes complete."""
        frames: list[bytes | BadFrame] = []
        for part in data.split(b"\0")[:-1]:
            self._buffer += part
            encoded, self._buffer = bytes(self._buffer), bytearray()
            if self._skipping:
                self._skipping = False
            elif encoded:
                frames.append(_decoded(encoded))
        self._buffer += data.rsplit(b"\0", 1)[-1]
        if len(self._buffer) > serial_bytes(MAX_FRAME):
            if not self._skipping:
                frames.append(BadFrame("frame too long", bytes(self._buffer)))
            self._buffer, self._skipping = bytearray(), True
        return frames


def _decoded(encoded: bytes) -> bytes | BadFrame:
    try:
        frame: bytes = cobs.decode(encoded)  # type: ignore[no-untyped-call]
        return frame
    except cobs.DecodeError:
        return BadFrame("not COBS", encoded)
