"""SCIP 2.0 as a scanner hears and speaks it: requests out of a stream, numbers, lines, replies.

Source: urg04lx sheet, sections 3 to 5.
"""

import re
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

I32 = npt.NDArray[np.int32]
Carried = tuple[bytes, list[bytes]]  # status of a reply, and its lines with their sums

OK, DATA, RESUMED, LASER_OFF = b"00", b"99", b"98", b"10"
BUFFER, TOO_FEW, UNDEFINED = b"0B", b"0C", b"0E"
LONG_TEXT, BAD_TEXT, UPDATING = b"0G", b"0H", b"0I"
SWITCH = b"SCIP2.0"
LINE = 64  # characters of data before a sum
MOST_REQUEST = 80  # bytes that its buffer holds; no request is near it
TEXT = re.compile(rb"[A-Za-z0-9 ._+@]*")
MOST_TEXT = 16
END = re.compile(rb"[\r\n]")
SCANS = {b"GD": 3, b"GS": 2, b"MD": 3, b"MS": 2}  # characters of a value

SIZES = {  # digits of parameters
    **dict.fromkeys((b"VV", b"PP", b"II", b"BM", b"QT", b"RS", b"%ST", b"RB"), 0),
    **dict.fromkeys((b"GD", b"GS"), 10),
    **dict.fromkeys((b"MD", b"MS"), 13),
    **dict.fromkeys((b"TM", b"HS"), 1),
    **dict.fromkeys((b"CR", b"DB"), 2),
    b"SS": 6,
}


class StatusError(Exception):
    """A request that gets this status, and no data."""

    def __init__(self, status: bytes) -> None:
        super().__init__(status.decode("latin-1"))
        self.status = status


@dataclass(frozen=True, slots=True)
class Request:
    """One line of the host: `MD0044072501000;left` is MD, its digits, and the text from ";" on."""

    whole: bytes
    command: bytes
    parameters: bytes
    text: bytes


def request(line: bytes) -> Request:
    head, mark, text = line.partition(b";")
    size = 3 if head.startswith(b"%") else 2
    return Request(line, head[:size], head[size:], mark + text)


def check_form(one: Request) -> None:
    """Of a request whose command there is: its text, then how many digits it has.

    Raises:
        StatusError: not as they must be.
    """
    if len(one.text) > 1 + MOST_TEXT:
        raise StatusError(LONG_TEXT)
    if not TEXT.fullmatch(one.text[1:]):
        raise StatusError(BAD_TEXT)
    missing = SIZES[one.command] - len(one.parameters)
    if missing:
        raise StatusError(TOO_FEW if missing > 0 else UNDEFINED)


def check_sum(line: bytes) -> bytes:
    """The character behind a line.

    >>> check_sum(b"00"), check_sum(b"MODL:URG-04LX(Hokuyo Automatic Co.,Ltd.)")
    (b'P', b'N')
    """
    return bytes([(sum(line) & 0x3F) + 0x30])


def summed(line: bytes) -> bytes:
    return line + check_sum(line)


def told(text: str) -> bytes:
    """A line of VV, PP or II: its ";" is not part of the sum."""
    line = text.encode("ascii")
    return line + b";" + check_sum(line)


def message(echo: bytes, status: bytes, lines: list[bytes]) -> bytes:
    """A whole reply; the lines bring their own sums."""
    return b"\n".join([echo, summed(status), *lines]) + b"\n\n"


def number(value: int, width: int) -> bytes:
    """So many characters of 6 bits.

    >>> number(1234, 2), number(5432, 3), number(16000000, 4)
    (b'CB', b'1Dh', b'm2@0')
    """
    return bytes((value >> 6 * k & 0x3F) + 0x30 for k in reversed(range(width)))


def data_lines(values: I32, width: int) -> list[bytes]:
    """Values (n,) as the lines of a scan; what two characters can't say is their largest."""
    shifts = 6 * np.arange(width)[::-1]
    kept = np.minimum(values, (1 << 6 * width) - 1)
    text = ((kept[:, None] >> shifts & 0x3F) + 0x30).astype(np.uint8).tobytes()
    return [summed(text[at : at + LINE]) for at in range(0, len(text), LINE)]


def clustered(values: I32, count: int, lowest: int) -> I32:
    """The least of each `count` neighbours (n,); below `lowest` are errors, which are left out."""
    if count <= 1:
        return values
    far = np.iinfo(np.int32).max
    padded = np.full(-(-len(values) // count) * count, far, np.int32)
    padded[: len(values)] = values
    groups = padded.reshape(-1, count)
    least = np.where(groups >= lowest, groups, far).min(1)
    none: I32 = np.where(least < far, least, groups.min(1)).astype(np.int32)
    return none


class RequestReader:
    """Takes the host's stream cut anywhere; gives its lines without their ends, no empty ones."""

    def __init__(self) -> None:
        self._buffer = bytearray()

    def feed(self, data: bytes) -> list[bytes]:
        self._buffer += data
        *lines, rest = END.split(bytes(self._buffer))
        self._buffer = bytearray(rest[: MOST_REQUEST + 1])
        return [line[: MOST_REQUEST + 1] for line in lines if line]
