"""Wires that carry the planner link: UDP, TCP and serial lines, as the planner's end of them.

No call waits longer than it is told to. A wire reads the monotonic clock, to tell a receiver when
bytes have arrived: never later than they did, so that what lay about unread is not taken for fresh.

Each has a `url`, and a `peer`: whoever answers go to, None while there is nobody. `wait` returns as
soon as there is something to `feed`; `write` sends a frame, or drops it where nobody can take it.
`fileno` is for a program that waits by itself.
"""

import errno
import math
import os
import select
import socket
import struct
import sys
import termios
import time
import tty
from urllib.parse import parse_qs, urlsplit

from mapod_link.receiver import Receiver
from mapod_link.serial_line import serial_from_frame

SO_TIMESTAMPNS = 35  # Linux: the kernel stamps each datagram as it arrives
NOBODY = (errno.ECONNREFUSED, errno.EAGAIN, errno.ENETUNREACH, errno.EHOSTUNREACH, errno.ENOBUFS)
PROVEN_FOR_S = 1.0
READ_SIZE, DATAGRAM_SIZE = 4096, 2048
MOST_PORT = 65535
READS = 64  # at a time, so that a flood leaves time to answer


def _is_ready(source: socket.socket | int, timeout_s: float) -> bool:
    return bool(select.select([source], [], [], max(timeout_s, 0.0))[0])


def arrival_s(
    notes: list[tuple[int, int, bytes]], ahead_s: float, least_s: float, most_s: float
) -> float:
    """When the kernel took a datagram, by the monotonic clock; `least_s` where it does not say.

    Args:
        ahead_s: of the wall clock, which it stamps with, and which may have been set meanwhile.
    """
    for level, kind, stamp in notes:
        if level == socket.SOL_SOCKET and kind == SO_TIMESTAMPNS:
            seconds, nanoseconds = struct.unpack("@ll", stamp)
            stamped_s: float = seconds + nanoseconds * 1e-9
            return min(max(stamped_s - ahead_s, least_s), most_s)
    return least_s


class UdpWire:
    """A bound socket; answers go to whoever sent the newest good frame.

    A stranger's datagram turns them away only while nobody else has sent a good one for a second:
    with a key, a sender that has just started cannot send one before it was answered.
    """

    def __init__(self, host: str, port: int) -> None:
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        try:
            self._socket.bind((host, port))
        except OSError:
            self._socket.close()
            raise
        if sys.platform == "linux":
            self._socket.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        self.peer: tuple[str, int] | None = None
        self._proven_s = -math.inf  # when a frame of the peer's was taken last
        self._empty_s = time.monotonic()  # when nothing lay there for the last time
        bound = self._socket.getsockname()
        self.url = f"udp://[{bound[0]}]:{bound[1]}" if ":" in host else "udp://{}:{}".format(*bound)

    def fileno(self) -> int:
        return self._socket.fileno()

    def wait(self, timeout_s: float) -> None:
        _is_ready(self._socket, timeout_s)

    def feed(self, receiver: Receiver) -> None:
        """Each datagram at the instant at which the kernel took it."""
        ahead_s = time.time() - time.monotonic()
        for _ in range(READS):
            try:
                data, notes, _, sender = self._socket.recvmsg(DATAGRAM_SIZE, 64)
            except BlockingIOError:
                self._empty_s = time.monotonic()
                return
            except ConnectionRefusedError:  # an answer of ours found nobody
                continue
            now_s = time.monotonic()
            arrived_s = arrival_s(notes, ahead_s, self._empty_s, now_s)
            taken = receiver.feed_datagram(arrived_s, data)
            if taken or now_s - self._proven_s > PROVEN_FOR_S:
                self.peer = sender
            self._proven_s = now_s if taken else self._proven_s

    def write(self, frame: bytes) -> None:
        if self.peer is not None:
            try:
                self._socket.sendto(frame, self.peer)
            except OSError as error:  # nobody there, or no room: an ACK may get lost
                if error.errno not in NOBODY:
                    raise

    def close(self) -> None:
        self._socket.close()


class StreamWire:
    """A stream of bytes with COBS-encoded frames in it."""

    url, peer = "", "the line"

    def __init__(self, fd: int) -> None:
        self._fd = fd
        os.set_blocking(fd, False)
        self._empty_s = time.monotonic()  # when nothing lay there for the last time
        self._rest = b""  # of a frame that the line had room for in part

    def fileno(self) -> int:
        return self._fd

    def wait(self, timeout_s: float) -> None:
        if not _is_ready(self._fd, 0.0):
            _is_ready(self._fd, timeout_s)
            self._empty_s = time.monotonic()

    def feed(self, receiver: Receiver) -> None:
        """All that has arrived; `OSError`: the line is gone."""
        for _ in range(READS):
            try:
                data = os.read(self._fd, READ_SIZE)
            except BlockingIOError:
                self._empty_s = time.monotonic()
                return
            if not data:
                raise OSError(errno.EIO, "the line was hung up")
            receiver.feed_stream(self._empty_s, data)

    def write(self, frame: bytes) -> None:
        """COBS-encoded; where the line has no room, an ACK may get lost."""
        if self._rest:
            self._rest = self._rest[self._written(self._rest) :]
        if not self._rest:
            data = serial_from_frame(frame)
            sent = self._written(data)
            self._rest = data[sent:] if sent else b""

    def _written(self, data: bytes) -> int:
        try:
            return os.write(self._fd, data)
        except BlockingIOError:
            return 0

    def close(self) -> None:
        os.close(self._fd)


class SerialWire(StreamWire):
    """A serial line, 8N1."""

    def __init__(self, path: str, baud: int) -> None:
        speed = getattr(termios, f"B{baud}", None)
        if speed is None:
            raise ValueError(f"{path}: no line here has {baud} baud")
        fd = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        try:
            tty.setraw(fd)
            settings = termios.tcgetattr(fd)
            settings[2] &= ~(termios.PARENB | termios.CSTOPB | termios.CSIZE)
            settings[2] |= termios.CS8 | termios.CLOCAL | termios.CREAD
            settings[4] = settings[5] = speed
            termios.tcsetattr(fd, termios.TCSANOW, settings)
        except termios.error as error:
            os.close(fd)
            raise OSError(error.args[0], f"{path}: no serial line") from None
        super().__init__(fd)
        self.url = f"serial://{path}?baud={baud}"


class TcpWire:
    """A listening socket: a serial stream of one sender at a time, the newest who has connected."""

    def __init__(self, host: str, port: int) -> None:
        self._listener = socket.create_server((host, port))
        self._listener.setblocking(False)
        self.url = "tcp://{}:{}".format(*self._listener.getsockname())
        self._socket: socket.socket | None = None
        self._stream: StreamWire | None = None

    @property
    def peer(self) -> object:
        return self._socket

    def fileno(self) -> int:
        """Of the connection, or of the listening socket while there is none."""
        return (self._socket or self._listener).fileno()

    def wait(self, timeout_s: float) -> None:
        if self._stream is None:
            _is_ready(self._listener, timeout_s)
        else:
            self._stream.wait(timeout_s)

    def feed(self, receiver: Receiver) -> None:
        """All that has arrived; a connection that ends is waited for anew."""
        if self._accept():
            receiver.begin_stream()
        if self._stream is not None:
            try:
                self._stream.feed(receiver)
            except OSError:
                self._hang_up()

    def write(self, frame: bytes) -> None:
        if self._stream is not None:
            try:
                self._stream.write(frame)
            except OSError:
                self._hang_up()

    def close(self) -> None:
        self._hang_up()
        self._listener.close()

    def _accept(self) -> bool:
        try:
            accepted, _ = self._listener.accept()
        except BlockingIOError:
            return False
        self._hang_up()
        accepted.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket, self._stream = accepted, StreamWire(accepted.fileno())
        return True

    def _hang_up(self) -> None:
        if self._socket is not None:
            self._socket.close()
        self._socket = self._stream = None


Wire = UdpWire | StreamWire | TcpWire


def wire_from_url(url: str) -> Wire:
    """udp://host:port (bound), tcp://host:port (listening) or serial:///path?baud=...

    Raises:
        ValueError: not such a URL.
        OSError: the port is taken, or there is no such line.
    """
    must_be = "must be udp://host:port, tcp://host:port or serial:///path?baud=115200"
    try:
        parts = urlsplit(url)
        number = parts.netloc.rpartition(":")[2]
        if number.isdecimal() and int(number) > MOST_PORT:
            must_be = f"the port must be within 1..{MOST_PORT}, is {number}"
        port, [baud] = parts.port, parse_qs(parts.query).get("baud", ["115200"])
        baud_given = int(baud)
    except ValueError:  # also a port beyond 65535, or two rates
        raise ValueError(f"{url}: {must_be}") from None
    if parts.scheme in ("udp", "tcp") and parts.hostname and port is not None:
        return (UdpWire if parts.scheme == "udp" else TcpWire)(parts.hostname, port)
    if parts.scheme == "serial" and parts.path:
        return SerialWire(parts.path, baud_given)
    raise ValueError(f"{url}: {must_be}")
