"""A sender without a mind, for tests of the planner's end: bodies and numbered frames.

Source: planner link, section 3. Shares no code with hw/planner_link/sender.py.
"""

import hashlib
import json
import struct
import zlib
from typing import Generic, TypeVar

from fakes.planner_mcu.receiver import FakePlanner
from mapod_link.frames import GEOM, MAP, POSE, Frame, bytes_from_frame, frame_from_bytes, int16
from mapod_link.receiver import Receiver
from tests import ROOT

VECTORS = json.loads((ROOT / "tests/vectors" / "planner_link.json").read_text())
GOOD_HEALTH = 0x007F
STOPS = [  # health and mode in a POSE frame, and why a planner stops for them
    (GOOD_HEALTH, 0, "mode 0"), (GOOD_HEALTH, 3, "mode 3"), (GOOD_HEALTH, 4, "mode 4"),
    (GOOD_HEALTH & ~0x10, 1, "pose not valid"), (GOOD_HEALTH & ~0x20, 1, "map not valid"),
    (GOOD_HEALTH | 0x80, 1, "drop-off ahead"), (GOOD_HEALTH | 0x200, 2, "attitude out of range"),
    (GOOD_HEALTH | 0x8000, 2, "operator stop"),
]  # fmt: skip
SESSION = 0x5A17C0DE
NONCE = 0x11223344


def vector(name: str) -> bytes:
    return bytes.fromhex(VECTORS[name])


def whole(datagrams: list[bytes]) -> list[Frame]:
    """The frames, those of them that are valid."""
    read = [frame_from_bytes(data) for data in datagrams]
    return [frame for frame in read if not isinstance(frame, str)]


def geom_body(
    geom_id: int = 7, width: int = 9, height: int = 5, session: int = SESSION, stale_ms: int = 150
) -> bytes:
    return struct.pack("<BxHHHIHH", geom_id, width, height, 50, session, 20, stale_ms)


def pose_body(health: int = GOOD_HEALTH, mode: int = 1) -> bytes:
    return struct.pack("<iihhhhhHBBBB", 0, 0, 0, 0, 0, 0, 0, health, 3, 1, 2, mode)


def map_body(
    ops: bytes = b"", start: int = 0, ox: int = 0, oy: int = 0, repaired: int = 0, geom_id: int = 7
) -> bytes:
    head = struct.pack("<hhHB", int16(ox), int16(oy), repaired % 0x10000, geom_id)
    return head + start.to_bytes(3, "little") + ops


def op(state: int, length: int) -> bytes:
    if length <= 63:
        return bytes([state << 6 | length - 1])
    rest, encoded = length - 64, bytearray([state << 6 | 63])
    while rest > 127:
        encoded.append(rest & 127 | 128)
        rest >>= 7
    return bytes([*encoded, rest])


R = TypeVar("R", bound=Receiver)


class Line(Generic[R]):
    """A sender without a mind: numbers frames, lets time pass."""

    def __init__(self, planner: R) -> None:
        self.planner, self.seq, self.now_s = planner, 0, 0.0

    def send(self, frame_type: int, body: bytes, lost: bool = False) -> int:
        self.seq, self.now_s = self.seq + 1, self.now_s + 0.01
        if not lost:
            frame = bytes_from_frame(frame_type, self.seq, round(self.now_s * 1000), body)
            self.planner.feed_datagram(self.now_s, frame)
        return self.seq


def with_map(line: Line[R], width: int = 9, height: int = 5) -> Line[R]:
    """The line, with geometry 7, a pose and a blank window at the origin told."""
    line.send(GEOM, geom_body(width=width, height=height))
    line.send(POSE, pose_body())
    line.send(MAP, map_body())
    return line


def begun() -> Line[FakePlanner]:
    return with_map(Line(FakePlanner()))


def receiving() -> Line[Receiver]:
    return with_map(Line(Receiver(NONCE)))


def zone_body(state: int = 1, causes: int = 0) -> bytes:
    return struct.pack("<8HhBB", 1250, 0xFFFF, 0, 480, 0xFFFF, 650, 0, 430, -7854, state, causes)


def signed_frame(
    key: bytes, nonce: int, kind: int, seq: int, t_ms: int, body: bytes, session: int = SESSION
) -> bytes:
    """An authenticated frame, made without the receiver's own code."""
    signed = struct.pack("<BBHI", 0x10 | kind, 0x10, seq % 0x10000, t_ms) + body
    data = struct.pack("<II", session, nonce) + signed
    content = signed + hashlib.blake2s(data, key=key, digest_size=8).digest()
    return content + struct.pack("<I", zlib.crc32(b"MPL1" + content))


def state_of(planner: Receiver) -> tuple[object, ...]:
    """All that a rejected frame must leave alone."""
    return (
        planner.geom, planner.pose, planner.stop_zone, planner.origin, planner.numbers.gap,
        planner.window().tobytes(), planner.accepted.copy(), planner.ack(9.0)[:12],
        planner.ignored.repeated, planner.needs.full, planner.needs.too_many_cells,
    )  # fmt: skip
