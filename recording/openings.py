"""How each device's connection began: kept beside what is newest, for files that begin later.

A device is asked and set up when its port opens. What it answered then says what its bytes mean,
and is nowhere else. Nothing is decoded here: of each connection the first records are kept, for
what is said before a device delivers is little beside what it delivers.
"""

from collections.abc import Sequence

from recording.records import CHANGED, HEAD, LOST, OPENED, Record

KEPT_BYTES = 1 << 16  # of a connection, with HEAD: minutes of asking, or ten seconds of an MTi
PLANNER = "planner"  # tells again and again what counts: of its ports the state is enough


class Opening:
    """The begin of one port's newest connection, and its newest state; or how it was lost."""

    def __init__(self, most_bytes: int) -> None:
        self._most_bytes = self._left = most_bytes
        self._first: list[tuple[int, Record]] = []
        self._state: list[tuple[int, Record]] = []  # the newest, where `first` has no room for it

    @property
    def records(self) -> list[tuple[int, Record]]:
        """With their numbers, in order."""
        return self._first + self._state

    def take(self, t_s: float, kind: bytes, port: int, data: bytes, sequence: int) -> None:
        if kind in (OPENED, LOST):
            self._left, self._first, self._state = self._most_bytes, [], []
        elif self._left <= 0 and kind != CHANGED:
            return
        entry = sequence, Record(t_s, kind, port, data)
        self._left -= HEAD.size + len(data)
        if self._left >= 0:
            self._first.append(entry)
            return
        self._left = 0  # from here on nothing is kept but the state
        if kind == CHANGED:
            self._state = [entry]


class Openings:
    """Those of all ports of a run."""

    def __init__(self, ports: Sequence[str]) -> None:
        self._of = [Opening(0 if name == PLANNER else KEPT_BYTES) for name in ports]

    def take(self, t_s: float, kind: bytes, port: int, data: bytes, sequence: int) -> None:
        """A record of a port, with its number."""
        self._of[port].take(t_s, kind, port, data, sequence)

    def before(self, sequence: int) -> list[Record]:
        """What a file that begins with this number lacks, in order."""
        found = [entry for opening in self._of for entry in opening.records]
        found.sort(key=lambda entry: entry[0])
        return [record for number, record in found if number < sequence]
