"""MT frames as a device hears and speaks them. What is damaged is ignored.

Source: MTi sheet, section 1.
"""

from dataclasses import dataclass

PREAMBLE, EXTENDED = 0xFA, 0xFF
MASTER, SINGLE = 0xFF, 0x01  # bus ids
MIN_EXTENDED, MAX_EXTENDED = 255, 2048
PATIENCE_S = 0.1  # for the rest of a frame


def frame(mid: int, data: bytes = b"", bus_id: int = MASTER) -> bytes:
    """A whole message."""
    size = (
        bytes([len(data)]) if len(data) < MIN_EXTENDED else b"\xff" + len(data).to_bytes(2, "big")
    )
    body = bytes([bus_id, mid]) + size + data
    return bytes([PREAMBLE]) + body + bytes([-sum(body) & 0xFF])


@dataclass(frozen=True, slots=True)
class Request:
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
        """The messages that these bytes complete."""
        self._buffer += data
        requests = []
        while self._buffer:
            begin, end = self._extent()
            if begin < 0:
                self._skip()
            elif len(self._buffer) < end:
                if self._is_patient(now_s):
                    break
                self._skip()
            elif sum(self._buffer[1:end]) & 0xFF:
                self._skip()
            else:
                bus_id, mid = self._buffer[1:3]
                requests.append(Request(mid, bytes(self._buffer[begin : end - 1]), bus_id))
                del self._buffer[:end]
                self._waiting_s = None
        return requests

    def _extent(self) -> tuple[int, int]:
        """Where data begins and the frame ends, as far as is known; begin < 0: no frame."""
        buffer = self._buffer
        if buffer[0] != PREAMBLE or (len(buffer) > 1 and buffer[1] not in (MASTER, SINGLE)):
            return -1, 0
        if len(buffer) < 4:
            return 4, 5
        if buffer[3] != EXTENDED:
            return 4, 5 + buffer[3]
        if len(buffer) < 6:
            return 6, 7
        length = int.from_bytes(buffer[4:6], "big")
        if not MIN_EXTENDED <= length <= MAX_EXTENDED:
            return -1, 0
        return 6, 7 + length

    def _is_patient(self, now_s: float) -> bool:
        if self._waiting_s is None:
            self._waiting_s = now_s
        return now_s - self._waiting_s <= PATIENCE_S

    def _skip(self) -> None:
        """To the next byte that may begin a frame."""
        start = self._buffer.find(PREAMBLE, 1)
        del self._buffer[: start if start > 0 else len(self._buffer)]
        self._waiting_s = None
