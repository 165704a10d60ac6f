"""A wire that opens, is lost and reopens by itself: what TCP, UDP and serial lines share.

Source: the rules in hw/ports/wires.py; reasons are the operating system's, in our words.
"""

import errno
import os
import termios

RETRY_FIRST_S, RETRY_LAST_S = 0.2, 5.0  # doubling; from the first again once bytes arrived
CHEAP_LAST_S = 0.5  # the longest pause after what cost nobody anything
READ_SIZE = 65536  # bytes a call
BACKLOG = 65536  # bytes not yet taken by the wire, beyond which the connection is given up
SILENCE_S = 2.5  # of a device that had spoken, after which its wire may be dead

REASONS = {
    errno.ECONNREFUSED: "connection refused by {where}",
    errno.ECONNRESET: "connection reset by {where}",
    errno.EPIPE: "connection closed by {where}",
    errno.ETIMEDOUT: "{where} does not answer any more",
    errno.EHOSTUNREACH: "no answer from {where}",  # to the neighbour's address, as to our packets
    errno.ENETUNREACH: "no network that leads to {where}",
    errno.ENOENT: "no such device {where}",
    errno.ENXIO: "no such device {where}",
    errno.ENODEV: "no such device {where}",
    errno.EACCES: "no permission for {where}",
    errno.EAGAIN: "{where} is in use by another program",
    errno.EBUSY: "{where} is in use by another program",
    errno.EIO: "{where} is gone",
    errno.ENOTTY: "{where} is not a serial line",
}


CHEAP = {errno.ECONNREFUSED, errno.EHOSTUNREACH, errno.ENETUNREACH, errno.ENETDOWN}


def describe_loss(error: OSError | termios.error | ValueError, where: str) -> str:
    told = error.__context__ if isinstance(error.__context__, termios.error) else error
    code = told.args[0] if told.args and isinstance(told.args[0], int) else 0
    if code in REASONS:
        return REASONS[code].format(where=where)
    return f"{where}: {os.strerror(code) if code else error}"


class ReopeningPort:
    """What all kinds share: opening, back-off, loss with its cause, bounded output."""

    datagrams = False
    silence_s = SILENCE_S

    def __init__(self, where: str) -> None:
        self.cause, self.opened, self.backlog = "not opened yet", 0, 0
        self._where = where
        self._out = bytearray()
        self._is_open = self._finished = False
        self._delivered = False  # bytes, since it was opened
        self._is_polled = False  # since it was read
        self._now_s = self._retry_s = float("-inf")
        self._backoff_s = RETRY_FIRST_S

    def poll(self, now_s: float) -> bool:
        self._now_s, self._is_polled = now_s, True
        if self._finished:
            return False
        if self._is_open and not self._out:  # as nearly always
            return True
        if not self._is_open:
            self._look_around()
        try:
            if not self._is_open and now_s >= self._retry_s and self._try_open():
                self._is_open, self._delivered = True, False
                self.cause, self.opened = "", self.opened + 1
            if self._is_open:
                self._flush()
        except (OSError, termios.error, ValueError) as error:  # ValueError: an impossible baud rate
            self._lose(describe_loss(error, self._where))
            if isinstance(error, OSError) and error.errno in CHEAP:
                self._try_soon(CHEAP_LAST_S)
        return self._is_open

    def read(self) -> list[bytes]:
        pieces: list[bytes] = []
        if self._is_open:
            try:
                self._read_into(pieces)
            except BlockingIOError:  # nothing
                pass
            except OSError as error:
                self._lose(describe_loss(error, self._where))
        self._is_polled = False
        if pieces and not self._delivered:
            self._delivered, self._backoff_s = True, RETRY_FIRST_S
        return pieces

    def write(self, data: bytes) -> None:
        if not self._is_open or not data:
            return
        self._out += data
        try:
            self._flush()
        except OSError as error:
            self._lose(describe_loss(error, self._where))
        if len(self._out) > BACKLOG:
            self._lose(f"{self._where} is not taking bytes")

    def reopen(self, cause: str) -> None:
        if self._is_open:
            self._lose(cause)
            self._try_soon(RETRY_FIRST_S)

    def fileno(self) -> int:
        return self._descriptor() if self._is_open else -1

    def close(self) -> None:
        """Let go of the wire for good, without waiting for what is still to be written."""
        self._lose("closed")
        self._finished = True

    def _lose(self, cause: str) -> None:
        self._let_go()
        self._out.clear()
        self.backlog = 0
        self._is_open = False
        if not self._finished:
            self.cause = cause
        self._retry_s = self._now_s + self._backoff_s
        self._backoff_s = min(2 * self._backoff_s, RETRY_LAST_S)

    def _try_soon(self, within_s: float) -> None:
        """What failed was cheap: tried again within this time, however often it has failed."""
        self._backoff_s = min(self._backoff_s, within_s)
        self._retry_s = min(self._retry_s, self._now_s + within_s)

    def _flush(self) -> None:
        try:
            while self._out and (taken := self._send(bytes(self._out[:READ_SIZE]))):
                del self._out[:taken]
        except BlockingIOError:  # later
            return
        finally:
            self.backlog = len(self._out)

    def _look_around(self) -> None:
        """Closed: something may speak for trying sooner."""

    def _try_open(self) -> bool:
        """Begin to open, or go on with it; True once open; raises OSError if that failed."""
        raise NotImplementedError

    def _read_into(self, pieces: list[bytes]) -> None:
        """Append what has arrived; raises OSError if the wire is gone."""
        raise NotImplementedError

    def _send(self, data: bytes) -> int:
        """How many bytes the wire took; raises BlockingIOError for none, OSError if it is gone."""
        raise NotImplementedError

    def _let_go(self) -> None:
        raise NotImplementedError

    def _descriptor(self) -> int:
        raise NotImplementedError
