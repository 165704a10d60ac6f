"""Modbus as a target: what comes over TCP, in datagrams, and on a serial line, with time between.

Nothing that comes raises; who asks gets one answer a request at most, and no more than fit into the
standard's frames; nobody from another machine drives, and nobody beyond the registers' ranges.
"""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from core.records import ObstacleMap, PoseReport, StopZoneReport
from hw.device import DeviceStatus
from hw.modbus.client import Client, Request, ServerContext
from hw.modbus.image import RegisterImage
from hw.modbus.network import MBAP, TcpConnection, TcpService, UdpService
from hw.modbus.rtu import RtuReceiver, crc16, rtu_frame
from hw.ports.url import parse_url
from tools.fuzz.program import instruction, instructions_of

RAW, FRAMED, DATAGRAM, LINE = range(4)  # by the low 2 bits of an instruction's first byte
RAW_TOO = 4  # this bit beside DATAGRAM and LINE: without a right frame
SILENT = 8  # this bit beside LINE: the line is silent behind it
SECOND = 16  # this bit beside RAW and FRAMED: another connection, from another machine
PAUSE = 32  # this bit: half a second passes
UNITS = 1, 2
HERE, FAR = "127.0.0.1", "10.0.0.9"
SIZE, MOST_STEPS, START_S = 9, 120, 1000.0
MOST_ANSWER = 260  # bytes of a frame
POSE = PoseReport(1.0, -2.0, 0.5, 0.01, -0.02, 0.25, -0.1, 0x7F, 0.01, 0.02, 0.03, 1)
ZONE = StopZoneReport(2.0, 2.5, 1.0, math.inf, math.inf, 0.8, 0.4, 0.5, 0.1, (2.0,) * 8, 1, 0)
CELLS = np.random.default_rng(1).integers(-1, 2, (SIZE, SIZE)).astype(np.int8)


class Later:
    """A call to come, of the loop below."""

    def __init__(self, due_s: float, callback: Callable[[], object]) -> None:
        self.due_s, self.callback = due_s, callback

    def cancel(self) -> None:
        self.callback = int


class Loop:
    """As much of a loop as clients use, on a clock that is set."""

    def __init__(self) -> None:
        self.now_s, self._calls = START_S, list[Later]()

    def call_soon(self, callback: Callable[[], object]) -> Later:
        return self.call_later(0.0, callback)

    def call_later(self, delay_s: float, callback: Callable[[], object]) -> Later:
        self._calls.append(Later(self.now_s + delay_s, callback))
        return self._calls[-1]

    def run_until(self, now_s: float) -> None:
        while due := [call for call in self._calls if call.due_s <= now_s]:
            first = min(due, key=lambda call: call.due_s)
            self._calls.remove(first)
            self.now_s = max(self.now_s, first.due_s)
            first.callback()
        self.now_s = now_s


class Transport:
    """Of a connection or of datagrams: counts what is answered."""

    def __init__(self, host: str) -> None:
        self.host, self.answers, self.is_closed = host, 0, False

    def get_extra_info(self, name: str) -> tuple[str, int] | None:
        return (self.host, 5000) if name == "peername" else None

    def write(self, data: bytes) -> None:
        assert len(data) <= MOST_ANSWER
        self.answers += 1

    def sendto(self, data: bytes, to: object) -> None:
        del to
        self.write(data)

    def close(self) -> None:
        self.is_closed = True


class Server:
    """One register image, served every way; remembers what was asked of the motors."""

    def __init__(self) -> None:
        self.loop, self.asked = Loop(), list[str]()
        image = RegisterImage(size=SIZE, cell_mm=200, session=7, version="1", ask=self._ask)
        window = ObstacleMap(CELLS, -7, 3, np.zeros(0, dtype=np.int32), 0, True)
        image.publish(START_S, POSE, ZONE, window)
        self.context = ServerContext(
            image=image,
            clock=lambda: self.loop.now_s,
            utc_s=lambda: 0.0,
            loop=self.loop,  # type: ignore[arg-type]
            views={1: None, 2: image.new_view()},
            is_silent=False,
            status=DeviceStatus("modbus"),
        )
        self._tcp = TcpService(self.context, parse_url("tcp://127.0.0.1:502"))
        self.udp = UdpService(self.context, parse_url("udp://127.0.0.1:502"))
        self.datagrams = Transport(HERE)
        self.udp._transport = self.datagrams  # type: ignore[assignment]
        self.line = RtuReceiver(frozenset(UNITS))
        self.master = Client(self.context, "line", True, lambda request, pdu: None)
        self._connections: dict[str, tuple[TcpConnection, Transport]] = {}

    def _ask(self, now_s: float, who: str, v_mps: float, w_radps: float, valid_s: float) -> str:
        assert FAR not in who, "driven from another machine"
        assert max(abs(v_mps), abs(w_radps)) <= 32.767
        assert 0.0 <= valid_s <= 1.0
        self.asked.append(f"{now_s} {who}")
        return ""

    def connection(self, host: str) -> TcpConnection:
        """From there, a new one where the last was closed."""
        known = self._connections.get(host)
        if known is None or known[1].is_closed:
            transport: Any = Transport(host)
            known = TcpConnection(self._tcp), transport
            known[0].connection_made(transport)
            self._connections[host] = known
        return known[0]

    def close(self) -> None:
        for connection, transport in self._connections.values():
            if not transport.is_closed:
                connection.connection_lost(None)


def framed(data: bytes) -> bytes:
    """A TCP frame: unit and PDU are the data, as many bytes as may be."""
    data = (data or b"\1\3")[:254]
    return MBAP.pack(7, 0, max(2, len(data)), data[0]) + (data[1:] or b"\3")


def run(program: bytes) -> int:
    """How often the motors were asked. Raises AssertionError."""
    server = Server()
    for kind, data in instructions_of(program, MOST_STEPS):
        way = kind & 3
        if way == LINE:
            whole = data if kind & RAW_TOO else rtu_frame(Request(1, b""), data)
            found = server.line.feed(whole)
            if kind & SILENT:
                found += server.line.silence(long=bool(kind & PAUSE))
            for request in found:
                assert request.unit in UNITS
                assert request.pdu
            server.master.offer(found)
            assert len(server.line._buffer) <= 4 * 256
        elif way == DATAGRAM:
            whole = data if kind & RAW_TOO else framed(data)
            server.udp.datagram_received(whole, (FAR if kind & SECOND else HERE, 1))
        else:
            server.connection(FAR if kind & SECOND else HERE).data_received(
                framed(data) if way == FRAMED else data
            )
        server.loop.run_until(server.loop.now_s + (0.5 if kind & PAUSE else 0.01))
    server.close()
    return len(server.asked)


def write_seeds(folder: Path) -> None:
    """One request of each function that is served, over each way; the standard's own frames."""
    drive = bytes.fromhex("01 10 00 c8 00 04 08 01 2c ff 38 01 90 00 01")
    requests = [
        bytes.fromhex(text)
        for text in (
            "01 01 00 00 00 10", "01 02 00 05 00 13", "01 03 00 00 00 0a", "02 04 01 00 00 20",
            "01 05 00 01 ff 00", "01 06 00 5a 00 01", "01 0f 00 00 00 04 01 05",
            "02 16 00 5a 00 f2 00 25", "01 17 00 00 00 05 00 c8 00 04 08 00 00 00 00 00 00 00 02",
            "01 2b 0e 01 00", "01 2b 0e 04 05", "03 03 00 00 00 01",
        )
    ]  # fmt: skip
    requests.append(drive)
    ways = {"tcp": FRAMED, "far": FRAMED | SECOND, "udp": DATAGRAM, "line": LINE | SILENT}
    for name, way in ways.items():
        bodies = [request[1:] if name == "line" else request for request in requests]
        pieces = [bytes([way]) + instruction(0, body)[1:] for body in bodies]
        (folder / f"all-{name}").write_bytes(b"".join(pieces))
        for number, piece in enumerate(pieces):
            (folder / f"one-{name}-{number}").write_bytes(piece)
    frame = requests[2]
    raw = instruction(LINE, frame + crc16(frame).to_bytes(2, "little"), 1)
    (folder / "raw").write_bytes(raw + instruction(RAW, framed(drive)[:9]))
