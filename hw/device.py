"""What all device sessions share: the port's face, their status, the step to measurements.

A session is a generator: it yields the bytes to write and is sent a Tick. It never waits, reads no
clock and logs nothing.

A device that says nothing at all, though its session asks, gets a fresh connection: one that had
spoken on this connection after the port's own patience, one that never had after NEVER_HEARD_S.
So a TCP connection whose other end has lost its memory doesn't keep us from the rebooted device,
and one that accepts long before it answers is left in peace meanwhile.
"""

from collections.abc import Callable, Generator
from dataclasses import dataclass, field
from typing import Any, Generic, Literal, Protocol, TypeVar, runtime_checkable

from core.records import record
from hw.fingerprint import Stranger

Measurement = TypeVar("Measurement")
REJECTIONS_KEPT = 8  # per device, until somebody takes them to the log
NEVER_HEARD_S = 10.0  # of silence on a connection on which nothing was ever heard


class Port(Protocol):
    """One wire. No call waits. Opens and reopens by itself while it is polled (hw/ports)."""

    datagrams: bool  # True: each piece read or written is one datagram
    cause: str  # in words, why it is not open; "" while it is
    opened: int  # how often it was opened so far: a change means a new connection
    backlog: int  # bytes accepted and not yet taken by the wire

    def fileno(self) -> int:
        """The descriptor that is readable when bytes arrive; -1 while there is none."""

    def poll(self, now_s: float) -> bool:
        """Move on with opening, or with what is still to be written; True while open."""

    def read(self) -> list[bytes]:
        """The pieces that have arrived: cut anywhere (streams), or whole (datagrams)."""

    def write(self, data: bytes) -> None:
        """Hand over for sending, in order; dropped while the port is not open."""

    def close(self) -> None:
        """Let go of the wire for good."""


@runtime_checkable
class Reopens(Protocol):
    """A port that can get a fresh connection: one over a wire that may have died unnoticed."""

    silence_s: float  # of a device that had spoken, after which its connection is thought dead

    def reopen(self, cause: str) -> None:
        """Drop the connection for this cause, and open the next one after the shortest pause."""


class NoPort:
    """A wire that is open and leads nowhere: for warming up, and where a device is left out."""

    datagrams, cause, opened, backlog = False, "", 1, 0

    def fileno(self) -> int:
        """Nothing of it is known to the operating system."""
        return -1

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


@record()
class BadFrame:
    """Bytes that belong to no valid frame: something to count, not an exception."""

    reason: str
    skipped: bytes


@record()
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
        self._maybe_reopens = port if isinstance(port, Reopens) else None
        self._new_parser, self._new_session = new_parser, new_session
        self._stranger = Stranger(status.name)
        self._opened = 0
        self._held: list[Measurement] = []  # heard since the last step
        self._spoke_s = float("-inf")  # last bytes of any kind, or the opening of the connection
        self._has_spoken = False  # on this connection
        self._given_up = ""  # the cause for which we have dropped the connection
        self._begin()

    def _begin(self) -> None:
        self._parser, self._session = self._new_parser(), self._new_session()
        next(self._session)  # up to its first yield, which waits for a Tick

    def step(self, now_s: float) -> list[Measurement]:
        """Read, decode, let the session write; the measurements complete since the last step."""
        if self.port.poll(now_s):
            if self.port.opened != self._opened:
                self._start_anew(now_s)
            self._advance(now_s, self.port.read())
            if self._maybe_reopens is not None:
                self._drop_if_silent(now_s, self._maybe_reopens)
        elif self.port.cause != self._given_up and (
            self.status.state != "closed" or self.status.cause != self.port.cause
        ):
            self.status.fall_back("closed", self.port.cause)
            self._given_up = ""
        measurements, self._held = self._held, []
        return measurements

    def hear(self, now_s: float) -> None:
        """Read what has arrived between two steps, at the instant at which it did.

        The session may answer at once; measurements wait for the next step.
        """
        if self.port.opened == self._opened and (pieces := self.port.read()):
            self._advance(now_s, pieces)

    def stop(self) -> None:
        """The program ends: last words; step it until it has settled."""

    @property
    def settled(self) -> bool:
        """After `stop`: nothing is left that it must still bring about."""
        return True

    @property
    def identity(self) -> str:
        """Type, serial number, firmware, as far as it has told."""
        return ""

    def measured(self) -> dict[str, float]:
        """Voltages, temperatures and the like, by name with its unit."""
        return {}

    @property
    def has_heard(self) -> bool:
        """Whether measurements wait for the next step."""
        return bool(self._held)

    def _start_anew(self, now_s: float) -> None:
        """On a new connection. The same device after mere silence is no change of state."""
        self._opened, self._spoke_s, self._has_spoken = self.port.opened, now_s, False
        if not self._given_up:
            self.status.fall_back("starting", "waiting for the first answer")
            self._stranger.forget()
        self._given_up = ""
        self._begin()

    def _advance(self, now_s: float, pieces: list[bytes]) -> None:
        """Parser and session up to now; what they measured is held for the step."""
        events: list[Any] = []
        if pieces:
            for piece in pieces:
                events += self._parser.feed(now_s, piece)
            if any(pieces):
                self._spoke_s, self._has_spoken = now_s, True
            for event in events:
                if isinstance(event, BadFrame):
                    self.status.reject(event)
        out = self._session.send(Tick(now_s, events))
        if out:
            self.port.write(out)
        if self.status.state == "running":
            self._stranger.forget()
        else:
            self._name_stranger(now_s, pieces, out)
        if measurements := self._measure(now_s, events):
            self._held += measurements
            self.status.heard_s = now_s

    def _name_stranger(self, now_s: float, pieces: list[bytes], out: bytes) -> None:
        """While it does not run: say what seems to answer instead of the device."""
        words, cause = self._stranger.words(now_s, pieces, out), self.status.cause
        is_said = cause.endswith(words) or ("baud rate" in words and "baud rate" in cause)
        if words and not is_said:
            self.status.cause = f"{cause}: {words}"

    def _drop_if_silent(self, now_s: float, port: Reopens) -> None:
        if not self.port.fileno() >= 0:
            return
        limit_s = port.silence_s if self._has_spoken else NEVER_HEARD_S
        if now_s - self._spoke_s > limit_s:
            if self.status.state == "running":
                self.status.fall_back("starting", f"nothing heard for {limit_s:g} s")
            port.reopen(f"nothing heard for {limit_s:g} s")
            self._given_up = self.port.cause

    def _measure(self, now_s: float, events: list[Any]) -> list[Measurement]:
        """What the events mean to the rest of the program."""
        raise NotImplementedError
