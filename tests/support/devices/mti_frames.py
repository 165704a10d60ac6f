"""The frames printed in the MTi sheet, and how one is built by its rule."""

import math
import struct

from tests import VECTORS

ROWS = [
    row.split("\t")
    for row in (VECTORS / "mti_frames.tsv").read_text().splitlines()
    if not row.startswith("#")
]


def wire(name: str, which: int = 0) -> bytes:
    return [bytes.fromhex(row[2]) for row in ROWS if row[1] == name][which]


def framed(mid: int, data: bytes = b"") -> bytes:
    """A message, by the rule of section 1."""
    size = bytes([len(data)]) if len(data) < 255 else b"\xff" + struct.pack(">H", len(data))
    body = bytes([0xFF, mid]) + size + data
    return b"\xfa" + body + bytes([-sum(body) & 0xFF])


def slow_number(value: float, number_format: int) -> bytes:
    """By the words of section 3, one byte after the other."""
    if number_format in (0, 3):
        return struct.pack(">f" if number_format == 0 else ">d", value)
    if number_format == 1:
        return (round(value * 2**20) % 2**32).to_bytes(4, "big")
    b5, b4, b3, b2, b1, b0 = (round(value * 2**32) % 2**48).to_bytes(6, "big")
    return bytes([b3, b2, b1, b0, b5, b4])


def configuration(tail_102: str, device_id: str = "00300D2A", head: str = "04800000") -> bytes:
    """The Configuration frame of section 8; bytes 102..109 are given."""
    data = bytes.fromhex(device_id + head) + bytes(88) + bytes.fromhex("0001" + device_id)
    return framed(0x0D, data + bytes.fromhex(tail_102 + "0003 020601 330208"))


def euler_deg(q: tuple[float, float, float, float] | None) -> list[float]:
    """Roll, pitch and yaw by the formulas of section 6."""
    assert q is not None
    w, x, y, z = q
    roll = math.atan2(2 * (y * z + w * x), 2 * w * w + 2 * z * z - 1)
    pitch = -math.asin(2 * x * z - 2 * w * y)
    yaw = math.atan2(2 * (x * y + w * z), 2 * w * w + 2 * x * x - 1)
    return [math.degrees(angle) for angle in (roll, pitch, yaw)]
