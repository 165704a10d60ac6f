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
NOT_OPENED = "not opened yet"  # the cause before a port's first use


class Notes(Protocol):
    """Takes what happens."""

    calls: int  # of the app so far

    def note(
        self, t_s: float, kind: bytes, port: int = 0, data: bytes = b"", more: bytes = b""
    ) -> None:
        """One record. `more`: the rest of its data, where that is large: it is not copied."""


class RecordedPort:
    """A port, and a record of each connection, loss, piece and change of its state.

    What a port says of itself changes only with a use of it, so it is copied after each.
    """

    def __init__(self, port: Port, number: int, notes: Notes, clock: Callable[[], float]) -> None:
        self.datagrams = port.datagrams
        self.opened, self.cause, self.backlog = 0, NOT_OPENED, 0  # as told last
        self._port, self._number, self._notes, self._clock = port, number, notes, clock
        self._is_open = self._told_open = False  # as poll said last, as told last
        self._has_number = False  # a descriptor's, on this connection
        self._call = self._uses = self._reads = self._ended_reads = 0

    def fileno(self) -> int:
        return self._port.fileno()

    def poll(self, now_s: float) -> bool:
        if self._call != self._notes.calls:
            self._begin_call()
        self._uses += 1
        port = self._port
        is_open = port.poll(now_s)
        if is_open is not self._is_open or port.opened != self.opened:
            self._is_open = is_open
            self._has_number = is_open and port.fileno() >= 0
        self._tell_state(now_s)
        return is_open

    def read(self) -> list[bytes]:
        if self._call != self._notes.calls:
            self._begin_call()
        self._uses += 1
        pieces = self._port.read()
        self._reads += 1
        if pieces:
            self._tell_pieces(pieces)
        self._tell_state()
        return pieces

    def write(self, data: bytes) -> None:
        if self._call != self._notes.calls:
            self._begin_call()
        self._uses += 1
        if data:
            self._notes.note(self._clock(), OUT, self._number, data)
        self._port.write(data)
        self._tell_state()

    def close(self) -> None:
        self._port.close()
        self.cause, self.backlog = self._port.cause, self._port.backlog

    def _begin_call(self) -> None:
        """The first use in this call of the app."""
        self._call = self._notes.calls
        self._uses = self._reads = self._ended_reads = 0

    def _tell_pieces(self, pieces: list[bytes]) -> None:
        """They came with this read, not with an earlier one of this call."""
        now_s = self._clock()
        while self._ended_reads < self._reads - 1:
            self._ended_reads += 1
            self._notes.note(now_s, READ_ENDED, self._number)
        for piece in pieces:
            self._notes.note(now_s, IN, self._number, piece)

    def _tell_state(self, now_s: float | None = None) -> None:
        """Of nearly all uses there is nothing to tell."""
        port, is_open = self._port, self._is_open
        opened, cause, backlog = port.opened, port.cause, port.backlog
        if (
            opened == self.opened
            and cause == self.cause
            and backlog == self.backlog
            and is_open is self._told_open
        ):
            return
        has_new_cause, is_new_connection = cause != self.cause, opened != self.opened
        if has_new_cause and self._has_number and port.fileno() < 0:
            is_open = self._is_open = False  # its end was found by reading or writing
        has_turned = is_open is not self._told_open
        self.opened, self.cause, self.backlog, self._told_open = opened, cause, backlog, is_open
        now_s = self._clock() if now_s is None else now_s
        if is_new_connection:
            self._notes.note(now_s, OPENED, self._number)
        if not is_open and (has_turned or has_new_cause or is_new_connection):
            self._notes.note(now_s, LOST, self._number, cause.encode())
        use = min(self._uses, MOST_USES)
        told = PORT_STATE.pack(use, is_open, opened, min(backlog, MOST_BACKLOG))
        self._notes.note(now_s, CHANGED, self._number, told + cause.encode())


class RecordedConnection(RecordedPort):
    """Of a port that can get a fresh connection."""

    def __init__(self, port: Port, number: int, notes: Notes, clock: Callable[[], float]) -> None:
        super().__init__(port, number, notes, clock)
        self.silence_s = cast(Reopens, port).silence_s

    def reopen(self, cause: str) -> None:
        if self._call != self._notes.calls:
            self._begin_call()
        self._uses += 1
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
