"""Roboteq AX3500 bytes to lines, lines to numbers, queries to bytes. No I/O, no clock, no logging.

Nothing here moves a motor, writes a parameter or resets the controller.
Source: AX3500 sheet, sections 1, 2, 4, 5 and 7. ASCII, 7 bits, CR ends a line in both directions.
"""

import re
from functools import cache

from msgspec import Struct

from hw.device import BadFrame

CR = b"\r"
CHARACTER_S = 10 / 9600  # start, 7 bits, parity, stop
MAX_LINE = 64  # no line of the device is longer
SEVEN_BITS = bytes(byte & 0x7F for byte in range(256))  # a pty passes the bit that was the parity's
LEFT_OUT = b"\0\x80\n\x8a"  # NUL and LF
PARTS = re.compile(r"[^\rW]+|\r|W")  # of what has come
READ_COUNTER = ("?Q0", "?Q1")  # absolute, channel 1 and 2: a lost reply loses no travel
READ_IDENTITY = "^8A"
ENCODER_BIT = 0x20  # of the identity
QUERY = re.compile(r"\?[VAPRMEIKDZ]|\?Q[0-2]|\^[0-9A-F]{2}")  # nothing that changes anything

COUNTER = re.compile(r"[0-9A-Fa-f]{1,8}")
BYTE = re.compile(r"[0-9A-Fa-f]{2}")
HALF, TURN = 2**31, 2**32
ROLLOVER_ZONE = 10**6  # counts from either end within which "rolls over to zero" is believed

BATTERY_V, INTERNAL_V = 55.0 / 256, 28.5 / 256  # a step of `?E`, first and second value
# thermistor bytes from -40 C up, one each 5 C (section 7)
THERMISTOR = (
    *(248, 246, 243, 240, 235, 230, 224, 217, 208, 199, 188, 177, 165, 153, 140, 128, 116, 104, 93),
    *(83, 74, 65, 58, 51, 45, 40, 35, 31, 27, 24, 21, 19, 17, 15, 13, 12, 11, 9, 8),
)


class Line(Struct, frozen=True):
    """What stood between two CR, without `W`, NUL and LF; never empty."""

    text: str
    began_s: float  # host clock, when its first character came: read, or so long before its end


class WatchdogStop(Struct, frozen=True):
    """A `W`: for 1 s nothing that we sent has reached the controller; it stopped the motors."""


WATCHDOG_STOP = WatchdogStop()


class LineParser:
    """Takes a stream cut anywhere; gives Line, WatchdogStop, BadFrame; keeps less than a line."""

    def __init__(self) -> None:
        self._text, self._began_s = "", 0.0
        self._too_long = False  # dropping until the next CR

    def feed(self, now_s: float, data: bytes) -> list[Line | WatchdogStop | BadFrame]:
        events: list[Line | WatchdogStop | BadFrame] = []
        text = data.translate(SEVEN_BITS, LEFT_OUT).decode("ascii")
        for part in PARTS.findall(text):
            if part == "W":
                events.append(WATCHDOG_STOP)
            elif part == "\r":
                line, is_rest, self._text, self._too_long = self._text, self._too_long, "", False
                if line and is_rest:
                    events.append(BadFrame("end of a line that was too long", line.encode("ascii")))
                elif line and line.isprintable():
                    began_s = min(self._began_s, now_s - len(line) * CHARACTER_S)
                    events.append(Line(line, began_s))
                elif line:
                    events.append(BadFrame("line with control characters", line.encode("ascii")))
            else:
                self._began_s = self._began_s if self._text else now_s
                self._text += part
                while len(self._text) > MAX_LINE:
                    head, self._text = self._text[: MAX_LINE + 1], self._text[MAX_LINE + 1 :]
                    events.append(BadFrame("line without an end", head.encode("ascii")))
                    self._too_long = True
        return events


@cache  # some 270 are legal, the others are not kept
def encode_query(query: str) -> bytes:
    """A query that only reads; anything else is refused with ValueError.

    >>> encode_query("?Q0")
    b'?Q0\\r'
    """
    if not QUERY.fullmatch(query):
        raise ValueError(f"query: one that only reads, given {query!r}")
    return query.encode("ascii") + CR


def maybe_counter(text: str) -> int | None:
    """A counter from its shortened hexadecimal form; None where the line is damaged (section 5).

    >>> maybe_counter("0FA"), maybe_counter("F15"), maybe_counter("123456789")
    (250, -235, None)
    """
    if not COUNTER.fullmatch(text):
        return None
    number = int(text, 16)
    return number - 16 ** len(text) if int(text[0], 16) >= 8 else number


def maybe_byte(text: str) -> int | None:
    """0..255 from exactly two digits."""
    return int(text, 16) if BYTE.fullmatch(text) else None


def wrap_difference(new: int, old: int) -> int:
    """Counts from old to new, the short way round the 32-bit circle."""
    return (new - old + HALF) % TURN - HALF


def maybe_rollover(new: int, old: int) -> int | None:
    """Counts from old to new if the counter passed an end and went on from zero, else None."""
    if abs(old) <= HALF - ROLLOVER_ZONE or abs(new) >= ROLLOVER_ZONE:
        return None
    return new + HALF - old if old > 0 else new - 1 - HALF - old


def celsius_from_thermistor(value: int) -> float:
    """Heat sink temperature (`?M`), -40 to 150; linear between the table's points."""
    if value >= THERMISTOR[0]:
        return -40.0
    for k, (warm, cool) in enumerate(zip(THERMISTOR[1:], THERMISTOR, strict=False)):
        if value >= warm:
            return -40.0 + 5.0 * (k + (cool - value) / (cool - warm))
    return 150.0
