"""Modbus over TCP and UDP: frames, listening and connections.

pymodbus is not used: its server answers only the first of several requests, sends UDP answers to
whoever asked last, says "unknown function" with the wrong bytes and stays deaf after garbage.
Source: Modbus messaging on TCP/IP implementation guide 1.0b, section 3.1.3.
"""

import asyncio
import struct
from functools import partial
from typing import Any

from hw.modbus.client import Client, Request, ServerContext, is_loopback
from hw.ports.url import PortUrl

MBAP = struct.Struct(">HHHB")  # transaction, protocol (0), length of what follows, unit
LENGTHS = range(2, 255)  # unit and 1 to 253 bytes of request
LENGTH_OFFSET = 6
MOST_CONNECTIONS = 8
IDLE_S = 60.0  # a TCP connection without a request is closed after this time,
SPARED_S = 10.0  # and after this one already when another client wants its place
MOST_BYTES = 8192  # of one TCP client, that have arrived at once
MOST_UDP_CLIENTS = 64
UDP_WAITING = 16  # requests of one UDP client
MOST_DATAGRAM = UDP_WAITING * (LENGTH_OFFSET + LENGTHS[-1])  # bytes: more can't be served


def take_requests(data: bytearray) -> tuple[list[Request], str]:
    """The whole requests at the start of `data`, which are taken out of it.

    And why what follows them is no Modbus frame, and nothing behind it can be understood; "" if
    it may be one.
    """
    found: list[Request] = []
    at, reason = 0, ""
    while len(data) - at >= LENGTH_OFFSET:
        transaction, protocol, length = struct.unpack_from(">HHH", data, at)
        if protocol != 0 or length not in LENGTHS:
            reason = "impossible length" if protocol == 0 else "wrong protocol number"
            break
        end = at + LENGTH_OFFSET + length
        if end > len(data):
            break
        found.append(Request(data[at + LENGTH_OFFSET], bytes(data[at + 7 : end]), transaction))
        at = end
    del data[:at]
    return found, reason


def datagram_requests(data: bytes) -> list[Request]:
    """The requests of one datagram: whole ones and nothing else; none if there is anything else."""
    rest = bytearray(data)
    found, reason = take_requests(rest)
    return [] if rest or reason else found


def mbap_frame(request: Request, pdu: bytes) -> bytes:
    """The frame of an answer on TCP or UDP.

    >>> mbap_frame(Request(1, b"", 5), bytes((0xE3, 1))).hex(" ")
    '00 05 00 00 00 03 01 e3 01'
    """
    return MBAP.pack(request.transaction, 0, len(pdu) + 1, request.unit) + pdu


class TcpConnection(asyncio.Protocol):
    """One TCP connection."""

    def __init__(self, owner: "TcpService") -> None:
        self._owner, self._data = owner, bytearray()
        self._client: Client | None = None
        self._transport: Any = None
        self._is_ending = False  # it will ask nothing more, and waits for its answers

    @property
    def idle_since_s(self) -> float:
        return self._client.asked_s if self._client else float("-inf")

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Take the connection, or close it at once where there are too many."""
        self._transport = transport
        host, port = (*(transport.get_extra_info("peername") or ("", 0)), 0, 0)[:2]
        context = self._owner.context
        self._client = Client(context, f"modbus tcp {host}:{port}", is_loopback(host), self._reply)
        self._owner.connections[self] = None
        if len(self._owner.connections) > MOST_CONNECTIONS:
            self._make_room()

    def _make_room(self) -> None:
        idlest = min(self._owner.connections, key=lambda one: one.idle_since_s)
        context = self._owner.context
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
            self._owner.context.reject("more bytes at once than are looked at")
            self.end()
            return
        found, reason = take_requests(self._data)
        if not self._client.offer(found):
            self.end()
        elif reason:
            self._owner.context.reject(reason, bytes(self._data))
            self._data.clear()
            self._end_when_answered()

    def _end_when_answered(self) -> None:
        self._is_ending = True
        if self._client is None or not self._client.waiting:
            self.end()

    def _reply(self, request: Request, pdu: bytes) -> None:
        self._transport.write(mbap_frame(request, pdu))
        if self._is_ending:
            self._end_when_answered()

    def eof_received(self) -> bool:
        """It asks nothing more; True keeps the connection until all is answered."""
        self._is_ending = bool(self._client and self._client.waiting)
        return self._is_ending

    def pause_writing(self) -> None:
        if self._client:
            self._client.hold(True)

    def resume_writing(self) -> None:
        if self._client:
            self._client.hold(False)

    def end(self) -> None:
        """Close the connection; what was sent still goes out."""
        self._owner.connections.pop(self, None)
        if self._client is not None:
            self._client.close()
            self._client = None
        self._transport.close()

    def connection_lost(self, exc: Exception | None) -> None:
        self.end()
        # asyncio's own cycle of references, which nothing frees while the collector is off
        vars(self._transport).pop("_read_ready_cb", None)


class TcpService:
    """Listens for TCP connections."""

    def __init__(self, context: ServerContext, url: PortUrl) -> None:
        self.context, self._url = context, url
        self.connections: dict[TcpConnection, None] = {}  # in the order of their coming
        self._server: asyncio.Server | None = None

    async def open(self) -> None:
        """Begin to serve; raises OSError where that can't be."""
        # asyncio accepts as many connections in one go as may wait: by itself a hundred
        self._server = await self.context.loop.create_server(
            partial(TcpConnection, self),
            self._url.host,
            self._url.port,
            reuse_address=True,
            backlog=MOST_CONNECTIONS,
        )

    def tend(self, now_s: float) -> str:
        """Close what has been idle for long; why nothing is served now, "" if it is."""
        for connection in list(self.connections):
            if now_s - connection.idle_since_s > IDLE_S:
                connection.end()
        return ""

    async def shutdown(self) -> None:
        if self._server is not None:
            self._server.close()
        for connection in list(self.connections):
            connection.end()


class UdpService(asyncio.DatagramProtocol):
    """The datagrams of all clients; each gets its own answers."""

    def __init__(self, context: ServerContext, url: PortUrl) -> None:
        self._context, self._url = context, url
        self._clients: dict[Any, Client] = {}
        self._transport: asyncio.DatagramTransport | None = None

    async def open(self) -> None:
        """Begin to serve; raises OSError where that can't be."""
        self._transport, _ = await self._context.loop.create_datagram_endpoint(
            lambda: self, local_addr=(self._url.host, self._url.port)
        )

    def tend(self, now_s: float) -> str:
        return ""

    def datagram_received(self, data: bytes, addr: tuple[Any, ...]) -> None:
        found = datagram_requests(data) if len(data) <= MOST_DATAGRAM else []
        if not found:
            self._context.reject("a datagram of anything but whole requests", data)
            return
        client = self._client_at(addr)
        if client is None or client.waiting + len(found) > UDP_WAITING:
            self._context.reject("more requests than can wait")
        else:
            client.offer(found)

    def _client_at(self, addr: tuple[Any, ...]) -> Client | None:
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
        client = Client(self._context, who, is_loopback(addr[0]), partial(self._reply, addr))
        self._clients[addr] = client
        return client

    def _reply(self, addr: tuple[Any, ...], request: Request, pdu: bytes) -> None:
        if self._transport is not None:
            self._transport.sendto(mbap_frame(request, pdu), addr)

    async def shutdown(self) -> None:
        for client in self._clients.values():
            client.close()
        if self._transport is not None:
            self._transport.close()
