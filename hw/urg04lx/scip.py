"""SCIP 2.0 messages: a Hokuyo scanner's stream to replies, and numbers in its characters. No I/O.

A reply is the echo of its request, a status with its sum, lines of data with theirs, and an empty
line, the only place where LF LF occurs. So after damage, or in the midst of a stream, the next
reply begins behind the next LF LF; where that is lost too, at the last echo with a status behind
it. A reply of SCIP 1.1 has a status of one character and no sum.
Source: urg04lx sheet, sections 3 and 4.
"""

import contextlib
import re

import numpy as np
from msgspec import Struct

from core.records import F64
from hw.device import BadFrame

END = b"\n\n"
MOST_BYTES = 8192  # of a reply: a scan of 1440 points with intensities is less
LINE_BYTES = 64  # of data, before their sum
LEAST_CHARACTER, BITS = 0x30, 6
INCOMPLETE_S = 2.5  # a reply that takes longer is none: a full scan takes 1.1 s at 19200 baud
STATUS, STATUS1 = re.compile(rb"[0-9A-I]{2}"), re.compile(rb"[0-9A-Z]")  # of SCIP 2.0; of 1.1
COMMAND, TEXT = rb"(%?[A-Z]{2}[0-9]*|SCIP2\.0)", rb"(?:;[A-Za-z0-9 ._+@]{1,16})?"
REQUEST = re.compile(COMMAND + TEXT)
# An echo with its status, which may stand behind the torn line of another reply.
BEGIN = re.compile(COMMAND + TEXT + rb"\n[0-9A-I]{2}[0-o]\n")


class Reply(Struct, frozen=True):
    """What a device answers, or sends unasked: checked, but for the echo, which has no sum."""

    command: str  # the request, without what follows ";"
    status: str  # two characters; one: of SCIP 1.1
    lines: tuple[bytes, ...]  # without their sums
    arrived_s: float  # host clock
    size: int  # bytes on the wire

    @property
    def data(self) -> bytes:
        """What lines after the first carry, which may cut a number in two."""
        return b"".join(self.lines[1:])


class ScipError(Exception):
    """A reply that can't be what it says; the text says why."""


def encode_request(command: str) -> bytes:
    """A request, without a text of its own."""
    return command.encode("ascii") + b"\n"


def sum_of(text: bytes) -> int:
    """The character that ends a line: the low six bits of the sum of what is before it."""
    return (sum(text) & 0x3F) + LEAST_CHARACTER


def number_in(text: bytes) -> int:
    """A number in groups of six bits, the most significant first.

    >>> number_in(b"CB"), number_in(b"1Dh"), number_in(b"m2@0")
    (1234, 5432, 16000000)

    Raises:
        ScipError: a character that no group has.
    """
    value = 0
    for character in text:
        group = character - LEAST_CHARACTER
        if not 0 <= group < 1 << BITS:
            raise ScipError(f"{text!r} is no number")
        value = value << BITS | group
    return value


def numbers_in(data: bytes, characters: int) -> F64:
    """Numbers (n,) of two or three characters each.

    Raises:
        ScipError: a character that no group has, or a number cut short.
    """
    groups = np.frombuffer(data, np.uint8) - np.uint8(LEAST_CHARACTER)  # what is less wraps
    if groups.size % characters:
        raise ScipError("data that end within a number")
    if groups.size and groups.max() >= 1 << BITS:
        raise ScipError("data with characters that no number has")
    values = groups[0::characters].astype(np.float64)
    for k in range(1, characters):
        values *= 1 << BITS
        values += groups[k::characters]
    return values


def _checked_line(line: bytes) -> bytes:
    """A line without its sum, of which a ";" at the end may be a part or not."""
    text = line[:-1]
    if line and line[-1] == sum_of(text):
        return text
    if text.endswith(b";") and line[-1] == sum_of(text[:-1]):
        return text
    raise ScipError("wrong sum")


def reply_in(message: bytes, arrived_s: float) -> Reply:
    """The reply that a message is, given without its LF LF.

    Raises:
        ScipError: no echo of a request, no status, or a wrong sum.
    """
    echo, *lines = message.split(b"\n")
    found = REQUEST.fullmatch(echo)
    if found is None or not lines:
        raise ScipError("no reply")
    command, size = found[1].decode("ascii"), len(message) + len(END)
    if len(lines) == 1 and STATUS1.fullmatch(lines[0]):
        return Reply(command, lines[0].decode("ascii"), (), arrived_s, size)
    status, *data = map(_checked_line, lines)
    if STATUS.fullmatch(status) is None:
        raise ScipError("no status")
    return Reply(command, status.decode("ascii"), tuple(data), arrived_s, size)


def events_in(message: bytes, arrived_s: float) -> list[Reply | BadFrame]:
    """What a message is: a reply, or a BadFrame and the whole reply at its end, if there is one."""
    try:
        return [reply_in(message, arrived_s)]
    except ScipError as error:
        why = str(error)
    begins = [found.start() for found in BEGIN.finditer(message + b"\n")]
    if begins and begins[-1] > 0:
        with contextlib.suppress(ScipError):
            reply = reply_in(message[begins[-1] :], arrived_s)
            return [BadFrame(why, message[: begins[-1]]), reply]
    return [BadFrame(why, message)]


class ScipParser:
    """Takes a stream cut anywhere; what is no reply up to the next one is one BadFrame."""

    def __init__(self) -> None:
        self._buffer = b""
        self._begun_s = 0.0  # when the first byte of it came

    def feed(self, now_s: float, data: bytes) -> list[Reply | BadFrame]:
        events: list[Reply | BadFrame] = []
        if self._buffer and now_s - self._begun_s > INCOMPLETE_S:
            events.append(BadFrame("reply never completed", self._buffer))
            self._buffer = b""
        if not self._buffer:
            self._begun_s = now_s
        searched = max(0, len(self._buffer) - 1)
        self._buffer += data
        while (end := self._buffer.find(END, searched)) >= 0:
            message, self._buffer = self._buffer[:end], self._buffer[end + len(END) :]
            self._begun_s, searched = now_s, 0
            message = message.lstrip(b"\n")
            if message:
                events += events_in(message, now_s)
        if len(self._buffer) > MOST_BYTES:
            events.append(BadFrame("no end of a reply", self._buffer))
            self._buffer = b""
        return events
