"""Datagrams to and from one peer."""

import contextlib
import errno
import socket
from typing import Any

from hw.ports.reopening import ReopeningPort, describe_loss
from hw.ports.url import PortUrl

DATAGRAM_SIZE, DATAGRAMS = 2048, 64  # bytes each, so many a call
Address = tuple[Any, ...]


class UdpPort(ReopeningPort):
    """Datagrams to and from one peer, who need not be there: what can't be sent is lost."""

    datagrams = True

    def __init__(self, peer: PortUrl, address: tuple[int, Address]) -> None:
        super().__init__(f"{peer.host}:{peer.port}")
        self._family, self._address = address
        self._socket: socket.socket | None = None

    def write(self, data: bytes) -> None:
        """Send one datagram, now or never."""
        if self._socket is None or not data:
            return
        try:
            with contextlib.suppress(ConnectionRefusedError):  # tells of an earlier one:
                self._socket.send(data)
                return
            self._socket.send(data)  # this one did not leave yet
        except ConnectionRefusedError:
            pass
        except OSError as error:
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
            except ConnectionRefusedError:  # nobody listens there now
                continue

    def _let_go(self) -> None:
        if self._socket is not None:
            self._socket.close()
        self._socket = None

    def _descriptor(self) -> int:
        return -1 if self._socket is None else self._socket.fileno()
