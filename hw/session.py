"""What all device sessions share: the port's face, their status, the step to measurements.

A session is a generator: it yields the bytes to write and is sent a Tick. It never waits, reads no
clock and logs nothing.
"""

from collections.abc import Callable, Generator
from dataclasses import dataclass, field
from typing import Any, Generic, Literal, Protocol, TypeVar

Measurement = TypeVar("Measurement")
REJECTIONS_KEPT = 8  # per device, until somebody takes them to the log


class Port(Protocol):
    """One wire. No call waits. Opens and reopens by itself while it is polled (hw/port.py)."""

    datagrams: bool  # True: each piece read or written is one datagram
    cause: str  # in words, why it is not open; "" while it is
    opened: int  # how often it was opened so far: a change means a new connection
    backlog: int  # bytes accepted and not yet taken by the wire

    def poll(self, now_s: float) -> bool:
        """Move on with opening, or with what is still to be written; True while open."""

    def read(self) -> list[bytes]:
        """The pieces that have arrived: cut anywhere (streams), or whole (datagrams)."""

    def write(self, data: bytes) -> None:
        """Hand over for sending, in order; dropped while the port is not open."""

    def close(self) -> None:
        """Let go of the wire for good."""


class NoPort:
    """A wire that is open and leads nowhere: for warming up, and where a device is left out."""

    datagrams, cause, opened, backlog = False, "", 1, 0

    def poll(self, now_s: float) -> bool:
        """Always open."""
        return True

    def read(self) -> list[bytes]:
        """Nothing ever arrives."""
        return []

    def write(self, data: bytes) -> None:
        """Gone."""

    def close(self) -> None:
        """Nothing to let go of."""


@dataclass(frozen=True, slots=True)
class BadFrame:
    """Bytes that belong to no valid frame: something to count, not an exception."""

    reason: str
    skipped: bytes


@dataclass(frozen=True, slots=True)
class Tick:
    """What a session learns at each step."""

    now_s: float
    events: list[Any]  # what the parser made of the bytes that arrived


@dataclass(slots=True)
class DeviceStatus:
    """All that the rest of the program may know of a device."""

    name: str
    state: Literal["closed", "starting", "running"] = "closed"
    cause: str = "not opened yet"  # in words, while not running or not as configured; else ""
    heard_s: float = float("-inf")  # host clock, last measurement
    losses: int = 0  # times that running ended
    rejected: int = 0  # frames
    skipped_bytes: int = 0
    missed: int = 0  # measurements that the device's own counter says never arrived
    rejections: list[BadFrame] = field(default_factory=list)  # newest few, for the log to take

    def reject(self, frame: BadFrame) -> None:
        """Count it, and keep it for the log if there is room."""
        self.rejected += 1
        self.skipped_bytes += len(frame.skipped)
        if len(self.rejections) < REJECTIONS_KEPT:
            self.rejections.append(frame)

    def fall_back(self, state: Literal["closed", "starting"], cause: str) -> None:
        """Running no longer, or not yet; says why."""
        if self.state == "running":
            self.losses += 1
        self.state, self.cause = state, cause


class Parser(Protocol):
    """Takes a stream cut anywhere; gives events; never raises on input."""

    def feed(self, now_s: float, data: bytes) -> list[Any]:
        """The events that these bytes complete, BadFrame among them."""


Session = Generator[bytes, Tick, None]


class Device(Generic[Measurement]):
    """One device on its port: bytes in, measurements out, its session's bytes back.

    A session runs from one connection to the next: a new connection starts parser and session anew.
    """

    def __init__(
        self,
        status: DeviceStatus,
        port: Port,
        new_parser: Callable[[], Parser],
        new_session: Callable[[], Session],
    ) -> None:
        self.status, self.port = status, port
        self._new_parser, self._new_session = new_parser, new_session
        self._opened = 0
        self._begin()

    def _begin(self) -> None:
        self._parser, self._session = self._new_parser(), self._new_session()
        next(self._session)  # up to its first yield, which waits for a Tick

    def step(self, now_s: float) -> list[Measurement]:
        """Read, decode, let the session write; the measurements that became complete."""
        if not self.port.poll(now_s):
            if self.status.state != "closed" or self.status.cause != self.port.cause:
                self.status.fall_back("closed", self.port.cause)
            return []
        if self.port.opened != self._opened:
            self._opened = self.port.opened
            self.status.fall_back("starting", "waiting for the first answer")
            self._begin()
        events: list[Any] = []
        for piece in self.port.read():
            events += self._parser.feed(now_s, piece)
        for event in events:
            if isinstance(event, BadFrame):
                self.status.reject(event)
        self.port.write(self._session.send(Tick(now_s, events)))
        measurements = self._measure(now_s, events)
        if measurements:
            self.status.heard_s = now_s
        return measurements

    def _measure(self, now_s: float, events: list[Any]) -> list[Measurement]:
        """What the events mean to the rest of the program."""
        raise NotImplementedError
