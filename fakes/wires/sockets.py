"""Puts a fake on TCP, where any program can reach it, with the same faults as in memory.

A fake that has `connect(now_s)` gives an object for each of up to `max_clients`: a fake that may
have `left(now_s)`, called when the client has gone, and `gone`, true once the device has dropped
it. Any other fake has one client at a time. Others are turned away. A wire waits for nothing and
reads no clock.
"""

import select
import socket
from collections import deque

from fakes.wires.disturbance import Disturbance, Fake, Late, tell_reconnected

READ_SIZE = 65536
TCP_BACKLOG = 1 << 20  # bytes kept for a client that does not read; what comes then is lost
NEWS_KEPT = 64


class Connection:
    """One client's socket, what waits for it, and what answers it."""

    def __init__(self, opened: socket.socket, guest: Fake, name: str) -> None:
        opened.setblocking(False)
        opened.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.guest, self.name, self.open = guest, name, True
        self.late, self.unsent = Late(), bytearray()
        self._socket = opened

    @property
    def has_left(self) -> bool:
        """Whether the client has closed its end, whatever of it is still to be read."""
        look = select.poll()
        look.register(self._socket, select.POLLRDHUP)
        return bool(look.poll(0))

    def receive(self) -> bytes:
        """What has come; the connection closes when the client has gone."""
        try:
            received = self._socket.recv(READ_SIZE)
        except BlockingIOError:
            return b""
        except OSError:  # reset
            received = b""
        if not received:
            self.close()
        return received

    def send(self, most: int) -> None:
        """Hand over what the system takes, at most so many bytes; 0: all."""
        if not self.open or not self.unsent:
            return
        try:
            del self.unsent[: self._socket.send(self.unsent[:most] if most else self.unsent)]
        except BlockingIOError:
            pass
        except OSError:  # reset
            self.close()

    def close(self) -> None:
        self.open = False
        self._socket.close()
        self.unsent.clear()


class TcpWire(Disturbance):
    """A fake that listens on TCP.

    `cut`: clients are thrown out and nobody gets in. `unplugged`: as with a pulled network cable,
    silence both ways on connections that stay; TCP keeps what was under way and delivers it
    afterwards, up to TCP_BACKLOG. `chunk`: at most so many bytes a step.
    """

    def __init__(
        self, fake: Fake, host: str = "127.0.0.1", port: int = 0, *, seed: int = 0
    ) -> None:
        super().__init__(seed)
        self._listener = socket.create_server((host, port), backlog=8)
        self._listener.setblocking(False)
        self.host, self.port = self._listener.getsockname()[:2]
        self.chunk = 0  # the device's bytes come in pieces of at most so many; 0: as sent
        self.unplugged = False  # no byte passes either way, and nobody is told
        self.clients = self.turned_away = 0  # so far
        self.lost = 0  # bytes that a client was too slow for
        self.news: deque[str] = deque(maxlen=NEWS_KEPT)  # what happened, in words; take it out
        self._fake = fake
        self._connections: list[Connection] = []

    def step(self, now_s: float) -> None:
        if self.cut:
            for connection in self._connections:
                connection.close()
            self._bury(now_s)
        for connection in self._connections:
            self._serve(connection, now_s)
        self._bury(now_s)
        if not self._connections:  # time passes for the device all the same
            self._fake.exchange(now_s, b"")
        while not self.unplugged and (newcomer := self._maybe_newcomer()) is not None:
            self._make_room(now_s)
            self._welcome(newcomer, now_s)

    def close(self) -> None:
        for connection in self._connections:
            connection.close()
        self._connections.clear()
        self._listener.close()

    def _serve(self, connection: Connection, now_s: float) -> None:
        received = b"" if self.unplugged else self.heard(connection.receive())
        if not connection.open:
            return
        self.send(now_s, connection.guest.exchange(now_s, received), connection.late)
        if getattr(connection.guest, "gone", False):
            connection.close()
            return
        for data in connection.late.take(now_s):
            if len(connection.unsent) + len(data) > getattr(self._fake, "backlog", TCP_BACKLOG):
                self.lost += len(data)
            else:
                connection.unsent += data
        if not self.unplugged:
            connection.send(self.chunk)

    def _make_room(self, now_s: float) -> None:
        """Take leave of those that left since they were served: a newcomer may be one of them."""
        for connection in self._connections:
            while connection.open and connection.has_left:
                self._serve(connection, now_s)
        self._bury(now_s)

    def _welcome(self, newcomer: socket.socket, now_s: float) -> None:
        name, guest = _name(newcomer), self._maybe_guest(now_s)
        if guest is None:
            self.turned_away += 1
            self.news.append(f"client {name} turned away")
            newcomer.close()
            return
        self.clients += 1
        self.news.append(f"client {name} connected")
        self._connections.append(Connection(newcomer, guest, name))

    def _maybe_guest(self, now_s: float) -> Fake | None:
        """Who answers one more client; None: nobody does."""
        if self.cut:
            return None
        if len(self._connections) >= getattr(self._fake, "max_clients", 1):
            return None
        connect = getattr(self._fake, "connect", None)
        if connect is not None:
            guest: Fake | None = connect(now_s)
            return guest
        tell_reconnected(self._fake, now_s)
        return self._fake

    def _maybe_newcomer(self) -> socket.socket | None:
        try:
            return self._listener.accept()[0]
        except OSError:  # none, or gone before we looked
            return None

    def _bury(self, now_s: float) -> None:
        """Forget those that are gone, and tell the device."""
        for connection in self._connections:
            if not connection.open:
                self.news.append(f"client {connection.name} gone")
                left = getattr(connection.guest, "left", None)
                if left is not None:
                    left(now_s)
        self._connections = [connection for connection in self._connections if connection.open]


def _name(client: socket.socket) -> str:
    try:
        host, port = client.getpeername()[:2]
    except OSError:  # gone before we asked
        return "unknown"
    return f"{host}:{port}"
