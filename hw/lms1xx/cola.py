"""CoLa telegrams, binary (B) and text (A): a SICK scanner's stream to payloads and back. No I/O.

CoLa-B: 02 02 02 02 | length u32 | payload | XOR of the payload; big-endian.
CoLa-A: 02 | payload | 03; text has no checksum, so a digit altered into another is not noticed.
Source: lms111 sheet, section 2.
"""

import re
from collections.abc import Callable
from typing import Generic, Literal, TypeVar

import numpy as np

from hw.device import BadFrame

Event = TypeVar("Event")
Dialect = Literal["binary", "ascii"]
DialectSetting = Literal["auto", "binary", "ascii"]

START = b"\x02\x02\x02\x02"
HEAD_SIZE = 8
TEXT_START, TEXT_END = b"\x02", b"\x03"
MAX_PAYLOAD = 0x4FFF  # four 16-bit channels of 2000 points are less
MAX_TEXT = 0xFFFF  # the same in digits, and six channels of a sister model
# What can be a telegram's first bytes: start, a length up to MAX_PAYLOAD, the `s` of all telegrams;
# in text a type, or its beginning where the buffer ends. Each false head costs a telegram's time.
BINARY_HEAD = rb"\x02\x02\x02\x02\x00\x00[\x00-\x4f].s"
TEXT_HEAD = rb"\x02s(?:\Z|[A-Z](?:\Z|[A-Z](?:\Z| )))"
HEADS = {
    "binary": re.compile(BINARY_HEAD, re.DOTALL),
    "ascii": re.compile(TEXT_HEAD),
    "auto": re.compile(rb"(?:%b|%b)" % (TEXT_HEAD, BINARY_HEAD), re.DOTALL),
}
HEAD_CUT = re.compile(rb"\x02(\x02(\x02(\x02(\x00(\x00([\x00-\x4f].?)?)?)?)?)?)?\Z", re.DOTALL)
TEXT_STOP = re.compile(rb"[\x02\x03]")
INCOMPLETE_S = 0.5  # a telegram that takes longer was none: its length is not to be believed
REPORTED_SIZE = 4096  # junk is told at the latest when so much has come

_xor_of = np.bitwise_xor.reduce


class PayloadError(Exception):
    """A payload that can't be what its frame says; the text says why."""


def encode_frame(payload: bytes) -> bytes:
    """A payload with start, length and checksum around it: CoLa-B."""
    checksum = _xor_of(np.frombuffer(payload, np.uint8))
    return START + len(payload).to_bytes(4, "big") + payload + bytes([checksum])


def encode_text(payload: bytes) -> bytes:
    """A payload between its marks: CoLa-A."""
    return TEXT_START + payload + TEXT_END


class ColaParser(Generic[Event]):
    """Takes a stream cut anywhere; finds its way back after damage; keeps less than one telegram.

    `decode` makes an event of (now_s, payload, dialect), or raises PayloadError: then, as after a
    wrong checksum, the search goes on one byte further. All junk between two telegrams is one
    BadFrame. "auto" takes telegrams of either dialect as they come.
    """

    def __init__(
        self, decode: Callable[[float, bytes, Dialect], Event], dialect: DialectSetting = "binary"
    ) -> None:
        self._decode, self._head = decode, HEADS[dialect]
        self._buffer = b""
        self._searched = 0  # so much of the text at the front holds no mark: not looked at again
        self._waiting_since_s: float | None = None  # for the rest of the telegram at the front
        self._skipped, self._reason, self._skipped_s = bytearray(), "", 0.0

    def feed(self, now_s: float, data: bytes) -> list[Event | BadFrame]:
        self._buffer += data
        events: list[Event | BadFrame] = []
        if self._skipped and now_s - self._skipped_s >= INCOMPLETE_S:
            self._report(events)
            self._reason = ""
        at = 0
        while at < len(self._buffer):
            head = self._head.search(self._buffer, at)
            start = head.start() if head else self._junk_end(at)
            if at < start:
                at = self._skip(now_s, at, start, "no telegram", events)
            if head is None:
                break
            try:
                found = self._maybe_event(now_s, at)
                if found is None:
                    self._check_patience(now_s)
            except PayloadError as error:
                at = self._skip(now_s, at, at + 1, str(error), events)
                continue
            if found is None:
                break
            self._waiting_since_s, self._searched = None, 0
            if self._reason:
                self._report(events)
                self._reason = ""
            at, event = found
            events.append(event)
        self._buffer = self._buffer[at:]
        return events

    def _maybe_event(self, now_s: float, at: int) -> tuple[int, Event] | None:
        """The end of the telegram there, and its event; None while its rest is waited for."""
        if self._buffer[at + 1] != START[1]:
            stop = TEXT_STOP.search(self._buffer, at + max(1, self._searched))
            if stop is None:
                self._searched = len(self._buffer) - at
                if self._searched <= MAX_TEXT:
                    return None
            if stop is None or stop.group() != TEXT_END:
                raise PayloadError("telegram cut short")
            payload = self._buffer[at + 1 : stop.start()]
            return stop.end(), self._decode(now_s, payload, "ascii")
        size = int.from_bytes(self._buffer[at + 4 : at + HEAD_SIZE], "big")
        end = at + HEAD_SIZE + size + 1
        if end > len(self._buffer):
            return None
        if _xor_of(np.frombuffer(self._buffer, np.uint8, size + 1, at + HEAD_SIZE)):
            raise PayloadError("wrong checksum")  # over payload and checksum it is 0
        return end, self._decode(now_s, self._buffer[at + HEAD_SIZE : end - 1], "binary")

    def _check_patience(self, now_s: float) -> None:
        """For the rest of the telegram at the front, but not for ever."""
        if self._waiting_since_s is None:
            self._waiting_since_s = now_s
        if now_s - self._waiting_since_s >= INCOMPLETE_S:
            raise PayloadError("telegram never completed")

    def _junk_end(self, at: int) -> int:
        """Where the bytes begin that may be the start of a telegram cut short, after `at`."""
        cut = HEAD_CUT.search(self._buffer, max(at, len(self._buffer) - HEAD_SIZE))
        return cut.start() if cut else len(self._buffer)

    def _skip(
        self, now_s: float, at: int, end: int, reason: str, events: list[Event | BadFrame]
    ) -> int:
        """Take the bytes up to `end` as junk; returns `end`."""
        if at < end:  # what was at the front is no longer there
            self._waiting_since_s, self._searched = None, 0
        while at < end:
            if not self._skipped:
                self._skipped_s = now_s
            self._reason = self._reason or reason  # what spoiled the first telegram of a run
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
