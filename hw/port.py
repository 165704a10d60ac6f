"""Wires by URL: TCP, UDP and serial lines that open, lose and reopen without ever waiting.

    tcp://host:port    udp://host:port    serial:///path?baud=9600&parity=E&bytesize=7&stopbits=1

A host's name is looked up once, in open_port, before the loop runs; nothing after it waits.
Time is what poll() is told. Source: Modbus sheet, section 6, for serial lines and ptys.
"""

import contextlib
import errno
import os
import select
import socket
import termios
from typing import Any

from serial.serialposix import Serial

from hw.port_url import PortUrl, PortUrlError, parse_url
from hw.session import Port

__all__ = ["PortUrlError", "open_port", "parse_url"]

CONNECT_S = 3.0
RETRY_FIRST_S, RETRY_LAST_S = 0.2, 5.0  # doubling; from the first again once bytes arrived
READ_SIZE = 65536  # bytes a call
DATAGRAM_SIZE, DATAGRAMS = 2048, 64  # bytes each, so many a call
BACKLOG = 65536  # bytes not yet taken by the wire, beyond which the connection is given up
TCP_OPTIONS = {  # commands leave at once; a peer that acknowledges nothing for 6 s is gone
    socket.TCP_NODELAY: 1,
    socket.TCP_KEEPIDLE: 3,
    socket.TCP_KEEPINTVL: 1,
    socket.TCP_KEEPCNT: 3,
    socket.TCP_USER_TIMEOUT: 6000,
}

OPEN_LINE: Any = Serial  # pyserial has no types
Address = tuple[Any, ...]
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


def open_port(url: str) -> Port:
    """The port of a URL, not opened yet: polling does that.

    Raises:
        PortUrlError: no such kind of port, a part missing or out of range, a host without address.
    """
    parts = parse_url(url)
    match parts.kind:
        case "serial":
            return SerialPort(parts)
        case "tcp":
            return TcpPort(parts, _address(url, parts))
        case "udp":
            return UdpPort(parts, _address(url, parts))


def _address(url: str, peer: PortUrl) -> tuple[int, Address]:
    """Family and address; only a name that is no number is looked up."""
    kind = socket.SOCK_STREAM if peer.kind == "tcp" else socket.SOCK_DGRAM
    try:
        try:
            found = socket.getaddrinfo(peer.host, peer.port, type=kind, flags=socket.AI_NUMERICHOST)
        except socket.gaierror:
            found = socket.getaddrinfo(peer.host, peer.port, type=kind)
    except (OSError, UnicodeError):
        raise PortUrlError(f"{url!r}: the host {peer.host!r} has no known address") from None
    family, _, _, _, address = found[0]
    return family, address


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
        self.cause, self.opened, self.backlog = "not opened yet", 0, 0
        self._where = where
        self._out = bytearray()
        self._is_open = self._finished = False
        self._delivered = False  # bytes, since it was opened
        self._now_s = self._retry_s = float("-inf")
        self._backoff_s = RETRY_FIRST_S

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
        self.backlog = 0
        self._is_open = False
        if not self._finished:
            self.cause = cause
        self._retry_s = self._now_s + self._backoff_s
        self._backoff_s = min(2 * self._backoff_s, RETRY_LAST_S)

    def _flush(self) -> None:
        with contextlib.suppress(BlockingIOError):
            while self._out and (taken := self._send(bytes(self._out[:READ_SIZE]))):
                del self._out[:taken]
        self.backlog = len(self._out)

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
        """Close what is open or half open."""
        raise NotImplementedError


class TcpPort(_ReopeningPort):
    """A TCP connection, as its client."""

    def __init__(self, peer: PortUrl, address: tuple[int, Address]) -> None:
        super().__init__(f"{peer.host}:{peer.port}")
        self._family, self._address = address
        self._socket: socket.socket | None = None  # connecting, or connected
        self._deadline_s = float("inf")

    def _try_open(self) -> bool:
        if self._socket is None:
            self._begin()
        assert self._socket is not None
        if code := self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR):
            raise OSError(code, os.strerror(code))
        try:
            peer = self._socket.getpeername()
        except OSError:  # not connected yet
            if self._now_s >= self._deadline_s:
                self._lose(f"no answer from {self._where} within {CONNECT_S:g} s")
            return False
        if peer == self._socket.getsockname():
            # Nobody listens there, and our own end happened to get the very port: TCP allows it.
            raise OSError(errno.ECONNREFUSED, os.strerror(errno.ECONNREFUSED))
        return True

    def _begin(self) -> None:
        if not self.opened and self.cause == "not opened yet":
            self.cause = f"connecting to {self._where}"
        self._deadline_s = self._now_s + CONNECT_S
        self._socket = socket.socket(self._family, socket.SOCK_STREAM)
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        for option, value in TCP_OPTIONS.items():
            self._socket.setsockopt(socket.IPPROTO_TCP, option, value)
        code = self._socket.connect_ex(self._address)
        if code not in (0, errno.EINPROGRESS):
            raise OSError(code, os.strerror(code))

    def _read_into(self, pieces: list[bytes]) -> None:
        assert self._socket is not None
        try:
            data = self._socket.recv(READ_SIZE)
        except BlockingIOError:
            return
        if data:
            pieces.append(data)
        else:
            self._lose(REASONS[errno.EPIPE].format(where=self._where))

    def _send(self, data: bytes) -> int:
        assert self._socket is not None
        return self._socket.send(data)

    def _let_go(self) -> None:
        if self._socket is not None:
            self._socket.close()
        self._socket = None


class UdpPort(_ReopeningPort):
    """Datagrams to and from one peer, who need not be there: what can't be sent is lost."""

    datagrams = True

    def __init__(self, peer: PortUrl, address: tuple[int, Address]) -> None:
        super().__init__(f"{peer.host}:{peer.port}")
        self.refused = 0  # times that the peer's host said that nobody listens there
        self.unsent = 0  # datagrams for which there was no room on the way out
        self._family, self._address = address
        self._socket: socket.socket | None = None

    def write(self, data: bytes) -> None:
        """Send one datagram, now or never."""
        if self._socket is None or not data:
            return
        try:
            try:
                self._socket.send(data)
            except ConnectionRefusedError:  # tells of an earlier one; this one did not leave yet
                self.refused += 1
                self._socket.send(data)
        except ConnectionRefusedError:
            self.refused += 1
        except OSError as error:
            self.unsent += 1
            if not isinstance(error, BlockingIOError) and error.errno != errno.EMSGSIZE:
                self._lose(_in_words(error, self._where))  # a new socket gets the new route

    def _try_open(self) -> bool:
        self._socket = socket.socket(self._family, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.connect(self._address)  # waits for nothing: it only names the peer
        return True

    def _read_into(self, pieces: list[bytes]) -> None:
        assert self._socket is not None
        for _ in range(DATAGRAMS):
            try:
                pieces.append(self._socket.recv(DATAGRAM_SIZE))
            except BlockingIOError:
                return
            except ConnectionRefusedError:
                self.refused += 1

    def _let_go(self) -> None:
        if self._socket is not None:
            self._socket.close()
        self._socket = None


class SerialPort(_ReopeningPort):
    """A serial line, or a pty. pyserial opens and sets it; bytes go by its descriptor."""

    def __init__(self, line: PortUrl) -> None:
        super().__init__(line.path)
        self._line = line
        self._serial: Any = None  # while open
        self._fd = -1
        self._hang_up = select.poll()

    def _try_open(self) -> bool:
        line = self._line
        # A pty has no parity and always 8 bits: asked for others twice, it refuses (EINVAL).
        is_pty = os.path.realpath(line.path).startswith("/dev/pts/")
        self._serial = OPEN_LINE(
            line.path,
            baudrate=line.baud,
            bytesize=8 if is_pty else line.bytesize,
            parity="N" if is_pty else line.parity,
            stopbits=1 if is_pty else line.stopbits,
            timeout=0,
            exclusive=True,
        )
        self._fd = self._serial.fileno()
        self._hang_up = select.poll()
        self._hang_up.register(self._fd, 0)
        return True

    def _read_into(self, pieces: list[bytes]) -> None:
        is_gone = bool(self._hang_up.poll(0))  # asked first: what was sent before is read below
        left = READ_SIZE
        with contextlib.suppress(BlockingIOError):
            while left > 0 and (data := os.read(self._fd, left)):
                pieces.append(data)
                left -= len(data)
        if is_gone and left == READ_SIZE:
            raise OSError(errno.EIO, os.strerror(errno.EIO))

    def _send(self, data: bytes) -> int:
        return os.write(self._fd, data)

    def _let_go(self) -> None:
        if self._serial is None:
            return
        with contextlib.suppress(termios.error, OSError):
            termios.tcflush(self._fd, termios.TCIOFLUSH)  # else close waits until all is sent
        with contextlib.suppress(OSError):
            self._serial.close()
        self._serial = None
