"""The live page's server as a target: HTTP requests as they come, and what sockets say.

An input says what one connection sends: bytes as they are, a request with a right head, a socket's
upgrade, and messages in right frames behind it. No answer may be one of a mistake of ours (500),
no task may end by one, and nobody drives without the token.
"""

import asyncio
import contextlib
import logging
from functools import cache
from pathlib import Path
from typing import Any

from aiohttp import web

from mapod_link.frames import GEOM, MAP, POSE, bytes_from_frame
from mapod_link.wires import UdpWire
from tools.conformance.wire import Geom, map_body, op, pose_body
from tools.fuzz.program import instruction, instructions_of
from tools.view.driving import Limits
from tools.view.guard import Guard
from tools.view.link_end import LinkEnd
from tools.view.server import Facts, Server

RAW, REQUEST, UPGRADE, MESSAGE = range(4)  # by the low 2 bits of an instruction's first byte
BINARY = 4  # this bit beside MESSAGE
WITH_TOKEN = 8  # this bit beside UPGRADE
CLOSES = 16  # the connection ends behind it, and another one begins
TOKEN = "the token of a fuzzer"
HOST = "127.0.0.1:8080"
START_S, STEP_S = 1000.0, 0.02
MOST_STEPS, TURNS = 40, 12  # of an input; of the loop, behind each instruction
LONG_MS = 65_535  # before the link is stale
NOW = b"NOW"  # in a message: the instant at which it is sent
MASK = b"\x11\x22\x33\x44"


class Transport(asyncio.Transport):
    """The client's end: keeps what is answered."""

    def __init__(self) -> None:
        super().__init__({"peername": ("127.0.0.1", 5000), "sockname": ("127.0.0.1", 8080)})
        self.answered, self._is_closing = bytearray(), False

    def write(self, data: bytes | bytearray | memoryview) -> None:
        self.answered += data

    def is_closing(self) -> bool:
        return self._is_closing

    def close(self) -> None:
        self._is_closing = True

    abort = close

    def pause_reading(self) -> None:
        pass

    resume_reading = pause_reading

    def is_reading(self) -> bool:
        return True

    def set_write_buffer_limits(self, high: int | None = None, low: int | None = None) -> None:
        pass


class Site:
    """One server on no port, in a loop that turns when it is told to."""

    def __init__(self) -> None:
        logging.getLogger("aiohttp").setLevel(logging.CRITICAL)
        self.loop = asyncio.new_event_loop()
        self._frames = 0
        self.faults: list[dict[str, Any]] = []
        self.loop.set_exception_handler(lambda _, context: self.faults.append(context))
        end, self.now_s = LinkEnd(UdpWire("127.0.0.1", 0)), START_S
        end.now_s = lambda: self.now_s  # type: ignore[method-assign]
        self.server = Server(
            end,
            Guard("127.0.0.1", TOKEN),
            Facts(version="1", limits=Limits(1.0, 0.8, "")),
        )
        self.runner = web.AppRunner(self.server.application(), access_log=None)
        self.loop.run_until_complete(self.runner.setup())

    def begin(self) -> None:
        """The link lives: a map, a pose and a stop zone have just arrived."""
        self.now_s += 1.0
        cells = map_body((0, 0), 0, 7, 0, op(1, 9) + op(2, 1))
        told = (GEOM, Geom(7, 9, 9, 3, LONG_MS).body()), (POSE, pose_body()), (MAP, cells)
        for kind, body in told:
            self._frames += 1
            frame = bytes_from_frame(kind, self._frames, round(1000 * self.now_s), body)
            assert self.server.end.receiver.feed_datagram(self.now_s, frame)
        self.server.tick(self.now_s)

    def turn(self, times: int = TURNS) -> None:
        for _ in range(times):
            self.loop.run_until_complete(asyncio.sleep(0))

    def connect(self) -> tuple[Any, Transport]:
        transport, handlers = Transport(), self.runner.server
        assert handlers is not None
        connection = handlers()
        connection.connection_made(transport)
        self.turn()
        return connection, transport

    def lose(self, connection: Any, transport: Transport) -> None:
        with contextlib.suppress(ConnectionError):
            connection.connection_lost(None)
        self.turn()
        answered = bytes(transport.answered)
        assert b"HTTP/1.1 500" not in answered, answered[:200]
        assert not self.faults, self.faults


@cache
def site() -> Site:
    return Site()


def bytes_of(kind: int, data: bytes) -> bytes:
    """What goes over the connection for one instruction."""
    way = kind & 3
    if way == REQUEST:
        path = data.split(b"\r\n", 1)[0].replace(b" ", b"") or b"/"
        rest = data[len(path) :].removeprefix(b"\r\n")
        return (
            b"GET " + path + b" HTTP/1.1\r\nHost: " + HOST.encode() + b"\r\n" + rest + b"\r\n\r\n"
        )
    if way == UPGRADE:
        token = f"?token={TOKEN.replace(' ', '%20')}" if kind & WITH_TOKEN else ""
        head = (
            f"GET /ws{token} HTTP/1.1\r\nHost: {HOST}\r\nOrigin: http://{HOST}\r\n"
            "Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
            "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n"
        )
        return head.encode() + data.replace(b"\n", b"") + b"\r\n" * (1 + bool(data)) + b""
    if way == MESSAGE:
        opcode = 0x82 if kind & BINARY else 0x81
        size = (
            bytes([0x80 | len(data)]) if len(data) < 126 else b"\xfe" + len(data).to_bytes(2, "big")
        )
        return bytes([opcode]) + size + MASK + bytes(b ^ MASK[k % 4] for k, b in enumerate(data))
    return data


def run(program: bytes) -> int:
    """Behind how many instructions the robot was driven. Raises AssertionError."""
    here, driven, said = site(), 0, b""
    here.faults.clear()
    here.begin()
    connection, transport = here.connect()
    for kind, data in instructions_of(program, MOST_STEPS):
        said += data + TOKEN.encode() * bool(kind & 3 == UPGRADE and kind & WITH_TOKEN)
        if not transport.is_closing():
            connection.data_received(bytes_of(kind, data.replace(NOW, b"%.2f" % here.now_s)))
        here.turn()
        here.now_s += STEP_S
        here.server.tick(here.now_s)
        is_driven = here.server.driving.told_to(None, here.now_s)["by"] is not None
        assert not is_driven or TOKEN.encode() in said, "driven without the token"
        driven += is_driven
        if kind & CLOSES or transport.is_closing():
            here.lose(connection, transport)
            connection, transport = here.connect()
    here.lose(connection, transport)
    assert not here.server._pages
    return driven


def write_seeds(folder: Path) -> None:
    """Each file of the page, each message that a page may say, with the token and without."""
    paths = (b"/", b"/page.js", b"/ws", b"/nothing", b"/%2e%2e/x", b"/ws?token=x")
    for number, path in enumerate(paths):
        (folder / f"request-{number}").write_bytes(instruction(REQUEST, path))
    headers = (b"Origin: http://elsewhere", b"Host: evil", b"Content-Length: 5", b"Range: bytes=0-")
    for number, header in enumerate(headers):
        told = instruction(REQUEST, b"/\r\n" + header)
        (folder / f"header-{number}").write_bytes(told)
    said = (
        b'{"type":"auth","token":"' + TOKEN.encode() + b'"}',
        b'{"type":"layers","names":["height","slope"]}',
        b'{"type":"cell","i":-3,"j":70000}',
        b'{"type":"drive","v":1,"w":-0.5,"dead_man":true,"t_s":NOW}',
        b'{"type":"stop"}',
        b'{"type":"history","t_s":180}',
        b'{"type":"auth","token":"wrong"}',
        b"[",
    )
    for way in (UPGRADE, UPGRADE | WITH_TOKEN):
        begin = bytes([way]) + instruction(0, b"")[1:]
        pieces = [instruction(MESSAGE, words) for words in said]
        (folder / f"page-{way}").write_bytes(begin + b"".join(pieces))
        for number, piece in enumerate(pieces):
            (folder / f"said-{way}-{number}").write_bytes(begin + piece)
    raw = bytes_of(UPGRADE, b"")
    binary = bytes([MESSAGE | BINARY]) + instruction(0, b"\0\1")[1:]
    (folder / "raw").write_bytes(
        instruction(RAW, raw) + binary + instruction(RAW, b"\x89\x80\0\0\0\0")
    )
