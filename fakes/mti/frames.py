"""MT frames as a device hears and speaks them. What is damaged is ignored.

Source: MTi sheet, section 1.
"""

from typing import NamedTuple

PREAMBLE, EXTENDED = 0xFA, 0xFF
MASTER, SINGLE = 0xFF, 0x01  # bus ids
MIN_EXTENDED, MAX_EXTENDED = 255, 2048
PATIENCE_S = 0.1  # for the rest of a frame


def frame(mid: int, data: bytes = b"", bus_id: int = MASTER) -> bytes:
    size = (
        bytes([len(data)]) if len(data) < MIN_EXTENDED else b"\xff" + len(data).to_bytes(2, "big")
    )
    body = bytes([bus_id, mid]) + size + data
    return bytes([PREAMBLE]) + body + bytes([-sum(body) & 0xFF])


class Request(NamedTuple):
    """One message of the host."""

    mid: int
    data: bytes
    bus_id: int  # the answer carries the same


class RequestReader:
    """Takes the host's stream cut anywhere; gives whole, undamaged messages."""

    def __init__(self) -> None:
        self._buffer = bytearray()
        self._waiting_s: float | None = None  # since when the front waits for its rest

    def feed(self, now_s: float, data: bytes) -> list[Request]:
        self._buffer += data
        requests = []
        while self._buffer:
            begin, end = self._extent()
            if end > len(self._buffer):
                if self._waiting_s is None:
                    self._waiting_s = now_s
                if now_s - self._waiting_s <= PATIENCE_S:
                    break
            elif end and sum(self._buffer[1:end]) & 0xFF == 0:
                bus_id, mid = self._buffer[1:3]
                requests.append(Request(mid, bytes(self._buffer[begin : end - 1]), bus_id))
                self._drop(end)
                continue
            start = self._buffer.find(PREAMBLE, 1)  # the next byte that may begin a frame
            self._drop(start if start > 0 else len(self._buffer))
        return requests

    def _extent(self) -> tuple[int, int]:
        """Where data begins and the frame ends, as far as is known; 0, 0: no frame."""
        buffer = self._buffer
        if buffer[0] != PREAMBLE or (len(buffer) > 1 and buffer[1] not in (MASTER, SINGLE)):
            return 0, 0
        if len(buffer) < 4 or buffer[3] != EXTENDED:
            return 4, 5 + (buffer[3] if len(buffer) > 3 else 0)
        if len(buffer) < 6:
            return 6, 7
        length = int.from_bytes(buffer[4:6], "big")
        return (6, 7 + length) if MIN_EXTENDED <= length <= MAX_EXTENDED else (0, 0)

    def _drop(self, count: int) -> None:
        del self._buffer[:count]
        self._waiting_s = None
