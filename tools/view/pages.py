"""One open page: what it asks for, and what it gets. It gets the newest of all, and nothing queues.

What does not go out at once, because the page or its network is slow, is left out: the next message
tells of the state of then. So a page that lies in the background for hours costs what one costs.
"""

import asyncio
import math
from collections import deque
from typing import Protocol

import msgspec
from aiohttp import WSMessage, WSMsgType
from aiohttp.web import WebSocketResponse

from tools.view.driving import NO_HAND, Driving
from tools.view.guard import Guard
from tools.view.history import History, Kept
from tools.view.layers import OFFERED, CellQuestion, Layers
from tools.view.link_end import LinkEnd
from tools.view.requests import (
    AskCell,
    AskHistory,
    Auth,
    Drive,
    Flight,
    Request,
    ShowLayers,
    Stop,
    request_of,
)
from tools.view.vectors import VectorMessage
from tools.view.window import ScanLine, Window

ANSWERS = 16  # that wait to be sent
REFUSED_S = 1.0  # so long a refusal is told
LAYER_S = 1.0  # from one picture of a layer to the next
MESSAGES_PER_S, BURST = 40.0, 80.0
ON_THE_WAY = 3  # rounds of news, at most: kernels and networks queue too
WRONG_TOKENS = 5  # of one socket
STATE = "state"  # a layer that every page gets anyway

Told = str | bytes


class Desk(Protocol):
    """What a page needs of its server."""

    end: LinkEnd
    guard: Guard
    driving: Driving
    layers: Layers
    history: History
    window: Window | None
    state: bytes  # JSON, without `driving` and the last brace
    scan: ScanLine | None
    vectors: dict[str, VectorMessage]

    def hello(self) -> str: ...

    def save_flight(self) -> str: ...


class Bucket:
    """So many a second, and a burst of some more."""

    def __init__(self) -> None:
        self._left, self._s = BURST, 0.0
        self.was_told = False  # that it is empty, since it was last not so

    def take(self, now_s: float) -> bool:
        self._left = min(BURST, self._left + (now_s - self._s) * MESSAGES_PER_S)
        self._s = now_s
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True


class Page:
    """One socket. `read` and `write` run until it closes.

    Args:
        may_drive: it has come with the token.
    """

    def __init__(self, desk: Desk, socket: WebSocketResponse, may_drive: bool) -> None:
        self._desk, self._socket = desk, socket
        self._news = asyncio.Event()
        self.answers: deque[Told] = deque(maxlen=ANSWERS)
        self.layers: tuple[str, ...] = ()
        self._may_drive, self._wrong_tokens = may_drive, 0
        self._on_the_way = 0  # rounds of news that have not arrived, as far as is known
        self._why_not = "", -math.inf  # of the newest wish to drive, and when it came
        self._held: Window | None = None  # that the page has
        self._sent_layers: dict[str, tuple[float, bytes]] = {}
        self._sent_scan: ScanLine | None = None
        self._sent_vectors: dict[str, VectorMessage] = {}
        self._cell: CellQuestion | None = None
        self._past: Kept | None = None  # that it has asked for
        self._bucket = Bucket()

    def tick(self) -> None:
        """There is something new to be told."""
        self._news.set()

    async def read(self) -> None:
        """Takes the page's messages until the socket closes."""
        async for message in self._socket:
            if message.type is WSMsgType.PONG:
                self._on_the_way = max(self._on_the_way - 1, 0)
            elif message.type is WSMsgType.PING:
                await self._socket.pong(message.data)
            else:
                self.take(self._desk.end.now_s(), message)
            if self._wrong_tokens > WRONG_TOKENS:
                return

    async def write(self) -> None:
        """Sends the newest, over and over; the ping behind it tells when it has arrived."""
        await self._send(self._desk.hello())
        while True:
            await self._news.wait()
            self._news.clear()
            if self._on_the_way >= ON_THE_WAY:
                continue
            while self.answers:
                await self._send(self.answers.popleft())
            for told in self._news_of(self._desk.end.now_s()):
                await self._send(told)
            self._on_the_way += 1
            await self._socket.ping()

    async def _send(self, told: Told) -> None:
        if isinstance(told, bytes):
            await self._socket.send_bytes(told)
        else:
            await self._socket.send_str(told)

    def _news_of(self, now_s: float) -> list[Told]:
        """What is new for this page, as of now; it counts as sent."""
        desk, news = self._desk, list[Told]()
        if desk.state:
            told, (why_not, asked_s) = desk.driving.told_to(self, now_s), self._why_not
            if why_not and now_s - asked_s < REFUSED_S:
                told["why_not"] = why_not
            driving = msgspec.json.encode(told)
            news.append((desk.state + b',"driving":' + driving + b"}").decode())
        if desk.window is not None and (change := desk.window.since(self._held)):
            news.append(change)
        self._held = desk.window
        if desk.scan is not None and desk.scan is not self._sent_scan:
            self._sent_scan = desk.scan
            news.append(desk.scan.message())
        sent, self._sent_vectors = self._sent_vectors, desk.vectors
        news += [new.text for name, new in desk.vectors.items() if new is not sent.get(name)]
        if self._cell is not None and (answer := self._cell.maybe_answer(now_s)):
            self._cell = None
            news.append(msgspec.json.encode(answer).decode())
        if self._past is not None:
            news += self._past.messages()
            self._past = None
        return news + self._layer_of(now_s)

    def _layer_of(self, now_s: float) -> list[Told]:
        """One layer at a time, the one that was sent longest ago."""
        order = sorted(self.layers, key=lambda name: self._sent_layers.get(name, (-math.inf,))[0])
        for name in order:
            sent_s, sent = self._sent_layers.get(name, (-math.inf, b""))
            layer = self._desk.layers.maybe_layer(name)
            if layer is None or now_s - sent_s < LAYER_S or (told := layer.encoded()) is sent:
                continue
            self._sent_layers[name] = now_s, told
            return [told]
        return []

    # What a page says

    def take(self, now_s: float, message: WSMessage) -> None:
        """One message; nothing raises on what it says."""
        if message.type is not WSMsgType.TEXT:
            self._refuse("not understood: messages are JSON")
            return
        request = request_of(message.data)
        if isinstance(request, Stop):  # never too many
            self._desk.driving.stop(now_s, self)
        elif not self._bucket.take(now_s):
            if not self._bucket.was_told:
                self._refuse("too many messages: those beyond 40 a second are left out")
            self._bucket.was_told = True
        elif isinstance(request, str):
            self._refuse(request)
        elif isinstance(request, Auth):
            self._authenticate(request)
        else:
            self._bucket.was_told = False
            self._obey(now_s, request)

    def _obey(self, now_s: float, request: Request) -> None:
        desk = self._desk
        match request:
            case ShowLayers(names):
                self._show(names)
            case AskCell(i, j):
                if self._cell is not None:
                    self._cell.drop()
                self._cell = CellQuestion(now_s, desk.end.receiver, i, j)
            case Drive():
                self._drive(now_s, request)
            case AskHistory(t_s):
                self._past = desk.history.at(t_s)
                if self._past is None:
                    self._refuse("nothing is kept yet")
            case Flight(token):
                if self._knows(token):
                    why_not = desk.save_flight()
                    self._say({"type": "flight", "ok": not why_not, "text": why_not})

    def _authenticate(self, request: Auth) -> None:
        ok = self._desk.guard.token_is_right(request.token)
        self._wrong_tokens += not ok
        self._say({"type": "auth", "ok": ok})
        self._may_drive = self._may_drive or ok

    def _knows(self, token: str) -> bool:
        """Whether the page may do more than look; else it is told what it takes."""
        if self._may_drive or self._desk.guard.token_is_right(token):
            return True
        self._wrong_tokens += bool(token)
        self._refuse("this needs the token of the address that `mapod view` has printed")
        return False

    def _show(self, names: list[str]) -> None:
        unknown = [name for name in names if name not in (*OFFERED, STATE)]
        refusals = self._desk.layers.refused
        refused = [f"{name}: {refusals[name]}" for name in names if name in refusals]
        if unknown:
            self._refuse(f"there is no layer {unknown[0]!r}; there are {', '.join(OFFERED)}")
        elif refused:
            self._refuse("; ".join(refused))
        self.layers = tuple(dict.fromkeys(name for name in names if name in OFFERED))
        self._sent_layers = {n: sent for n, sent in self._sent_layers.items() if n in self.layers}

    def _drive(self, now_s: float, request: Drive) -> None:
        driving = self._desk.driving
        if not self._knows(request.token):
            return
        if not request.dead_man:
            driving.stop(now_s, self)
            self._refuse(NO_HAND)
        else:
            before, before_s = self._why_not
            why_not = driving.drive(now_s, self, request.v, request.w, request.t_s)
            self._why_not = why_not, now_s
            if why_not and (why_not != before or now_s - before_s > REFUSED_S):
                self._refuse(f"not driven: {why_not}")  # once, though it goes on asking

    def _refuse(self, text: str) -> None:
        self._say({"type": "error", "text": text})

    def _say(self, told: dict[str, object]) -> None:
        self.answers.append(msgspec.json.encode(told).decode())
        self._news.set()
