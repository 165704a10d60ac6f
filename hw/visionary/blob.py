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
    """Takes a stream cut anywhere; after damage it goes on at the next start.

    A byte is moved at most twice, whatever comes.
    """

    def __init__(self) -> None:
        self._buffer, self._spare = bytearray(MOST_BYTES + 9), bytearray(MOST_BYTES + 9)
        self.begin()

    def begin(self) -> None:
        """A new connection: what has come of a frame is of no use."""
        self._filled = self._size = 0  # bytes in the buffer; of the message at its begin, if known
        self._began_s = self._read_s = 0.0
        self._maybe_tail: bytes | None = None  # while a start is looked for: the newest bytes
        self._is_second_look = False  # the frame coming in was found within a damaged one

    def feed(self, now_s: float, data: bytes) -> list[Blob | BadFrame]:
        """The frames that these bytes complete; an event where the stream ceases to be frames."""
        self._read_s, events = now_s, list[Blob | BadFrame]()
        given = memoryview(data)
        while given:
            if self._maybe_tail is not None:
                given = self._hunt(self._maybe_tail + given)
                continue
            if not self._filled:
                self._began_s = now_s
            wanted = (self._size or HEAD.size) - self._filled
            taken = given[:wanted]
            self._buffer[self._filled : self._filled + len(taken)] = taken
            self._filled += len(taken)
            given = given[len(taken) :]
            if len(taken) == wanted:
                self._look(events)
        return events

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
        while self._filled >= (self._size or HEAD.size):
            if self._size:
                self._whole(events)
                continue
            head = self._buffer[: HEAD.size]
            if why := fault_of_head(head):
                self._resume(events, why)
            else:
                self._size = int.from_bytes(head[4:8], "big") + 9

    def _whole(self, events: list[Blob | BadFrame]) -> None:
        size, buffer = self._size, self._buffer
        if buffer[size - 1] != END:
            if self._is_second_look:
                events.append(BadFrame(NO_END, bytes(buffer[:SHOWN])))
                self._keep_from(size)
            else:
                self._resume(events, NO_END)
                self._is_second_look = self._filled > 0
            return
        _, _, _, _, _, _, change, second, _, third, _ = HEAD.unpack_from(buffer)
        data = memoryview(buffer)[:size].toreadonly()
        xml, binary = data[BASE + FIRST : BASE + second], data[BASE + second : BASE + third]
        events.append(Blob(data, change, xml, binary, self._began_s, self._read_s))
        left = self._filled - size
        self._spare[:left] = memoryview(buffer)[size : self._filled]
        self._buffer, self._spare = self._spare, buffer
        self._begin_at(left)

    def _resume(self, events: list[Blob | BadFrame], why: str) -> None:
        """Drop what comes before the next start that may be one."""
        events.append(BadFrame(why, bytes(self._buffer[:SHOWN])))
        found = START.search(self._buffer, 1, self._filled)
        if found:
            self._keep_from(found.start())
            return
        first = max(1, self._filled - START_BYTES + 1)
        self._maybe_tail = bytes(self._buffer[first : self._filled])
        self._begin_at(0)

    def _keep_from(self, at: int) -> None:
        left = self._filled - at
        self._buffer[:left] = self._buffer[at : self._filled]
        self._begin_at(left)

    def _begin_at(self, left: int) -> None:
        self._filled, self._size, self._is_second_look = left, 0, False
        self._began_s = self._read_s
