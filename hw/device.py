"""What all devices share: the port's face, their status, the step from bytes to measurements.

Three parts make a device. Its parser turns bytes into events and never raises on input. Its session
says which bytes to send: a generator that yields bytes and is sent a Tick, never waits, reads no
clock and logs nothing (hw/exchange.py). `Device` steps both and keeps the status, which has all
that the rest of the program may know:

| state    | what it means                                  | what ends it                |
|----------|------------------------------------------------|-----------------------------|
| closed   | the port is not open: the cause is the port's  | the port opens              |
| starting | the session asks and sets: the cause says why  | it delivers                 |
| running  | it delivers: a cause is a remark               | silence, of device or port  |

A device that says nothing at all, though its session asks, gets a fresh connection: one that had
spoken on this connection after the port's own patience, one that never had after NEVER_HEARD_S.
So a TCP connection whose other end has lost its memory does not keep us from the rebooted device,
and one that accepts long before it answers is left in peace meanwhile.

Whoever else is at the other end of the wire can send more than a device does, and worse: junk that
looks like telegrams costs thirty times what telegrams cost. So a step parses what the device itself
could have sent, and leaves the rest to the next one (`Intake`).
"""

import enum
import math
from collections import deque
from collections.abc import Callable, Generator
from dataclasses import dataclass, field
from typing import Any, Generic, Literal, Protocol, TypeVar, runtime_checkable

from msgspec import Struct

from hw.fingerprint import Fingerprint

Measurement = TypeVar("Measurement")
REJECTIONS_KEPT = 8  # per device, until somebody takes them to the log
NEVER_HEARD_S = 10.0  # of silence on a connection on which nothing was ever heard

# One byte of a telegram costs about 0.03 us; what costs more is counted in such bytes.
EVENT_BYTES = 128  # an event, however short: 4 us
JUNK_FACTOR = 32  # a byte of junk that looks like telegrams: 1 us
MOST_KEPT = 8  # pieces between two steps
PIECE = 1024  # bytes parsed at once, where a device does not say otherwise: its longest telegram
HELD_UP_S = 0.2  # so much of a device's fastest stream may come at once: an ordinary delay
SERIAL_BYTES_PER_S = 92_160  # 921600 baud, the fastest line that any of the devices has


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


@runtime_checkable
class Gathers(Protocol):
    """A port that can wait for several bytes: a serial line."""

    def gather(self, size: int) -> None:
        """Be readable when so many bytes have come, 1..255, and give multiples of it only."""


@runtime_checkable
class SetsRate(Protocol):
    """A port whose rate can be changed while it is open: a serial line."""

    def set_rate(self, baud: int) -> None:
        """From now on; a connection that is opened anew has the rate of its URL again."""


class NoPort:
    """A wire that is open and leads nowhere: for warming up, and where a device is left out."""

    datagrams, cause, opened, backlog = False, "", 1, 0

    def fileno(self) -> int:
        return -1

    def poll(self, now_s: float) -> bool:
        return True

    def read(self) -> list[bytes]:
        return []

    def write(self, data: bytes) -> None: ...

    def close(self) -> None: ...


class BadFrame(Struct, frozen=True):
    """Bytes that belong to no valid frame: something to count, not an exception."""

    reason: str
    skipped: bytes


class Tick(Struct, frozen=True):
    """What a session learns at each step."""

    now_s: float
    events: list[Any]  # what the parser made of the bytes that arrived


@dataclass(slots=True)
class DeviceStatus:
    """All that the rest of the program may know of a device."""

    name: str
    state: Literal["closed", "starting", "running"] = "closed"
    cause: str = "not opened yet"  # in words, while not running or not as configured; else ""
    session: enum.Enum | None = None  # what its session is doing, for a person
    heard_s: float = float("-inf")  # host clock, last measurement
    due_s: float = -math.inf  # its session wants a Tick then, though no bytes come; -inf: the next
    each_step: bool = False  # and at every step before
    hears_s: float = -math.inf  # what arrives sooner is not worth a turn of its own
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


class Intake:
    """A device's parser, and the bytes that wait for it, each with the time of its arrival.

    While bytes wait no more are to be read: they stay with the operating system, which makes a
    sender over TCP wait. Nothing is lost but what waits when its connection ends.

    Args:
        piece: bytes parsed at once.
    """

    def __init__(self, new_parser: Callable[[], Parser], piece: int = PIECE) -> None:
        self._new_parser, self._piece = new_parser, piece
        self._waiting: deque[tuple[float, bytes]] = deque()
        self.allowance = 0.0  # bytes that may still be parsed in this step
        self.begin()

    def begin(self) -> None:
        """A new connection: a new parser, and what waited is of no use."""
        self._parser = self._new_parser()
        self._waiting.clear()
        self.waits = False  # bytes do

    def events(self, now_s: float, pieces: list[bytes]) -> list[Any]:
        """Take what has arrived now; the events of what this step may parse, in order."""
        waiting, size = self._waiting, self._piece
        for piece in pieces:
            for at in range(0, len(piece) or 1, size):
                waiting.append((now_s, piece[at : at + size]))
        events: list[Any] = []
        while waiting and self.allowance > 0:
            arrived_s, piece = waiting.popleft()
            found = self._parser.feed(arrived_s, piece)
            self.allowance -= len(piece) + EVENT_BYTES * len(found)
            for event in found:
                if isinstance(event, BadFrame):
                    self.allowance -= JUNK_FACTOR * len(event.skipped)
            events += found
        self.waits = bool(waiting)
        return events


class Device(Generic[Measurement]):
    """One device on its port: bytes in, measurements out, its session's bytes back.

    A session runs from one connection to the next: a new connection starts parser and session anew.

    Args:
        bytes_per_s: of the fastest stream that the device can send.
        piece: bytes parsed at once.
    """

    def __init__(
        self,
        status: DeviceStatus,
        port: Port,
        new_parser: Callable[[], Parser],
        new_session: Callable[[], Session],
        bytes_per_s: float = SERIAL_BYTES_PER_S,
        piece: int = PIECE,
    ) -> None:
        self.status, self.port = status, port
        self.due_s = -math.inf  # when to look at it if nothing arrives; -inf: at every tick
        self._intake, self._bytes_per_s = Intake(new_parser, piece), bytes_per_s
        self._new_session = new_session
        self._session = self._begun_session()
        self._fingerprint = Fingerprint(status.name)
        self._opened = 0
        self._kept: list[tuple[float, bytes]] = []  # read since the last step, not taken yet
        self._held: list[Measurement] = []  # heard since the last step
        self._stepped_s, self._read_s = math.inf, -math.inf  # the newest step; the port's last use
        self._maybe_reopens = port if isinstance(port, Reopens) else None
        self._patience_s = self._silent_s = math.inf  # without a byte; when that will be over
        self._given_up = ""  # the cause for which we have dropped the connection

    def _begun_session(self) -> Session:
        session = self._new_session()
        next(session)  # up to its first yield, which waits for a Tick
        return session

    def step(self, now_s: float) -> list[Measurement]:
        """Read, decode, let the session write; the measurements complete since the last step."""
        if self.port.poll(now_s):
            if self.port.opened != self._opened:
                self._start_anew(now_s)
            passed_s, self._stepped_s = now_s - self._stepped_s, now_s
            self._intake.allowance = self._bytes_per_s * max(HELD_UP_S, 2 * passed_s)
            self._take(now_s)
            if now_s > self._silent_s and self.port.fileno() >= 0:  # not found at its end
                self._drop()
        elif self.port.cause != self._given_up and (
            self.status.state != "closed" or self.status.cause != self.port.cause
        ):
            self.status.fall_back("closed", self.port.cause)
            self._given_up, self.due_s = "", -math.inf
        measurements, self._held = self._held, []
        return measurements

    def hear(self, now_s: float) -> None:
        """Read what has arrived between two steps, at the instant at which it did.

        The session may answer at once; measurements wait for the next step.
        """
        if self.port.opened != self._opened or self._intake.waits:
            return
        self._take(now_s)

    def keep(self, now_s: float) -> None:
        """Read what has arrived, with its time; the next step finds out what it means.

        For what nobody waits for: each wake-up by itself costs as much as two taken together.
        """
        if self.status.state != "running" or len(self._kept) >= MOST_KEPT:
            self.hear(now_s)
        elif self.port.opened == self._opened and not self._intake.waits:
            self._read_s = now_s
            for piece in self.port.read():
                self._kept.append((now_s, piece))

    def stop(self) -> None: ...

    @property
    def settled(self) -> bool:
        return True

    @property
    def identity(self) -> str:
        return ""

    def measured(self) -> dict[str, float]:
        return {}

    @property
    def has_heard(self) -> bool:
        return bool(self._held)

    def _start_anew(self, now_s: float) -> None:
        """On a new connection. The same device after mere silence is no change of state."""
        self._opened = self.port.opened
        if self._maybe_reopens is not None:
            self._patience_s, self._silent_s = NEVER_HEARD_S, now_s + NEVER_HEARD_S
        if not self._given_up:
            self.status.fall_back("starting", "waiting for the first answer")
            self._fingerprint.forget()
        self._given_up = ""
        self._intake.begin()
        self._kept.clear()
        self._session = self._begun_session()

    def _take(self, now_s: float) -> None:
        """What has arrived, for the session; while it runs, only what it may have waited for.

        What it measured is held for the step.
        """
        intake, status, events = self._intake, self.status, list[Any]()
        has_come = bool(self._kept) or intake.waits
        for arrived_s, piece in self._kept:
            events += intake.events(arrived_s, [piece])
        self._kept.clear()
        pieces: list[bytes] = []
        if intake.waits:
            events += intake.events(now_s, pieces)
        elif now_s > self._read_s:  # else nothing can have come since
            self._read_s = now_s
            if pieces := self.port.read():
                events += intake.events(now_s, pieces)
        if (has_come or any(pieces)) and self._maybe_reopens is not None:
            self._patience_s = self._maybe_reopens.silence_s
            self._silent_s = now_s + self._patience_s
        for event in events:
            if isinstance(event, BadFrame):
                status.reject(event)
        was_running = status.state == "running"
        if events or status.each_step or status.due_s <= now_s or not was_running:
            out = self._session.send(Tick(now_s, events))
            if out:
                self.port.write(out)
            if status.state != "running":
                self._name_who_answers(now_s, pieces, out)
            elif not was_running:
                self._fingerprint.forget()
            if measurements := self._measure(now_s, events):
                self._held += measurements
                status.heard_s = now_s
        is_held_up = intake.waits or self.port.backlog or status.state != "running"
        self.due_s = -math.inf if is_held_up else status.due_s

    def _name_who_answers(self, now_s: float, pieces: list[bytes], out: bytes) -> None:
        message, cause = self._fingerprint.message(now_s, pieces, out), self.status.cause
        is_said = cause.endswith(message) or ("baud rate" in message and "baud rate" in cause)
        if message and not is_said:
            self.status.cause = f"{cause}: {message}"

    def _drop(self) -> None:
        """Nothing has come for too long: the port makes a fresh connection."""
        cause = f"nothing heard for {self._patience_s:g} s"
        assert self._maybe_reopens is not None  # else its time is never over
        self._maybe_reopens.reopen(cause)
        self.due_s = -math.inf
        if self.status.state == "running":
            self.status.fall_back("starting", cause)
        self._given_up = self.port.cause

    def _measure(self, now_s: float, events: list[Any]) -> list[Measurement]:
        """What these events complete; nothing where a device measures in its own `step`."""
        return []
