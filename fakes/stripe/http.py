"""What the fake camera says over HTTP: one request in, a head, and images part by part.

Source: RFC 9112; RFC 2046, section 5.1.1. A part ends with the next boundary, as mjpg-streamer has
it, so that nobody need wait for the next image to know the end of one.
"""

import re

BOUNDARY = "imagefollows"
MOST_REQUEST = 4096
REASONS = {
    400: "Bad Request",
    404: "Not Found",
    405: "Method Not Allowed",
    503: "Service Unavailable",
}
REQUEST = re.compile(rb"([A-Z]{1,10}) (\S{1,2000}) HTTP/1\.[01]\r?\n")


def status_of(request: bytes, path: str) -> int:
    """What a whole request is worth: 200, or why it gets nothing."""
    found = REQUEST.match(request)
    if found is None:
        return 400
    if found[1] != b"GET":
        return 405
    return 200 if found[2] == path.encode("ascii", "replace") else 404


def refusal(status: int) -> bytes:
    reason = REASONS.get(status, "Refused")
    return (
        f"HTTP/1.0 {status} {reason}\r\nContent-Type: text/plain\r\nConnection: close\r\n\r\n"
        f"{reason}\r\n"
    ).encode()


def head() -> bytes:
    """The answer's head, and the first boundary."""
    return (
        "HTTP/1.0 200 OK\r\nConnection: close\r\nCache-Control: no-store\r\n"
        f"Content-Type: multipart/x-mixed-replace; boundary={BOUNDARY}\r\n\r\n--{BOUNDARY}\r\n"
    ).encode()


def part(jpeg: bytes, exposed_us: int | None, tells_length: bool) -> bytes:
    """An image, and the boundary behind it.

    Args:
        exposed_us: by the camera's clock; None: not told.
    """
    told = "Content-Type: image/jpeg\r\n"
    if tells_length:
        told += f"Content-Length: {len(jpeg)}\r\n"
    if exposed_us is not None:
        seconds, micros = divmod(exposed_us, 1_000_000)
        told += f"X-Timestamp: {seconds}.{micros:06d}\r\n"
    return f"{told}\r\n".encode() + jpeg + f"\r\n--{BOUNDARY}\r\n".encode()
