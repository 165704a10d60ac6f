"""An app that is played a recording of `mapod record`, and what came of a replay of any kind.

The app is stepped at the recorded instants and gets the recorded bytes, so that the same recording
always gives the same map. Its planner's frames say that the data are replayed (mode 4).
"""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from app import App
from core.config import Config
from core.mapping.mapper import MapperCounts
from hw.device import DeviceStatus
from mapod_link.receiver import Receiver
from recording.reader import Recording
from tools.replay.player import Player

SESSION = 1  # of a replay whose recording tells none
PLANNER = 3  # the first planner's place among the ports of a recording
NONCE = 1  # of the receiver whose map is shown


class Played(Protocol):
    """An app on recorded bytes."""

    app: App

    @property
    def lacks(self) -> str:
        """Why no scan can have been mapped, as far as the recording itself says; or ""."""


class Replay(Played, Protocol):
    """The same with its settings, and what its planner heard."""

    config: Config
    view: "LinkView"

    @property
    def now_s(self) -> float: ...

    @property
    def done(self) -> bool: ...

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


def why_nothing_was_mapped(replay: Played) -> str:
    if replay.lacks:
        return replay.lacks
    app, counts = replay.app, replay.app.mapper.counts
    causes = complaints_of(app.states.statuses)
    if counts.scans_dropped:
        causes.append(f"{counts.scans_dropped} scans came without an attitude or a pose in time")
    if rejected := app.states.statuses["scanner"].rejected:
        causes.append(f"{rejected} of the scanner's frames were damaged")
    return "; ".join(causes) or "no scan came that could be used"


class RecordingReplay:
    """A recording of all ports around one app, with its own settings or `config`."""

    def __init__(self, recording: Recording, config: Config | None = None) -> None:
        self._player = Player(recording, config, replayed=True)
        self.config, self.app = self._player.config, self._player.app
        self.view = LinkView(bool(recording.wires[PLANNER]["datagrams"]))

    @property
    def now_s(self) -> float:
        return self._player.now_s

    @property
    def done(self) -> bool:
        return self._player.done

    @property
    def lacks(self) -> str:
        return self._player.lacks

    def step(self) -> None:
        """Play the next call of the app. Raises RecordingError: damaged."""
        self._player.step()
        for frame in self._player.frames:
            self.view.take(self.now_s, frame)
