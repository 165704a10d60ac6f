"""pymodbus's connections with their bytes taken in by us, for TCP, UDP and serial lines.

pymodbus 3.16 listens, accepts and holds connections. Its own handler answers only the first of
several requests, sends UDP answers to whoever asked last, says "unknown function" with the
wrong bytes, stays deaf after garbage and talks over other slaves: so each of its entry points for
bytes is overridden here, and none of its messages is used. It and asyncio also leave cycles of
references with each connection, which nothing frees while the garbage collector is off: `_untie`.
"""

import asyncio
from functools import partial
from typing import Any, Protocol

from pymodbus.server.requesthandler import ServerRequestHandler

from hw.modbus.client import Client, ServerContext, Timer, is_loopback
from hw.modbus.framing import (
    LENGTH_OFFSET,
    LENGTHS,
    Request,
    RtuReceiver,
    datagram_requests,
    mbap_frame,
    rtu_frame,
    take_requests,
)

MOST_CONNECTIONS = 8
IDLE_S = 60.0  # a TCP connection without a request is closed after this time,
SPARED_S = 10.0  # and after this one already when another client wants its place
MOST_BYTES = 8192  # of one TCP client, that have arrived at once
MOST_UDP_CLIENTS = 64
UDP_WAITING = 16  # requests of one UDP client
MOST_DATAGRAM = UDP_WAITING * (LENGTH_OFFSET + LENGTHS[-1])  # bytes: more can't be served
CHARACTER_BITS = 11
SILENT_CHARACTERS, LEAST_SILENT_S = 3.5, 0.00175
LONG_SILENCE_S = 0.1  # nothing begun will be ended any more
BUSY_LINE_S = 0.02  # a line that is never silent gets its answers after this time

CYCLIC = ("trace_packet", "trace_pdu", "trace_connect", "low_level_send", "call_create")


class Owner(Protocol):
    """What a handler wants of its server."""

    server_context: ServerContext
    connections: "dict[TcpHandler, None]"  # in the order of their coming


def silent_s(baud: int) -> float:
    """The silence that ends a frame.

    >>> round(1e3 * silent_s(9600), 2), round(1e3 * silent_s(115200), 2)
    (4.01, 1.75)
    """
    return max(LEAST_SILENT_S, SILENT_CHARACTERS * CHARACTER_BITS / baud) if baud else 0.0


class TcpHandler(ServerRequestHandler):
    """One TCP connection."""

    def __init__(self, owner: Any) -> None:
        super().__init__(owner, None, None, None)  # type: ignore[no-untyped-call]
        self._owner: Owner = owner
        self._data = bytearray()
        self._client: Client | None = None
        self._socket: asyncio.BaseTransport | None = None  # pymodbus drops its own too early
        self._is_ending = False  # it will ask nothing more, and waits for its answers

    @property
    def idle_since_s(self) -> float:
        """When it last asked something."""
        return self._client.asked_s if self._client else float("-inf")

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Take the connection, or close it at once where there are too many."""
        super().connection_made(transport)
        self._socket = transport
        host, port = (*(transport.get_extra_info("peername") or ("", 0)), 0, 0)[:2]
        context = self._owner.server_context
        self._client = Client(context, f"modbus tcp {host}:{port}", is_loopback(host), self._reply)
        self._owner.connections[self] = None
        if len(self._owner.connections) > MOST_CONNECTIONS:
            self._make_room()

    def _make_room(self) -> None:
        """End the connection that has been idle longest, or else this one."""
        idlest = min(self._owner.connections, key=lambda handler: handler.idle_since_s)
        context = self._owner.server_context
        if context.clock() - idlest.idle_since_s > SPARED_S:
            idlest.end()
        else:
            context.reject("more connections than there is room for")
            self.end()

    def data_received(self, data: bytes) -> None:
        """Requests, cut anywhere; anything else ends the connection."""
        if self._client is None or self._is_ending:
            return
        self._data += data
        if len(self._data) > MOST_BYTES:  # not even looked at: that would take long
            self._owner.server_context.reject("more bytes at once than are looked at")
            self.end()
            return
        found, reason = take_requests(self._data)
        if not self._client.offer(found):
            self.end()
        elif reason:
            self._owner.server_context.reject(reason, bytes(self._data))
            self._data.clear()
            self._end_when_answered()

    def _end_when_answered(self) -> None:
        self._is_ending = True
        if self._client is None or not self._client.waiting:
            self.end()

    def _reply(self, request: Request, pdu: bytes) -> None:
        self.send(mbap_frame(request, pdu))
        if self._is_ending:
            self._end_when_answered()

    def eof_received(self) -> bool:  # type: ignore[override]
        """It asks nothing more; True keeps the connection until all is answered."""
        self._is_ending = bool(self._client and self._client.waiting)
        return self._is_ending

    def pause_writing(self) -> None:
        """It does not take its answers."""
        if self._client:
            self._client.hold(True)

    def resume_writing(self) -> None:
        """It does again."""
        if self._client:
            self._client.hold(False)

    def end(self) -> None:
        """Close the connection; what was sent still goes out."""
        self._untie()
        self.close()

    def connection_lost(self, exc: Exception | None) -> None:
        """It is gone."""
        super().connection_lost(exc)
        self._untie()
        vars(self._socket).pop("_read_ready_cb", None)  # asyncio's own cycle of references
        self._socket = None

    def callback_disconnected(self, exc: Exception | None) -> None:
        """Nothing to tell anybody."""

    def _untie(self) -> None:
        """Let go of all that refers back to this object."""
        self._owner.connections.pop(self, None)
        if self._client is not None:
            self._client.close()
            self._client = None
        for name in CYCLIC:
            self.__dict__.pop(name, None)


class UdpHandler(ServerRequestHandler):
    """The datagrams of all clients; each gets its own answers."""

    def __init__(self, owner: Any) -> None:
        super().__init__(owner, None, None, None)  # type: ignore[no-untyped-call]
        self._context: ServerContext = owner.server_context
        self._clients: dict[Any, Client] = {}

    def datagram_received(self, data: bytes, addr: tuple[Any, ...] | None) -> None:
        """One datagram: whole requests, or nothing."""
        found = datagram_requests(data) if len(data) <= MOST_DATAGRAM else []
        if not found:
            self._context.reject("a datagram of anything but whole requests", data)
            return
        client = self._client_at(addr)
        if client is None or client.waiting + len(found) > UDP_WAITING:
            self._context.reject("more requests than can wait")
        else:
            client.offer(found)

    def _client_at(self, addr: Any) -> Client | None:
        """Who sends from there; None when there are too many others."""
        client = self._clients.get(addr)
        if client is not None:
            return client
        if len(self._clients) >= MOST_UDP_CLIENTS:
            oldest = min(self._clients, key=lambda at: self._clients[at].asked_s)
            if self._clients[oldest].waiting:
                return None
            self._clients.pop(oldest).close()
        who = f"modbus udp {addr[0]}:{addr[1]}"

        def reply(request: Request, pdu: bytes) -> None:
            self.send(mbap_frame(request, pdu), addr)

        client = self._clients[addr] = Client(self._context, who, is_loopback(addr[0]), reply)
        return client

    def callback_disconnected(self, exc: Exception | None) -> None:
        """The socket is closed."""
        for client in self._clients.values():
            client.close()
        self._clients.clear()


class LineHandler(ServerRequestHandler):
    """A serial line, on which others may speak: we do only after a silence."""

    def __init__(self, owner: Any, path: str, baud: int) -> None:
        super().__init__(owner, None, None, None)  # type: ignore[no-untyped-call]
        self._context: ServerContext = owner.server_context
        self._silent_s = silent_s(baud)
        self._client = Client(self._context, f"modbus rtu {path}", True, self._reply)
        self._timer: Timer | None = None
        self.restart()

    def restart(self) -> None:
        """The line was opened anew."""
        self._receiver = RtuReceiver(frozenset(self._context.views))
        self._found: list[Request] = []
        self._found_s = float("-inf")  # since when they wait for silence

    def data_received(self, data: bytes) -> None:
        """What the line carries, cut anywhere."""
        now_s, before = self._context.clock(), self._receiver.rejected
        found = self._receiver.feed(data)
        if found and not self._found:
            self._found_s = now_s
        self._found += found
        self._reject(before)
        if self._found and now_s - self._found_s > BUSY_LINE_S:
            self._offer()
        self._listen(self._silent_s, long=False)

    def _listen(self, wait_s: float, *, long: bool) -> None:
        if self._timer is not None:
            self._timer.cancel()
        self._timer = self._context.loop.call_later(wait_s, partial(self._silence, long))

    def _silence(self, long: bool) -> None:
        before = self._receiver.rejected
        self._found += self._receiver.silence(long=long)
        self._reject(before)
        self._offer()
        if not long:
            self._listen(LONG_SILENCE_S, long=True)

    def _offer(self) -> None:
        found, self._found = self._found, []
        self._client.offer(found)

    def _reject(self, before: int) -> None:
        if noise := self._receiver.rejected - before:
            self._context.reject("noise on the line", bytes(noise))

    def _reply(self, request: Request, pdu: bytes) -> None:
        self.send(rtu_frame(request, pdu))

    def callback_disconnected(self, exc: Exception | None) -> None:
        """The server is closed."""
        if self._timer is not None:
            self._timer.cancel()
        self._client.close()
