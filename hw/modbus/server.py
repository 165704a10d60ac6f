"""The register image served over TCP, UDP or a serial line.

`ModbusServer` opens what its URL names, keeps it open and tries again where it can't be: a busy
port is told and never ends anything. It lives between the ticks of the loop; its own pace and
limits keep it short. Logs nothing: `status` says how it is.
"""

import asyncio
import errno
import socket
from collections.abc import Callable

from hw.device import DeviceStatus
from hw.modbus.client import ServerContext
from hw.modbus.image import RegisterImage, View
from hw.modbus.network import TcpService, UdpService
from hw.modbus.rtu import LineService
from hw.ports.reopening import describe_loss
from hw.ports.url import PortUrl, parse_url

RETRY_FIRST_S, RETRY_LAST_S = 0.5, 10.0
TEND_S, TEND_LINE_S = 0.2, 0.01
VIEWS = 8
LINE_VIEWS = 1  # a line has one master, and other slaves need unit ids too
ANY_UNITS = (0, 255)  # of who does not care, on a network
FIRST_UNITS = range(1, 239)

Service = TcpService | UdpService | LineService
SERVICES: dict[str, Callable[[ServerContext, PortUrl], Service]] = {
    "tcp": TcpService,
    "udp": UdpService,
    "serial": LineService,
}


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


def _why_closed(error: OSError, url: PortUrl) -> str:
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
            status=self.status,
        )
