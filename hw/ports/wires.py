"""Wires by URL: TCP, UDP and serial lines that open, lose and reopen without ever waiting.

    tcp://host:port    udp://host:port    serial:///path?baud=9600&parity=E&bytesize=7&stopbits=1

A host's name is looked up once, in open_port, before the loop runs; nothing after it waits.
Time is what poll() is told. Source: Modbus sheet, section 6, for serial lines and ptys.

When it is tried again. What costs nobody anything is tried often, so that a device is found soon
after it is back; what a device has to bear, or can't become better soon, is tried ever less often.
  - A host that does not answer is asked anew every CONNECT_S, without end: one small packet each,
    while the kernel would wait 1, 2, 4 s between its own. One that needs longer to answer is too
    far away to keep a map fresh.
  - A host that refuses is there, its service not yet: after 0.2, 0.4, then each CHEAP_LAST_S. So
    with what the kernel knows without asking: that no way leads there.
  - A serial path that is not there is looked at, not opened, every RETRY_FIRST_S; as soon as it is
    there, or another than the one that failed (new device node, new owner), it is opened.
  - A connection dropped because nothing was heard on it is renewed at once: it was long enough.
  - Whatever opens and brings nothing, or fails otherwise: after 0.2, 0.4, .. RETRY_LAST_S.
"""

import contextlib
import errno
import os
import select
import socket
import termios
from typing import Any

from serial.serialposix import Serial

from hw.device import Port
from hw.ports.reopening import READ_SIZE, REASONS, RETRY_FIRST_S, ReopeningPort, describe_loss
from hw.ports.url import PortUrl, PortUrlError, parse_url

__all__ = ["PortUrlError", "open_port", "parse_url"]

CONNECT_S = 0.5
SERIAL_SILENCE_S = 10.0  # a restarting device is silent for seconds, and its wire is not dead
DATAGRAM_SIZE, DATAGRAMS = 2048, 64  # bytes each, so many a call
TCP_OPTIONS = {  # commands leave at once; a peer that acknowledges nothing for 6 s is gone
    socket.TCP_NODELAY: 1,
    socket.TCP_KEEPIDLE: 3,
    socket.TCP_KEEPINTVL: 1,
    socket.TCP_KEEPCNT: 3,
    socket.TCP_USER_TIMEOUT: 6000,
}

OPEN_LINE: Any = Serial  # pyserial has no types
Address = tuple[Any, ...]


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


class TcpPort(ReopeningPort):
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
                self._lose(f"no answer from {self._where}")
                self._try_soon(0.0)
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

    def _descriptor(self) -> int:
        return -1 if self._socket is None else self._socket.fileno()


class UdpPort(ReopeningPort):
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
                self._lose(describe_loss(error, self._where))  # a new socket gets the new route

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

    def _descriptor(self) -> int:
        return -1 if self._socket is None else self._socket.fileno()


class SerialPort(ReopeningPort):
    """A serial line, or a pty. pyserial opens and sets it; bytes go by its descriptor."""

    silence_s = SERIAL_SILENCE_S

    def __init__(self, line: PortUrl) -> None:
        super().__init__(line.path)
        self._line = line
        self._serial: Any = None  # while open
        self._fd = -1
        self._arrivals: select.epoll | None = None  # while open
        self._seen: tuple[int, ...] = ()  # the path as it was when it was last tried; () for absent
        self._look_s = float("-inf")

    def poll(self, now_s: float) -> bool:
        """As the base; and a path that has appeared or changed does not wait for its turn."""
        if not self._is_open and self._look_s <= now_s < self._retry_s:
            self._look_s = now_s + RETRY_FIRST_S
            if self._path_now() != self._seen:
                self._retry_s, self._backoff_s = now_s, RETRY_FIRST_S
        return super().poll(now_s)

    def _path_now(self) -> tuple[int, ...]:
        """What tells one device node from the next at the same path; () if there is none."""
        try:
            found = os.stat(self._line.path)
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

    def _try_open(self) -> bool:
        line = self._line
        self._seen, self._look_s = self._path_now(), self._now_s + RETRY_FIRST_S
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
        self._arrivals = select.epoll()
        self._arrivals.register(self._fd, select.EPOLLIN | select.EPOLLET)
        if not is_pty:
            with contextlib.suppress(ValueError, OSError, NotImplementedError):
                self._serial.set_low_latency_mode(True)  # an adapter that holds bytes for 16 ms
        return True

    def _read_into(self, pieces: list[bytes]) -> None:
        # The line itself is neither asked nor read unless the kernel has told of an arrival: where
        # nothing lies ready both wait for a worker of the kernel's, an ordinary process, which on a
        # busy machine comes tens of milliseconds later, whatever our priority.
        if self._arrivals is not None and self._arrivals.poll(0):
            data = os.read(self._fd, READ_SIZE)
            if not data:  # it has hung up
                raise OSError(errno.EIO, os.strerror(errno.EIO))
            pieces.append(data)

    def _send(self, data: bytes) -> int:
        return os.write(self._fd, data)

    def _let_go(self) -> None:
        if self._arrivals is not None:
            self._arrivals.close()
        self._arrivals = None
        if self._serial is None:
            return
        with contextlib.suppress(termios.error, OSError):
            termios.tcflush(self._fd, termios.TCIOFLUSH)  # else close waits until all is sent
        with contextlib.suppress(OSError):
            self._serial.close()
        self._serial = None

    def _descriptor(self) -> int:
        return -1 if self._arrivals is None else self._arrivals.fileno()
