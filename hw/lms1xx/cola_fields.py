"""The fields of a CoLa payload one after another, packed (CoLa-B) or written out (CoLa-A).

Both readers take the same layouts (of `struct`, big-endian), so that a telegram is described once.
Refuses what can't be: PayloadError where the payload ends early or a token is no such number.
Text is read leniently: any case, leading zeros, signs, several spaces.
Source: lms111 sheet, section 2.
"""

import re
import struct
from functools import cache, lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from hw.lms1xx.cola import Dialect, PayloadError

Raw = npt.NDArray[np.integer[Any]]
Kind = npt.DTypeLike

_NUMBER = re.compile(rb"[+-][0-9]{1,9}|[0-9A-Fa-f]{1,9}")
_NUMBERS = re.compile(rb"[0-9A-Fa-f ]*")
_TOKEN = re.compile(rb" *([^ ]+)")
_BITS = {"b": 8, "B": 8, "h": 16, "H": 16, "i": 32, "I": 32}


@cache
def _packed(layout: str) -> struct.Struct:  # there are few, but for a text of each length to 255
    return struct.Struct(">" + layout)


class BinaryFields:
    """Takes packed fields off a payload."""

    def __init__(self, payload: bytes, at: int = 0) -> None:
        self._payload, self._at = payload, at

    def fields(self, layout: str) -> tuple[Any, ...]:
        packed = _packed(layout)
        try:
            values = packed.unpack_from(self._payload, self._at)
        except struct.error:
            raise PayloadError("telegram ends early") from None
        self._at += packed.size
        return values

    def text(self, length: str) -> str:
        """A length of that layout, then so many characters."""
        (size,) = self.fields(length)
        (text,) = self.fields(f"{size}s")
        return str(text, "latin-1")

    def array(self, kind: Kind, count: int) -> Raw:
        """So many values of a numpy kind, at least one, (count,), without a copy."""
        try:
            values = np.frombuffer(self._payload, kind, count, self._at)
        except ValueError:
            raise PayloadError("telegram ends early") from None
        self._at += values.nbytes
        return values

    def rest(self) -> bytes:
        left, self._at = self._payload[self._at :], len(self._payload)
        return left


@lru_cache(64)
def _codes(layout: str) -> tuple[str, ...]:
    """One code for each value: "2BH" is B, B, H; "5s" is one."""
    codes: list[str] = []
    for count, code in re.findall(r"(\d*)(\w)", layout):
        codes += [code] if code == "s" else [code] * int(count or 1)
    return tuple(codes)


class TextFields:
    """The same of fields written out: hexadecimal without a sign, decimal with one."""

    def __init__(self, payload: bytes, at: int = 0) -> None:
        self._payload, self._at = payload, at

    def fields(self, layout: str) -> tuple[Any, ...]:
        return tuple(self._value(code) for code in _codes(layout))

    def _value(self, code: str) -> Any:
        token = self._token()
        if code == "s":
            return token
        if code == "f":
            return struct.unpack(">f", number(token, "I").to_bytes(4, "big"))[0]
        return number(token, code)

    def _token(self) -> bytes:
        found = _TOKEN.match(self._payload, self._at)
        if found is None:
            raise PayloadError("telegram ends early")
        self._at = found.end()
        return found.group(1)

    def text(self, length: str) -> str:
        """Length (some firmware writes it in decimal), a space, characters.

        A length that fits in neither way takes all that is left.
        """
        token = self._token()
        begin = self._at + 1  # spaces after that belong to the text
        sizes = [number(token, length)]
        if token.isdigit():
            sizes.append(int(token))
        for size in sizes:
            end = begin + size if size else self._at
            if end == len(self._payload) or self._payload[end : end + 1] == b" ":
                break
        else:
            end = len(self._payload)
        text, self._at = self._payload[begin:end], end
        return str(text, "latin-1")

    def array(self, kind: Kind, count: int) -> Raw:
        *tokens, rest = [*self._payload[self._at :].split(None, count), b""][: count + 1]
        if len(tokens) < count:
            raise PayloadError("telegram ends early")
        begin = self._at
        self._at = len(self._payload) - len(rest)
        code = {1: "B", 2: "H"}[np.dtype(kind).itemsize]
        if _NUMBERS.fullmatch(self._payload, begin, self._at):
            values = [int(token, 16) for token in tokens]
            if max(values, default=0) < 1 << _BITS[code]:
                return np.array(values, kind)
        return np.array([number(token, code) for token in tokens], kind)

    def rest(self) -> bytes:
        left, self._at = self._payload[self._at :].strip(b" "), len(self._payload)
        return left


def number(token: bytes, code: str) -> int:
    """A token as an integer of a struct code.

    >>> number(b"FFF92230", "i"), number(b"-450000", "i"), number(b"+20", "H"), number(b"20", "H")
    (-450000, -450000, 20, 32)

    Raises:
        PayloadError: no number, or too big for its field.
    """
    if not _NUMBER.fullmatch(token):
        raise PayloadError(f"{token[:12]!r} is no number")
    bits, is_signed = _BITS[code], code.islower()
    if token[:1] in (b"+", b"-"):
        value = int(token)
    else:
        value = int(token, 16)
        if is_signed and 1 << (bits - 1) <= value < 1 << bits:
            value -= 1 << bits
    least = -(1 << (bits - 1)) if is_signed else 0
    if not least <= value < least + (1 << bits):
        raise PayloadError(f"{token[:12]!r} is too big")
    return value


Fields = BinaryFields | TextFields
READERS: dict[Dialect, type[BinaryFields] | type[TextFields]] = {
    "binary": BinaryFields,
    "ascii": TextFields,
}
