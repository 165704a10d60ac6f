"""Requests to a Linux video device, byte for byte, on 64-bit systems. No device is opened here.

Source: linux/videodev2.h, and the kernel's documentation, Video for Linux API, part I; the numbers
of requests are made as in asm-generic/ioctl.h.
"""

import errno
import fcntl
import mmap
import os
from collections.abc import Iterator
from struct import Struct
from typing import Any, NamedTuple

READ, WRITE = 2, 1
# 16 driver, 32 card, 32 bus, version, capabilities, those of this node, 3 reserved
CAPABILITY = Struct("=16s32s32sIII12x")
FORMAT_DESCRIPTION = Struct("=III32sI16x")  # index, type, flags, description, pixel format
FORMAT = Struct("=I4xIIIIII176x")  # type; width, height, pixel format, field, line, bytes
STREAM = Struct("=IIIII184x")  # type; capability, mode, seconds a frame: numerator, denominator
BUFFERS = Struct("=III8x")  # count, type, memory
# index, type, bytes used, flags, field; s, us; 16 time code; sequence, memory, offset, length
BUFFER = Struct("=IIIII4xqq16xIII4xI12x")
ON_OR_OFF = Struct("=i")  # type
CONTROL = Struct("=Ii")  # id, value


def _request(direction: int, number: int, what: Struct) -> int:
    return direction << 30 | what.size << 16 | ord("V") << 8 | number


QUERYCAP = _request(READ, 0, CAPABILITY)
ENUM_FMT = _request(READ | WRITE, 2, FORMAT_DESCRIPTION)
S_FMT = _request(READ | WRITE, 5, FORMAT)
REQBUFS = _request(READ | WRITE, 8, BUFFERS)
QUERYBUF = _request(READ | WRITE, 9, BUFFER)
QBUF = _request(READ | WRITE, 15, BUFFER)
DQBUF = _request(READ | WRITE, 17, BUFFER)
STREAMON = _request(WRITE, 18, ON_OR_OFF)
STREAMOFF = _request(WRITE, 19, ON_OR_OFF)
S_PARM = _request(READ | WRITE, 22, STREAM)
S_CTRL = _request(READ | WRITE, 28, CONTROL)

CAN_CAPTURE, CAN_STREAM, TELLS_OF_NODE = 0x1, 0x0400_0000, 0x8000_0000
CAPTURE, MMAP, NO_FIELD = 1, 1, 1
MJPEG, JPEG = 0x47504A4D, 0x4745504A  # "MJPG", "JPEG", the first letter lowest
HAS_ERROR, CLOCK_KINDS, IS_MONOTONIC = 0x40, 0xE000, 0x2000
EXPOSURE_MODE, EXPOSURE_100US, MANUAL = 0x009A0901, 0x009A0902, 1
MOST_FORMATS = 64


class Kernel:
    """The system's own calls."""

    def open(self, path: str) -> int:
        return os.open(path, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)

    def ioctl(self, fd: int, request: int, of: bytearray) -> None:
        """Changes `of`. Raises OSError."""
        fcntl.ioctl(fd, request, of, True)

    def map(self, fd: int, length: int, offset: int) -> Any:
        """The buffer at this offset, as bytes that can be cut."""
        return mmap.mmap(fd, length, mmap.MAP_SHARED, mmap.PROT_READ | mmap.PROT_WRITE, 0, offset)

    def close(self, fd: int) -> None:
        os.close(fd)


KERNEL = Kernel()


class Frame(NamedTuple):
    """What the driver says of a filled buffer."""

    buffer: int
    used: int  # bytes
    is_bad: bool
    stamp_us: int | None  # by the system's monotonic clock; None: by another


def asked(kernel: Kernel, fd: int, request: int, what: Struct, *values: Any) -> tuple[Any, ...]:
    """The answer to a request. Raises OSError."""
    of = bytearray(what.pack(*values))
    kernel.ioctl(fd, request, of)
    return what.unpack(of)


def buffer_of(index: int) -> tuple[Any, ...]:
    """What a request tells of a buffer, as BUFFER has it."""
    return index, CAPTURE, 0, 0, 0, 0, 0, 0, MMAP, 0, 0


def frame_of(answer: tuple[Any, ...]) -> Frame:
    index, _, used, flags, _, seconds, micros, *_ = answer
    is_ours = flags & CLOCK_KINDS == IS_MONOTONIC
    return Frame(
        index, used, bool(flags & HAS_ERROR), seconds * 1_000_000 + micros if is_ours else None
    )


def formats_of(kernel: Kernel, fd: int) -> Iterator[int]:
    """The pixel formats that it gives. Raises OSError."""
    for index in range(MOST_FORMATS):
        try:
            yield asked(kernel, fd, ENUM_FMT, FORMAT_DESCRIPTION, index, CAPTURE, 0, b"", 0)[4]
        except OSError as error:
            if error.errno != errno.EINVAL:
                raise
            return


def letters_of(pixel_format: int) -> str:
    """
    >>> letters_of(MJPEG)
    'MJPG'
    """
    return pixel_format.to_bytes(4, "little").decode("latin-1").rstrip(" \\0")


def fault_of_camera(kernel: Kernel, fd: int) -> str:
    """Why an open device gives no images that are of use, in words; "" if it does.

    Raises OSError.
    """
    try:
        *_, whole, of_node = asked(kernel, fd, QUERYCAP, CAPABILITY, b"", b"", b"", 0, 0, 0)
    except OSError as error:
        if error.errno in (errno.ENOTTY, errno.EINVAL):
            return "is no camera"
        raise
    able = of_node if whole & TELLS_OF_NODE else whole
    if not (able & CAN_CAPTURE and able & CAN_STREAM):
        return "gives no images: a camera has several nodes, another one may"
    found = list(formats_of(kernel, fd))
    if not {MJPEG, JPEG} & set(found):
        given = ", ".join(map(letters_of, found)) or "nothing"
        return f"gives no MJPEG, but {given}: mapod needs a camera that does"
    return ""


def name_of(kernel: Kernel, fd: int) -> str:
    """Of the camera. Raises OSError."""
    _, card, *_ = asked(kernel, fd, QUERYCAP, CAPABILITY, b"", b"", b"", 0, 0, 0)
    return str(card.partition(b"\0")[0].decode("utf-8", "replace"))
