"""Ports over sockets: a TCP connection, as its client, and datagrams to and from one peer."""

import errno
import os
import select
import socket
from typing import Any

from hw.ports.reopening import READ_SIZE, REASONS, ReopeningPort, describe_loss
from hw.ports.url import PortUrl

CONNECT_S = 0.5  # a host that needs longer to answer is too far away to keep a map fresh
OPTIONS = {  # commands leave at once; a peer that acknowledges nothing for 6 s is gone
    socket.TCP_NODELAY: 1,
    socket.TCP_KEEPIDLE: 3,
    socket.TCP_KEEPINTVL: 1,
    socket.TCP_KEEPCNT: 3,
    socket.TCP_USER_TIMEOUT: 6000,
}
DATAGRAM_SIZE, DATAGRAMS = 2048, 64  # bytes each, so many a call
Address = tuple[Any, ...]


class SocketPort(ReopeningPort):
    """What both have in common: where to, and the socket."""

    def __init__(self, peer: PortUrl, address: tuple[int, Address]) -> None:
        super().__init__(f"{peer.host}:{peer.port}")
        self._family, self._address = address
        self._socket: socket.socket | None = None  # opening, or open
        self._arrivals: select.epoll | None = None  # as long

    def _let_go(self) -> None:
        if self._arrivals is not None:
            self._arrivals.close()
        if self._socket is not None:
            self._socket.close()
        self._socket = self._arrivals = None

    def _new_socket(self, kind: socket.SocketKind) -> socket.socket:
        """One that waits for nothing, and tells by `_arrivals` whether it is readable.

        That is asked before it is read in vain: what the system then raises costs twice as much.
        """
        self._socket = new = socket.socket(self._family, kind)
        new.setblocking(False)
        self._arrivals = select.epoll()
        self._arrivals.register(new, select.EPOLLIN)
        return new

    def _descriptor(self) -> int:
        return -1 if self._socket is None else self._socket.fileno()


class TcpPort(SocketPort):
    """A TCP connection, as its client."""

    def __init__(self, peer: PortUrl, address: tuple[int, Address]) -> None:
        super().__init__(peer, address)
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
        opening = self._new_socket(socket.SOCK_STREAM)
        opening.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        for option, value in OPTIONS.items():
            opening.setsockopt(socket.IPPROTO_TCP, option, value)
        code = opening.connect_ex(self._address)
        if code not in (0, errno.EINPROGRESS):
            raise OSError(code, os.strerror(code))

    def _read_into(self, pieces: list[bytes]) -> None:
        assert self._socket is not None
        assert self._arrivals is not None
        if self._is_polled and not self._arrivals.poll(0):
            return  # as in most steps, which poll it first; between them it is read as bytes arrive
        if data := self._socket.recv(READ_SIZE):
            pieces.append(data)
        else:
            self._lose(REASONS[errno.EPIPE].format(where=self._where))

    def _send(self, data: bytes) -> int:
        assert self._socket is not None
        return self._socket.send(data)


class UdpPort(SocketPort):
    """Datagrams to and from one peer, who need not be there: what can't be sent is lost."""

    datagrams = True

    def write(self, data: bytes) -> None:
        """Send one datagram, now or never."""
        if self._socket is None or not data:
            return
        try:
            try:
                self._socket.send(data)
            except ConnectionRefusedError:  # tells of an earlier one: this one did not leave yet
                self._socket.send(data)
        except ConnectionRefusedError:
            pass
        except OSError as error:
            if not isinstance(error, BlockingIOError) and error.errno != errno.EMSGSIZE:
                self._lose(describe_loss(error, self._where))  # a new socket gets the new route

    def _try_open(self) -> bool:
        # connecting waits for nothing: it only names the peer
        self._new_socket(socket.SOCK_DGRAM).connect(self._address)
        return True

    def _read_into(self, pieces: list[bytes]) -> None:
        assert self._socket is not None
        assert self._arrivals is not None
        for _ in range(DATAGRAMS):
            if not self._arrivals.poll(0):
                return
            try:
                pieces.append(self._socket.recv(DATAGRAM_SIZE))
            except ConnectionRefusedError:  # nobody listens there now
                continue
