"""The register image served over TCP, UDP or a serial line, by pymodbus's servers.

`ModbusServer` opens what its URL names, keeps it open and tries again where it can't be: a busy
port is told and never ends anything. It lives between the ticks of the loop; its own pace and
limits keep it short. Logs nothing: `status` says how it is.
"""

import asyncio
import errno
import functools
import logging
import socket
from collections.abc import Callable
from typing import Any, Protocol

from pymodbus.server import ModbusSerialServer, ModbusTcpServer, ModbusUdpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from hw.device import DeviceStatus
from hw.modbus.client import ServerContext
from hw.modbus.handlers import IDLE_S, MOST_CONNECTIONS, LineHandler, TcpHandler, UdpHandler
from hw.modbus.image import RegisterImage, View
from hw.ports.reopening import describe_loss
from hw.ports.serial import SerialPort
from hw.ports.url import PortUrl, parse_url
from hw.runtime.wakeup import WakeUp

PYMODBUS = "3.16."  # the handlers stand on this version's inside
RETRY_FIRST_S, RETRY_LAST_S = 0.5, 10.0
TEND_S, TEND_LINE_S = 0.2, 0.01
CALL_BYTES = 1024  # of a line, looked at in one call: 11 ms of 921 600 baud
VIEWS = 8
LINE_VIEWS = 1  # a line has one master, and other slaves need unit ids too
ANY_UNITS = (0, 255)  # of who does not care, on a network
FIRST_UNITS = range(1, 239)
VENDOR, URL, PRODUCT = b"mapod", b"", b"mapod obstacle map"


def identity_of(version: str) -> dict[int, bytes]:
    """The objects of device identification: vendor, code, revision, url, product, model, app."""
    revision = version.encode("ascii", "replace")[:32]
    return {0: VENDOR, 1: b"MP", 2: revision, 3: URL, 4: PRODUCT, 5: b"MP", 6: b"mapod"}


def units_of(unit: int, kind: str) -> tuple[list[int], list[int]]:
    """The unit ids that are ours: of the live registers, and of the frozen views.

    >>> units_of(1, "serial")
    ([1], [2])
    >>> units_of(1, "tcp")
    ([1, 0, 255], [2, 3, 4, 5, 6, 7, 8, 9])
    """
    if kind == "serial":
        return [unit], list(range(unit + 1, unit + 1 + LINE_VIEWS))
    return [unit, *ANY_UNITS], list(range(unit + 1, unit + 1 + VIEWS))


def _no_memory() -> SimDevice:
    """pymodbus wants registers of its own; nothing reads them."""
    return SimDevice(1, simdata=[SimData(0, values=0, datatype=DataType.REGISTERS)])


class Service(Protocol):
    """One of pymodbus's servers, as it is kept."""

    async def open(self) -> None:
        """Begin to serve; raises OSError where that can't be."""

    def tend(self, now_s: float) -> str:
        """From time to time; why it does not serve now, "" if it does."""

    async def shutdown(self) -> None:
        """End it."""


class _Opening:
    """Opens as pymodbus does, but says why it can't."""

    call_create: Any
    transport: Any
    is_listener: bool

    async def open(self) -> None:
        """Begin to serve; raises OSError where that can't be."""
        self.is_listener = True
        made = await self.call_create()
        self.transport = made[0] if isinstance(made, tuple) else made


class TcpService(_Opening, ModbusTcpServer):
    """Listens for TCP connections."""

    def __init__(self, context: ServerContext, url: PortUrl) -> None:
        self.server_context = context
        self.connections: dict[TcpHandler, None] = {}
        super().__init__(_no_memory(), address=(url.host, url.port))
        # asyncio accepts as many connections in one go as may wait: by itself a hundred
        self.call_create = functools.partial(self.call_create, backlog=MOST_CONNECTIONS)

    def callback_new_connection(self) -> TcpHandler:
        """Of one connection."""
        return TcpHandler(self)

    def tend(self, now_s: float) -> str:
        """Close what has been idle for long."""
        for handler in list(self.connections):
            if now_s - handler.idle_since_s > IDLE_S:
                handler.end()
        return ""


class UdpService(_Opening, ModbusUdpServer):
    """Takes datagrams."""

    def __init__(self, context: ServerContext, url: PortUrl) -> None:
        self.server_context = context
        super().__init__(_no_memory(), address=(url.host, url.port))

    def callback_new_connection(self) -> UdpHandler:
        """Of the one socket."""
        return UdpHandler(self)

    def tend(self, now_s: float) -> str:
        """Nothing to be done."""
        return ""


class _LineTransport(asyncio.Transport):
    """Our own serial port (it reopens, and knows what a pty can't do) in asyncio's words."""

    def __init__(self, port: SerialPort) -> None:
        super().__init__()
        self._port = port

    def write(self, data: Any) -> None:
        """Hand over; never waits."""
        self._port.write(bytes(data))

    def close(self) -> None:
        """Nothing more."""
        self._port.close()


class LineService(_Opening, ModbusSerialServer):
    """A slave on a serial line; where the line is lost, it comes back by itself."""

    def __init__(self, context: ServerContext, url: PortUrl) -> None:
        self.server_context = context
        self._url, self._port = url, SerialPort(url)
        self._opened = 0
        self._unread, self._is_going_on = bytearray(), False
        self._handler: LineHandler | None = None
        self._wake_up = WakeUp(asyncio.get_running_loop(), (self._port,), self._hear)
        super().__init__(_no_memory(), port=url.path)
        self.call_create = self._create

    def callback_new_connection(self) -> LineHandler:
        """Of the one line."""
        return LineHandler(self, self._url.path, self._url.baud or 0)

    async def _create(self) -> tuple[asyncio.Transport, LineHandler]:
        transport = _LineTransport(self._port)
        handler = self.handle_new_connection()
        assert isinstance(handler, LineHandler)
        handler.connection_made(transport)
        self._handler = handler
        return transport, handler

    def tend(self, now_s: float) -> str:
        """Open or reopen the line, send what it did not take at once, listen to it."""
        is_open = self._port.poll(now_s)
        if is_open and self._port.opened != self._opened and self._handler is not None:
            self._opened = self._port.opened
            self._unread.clear()
            self._handler.restart()
        self._wake_up.after_tick()
        return "" if is_open else self._port.cause

    def _hear(self) -> None:
        """Look at some of what has arrived; at the rest once all else has had its turn."""
        if not self._unread:
            self._unread += b"".join(self._port.read())
        piece = bytes(self._unread[:CALL_BYTES])
        del self._unread[:CALL_BYTES]
        if piece and self._handler is not None:
            self._handler.data_received(piece)
        if self._unread and not self._is_going_on:
            self._is_going_on = True
            asyncio.get_running_loop().call_soon(self._go_on)

    def _go_on(self) -> None:
        self._is_going_on = False
        self._hear()

    async def shutdown(self) -> None:
        """Let go of the line."""
        self._wake_up.close()
        await super().shutdown()  # type: ignore[no-untyped-call]


SERVICES: dict[str, Callable[[ServerContext, PortUrl], Service]] = {
    "tcp": TcpService,
    "udp": UdpService,
    "serial": LineService,
}


def _why_closed(error: OSError, url: PortUrl) -> str:
    """Why nothing can be served at this URL."""
    if isinstance(error, socket.gaierror):
        return f"the host {url.host!r} has no known address"
    if error.errno == errno.EADDRINUSE:
        return f"port {url.port} at {url.host} is in use by another program"
    if error.errno == errno.EADDRNOTAVAIL:
        return f"this machine does not have the address {url.host}"
    return describe_loss(error, f"{url.host}:{url.port}" if url.port else url.path)


class ModbusServer:
    """One register image at one URL, for as long as it is started."""

    def __init__(
        self,
        url: str,
        image: RegisterImage,
        clock: Callable[[], float],
        *,
        unit: int = 1,
        utc_s: Callable[[], float] = lambda: 0.0,
    ) -> None:
        """A server that is not started yet.

        Args:
            url: tcp://host:port and udp://host:port: where to listen; or serial:///path?baud=...
            clock: the host's monotonic clock, the one that `image` is published with.
            unit: the id of the live registers; the ids of the frozen views follow it.
            utc_s: seconds since 1970, or 0.

        Raises:
            PortUrlError: no such kind of port, or a part missing or out of range.
            ValueError: a unit that leaves no room for the views.
        """
        if unit not in FIRST_UNITS:
            raise ValueError(f"unit must be within 1..238, is {unit}")
        self._url = parse_url(url)
        self._image, self._clock, self._utc_s, self._unit = image, clock, utc_s, unit
        self.status = DeviceStatus("modbus")
        self._service: Service | None = None
        self._is_open = False
        self._task: asyncio.Task[None] | None = None
        self._retry_s, self._pause_s = float("-inf"), RETRY_FIRST_S
        logging.getLogger("pymodbus.logging").setLevel(logging.CRITICAL + 1)

    def start(self) -> None:
        """Begin, within the running loop; whether it serves is in `status`."""
        self._task = asyncio.get_running_loop().create_task(self._keep())

    async def stop(self) -> None:
        """End it, and close what is open; raises what has ended it before, if anything has."""
        task, self._task = self._task, None
        if task is not None:
            task.cancel()
            await asyncio.wait([task])
        if self._service is not None:
            await self._service.shutdown()
            self._service, self._is_open = None, False
        self.status.fall_back("closed", "stopped")
        if task is not None and not task.cancelled():
            task.result()

    async def _keep(self) -> None:
        pause_s = TEND_LINE_S if self._url.kind == "serial" else TEND_S
        try:
            while True:
                await self.tend()
                await asyncio.sleep(pause_s)
        finally:
            self.status.fall_back("closed", "ended by a mistake of ours")

    async def tend(self) -> None:
        """Open where that is due; look after what is open. `start` has this done."""
        now_s = self._clock()
        if self._service is None:
            self._service = SERVICES[self._url.kind](self._context(), self._url)
        if not self._is_open and now_s >= self._retry_s:
            await self._open(now_s)
        if self._is_open:
            cause = self._service.tend(now_s)
            if cause:
                self.status.fall_back("closed", cause)
            else:
                self.status.state, self.status.cause = "running", ""

    async def _open(self, now_s: float) -> None:
        assert self._service is not None
        try:
            await self._service.open()
        except OSError as error:
            self.status.fall_back("closed", _why_closed(error, self._url))
            self._retry_s = now_s + self._pause_s
            self._pause_s = min(2 * self._pause_s, RETRY_LAST_S)
        else:
            self._is_open, self._pause_s = True, RETRY_FIRST_S

    def _context(self) -> ServerContext:
        live, frozen = units_of(self._unit, self._url.kind)
        views: dict[int, View | None] = dict.fromkeys(live)
        views |= {unit: self._image.new_view() for unit in frozen}
        return ServerContext(
            image=self._image,
            clock=self._clock,
            utc_s=self._utc_s,
            loop=asyncio.get_running_loop(),
            views=views,
            is_silent=self._url.kind == "serial",
            identity=identity_of(self._image.version),
            status=self.status,
        )
