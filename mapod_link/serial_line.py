"""Frames on a serial line: COBS, and a zero after each.

Nothing here raises on what has arrived, and no more than one frame of bytes is kept.
Source: planner link, section 2.
"""

from mapod_link.frames import MAX_FRAME

MAX_ENCODED = MAX_FRAME + 4  # COBS adds at most three bytes; one more is already too long


def cobs_from_bytes(data: bytes) -> bytes:
    """COBS, without the delimiter."""
    encoded = bytearray()
    runs = data.split(b"\0")
    for last, run in ((i == len(runs) - 1, run) for i, run in enumerate(runs)):
        while len(run) > 254 or (len(run) == 254 and not last):
            encoded += b"\xff" + run[:254]
            run = run[254:]
        encoded += bytes([len(run) + 1]) + run
    return bytes(encoded)


def maybe_bytes_from_cobs(encoded: bytes) -> bytes | None:
    """What was encoded; None if the code bytes do not fit the length or a zero lies within."""
    if 0 in encoded:
        return None
    decoded, at, end = [], 0, len(encoded)
    while at < end:
        code = encoded[at]
        decoded.append(encoded[at + 1 : at + code])
        at += code
        if code < 255 and at < end:
            decoded.append(b"\0")
    return b"".join(decoded) if at == end else None


def serial_from_frame(frame: bytes) -> bytes:
    """A frame as it goes over a serial line."""
    return cobs_from_bytes(frame) + b"\0"


class Deframer:
    """Cuts a serial stream into frames, wherever it is cut itself."""

    def __init__(self) -> None:
        self._encoded = bytearray()

    def feed(self, data: bytes) -> list[bytes | None]:
        """The frames that these bytes complete; None stands for one that cannot be read."""
        frames: list[bytes | None] = []
        *ended, rest = data.split(b"\0")
        for piece in ended:
            self._keep(piece)
            if self._encoded:
                fits = len(self._encoded) < MAX_ENCODED
                frames.append(maybe_bytes_from_cobs(bytes(self._encoded)) if fits else None)
                self._encoded.clear()
        self._keep(rest)
        return frames

    def _keep(self, piece: bytes) -> None:
        self._encoded += piece[: MAX_ENCODED - len(self._encoded)]
