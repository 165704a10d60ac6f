"""Serves the page: files, and a socket for each that is open. One process, one asyncio loop.

Source: RFC 6455 (sockets), by aiohttp; what they carry is told in docs/view.md.
"""

import asyncio
import contextlib
import os
from collections.abc import AsyncIterator, Awaitable, Callable
from dataclasses import dataclass
from pathlib import Path

import msgspec
from aiohttp import web

from tools.view.driving import Driving, Limits
from tools.view.flight import maybe_app, save_flight
from tools.view.guard import Guard
from tools.view.history import SPAN_S, History
from tools.view.layers import OFFERED, Layers, about
from tools.view.link_end import LinkEnd
from tools.view.pages import Page
from tools.view.requests import MOST_BYTES
from tools.view.state import state_of
from tools.view.vectors import VectorMessage, vectors_of
from tools.view.window import ScanLine, Window, scan_of, window_of

RATE_HZ = 10
SCAN_TICKS = 2  # from one scan line that is asked for to the next
MOST_PAGES = 16
NEEDS_TOKEN = 4401  # a socket is closed with
HEARTBEAT_S = 20.0  # a page that does not answer so long is gone
PAGE = Path(__file__).parent / "page"
KINDS = {".html": "text/html", ".js": "text/javascript", ".css": "text/css",
         ".svg": "image/svg+xml"}  # fmt: skip
HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; "
    "img-src 'self' blob:; connect-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-cache",
}
Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Facts:
    """What a page is told of the robot that stands in no frame."""

    version: str
    limits: Limits
    robot: dict[str, float] | None = None  # front_m, rear_m, width_m


class Server:
    """All that the pages share: the newest of everything, and who drives."""

    def __init__(self, end: LinkEnd, guard: Guard, facts: Facts) -> None:
        self.end, self.guard, self.facts = end, guard, facts
        self.driving, self.layers = Driving(end, facts.limits), Layers(end.receiver)
        self.history = History()
        self.window: Window | None = None
        self.scan: ScanLine | None = None
        self.vectors: dict[str, VectorMessage] = {}
        self.state, self._ticks = b"", 0
        self._pages: set[Page] = set()

    def application(self) -> web.Application:
        application = web.Application(middlewares=[self._guarded], client_max_size=MOST_BYTES)
        application.on_response_prepare.append(add_headers)
        application.router.add_get("/ws", self._socket)
        for path in sorted(PAGE.glob("*")):
            if path.suffix in KINDS:
                place = "/" if path.name == "index.html" else f"/{path.name}"
                application.router.add_get(place, file_handler(path))
        return application

    def hello(self) -> str:
        limits = self.facts.limits
        told = {
            "type": "hello",
            "version": self.facts.version,
            "link": self.end.url,
            "layers": [about(name) for name in OFFERED],
            "robot": self.facts.robot,
            "drive": {"allowed": not limits.refusal, "why": limits.refusal},
            "rate_hz": RATE_HZ,
            "history_s": SPAN_S,
            "needs_token": self.guard.looking_needs_token,
            "flight": self.has_flight(),
        }
        return msgspec.json.encode(told).decode()

    def has_flight(self) -> bool:
        """Whether the app runs on this machine."""
        handle = maybe_app(self.end.peer)
        if handle is not None:
            os.close(handle)
        return handle is not None

    def save_flight(self) -> str:
        return save_flight(self.end.peer)

    def tick(self, now_s: float) -> None:
        """Ten times a second: what pages get from now on."""
        self.window = window_of(self.end.receiver, now_s, self.end.epoch, self.window)
        state = state_of(self.end, now_s)
        state["history"] = {"from_s": self.history.from_s, "mb": self.history.megabytes}
        self.state = msgspec.json.encode(state)[:-1]
        self.scan = scan_of(self.end.receiver, now_s, self.scan)
        self.vectors = vectors_of(self.end, now_s, self.vectors)
        self.history.keep(now_s, self.state, self.window, self.scan)
        self._ticks += 1
        if self._pages and self._ticks % SCAN_TICKS == 0:
            self.end.receiver.ask_scan()
        stale = bool(self.end.trouble) or self.end.receiver.stale(now_s)  # nobody would answer
        wanted = set() if stale else {name for page in self._pages for name in page.layers}
        self.layers.poll(now_s, self.window, wanted)
        for page in self._pages:
            page.tick()

    async def run(self) -> None:
        """The link, the pages' ticks and the dead man's watch, until it is cancelled."""
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(self.end.run(self.driving.poll))
            tasks.create_task(self._ticking())

    async def _ticking(self) -> None:
        loop, period_s = asyncio.get_running_loop(), 1 / RATE_HZ
        due_s = loop.time()
        while True:
            self.tick(self.end.now_s())
            due_s = max(due_s + period_s, loop.time())  # what was missed is not made up
            await asyncio.sleep(due_s - loop.time())

    # Requests

    @web.middleware
    async def _guarded(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        if why := self.guard.refusal(request.host, request.headers.get("Origin")):
            return web.Response(status=403, text=why)
        return await handler(request)

    async def _socket(self, request: web.Request) -> web.StreamResponse:
        if len(self._pages) >= MOST_PAGES:
            text = f"{MOST_PAGES} pages are open: close one"
            return web.Response(status=503, text=text)
        socket = web.WebSocketResponse(
            max_msg_size=MOST_BYTES, heartbeat=HEARTBEAT_S, autoping=False
        )
        try:
            await socket.prepare(request)
        except ValueError:  # of aiohttp, where the key of the handshake is no ASCII
            return web.Response(status=400, text="the key of the socket can't be")
        knows_token = self.guard.token_is_right(request.query.get("token", ""))
        if self.guard.looking_needs_token and not knows_token:
            await socket.close(code=NEEDS_TOKEN, message=b"needs the token")
            return socket
        page = Page(self, socket, knows_token)
        self._pages.add(page)
        tasks = [asyncio.create_task(page.read()), asyncio.create_task(page.write())]
        try:
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            self._pages.discard(page)
            self.driving.stop(self.end.now_s(), page)
            for task in tasks:
                task.cancel()
        for task in done:
            if not isinstance(task.exception(), ConnectionResetError | None):
                task.result()
        await socket.close()
        return socket


async def add_headers(_: web.Request, response: web.StreamResponse) -> None:
    response.headers.update(HEADERS)


def file_handler(path: Path) -> Handler:
    """Gives a file of the page, as it is now."""

    async def handler(_: web.Request) -> web.StreamResponse:
        text = await asyncio.to_thread(path.read_text, "utf-8")
        kind = KINDS[path.suffix]
        return web.Response(text=text, content_type=kind, charset="utf-8")

    return handler


@contextlib.asynccontextmanager
async def served(server: Server, host: str, port: int) -> AsyncIterator[int]:
    """The server listens and runs meanwhile; gives its port. Raises OSError: it is taken."""
    runner = web.AppRunner(server.application(), access_log=None, shutdown_timeout=0.5)
    await runner.setup()
    try:
        site = web.TCPSite(runner, host, port)
        await site.start()
        async with asyncio.TaskGroup() as tasks:  # what fails in it ends the block, too
            running = tasks.create_task(server.run())
            try:
                yield runner.addresses[0][1]
            finally:
                running.cancel()
    finally:
        await runner.cleanup()
