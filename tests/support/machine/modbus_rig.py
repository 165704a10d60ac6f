"""A Modbus server on a real port of this machine, a published image, and clients made of bytes."""

import asyncio
import contextlib
import functools
import math
import os
import socket
import struct
import tty
from collections.abc import AsyncIterator, Callable, Coroutine
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from core.records import FREE, I8, OBSTACLE, ObstacleMap, PoseReport, StopZoneReport
from hw.device import DeviceStatus
from hw.modbus.client import ServerContext
from hw.modbus.image import RegisterImage, View
from hw.modbus.layout import Refusal, stride_of
from hw.modbus.server import ModbusServer

START_S = 1000.0
CODES = {OBSTACLE: 2, FREE: 1, 0: 0}
SIZE, CELL_MM = 29, 200
GOOD = PoseReport(1.0, -2.0, 0.5, 0.01, -0.02, 0.25, -0.1, 0x7F, 0.01, 0.02, 0.03, 1)
SECTORS_M = (1.0, 2.0, math.inf, 3.0, 4.0, 5.0, 6.0, 0.5)
CLEAR = StopZoneReport(2.0, 2.5, 1.0, math.inf, math.inf, 0.8, 0.4, 0.5, 0.1, SECTORS_M, 1, 0)
BAD = replace(GOOD, health=0x0C, mode=3)
READ_TEN = bytes.fromhex("00 01 00 00 00 06 01 03 00 00 00 0A")


class Clock:
    """A clock that a test moves."""

    now_s = START_S

    def __call__(self) -> float:
        return self.now_s


@dataclass
class Later:
    """A call to come."""

    due_s: float
    callback: Callable[[], object]

    def cancel(self) -> None:
        self.callback = int


class Loop:
    """Calls that come when a test says so, on its clock; as much of a loop as a client uses."""

    def __init__(self, clock: Clock) -> None:
        self.clock = clock
        self.calls: list[Later] = []

    def call_soon(self, callback: Callable[[], object]) -> Later:
        return self.call_later(0.0, callback)

    def call_later(self, delay_s: float, callback: Callable[[], object]) -> Later:
        self.calls.append(Later(self.clock.now_s + delay_s, callback))
        return self.calls[-1]

    def step(self) -> None:
        call = min(self.calls, key=lambda call: call.due_s)
        self.calls.remove(call)
        self.clock.now_s = max(self.clock.now_s, call.due_s)
        call.callback()


def context_of(image: RegisterImage, loop: Any) -> ServerContext:
    """What clients share: unit 1 live, unit 2 a frozen view."""
    return ServerContext(
        image=image,
        clock=loop.clock,
        utc_s=lambda: 0.0,
        loop=loop,
        views={1: None, 2: image.new_view()},
        is_silent=False,
        status=DeviceStatus("modbus"),
    )


def window_of(
    cells: I8, corner: tuple[int, int] = (-7, 3), *, trusted: bool = True, epoch: int = 0
) -> ObstacleMap:
    changed = np.zeros(0, dtype=np.int32)
    return ObstacleMap(cells, corner[0], corner[1], changed, epoch, trusted)


def some_cells(seed: int, size: int = SIZE) -> I8:
    return np.random.default_rng(seed).integers(-1, 2, (size, size)).astype(np.int8)


def new_image(**settings: Any) -> RegisterImage:
    """An image to which something was published at START_S."""
    usual: dict[str, Any] = {"size": SIZE, "cell_mm": CELL_MM, "session": 7, "version": "0.1.0"}
    given = usual | settings
    image = RegisterImage(**given)
    image.publish(START_S, GOOD, CLEAR, window_of(some_cells(1, given["size"])))
    return image


async def until(done: Callable[[], object]) -> None:
    """Give the loop and the kernel all the time that they need to bring it about."""
    for _ in range(60_000):
        if done():
            return
        await asyncio.sleep(0.001)
    raise AssertionError("it did not come about")


def free_port(kind: int = socket.SOCK_STREAM) -> int:
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@contextlib.asynccontextmanager
async def serving(
    url: str, image: RegisterImage, clock: Callable[[], float], unit: int = 1
) -> AsyncIterator[ModbusServer]:
    server = ModbusServer(url, image, clock, unit=unit)
    server.start()
    try:
        await until(lambda: server.status.state == "running")
        yield server
    finally:
        await server.stop()


class Tcp:
    """A client on a TCP connection, in bytes."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.reader, self.writer = reader, writer

    @classmethod
    async def connect(cls, port: int) -> "Tcp":
        return cls(*await asyncio.open_connection("127.0.0.1", port))

    async def another(self) -> "Tcp":
        return await Tcp.connect(self.writer.get_extra_info("peername")[1])

    async def ask(self, request: bytes) -> bytes:
        self.writer.write(request)
        return await self.answer()

    async def answer(self) -> bytes:
        head = await asyncio.wait_for(self.reader.readexactly(6), 60)
        return head + await asyncio.wait_for(self.reader.readexactly(head[5]), 60)

    async def ended(self) -> bool:
        """Whether the server closed the connection; waits for that, or for bytes."""
        with contextlib.suppress(ConnectionResetError):
            return not await asyncio.wait_for(self.reader.read(1), 60)
        return True

    def close(self) -> None:
        self.writer.close()


class Udp(asyncio.DatagramProtocol):
    """A client with a UDP socket of its own."""

    def __init__(self) -> None:
        self.heard: asyncio.Queue[bytes] = asyncio.Queue()
        self.transport: Any = None

    @classmethod
    async def connect(cls, port: int) -> "Udp":
        loop = asyncio.get_running_loop()
        transport, client = await loop.create_datagram_endpoint(
            cls, remote_addr=("127.0.0.1", port)
        )
        client.transport = transport
        return client

    async def another(self) -> "Udp":
        return await Udp.connect(self.transport.get_extra_info("peername")[1])

    def datagram_received(self, data: bytes, addr: object) -> None:
        self.heard.put_nowait(data)

    def send(self, data: bytes) -> None:
        self.transport.sendto(data)

    async def ask(self, request: bytes) -> bytes:
        self.send(request)
        return await self.answer()

    async def answer(self) -> bytes:
        return await asyncio.wait_for(self.heard.get(), 60)

    def close(self) -> None:
        self.transport.close()


class Line:
    """A pty: the server has its slave end, the test speaks as the master of the line."""

    def __init__(self) -> None:
        self.master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self.master, False)
        self.path = os.ttyname(self._slave)
        self.heard = bytearray()

    def send(self, data: bytes) -> None:
        os.write(self.master, data)

    def listen(self) -> bytes:
        with contextlib.suppress(BlockingIOError):
            self.heard += os.read(self.master, 65536)
        return bytes(self.heard)

    async def ask(self, request: bytes, size: int) -> bytes:
        self.send(request)
        await until(lambda: len(self.listen()) >= size)
        answer = bytes(self.heard[:size])
        del self.heard[:size]
        return answer

    def close(self) -> None:
        os.close(self.master)
        os.close(self._slave)


Talk = Callable[[Any, ModbusServer, Clock], Coroutine[Any, Any, None]]


def in_loop(test: Callable[..., Coroutine[Any, Any, None]]) -> Callable[..., None]:
    """The test, run in an event loop of its own."""

    @functools.wraps(test)
    def run(*given: Any, **named: Any) -> None:
        asyncio.run(test(*given, **named))

    return run


def talk(*kinds: str) -> Callable[[Talk], Callable[..., None]]:
    """A conversation as a test, once by each kind of port.

    It gets a client on a fresh port, or the master of a line; the server; and the clock.
    """

    def test_of(conversation: Talk) -> Callable[..., None]:
        @in_loop
        async def test(kind: str) -> None:
            await converse(kind, conversation)

        tried: Callable[..., None] = pytest.mark.parametrize("kind", kinds)(test)
        return tried

    return test_of


async def converse(kind: str, conversation: Talk) -> None:
    clock, port, line = Clock(), free_port(), Line() if kind == "serial" else None
    at = f"{line.path}?baud=115200" if line else f"127.0.0.1:{port}"
    async with serving(f"{kind}://{at}", new_image(), clock) as server:
        one = line or await (Tcp if kind == "tcp" else Udp).connect(port)
        await conversation(one, server, clock)
        if one is not line:
            one.close()
    if line:
        line.close()


def read_request(first: int, count: int, unit: int = 1, number: int = 1, code: int = 3) -> bytes:
    pdu = struct.pack(">BHH", code, first, count)
    return mbap(pdu, unit, number)


def words_of(answer: bytes) -> list[int]:
    assert answer[7] < 0x80, f"refused with {answer[8]}"
    data = answer[9:]
    assert len(data) == answer[8]
    return words_from(data)


def write_request(first: int, words: list[int], unit: int = 1, number: int = 1) -> bytes:
    """A write of registers (code 16) over TCP or UDP."""
    head = struct.pack(">BHHB", 16, first, len(words), 2 * len(words))
    pdu = head + struct.pack(f">{len(words)}H", *words)
    return mbap(pdu, unit, number)


def mbap(pdu: bytes, unit: int = 1, number: int = 1) -> bytes:
    """A request or an answer as it is on a network."""
    return struct.pack(">HHHB", number, 0, len(pdu) + 1, unit) + pdu


def words(
    image: RegisterImage, first: int, count: int, now_s: float = START_S, view: View | None = None
) -> list[int]:
    """Registers of the image, without a wire, in as many reads as a client needs."""
    found: list[int] = []
    for at in range(first, first + count, 125):
        data = image.read(now_s, view, at, min(125, first + count - at))
        assert not isinstance(data, Refusal), data
        found += words_from(data)
    return found


def words_from(data: bytes) -> list[int]:
    return [int.from_bytes(data[k : k + 2], "big") for k in range(0, len(data), 2)]


def rows_of(registers: list[int], edge: int) -> list[list[int]]:
    stride = stride_of(edge)
    rows = [registers[row * stride : (row + 1) * stride] for row in range(edge)]
    return [[row[c // 8] >> 2 * (c % 8) & 3 for c in range(edge)] for row in rows]


def raster(cells: I8, corner: tuple[int, int], trusted: bool) -> list[list[int]]:
    """The slow and obvious model: codes by world cell, lowest corner first."""
    n = len(cells)
    rows = [
        [CODES[int(cells[j % n, i % n])] for i in range(corner[0], corner[0] + n)]
        for j in range(corner[1], corner[1] + n)
    ]
    return rows if trusted else [[code if code == 2 else 0 for code in row] for row in rows]
