"""Images as a web camera's answer, for cameras on this machine: so one driver reads them all."""

BOUNDARY = "mapod-image"
HEAD = (
    f"HTTP/1.0 200 OK\r\nContent-Type: multipart/x-mixed-replace; boundary={BOUNDARY}\r\n\r\n"
).encode()
DAMAGED = b"damaged"  # instead of an image: no JPEG, and counted as such
REQUEST_END = b"\r\n\r\n"


def part(image: bytes, stamp_us: int | None, kind: str = "") -> bytes:
    """One image, with its time in microseconds of the camera's clock; None: not known.

    Args:
        kind: what it is, where the bytes themselves do not tell.
    """
    told = f"--{BOUNDARY}\r\nContent-Length: {len(image)}\r\n"
    if kind:
        told += f"Content-Type: {kind}\r\n"
    if stamp_us is not None:
        told += f"X-Timestamp: {stamp_us // 1_000_000}.{stamp_us % 1_000_000:06d}\r\n"
    return f"{told}\r\n".encode() + image + b"\r\n"


class Request:
    """What is written to such a port: a whole request opens the stream, whatever it says."""

    def __init__(self) -> None:
        self.begin()

    def begin(self) -> None:
        self._received, self.is_whole = b"", False

    def take(self, data: bytes) -> bool:
        """Whether that completes it."""
        if self.is_whole:
            return False
        self._received = (self._received + data)[-4096:]
        self.is_whole = REQUEST_END in self._received
        return self.is_whole
