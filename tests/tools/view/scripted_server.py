"""A server of the page that tells what a test says: any state of robot, link and driving.

It speaks the same messages as the server of `mapod view` and shares no code with it. It runs in a
thread of its own; a test sets its attributes and reads what pages have said.
"""

import asyncio
import json
import struct
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from aiohttp import WSMsgType, web

from tests import ROOT
from tests.tools.view.made_up import CELL_M, SIZE, U8, Drive, shifted

PAGE = ROOT / "tools" / "view" / "page"
TYPES = {
    ".html": "text/html",
    ".js": "text/javascript",
    ".css": "text/css",
    ".svg": "image/svg+xml",
}
HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; "
    "img-src 'self' blob:; connect-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'",
    "Cache-Control": "no-store",
}
TOKEN = "correct-horse-battery"
PERIOD_S = 0.1
LAYERS = (
    ("height", "m", "height"), ("variance", "m²", "variance"), ("slope", "rad", "slope"),
    ("age", "s", "age"), ("edge", "m", "way to the next edge"), ("foothold", "", "foothold"),
    ("cause", "", "cause"),
)  # fmt: skip
RANGES = {"edge": {"range": [0.0, 0.5]}, "foothold": {"range": [0.0, 1.0]}}
WORDS = ["unseen", "floor", "high: beyond h_pos_m", "drop: floor was due"]
ALL_WELL = 0b111_1111
ADVICE = {"clear": ["go", ""], "slow": ["slow", "a drop ahead"], "stop": ["stop", "a drop ahead"]}
ROBOT = {"front_m": 0.42, "rear_m": 0.28, "width_m": 0.52}


def message(kind: int, header: Mapping[str, object], payload: bytes) -> bytes:
    told = json.dumps(header).encode()
    return struct.pack("<BBH", kind, 0, len(told)) + told + payload


class Script:
    """What is told; a test may change any of it at any time."""

    def __init__(self) -> None:
        self.drive = Drive()
        self.moves = True
        self.speaks = True  # False: the socket stays open and nothing comes
        self.has_map = True
        self.over: dict[str, Any] = {}  # put over the state message
        self.zone: dict[str, Any] = {}  # put over its stop zone
        self.refusal = ""  # why nobody may drive
        self.needs_token = False  # to look
        self.heard: list[dict[str, Any]] = []
        self.kept: list[tuple[float, dict[str, Any], bytes]] = []  # t_s, state, window
        self.wish: tuple[float, float] | None = None
        self.layers: list[str] = []
        self.faults: list[BaseException] = []
        self.extra: list[str | bytes] = []  # told once to each page, after hello
        self.vectors: list[dict[str, Any]] = []  # messages `objects` and `path`: told when others

    def hello(self) -> dict[str, object]:
        layers: list[dict[str, object]] = [
            {"name": name, "unit": unit, "label": label, **RANGES.get(name, {})}
            for name, unit, label in LAYERS
        ]
        return {
            "type": "hello", "version": "0.1.0", "link": "udp://127.0.0.1:9750", "rate_hz": 10,
            "layers": [*layers[:-1], layers[-1] | {"words": WORDS}],
            "robot": ROBOT, "drive": {"allowed": not self.refusal, "why": self.refusal},
        }  # fmt: skip

    def state(self) -> dict[str, Any]:
        drive, t_s = self.drive, self.drive.t_s
        free_m = max(0.0, 9.4 - drive.x_m - ROBOT["front_m"])
        word = "clear" if free_m > 1.5 else "slow" if free_m > 0.6 else "stop"
        wave = 0.004 * (1 + np.sin(0.9 * t_s)) + 0.002 * drive.random.random()
        zone = {
            "state": word, "causes": 0 if word == "clear" else 4, "free_ahead_m": free_m,
            "text": word if word == "clear" else f"{word}: a drop", "free_behind_m": 1.4,
            "allowed_ahead_mps": min(0.8, free_m / 2), "allowed_behind_mps": 0.3,
            "nearest_m": 0.71, "bearing_rad": -1.2, **self.zone,
        }  # fmt: skip
        inputs = [
            {"name": name, "ok": True, "age_s": float(age_s), "text": ""}
            for name, age_s in (
                ("scanner", 0.012 + wave),
                ("attitude sensor", 0.006),
                ("wheel encoders", 0.021),
            )
        ]
        names = ("clock lock", "pose", "map", "pace")
        inputs += [{"name": name, "ok": True, "age_s": None, "text": ""} for name in names]
        state = {
            "type": "state", "t_s": t_s, "mode": 1, "mode_name": "running", "advice": ADVICE[word],
            "pose": {"x": drive.x_m, "y": drive.y_m, "yaw": drive.yaw_rad, "pitch": 0.012,
                     "roll": -0.004, "v": drive.v_mps, "w": drive.w_radps},
            "inputs": inputs, "health_bits": ALL_WELL, "zone": zone,
            "rates": {"map_hz": 25.0 + wave * 30, "pose_hz": 50.0, "scan_hz": 25.0,
                      "bytes_s": 9000 + 3e5 * wave},
            "latency_ms": {"p50": 1.8 + 60 * wave, "p99": 4.1 + 300 * wave},
            "link": {"text": "live", "stale": False, "lost": 0, "suspect": False},
            "driving": {"by": "you" if self.wish else None, "v": self.wish and self.wish[0],
                        "w": self.wish and self.wish[1], "why_not": self.refusal or None},
            "history": {"from_s": self.kept[0][0] if self.kept else None, "mb": 1.0},
        }  # fmt: skip
        return state | self.over

    def window(self, **more: object) -> bytes:
        drive = self.drive
        header = {"i": drive.origin[0], "j": drive.origin[1], "size": SIZE, "cell_m": CELL_M,
                  "epoch": 1, "t_s": drive.t_s, **more}  # fmt: skip
        return message(1, header, drive.cells.tobytes())

    def changed(self, before: U8) -> bytes:
        drive = self.drive
        index = np.flatnonzero(before != drive.cells)
        payload = np.empty(len(index), [("index", "<u4"), ("state", "u1")])
        payload["index"], payload["state"] = index, drive.cells.flat[index]
        header = {"i": drive.origin[0], "j": drive.origin[1], "size": SIZE, "t_s": drive.t_s}
        return message(2, header, payload.tobytes())

    def scan(self) -> bytes:
        points = self.drive.points
        return message(4, {"t_s": self.drive.t_s, "n": len(points)}, points.tobytes())

    def layer(self, name: str) -> bytes:
        drive, unit = self.drive, next(unit for known, unit, _ in LAYERS if known == name)
        header = {"name": name, "unit": unit, "i": drive.origin[0], "j": drive.origin[1],
                  "size": SIZE, "cell_m": CELL_M, "t_s": drive.t_s}  # fmt: skip
        return message(3, header, drive.layer(name).tobytes())

    def warm_up(self, seconds: float) -> None:
        """Drives on unseen, and keeps history."""
        for k in range(round(seconds / PERIOD_S)):
            self.drive.advance(PERIOD_S)
            if k % 5 == 0:
                state = self.state() | {"history": True}
                self.kept.append((self.drive.t_s, state, self.window(history=True)))

    def said(self, kind: str) -> list[dict[str, Any]]:
        return [told for told in self.heard if told.get("type") == kind]


class Server:
    """Pages and sockets over a script. `url` is where it listens."""

    def __init__(self, script: Script, page: Path = PAGE) -> None:
        self.script, self.page = script, page
        self.loop = asyncio.new_event_loop()
        self.sockets: set[web.WebSocketResponse] = set()
        self.url = ""
        self.ready = threading.Event()
        self.thread = threading.Thread(target=self._run, daemon=True)

    def _run(self) -> None:
        asyncio.set_event_loop(self.loop)
        self.loop.run_until_complete(self._start())
        self.ready.set()
        self.loop.run_forever()

    async def _start(self, port: int = 0) -> None:
        application = web.Application()
        application.router.add_get("/ws", self._socket)
        application.router.add_get("/{name:[a-z0-9.]*}", self._file)
        self.runner = web.AppRunner(application, shutdown_timeout=0.1)
        await self.runner.setup()
        await web.TCPSite(self.runner, "127.0.0.1", port).start()
        host, bound = self.runner.addresses[0][:2]
        self.url = f"http://{host}:{bound}/"

    async def _file(self, request: web.Request) -> web.Response:
        path = self.page / (request.match_info["name"] or "index.html")
        if not path.is_file():
            raise web.HTTPNotFound
        return web.Response(
            body=path.read_bytes(), content_type=TYPES[path.suffix], headers=HEADERS
        )

    async def _socket(self, request: web.Request) -> web.WebSocketResponse:
        socket = web.WebSocketResponse()
        await socket.prepare(request)
        if self.script.needs_token and request.query.get("token") != TOKEN:
            await socket.close(code=4401, message=b"needs the token")
            return socket
        self.sockets.add(socket)
        telling = asyncio.ensure_future(self._tell(socket))
        telling.add_done_callback(self._ended)
        async for got in socket:
            if got.type is WSMsgType.TEXT:
                await self._take(socket, json.loads(got.data))
        telling.cancel()
        self.sockets.discard(socket)
        self.script.wish = None
        self.script.heard.append({"type": "closed"})
        return socket

    def _ended(self, telling: asyncio.Future[None]) -> None:
        """A fault of the script itself is told by the test that waits for its page."""
        fault = None if telling.cancelled() else telling.exception()
        if fault is not None and not isinstance(fault, ConnectionError):
            self.script.faults.append(fault)

    async def _take(self, socket: web.WebSocketResponse, told: dict[str, Any]) -> None:
        script = self.script
        script.heard.append(told)
        match told["type"]:
            case "auth":
                await socket.send_json({"type": "auth", "ok": told["token"] == TOKEN})
            case "layers":
                script.layers = told["names"]
            case "cell":
                await socket.send_json(script.drive.cell(told["i"], told["j"]))
            case "drive" if script.refusal or told["token"] != TOKEN:
                why = script.refusal or "driving needs the token"
                await socket.send_json({"type": "error", "text": f"not driven: {why}"})
            case "drive":
                script.wish = (told["v"], told["w"])
            case "stop":
                script.wish = None
            case "history" if script.kept:
                before = [kept for kept in script.kept if kept[0] <= told["t_s"] + 1e-6]
                _, state, window = (before or script.kept)[-1 if before else 0]
                await socket.send_json(state)
                await socket.send_bytes(window)

    async def _tell(self, socket: web.WebSocketResponse) -> None:
        script, drive = self.script, self.script.drive
        await socket.send_json(script.hello())
        for told in script.extra:
            await (socket.send_str(told) if isinstance(told, str) else socket.send_bytes(told))
        held, origin, rounds = None, drive.origin, 0
        vectors: list[dict[str, Any]] = []
        while True:
            if script.speaks:
                if script.moves:
                    drive.advance(PERIOD_S)
                else:
                    drive.t_s += PERIOD_S
                await socket.send_json(script.state())
                if script.has_map:
                    await self._tell_map(socket, held, origin, rounds)
                    held, origin = drive.cells.copy(), drive.origin
                    rounds += 1
                if vectors is not script.vectors:
                    vectors = script.vectors
                    for each in vectors:
                        await socket.send_json({"t_s": drive.t_s, "left_out": 0, **each})
            await asyncio.sleep(PERIOD_S)

    async def _tell_map(
        self, socket: web.WebSocketResponse, held: U8 | None, origin: tuple[int, int], rounds: int
    ) -> None:
        script, now = self.script, self.script.drive.origin
        if held is None:
            await socket.send_bytes(script.window())
        else:
            before = shifted(held, now[0] - origin[0], now[1] - origin[1], 0)
            await socket.send_bytes(script.changed(before))
        await socket.send_bytes(script.scan())
        if script.layers and rounds % 5 == 0:
            await socket.send_bytes(script.layer(script.layers[rounds // 5 % len(script.layers)]))

    # From the test's thread

    def call(self, work: Any) -> Any:
        return asyncio.run_coroutine_threadsafe(work, self.loop).result(10.0)

    def hang_up(self) -> None:
        """Closes the sockets and the port; `listen_again` opens it at the same address."""
        self.call(self.runner.cleanup())

    def listen_again(self) -> None:
        self.call(self._start(int(self.url.rstrip("/").rpartition(":")[2])))


@contextmanager
def served(script: Script) -> Iterator[Server]:
    server = Server(script)
    server.thread.start()
    server.ready.wait(10.0)
    try:
        yield server
    finally:
        server.hang_up()
        server.loop.call_soon_threadsafe(server.loop.stop)
        server.thread.join(10.0)
        server.loop.close()
