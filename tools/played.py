"""An app that is played a recording of `mapod record`, and what came of a replay of any kind.

The app is stepped at the recorded instants and gets the recorded bytes, so that the same recording
always gives the same map. Its planner's frames say that the data are replayed (mode 4).
"""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from app import App, Ports
from config_file import load_config
from core.config import Config
from core.mapping.mapper import MapperCounts
from hw.device import DeviceStatus
from hw.ports.url import parse_url
from mapod_link.receiver import Receiver
from tools.recording import IN, LOST, OPENED, OUT, STEP, TURN, PlayedPort, Record, Recording

SESSION = 1  # of a replay whose recording tells none
NONCE = 1  # of the receiver whose map is shown


class Replay(Protocol):
    """An app on recorded bytes."""

    config: Config
    app: App
    view: "LinkView"

    @property
    def now_s(self) -> float: ...

    @property
    def done(self) -> bool: ...

    @property
    def lacks(self) -> str:
        """Why no scan can have been mapped, as far as the recording itself says; or ""."""

    def step(self) -> None: ...


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of a replay."""

    counts: MapperCounts
    link_bytes: int
    link_sha256: str
    obstacle: int
    free: int


class LinkView:
    """A receiver of what the app tells the planner, and the digest of all of it."""

    def __init__(self, datagrams: bool) -> None:
        self.planner = Receiver(NONCE)
        self._datagrams = datagrams
        self._digest, self._bytes = hashlib.sha256(), 0

    def take(self, now_s: float, data: bytes) -> None:
        self._digest.update(data)
        self._bytes += len(data)
        feed = self.planner.feed_datagram if self._datagrams else self.planner.feed_stream
        feed(now_s, data)

    def outcome(self, app: App) -> Outcome:
        window, sha256 = self.planner.window(), self._digest.hexdigest()
        cells = int((window == 2).sum()), int((window == 1).sum())
        return Outcome(app.mapper.counts, self._bytes, sha256, *cells)


def complaints_of(statuses: Mapping[str, DeviceStatus]) -> list[str]:
    """Of devices by name: those that do not run, or have a cause of trouble, in words."""
    return [
        f"the {name} is {status.state}" + (f": {status.cause}" if status.cause else "")
        for name, status in statuses.items()
        if status.cause or status.state != "running"
    ]


def why_nothing_was_mapped(replay: Replay) -> str:
    if replay.lacks:
        return replay.lacks
    app, counts = replay.app, replay.app.mapper.counts
    causes = complaints_of(app.states.statuses)
    if counts.scans_dropped:
        causes.append(f"{counts.scans_dropped} scans came without an attitude or a pose in time")
    if rejected := app.states.statuses["scanner"].rejected:
        causes.append(f"{rejected} of the scanner's frames were damaged")
    return "; ".join(causes) or "no scan came that could be used"


def session_of(recording: Recording) -> int:
    """The session that the recorded app told the planner; SESSION where that cannot be read."""
    receiver = Receiver(NONCE)
    port = recording.ports.index("planner") if "planner" in recording.ports else -1
    for record in recording.records():
        if record.kind == OUT and record.port == port:
            receiver.feed_datagram(record.t_s, record.data)
            receiver.feed_stream(record.t_s, record.data)
        if receiver.geom is not None:
            return receiver.geom.session
    return SESSION


class RecordingReplay:
    """A recording of all ports around one app, with its own settings or `config`."""

    def __init__(
        self, recording: Recording, session: int = SESSION, config: Config | None = None
    ) -> None:
        self.config = load_config(recording.config) if config is None else config
        planners = [parse_url(url).kind == "udp" for url in self.config.planner.ports]
        datagrams = [False, False, False, *planners]
        self._ports = [PlayedPort(flag) for flag in datagrams]
        scanner, ahrs, drive, planner, *others = self._ports
        ports = Ports(scanner, ahrs, drive, planner, tuple(others))
        self.app = App(self.config, ports, session=session, replayed=True)
        self.view = LinkView(planner.datagrams)
        self.now_s, self.done = 0.0, False
        self._records = recording.records()
        self._call: Record | None = None  # whose bytes are being read
        self._scanner_bytes = 0

    @property
    def lacks(self) -> str:
        return "" if self._scanner_bytes else "the recording holds no byte of the scanner"

    def step(self) -> None:
        """Play up to the next call of the app, and call it. Raises RecordingError: damaged."""
        for record in self._records:
            if record.kind in (OPENED, LOST, IN):
                self._ports[record.port].play(record)
                self._scanner_bytes += len(record.data) * (record.port == 0)
            elif record.kind != OUT:
                call, self._call = self._call, record
                if call is not None:
                    self._do(call)
                    return
        self.done = True
        if self._call is not None:
            self._do(self._call)

    def _do(self, call: Record) -> None:
        self.now_s = call.t_s
        if call.kind == STEP:
            self.app.step(call.t_s)
        elif call.kind == TURN:
            readable = [port for k, port in enumerate(self._ports) if call.port >> k & 1]
            self.app.turn(call.t_s, readable)
        written = self._ports[3].written
        while written:
            self.view.take(call.t_s, written.popleft())
        for port in self._ports:
            port.written.clear()
