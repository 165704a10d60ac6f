"""The bytes of hw/ports' cameras to whole images. No I/O, no clock.

    --mapod-image | Content-Length: n | X-Timestamp: s.us | Content-Type: t | X-Number: k |
    empty line | n bytes | CR LF

Lines end with CR LF, and come in any order; only the length must be there. What comes before a
boundary is an answer's head or damage; only what does not belong to that head is told.
"""

import re

from msgspec import Struct

from hw.device import BadFrame

MARK = b"--mapod-image\r\n"
HEAD = re.compile(rb"HTTP/1\.0 200 OK\r\n[^\r\n]{1,200}\r\n\r\n")  # of the answer
MOST_HEAD = 512  # bytes of a part's headers, or of the answer's
END = b"\r\n\r\n"
FIELD = re.compile(rb"([A-Za-z-]{1,40}): ([ -~]{1,100})")
STAMP = re.compile(r"(\d{1,12})\.(\d{6})", re.ASCII)
SHOWN = 64  # bytes of what is refused, which are kept for a person


class Part(Struct, frozen=True):
    """One image, or what is said of the lens, as it came."""

    data: bytes
    kind: str  # "": it does not tell
    stamp_s: float | None  # its time by the host's monotonic clock; None: it does not tell
    number: int  # of the camera's frames; -1: it does not tell
    began_s: float  # host clock, when its first bytes were read
    arrived_s: float  # and its last


def maybe_stamp_s(text: str) -> float | None:
    """Seconds, of a header's text.

    >>> maybe_stamp_s("12.500000")
    12.5
    """
    found = STAMP.fullmatch(text)
    return None if found is None else (int(found[1]) * 1_000_000 + int(found[2])) / 1e6


def fields_of(head: bytes) -> dict[str, str]:
    """A part's headers by their names in small letters; lines that are none are left out."""
    found = (FIELD.fullmatch(line) for line in head.split(b"\r\n"))
    return {one[1].decode().lower(): one[2].decode() for one in found if one is not None}


def _whole(text: str) -> int:
    """A number that is not negative; -1: it is none."""
    return int(text) if text.isdecimal() and text.isascii() and len(text) <= 15 else -1


class PartsParser:
    """Takes a stream cut anywhere; finds its way back after damage at the next boundary.

    Args:
        most_bytes: of a part; bounds what a damaged length can make us wait for.
    """

    def __init__(self, most_bytes: int) -> None:
        self._most, self._buffer = most_bytes, bytearray()
        self._began_s = 0.0
        self._maybe_fields: dict[str, str] | None = None  # of the part that is coming in
        self._length = 0  # of that

    def feed(self, now_s: float, data: bytes) -> list[Part | BadFrame]:
        if not self._buffer:
            self._began_s = now_s
        self._buffer += data
        events = list[Part | BadFrame]()
        while self._buffer and self._advance(now_s, events):
            pass
        return events

    def _advance(self, now_s: float, events: list[Part | BadFrame]) -> bool:
        """One step on; False: more bytes are needed."""
        if self._maybe_fields is not None:
            return self._take_part(now_s, events)
        at = self._buffer.find(MARK)
        if at != 0:
            if at < 0:
                at = len(self._buffer) - len(MARK) + 1
                if at <= MOST_HEAD:  # it may be the answer's head
                    return False
            before = bytes(self._buffer[:at])
            if not HEAD.fullmatch(before):
                events.append(BadFrame("bytes before a boundary", before))
            del self._buffer[:at]
            self._began_s = now_s
            return True
        end = self._buffer.find(END, 0, MOST_HEAD)
        if end < 0:
            if len(self._buffer) < MOST_HEAD:
                return False
            return self._skip(now_s, events, "a part without an end of its headers")
        fields = fields_of(bytes(self._buffer[len(MARK) : end]))
        self._length = _whole(fields.get("content-length", ""))
        if not 0 < self._length <= self._most:
            return self._skip(now_s, events, "a part whose length is missing, or can't be")
        del self._buffer[: end + len(END)]
        self._maybe_fields = fields
        return True

    def _take_part(self, now_s: float, events: list[Part | BadFrame]) -> bool:
        fields, length = self._maybe_fields, self._length
        assert fields is not None
        if len(self._buffer) < length + 2:
            return False
        self._maybe_fields = None
        if self._buffer[length : length + 2] != b"\r\n":
            self._skip(now_s, events, "a part that does not end where it says", 0)
            return True
        data, number = bytes(self._buffer[:length]), _whole(fields.get("x-number", ""))
        stamp_s = maybe_stamp_s(fields.get("x-timestamp", ""))
        kind = fields.get("content-type", "")
        events.append(Part(data, kind, stamp_s, number, self._began_s, now_s))
        del self._buffer[: length + 2]
        self._began_s = now_s
        return True

    def _skip(
        self, now_s: float, events: list[Part | BadFrame], reason: str, begin: int = 1
    ) -> bool:
        """Drop all before the next boundary that may be one."""
        at = self._buffer.find(MARK, begin)
        at = at if at >= 0 else max(begin, len(self._buffer) - len(MARK) + 1)
        events.append(BadFrame(reason, bytes(self._buffer[:at][:SHOWN])))
        del self._buffer[:at]
        self._began_s = now_s
        return True
