"""The camera's stream: bytes to whole BLOBs, each a frame. No I/O, no clock.

    02 02 02 02 | length L u32 | 00 01 | 62 | id u16 | segments u16 |
    3 x (offset u32, change counter u32) | XML | binary | overlay | 45

Big-endian; the message is L + 9 bytes long, and offsets count from byte 11. The same four bytes 02
occur within depth data, so a start is believed only with all that must follow it.

A frame is copied once, to where it stays while it is looked at. There is room for two: one that is
whole and one that is coming in, so a frame is to be used before two more have come.
Source: visionary sheet, section 5.
"""

import re
import struct

from msgspec import Struct

from hw.device import BadFrame

HEAD = struct.Struct(">4xIHBHH6I")
START = re.compile(rb"\x02{4}\x00...\x00\x01b..\x00\x03\x00\x00\x00\x1c", re.DOTALL)
START_BYTES = 19  # of that pattern
FIRST, BASE = 28, 11  # the first offset; and from where offsets count
SEGMENTS, VERSION, TYPE, END = 3, 1, 0x62, 0x45
MOST_BYTES = 4 << 20  # of a message; the greatest known, of a Visionary-S, has 2.6 MB
MOST_SIZE = MOST_BYTES + 9  # with what its length does not count
MOST_XML = 1 << 16
SHOWN = 64  # bytes of what is refused, which are kept for a person
NO_END = "a message without its end"


class Blob(Struct, frozen=True):
    """A whole message: valid until the next one is whole."""

    data: memoryview  # all of it
    change: int  # counter of the XML
    xml: memoryview
    binary: memoryview
    began_s: float  # host clock, when its first bytes were read
    arrived_s: float  # and its last


def fault_of_head(head: bytes | bytearray) -> str:
    """Why 35 bytes at a start do not begin a message; "" if they do."""
    if head[:4] != b"\x02\x02\x02\x02":
        return "no start of a message"
    length, version, kind, _, segments, *places = HEAD.unpack_from(head)
    first, second, third = places[::2]
    if (version, kind) != (VERSION, TYPE):
        return f"a message of version {version}, type {kind:02x}, not 1 and 62"
    if segments != SEGMENTS:
        return f"a message of {segments} segments, not {SEGMENTS}"
    if length > MOST_BYTES:
        return f"a message of {length} bytes, more than {MOST_BYTES}"
    if not FIRST == first < second < third < length - 2 or second - first > MOST_XML:
        return f"a message whose segments begin at {first}, {second}, {third} of {length}"
    return ""


class BlobParser:
    """Takes a stream cut anywhere; after damage it goes on at the next start that may be one.

    In the mean a byte is moved at most twice, whatever comes: what is left goes to the other buffer
    only when MOST_SIZE bytes have been looked at, and is no more than that.
    """

    def __init__(self) -> None:
        self._buffer, self._spare = bytearray(2 * MOST_SIZE), bytearray(2 * MOST_SIZE)
        self.begin()

    def begin(self) -> None:
        """A new connection: what has come of a frame is of no use."""
        self._at = self._end = 0  # in the buffer: what is not looked at yet
        self._size = 0  # bytes of the message that begins there, if known
        self._began_s = self._read_s = 0.0
        self._maybe_tail: bytes | None = None  # while a start is looked for: the newest bytes

    def feed(self, now_s: float, data: bytes) -> list[Blob | BadFrame]:
        """The frames that these bytes complete; an event where the stream ceases to be frames."""
        self._read_s, events = now_s, list[Blob | BadFrame]()
        given = memoryview(data)
        while given:
            if self._maybe_tail is not None:
                given = self._hunt(self._maybe_tail + given)
                continue
            if self._at == self._end:
                self._began_s = now_s
            wanted = self._wanted - (self._end - self._at)
            taken = given[:wanted]
            self._buffer[self._end : self._end + len(taken)] = taken
            self._end += len(taken)
            given = given[len(taken) :]
            if len(taken) == wanted:
                self._look(events)
        return events

    @property
    def _wanted(self) -> int:
        return self._size or HEAD.size

    def _hunt(self, window: bytes) -> memoryview:
        """From where a message may begin; nothing of it if none does."""
        found = START.search(window)
        if found is None:
            self._maybe_tail = window[1 - START_BYTES :]
            return memoryview(b"")
        self._maybe_tail = None
        return memoryview(window)[found.start() :]

    def _look(self, events: list[Blob | BadFrame]) -> None:
        """All that was wanted is there: a head, or a whole message."""
        while self._end - self._at >= self._wanted:
            if self._size:
                self._whole(events)
                continue
            head = self._buffer[self._at : self._at + HEAD.size]
            if why := fault_of_head(head):
                self._resume(events, why)
            else:
                self._size = int.from_bytes(head[4:8], "big") + 9
        if self._at + MOST_SIZE > len(self._buffer):  # the next message may not fit behind it
            self._move()

    def _whole(self, events: list[Blob | BadFrame]) -> None:
        at, size, buffer = self._at, self._size, self._buffer
        if buffer[at + size - 1] != END:
            self._resume(events, NO_END)
            return
        _, _, _, _, _, _, change, second, _, third, _ = HEAD.unpack_from(buffer, at)
        data = memoryview(buffer)[at : at + size].toreadonly()
        xml, binary = data[BASE + FIRST : BASE + second], data[BASE + second : BASE + third]
        events.append(Blob(data, change, xml, binary, self._began_s, self._read_s))
        self._begin_at(at + size)

    def _resume(self, events: list[Blob | BadFrame], why: str) -> None:
        """Go on at the next start that may be one: what begins with a head without a fault."""
        buffer, end = self._buffer, self._end
        events.append(BadFrame(why, bytes(buffer[self._at : min(end, self._at + SHOWN)])))
        at = self._at
        while found := START.search(buffer, at + 1, end):
            at = found.start()
            if end - at < HEAD.size or not fault_of_head(buffer[at : at + HEAD.size]):
                self._begin_at(at)
                return
        self._maybe_tail = bytes(buffer[max(self._at + 1, end - START_BYTES + 1) : end])
        self._begin_at(end)

    def _move(self) -> None:
        """What is not looked at yet to the other buffer: frames that were told stay in this one."""
        left = self._end - self._at
        self._spare[:left] = memoryview(self._buffer)[self._at : self._end]
        self._buffer, self._spare = self._spare, self._buffer
        self._at, self._end = 0, left

    def _begin_at(self, at: int) -> None:
        self._at, self._size, self._began_s = at, 0, self._read_s
