"""Fake video device: what the kernel answers for a USB camera, at the level of its calls.

A driver's state machine in the form of open, ioctl, mmap and close: formats, buffers that are
queued, filled in turn and taken back, and a node that comes and goes. Images are given by `show`;
one for which no buffer is queued is lost, as in a driver.
Source: the kernel's documentation, Video for Linux API; field offsets of linux/videodev2.h on a
64-bit system.
"""

import errno
import os
import struct
from collections import deque

NUMBERS = {  # of requests, with the bytes of what they carry
    (0, 104): "capability",
    (2, 64): "formats",
    (5, 208): "format",
    (8, 20): "room",
    (9, 88): "look",
    (15, 88): "queue",
    (17, 88): "take",
    (18, 4): "on",
    (19, 4): "off",
    (22, 204): "rate",
    (28, 8): "control",
}
PAGE, ROOM = 4096, 128 * 1024  # of a buffer
ALL_CAPABILITIES, OF_THIS_NODE = 0x84A00001, 0x04200001
MONOTONIC, BAD = 0x2000, 0x40
EXPOSURE_MODE, EXPOSURE = 0x9A0901, 0x9A0902


class Mapped(bytearray):
    """A buffer, the driver's and its user's."""

    def close(self) -> None:
        """No more its user's."""


class FakeVideo:
    """One camera. Its properties and faults are attributes, to be set at any time."""

    def __init__(self) -> None:
        self.formats = [b"YUYV", b"MJPG"]
        self.is_camera = True  # else a device that knows none of this
        self.of_this_node = OF_THIS_NODE
        self.refuses_exposure = False
        self.clock = MONOTONIC  # flags of its images' times
        self.is_bad = False  # its images are called damaged
        self.is_used = False  # by another program
        self.size, self.pixels, self.rate_hz = (0, 0), b"", 0.0  # as set
        self.controls: dict[int, int] = {}
        self.lost = 0  # images for which no buffer was queued
        self._sequence = 0
        self._fd, self._is_on, self._is_gone = -1, False, False
        self._buffers: list[Mapped] = []
        self._queued: deque[int] = deque()
        self._filled: deque[tuple[int, int, int, int]] = deque()  # buffer, bytes, us, flags

    @property
    def is_open(self) -> bool:
        return self._fd >= 0

    def show(self, image: bytes, t_s: float) -> None:
        """The camera has exposed an image."""
        if not self._is_on:
            return
        if not self._queued:
            self.lost += 1
            return
        index = self._queued.popleft()
        self._buffers[index][: len(image)] = image
        flags = self.clock | (BAD if self.is_bad else 0)
        self._filled.append((index, len(image), round(t_s * 1e6), flags))
        os.eventfd_write(self._fd, 1)

    def unplug(self) -> None:
        """Who has it open finds out by the next call."""
        self._is_gone = True
        if self._fd >= 0:
            os.eventfd_write(self._fd, 1)

    def plug(self) -> None:
        self._is_gone = False

    def open(self, path: str) -> int:
        if self._is_gone or not os.path.exists(path):
            raise OSError(errno.ENODEV, os.strerror(errno.ENODEV))
        if not os.access(path, os.R_OK | os.W_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
        self._fd = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        return self._fd

    def close(self, fd: int) -> None:
        os.close(fd)
        self._fd, self._is_on = -1, False
        self._queued.clear()
        self._filled.clear()

    def map(self, fd: int, length: int, offset: int) -> "Mapped":
        if length != ROOM or offset % PAGE:
            raise OSError(errno.EINVAL, "mmap")
        return self._buffers[offset // ROOM]

    def ioctl(self, fd: int, request: int, of: bytearray) -> None:
        size, kind, number = request >> 16 & 0x3FFF, request >> 8 & 0xFF, request & 0xFF
        if self._is_gone:
            raise OSError(errno.ENODEV, "ioctl")
        name = NUMBERS.get((number, size))
        if fd != self._fd or kind != ord("V") or name is None or not self.is_camera:
            raise OSError(errno.ENOTTY, "ioctl")
        if len(of) != size:
            raise OSError(errno.EFAULT, "ioctl")
        getattr(self, f"_{name}")(of)

    def _capability(self, of: bytearray) -> None:
        of[16:48] = b"Fake camera".ljust(32, b"\0")
        struct.pack_into("<II", of, 84, ALL_CAPABILITIES, self.of_this_node)

    def _formats(self, of: bytearray) -> None:
        index, kind = struct.unpack_from("<II", of)
        if kind != 1 or index >= len(self.formats):
            raise OSError(errno.EINVAL, "formats")
        of[44:48] = self.formats[index]

    def _format(self, of: bytearray) -> None:
        if self._buffers and self._is_on:
            raise OSError(errno.EBUSY, "format")
        self.size, self.pixels = struct.unpack_from("<II", of, 8), bytes(of[16:20])
        struct.pack_into("<I", of, 28, ROOM)

    def _rate(self, of: bytearray) -> None:
        seconds, frames = struct.unpack_from("<II", of, 12)
        self.rate_hz = frames / seconds

    def _control(self, of: bytearray) -> None:
        if self.refuses_exposure:
            raise OSError(errno.EINVAL, "control")
        number, value = struct.unpack_from("<Ii", of)
        self.controls[number] = value

    def _room(self, of: bytearray) -> None:
        count, kind, memory = struct.unpack_from("<III", of)
        if self.is_used:
            raise OSError(errno.EBUSY, "buffers")
        if (kind, memory) != (1, 1):
            raise OSError(errno.EINVAL, "buffers")
        self._buffers = [Mapped(ROOM) for _ in range(count)]

    def _look(self, of: bytearray) -> None:
        index = self._index(of)
        struct.pack_into("<I", of, 64, index * ROOM)
        struct.pack_into("<I", of, 72, ROOM)

    def _queue(self, of: bytearray) -> None:
        self._queued.append(self._index(of))

    def _take(self, of: bytearray) -> None:
        if not self._is_on:
            raise OSError(errno.EINVAL, "take")
        if not self._filled:
            raise BlockingIOError(errno.EAGAIN, "take")
        index, used, at_us, flags = self._filled.popleft()
        if not self._filled:
            os.eventfd_read(self._fd)
        struct.pack_into("<IIII", of, 0, index, 1, used, flags)
        struct.pack_into("<qq", of, 24, *divmod(at_us, 1_000_000))
        struct.pack_into("<I", of, 56, self._sequence)
        self._sequence += 1

    def _on(self, of: bytearray) -> None:
        self._is_on = True

    def _off(self, of: bytearray) -> None:
        self._is_on = False
        self._queued.clear()
        self._filled.clear()

    def _index(self, of: bytearray) -> int:
        index, kind = struct.unpack_from("<II", of)
        if kind != 1 or index >= len(self._buffers) or struct.unpack_from("<I", of, 60)[0] != 1:
            raise OSError(errno.EINVAL, "buffer")
        return int(index)
