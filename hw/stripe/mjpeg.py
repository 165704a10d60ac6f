"""MJPEG over HTTP: the bytes of a camera's answer to whole JPEG images. No I/O, no clock.

    HTTP/1.0 200 OK | Content-Type: multipart/x-mixed-replace; boundary=B | empty line
    --B | Content-Type: image/jpeg | Content-Length: n | empty line | n bytes | --B | ...

A part without Content-Length ends where the next boundary begins. Some cameras tell of each image
when it was exposed, by a clock of their own: `X-Timestamp: 1700000000.123456`. Cameras differ:
lines may end with LF alone, the boundary that is told may have its two hyphens already. One that
begins with two may also be right: then two more precede it, and the first delimiter shows which.
Images are not decoded here; one whose end mark is missing is damaged. Chunked answers are refused:
HTTP/1.0 has none.
Source: RFC 2046, section 5.1.1; RFC 9112; ITU-T T.81, annex B.
"""

import re

from msgspec import Struct

from hw.device import BadFrame

MOST_HEAD = 8192  # bytes of the headers of an answer, or of a part
HEAD_END = re.compile(rb"\r?\n\r?\n")
STATUS = re.compile(rb"HTTP/1\.[01] (\d{3})([^\r\n]*)")
BOUNDARY = re.compile(rb"multipart/[\w-]+\s*;.*?boundary=\"?([^\s\";,]{1,70})", re.IGNORECASE)
LENGTH = re.compile(rb"^content-length:[ \t]*(\d{1,10})[ \t]*\r?$", re.IGNORECASE | re.MULTILINE)
STAMP = re.compile(
    rb"^x-timestamp:[ \t]*(\d{1,12})(?:\.(\d{1,9}))?[ \t]*\r?$", re.IGNORECASE | re.MULTILINE
)
CHUNKED = re.compile(rb"^transfer-encoding:[ \t]*chunked", re.IGNORECASE | re.MULTILINE)
BEGIN, END = b"\xff\xd8", b"\xff\xd9"  # of a JPEG
SIZES = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}  # markers of segments that tell it


class StreamBegun(Struct, frozen=True):
    """The camera answers, and images follow."""


class Refused(Struct, frozen=True):
    """The camera answers, and none will follow."""

    why: str


class Jpeg(Struct, frozen=True):
    """A whole image, as bytes."""

    data: bytes
    began_s: float  # when its part's first bytes came, behind the boundary
    arrived_s: float  # and its last
    stamp_us: int | None = None  # its exposure by the camera's clock; None: not told


Event = StreamBegun | Refused | Jpeg | BadFrame


def encode_request(host: str, path: str) -> bytes:
    """Asks for the stream. HTTP/1.0: so nobody answers in chunks."""
    return (
        f"GET {path} HTTP/1.0\r\nHost: {host}\r\nUser-Agent: mapod\r\n"
        "Accept: multipart/x-mixed-replace\r\n\r\n"
    ).encode("ascii", "replace")


def maybe_size(jpeg: bytes) -> tuple[int, int] | None:
    """Width and height that a JPEG tells of itself, in pixels."""
    at = 2
    while at + 9 <= len(jpeg) and jpeg[at] == 0xFF:
        marker = jpeg[at + 1]
        if marker == 0xFF:  # filling
            at += 1
            continue
        if marker in SIZES:
            size = int.from_bytes(jpeg[at + 7 : at + 9], "big")
            return size, int.from_bytes(jpeg[at + 5 : at + 7], "big")
        at += 2 + int.from_bytes(jpeg[at + 2 : at + 4], "big")
    return None


def maybe_stamp_us(head: bytes) -> int | None:
    """What a part's headers tell of its time, microseconds.

    >>> maybe_stamp_us(b"X-Timestamp: 12.5")
    12500000
    """
    found = STAMP.search(head)
    if found is None:
        return None
    return int(found[1]) * 1_000_000 + int((found[2] or b"").ljust(6, b"0")[:6])


def fault_of(image: bytes) -> str:
    """Why a part's bytes are no whole JPEG; "" if they seem to be one."""
    if not image.startswith(BEGIN):
        return "a part is no JPEG"
    return "" if image.endswith(END) else "a JPEG without its end"


class MjpegParser:
    """Takes a stream cut anywhere; finds its way back after damage at the next boundary.

    Args:
        most_bytes: of an image; bounds what a damaged length can make us wait for.
    """

    def __init__(self, most_bytes: int) -> None:
        self._most, self._buffer = most_bytes, bytearray()
        self._searched = 0  # bytes of it that hold no end of what is awaited
        self._mark = b""  # what begins a part; none before the answer's head
        self._told = b""  # which may be the mark as it is, until the first one is seen
        self._is_in_part = self._is_refused = False
        self._length: int | None = None  # of the part
        self._stamp_us: int | None = None
        self._began_s = 0.0

    def feed(self, now_s: float, data: bytes) -> list[Event]:
        if not self._is_in_part and self._buffer.strip() in (b"", self._mark):
            self._began_s = now_s  # some send the boundary right behind the image before
        self._buffer += data
        events: list[Event] = []
        while self._buffer and not self._is_refused:
            before = len(self._buffer), self._is_in_part, bool(self._mark)
            if not self._mark:
                event = self._answer()
            elif self._is_in_part:
                event = self._part(now_s)
            else:
                event = self._part_head(now_s)
            if event is not None:
                events.append(event)
            elif before == (len(self._buffer), self._is_in_part, bool(self._mark)):
                break
        if self._is_refused:
            self._buffer.clear()
        return events

    def _drop(self, count: int, reason: str) -> BadFrame:
        dropped = bytes(self._buffer[:count])
        del self._buffer[:count]
        self._searched, self._is_in_part = 0, False
        return BadFrame(reason, dropped)

    def _find(self, what: bytes) -> int:
        """Where it begins, from where it was not searched yet; -1: not there."""
        at = self._buffer.find(what, self._searched)
        self._searched = max(0, len(self._buffer) - len(what) + 1) if at < 0 else at
        return at

    def _maybe_head(self) -> bytes | None:
        """Headers up to an empty line, taken from the buffer."""
        found = HEAD_END.search(self._buffer, max(0, self._searched - 3))
        if found is None or found.end() > MOST_HEAD:
            self._searched = len(self._buffer)
            return None
        head = bytes(self._buffer[: found.start()])
        del self._buffer[: found.end()]
        self._searched = 0
        return head

    def _answer(self) -> Event | None:
        """The head of the answer, once it is whole."""
        head = self._maybe_head()
        if head is None:
            return self._overlong("no end of the answer's headers")
        status, boundary = STATUS.match(head.lstrip()), BOUNDARY.search(head)
        if status is None:
            self._is_refused = True
            return Refused("what answers is no web camera")
        if status[1] != b"200":
            self._is_refused = True
            said = (status[1] + status[2]).decode("latin-1")
            return Refused(f"the camera refuses the stream: {said[:80]!r}")
        if boundary is None:
            self._is_refused = True
            return Refused("the camera answers with something else than a stream of images")
        if CHUNKED.search(head):
            self._is_refused = True
            return Refused("the camera answers in chunks, which HTTP/1.0 does not know")
        self._mark = b"--" + boundary[1]
        self._told = boundary[1] if boundary[1].startswith(b"--") else b""
        return StreamBegun()

    def _settle_mark(self) -> None:
        """By the first one: with two hyphens more than it was told, or without."""
        at = self._buffer.find(self._told)
        if at >= 0:
            is_longer = self._buffer[:at].endswith(b"--")
            self._mark, self._told = self._mark if is_longer else self._told, b""
            self._searched = 0

    def _overlong(self, reason: str) -> BadFrame | None:
        """Headers that do not end are dropped, but for what may begin the next part."""
        if len(self._buffer) <= MOST_HEAD:
            return None
        again = self._buffer.find(self._mark, 1) if self._mark else -1
        return self._drop(again if again > 0 else len(self._buffer) - len(self._mark), reason)

    def _part_head(self, now_s: float) -> Event | None:
        """Up to the part's bytes: the boundary, then its headers."""
        if self._told:
            self._settle_mark()
        if not self._buffer.startswith(self._mark):
            at = self._find(self._mark)
            if at < 0:
                rest = len(self._buffer) - len(self._mark)
                return self._drop(rest, "no boundary") if rest > MOST_HEAD else None
            if bytes(self._buffer[:at]).strip():
                return self._drop(at, "bytes before a boundary")
            del self._buffer[:at]
            self._searched = 0
            self._began_s = now_s
        head = self._maybe_head()
        if head is None:
            return self._overlong("no end of a part's headers")
        found = LENGTH.search(head)
        self._length = int(found[1]) if found else None
        self._stamp_us = maybe_stamp_us(head)
        self._is_in_part = True
        if self._length is not None and not 0 < self._length <= self._most:
            self._is_in_part = False
            return BadFrame("a part's length that can't be", head)
        return None

    def _part(self, now_s: float) -> Event | None:
        """The part's bytes, once they are whole."""
        if self._length is None:
            size = self._find(self._mark)
            if size < 0 and len(self._buffer) <= self._most + len(self._mark):
                return None
            if not 0 <= size <= self._most:
                rest = len(self._buffer) - len(self._mark)
                return self._drop(size if size >= 0 else rest, "an image without an end")
        elif len(self._buffer) >= self._length:
            size = self._length
        else:
            return None
        image = bytes(self._buffer[:size]).rstrip(b"\r\n\0")  # some fill it up
        if why := fault_of(image):
            inside = self._buffer.find(self._mark, 0, size + len(self._mark))
            return self._drop(inside if inside >= 0 else size, why)
        del self._buffer[:size]
        self._searched, self._is_in_part = 0, False
        began_s, self._began_s = self._began_s, now_s
        return Jpeg(image, began_s, now_s, self._stamp_us)
