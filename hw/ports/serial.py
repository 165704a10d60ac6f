"""Serial lines and ptys, opened and closed by pyserial in a thread of their own.

Source: Modbus sheet, section 6, for what a pty does.
"""

import contextlib
import errno
import fcntl
import os
import select
import sys
import termios
from concurrent.futures import wait
from functools import partial
from typing import Any

from serial.serialposix import Serial

from hw.ports.opening import Opening
from hw.ports.reopening import READ_SIZE, RETRY_FIRST_S, ReopeningPort
from hw.ports.url import PortUrl
from hw.runtime.threads import Worker

SILENCE_S = 10.0  # a restarting device is silent for seconds, and its wire is not dead
CONTROL_CHARACTERS = 6  # their place among a line's settings
NO_COUNT = bytes(4)  # of bytes that wait: an int of the system's
DRAIN_S = 0.5  # for the last bytes on closing: 480 of them at 9600 baud

OPEN_LINE: Any = Serial  # pyserial has no types


def open_line(url: PortUrl, open_it: Any) -> Any:
    """The line, open and set as its URL says; may take its time, or raise what pyserial does."""
    # A pty has no parity and always 8 bits: asked for others twice, it refuses (EINVAL).
    is_pty = os.path.realpath(url.path).startswith("/dev/pts/")
    line = open_it(
        url.path,
        baudrate=url.baud,
        bytesize=8 if is_pty else url.bytesize,
        parity="N" if is_pty else url.parity,
        stopbits=1 if is_pty else url.stopbits,
        timeout=0,
        exclusive=True,
    )
    if not is_pty:
        with contextlib.suppress(ValueError, OSError, NotImplementedError):
            line.set_low_latency_mode(True)  # an adapter that holds bytes for 16 ms
    return line


def _discard(line: Any) -> None:
    """Close at once: closing alone would wait until all is sent."""
    with contextlib.suppress(termios.error, OSError):
        termios.tcflush(line.fileno(), termios.TCIOFLUSH)
    with contextlib.suppress(OSError):
        line.close()


def _drain(line: Any, rest: bytes) -> None:
    """Close when `rest`, and all that was written before, has left."""
    with contextlib.suppress(termios.error, OSError):
        os.set_blocking(line.fileno(), True)
        while rest:
            rest = rest[os.write(line.fileno(), rest) :]
        termios.tcdrain(line.fileno())
    with contextlib.suppress(OSError):
        line.close()


def _stop_draining(fd: int) -> None:
    """Whoever waits in `_drain` waits no more."""
    with contextlib.suppress(termios.error, OSError):
        os.set_blocking(fd, False)
        termios.tcflush(fd, termios.TCOFLUSH)


class SerialPort(ReopeningPort):
    """A serial line, or a pty. A thread opens and closes it, which may take a while."""

    silence_s = SILENCE_S

    def __init__(self, url: PortUrl) -> None:
        super().__init__(url.path)
        self._url, self._worker = url, Worker()
        self._opening = Opening[Any](self._worker, lambda: open_line(url, OPEN_LINE))
        self._line: Any = None  # pyserial's, while open
        self._fd, self._gathers = -1, 0
        self._arrivals: select.epoll | None = None  # while open
        self._seen: tuple[int, ...] = ()  # the path as it was when it was last tried; () for absent
        self._look_s = float("-inf")

    def _look_around(self) -> None:
        """A path that has appeared or changed does not wait for its turn."""
        if self._look_s <= self._now_s < self._retry_s:
            self._look_s = self._now_s + RETRY_FIRST_S
            if self._path_now() != self._seen:
                self._retry_s, self._backoff_s = self._now_s, RETRY_FIRST_S

    def _path_now(self) -> tuple[int, ...]:
        """What tells one device node from the next at the same path; () if there is none."""
        try:
            found = os.stat(self._url.path)
        except OSError:
            return ()
        return (
            found.st_dev,
            found.st_ino,
            found.st_rdev,
            found.st_uid,
            found.st_gid,
            found.st_mode,
        )

    def gather(self, size: int) -> None:
        """Be readable when so many bytes have come, 1..255, and give multiples of it only."""
        if self._line is None or size == self._gathers:
            return
        with contextlib.suppress(termios.error, OSError):  # a line that is gone: reading finds it
            settings = termios.tcgetattr(self._fd)
            settings[CONTROL_CHARACTERS][termios.VMIN] = size
            termios.tcsetattr(self._fd, termios.TCSANOW, settings)
            self._gathers = size

    def set_rate(self, baud: int) -> None:
        """From now on; a line that is opened anew has the rate of its URL again."""
        if self._line is None:
            return
        with contextlib.suppress(termios.error, OSError, ValueError):  # gone: reading finds it
            self._line.baudrate = baud

    def _try_open(self) -> bool:
        if not self._opening.is_under_way:
            self._seen, self._look_s = self._path_now(), self._now_s + RETRY_FIRST_S
            if not self._seen:
                raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT))
        self._line = self._opening.maybe_opened()
        if self._line is None:
            return False
        self._fd, self._gathers = self._line.fileno(), 0
        self._arrivals = select.epoll()
        self._arrivals.register(self._fd, select.EPOLLIN | select.EPOLLET)
        return True

    def _read_into(self, pieces: list[bytes]) -> None:
        # The line itself is neither asked nor read unless the kernel has told of an arrival: where
        # nothing lies ready both wait for a worker of the kernel's, an ordinary process, which on a
        # busy machine comes tens of milliseconds later, whatever our priority.
        if self._arrivals is not None and self._arrivals.poll(0):
            size = READ_SIZE
            if self._gathers > 1:  # whole gatherings; none: it has hung up, which reading tells
                waiting = fcntl.ioctl(self._fd, termios.FIONREAD, NO_COUNT)
                count = int.from_bytes(waiting, sys.byteorder)
                size = count - count % self._gathers or READ_SIZE
            data = os.read(self._fd, size)
            if not data:  # it has hung up
                raise OSError(errno.EIO, os.strerror(errno.EIO))
            pieces.append(data)

    def _send(self, data: bytes) -> int:
        return os.write(self._fd, data)

    def _let_go(self) -> None:
        if self._arrivals is not None:
            self._arrivals.close()
        line, self._arrivals, self._line = self._line, None, None
        if line is not None:
            self._worker.submit(partial(_discard, line))

    def close(self) -> None:
        """Let go of the wire for good, once what was written has left or DRAIN_S have passed."""
        line, self._line, rest = self._line, None, bytes(self._out)
        if line is not None:
            drained = self._worker.submit(partial(_drain, line, rest))
            if wait([drained], DRAIN_S).not_done:
                _stop_draining(self._fd)
                wait([drained], DRAIN_S)
        self._opening.give_up(_discard)
        if not self._finished:
            self._worker.finish()
        super().close()

    def _descriptor(self) -> int:
        return -1 if self._arrivals is None else self._arrivals.fileno()
