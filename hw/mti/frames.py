"""Xsens MT bytes to frames, commands to bytes. No I/O, no clock, no logging.

Source: MTi sheet, sections 1 and 3. Frame: FA | bus id | mid | length | data | checksum; the sum of
all bytes after FA is 0 modulo 256; big-endian.
"""

from collections import deque
from dataclasses import field
from enum import IntEnum

from core.records import record
from hw.device import BadFrame

PREAMBLE, MASTER, SINGLE, EXTENDED = 0xFA, 0xFF, 0x01, 0xFF
MIN_EXTENDED, MAX_EXTENDED = 255, 2048
COMPLETION_S = 0.1  # for a claimed frame, beyond the time that its bytes take on the wire


class Mid(IntEnum):
    """Message ids of requests and data; the answer to a request has the next higher id."""

    ReqDID = 0x00
    InitBus = 0x02
    SetPeriod = 0x04
    ReqDataLength = 0x0A
    ReqConfiguration = 0x0C
    Configuration = 0x0D  # unasked after a WakeUp that nobody answered
    RestoreFactoryDef = 0x0E
    GoToMeasurement = 0x10
    ReqFWRev = 0x12
    SetBaudrate = 0x18
    ReqProductCode = 0x1C
    ReqHardwareVersion = 0x1E
    SetNoRotation = 0x22
    RunSelfTest = 0x24
    GoToConfig = 0x30
    MTData = 0x32
    ReqData = 0x34
    MTData2 = 0x36
    WakeUp = 0x3E
    WakeUpAck = 0x3F
    Reset = 0x40
    Error = 0x42
    ReqUTCTime = 0x60
    ReqAvailableScenarios = 0x62
    SetScenario = 0x64
    SetGravityMagnitude = 0x66
    SetMagneticDeclination = 0x6A
    SetHeading = 0x82
    SetLocationID = 0x84
    ResetOrientation = 0xA4
    SetOutputConfiguration = 0xC0
    SetOutputMode = 0xD0
    SetOutputSettings = 0xD2
    SetOutputSkipFactor = 0xD4
    SetErrorMode = 0xDA


NOT_IMPLEMENTED, BAD_PERIOD, TIMER_OVERFLOW, TOO_MUCH_OUTPUT = 0x04, 0x03, 0x1E, 0x29
ERRORS = {
    0x01: "no bus communication",
    0x02: "bus not ready",
    BAD_PERIOD: "period invalid: choose another rate",
    NOT_IMPLEMENTED: "message invalid or not implemented",
    TIMER_OVERFLOW: "timer overflow: lower the rate, or send less to it",
    0x20: "baud rate code invalid: choose another baud rate",
    0x21: "parameter invalid",
    0x23: "transmit buffer full: lower the rate or raise the baud rate",
    0x24: "transmit buffer full: lower the rate or raise the baud rate",
    0x28: "device error: power it off and on; if it stays, it is broken",
    TOO_MUCH_OUTPUT: "more data than the baud rate carries: lower the rate or raise the baud rate",
    **dict.fromkeys(
        range(0x18, 0x1E), "measurement failed: power it off and on; if it stays, it is broken"
    ),
}


def error_in_words(data: bytes) -> str:
    """The data of an Error message (section 3): its code, its meaning, what to do.

    >>> error_in_words(bytes([0x28, 0x01, 0x02]))
    'error 28 (0102), device error: power it off and on; if it stays, it is broken'
    """
    if not data:
        return "an error without a code"
    more = f" ({data[1:].hex()})" if len(data) > 1 else ""
    return f"error {data[0]:02X}{more}, {ERRORS.get(data[0], 'not listed')}"


@record()
class MtFrame:
    """One frame whose checksum is right."""

    mid: int
    data: bytes
    arrived_s: float = field(default=0.0, compare=False)  # host clock, when its last byte was read

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
    """Takes a stream cut anywhere; gives MtFrame and BadFrame; keeps less than one frame.

    It remembers when each kept byte was read. So a frame that stood behind a false claim has its
    true time of arrival, and a claim within a claim is not waited for a second time.
    """

    def __init__(self, baud: int) -> None:
        self._byte_s = 10 / baud
        self._buffer = bytearray()
        self._taken = 0  # bytes of the stream before the buffer
        self._arrivals: deque[tuple[int, float]] = deque()  # end of a piece in the stream, when

    def feed(self, now_s: float, data: bytes) -> list[MtFrame | BadFrame]:
        """The events that these bytes complete."""
        self._buffer += data
        if data:
            self._arrivals.append((self._taken + len(self._buffer), now_s))
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
            if now_s - self._arrivals[0][1] > COMPLETION_S + size * self._byte_s:
                return self._skip("frame not completed in time")
            return None
        if sum(buffer[1:size]) & 0xFF:
            return self._skip("bad checksum")
        mid, data = buffer[2], bytes(buffer[head : size - 1])
        return MtFrame(mid, data, self._drop(size))

    def _skip(self, reason: str) -> BadFrame:
        """Drop the first byte, and what follows up to the next possible start."""
        start = self._buffer.find(PREAMBLE, 1)
        skipped = bytes(self._buffer[: start if start > 0 else len(self._buffer)])
        self._drop(len(skipped))
        return BadFrame(reason, skipped)

    def _drop(self, count: int) -> float:
        """Forget so many bytes; when the last of them was read."""
        del self._buffer[:count]
        self._taken += count
        while self._arrivals[0][0] < self._taken:
            self._arrivals.popleft()
        arrived_s = self._arrivals[0][1]
        if self._arrivals[0][0] == self._taken:
            self._arrivals.popleft()
        return arrived_s
