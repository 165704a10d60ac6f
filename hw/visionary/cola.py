"""CoLa-2 and CoLa-B, the camera's control telegrams: bytes to replies, commands to bytes. No I/O.

    CoLa-2   02 02 02 02 | length u32 | 00 00 | session u32 | request u16 | letters | rest
    CoLa-B   02 02 02 02 | length u32 | 's' letters rest | XOR over 's' up to the end of rest

All big-endian. Letters say what it is: RN RA read, WN WA write, MN AN method, Ox OA open, Cx CA
close, FA refused, with its error. The rest of others is a space, a name, a space and arguments.
Source: visionary sheet, sections 2 and 3; lms111 sheet, section 2.
"""

import struct
from functools import reduce
from operator import xor

from msgspec import Struct

from hw.device import BadFrame

START = b"\x02\x02\x02\x02"
MOST_BYTES = 65_536  # of a telegram behind its length: what a damaged length can make us wait for
HEAD_2 = struct.Struct(">2xIH")  # session, request
LEAST_2, LEAST_B = HEAD_2.size + 2, 3  # bytes behind the length
REQUESTS = 65_536  # then they begin anew
SHOWN = 64  # bytes of a telegram that is refused, which are kept for a person


class Reply(Struct, frozen=True):
    """One answer of the camera."""

    letters: str  # RA, WA, AN, OA, CA, FA
    name: str  # what it answers; "" where the protocol does not say
    data: bytes = b""
    error: int = 0  # of FA
    session: int = 0  # CoLa-2's
    request: int = 0


def flexstring(text: str) -> bytes:
    """A text with its length before it.

    >>> flexstring("mapod").hex()
    '00056d61706f64'
    """
    data = text.encode("utf-8")
    return len(data).to_bytes(2, "big") + data


def texts_of(data: bytes) -> list[str]:
    """The flexstrings at the begin of an answer, as far as they are whole.

    >>> texts_of(bytes.fromhex("0003312e32" "0001"))
    ['1.2']
    """
    texts = []
    while len(data) >= 2:
        end = 2 + int.from_bytes(data[:2], "big")
        if end > len(data):
            break
        texts.append(data[2:end].decode("utf-8", "replace"))
        data = data[end:]
    return texts


def arguments(name: str, data: bytes) -> bytes:
    """The rest of a command, behind its letters."""
    return b" " + name.encode("ascii") + b" " + data


def encode_cola_2(session: int, request: int, letters: str, rest: bytes) -> bytes:
    body = HEAD_2.pack(session, request) + letters.encode("ascii") + rest
    return START + len(body).to_bytes(4, "big") + body


def encode_cola_b(letters: str, rest: bytes) -> bytes:
    """
    >>> encode_cola_b("MN", arguments("PLAYSTOP", b"")).hex()
    '020202020000000d734d4e20504c415953544f50206c'
    """
    body = b"s" + letters.encode("ascii") + rest
    return START + len(body).to_bytes(4, "big") + body + bytes([reduce(xor, body)])


def reply_of(letters: bytes, rest: bytes, session: int = 0, request: int = 0) -> Reply | BadFrame:
    """What a whole telegram says."""
    kind = letters.decode("latin-1")
    if kind in ("OA", "CA"):
        return Reply(kind, "", rest, 0, session, request)
    if kind == "FA":
        if len(rest) < 2:
            return BadFrame("a refusal without its error", letters + rest)
        return Reply(kind, "", b"", int.from_bytes(rest[:2], "big"), session, request)
    if kind not in ("RA", "WA", "AN") or not rest.startswith(b" "):
        return BadFrame("a telegram that is no answer", (letters + rest)[:SHOWN])
    name, _, data = rest[1:].partition(b" ")
    return Reply(kind, name.decode("latin-1"), data, 0, session, request)


class ColaParser:
    """Takes a stream cut anywhere; finds its way back at the next start; keeps one telegram.

    Args:
        is_cola_2: else it is CoLa-B.
    """

    def __init__(self, is_cola_2: bool) -> None:
        self._is_cola_2, self._buffer = is_cola_2, bytearray()

    def feed(self, now_s: float, data: bytes) -> list[Reply | BadFrame]:
        self._buffer += data
        events: list[Reply | BadFrame] = []
        while self._buffer and (event := self._maybe_event()):
            events.append(event)
        return events

    def _maybe_event(self) -> Reply | BadFrame | None:
        """The event at the front; None when more bytes are needed."""
        buffer = self._buffer
        at = buffer.find(START)
        if at < 0:  # its last bytes may begin one
            at = len(buffer) - next(n for n in (3, 2, 1, 0) if buffer.endswith(START[:n]))
        if at:
            return self._skip(at, "no start")
        if len(buffer) < 8:
            return None
        length = int.from_bytes(buffer[4:8], "big")
        if not (LEAST_2 if self._is_cola_2 else LEAST_B) <= length <= MOST_BYTES:
            return self._skip(1, f"a length of {length} bytes")
        size = 8 + length + (not self._is_cola_2)
        if len(buffer) < size:
            return None
        body = bytes(buffer[8:size])
        if self._is_cola_2:
            del buffer[:size]
            letters, rest = body[HEAD_2.size : LEAST_2], body[LEAST_2:]
            return reply_of(letters, rest, *HEAD_2.unpack_from(body))
        if reduce(xor, body):
            return self._skip(1, "a wrong checksum")
        if body[:1] != b"s":
            return self._skip(size, "a telegram that is no answer")
        del buffer[:size]
        return reply_of(body[1:3], body[3:-1])

    def _skip(self, count: int, reason: str) -> BadFrame:
        skipped = bytes(self._buffer[:count])
        del self._buffer[:count]
        return BadFrame(reason, skipped)
