"""A sender without a mind, for tests of the planner's end: bodies and numbered frames.

Source: planner link, section 3. Shares no code with hw/planner_link.py.
"""

import json
import struct
from pathlib import Path

from fakes.planner import FakePlanner
from fakes.planner_frames import GEOM, MAP, POSE, bytes_from_frame, int16

VECTORS = json.loads((Path(__file__).parent / "vectors" / "planner_link.json").read_text())
GOOD_HEALTH = 0x007F
SESSION = 0x5A17C0DE


def vector(name: str) -> bytes:
    return bytes.fromhex(VECTORS[name])


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
    """One operation, section 3."""
    if length <= 63:
        return bytes([state << 6 | length - 1])
    rest, encoded = length - 64, bytearray([state << 6 | 63])
    while rest > 127:
        encoded.append(rest & 127 | 128)
        rest >>= 7
    return bytes([*encoded, rest])


class Line:
    """A sender without a mind: numbers frames, lets time pass."""

    def __init__(self, planner: FakePlanner, seq: int = 0) -> None:
        self.planner, self.seq, self.now_s = planner, seq, 0.0

    def planner_heard(self, frame_type: int) -> float:
        """When a frame of that type arrived last."""
        return max(frame.arrived_s for frame in self.planner.heard if frame.type == frame_type)

    def send(self, frame_type: int, body: bytes, lost: bool = False) -> int:
        self.seq, self.now_s = self.seq + 1, self.now_s + 0.01
        if not lost:
            frame = bytes_from_frame(frame_type, self.seq, round(self.now_s * 1000), body)
            self.planner.feed_datagram(self.now_s, frame)
        return self.seq


def begun(width: int = 9, height: int = 5, seq: int = 0) -> Line:
    """A line with geometry 7, a pose and a blank window at the origin."""
    line = Line(FakePlanner(), seq)
    line.send(GEOM, geom_body(width=width, height=height))
    line.send(POSE, pose_body())
    line.send(MAP, map_body())
    return line
