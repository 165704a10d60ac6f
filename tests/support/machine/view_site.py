"""The page's server with real sockets: a sender on UDP on one side, pages on the other."""

import asyncio
import contextlib
import json
import socket
import struct
import time
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass, field
from typing import Any

from aiohttp import ClientSession, ClientWebSocketResponse, WSMsgType

from mapod_link.asking import ASK_BODY, DRIVE_BODY
from mapod_link.frames import (
    ASK,
    DRIVE,
    GEOM,
    MAP,
    POSE,
    STOP_ZONE,
    TILE,
    bytes_from_frame,
    frame_from_bytes,
)
from mapod_link.wires import UdpWire
from tests.support.link.planner_sender import SESSION, geom_body, map_body, op, pose_body, zone_body
from tools.view.driving import Limits
from tools.view.guard import Guard
from tools.view.link_end import LinkEnd
from tools.view.server import Facts, Server, served

TOKEN = "the token of this test"
OPEN_FOR_S = 60.0  # before a test has failed
LONG_MS = 65_535  # before what was told is stale


class Robot:
    """A sender on UDP, one run of it. It tells what it is told to tell, and keeps what it hears."""

    def __init__(self, url: str, session: int = SESSION) -> None:
        host, _, port = url.removeprefix("udp://").partition(":")
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.connect((host, int(port)))
        self._socket.setblocking(False)
        self._session, self._seq = session, 0
        self.drives: list[tuple[int, int, int]] = []  # (v mm/s, w mrad/s, valid ms)

    def tell(self, frame_type: int, body: bytes) -> None:
        self._seq += 1
        t_ms = int(time.monotonic() * 1000)
        self._socket.send(bytes_from_frame(frame_type, self._seq, t_ms, body))

    def begin(self, ops: bytes = b"") -> None:
        geom = geom_body(width=9, height=9, session=self._session, stale_ms=LONG_MS)
        self.tell(GEOM, geom)
        self.tell(POSE, pose_body())
        self.tell(MAP, map_body(ops))

    def tell_zone(self) -> None:
        self.tell(STOP_ZONE, zone_body())

    async def listen(self) -> None:
        """Until it is cancelled: keeps drive requests, answers for tiles with the column's mm."""
        while True:
            data = await asyncio.get_running_loop().sock_recv(self._socket, 2048)
            frame = frame_from_bytes(data)
            assert not isinstance(frame, str)
            if frame.type == DRIVE:
                self.drives.append(DRIVE_BODY.unpack(frame.body)[2:5])
            elif frame.type == ASK:
                self._answer(*ASK_BODY.unpack(frame.body))

    def _answer(
        self, i_d: int, _: int, layer: int, i: int, j: int, width: int, height: int
    ) -> None:
        values = [i + k % width for k in range(width * height)]
        head = struct.pack("<HBBhhHH", i_d, layer, 0, i, j, width, height)
        body = head + bytes(3) + struct.pack("<BHH", 7, len(values), 50)
        self.tell(TILE, body + struct.pack(f"<{len(values)}h", *values))

    def close(self) -> None:
        self._socket.close()


@dataclass
class Browser:
    """A page's end of a socket; keeps all that has come."""

    socket: ClientWebSocketResponse
    texts: list[dict[str, Any]] = field(default_factory=list)
    frames: list[tuple[int, dict[str, Any], bytes]] = field(default_factory=list)

    @property
    def states(self) -> list[dict[str, Any]]:
        return [text for text in self.of_type("state") if text["history"] is not True]

    @property
    def past(self) -> list[dict[str, Any]]:
        return [text for text in self.of_type("state") if text["history"] is True]

    def kinds(self, kind: int) -> list[tuple[dict[str, Any], bytes]]:
        return [(header, payload) for k, header, payload in self.frames if k == kind]

    def of_type(self, name: str) -> list[dict[str, Any]]:
        return [text for text in self.texts if text["type"] == name]

    async def until(self, holds: Callable[["Browser"], object]) -> "Browser":
        while not holds(self):
            message = await self.socket.receive()
            if message.type is WSMsgType.TEXT:
                self.texts.append(json.loads(message.data))
            elif message.type is WSMsgType.BINARY:
                kind, _, size = struct.unpack_from("<BBH", message.data)
                header = json.loads(message.data[4 : 4 + size])
                self.frames.append((kind, header, message.data[4 + size :]))
            else:
                raise AssertionError(f"closed: {message}")
        return self

    async def until_errors(self, count: int) -> None:
        await self.until(lambda browser: len(browser.of_type("error")) == count)

    async def until_closed(self) -> int:
        """Whatever comes before; gives the code."""
        while True:
            message = await self.socket.receive()
            if message.type is WSMsgType.CLOSE:
                return int(message.data)
            assert message.type in (WSMsgType.TEXT, WSMsgType.BINARY)

    async def say(self, **message: object) -> None:
        await self.socket.send_str(json.dumps(message))

    async def drive(self, v: float, w: float = 0.0, token: str = TOKEN) -> None:
        """As a page does that has just got a state."""
        seen = len(self.states)
        await self.until(lambda browser: len(browser.states) > seen)
        t_s = self.states[-1]["t_s"]
        await self.say(type="drive", v=v, w=w, dead_man=True, t_s=t_s, token=token)


@dataclass
class Site:
    """A server that runs, and who speaks with it."""

    server: Server
    url: str
    robot: Robot
    session: ClientSession

    @contextlib.asynccontextmanager
    async def browser(self, query: str = "", **more: Any) -> AsyncIterator[Browser]:
        headers = {"Origin": self.url}
        url = f"{self.url}/ws{query}"
        async with self.session.ws_connect(url, headers=headers, **more) as connected:
            yield Browser(connected)


@contextlib.asynccontextmanager
async def site(host: str = "127.0.0.1", refusal: str = "") -> AsyncIterator[Site]:
    """Listens on loopback, with the rules of a server that listens on `host`."""
    end = LinkEnd(UdpWire("127.0.0.1", 0))
    facts = Facts(version="1", limits=Limits(1.0, 0.8, refusal))
    server = Server(end, Guard(host, TOKEN), facts)
    robot = Robot(end.url)
    async with (
        asyncio.timeout(OPEN_FOR_S),
        ClientSession() as session,
        served(server, "127.0.0.1", 0) as port,
    ):
        listening = asyncio.create_task(robot.listen())
        try:
            yield Site(server, f"http://127.0.0.1:{port}", robot, session)
        finally:
            listening.cancel()
            robot.close()
    end.close()


FREE_AND_OBSTACLE = op(1, 9) + op(2, 1)
