"""A camera of this machine, by Video for Linux: its MJPEG images as a web camera's answer.

A thread opens and closes it, for that may take a while; a request that is written begins the
stream. The driver fills buffers that are mapped, and tells by its descriptor when one is full. An
image that the driver calls damaged is told as a part that is no JPEG, and so counted.
Source: Video for Linux API, streaming I/O (memory mapping).
"""

import contextlib
import errno
import os
import select
import struct
from functools import partial
from typing import Any

from hw.ports import v4l2
from hw.ports.opening import Opening
from hw.ports.parts import DAMAGED, HEAD, Request, part
from hw.ports.reopening import CHEAP_LAST_S, REASONS, ReopeningPort
from hw.ports.url import PortUrl
from hw.ports.v4l2 import CAPTURE, KERNEL, Kernel, asked
from hw.runtime.threads import Worker

BUFFERS = 4


class OpenCamera:
    """A camera that streams: its descriptor and buffers."""

    def __init__(self, kernel: Kernel, fd: int) -> None:
        self.fd, self._kernel = fd, kernel
        self.buffers: list[Any] = []

    def take(self) -> tuple[bytes, int | None]:
        """An image and its time. Raises OSError; BlockingIOError: none is ready."""
        kernel, fd = self._kernel, self.fd
        frame = v4l2.frame_of(asked(kernel, fd, v4l2.DQBUF, v4l2.BUFFER, *v4l2.buffer_of(0)))
        if frame.buffer >= len(self.buffers):
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        image = DAMAGED if frame.is_bad else bytes(self.buffers[frame.buffer][: frame.used])
        asked(kernel, fd, v4l2.QBUF, v4l2.BUFFER, *v4l2.buffer_of(frame.buffer))
        return image or DAMAGED, frame.stamp_us

    def close(self) -> None:
        with contextlib.suppress(OSError):
            asked(self._kernel, self.fd, v4l2.STREAMOFF, v4l2.ON_OR_OFF, CAPTURE)
        for buffer in self.buffers:
            buffer.close()
        with contextlib.suppress(OSError):
            self._kernel.close(self.fd)


def open_camera(url: PortUrl, kernel: Kernel) -> OpenCamera:
    """The camera, streaming as its URL says; may take its time.

    Raises:
        OSError: it is not there, not permitted, or used by another.
        ValueError: it can't do that; says why.
    """
    if struct.calcsize("@l") != 8:
        raise ValueError("cameras need a 64-bit system")
    camera = OpenCamera(kernel, kernel.open(url.path))
    try:
        if why := v4l2.fault_of_camera(kernel, camera.fd):
            raise ValueError(why)
        _set(url, kernel, camera.fd)
        _begin(kernel, camera)
    except (OSError, ValueError):
        camera.close()
        raise
    return camera


def _set(url: PortUrl, kernel: Kernel, fd: int) -> None:
    """Size, rate and exposure; the size that it then has its images tell."""
    width, height = url.size
    formats = set(v4l2.formats_of(kernel, fd))
    pixels = v4l2.MJPEG if v4l2.MJPEG in formats else v4l2.JPEG
    asked(
        *(kernel, fd, v4l2.S_FMT, v4l2.FORMAT),
        *(CAPTURE, width, height, pixels, v4l2.NO_FIELD, 0, 0),
    )
    with contextlib.suppress(OSError):  # one that has a single rate need not know this
        asked(kernel, fd, v4l2.S_PARM, v4l2.STREAM, CAPTURE, 0, 0, 1, url.rate_hz)
    if url.exposure_us is not None:
        try:
            mode = v4l2.EXPOSURE_MODE, v4l2.MANUAL
            asked(kernel, fd, v4l2.S_CTRL, v4l2.CONTROL, *mode)
            time = v4l2.EXPOSURE_100US, url.exposure_us // 100
            asked(kernel, fd, v4l2.S_CTRL, v4l2.CONTROL, *time)
        except OSError as error:
            why = os.strerror(error.errno or 0)
            raise ValueError(f"does not take exposure_us={url.exposure_us}: {why}") from None


def _begin(kernel: Kernel, camera: OpenCamera) -> None:
    """Map its buffers, give them to the driver, and start."""
    fd = camera.fd
    count, *_ = asked(kernel, fd, v4l2.REQBUFS, v4l2.BUFFERS, BUFFERS, CAPTURE, v4l2.MMAP)
    for index in range(count):
        told = asked(kernel, fd, v4l2.QUERYBUF, v4l2.BUFFER, *v4l2.buffer_of(index))
        offset, length = told[-2:]
        camera.buffers.append(kernel.map(fd, length, offset))
        asked(kernel, fd, v4l2.QBUF, v4l2.BUFFER, *v4l2.buffer_of(index))
    asked(kernel, fd, v4l2.STREAMON, v4l2.ON_OR_OFF, CAPTURE)


class CameraPort(ReopeningPort):
    """A camera of this machine. What is written to it only opens the stream."""

    def __init__(self, url: PortUrl, kernel: Kernel = KERNEL) -> None:
        super().__init__(url.path)
        self._url, self._worker = url, Worker()
        self._opening = Opening(self._worker, partial(open_camera, url, kernel))
        self._camera: OpenCamera | None = None  # while open
        self._arrivals: select.epoll | None = None  # as long
        self._request, self._owes_head = Request(), False

    def _try_open(self) -> bool:
        if not self._opening.is_under_way and not os.path.exists(self._url.path):
            self._lose(REASONS[errno.ENODEV].format(where=self._where))
            self._try_soon(CHEAP_LAST_S)  # looking costs nobody anything
            return False
        self._camera = self._opening.maybe_opened()
        if self._camera is None:
            return False
        self._arrivals = select.epoll()
        self._arrivals.register(self._camera.fd, select.EPOLLIN)
        self._request.begin()
        return True

    def _read_into(self, pieces: list[bytes]) -> None:
        assert self._camera is not None
        assert self._arrivals is not None
        if self._owes_head:
            pieces.append(HEAD)
            self._owes_head = False
        for _ in range(BUFFERS):
            if not self._arrivals.poll(0):
                return
            image, stamp_us = self._camera.take()
            if self._request.is_whole:
                pieces.append(part(image, stamp_us))

    def _send(self, data: bytes) -> int:
        self._owes_head |= self._request.take(data)
        return len(data)

    def _let_go(self) -> None:
        if self._arrivals is not None:
            self._arrivals.close()
        camera, self._arrivals, self._camera = self._camera, None, None
        self._owes_head = False
        if camera is not None:
            self._worker.submit(camera.close)

    def close(self) -> None:
        """Let go of it for good, without waiting until it is closed."""
        self._opening.give_up(OpenCamera.close)
        super().close()
        self._worker.finish()

    def _descriptor(self) -> int:
        return -1 if self._arrivals is None else self._arrivals.fileno()
