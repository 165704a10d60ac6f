"""Reads a Kinect by libfreenect, as a program of its own: `kinect_reader.py LIBRARY NUMBER FORMAT`.

Depth frames go to the standard output as parts of a web camera's answer, each with the instant of
its arrival by the monotonic clock and its number; what goes wrong, as the last line of the standard
error. It is a process of its own because the library ends its process where it meets what it does
not expect: an assertion, a fault of memory. It uses Python's own library alone. Of frames that
nobody has taken yet the newest is kept.

Source: libfreenect 0.5.3, libfreenect.h: the asynchronous functions.
"""

import ctypes
import os
import sys
import threading
import time

MEDIUM, RAW, MM = 1, 0, 5  # resolution of 640 x 480; depth formats
KINDS = {"raw": (RAW, "depth/raw-11"), "mm": (MM, "depth/mm")}
SIZE_PX, FRAME_BYTES = (640, 480), 614_400
CAMERA_ALONE = 2  # of its parts: neither motor nor microphones
QUIET = 0  # log level: fatal alone
BOUNDARY = "mapod-image"
HEAD = (
    f"HTTP/1.0 200 OK\r\nContent-Type: multipart/x-mixed-replace; boundary={BOUNDARY}\r\n\r\n"
).encode()
FrameCallback = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_uint32)


class FrameMode(ctypes.Structure):
    """freenect_frame_mode."""

    _fields_ = (
        ("reserved", ctypes.c_uint32),
        ("resolution", ctypes.c_int),
        ("format", ctypes.c_int32),
        ("bytes", ctypes.c_int32),
        ("width", ctypes.c_int16),
        ("height", ctypes.c_int16),
        ("data_bits", ctypes.c_int8),
        ("padding_bits", ctypes.c_int8),
        ("framerate", ctypes.c_int8),
        ("is_valid", ctypes.c_int8),
    )


class NoKinectError(Exception):
    """Why there are no frames, in words."""


class Writer:
    """Writes parts to a descriptor in a thread of its own: the newest frame wins."""

    def __init__(self, fd: int, kind: str) -> None:
        self._fd, self._kind = fd, kind
        self._wake = threading.Condition()
        self._maybe_part: bytes | None = HEAD
        self._is_over = False
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._number = 0

    def start(self) -> None:
        self._thread.start()

    def put(self, frame: bytes) -> None:
        """A frame that is complete now."""
        micros = time.monotonic_ns() // 1000
        head = (
            f"--{BOUNDARY}\r\nContent-Length: {len(frame)}\r\nContent-Type: {self._kind}\r\n"
            f"X-Timestamp: {micros // 1_000_000}.{micros % 1_000_000:06d}\r\n"
            f"X-Number: {self._number}\r\n\r\n"
        )
        with self._wake:
            self._number += 1
            begin = HEAD if self._maybe_part and self._maybe_part.startswith(HEAD) else b""
            self._maybe_part = begin + head.encode() + frame + b"\r\n"
            self._wake.notify()

    def finish(self) -> None:
        """No more comes: let what there is go out."""
        with self._wake:
            self._is_over = True
            self._wake.notify()
        self._thread.join()

    def _run(self) -> None:
        while True:
            with self._wake:
                self._wake.wait_for(lambda: self._maybe_part is not None or self._is_over)
                part, self._maybe_part = self._maybe_part, None
            if part is None:
                return
            try:
                while part:
                    part = part[os.write(self._fd, part) :]
            except OSError:  # nobody reads any more
                os._exit(0)


class Kinect:
    """One camera, started."""

    def __init__(self, library: ctypes.CDLL, number: int, depth_format: int) -> None:
        self._library = library
        self._context, self._device = ctypes.c_void_p(), ctypes.c_void_p()
        if library.freenect_init(ctypes.byref(self._context), None) < 0:
            raise NoKinectError("libfreenect does not start: is USB permitted?")
        library.freenect_set_log_level(self._context, QUIET)
        library.freenect_select_subdevices(self._context, CAMERA_ALONE)
        there = library.freenect_num_devices(self._context)
        if number >= there:
            raise NoKinectError(f"not there: libfreenect finds {max(0, there)} of them")
        opened = library.freenect_open_device(
            self._context, ctypes.byref(self._device), ctypes.c_int(number)
        )
        if opened < 0:
            raise NoKinectError("can't be opened: in use by another program, or not permitted")
        library.freenect_find_depth_mode.restype = FrameMode
        library.freenect_set_depth_mode.argtypes = [ctypes.c_void_p, FrameMode]
        mode = library.freenect_find_depth_mode(MEDIUM, depth_format)
        if not mode.is_valid or (mode.width, mode.height, mode.bytes) != (*SIZE_PX, FRAME_BYTES):
            raise NoKinectError("libfreenect has no such depth format")
        if library.freenect_set_depth_mode(self._device, mode) < 0:
            raise NoKinectError("does not take its depth format")

    def run(self, writer: Writer) -> None:
        """Hand all frames over, until the library ends. Raises NoKinectError, always."""

        def take(device: int, depth: int, stamp: int) -> None:
            writer.put(ctypes.string_at(depth, FRAME_BYTES))

        library, kept = self._library, FrameCallback(take)
        library.freenect_set_depth_callback(self._device, kept)
        if library.freenect_start_depth(self._device) < 0:
            raise NoKinectError("does not start")
        writer.start()
        while library.freenect_process_events(self._context) >= 0:
            pass
        writer.finish()
        raise NoKinectError("gone; or, of a dump, played to its end")


def main(path: str, number: str, form: str) -> int:
    """Exit status, always 1: it ends only when there are no frames, or no more."""
    out = os.dup(1)
    os.dup2(2, 1)  # what the library prints is no frame
    depth_format, kind = KINDS[form]
    try:
        try:
            library = ctypes.CDLL(path)
        except OSError as error:
            raise NoKinectError(
                f"needs libfreenect: apt install libfreenect0.5 ({error})"
            ) from None
        Kinect(library, int(number), depth_format).run(Writer(out, kind))
    except NoKinectError as error:
        sys.stderr.write(f"\n{error}\n")
        sys.stderr.flush()
    return 1


if __name__ == "__main__":
    os._exit(main(*sys.argv[1:]))
