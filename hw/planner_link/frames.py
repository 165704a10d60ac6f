"""Frames of the planner link, version 1: what all have in common, and what goes to the planner.

No clock. What comes back is cut out of a port's bytes here and decoded in messages.py.
Source: planner link, sections 2, 3 and 9.
"""

import hashlib
import math
import struct
import zlib
from collections import deque
from dataclasses import dataclass

from cobs import cobs

from core.records import PoseReport, StopZoneReport, SweepPoints
from hw.device import BadFrame, Port

VERSION = 1
GEOM, POSE, MAP, DIGEST, STOP_ZONE, TILE, SCAN = 1, 2, 3, 4, 5, 6, 7
ACK, HELLO, DRIVE, ASK, EXTERNAL_POSE = 8, 9, 10, 11, 12
OBJECTS, PATH = 13, 14
MORE, REFRESH, AUTH = 1 << 0, 1 << 1, 1 << 4
KNOWN_FLAGS = 0x1F  # an unknown bit of 5..7 drops the frame
CRC_START = 0x2994717F  # CRC-32 of b"MPL1": frames of other layouts never pass
MAX_FRAME = 368
TICK_BYTES = 2048  # looked at in one tick: a line of 921 600 baud brings 1843 in 20 ms
HEAD, CRC, TAG_BYTES = struct.Struct("<BBHI"), struct.Struct("<I"), 8
GEOM_BODY, POSE_BODY = struct.Struct("<BxHHHIHH"), struct.Struct("<iihhhhhHBBBB")
MAP_HEAD, DIGEST_BODY = struct.Struct("<HHHB3s"), struct.Struct("<BxxxI")
STOP_ZONE_BODY = struct.Struct("<HHHHHHHHhBB")
TILE_HEAD = struct.Struct("<HBBhhHH3sBHH")
SCAN_HEAD = struct.Struct("<HBBHHHxxIiii")  # id, status, unit, count, first, returns, t, lens
AGE_UNIT_S, MOST_AGE = 0.004, 255.0  # the most also says: never
MOST_I16, MOST_I32 = 2.0**15 - 1, 2.0**31 - 1
NONE, MOST = 0xFFFF, 0xFFFE  # of a u16 that may say "none": that, and the greatest number


@dataclass(frozen=True, slots=True)
class Secret:
    """What the authentication tag is made with besides the frame."""

    key: bytes  # 32
    session: int
    nonce: int

    def tag(self, frame: bytes) -> bytes:
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
    """Body of a POSE frame; what does not fit becomes the nearest that does."""
    return POSE_BODY.pack(
        _int(pose.x_m * 1000, MOST_I32),
        _int(pose.y_m * 1000, MOST_I32),
        max(-31416, min(31415, _int(pose.yaw_rad * 10_000, MOST_I16))),
        _int(pose.pitch_rad * 10_000, MOST_I16),
        _int(pose.roll_rad * 10_000, MOST_I16),
        _int(pose.v_mps * 1000, MOST_I16),
        _int(pose.w_radps * 1000, MOST_I16),
        pose.health & 0xFFFF,
        int(min(MOST_AGE, max(pose.age_scan_s, 0.0) / AGE_UNIT_S)),
        int(min(MOST_AGE, max(pose.age_ahrs_s, 0.0) / AGE_UNIT_S)),
        int(min(MOST_AGE, max(pose.age_enc_s, 0.0) / AGE_UNIT_S)),
        pose.mode,
    )


def _int(value: float, most: float) -> int:
    """Rounded and saturated to a signed number of `most` at most; 0 for what is no number."""
    if -most <= value <= most:  # as nearly all are
        return round(value)
    return 0 if math.isnan(value) else round(max(-most - 1, min(most, value)))


def encode_map(
    origin: tuple[int, int], repaired: int, geom_id: int, start: int, ops: bytes
) -> bytes:
    """Body of a MAP frame; `origin` is the world cell (i, j) of the window's lowest corner."""
    ox, oy, repaired = origin[0] % 2**16, origin[1] % 2**16, repaired % 2**16
    return MAP_HEAD.pack(ox, oy, repaired, geom_id, start.to_bytes(3, "little")) + ops


def encode_digest(geom_id: int, window_crc: int) -> bytes:
    return DIGEST_BODY.pack(geom_id, window_crc)


def encode_stop_zone(zone: StopZoneReport) -> bytes:
    """Body of a STOP_ZONE frame: distances, times and speeds are never more than they are."""
    has_nearest = zone.nearest_m < math.inf
    return STOP_ZONE_BODY.pack(
        _thousandths(zone.free_ahead_m, MOST),
        _thousandths(zone.obstacle_ahead_m),
        _thousandths(zone.free_behind_m, MOST),
        _thousandths(zone.obstacle_behind_m),
        _thousandths(zone.contact_s),
        _thousandths(zone.allowed_ahead_mps, MOST),
        _thousandths(zone.allowed_behind_mps, MOST),
        _thousandths(zone.nearest_m),
        _int(zone.bearing_rad * 10_000, MOST_I16) if has_nearest else 0,
        zone.state,
        zone.causes,
    )


def encode_scan_head(
    ask_id: int, unit_mm: int, count: int, first: int, sweep: SweepPoints | None
) -> bytes:
    """What a SCAN frame begins with; no sweep: there is none to be told."""
    if sweep is None:
        return SCAN_HEAD.pack(ask_id, 1, 0, 0, 0, 0, 0, 0, 0, 0)
    t_ms, lens_mm = round(sweep.t_s * 1000) % 2**32, lens_mm_of(sweep)
    returns = min(sweep.returns, 0xFFFF)
    return SCAN_HEAD.pack(ask_id, 0, unit_mm, count, first, returns, t_ms, *lens_mm)


def lens_mm_of(sweep: SweepPoints) -> tuple[int, int, int]:
    """Where the lens was, as it is told: points are told from there."""
    x_m, y_m, z_m = sweep.lens_m
    return _int(x_m * 1000, MOST_I32), _int(y_m * 1000, MOST_I32), _int(z_m * 1000, MOST_I32)


def _thousandths(value: float, infinite: int = NONE) -> int:
    """Rounded down to what a u16 can say; 0 for what is no number."""
    if value == math.inf:
        return infinite
    return int(max(0.0, min(float(MOST), value * 1000 + 1e-6))) if value > 0.0 else 0


def int16(number: int) -> int:
    """The signed 16-bit number that equals it modulo 65 536."""
    return (number + 0x8000) % 0x10000 - 0x8000


class Deframer:
    """Takes a serial stream cut anywhere; gives the frames between its zeros."""

    def __init__(self) -> None:
        self._buffer = bytearray()
        self._skipping = False

    def feed(self, data: bytes) -> list[bytes | BadFrame]:
        frames: list[bytes | BadFrame] = []
        *ended, rest = data.split(b"\0")
        for part in ended:
            encoded, self._buffer = bytes(self._buffer + part), bytearray()
            if encoded and not self._skipping:
                frames.append(_decoded(encoded))
            self._skipping = False
        self._buffer += rest
        if len(self._buffer) > serial_bytes(MAX_FRAME):
            if not self._skipping:
                frames.append(BadFrame("frame too long", bytes(self._buffer)))
            self._buffer, self._skipping = bytearray(), True
        return frames


def _decoded(encoded: bytes) -> bytes | BadFrame:
    if len(encoded) <= HEAD.size + CRC.size:  # not worth decoding
        return BadFrame("bad length", encoded)
    try:
        frame: bytes = cobs.decode(encoded)  # type: ignore[no-untyped-call]
        return frame
    except cobs.DecodeError:
        return BadFrame("not COBS", encoded)


class FrameInput:
    """The frames out of what a port has read, a bounded number of bytes at a time.

    What a tick does not look at waits for the next one, in order; meanwhile the port is not read,
    so that the kernel's buffer bounds the rest. Each connection begins with a frame.
    """

    def __init__(self, port: Port) -> None:
        self._port, self._opened = port, port.opened
        self._deframer = Deframer()
        self._unread: deque[bytes] = deque()

    def read(self) -> list[bytes | BadFrame]:
        if self._port.opened != self._opened:
            self._opened, self._deframer = self._port.opened, Deframer()
            self._unread.clear()
        if not self._unread:
            self._unread.extend(self._port.read())
        frames: list[bytes | BadFrame] = []
        left = TICK_BYTES
        while self._unread and left > 0:
            piece = self._unread.popleft()
            if self._port.datagrams:
                frames.append(piece)
            else:
                frames += self._deframer.feed(piece[:left])
                if piece[left:]:
                    self._unread.appendleft(piece[left:])
            left -= len(piece)
        return frames
