"""CoLa-B frames: the stream of a SICK scanner to payloads, payloads to frames. No I/O, no clock.

Frame: 02 02 02 02 | length u32 | payload | XOR of the payload; big-endian. Refuses CoLa-A (text).
Source: lms111 sheet, section 2.
"""

import re
from collections.abc import Callable
from typing import Generic, TypeVar

import numpy as np

from hw.session import BadFrame

Event = TypeVar("Event")

START = b"\x02\x02\x02\x02"
HEAD_SIZE = 8
MAX_PAYLOAD = 0x4FFF  # four 16-bit channels of 2000 points are less
# What can be a frame's first bytes: start, a length up to MAX_PAYLOAD, the `s` of all telegrams.
HEAD = re.compile(rb"\x02{4}\x00\x00[\x00-\x4f].s", re.DOTALL)
HEAD_CUT = re.compile(rb"\x02(\x02(\x02(\x02(\x00(\x00([\x00-\x4f].?)?)?)?)?)?)?\Z", re.DOTALL)
INCOMPLETE_S = 0.5  # a frame that takes longer was none: its length is not to be believed
REPORTED_SIZE = 4096  # junk is told at the latest when so much has come


class PayloadError(Exception):
    """A payload that can't be what its frame says; the text says why."""


def encode_frame(payload: bytes) -> bytes:
    """A payload with start, length and checksum around it."""
    return START + len(payload).to_bytes(4, "big") + payload + bytes([_xor(payload)])


def _xor(payload: bytes | bytearray) -> int:
    return int(np.bitwise_xor.reduce(np.frombuffer(payload, np.uint8), initial=0))


class ColaParser(Generic[Event]):
    """Takes a stream cut anywhere; finds its way back after damage; keeps less than one frame.

    `decode` makes an event of (now_s, payload), or raises PayloadError: then, as after a wrong
    checksum, the search goes on one byte further. All junk between two frames is one BadFrame.
    """

    def __init__(self, decode: Callable[[float, bytes], Event]) -> None:
        self._decode = decode
        self._buffer = bytearray()
        self._waiting_since_s: float | None = None  # for the rest of the frame at the front
        self._skipped, self._reason, self._skipped_s = bytearray(), "", 0.0

    def feed(self, now_s: float, data: bytes) -> list[Event | BadFrame]:
        """The events that these bytes complete."""
        self._buffer += data
        events: list[Event | BadFrame] = []
        if self._skipped and now_s - self._skipped_s >= INCOMPLETE_S:
            self._report(events)
        at = 0
        while True:
            head = HEAD.search(self._buffer, at)
            start = head.start() if head else self._junk_end(at)
            at = self._skip(now_s, at, start, "no telegram", events)
            if head is None:
                break
            size = int.from_bytes(self._buffer[at + 4 : at + HEAD_SIZE], "big")
            end = at + HEAD_SIZE + size + 1
            if end > len(self._buffer):
                if not self._is_overdue(now_s):
                    break
                at = self._skip(now_s, at, at + 1, "telegram never completed", events)
                continue
            self._waiting_since_s = None
            try:
                event = self._event(now_s, bytes(self._buffer[at + HEAD_SIZE : end]))
            except PayloadError as error:
                at = self._skip(now_s, at, at + 1, str(error), events)
                continue
            self._report(events)
            events.append(event)
            at = end
        del self._buffer[:at]
        return events

    def _event(self, now_s: float, rest: bytes) -> Event:
        """What a frame's payload and checksum say."""
        if _xor(rest) != 0:  # the payload with its own checksum
            raise PayloadError("wrong checksum")
        return self._decode(now_s, rest[:-1])

    def _is_overdue(self, now_s: float) -> bool:
        if self._waiting_since_s is None:
            self._waiting_since_s = now_s
        if now_s - self._waiting_since_s < INCOMPLETE_S:
            return False
        self._waiting_since_s = None
        return True

    def _junk_end(self, at: int) -> int:
        """Where the bytes begin that may be the start of a frame cut short, after `at`."""
        cut = HEAD_CUT.search(self._buffer, max(at, len(self._buffer) - HEAD_SIZE))
        return cut.start() if cut else len(self._buffer)

    def _skip(
        self, now_s: float, at: int, end: int, reason: str, events: list[Event | BadFrame]
    ) -> int:
        """Take the bytes up to `end` as junk; returns `end`."""
        while at < end:
            if not self._skipped:
                self._reason, self._skipped_s = reason, now_s
            taken = min(end - at, REPORTED_SIZE - len(self._skipped))
            self._skipped += self._buffer[at : at + taken]
            at += taken
            if len(self._skipped) >= REPORTED_SIZE:
                self._report(events)
        return end

    def _report(self, events: list[Event | BadFrame]) -> None:
        if self._skipped:
            events.append(BadFrame(self._reason, bytes(self._skipped)))
            self._skipped.clear()
