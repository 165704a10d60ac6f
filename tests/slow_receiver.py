"""A receiver of the planner link that is slow and obvious: a dictionary of cells, a set of frames.

Written from the sheet's sections 4 and 5 alone; shares no code with the public receiver.
"""

import struct
import zlib

Cell = tuple[int, int]


def lowest16(number: int) -> int:
    """As a signed number of 16 bits."""
    number %= 65_536
    return number - 65_536 if number >= 32_768 else number


class SlowReceiver:
    """Takes whole, valid frames only; a body that is wrong changes nothing."""

    def __init__(self) -> None:
        self.cells: dict[Cell, int] = {}  # in the window, by column and row
        self.geom: tuple[int, ...] | None = None  # geom_id, width, height, cell_mm, session
        self.origin: Cell | None = None
        self.gap: int | None = None
        self.last = self.last_ms = -1
        self.came: dict[int, int] = {}  # how many counted after the frame of this number
        self.mode = -1  # of the newest pose
        self.map_s = self.pose_s = -1e9
        self.need_geom = self.need_full = self.digest_ok = False

    def take(self, now_s: float, frame: bytes) -> None:
        """One frame as a datagram."""
        content, (crc,) = frame[:-4], struct.unpack("<I", frame[-4:])
        if zlib.crc32(b"MPL1" + content) != crc or content[0] >> 4 != 1 or content[1] & 0xE0:
            return
        kind, (seq, t_ms), body = content[0] & 15, struct.unpack("<HI", content[2:8]), content[8:]
        if 8 <= kind <= 12 or not self.is_right(kind, body):
            return
        begins = kind == 1 and (
            self.geom is None or self.geom[4] != struct.unpack("<I", body[8:12])[0]
        )
        anew = self.last >= 0 and 60_000 <= (t_ms - self.last_ms) % 2**32 < 2**31
        if self.last >= 0 and not begins and not anew and lowest16(seq - self.last) <= 0:
            return
        if begins or anew:
            self.came.clear()
        elif self.last >= 0 and lowest16(seq - self.last) > 1:
            self.gap = (seq - 1) % 65_536
        if anew and not begins:
            self.cells, self.gap = {}, None
        step = lowest16(seq - self.last) if self.last >= 0 else 0
        self.came = {age + step: 1 for age in self.came} | {0: 1}
        self.last, self.last_ms = seq, t_ms
        if kind == 1:
            self.adopt(body, begins)
        elif kind == 2:
            self.mode, self.pose_s = body[23], now_s
        elif kind == 3:
            self.map(now_s, body)
        elif kind == 4:
            self.compare(body)

    def is_right(self, kind: int, body: bytes) -> bool:
        """Lengths; and operations that stay in the window."""
        if kind == 1:
            return len(body) == 16 and all(struct.unpack("<HHH", body[2:8]))
        if kind == 3 and self.geom is not None and len(body) >= 10 and body[6] == self.geom[0]:
            return self.walked(body) is not None
        sizes = {2: (24,), 3: range(10, 400), 4: (8,), 5: (20,)}
        return len(body) in sizes.get(kind, range(400))

    def walked(self, body: bytes) -> dict[int, int] | None:
        """State by cell number; None if the operations do not fit."""
        assert self.geom is not None
        at = int.from_bytes(body[7:10], "little")
        told: dict[int, int] = {}
        ops = list(body[10:])
        while ops:
            op = ops.pop(0)
            length = op % 64 + 1
            if op % 64 == 63:
                digits: list[int] = []
                while not digits or digits[-1] >= 128:
                    if not ops or len(digits) == 3:
                        return None
                    digits.append(ops.pop(0))
                length = 64 + sum(digit % 128 * 128**k for k, digit in enumerate(digits))
            if at + length > self.geom[1] * self.geom[2]:
                return None
            told |= dict.fromkeys(range(at, at + length), op // 64)
            at += length
        return told

    def adopt(self, body: bytes, begins: bool) -> None:
        """Section 3, GEOM."""
        geom_id, width, height, cell_mm, session = struct.unpack("<BxHHHI", body[:12])
        old, self.geom = self.geom, (geom_id, width, height, cell_mm, session)
        self.need_geom = False
        if begins:
            self.mode, self.map_s, self.pose_s = -1, -1e9, -1e9
        if old != self.geom:
            self.cells, self.origin, self.gap = {}, None, None
            self.need_full = self.digest_ok = False

    def map(self, now_s: float, body: bytes) -> None:
        """Section 4."""
        ox, oy, repaired, geom_id = struct.unpack("<hhHB", body[:7])
        if self.geom is None or geom_id != self.geom[0]:
            self.need_geom = True
            return
        _, width, height, _, _ = self.geom
        dx, dy = (
            (lowest16(ox - self.origin[0]), lowest16(oy - self.origin[1]))
            if self.origin
            else (0, 0)
        )
        moved = {(col - dx, row - dy): state for (col, row), state in self.cells.items()}
        self.cells = {
            (col, row): state
            for (col, row), state in moved.items()
            if 0 <= col < width and 0 <= row < height
        }
        if self.origin is None or abs(dx) >= width or abs(dy) >= height:
            self.cells, self.gap = {}, None
        self.origin = ox, oy
        if self.gap is not None and lowest16(repaired - self.gap) >= 0:
            self.gap = None
        for cell, state in (self.walked(body) or {}).items():
            if state != 3:
                self.cells[cell % width, cell // width] = state
        self.map_s = now_s

    def compare(self, body: bytes) -> None:
        """Section 3, DIGEST."""
        assert len(body) == 8
        ours = self.geom is not None and body[0] == self.geom[0]
        if not ours or self.gap is not None or self.origin is None:
            self.digest_ok = False
            return
        packed = bytearray(-(-len(self.window()) // 4))
        for k, state in enumerate(self.window()):
            packed[k // 4] |= state << 2 * (k % 4)
        self.digest_ok = zlib.crc32(bytes(packed)) == struct.unpack("<I", body[4:])[0]
        self.need_full = self.need_full or not self.digest_ok

    def window(self) -> list[int]:
        """All cells, row by row."""
        if self.geom is None:
            return []
        _, width, height, _, _ = self.geom
        return [self.cells.get((col, row), 0) for row in range(height) for col in range(width)]

    def mask(self) -> int:
        """Of an ACK."""
        return sum(1 << (age - 1) for age in self.came if 1 <= age <= 32)
