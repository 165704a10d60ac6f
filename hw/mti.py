"""Xsens MT bytes to frames, commands to bytes. No I/O, no clock, no logging.

Source: MTi sheet, sections 1 and 3. Frame: FA | bus id | mid | length | data | checksum; the sum of
all bytes after FA is 0 modulo 256; big-endian.
"""

from dataclasses import dataclass
from enum import IntEnum

from hw.session import BadFrame

PREAMBLE, MASTER, SINGLE, EXTENDED = 0xFA, 0xFF, 0x01, 0xFF
MIN_EXTENDED, MAX_EXTENDED = 255, 2048
COMPLETION_S = 0.1  # for a claimed frame, beyond the time that its bytes take on the wire


class Mid(IntEnum):
    """Message ids of requests and data; the answer to a request has the next higher id."""

    ReqDID = 0x00
    SetPeriod = 0x04
    ReqConfiguration = 0x0C
    GoToMeasurement = 0x10
    ReqFWRev = 0x12
    ReqProductCode = 0x1C
    GoToConfig = 0x30
    MTData = 0x32
    MTData2 = 0x36
    WakeUp = 0x3E
    WakeUpAck = 0x3F
    Reset = 0x40
    Error = 0x42
    SetOutputConfiguration = 0xC0
    SetOutputMode = 0xD0
    SetOutputSettings = 0xD2
    SetOutputSkipFactor = 0xD4


NOT_IMPLEMENTED = 0x04
ERRORS = {
    0x01: "no bus communication",
    0x02: "bus not ready",
    0x03: "period invalid",
    NOT_IMPLEMENTED: "message invalid or not implemented",
    0x1E: "timer overflow: rate too high",
    0x20: "baud rate code invalid",
    0x21: "parameter invalid",
    0x23: "transmit buffer full",
    0x24: "transmit buffer full",
    0x28: "device error",
    0x29: "more data than the baud rate carries",
    **dict.fromkeys(range(0x18, 0x1E), "measurement failed"),
}


@dataclass(frozen=True, slots=True)
class MtFrame:
    """One frame whose checksum is right."""

    mid: int
    data: bytes

    @property
    def wire_bytes(self) -> int:
        """How many bytes it took on the wire."""
        return len(self.data) + (5 if len(self.data) < MIN_EXTENDED else 7)


def encode_frame(mid: int, data: bytes = b"") -> bytes:
    """A message to the single device on the line; data of 0..2048 bytes."""
    size = len(data)
    if size > MAX_EXTENDED:
        raise ValueError(f"data: at most {MAX_EXTENDED} bytes, given {size}")
    length = bytes([size]) if size < MIN_EXTENDED else b"\xff" + size.to_bytes(2, "big")
    body = bytes([MASTER, mid]) + length + data
    return bytes([PREAMBLE]) + body + bytes([-sum(body) & 0xFF])


class MtParser:
    """Takes a stream cut anywhere; gives MtFrame and BadFrame; keeps less than one frame."""

    def __init__(self, baud: int) -> None:
        self._byte_s = 10 / baud
        self._buffer = bytearray()
        self._claimed_s: float | None = None  # since when the front claims to be a frame

    def feed(self, now_s: float, data: bytes) -> list[MtFrame | BadFrame]:
        """The events that these bytes complete."""
        self._buffer += data
        events: list[MtFrame | BadFrame] = []
        while self._buffer and (event := self._maybe_event(now_s)) is not None:
            events.append(event)
        return events

    def _maybe_event(self, now_s: float) -> MtFrame | BadFrame | None:
        """The event at the front of the buffer; None while more bytes are needed."""
        buffer = self._buffer
        if buffer[0] != PREAMBLE:
            return self._skip("no preamble")
        if len(buffer) > 1 and buffer[1] not in (MASTER, SINGLE):
            return self._skip("unknown bus id")
        head, length = 4, buffer[3] if len(buffer) > 3 else 0
        if len(buffer) > 3 and length == EXTENDED:
            head, length = 6, int.from_bytes(buffer[4:6], "big")
            if len(buffer) > 5 and not MIN_EXTENDED <= length <= MAX_EXTENDED:
                return self._skip("bad extended length")
        size = head + length + 1
        if len(buffer) < size:
            return self._maybe_give_up(now_s, size)
        if sum(buffer[1:size]) & 0xFF:
            return self._skip("bad checksum")
        frame = MtFrame(buffer[2], bytes(buffer[head : size - 1]))
        self._drop(size)
        return frame

    def _maybe_give_up(self, now_s: float, size: int) -> BadFrame | None:
        if self._claimed_s is None:
            self._claimed_s = now_s
        if now_s - self._claimed_s > COMPLETION_S + size * self._byte_s:
            return self._skip("frame not completed in time")
        return None

    def _skip(self, reason: str) -> BadFrame:
        """Drop the first byte, and what follows up to the next possible start."""
        start = self._buffer.find(PREAMBLE, 1)
        skipped = bytes(self._buffer[: start if start > 0 else len(self._buffer)])
        self._drop(len(skipped))
        return BadFrame(reason, skipped)

    def _drop(self, count: int) -> None:
        del self._buffer[:count]
        self._claimed_s = None
