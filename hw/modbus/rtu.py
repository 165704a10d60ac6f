"""Modbus on a serial line (RTU), which may have other slaves: we speak only after a silence.

A frame is recognised by its length and checksum at the place where one must begin; what other
units are asked, and what they answer, is stepped over whole, so that no byte of it is taken for a
request. What lies there after noise is looked for only once the line is silent, and only at the
very end: whoever asks us then waits. A broadcast (unit 0) is not answered.
Source: Modbus over serial line 1.02, section 2.5.1.
"""

import asyncio
from functools import partial

from hw.modbus.client import Client, Request, ServerContext
from hw.modbus.pdu import (
    IDENTIFY,
    MASK_WRITE,
    READ_COILS,
    READ_INPUTS,
    WRITE_COIL,
    WRITE_COILS,
    WRITE_MANY,
    WRITE_ONE,
    WRITE_READ,
)
from hw.ports.serial import SerialPort
from hw.ports.url import PortUrl

POLYNOMIAL, START = 0xA001, 0xFFFF
LEAST, MOST = 4, 256  # bytes of a frame
KEPT = 4 * MOST  # bytes without a frame in them; older ones are dropped
UNKNOWN, MORE = 0, -1  # a frame's size: can't be told; can't be told yet
EXCEPTION_SIZE = 5
COUNTED = {WRITE_COILS: 6, WRITE_MANY: 6, WRITE_READ: 10, 20: 2, 21: 2}  # where the byte count is
FIXED = {7: 4, 8: 8, 11: 4, 12: 4, 17: 4, MASK_WRITE: 10, 24: 6}
ECHOED = {WRITE_COIL: 8, WRITE_ONE: 8, WRITE_COILS: 8, WRITE_MANY: 8, MASK_WRITE: 10, 8: 8, 11: 8}
LISTED = {READ_COILS, 2, 3, READ_INPUTS, WRITE_READ, 12, 17, 20, 21}  # answers with a byte count

CHARACTER_BITS = 11
SILENT_CHARACTERS, LEAST_SILENT_S = 3.5, 0.00175
LONG_SILENCE_S = 0.1  # nothing begun will be ended any more
CALLS = 32  # of the system between two tendings; what arrives beyond waits for the next
NO_READER = (-1, 0)  # descriptor and connection that are listened to
CALL_BYTES = 1024  # looked at in one call: 11 ms of 921 600 baud
MOST_FOUND = 64  # requests of a master that never falls silent, before it is answered all the same


def _crc_table() -> list[int]:
    table = []
    for byte in range(256):
        for _ in range(8):
            byte = byte >> 1 ^ (POLYNOMIAL if byte & 1 else 0)
        table.append(byte)
    return table


TABLE = _crc_table()


def crc16(data: bytes | bytearray) -> int:
    """The checksum, 0 over a frame with its own at the end, low byte first.

    >>> crc16(bytes.fromhex("01 03 00 00 00 0A")).to_bytes(2, "little").hex(" ")
    'c5 cd'
    """
    crc = START
    for byte in data:
        crc = crc >> 8 ^ TABLE[(crc ^ byte) & 0xFF]
    return crc


def rtu_frame(request: Request, pdu: bytes) -> bytes:
    """The frame of an answer.

    >>> rtu_frame(Request(1, b""), bytes((0x83, 2))).hex(" ")
    '01 83 02 c0 f1'
    """
    frame = bytes((request.unit,)) + pdu
    return frame + crc16(frame).to_bytes(2, "little")


def request_size(frame: bytes | bytearray) -> int:
    """Bytes of the request that begins here; UNKNOWN or MORE."""
    if len(frame) < 2:
        return MORE
    function = frame[1]
    if READ_COILS <= function <= WRITE_ONE:
        return 8
    if function in FIXED:
        return FIXED[function]
    if function == IDENTIFY:
        return MORE if len(frame) < 3 else (7 if frame[2] == 0x0E else UNKNOWN)
    if function in COUNTED:
        place = COUNTED[function]
        return MORE if len(frame) <= place else min(MOST + 1, place + 1 + frame[place] + 2)
    return UNKNOWN


def answer_size(frame: bytes | bytearray) -> int:
    """Bytes of the answer that begins here; UNKNOWN or MORE."""
    if len(frame) < 2:
        return MORE
    function = frame[1]
    if function & 0x80:
        return EXCEPTION_SIZE
    if function in ECHOED:
        return ECHOED[function]
    if function in LISTED:
        return MORE if len(frame) < 3 else min(MOST + 1, 3 + frame[2] + 2)
    return 5 if function == 7 else UNKNOWN


class RtuReceiver:
    """Takes what the line carries, cut anywhere; keeps less than 1 kB; never raises on input."""

    def __init__(self, units: frozenset[int]) -> None:
        self._units = units  # ours
        self._buffer = bytearray()
        self._asked: tuple[int, int] | None = None  # another unit and function: it may answer now
        self.rejected = 0  # bytes that belonged to no frame

    def feed(self, data: bytes) -> list[Request]:
        """The requests for us that these bytes complete."""
        self._buffer += data
        found: list[Request] = []
        while size := self._frame_size():
            self._sort(size, found)
        if len(self._buffer) > KEPT:
            self._drop(len(self._buffer) - MOST)
        return found

    def silence(self, *, long: bool) -> list[Request]:
        """The line is silent; `long`: so long that nothing begun will be ended any more."""
        found: list[Request] = []
        if not self._buffer:
            return found
        size = len(self._buffer)
        if LEAST <= size <= MOST and crc16(self._buffer) == 0:  # of a function we do not know
            self._sort(size, found)
        elif long or not (self._is_asked() and self._may_grow(answer_size(self._buffer))):
            at = self._maybe_last_request()  # an answer under way may look like anything
            if at is not None:
                self._drop(at)
                self._sort(len(self._buffer), found)
            elif long or not self._may_grow(*self._sizes()):
                self._drop(size)
        return found

    def _sizes(self) -> tuple[int, ...]:
        sizes = request_size(self._buffer), answer_size(self._buffer)
        return sizes[::-1] if self._is_asked() else sizes

    def _is_asked(self) -> bool:
        start = self._buffer[:2]
        if self._asked is None or len(start) < 2:
            return False
        return (start[0], start[1] & 0x7F) == self._asked

    def _frame_size(self) -> int:
        for size in self._sizes():
            if LEAST <= size <= min(MOST, len(self._buffer)) and crc16(self._buffer[:size]) == 0:
                return size
        return 0

    def _may_grow(self, *sizes: int) -> bool:
        """Whether what lies at the start may become a frame of one of these sizes."""
        return any(size == MORE or len(self._buffer) < size <= MOST for size in sizes)

    def _maybe_last_request(self) -> int | None:
        """Where a request for us begins that ends with the last byte."""
        size = len(self._buffer)
        for at in range(max(0, size - MOST), size - LEAST + 1):
            rest = self._buffer[at:]
            if rest[0] in self._units and request_size(rest) == len(rest) and crc16(rest) == 0:
                return at
        return None

    def _sort(self, size: int, found: list[Request]) -> None:
        frame = bytes(self._buffer[:size])
        del self._buffer[:size]
        unit, function = frame[0], frame[1]
        if unit not in self._units:
            was_answer = self._asked == (unit, function & 0x7F)
            self._asked = None if was_answer or unit == 0 else (unit, function)
        elif not function & 0x80 and request_size(frame) in (size, UNKNOWN):
            self._asked = None
            found.append(Request(unit, frame[1:-2]))

    def _drop(self, size: int) -> None:
        self.rejected += size
        del self._buffer[:size]


def silent_s(baud: int) -> float:
    """The silence that ends a frame.

    >>> round(1e3 * silent_s(9600), 2), round(1e3 * silent_s(115200), 2)
    (4.01, 1.75)
    """
    return max(LEAST_SILENT_S, SILENT_CHARACTERS * CHARACTER_BITS / baud) if baud else 0.0


class LineService:
    """Our unit on a serial line; where the line is lost, it comes back by itself."""

    def __init__(self, context: ServerContext, url: PortUrl) -> None:
        self._context, self._port = context, SerialPort(url)
        self._silent_s = silent_s(url.baud or 0)
        self._client = Client(context, f"modbus rtu {url.path}", True, self._reply)
        self._reader = NO_READER
        self._calls_left = 0  # until it is tended next
        self._timer: asyncio.Handle | None = None
        self._opened = 0
        self._begin()

    def _begin(self) -> None:
        self._unread = bytearray()
        self._receiver = RtuReceiver(frozenset(self._context.views))
        self._found: list[Request] = []  # they wait for silence

    async def open(self) -> None:
        """Tending opens it, and opens it again."""

    def tend(self, now_s: float) -> str:
        """Open or reopen the line, send what it did not take at once, listen to it."""
        is_open = self._port.poll(now_s)
        if is_open and self._port.opened != self._opened:
            self._opened = self._port.opened
            self._begin()
        if self._unread:
            self._hear()
        self._calls_left = CALLS
        self._heed()
        return "" if is_open else self._port.cause

    def _heed(self, *, is_over: bool = False) -> None:
        """Be told of bytes while the line is open, but not without end between two tendings."""
        wanted = (self._port.fileno(), self._port.opened)
        if is_over or self._calls_left <= 0 or wanted[0] < 0:
            wanted = NO_READER
        if wanted == self._reader:
            return
        if self._reader != NO_READER:
            self._context.loop.remove_reader(self._reader[0])
        if wanted != NO_READER:
            self._context.loop.add_reader(wanted[0], self._woken)
        self._reader = wanted

    def _woken(self) -> None:
        self._calls_left -= 1
        self._hear()
        self._heed()

    def _hear(self) -> None:
        """Look at some of what has arrived; at the rest when it is tended next."""
        self._unread += b"".join(self._port.read())
        piece = bytes(self._unread[:CALL_BYTES])
        del self._unread[:CALL_BYTES]
        if piece:
            self._take(self._receiver.feed(piece))
        if len(self._found) > MOST_FOUND:
            self._offer()
        if not self._unread:
            self._listen(self._silent_s, long=False)

    def _listen(self, wait_s: float, *, long: bool) -> None:
        if self._timer is not None:
            self._timer.cancel()
        self._timer = self._context.loop.call_later(wait_s, partial(self._silence, long))

    def _silence(self, long: bool) -> None:
        self._take(self._receiver.silence(long=long))
        self._offer()
        if not long:
            self._listen(LONG_SILENCE_S, long=True)

    def _take(self, found: list[Request]) -> None:
        self._found += found
        if noise := self._receiver.rejected:
            self._receiver.rejected = 0
            self._context.reject("noise on the line", bytes(noise))

    def _offer(self) -> None:
        found, self._found = self._found, []
        self._client.offer(found)

    def _reply(self, request: Request, pdu: bytes) -> None:
        self._port.write(rtu_frame(request, pdu))

    async def shutdown(self) -> None:
        self._heed(is_over=True)
        if self._timer is not None:
            self._timer.cancel()
        self._client.close()
        self._port.close()
