"""CoLa-B and CoLa-A as a scanner hears and speaks them: commands out of a stream, values, frames.

What is damaged is ignored, as the device does; so is the other dialect.
A value is a kind and what it holds. Kinds: B H I b h i f as in `struct`; S and s are texts with a
length of two bytes or one; N is a bare name; W and w are rows of 16 or 8 bit values.
Source: lms111 sheet, section 2.
"""

import re
import struct
from collections.abc import Iterable
from typing import Any

import numpy as np

START = b"\x02\x02\x02\x02"
HEAD = 8  # start and length
MAX_COMMAND = 256  # bytes of payload; no command is near it
PATIENCE_S = 1.0  # for the rest of a frame: a damaged length must not swallow what follows

# sFA codes
METHOD_DENIED, UNKNOWN_METHOD, UNKNOWN_VARIABLE, CONDITION_FAILED = 0x01, 0x02, 0x03, 0x04
TOO_LONG, TOO_SHORT, WRITE_DENIED = 0x07, 0x08, 0x0A
UNKNOWN_COMMAND, UNKNOWN_EVENT = 0x0C, 0x0F
VALUE_OVERFLOW, INVALID_CHARACTER = 0x10, 0x11

TEXT_START, TEXT_END = b"\x02", b"\x03"
BITS = {"B": 8, "H": 16, "I": 32, "b": 8, "h": 16, "i": 32}
NUMBER = re.compile(rb"[+-][0-9]+|[0-9A-Fa-f]+")

Value = tuple[str, Any]


class RefusedError(Exception):
    """A command that gets an sFA with this code."""

    def __init__(self, code: int) -> None:
        super().__init__(f"sFA {code:X}")
        self.code = code


def checksum(payload: bytes | bytearray) -> int:
    """XOR of all bytes."""
    return int(np.bitwise_xor.reduce(np.frombuffer(payload, dtype=np.uint8)))


def frame(payload: bytes) -> bytes:
    return START + len(payload).to_bytes(4, "big") + payload + bytes([checksum(payload)])


def text_frame(payload: bytes) -> bytes:
    """A whole telegram of CoLa-A."""
    return TEXT_START + payload + TEXT_END


def refusal(code: int, binary: bool = True) -> bytes:
    """The payload that says no: in CoLa-B without a space."""
    return b"sFA" + code.to_bytes(2, "big") if binary else b"sFA %X" % code


def command(payload: bytes) -> tuple[str, str, bytes]:
    """Kind, name and arguments of a payload; what is no command has the kind "" ."""
    kind, space, rest = payload[:3], payload[3:4], payload[4:]
    if payload in (b"sRI0", b"sRI 0"):
        return "sRN", "0", b""
    if kind not in (b"sRN", b"sWN", b"sMN", b"sEN") or space != b" ":
        return "", "", b""
    name, _, arguments = rest.partition(b" ")
    return kind.decode("ascii"), name.decode("latin-1"), arguments


def is_text(payload: bytes) -> bool:
    """Whether it may be a telegram of CoLa-A."""
    return payload.startswith(b"s") and payload.isascii() and payload.decode().isprintable()


class TextReader:
    """CoLa-A: takes the host's stream cut anywhere; gives what stands between STX and ETX."""

    def __init__(self) -> None:
        self._buffer = bytearray()

    def feed(self, now_s: float, data: bytes) -> list[bytes]:
        self._buffer += data
        payloads = []
        while (end := self._buffer.find(TEXT_END)) >= 0:
            start = self._buffer.rfind(TEXT_START, 0, end)
            payload = bytes(self._buffer[start + 1 : end]) if start >= 0 else b""
            if payload and len(payload) <= MAX_COMMAND:
                payloads.append(payload)
            del self._buffer[: end + 1]
        start = self._buffer.rfind(TEXT_START)  # only the last one can still begin a command
        del self._buffer[: start if start >= 0 else len(self._buffer)]
        if len(self._buffer) > MAX_COMMAND:
            self._buffer.clear()
        return payloads


class CommandReader:
    """CoLa-B: takes a stream cut anywhere; gives the payloads of undamaged frames."""

    def __init__(self, most: int = MAX_COMMAND) -> None:
        self._buffer, self._most = bytearray(), most  # bytes of a payload
        self._waiting_s: float | None = None  # since when the front waits for its rest

    def feed(self, now_s: float, data: bytes) -> list[bytes]:
        self._buffer += data
        payloads = []
        while len(self._buffer) >= HEAD:
            end = HEAD + int.from_bytes(self._buffer[4:HEAD], "big") + 1
            if not self._buffer.startswith(START) or end > HEAD + self._most + 1:
                self._skip()
            elif len(self._buffer) < end:
                if self._is_patient(now_s):
                    break
                self._skip()
            elif checksum(self._buffer[HEAD:end]):
                self._skip()
            else:
                payloads.append(bytes(self._buffer[HEAD : end - 1]))
                del self._buffer[:end]
                self._waiting_s = None
        return payloads

    def _is_patient(self, now_s: float) -> bool:
        if self._waiting_s is None:
            self._waiting_s = now_s
        return now_s - self._waiting_s <= PATIENCE_S

    def _skip(self) -> None:
        """To the next byte that may begin a frame."""
        start = self._buffer.find(START[:1], 1)
        del self._buffer[: start if start > 0 else len(self._buffer)]
        self._waiting_s = None


def fields(kinds: str, *numbers: float) -> list[Value]:
    return list(zip(kinds, numbers, strict=True))


def packed(values: Iterable[Value]) -> bytes:
    """As CoLa-B has them, big-endian and without separators."""
    parts = []
    for kind, value in values:
        match kind:
            case "S" | "s":
                parts += [len(value).to_bytes(2 if kind == "S" else 1, "big"), value]
            case "N":
                parts.append(value)
            case "W" | "w":
                parts.append(value.astype(">u2" if kind == "W" else "u1").tobytes())
            case _:
                parts.append(struct.pack(">" + kind, value))
    return b"".join(parts)


def written(values: Iterable[Value]) -> bytes:
    """As CoLa-A has them: hexadecimal without leading zeros, one space between."""
    tokens: list[str] = []
    for kind, value in values:
        match kind:
            case "S" | "s":
                tokens += [f"{len(value):X}", value.decode("latin-1")]
            case "N":
                tokens.append(value.decode("latin-1"))
            case "W" | "w":
                tokens += [f"{number:X}" for number in value.tolist()]
            case "f":
                tokens.append(struct.pack(">f", value).hex().upper())
            case _:
                tokens.append(f"{value & (1 << BITS[kind]) - 1:X}")
    return " ".join(tokens).encode("latin-1")


def unpacked(kinds: str, arguments: bytes) -> tuple[int, ...]:
    """Arguments of a CoLa-B command.

    Raises:
        RefusedError: too few bytes, or too many.
    """
    layout = struct.Struct(">" + kinds)
    if len(arguments) != layout.size:
        raise RefusedError(TOO_SHORT if len(arguments) < layout.size else TOO_LONG)
    return layout.unpack(arguments)


def read(kinds: str, arguments: bytes) -> tuple[int, ...]:
    """Arguments of a CoLa-A command: decimal with a sign, hexadecimal without one.

    >>> read("iBi", b"-450000 03 FFF92230")
    (-450000, 3, -450000)

    Raises:
        RefusedError: no number, too few, too many, or beyond its kind; looked for in this order.
    """
    tokens = arguments.split(b" ") if arguments else []
    if not all(NUMBER.fullmatch(token) for token in tokens):
        raise RefusedError(INVALID_CHARACTER)
    if len(tokens) != len(kinds):
        raise RefusedError(TOO_SHORT if len(tokens) < len(kinds) else TOO_LONG)
    return tuple(_number(kind, token) for kind, token in zip(kinds, tokens, strict=True))


def _number(kind: str, token: bytes) -> int:
    has_sign = token[:1] in (b"+", b"-")
    number, bits = int(token, 10 if has_sign else 16), BITS[kind]
    if not has_sign and kind.islower() and 1 << bits - 1 <= number < 1 << bits:
        number -= 1 << bits
    low, high = (-(1 << bits - 1), 1 << bits - 1) if kind.islower() else (0, 1 << bits)
    if not low <= number < high:
        raise RefusedError(VALUE_OVERFLOW)
    return number
