"""A port that tells of all that happens to it, so that a replay can give the same at the same uses.

Within one call of the app a port is polled, read and written several times. What came of each of
them is told with the number of that use.
"""

from collections.abc import Callable
from typing import Any, Protocol, cast

from hw.device import Gathers, Port, Reopens
from recording.records import (
    CHANGED,
    IN,
    LOST,
    OPENED,
    OUT,
    PORT_STATE,
    READ_ENDED,
)

MOST_BACKLOG, MOST_USES = 2**32 - 1, 2**16 - 1
CLOSED = (False, 0, "not opened yet", 0)  # is open, opened, cause, backlog: before its first use


class Notes(Protocol):
    """Takes what happens."""

    calls: int  # of the app so far

    def note(
        self, t_s: float, kind: bytes, port: int = 0, data: bytes = b"", more: bytes = b""
    ) -> None:
        """One record. `more`: the rest of its data, where that is large: it is not copied."""


class RecordedPort:
    """A port, and a record of each connection, loss, piece and change of its state."""

    def __init__(self, port: Port, number: int, notes: Notes, clock: Callable[[], float]) -> None:
        self.datagrams = port.datagrams
        self._port, self._number, self._notes, self._clock = port, number, notes, clock
        self._state = CLOSED
        self._is_open = False  # as poll said last
        self._has_number = False  # a descriptor's, on this connection
        self._call = self._uses = self._reads = self._ended_reads = 0

    @property
    def cause(self) -> str:
        return self._port.cause

    @property
    def opened(self) -> int:
        return self._port.opened

    @property
    def backlog(self) -> int:
        return self._port.backlog

    def fileno(self) -> int:
        return self._port.fileno()

    def poll(self, now_s: float) -> bool:
        self._use()
        is_open = self._is_open = self._port.poll(now_s)
        self._has_number = is_open and self._port.fileno() >= 0
        self._tell_state(now_s)
        return is_open

    def read(self) -> list[bytes]:
        self._use()
        pieces = self._port.read()
        self._reads += 1
        if pieces:
            self._tell_pieces(pieces)
        self._tell_state()
        return pieces

    def write(self, data: bytes) -> None:
        self._use()
        if data:
            self._notes.note(self._clock(), OUT, self._number, data)
        self._port.write(data)
        self._tell_state()

    def close(self) -> None:
        self._port.close()

    def _use(self) -> None:
        if self._call != self._notes.calls:
            self._call = self._notes.calls
            self._uses = self._reads = self._ended_reads = 0
        self._uses += 1

    def _tell_pieces(self, pieces: list[bytes]) -> None:
        """They came with this read, not with an earlier one of this call."""
        now_s = self._clock()
        while self._ended_reads < self._reads - 1:
            self._ended_reads += 1
            self._notes.note(now_s, READ_ENDED, self._number)
        for piece in pieces:
            self._notes.note(now_s, IN, self._number, piece)

    def _tell_state(self, now_s: float | None = None) -> None:
        port = self._port
        if self._has_number and self._is_open and port.fileno() < 0:
            self._is_open = False  # its end was found by reading or writing
        state = (self._is_open, port.opened, port.cause, port.backlog)
        if state == self._state:
            return
        before, self._state = self._state, state
        now_s = self._clock() if now_s is None else now_s
        if state[1] != before[1]:
            self._notes.note(now_s, OPENED, self._number)
        if not state[0] and state[:3] != before[:3]:
            self._notes.note(now_s, LOST, self._number, port.cause.encode())
        use = min(self._uses, MOST_USES)
        told = PORT_STATE.pack(use, state[0], state[1], min(state[3], MOST_BACKLOG))
        self._notes.note(now_s, CHANGED, self._number, told + port.cause.encode())


class RecordedConnection(RecordedPort):
    """Of a port that can get a fresh connection."""

    @property
    def silence_s(self) -> float:
        return cast(Reopens, self._port).silence_s

    def reopen(self, cause: str) -> None:
        self._use()
        cast(Reopens, self._port).reopen(cause)
        self._tell_state()


class RecordedLine(RecordedConnection):
    """Of a serial line."""

    def gather(self, size: int) -> None:
        cast(Gathers, self._port).gather(size)


def recorded(port: Port, number: int, notes: Notes, clock: Callable[[], float]) -> RecordedPort:
    """The port as one that tells, which can neither less nor more than itself."""
    if not isinstance(port, Reopens):
        return RecordedPort(port, number, notes, clock)
    kind = RecordedLine if isinstance(port, Gathers) else RecordedConnection
    return kind(port, number, notes, clock)


def abilities(port: Port) -> dict[str, Any]:
    """What a replay must know of a port beside what happens to it."""
    silence_s = port.silence_s if isinstance(port, Reopens) else None
    gathers = isinstance(port, Gathers)
    return {"datagrams": port.datagrams, "silence_s": silence_s, "gathers": gathers}
