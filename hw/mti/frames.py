"""Xsens MT bytes to frames, commands to bytes; a device's settings. No I/O, no clock, no logging.

Source: MTi sheet, sections 1 and 3. Frame: FA | bus id | mid | length | data | checksum; the sum of
all bytes after FA is 0 modulo 256; big-endian.
"""

import re
import struct
from collections import deque
from enum import IntEnum

import numpy as np
from msgspec import Struct

from hw.device import BadFrame

PREAMBLE, MASTER, EXTENDED = 0xFA, 0xFF, 0xFF
MIN_EXTENDED, MAX_EXTENDED = 255, 2048
COMPLETION_S = 0.1  # for a claimed frame, beyond the time that its bytes take on the wire
MAX_JUNK = 256  # bytes told at once
BUS_IDS = (MASTER, 0x01)
START = re.compile(rb"\xFA(?:[\xFF\x01]|\Z)")  # the end of the buffer may be half of one
NO_START = "no start of a frame"

CONFIGURATION_BYTES = 118
BAUDS = (  # by code; from 2000000 on: newer devices only
    *(460800, 230400, 115200, 76800, 57600, 38400, 28800, 19200, 14400, 9600),
    *(921600, 4800, 2000000, 4000000, 3686400),
)
BAUD_CODES = {baud: code for code, baud in enumerate(BAUDS)}
BAUD_CODES[921600] = 0x80  # only firmware of 2.4.6 and later knows it as 0A, too


class Mid(IntEnum):
    """Message ids of requests and data; the answer to a request has the next higher id."""

    ReqDID = 0x00
    SetPeriod = 0x04
    ReqDataLength = 0x0A
    ReqConfiguration = 0x0C
    Configuration = 0x0D  # unasked after a WakeUp that nobody answered
    GoToMeasurement = 0x10
    ReqFWRev = 0x12
    SetBaudrate = 0x18
    ReqProductCode = 0x1C
    ReqHardwareVersion = 0x1E
    SetNoRotation = 0x22
    RunSelfTest = 0x24
    GoToConfig = 0x30
    MTData = 0x32
    MTData2 = 0x36
    WakeUp = 0x3E
    WakeUpAck = 0x3F
    Reset = 0x40
    Error = 0x42
    ReqAvailableScenarios = 0x62
    SetScenario = 0x64
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


def describe_error(data: bytes) -> str:
    """The data of an Error message (section 3): its code, its meaning, what to do.

    >>> describe_error(bytes([0x28, 0x01, 0x02]))
    'error 28 (0102), device error: power it off and on; if it stays, it is broken'
    """
    if not data:
        return "an error without a code"
    more = f" ({data[1:].hex()})" if len(data) > 1 else ""
    return f"error {data[0]:02X}{more}, {ERRORS.get(data[0], 'not listed')}"


class MtFrame(Struct, frozen=True):
    """One frame whose checksum is right."""

    mid: int
    data: bytes
    arrived_s: float = 0.0  # host clock, when its last byte was read

    @property
    def wire_bytes(self) -> int:
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

    All bytes between two frames are one BadFrame, however they were cut: given when the next frame
    is there, when MAX_JUNK of them have come, or with what comes later than COMPLETION_S.

    It remembers when each kept byte was read. So a frame that stood behind a false claim has its
    true time of arrival, and a claim within a claim is not waited for a second time. What a frame
    still lacks is known since its head was read: until then a piece of it is only kept.
    """

    def __init__(self, baud: int) -> None:
        self._byte_s = 10 / baud
        self.kept = bytearray()  # of a frame that is not whole yet
        self._taken = 0  # bytes of the stream before the buffer
        self._arrivals: deque[tuple[int, float]] = deque()  # end of a piece in the stream, when
        self._claimed, self._begun_s = 0, 0.0  # bytes of the frame at the front, its begin; or 0
        self._wait_s = 0.0  # from then until it must be whole
        self._junk = bytearray()  # not told yet
        self._junk_reason, self._junk_s = "", 0.0

    def feed(self, now_s: float, data: bytes) -> list[MtFrame | BadFrame]:
        buffer = self.kept
        buffer += data
        if data:
            self._arrivals.append((self._taken + len(buffer), now_s))
        has_time = now_s - self._begun_s <= self._wait_s
        if has_time and len(buffer) < self._claimed and not self._junk:  # it is on its way
            return []
        events, at, self._claimed = list[MtFrame | BadFrame](), 0, 0
        while at < len(buffer):  # but for a frame at its end that may still be completed
            reason, head, size = self._claim(at)
            end = at + size
            if not reason and end > len(buffer):
                self._begun_s = self._arrived_s(at + 1)
                self._wait_s = COMPLETION_S + size * self._byte_s
                if now_s - self._begun_s <= self._wait_s:
                    self._claimed = size if len(buffer) - at >= head else 0
                    break
                reason = "frame not completed in time"
            elif not reason:  # long claims of junk are summed quickly, too
                claim = buffer[at:end]
                is_long = size > MIN_EXTENDED
                total = int(np.frombuffer(claim, np.uint8).sum()) if is_long else sum(claim)
                reason = "" if total & 0xFF == PREAMBLE else "bad checksum"
            if reason:
                start = START.search(buffer, at + 1)
                end = start.start() if start else len(buffer)
                events += self._reject(reason, buffer[at:end], now_s)
            else:
                if self._junk:
                    events += self._told_junk()
                data = bytes(buffer[at + head : end - 1])
                events.append(MtFrame(buffer[at + 2], data, self._arrived_s(end)))
            at = end
        del buffer[:at]
        self._taken += at
        if not buffer:
            self._arrivals.clear()
        if self._junk and now_s - self._junk_s > COMPLETION_S:
            events += self._told_junk()
        return events

    def _claim(self, at: int) -> tuple[str, int, int]:
        """Why no frame begins there, or "", its head and its size as far as they are known."""
        buffer = self.kept
        left = len(buffer) - at
        if buffer[at] != PREAMBLE or (left > 1 and buffer[at + 1] not in BUS_IDS):
            return NO_START, 0, 0
        if left < 4 or buffer[at + 3] != EXTENDED:
            return "", 4, 5 + (buffer[at + 3] if left > 3 else 0)
        length = int.from_bytes(buffer[at + 4 : at + 6], "big") if left > 5 else 0
        if left > 5 and not MIN_EXTENDED <= length <= MAX_EXTENDED:
            return "bad extended length", 0, 0
        return "", 6, 7 + length

    def _reject(self, reason: str, junk: bytearray, now_s: float) -> list[BadFrame]:
        """Keep bytes that belong to no frame; what became too much of them is told."""
        told = []
        while junk:
            if not self._junk:
                self._junk_reason, self._junk_s = reason, now_s
            room = MAX_JUNK - len(self._junk)
            self._junk += junk[:room]
            junk, reason = junk[room:], NO_START
            if len(self._junk) == MAX_JUNK:
                told += self._told_junk()
        return told

    def _told_junk(self) -> list[BadFrame]:
        junk, self._junk = bytes(self._junk), bytearray()
        return [BadFrame(self._junk_reason, junk)]

    def _arrived_s(self, end: int) -> float:
        """When the byte before this place of the buffer was read; places only go forward."""
        while self._arrivals[0][0] < self._taken + end:
            self._arrivals.popleft()
        return self._arrivals[0][1]


class MtConfiguration(Struct, frozen=True):
    """What is used of the 118 bytes of Configuration."""

    period: int  # 1/115200 s
    skip: int
    output_mode: int
    output_settings: int
    firmware: tuple[int, int, int]

    @property
    def rate_hz(self) -> float:
        """Messages a second; 0.0 where only requests bring one, or nothing is said."""
        if not self.period or self.skip == 0xFFFF:
            return 0.0
        return 115200 / (self.period * (self.skip + 1))


def maybe_configuration(data: bytes) -> MtConfiguration | None:
    """The data of Configuration; None where it has not 118 bytes."""
    if len(data) != CONFIGURATION_BYTES:
        return None
    period, skip = struct.unpack_from(">HH", data, 4)
    mode, settings = struct.unpack_from(">HI", data, 104)
    return MtConfiguration(period, skip, mode, settings, (data[112], data[113], data[114]))
