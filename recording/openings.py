"""How each device's connection began: kept beside what is newest, for files that begin later.

A device is asked and set up when its port opens. What it answered then says what its bytes mean,
and is nowhere else. Nothing is decoded here: of each connection the first records are kept, for
what is said before a device delivers is little beside what it delivers.
"""

from collections import deque
from collections.abc import Sequence

from recording.records import CHANGED, HEAD, LOST, OPENED, Record

KEPT_BYTES = 1 << 16  # of a connection, with HEAD: minutes of asking, or ten seconds of an MTi
MOST = 32  # connections of a port: of one that comes and goes all the time, the newest
PLANNER = "planner"  # tells again and again what counts: of its ports the state is enough


class Opening:
    """The begin of one connection and its newest state; or how it was lost."""

    def __init__(self, most_bytes: int, sequence: int, t_s: float) -> None:
        """`sequence`: of its first record, `t_s`: when that was."""
        self.sequence, self.t_s = sequence, t_s
        self._left = most_bytes
        self._first: list[tuple[int, Record]] = []
        self._state: list[tuple[int, Record]] = []  # the newest, where `first` has no room for it

    @property
    def records(self) -> list[tuple[int, Record]]:
        """With their numbers, in order."""
        return self._first + self._state

    def take(self, record: Record, sequence: int) -> None:
        if self._left <= 0 and record.kind != CHANGED:
            return
        self._left -= HEAD.size + len(record.data)
        if self._left >= 0:
            self._first.append((sequence, record))
            return
        self._left = 0  # from here on nothing is kept but the state
        if record.kind == CHANGED:
            self._state = [(sequence, record)]


class Openings:
    """Those of all ports of a run, as far as a file may begin behind them.

    Args:
        reach_s: so long ago a file may begin that is not there yet.
    """

    def __init__(self, ports: Sequence[str], reach_s: float) -> None:
        self._most_bytes = [0 if name == PLANNER else KEPT_BYTES for name in ports]
        self._of = [deque([Opening(most, 0, 0.0)], MOST) for most in self._most_bytes]
        self._reach_s = reach_s

    def take(self, t_s: float, kind: bytes, port: int, data: bytes, sequence: int) -> None:
        """A record of a port, with its number."""
        known = self._of[port]
        if kind in (OPENED, LOST):
            known.append(Opening(self._most_bytes[port], sequence, t_s))
            while len(known) > 1 and known[1].t_s < t_s - self._reach_s:
                known.popleft()
        known[-1].take(Record(t_s, kind, port, data), sequence)

    def before(self, sequence: int) -> list[Record]:
        """What a file that begins with this number lacks, in order."""
        found: list[tuple[int, Record]] = []
        for known in self._of:
            begun = [opening for opening in known if opening.sequence < sequence]
            found += begun[-1].records if begun else []
        found.sort(key=lambda entry: entry[0])
        return [record for number, record in found if number < sequence]
