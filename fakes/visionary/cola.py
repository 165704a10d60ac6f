"""The fake camera's side of CoLa-2 and CoLa-B: commands out of bytes, answers to bytes.

Both begin with 02 02 02 02 and a length u32. CoLa-2 goes on with two bytes 00, session u32, request
u16, and ends without a checksum; CoLa-B has an 's' before the letters and a checksum behind.
Source: visionary sheet, section 2; lms111 sheet, section 2.
"""

from typing import NamedTuple

MAGIC = b"\x02" * 4
LONGEST = 65_536


class Command(NamedTuple):
    """What a host wrote."""

    letters: str
    name: str
    data: bytes
    session: int
    request: int


def checksum(body: bytes) -> int:
    total = 0
    for byte in body:
        total ^= byte
    return total


def split_rest(letters: str, rest: bytes) -> tuple[str, bytes]:
    """Name and arguments; some hosts leave out the space before the name."""
    if letters.upper() in ("OX", "CX"):
        return "", rest
    name, _, data = rest.removeprefix(b" ").partition(b" ")
    return name.decode("latin-1"), data


class Reader:
    """Takes what hosts write; ignores what is no command, as the device does."""

    def __init__(self, is_cola_2: bool) -> None:
        self._is_cola_2, self._held = is_cola_2, b""

    def commands(self, received: bytes) -> list[Command]:
        self._held += received
        found: list[Command] = []
        while (at := self._held.find(MAGIC)) >= 0:
            self._held = self._held[at:]
            if len(self._held) < 8:
                return found
            size = int.from_bytes(self._held[4:8], "big")
            if not (10 if self._is_cola_2 else 3) <= size <= LONGEST:
                self._held = self._held[1:]
                continue
            end = 8 + size + (0 if self._is_cola_2 else 1)
            if len(self._held) < end:
                return found
            command = self._maybe_command(self._held[8:end])
            self._held = self._held[end if command else 1 :]
            found += [command] if command else []
        self._held = self._held[-3:]
        return found

    def _maybe_command(self, body: bytes) -> Command | None:
        session = request = 0
        if self._is_cola_2:
            session, request = int.from_bytes(body[2:6], "big"), int.from_bytes(body[6:8], "big")
            body = body[8:]
        elif body[:1] != b"s" or checksum(body) != 0:
            return None
        else:
            body = body[1:-1]
        letters = body[:2].decode("latin-1")
        return Command(letters, *split_rest(letters, body[2:]), session, request)


def telegram(is_cola_2: bool, session: int, request: int, content: bytes) -> bytes:
    """An answer, its letters first."""
    if is_cola_2:
        head = b"\x00\x00" + session.to_bytes(4, "big") + request.to_bytes(2, "big")
        return MAGIC + (len(head) + len(content)).to_bytes(4, "big") + head + content
    body = b"s" + content
    return MAGIC + len(body).to_bytes(4, "big") + body + bytes([checksum(body)])
