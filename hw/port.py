"""Wires by URL: TCP, UDP and serial lines that open, lose and reopen without ever waiting.

    tcp://host:port    udp://host:port    serial:///path?baud=9600&parity=E&bytesize=7&stopbits=1

A host's name is looked up once, in open_port, before the loop runs; nothing after it waits.
Time is what poll() is told. Source: Modbus sheet, section 6, for serial lines and ptys.
"""

import errno
import os
import select
import socket
import termios
from typing import Protocol

import serial

from hw.port_url import PortUrlError, SerialUrl, SocketUrl, parse_url
from hw.session import Port

CONNECT_S = 3.0
RETRY_FIRST_S, RETRY_LAST_S = 0.2, 5.0  # doubling; from the first again once bytes arrived
READ_SIZE = 65536  # bytes a call
DATAGRAM_SIZE, DATAGRAMS = 2048, 64  # bytes each, so many a call
BACKLOG = 65536  # bytes not taken by the wire, beyond which the connection is given up
KEEPALIVE = {"TCP_KEEPIDLE": 3, "TCP_KEEPINTVL": 1, "TCP_KEEPCNT": 3}  # seconds, seconds, probes
UNANSWERED_MS = 6000  # a peer that acknowledges nothing for so long is gone

REASONS = {
    errno.ECONNREFUSED: "connection refused by {where}",
    errno.ECONNRESET: "connection reset by {where}",
    errno.EPIPE: "connection closed by {where}",
    errno.ETIMEDOUT: "{where} does not answer any more",
    errno.EHOSTUNREACH: "no way to reach {where}",
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


class _Wire(Protocol):
    """One opening of a port; its calls raise OSError when it is lost."""

    def fileno(self) -> int:
        """The descriptor."""

    def close(self) -> None:
        """Let go of it, at once."""


def open_port(url: str) -> Port:
    """The port of a URL, not opened yet: polling does that.

    Raises:
        PortUrlError: no such kind of port, a part missing or out of range, a host without address.
    """
    match parse_url(url):
        case SerialUrl() as line:
            return SerialPort(line)
        case SocketUrl("tcp") as peer:
            return TcpPort(peer, _address(url, peer))
        case peer:
            return UdpPort(peer, _address(url, peer))


def _address(url: str, peer: SocketUrl) -> tuple[int, tuple[str, int]]:
    """Family and address; only a name that is no number is looked up."""
    kind = socket.SOCK_STREAM if peer.kind == "tcp" else socket.SOCK_DGRAM
    try:
        try:
            found = socket.getaddrinfo(
                peer.host, peer.port, type=kind, flags=socket.AI_NUMERICHOST
            )
        except socket.gaierror:
            found = socket.getaddrinfo(peer.host, peer.port, type=kind)
    except (OSError, UnicodeError):
        raise PortUrlError(f"{url!r}: the host {peer.host!r} has no known address") from None
    family, _, _, _, address = found[0]
    return family, (str(address[0]), int(address[1]))


def _in_words(error: OSError | termios.error | ValueError, where: str) -> str:
    """Why a wire did not open, or was lost."""
    code = error.args[0] if error.args and isinstance(error.args[0], int) else 0
    if code in REASONS:
        return REASONS[code].format(where=where)
    return f"{where}: {os.strerror(code) if code else error}"


class _ReopeningPort:
    """What all kinds share: opening, back-off, loss with its cause, bounded output."""

    datagrams = False

    def __init__(self, where: str) -> None:
        self.cause, self.opened = "not opened yet", 0
        self._where = where
        self._out = bytearray()
        self._is_open = self._finished = False
        self._delivered = False  # bytes, since it was opened
        self._now_s = self._retry_s = float("-inf")
        self._backoff_s = RETRY_FIRST_S

    @property
    def backlog(self) -> int:
        """Bytes accepted and not yet taken by the wire."""
        return len(self._out)

    def poll(self, now_s: float) -> bool:
        """Move on with opening, or with what is still to be written; True while open."""
        self._now_s = now_s
        if self._finished:
            return False
        try:
            if not self._is_open and now_s >= self._retry_s and self._try_open():
                self._is_open, self._delivered = True, False
                self.cause, self.opened = "", self.opened + 1
            if self._is_open:
                self._flush()
        except (OSError, termios.error, ValueError) as error:  # ValueError: an impossible baud rate
            self._lose(_in_words(error, self._where))
        return self._is_open

    def read(self) -> list[bytes]:
        """The pieces that have arrived: cut anywhere, or whole datagrams."""
        pieces: list[bytes] = []
        if self._is_open:
            try:
                self._read_into(pieces)
            except OSError as error:
                self._lose(_in_words(error, self._where))
        if pieces and not self._delivered:
            self._delivered, self._backoff_s = True, RETRY_FIRST_S
        return pieces

    def write(self, data: bytes) -> None:
        """Hand over for sending, in order; dropped while the port is not open."""
        if not self._is_open or not data:
            return
        self._out += data
        try:
            self._flush()
        except OSError as error:
            self._lose(_in_words(error, self._where))
        if len(self._out) > BACKLOG:
            self._lose(f"{self._where} is not taking bytes")

    def close(self) -> None:
        """Let go of the wire for good, without waiting for what is still to be written."""
        self._lose("closed")
        self._finished = True

    def _lose(self, cause: str) -> None:
        self._let_go()
        self._out.clear()
        self._is_open = False
        if not self._finished:
            self.cause = cause
        # A loss that read() finds is retried no sooner than one that poll() finds.
        self._retry_s = self._now_s + self._backoff_s
        self._backoff_s = min(2 * self._backoff_s, RETRY_LAST_S)

    def _flush(self) -> None:
        while self._out:
            try:
                sent = self._send(memoryview(self._out)[:READ_SIZE])
            except BlockingIOError:
                return
            if not sent:
                return
            del self._out[:sent]

    def _try_open(self) -> bool:
        """Begin to open, or go on with it; True once open; raises OSError if that failed."""
        raise NotImplementedError

    def _read_into(self, pieces: list[bytes]) -> None:
        """Append what has arrived; raises OSError if the wire is gone."""
        raise NotImplementedError

    def _send(self, data: memoryview) -> int:
        """How many bytes the wire took; raises BlockingIOError for none, OSError if it is gone."""
        raise NotImplementedError

    def _let_go(self) -> None:
        """Close what is open or half open."""
        raise NotImplementedError
