"""The values in a telegram, as a scanner reads and writes them: packed (CoLa-B) or written out.

A value is a kind and what it holds. Kinds: B H I b h i f as in `struct`; S and s are texts with a
length of two bytes or one; N is a bare name; W and w are rows of 16 or 8 bit values.

Source: lms111 sheet, section 2.
"""

import re
import struct
from collections.abc import Iterable
from typing import Any

from fakes.lms1xx.cola import (
    INVALID_CHARACTER,
    TOO_LONG,
    TOO_SHORT,
    VALUE_OVERFLOW,
    RefusedError,
)

Value = tuple[str, Any]

BITS = {"B": 8, "H": 16, "I": 32, "b": 8, "h": 16, "i": 32}
NUMBER = re.compile(rb"[+-][0-9]+|[0-9A-Fa-f]+")


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
