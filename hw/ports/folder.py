"""A folder of images with times, sent as a web camera would, each at its time: JPEG, or depths.

`times.csv` names them: `file,t_s` in each line, without a heading, times in seconds and in order.
The first image comes as soon as the stream is asked for, the others so much later than it as their
times say. A camera.toml, where there is one, goes before them. Once all are sent the port is
closed, and stays so. A thread reads the files.
"""

import contextlib
import csv
import ctypes
import io
import math
import os
import select
import stat
from pathlib import Path

from hw.ports.opening import Opening
from hw.ports.parts import DAMAGED, HEAD, Request, part
from hw.ports.reopening import ReopeningPort
from hw.ports.url import PortUrl
from hw.runtime.threads import Worker

TIMES, CAMERA = "times.csv", "camera.toml"
CAMERA_KIND, MOST_CAMERA = "application/toml", 4096
MOST_BYTES = 512 * 1024 * 1024  # of all images: they are kept in memory
MOST_TIMES = 16 * 1024 * 1024  # of times.csv
MOST_S = 1e6  # from the first image to the last
CLOCK_MONOTONIC, TIMER_ABSTIME = 1, 1
TIMER_FLAGS = os.O_NONBLOCK | os.O_CLOEXEC
Images = list[tuple[float, bytes]]  # seconds after the first one, and a file


def size_of(path: Path) -> int:
    """Bytes of a file. Raises ValueError: it is not there, or is a pipe, whose reader may wait."""
    try:
        found = path.stat()
    except OSError as error:
        raise ValueError(f"{path.name}: {error.strerror}") from None
    if not stat.S_ISREG(found.st_mode):
        raise ValueError(f"{path.name} is no file")
    return found.st_size


def read_within(path: Path, most: int) -> bytes:
    """All of a file. Raises ValueError: it can't be read, is none, or is too large."""
    if (size := size_of(path)) > most:
        raise ValueError(f"{path.name} must be of {most} bytes or fewer, is of {size}")
    try:
        with open(path, "rb") as file:
            return file.read(most)
    except OSError as error:
        raise ValueError(f"{path.name}: {error.strerror}") from None


def _rows_of(times: bytes) -> list[list[str]]:
    try:
        return list(csv.reader(io.StringIO(times.decode("utf-8-sig"), newline="")))
    except csv.Error as error:
        raise ValueError(f"{TIMES} is no table: {error}") from None


def images_of(folder: Path) -> Images:
    """All that times.csv names. Raises ValueError: it can't be played; says why."""
    names: list[tuple[float, str]] = []
    first_s, size = math.nan, 0
    for number, row in enumerate(_rows_of(read_within(folder / TIMES, MOST_TIMES)), 1):
        try:
            name, t_s = row[0], float(row[1])
        except (ValueError, IndexError):
            name, t_s = "", math.nan
        first_s = first_s if names else t_s
        at_s = t_s - first_s
        if not name or not math.isfinite(t_s):
            raise ValueError(f"{TIMES}, line {number}: needs file,seconds; is {','.join(row)!r}")
        if at_s > MOST_S:
            raise ValueError(
                f"{TIMES}, line {number}: is {at_s:g} s after the first, over {MOST_S:g}"
            )
        if names and at_s < names[-1][0]:
            raise ValueError(f"{TIMES}, line {number}: {t_s:g} s is before the line above")
        size += size_of(folder / name)
        if size > MOST_BYTES:
            raise ValueError(f"has more than {MOST_BYTES >> 20} MiB of images: play fewer")
        names.append((at_s, name))
    if not names:
        raise ValueError(f"{TIMES} names no image")
    return [(at_s, read_within(folder / name, MOST_BYTES) or DAMAGED) for at_s, name in names]


def maybe_camera_of(folder: Path) -> bytes:
    """What is said of the lens; b"": nothing. Raises ValueError: it can't be read."""
    path = folder / CAMERA
    return read_within(path, MOST_CAMERA) if path.exists() else b""


class Timer:
    """A descriptor, readable from an instant of the monotonic clock on. timerfd_create(2)."""

    def __init__(self) -> None:
        self._libc = ctypes.CDLL(None, use_errno=True)
        self.fd = int(self._libc.timerfd_create(CLOCK_MONOTONIC, TIMER_FLAGS))
        if self.fd < 0:
            code = ctypes.get_errno()
            raise OSError(code, os.strerror(code))

    def set(self, at_s: float) -> None:
        """Forgets what was set before."""
        seconds, rest = divmod(max(1, round(at_s * 1e9)), 1_000_000_000)
        once = (ctypes.c_long * 4)(0, 0, seconds, rest)
        self._libc.timerfd_settime(self.fd, TIMER_ABSTIME, ctypes.byref(once), None)

    def is_due(self) -> bool:
        return bool(select.select([self.fd], [], [], 0)[0])

    def close(self) -> None:
        with contextlib.suppress(OSError):
            os.close(self.fd)


class FolderPort(ReopeningPort):
    """Images of a folder, once. What is written to it only opens the stream."""

    def __init__(self, url: PortUrl) -> None:
        super().__init__(url.path)
        self._path, self._worker = Path(url.path), Worker()
        self._opening = Opening(self._worker, self._read_all)
        self._images: Images = []
        self._camera = b""
        self._next = 0  # of them
        self._begun_s = math.nan  # when the first one was due
        self._timer: Timer | None = None  # while open
        self._request, self._owes_head, self._is_over = Request(), False, False

    def poll(self, now_s: float) -> bool:
        return not self._is_over and super().poll(now_s)

    def _try_open(self) -> bool:
        opened = self._opening.maybe_opened()
        if opened is None:
            return False
        self._camera, self._images = opened
        self._next, self._begun_s = 0, math.nan
        self._timer = Timer()
        self._request.begin()
        return True

    def _read_all(self) -> tuple[bytes, Images]:
        return maybe_camera_of(self._path), images_of(self._path)

    def _due_s(self) -> float:
        return self._begun_s + self._images[self._next][0]

    def _read_into(self, pieces: list[bytes]) -> None:
        assert self._timer is not None
        if self._owes_head:
            pieces.append(HEAD)
            if self._camera:
                pieces.append(part(self._camera, None, CAMERA_KIND))
            self._owes_head, self._begun_s = False, self._now_s
        if math.isnan(self._begun_s):
            return
        if self._next == len(self._images):
            self._is_over = True
            self._lose(f"all {self._next} images of {self._where} are sent")
            return
        while self._next < len(self._images) and self._is_due():
            pieces.append(part(self._images[self._next][1], round(1e6 * self._due_s())))
            self._next += 1
            if self._next < len(self._images):
                self._timer.set(self._due_s())

    def _is_due(self) -> bool:
        """By the loop's clock, or by the system's where bytes are read between two turns."""
        assert self._timer is not None
        if self._is_polled:
            return self._now_s >= self._due_s()
        return self._next > 0 and self._timer.is_due()

    def reopen(self, cause: str) -> None:
        """What is silent is the recording: it goes on at its next image."""

    def _send(self, data: bytes) -> int:
        self._owes_head |= self._request.take(data)
        return len(data)

    def _let_go(self) -> None:
        if self._timer is not None:
            self._timer.close()
        self._timer, self._images, self._owes_head = None, [], False

    def close(self) -> None:
        super().close()
        self._worker.finish()

    def _descriptor(self) -> int:
        return -1 if self._timer is None else self._timer.fd
