"""Ports that give what recorded ones gave, and take what the app writes, which goes nowhere.

The app must see of a port what it saw when it was recorded, and at the same moment. A use is a
poll, a read, a write or a reopening. What a port became (C) is known with the number of the use
that it came by, counted from the beginning of the app's present call; which read brought some bytes
is known by the reads that ended before it (N).
"""

from collections import deque
from dataclasses import dataclass

from core.config import Config
from recording.reader import Recording, Wire
from recording.records import PORT_STATE

DEVICES = 3  # ports of a recording before the first planner's
ASKED_KEPT = 64  # writes, of which one at most waits for its answer


@dataclass(frozen=True, slots=True)
class Became:
    """What a port was after a use."""

    use: int  # of the app's call, from 1
    is_open: bool
    opened: int
    backlog: int
    cause: str


def became_from_bytes(data: bytes) -> Became:
    use, is_open, opened, backlog = PORT_STATE.unpack_from(data)
    cause = data[PORT_STATE.size :].decode(errors="replace")
    return Became(use, bool(is_open), opened, backlog, cause)


class PlayedPort:
    """One wire of a recording, as the app saw it."""

    def __init__(self, datagrams: bool) -> None:
        self.datagrams, self.cause, self.opened, self.backlog = datagrams, "not opened yet", 0, 0
        self.written: list[bytes] = []  # in the newest call
        self.asked: deque[tuple[float, bytes]] = deque(maxlen=ASKED_KEPT)  # by the recorded app
        self._is_open = False
        self._uses = 0
        self._states: deque[Became] = deque()
        self._reads: deque[list[bytes]] = deque()  # what each read of the next call gives

    # What the recording says, before the call in which it happened

    def becomes(self, state: Became) -> None:
        self._states.append(state)

    def arrives(self, data: bytes) -> None:
        if not self._reads:
            self._reads.append([])
        self._reads[-1].append(data)

    def ends_read(self) -> None:
        if not self._reads:
            self._reads.append([])
        self._reads.append([])

    def end_call(self) -> None:
        """What the call did not use stays for the next one: no byte is lost."""
        while self._states:
            self._take(self._states.popleft())
        if self._reads:
            rest = [piece for pieces in self._reads for piece in pieces]
            self._reads.clear()
            if rest:
                self._reads.append(rest)
        self._uses = 0
        if self.written:
            self.written = []

    # What the app does

    def fileno(self) -> int:
        """No descriptor: only whether there would be one."""
        return 0 if self._is_open else -1

    def poll(self, now_s: float) -> bool:
        self._used()
        return self._is_open

    def read(self) -> list[bytes]:
        self._used()
        return self._reads.popleft() if self._reads else []

    def write(self, data: bytes) -> None:
        if data and self._is_open:
            self.written.append(data)
        self._used()

    def close(self) -> None:
        """Nothing to let go of."""

    def _used(self) -> None:
        self._uses += 1
        while self._states and self._states[0].use <= self._uses:
            self._take(self._states.popleft())

    def _take(self, state: Became) -> None:
        self._is_open, self.opened = state.is_open, state.opened
        self.backlog, self.cause = state.backlog, state.cause


class ReopeningPlayedPort(PlayedPort):
    """One of a wire that the app may have opened anew."""

    def __init__(self, datagrams: bool, silence_s: float) -> None:
        super().__init__(datagrams)
        self.silence_s = silence_s

    def reopen(self, cause: str) -> None:
        """What came of it then is recorded."""
        self._used()

    def gather(self, size: int) -> None:
        """Nothing: how pieces were cut is recorded. A serial line has this."""


def played_ports(recording: Recording, config: Config) -> list[PlayedPort]:
    """The ports of a recording, and one that stays closed for each planner that it has not."""
    count = max(DEVICES + len(config.planner.ports), len(recording.ports))
    closed = Wire(datagrams=True, silence_s=None)
    absent = [closed] * (count - len(recording.ports))
    return [
        PlayedPort(wire["datagrams"])
        if wire["silence_s"] is None
        else ReopeningPlayedPort(wire["datagrams"], wire["silence_s"])
        for wire in [*recording.wires, *absent]
    ]
